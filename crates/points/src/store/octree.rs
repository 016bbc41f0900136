//! The outer octree in memory.

use super::format::Head;
use super::parse::parents;
use crate::Grid;
use crate::frame::Cell;
use farsight_geometry::DAabb;
use farsight_geometry::accuracy::{ErrorBound, Unit};
use glam::{DVec3, Vec3};
use std::ops::Range;

/// A node of an [`Octree`]: the root is 0, parents come before children, siblings stand together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(pub u32);

/// A node as the file has it.
#[derive(Clone, Debug)]
pub(crate) struct Record {
    pub cell: Cell,
    pub first: u32,
    pub per_level: Vec<u32>,
    pub points: u32,
    pub crc: u32,
    pub offset: u64,
    /// Box of its own points in steps from the cube's corner.
    pub box_min: [u64; 3],
    pub box_max: [u64; 3],
}

/// What a traversal reads of a node: half a cache line.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Walked {
    /// Centre and half extent of everything at and below the node, relative to the octree's corner, rounded outward.
    pub center: Vec3,
    pub half: Vec3,
    pub first_child: u32,
    /// Number of children in the upper 24 bits, level in the lower 8.
    children_level: u32,
}

impl Walked {
    #[inline]
    pub fn children(&self) -> u32 {
        self.children_level >> 8
    }

    #[inline]
    pub fn level(&self) -> u32 {
        self.children_level & 0xff
    }
}

/// How many points a node has, and how far apart.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Size {
    pub points: u32,
    pub spacing: f32,
}

/// Where a node's points are.
#[derive(Clone, Copy, Debug)]
struct Payload {
    offset: u64,
    crc: u32,
    parent: u32,
    first_level: u8,
    counts: (u32, u8),
}

/// A nested octree without its points: small enough to be in memory whatever the size of the cloud.
#[derive(Clone, Debug)]
pub struct Octree {
    head: Head,
    walked: Vec<Walked>,
    payloads: Vec<Payload>,
    counts: Vec<u32>,
    sizes: Vec<Size>,
    points: u64,
}

impl Octree {
    /// Orders nodes breadth first.
    pub(super) fn new(head: Head, records: Vec<Record>) -> Result<Self, String> {
        let bits = head.frame.bits;
        let parents = parents(&records, bits)?;
        let count = records.len();
        // Children of each record, in the order of the file, which is Morton order.
        let mut children: Vec<Vec<u32>> = vec![Vec::new(); count];
        let (mut min, mut max): (Vec<_>, Vec<_>) = records.iter().map(|r| (r.box_min, r.box_max)).unzip();
        for (i, parent) in parents.iter().enumerate() {
            if let Some(parent) = parent.map(|p| p as usize) {
                children[parent].push(i as u32);
                for k in 0..3 {
                    min[parent][k] = min[parent][k].min(min[i][k]);
                    max[parent][k] = max[parent][k].max(max[i][k]);
                }
            }
        }
        let mut order: Vec<u32> = Vec::with_capacity(count);
        order.extend(count.checked_sub(1).map(|root| root as u32));
        let mut out = Self {
            head,
            walked: Vec::with_capacity(count),
            payloads: Vec::with_capacity(count),
            counts: Vec::new(),
            sizes: Vec::with_capacity(count),
            points: 0,
        };
        let mut place = vec![0u32; count];
        let mut next = 0;
        while let Some(&i) = order.get(next) {
            let i = i as usize;
            place[i] = next as u32;
            let own_children = children[i].len() as u32;
            if own_children >= 1 << 24 {
                return Err(format!("a node with {own_children} children"));
            }
            let first_child = order.len() as u32;
            order.extend(&children[i]);
            let parent = parents[i].map_or(0, |p| place[p as usize]);
            out.add(&records[i], min[i], max[i], first_child, own_children, parent);
            next += 1;
        }
        Ok(out)
    }

    fn add(
        &mut self,
        record: &Record,
        min: [u64; 3],
        max: [u64; 3],
        first_child: u32,
        children: u32,
        parent: u32,
    ) {
        let at = |v: [u64; 3]| DVec3::from_array(v.map(|v| v as f64)) * self.head.grid.scale;
        let (min, max) = (at(min), at(max));
        let center = ((min + max) * 0.5).as_vec3();
        // The rounded centre may be anywhere within half an ulp; the half extent covers it, and its own rounding.
        let reach = (max - center.as_dvec3()).max(center.as_dvec3() - min);
        let half = reach.as_vec3() * (1.0 + 2.0 * f32::EPSILON);
        let children_level = children << 8 | record.cell.level;
        self.walked.push(Walked { center, half, first_child, children_level });
        self.payloads.push(Payload {
            offset: record.offset,
            crc: record.crc,
            parent,
            first_level: record.first as u8,
            counts: (self.counts.len() as u32, record.per_level.len() as u8),
        });
        self.counts.extend(&record.per_level);
        let cell = self.cell_edge((record.cell.level + self.head.inner).min(self.head.frame.bits));
        let sparse = if children == 0 { leaf_spacing(max - min, record.points) } else { 0.0 };
        self.sizes.push(Size { points: record.points, spacing: cell.max(sparse) as f32 });
        self.points += u64::from(record.points);
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.walked.len()
    }

    /// Whether there is no node, and so no point.
    pub fn is_empty(&self) -> bool {
        self.walked.is_empty()
    }

