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

/// Writes nodes into a block.
pub(crate) struct Encoder<'a, F, G> {
    pub block: &'a mut Block,
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

impl<const W: usize, T: Item, F: Fn(&T) -> Point, G: Fn(&T) -> [u64; W]> Sink<T> for Encoder<'_, F, G> {
    fn store(&mut self, outer: usize, first: usize, lists: &[Vec<T>]) {
        let Some(skip) = lists.iter().position(|l| !l.is_empty()) else { return };
        let end = lists.iter().rposition(|l| !l.is_empty()).map_or(skip, |i| i + 1);
        let lists = &lists[skip..end];
        let (start, first_count) = (self.block.payload.len(), self.block.counts.len());
        let points: usize = lists.iter().map(Vec::len).sum();
        self.block.payload.reserve(points * (POINT_BYTES + self.attribute_bytes));
        let (mut box_min, mut box_max) = ([u32::MAX; 3], [0; 3]);
        for list in lists {
            for item in list {
                let point = (self.decode)(item);
                let local = self.frame.local(point.position);
                for k in 0..3 {
                    box_min[k] = box_min[k].min(local[k]);
                    box_max[k] = box_max[k].max(local[k]);
                }
                self.block.payload.extend_from_slice(bytemuck::bytes_of(&point));
            }
            self.block.counts.push(list.len() as u32);
        }
        if self.attribute_bytes > 0 {
            for item in lists.iter().flatten() {
                let attributes = (self.attributes)(item);
                let bytes: &[u8] = bytemuck::cast_slice(&attributes);
                self.block.payload.extend_from_slice(&bytes[..self.attribute_bytes]);
            }
        }
        self.block.nodes.push(Node {
            cell: Cell::around(box_min, outer as u32, self.frame.bits),
            first: (first + skip) as u32,
            counts: first_count..self.block.counts.len(),
            points: points as u32,
            crc: crc32fast::hash(&self.block.payload[start..]),
            box_min,
            box_max,
        });
    }
}
