//! Nodes of the outer octree as they are written.

use crate::frame::{Cell, Frame};
use crate::point::Point;
use crate::record::Item;
use crate::tree::Sink;

/// What the index says about a node.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Node {
    pub cell: Cell,
    /// Level of the first entry of its counts.
    pub first: u32,
    /// Range of its counts: points per level.
    pub counts: std::ops::Range<usize>,
    pub points: u32,
    /// CRC-32 of its payload.
    pub crc: u32,
    /// Least and greatest local coordinates of its points.
    pub box_min: [u32; 3],
    pub box_max: [u32; 3],
}

/// Nodes in the order in which they are stored, with their payload.
#[derive(Debug, Default)]
pub(crate) struct Block {
    pub payload: Vec<u8>,
    pub nodes: Vec<Node>,
    pub counts: Vec<u32>,
}

impl Block {
    pub fn clear(&mut self) {
        self.payload.clear();
        self.nodes.clear();
        self.counts.clear();
    }
}

/// Where a node's bytes go.
pub(crate) trait Output {
    fn put(&mut self, bytes: &[u8]);
}

impl Output for Vec<u8> {
    fn put(&mut self, bytes: &[u8]) {
        self.extend_from_slice(bytes);
    }
}

/// Writes nodes to an output, and what the index needs of them to two lists.
pub(crate) struct Encoder<'a, O, F, G> {
    pub output: &'a mut O,
    pub nodes: &'a mut Vec<Node>,
    pub counts: &'a mut Vec<u32>,
    pub frame: Frame,
    /// Attribute bytes of a point.
    pub attribute_bytes: usize,
    /// Turns an item into a point.
    pub decode: F,
    /// Its attributes.
    pub attributes: G,
}

/// Bytes of a point without attributes.
pub(crate) const POINT_BYTES: usize = 16;

/// Points that are encoded before they go to the output.
const PIECE: usize = 256;

impl<const W: usize, T: Item, O: Output, F: Fn(&T) -> Point, G: Fn(&T) -> [u64; W]> Sink<T>
    for Encoder<'_, O, F, G>
{
    fn store(&mut self, outer: usize, first: usize, lists: &[Vec<T>]) {
        let Some(skip) = lists.iter().position(|l| !l.is_empty()) else { return };
        let end = lists.iter().rposition(|l| !l.is_empty()).map_or(skip, |i| i + 1);
        let lists = &lists[skip..end];
        let first_count = self.counts.len();
        let mut hasher = crc32fast::Hasher::new();
        let (mut box_min, mut box_max) = ([u32::MAX; 3], [0; 3]);
        let mut piece = [Point::default(); PIECE];
        for list in lists {
            for items in list.chunks(PIECE) {
                for (item, point) in items.iter().zip(&mut piece) {
                    *point = (self.decode)(item);
                    let local = self.frame.local(point.position);
                    for k in 0..3 {
                        box_min[k] = box_min[k].min(local[k]);
                        box_max[k] = box_max[k].max(local[k]);
                    }
                }
                let bytes = bytemuck::cast_slice(&piece[..items.len()]);
                hasher.update(bytes);
                self.output.put(bytes);
            }
            self.counts.push(list.len() as u32);
        }
        if self.attribute_bytes > 0 {
            let mut piece = Vec::with_capacity(PIECE * self.attribute_bytes);
            for items in lists.iter().flat_map(|list| list.chunks(PIECE)) {
                piece.clear();
                for item in items {
                    let attributes = (self.attributes)(item);
                    let bytes: &[u8] = bytemuck::cast_slice(&attributes);
                    piece.extend_from_slice(&bytes[..self.attribute_bytes]);
                }
                hasher.update(&piece);
                self.output.put(&piece);
            }
        }
        self.nodes.push(Node {
            cell: Cell::around(box_min, outer as u32, self.frame.bits),
            first: (first + skip) as u32,
            counts: first_count..self.counts.len(),
            points: lists.iter().map(Vec::len).sum::<usize>() as u32,
            crc: hasher.finalize(),
            box_min,
            box_max,
        });
    }
}
