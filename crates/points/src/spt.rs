//! Sequential point trees as published, to compare with: every inner node is a point of its own, and every point carries the
//! range of distances at which it is drawn.

use crate::frame::Frame;
use crate::record::{Item, Record, Wide, sort, unpack};
use crate::{Grid, Point};
use glam::Vec3;

/// A node of an [`Spt`]: 24 bytes.
///
/// `e` are world errors; dividing them by the angle ε gives the r_min and r_max of the paper.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct SptNode {
    /// Position relative to the least corner of the cloud.
    pub position: [f32; 3],
    /// Mean colour.
    pub colour: [u8; 4],
    /// Error of drawing this node: the diagonal of the smallest cell around its points; 0 for a point of the input.
    pub error: f32,
    /// Error of the node above.
    pub error_above: f32,
}

/// A sequential point tree with averaged inner nodes, sorted by the error of the nodes above.
#[derive(Clone, Debug)]
pub struct Spt {
    nodes: Vec<SptNode>,
    leaves: usize,
}

impl Spt {
    /// Builds the tree of some points.
    ///
    /// # Cost
    /// Sorting; 24 bytes a node, some 1.5 nodes a point.
    pub fn build(grid: &Grid, points: &[Point]) -> Self {
        let fold = |f: fn(i32, i32) -> i32| {
            let start = points.first().map_or([0; 3], |p| p.position);
            points.iter().fold(start, |a, p| [0, 1, 2].map(|k| f(a[k], p.position[k])))
        };
        let frame = Frame::around(fold(i32::min), fold(i32::max));
        let pack = |p: &Point| {
            let [r, g, b, _] = p.colour;
            let rgb = u32::from(r) << 16 | u32::from(g) << 8 | u32::from(b);
            Wide::<0>::pack(frame.local(p.position), rgb, [])
        };
        let mut records: Vec<Wide<0>> = points.iter().map(pack).collect();
        sort(&mut records, &mut Vec::new(), frame.bits);
        let mut builder = Builder { scale: grid.scale.as_vec3(), frame, nodes: Vec::new() };
        if !records.is_empty() {
            builder.visit(&records, f32::INFINITY);
        }
        let mut nodes = builder.nodes;
        nodes.sort_by(|a, b| b.error_above.total_cmp(&a.error_above));
        Self { nodes, leaves: points.len() }
    }

    /// All nodes, by falling error of the nodes above.
    pub fn nodes(&self) -> &[SptNode] {
        &self.nodes
    }

    /// Inner nodes, which are points that were not there before.
    pub fn inner_nodes(&self) -> usize {
        self.nodes.len() - self.leaves
    }

    /// Nodes that have to be processed where no error above `tolerance` is allowed.
    pub fn prefix(&self, tolerance: f32) -> usize {
        self.nodes.partition_point(|n| n.error_above > tolerance)
    }

    /// Nodes that are drawn where the tolerance is the same for all.
    pub fn drawn(&self, tolerance: f32) -> impl Iterator<Item = &SptNode> {
        self.nodes[..self.prefix(tolerance)].iter().filter(move |n| n.error <= tolerance)
    }
}

struct Builder {
    scale: Vec3,
    frame: Frame,
    nodes: Vec<SptNode>,
}

/// Sums over the points below a node.
#[derive(Clone, Copy, Default)]
struct Sums {
    position: [f64; 3],
    colour: [u64; 3],
    count: u64,
}

impl Builder {
    /// Adds the node of some records that lie in one cell, and all below; the depth of the recursion is that of the octree.
    fn visit(&mut self, records: &[Wide<0>], error_above: f32) -> Sums {
        let (first, last) = (records[0], records[records.len() - 1]);
        if records.len() == 1 {
            let (p, c) = (first.local(), unpack(first.rgb()));
            let sums = Sums { position: p.map(f64::from), colour: c.map(u64::from), count: 1 };
            self.push(&sums, 0.0, error_above);
            return sums;
        }
        let height = first.height(&last);
        let edge = self.frame.edge(self.frame.bits - height) as f32;
        let error = if height == 0 { 0.0 } else { (self.scale * edge).length() };
        let mut sums = Sums::default();
        let mut start = 0;
        while start < records.len() {
            // The next child: records that share the digit at which this node divides.
            let child = if height == 0 {
                1
            } else {
                records[start..].partition_point(|r| r.height(&records[start]) < height)
            };
            let below = self.visit(&records[start..start + child], error);
            (0..3).for_each(|k| {
                sums.position[k] += below.position[k];
                sums.colour[k] += below.colour[k];
            });
            sums.count += below.count;
            start += child;
        }
        self.push(&sums, error, error_above);
        sums
    }

    fn push(&mut self, sums: &Sums, error: f32, error_above: f32) {
        let n = sums.count as f64;
        let scale = self.scale.to_array();
        let position = [0, 1, 2].map(|k| (sums.position[k] / n) as f32 * scale[k]);
        let [r, g, b] = sums.colour.map(|c| (c as f64 / n).round() as u8);
        self.nodes.push(SptNode { position, colour: [r, g, b, 255], error, error_above });
    }
}
