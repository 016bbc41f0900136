//! The tree of a store: what stays in memory of every node.

use crate::cell::{BITS, Cell, Cube, Lattice, place};
use crate::piece::Attributes;
use farsight_geometry::DAabb;
use farsight_geometry::accuracy::{ErrorBound, Unit};
use glam::{DVec3, Vec3};

/// A node of a [`Tree`], numbered level by level from the root on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId(pub u32);

/// Which of a node's meshes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Mesh {
    /// With attributes, if the store has any.
    #[default]
    Full,
    /// Simplified for distance alone, without attributes: what casts shadows needs no more. The same as [`Full`](Self::Full) but for its attributes
    /// where the store has none, or nothing was simplified.
    Shape,
}

impl Mesh {
    pub(crate) fn index(self) -> usize {
        match self {
            Self::Full => 0,
            Self::Shape => 1,
        }
    }
}

/// A coded mesh in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Stored {
    pub offset: u64,
    pub shape_bytes: u32,
    pub looks_bytes: u32,
    pub shape_crc: u32,
    pub looks_crc: u32,
    pub positions: u32,
    pub vertices: u32,
    pub triangles: u32,
    /// Two-sided Hausdorff distance to the input, in world units.
    pub error: f64,
    /// Error of appearance, off and along the surface, in world units; estimated.
    pub look_error: f64,
}

/// A box in units of the lattice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LatticeBox {
    pub min: Lattice,
    pub max: Lattice,
}

impl LatticeBox {
    pub(crate) const EMPTY: Self = Self { min: [i32::MAX; 3], max: [i32::MIN; 3] };

    pub(crate) fn of(points: &[Lattice]) -> Self {
        points.iter().fold(Self::EMPTY, |b, &p| b.union(Self { min: p, max: p }))
    }

    pub(crate) fn union(self, o: Self) -> Self {
        let each = |f: fn(i32, i32) -> i32, a: Lattice, b: Lattice| [0, 1, 2].map(|k| f(a[k], b[k]));
        Self { min: each(i32::min, self.min, o.min), max: each(i32::max, self.max, o.max) }
    }
}

/// Directions within an angle of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cone {
    pub axis: Vec3,
    /// At least π: all directions.
    pub angle: f32,
}

impl Cone {
    pub(crate) const ALL: Self = Self { axis: Vec3::Z, angle: 4.0 };

    /// Around some cones; angles are rounded up.
    pub(crate) fn around(cones: &[Self]) -> Self {
        if cones.iter().any(|c| c.angle >= std::f32::consts::PI) {
            return Self::ALL;
        }
        let sum: DVec3 = cones.iter().map(|c| c.axis.as_dvec3()).sum();
        let Some(axis) = sum.try_normalize() else { return Self::ALL };
        let angle = cones.iter().map(|c| axis.angle_between(c.axis.as_dvec3()) + f64::from(c.angle));
        let angle = angle.fold(0.0, f64::max) + 1e-3;
        if angle < 1.6 { Self { axis: axis.as_vec3(), angle: angle as f32 } } else { Self::ALL }
    }

    /// Around the normals of triangles.
    pub(crate) fn of(at: &[Lattice], triangles: &[[u32; 3]]) -> Self {
        let place = |v: u32| place(at[v as usize]);
        let normal = |t: &[u32; 3]| {
            let [a, b, c] = t.map(place);
            (b - a).cross(c - a).try_normalize()
        };
        let sum: DVec3 = triangles.iter().filter_map(normal).sum();
        let Some(axis) = sum.try_normalize() else { return Self::ALL };
        let angle = triangles.iter().filter_map(normal).map(|n| axis.angle_between(n)).fold(0.0, f64::max);
        let angle = angle + 1e-3;
        if angle < 1.6 { Self { axis: axis.as_vec3(), angle: angle as f32 } } else { Self::ALL }
    }
}