    /// All nodes, parents before children.
    pub fn ids(&self) -> impl Iterator<Item = NodeId> + use<> {
        (0..self.walked.len() as u32).map(NodeId)
    }

    /// Number of points.
    pub fn points(&self) -> u64 {
        self.points
    }

    /// The grid of the positions.
    pub fn grid(&self) -> &Grid {
        &self.head.grid
    }

    /// Attribute bytes of a point.
    pub fn attribute_bytes(&self) -> usize {
        self.head.attribute_bytes
    }

    /// What the attributes mean, as the input named it.
    pub fn attributes(&self) -> &str {
        &self.head.attributes
    }

    /// How far positions may be from those that were given; zero for integer input.
    pub fn rounding(&self) -> ErrorBound {
        ErrorBound::proven(self.head.rounding, Unit::Metres)
    }

    /// Levels that a node adds below its cell.
    pub fn inner_depth(&self) -> u32 {
        self.head.inner
    }

    /// World box of all points.
    pub fn world_bounds(&self) -> DAabb {
        if self.is_empty() {
            return DAabb::EMPTY;
        }
        DAabb::new(self.head.grid.world(self.head.frame.lo), self.head.grid.world(self.head.hi))
    }

    /// World box around all points at and below a node.
    ///
    /// # Panics
    /// When there is no such node; so do the other functions that take one.
    pub fn bounds(&self, node: NodeId) -> DAabb {
        let walked = &self.walked[node.0 as usize];
        let center = walked.center.as_dvec3() + self.corner();
        // World coordinates are rounded once more, on either side.
        let slack = (center.abs() + self.head.grid.offset.abs()) * (4.0 * f64::EPSILON);
        DAabb::new(center - walked.half.as_dvec3() - slack, center + walked.half.as_dvec3() + slack)
    }

    /// Children of a node: up to eight, or more where a level between is empty.
    pub fn children(&self, node: NodeId) -> impl Iterator<Item = NodeId> + use<> {
        let walked = &self.walked[node.0 as usize];
        (walked.first_child..walked.first_child + walked.children()).map(NodeId)
    }

    /// The nearest node above; `None` for the root.
    pub fn parent(&self, node: NodeId) -> Option<NodeId> {
        (node.0 > 0).then(|| NodeId(self.payloads[node.0 as usize].parent))
    }

    /// Outer level of a node.
    pub fn level(&self, node: NodeId) -> u32 {
        self.walked[node.0 as usize].level()
    }

    /// Points in a node, those below not counted.
    pub fn node_points(&self, node: NodeId) -> u32 {
        self.sizes[node.0 as usize].points
    }

    /// Bytes of a node's points and attributes.
    pub fn node_bytes(&self, node: NodeId) -> u64 {
        u64::from(self.node_points(node)) * (crate::node::POINT_BYTES + self.head.attribute_bytes) as u64
    }

    /// First level of a node's points, and how many there are of it and the following levels.
    pub fn node_levels(&self, node: NodeId) -> (u32, &[u32]) {
        let p = &self.payloads[node.0 as usize];
        (p.first_level.into(), &self.counts[p.counts.0 as usize..][..p.counts.1 as usize])
    }

    /// Longest edge in the world of the cells of a level.
    pub fn cell_edge(&self, level: u32) -> f64 {
        self.head.frame.edge(level) as f64 * self.head.grid.scale.max_element()
    }

    /// Diagonal in the world of the cells of a level: how far a point may be from the one that represents its cell.
    pub fn cell_diagonal(&self, level: u32) -> f64 {
        // Two points of a cell differ by less than its edge: by one step at least.
        let steps = (self.head.frame.edge(level) - 1) as f64;
        (self.head.grid.scale * steps).length() * (1.0 + 4.0 * f64::EPSILON)
    }

    /// Distance in the world at which splats of a node's points leave no gaps, an estimate: the edge of the cells that it fills; for a
    /// node with nothing below, which may be sparser, what its number of points on the faces of its box would need.
    pub fn node_spacing(&self, node: NodeId) -> f32 {
        self.sizes[node.0 as usize].spacing
    }

    /// World position of the corner that [`Walked`] is relative to.
    pub(crate) fn corner(&self) -> DVec3 {
        self.head.grid.world(self.head.frame.lo)
    }

    /// What a traversal reads of nodes that stand together.
    #[inline]
    pub(crate) fn walk(&self, nodes: Range<u32>) -> impl Iterator<Item = (&Walked, &Size)> {
        let nodes = nodes.start as usize..nodes.end as usize;
        self.walked[nodes.clone()].iter().zip(&self.sizes[nodes])
    }

    /// Offset, number of points and checksum.
    pub(super) fn payload(&self, node: NodeId) -> (u64, usize, u32) {
        let p = &self.payloads[node.0 as usize];
        (p.offset, self.node_points(node) as usize, p.crc)
    }
}

/// Spacing of points that lie at random on a surface as large as three faces of a box: a plane fills one, a corner all.
fn leaf_spacing(extent: DVec3, points: u32) -> f64 {
    let area = extent.x * extent.y + extent.y * extent.z + extent.z * extent.x;
    // Random points leave holes larger than their mean distance.
    const HOLES: f64 = 1.15;
    HOLES * (area / f64::from(points)).sqrt()
}