/// What is known of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Node {
    pub cell: Cell,
    /// Children that there are, a bit each.
    pub children: u8,
    pub first_child: u32,
    pub parent: u32,
    /// Around its mesh and all below it.
    pub bounds: LatticeBox,
    /// Normals of its mesh and of all below it.
    pub cone: Cone,
    /// With attributes; for shape alone.
    pub meshes: [Stored; 2],
}

pub(crate) const NO_NODE: u32 = u32::MAX;

/// The nodes of a store: boxes, errors, sizes. Everything that choosing needs and nothing that drawing needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    pub(crate) cube: Cube,
    pub(crate) nodes: Vec<Node>,
    pub(crate) world: Vec<DAabb>,
    pub(crate) attributes: Attributes,
    /// Denominator of the tolerance: a node's edge over this.
    pub(crate) resolution: f64,
    /// Steps along a node's edge by level, for inner nodes and leaves.
    pub(crate) steps: Steps,
    pub(crate) input_triangles: u64,
}

/// How fine the lattices of nodes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Steps {
    /// Powers of two along an inner node's edge.
    pub inner: u32,
    /// Units, as a power of two, that no leaf's step exceeds.
    pub leaf_most: u32,
}

impl Steps {
    /// Units in a step of a node.
    pub(crate) fn of(&self, cell: &Cell, is_leaf: bool) -> i32 {
        let edge = BITS - cell.level;
        let power = edge.saturating_sub(self.inner);
        // Meshes of two levels above have f32 coordinates while they are simplified: 23 bits.
        let leaf = power.min(self.leaf_most.max(edge.saturating_sub(21)));
        1 << if is_leaf { leaf } else { power }
    }
}

impl Tree {
    /// All nodes, parents before children.
    pub fn ids(&self) -> impl ExactSizeIterator<Item = NodeId> + use<> {
        (0..self.nodes.len() as u32).map(NodeId)
    }

    /// The root, unless the store is empty.
    pub fn root(&self) -> Option<NodeId> {
        (!self.nodes.is_empty()).then_some(NodeId(0))
    }

    /// Nodes directly below.
    pub fn children(&self, node: NodeId) -> impl ExactSizeIterator<Item = NodeId> + use<> {
        let n = &self.nodes[node.0 as usize];
        (n.first_child..n.first_child + n.children.count_ones()).map(NodeId)
    }

    /// The node above.
    pub fn parent(&self, node: NodeId) -> Option<NodeId> {
        let parent = self.nodes[node.0 as usize].parent;
        (parent != NO_NODE).then_some(NodeId(parent))
    }

    /// Whether the input itself is stored here, cut at the cell's walls and rounded.
    pub fn is_leaf(&self, node: NodeId) -> bool {
        self.nodes[node.0 as usize].children == 0
    }

    /// Steps from the root.
    pub fn level(&self, node: NodeId) -> u32 {
        self.nodes[node.0 as usize].cell.level
    }

    /// Box in the world around a node's meshes and everything below it.
    pub fn bounds(&self, node: NodeId) -> DAabb {
        self.world[node.0 as usize]
    }

    /// Edge of a node's cell in the world.
    pub fn edge(&self, node: NodeId) -> f64 {
        f64::from(self.nodes[node.0 as usize].cell.edge()) * self.cube.unit
    }

    /// Two-sided Hausdorff distance between a node's mesh and the input in its cell, rounding of coordinates included: proven.
    pub fn error(&self, node: NodeId, mesh: Mesh) -> ErrorBound {
        ErrorBound::proven(self.stored(node, mesh).error, Unit::Metres)
    }

    /// Distance off and along the surface to where an attribute belongs; estimated. `None` without attributes.
    pub fn look_error(&self, node: NodeId) -> Option<ErrorBound> {
        let error = self.stored(node, Mesh::Full).look_error;
        self.attributes.any().then(|| ErrorBound::estimated(error, Unit::Metres))
    }

    /// The error that levels of detail are chosen by: that of appearance as well where there are attributes.
    pub(crate) fn chosen_by(&self, node: NodeId, mesh: Mesh) -> f64 {
        let stored = self.stored(node, mesh);
        match mesh {
            Mesh::Full => stored.error.max(stored.look_error),
            Mesh::Shape => stored.error,
        }
    }

    /// Triangles of a node's mesh.
    pub fn triangles(&self, node: NodeId, mesh: Mesh) -> u32 {
        self.stored(node, mesh).triangles
    }

    /// Vertices of a node's mesh.
    pub fn vertices(&self, node: NodeId, mesh: Mesh) -> u32 {
        let stored = self.stored(node, mesh);
        if mesh == Mesh::Full { stored.vertices } else { stored.positions }
    }

    /// Bytes that a node's mesh takes on disk.
    pub fn disk_bytes(&self, node: NodeId, mesh: Mesh) -> u64 {
        let stored = self.stored(node, mesh);
        u64::from(stored.shape_bytes) + if mesh == Mesh::Full { u64::from(stored.looks_bytes) } else { 0 }
    }

    /// Bytes that a node's mesh takes when it is decoded.
    pub fn memory_bytes(&self, node: NodeId, mesh: Mesh) -> u64 {
        let a = self.attributes;
        let looks = if mesh == Mesh::Full {
            12 * u64::from(a.normals) + 8 * u64::from(a.uvs) + 4 * u64::from(a.colours)
        } else {
            0
        };
        u64::from(self.vertices(node, mesh)) * (12 + looks) + 12 * u64::from(self.triangles(node, mesh))
    }

    /// Triangles of the input.
    pub fn input_triangles(&self) -> u64 {
        self.input_triangles
    }

    /// The denominator of the tolerance: no node is farther from the input than its cell's edge over this.
    pub fn resolution(&self) -> f64 {
        self.resolution
    }

    /// Box in the world around everything.
    pub fn world_bounds(&self) -> DAabb {
        self.world.first().copied().unwrap_or(DAabb::EMPTY)
    }

    pub(crate) fn stored(&self, node: NodeId, mesh: Mesh) -> &Stored {
        &self.nodes[node.0 as usize].meshes[mesh.index()]
    }

    /// World boxes of lattice boxes, rounded outwards.
    pub(crate) fn world_box(cube: &Cube, b: &LatticeBox) -> DAabb {
        let margin = cube.slack();
        DAabb { min: cube.leave(b.min), max: cube.leave(b.max) }.inflated(margin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cones_hold_what_they_are_made_of() {
        let at = vec![[0, 0, 0], [100, 0, 0], [0, 100, 0], [0, 0, 40]];
        let cone = Cone::of(&at, &[[0, 1, 2], [1, 2, 3]]);
        for n in [DVec3::Z, DVec3::new(40.0, 40.0, 100.0).normalize()] {
            assert!(cone.axis.as_dvec3().angle_between(n) <= f64::from(cone.angle), "{cone:?}");
        }
        let other = Cone { axis: Vec3::X, angle: 0.1 };
        let both = Cone::around(&[cone, other]);
        assert!(both.axis.angle_between(Vec3::X) + 0.1 <= both.angle);
        assert_eq!(Cone::around(&[other, Cone { axis: -Vec3::X, angle: 0.1 }]), Cone::ALL);
        assert_eq!(Cone::of(&at, &[[0, 1, 2], [0, 2, 1]]), Cone::ALL);
    }

    #[test]
    fn steps_shrink_with_levels_and_leaves_may_be_finer() {
        let steps = Steps { inner: 11, leaf_most: 12 };
        let cell = Cell { level: 3, at: [0; 3] };
        assert_eq!((steps.of(&cell, false), steps.of(&cell, true)), (1 << 16, 1 << 12));
        let deep = Cell { level: 16, at: [0; 3] };
        assert_eq!((steps.of(&deep, false), steps.of(&deep, true)), (1 << 3, 1 << 3));
    }
}
