//! Building the tree: octants, representatives, homes of the triangles, bounds.

use crate::hierarchy::{NONE, Node, VertexHierarchy};
use farsight_geometry::TriangleMesh;
use glam::Vec3;
use std::ops::Range;

/// Most levels that the octree halves boxes for; what is still together lies within rounding and is dealt out evenly.
const MOST_LEVELS: u32 = 64;

/// What is known of a vertex of the mesh: sums over the triangles around it, side by side as each triangle adds to all.
#[derive(Clone, Copy, Default)]
struct Sums {
    normals: Vec3,
    lengths: f32,
    edges: u32,
    /// Farthest corner of the triangles.
    reach: f32,
}

/// The cone of the normals of the triangles around a vertex.
#[derive(Clone, Copy)]
struct Cone {
    axis: Vec3,
    /// The normal farthest from the axis, and how far in terms of [`width`].
    farthest: Vec3,
    width: f64,
}

/// Builds the hierarchy over the triangles `kept`, of three different vertices each.
pub(crate) fn build(mesh: &TriangleMesh, kept: Vec<u32>, dropped: usize) -> VertexHierarchy {
    let (sums, cones) = surroundings(mesh, &kept);
    let mut tree = Octree::new(mesh.positions(), &sums, &cones);
    let count = tree.items.len();
    tree.cluster(0..count, NONE, 0);
    let Octree { items, mut nodes, .. } = tree;
    let vertices: Vec<u32> = items.iter().map(|item| item.vertex).collect();
    let positions: Vec<Vec3> = items.iter().map(|item| item.position).collect();
    let mut place_of = vec![0; mesh.positions().len()];
    vertices.iter().enumerate().for_each(|(place, &v)| place_of[v as usize] = place as u32);
    let (triangles, original) = hang(mesh, kept, &place_of, vertices.len(), &mut nodes);
    bound(&mut nodes, &place_of, &items, &cones);
    nodes.shrink_to_fit();
    VertexHierarchy::from_parts(nodes, vertices, positions, triangles, original, dropped)
}

/// What is known of each vertex. Those without a triangle have no edges.
fn surroundings(mesh: &TriangleMesh, kept: &[u32]) -> (Vec<Sums>, Vec<Cone>) {
    let mut normals = Vec::with_capacity(kept.len());
    let mut sums = vec![Sums::default(); mesh.positions().len()];
    for &t in kept {
        let corners = mesh.corners(t as usize);
        let normal = normal(corners);
        normals.push(normal);
        let corners = corners.map(|p| p.as_dvec3());
        // Of the side across from each corner.
        let side: [f32; 3] = std::array::from_fn(|k| up(corners[(k + 1) % 3].distance(corners[(k + 2) % 3])));
        for k in 0..3 {
            let sums = &mut sums[mesh.triangles()[t as usize][k] as usize];
            sums.normals += normal;
            let (left, right) = (side[(k + 1) % 3], side[(k + 2) % 3]);
            (sums.lengths, sums.edges) = (sums.lengths + left + right, sums.edges + 2);
            sums.reach = sums.reach.max(left.max(right));
        }
    }
    // The normal farthest from each axis; only that one's angle is computed.
    let unknown = |sums: &Sums| {
        let axis = sums.normals.normalize_or_zero();
        Cone { axis, farthest: Vec3::ZERO, width: f64::NEG_INFINITY }
    };
    let mut cones: Vec<Cone> = sums.iter().map(unknown).collect();
    for (&t, &normal) in kept.iter().zip(&normals) {
        for v in mesh.triangles()[t as usize] {
            let cone = &mut cones[v as usize];
            let width = width(cone.axis, normal);
            if width > cone.width {
                (cone.width, cone.farthest) = (width, normal);
            }
        }
    }
    (sums, cones)
}

/// Unit normal, or zero for a triangle without area.
fn normal(c: [Vec3; 3]) -> Vec3 {
    let [a, b, c] = c.map(|p| p.as_dvec3());
    (b - a).cross(c - a).normalize_or_zero().as_vec3()
}

/// Angle between unit vectors, rounded up by more than `f32` loses; π where one is zero.
fn angle(a: Vec3, b: Vec3) -> f32 {
    if a == Vec3::ZERO || b == Vec3::ZERO {
        return std::f32::consts::PI;
    }
    let (a, b) = (a.as_dvec3(), b.as_dvec3());
    (a.cross(b).length().atan2(a.dot(b)) as f32 + 1e-6).min(std::f32::consts::PI)
}

/// What grows with the angle between vectors: its tangent squared up to a right angle, larger values beyond. Largest for a vector without length.
fn width(a: Vec3, b: Vec3) -> f64 {
    let (a, b) = (a.as_dvec3(), b.as_dvec3());
    let (cross, dot) = (a.cross(b).length_squared(), a.dot(b));
    if dot > 0.0 {
        cross / (dot * dot)
    } else if cross == 0.0 && dot == 0.0 {
        f64::INFINITY
    } else {
        // Unit vectors, nearly: from 1e300 up, as the cosine falls to -1.
        1e300 * (1.0 - dot)
    }
}

/// The next `f32` that is not below a number that is not negative. Without a branch: one in two is rounded up.
fn up(x: f64) -> f32 {
    let near = x as f32;
    f32::from_bits(near.to_bits() + u32::from(f64::from(near) < x))
}

/// A vertex on its way to its place, with what is asked of it on every level.
#[derive(Clone, Copy)]
struct Item {
    position: Vec3,
    /// Curvature times mean edge length.
    weight: f32,
    /// Farthest corner of the triangles around it.
    reach: f32,
    /// Half angle of the cone of these triangles' normals.
    spread: f32,
    vertex: u32,
}

/// The tree on its way.
struct Octree {
    items: Vec<Item>,
    nodes: Vec<Node>,
    /// Buffers: the items of the node that is being split, and their octants.
    own: Vec<Item>,
    octants: Vec<u8>,
}

impl Octree {
    /// All vertices that triangles use.
    fn new(positions: &[Vec3], sums: &[Sums], cones: &[Cone]) -> Self {
        let mut items = Vec::with_capacity(positions.len());
        for (vertex, ((&position, sums), cone)) in positions.iter().zip(sums).zip(cones).enumerate() {
            if sums.edges > 0 {
                let spread = angle(cone.axis, cone.farthest);
                let weight = spread * sums.lengths / sums.edges as f32;
                items.push(Item { position, weight, reach: sums.reach, spread, vertex: vertex as u32 });
            }
        }
        Self { items, nodes: Vec::new(), own: Vec::new(), octants: Vec::new() }
    }

    /// Makes the node of some vertices and all below it.
    fn cluster(&mut self, range: Range<usize>, parent: u32, level: u32) {
        let id = self.nodes.len() as u32;
        let bounds = bounds(&self.items[range.clone()]);
        let representative = heaviest(&self.items[range.clone()], bounds);
        self.nodes.push(Node {
            parent,
            end: id + 1,
            first_vertex: range.start as u32,
            first_triangle: 0,
            representative,
            center: Vec3::ZERO,
            radius: 0.0,
            reach: 0.0,
            cone_axis: Vec3::ZERO,
            cone_angle: 0.0,
        });
        for part in self.split(range, bounds, level) {
            if part.len() > 1 {
                self.cluster(part, id, level + 1);
            }
        }
        self.nodes[id as usize].end = self.nodes.len() as u32;
    }

    /// Sorts vertices by the octants of their box: first those that are alone in theirs, then the others. The parts, some of them
    /// empty.
    fn split(&mut self, range: Range<usize>, (low, high): (Vec3, Vec3), level: u32) -> [Range<usize>; 8] {
        let Self { items, own, octants, .. } = self;
        let items = &mut items[range.clone()];
        // Halved first, so that the largest coordinates do not overflow.
        let middle = low * 0.5 + high * 0.5;
        let octant = |p: Vec3| {
            u8::from(p.x > middle.x) | u8::from(p.y > middle.y) << 1 | u8::from(p.z > middle.z) << 2
        };
        own.clear();
        own.extend_from_slice(items);
        octants.clear();
        octants.extend(own.iter().map(|item| octant(item.position)));
        let mut counts = [0; 8];
        octants.iter().for_each(|&o| counts[o as usize] += 1);
        if level >= MOST_LEVELS || counts.contains(&own.len()) {
            // All in one place, or in places that no number lies between.
            let size = own.len().div_ceil(8);
            counts = [0; 8];
            for (i, octant) in octants.iter_mut().enumerate() {
                *octant = (i / size) as u8;
                counts[i / size] += 1;
            }
        }
        let mut next = [0; 8];
        let mut parts = std::array::from_fn(|_| 0..0);
        let mut start = 0;
        let (alone, others) = ((0..8).filter(|&o| counts[o] <= 1), (0..8).filter(|&o| counts[o] > 1));
        for (part, o) in parts.iter_mut().zip(alone.chain(others)) {
            next[o] = start;
            *part = range.start + start..range.start + start + counts[o];
            start += counts[o];
        }
        for (item, &o) in own.iter().zip(octants.iter()) {
            items[next[o as usize]] = *item;
            next[o as usize] += 1;
        }
        parts
    }
}

fn bounds(items: &[Item]) -> (Vec3, Vec3) {
    let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    items.iter().fold(start, |(lo, hi), item| (lo.min(item.position), hi.max(item.position)))
}

/// The mesh vertex that stands for all: the heaviest, then the one nearest to the middle, then by place, so that neither the
/// order of vertices nor that of threads matters.
fn heaviest(items: &[Item], (low, high): (Vec3, Vec3)) -> u32 {
    let most = items.iter().map(|item| item.weight).fold(f32::NEG_INFINITY, f32::max);
    let middle = low + (high - low) * 0.5;
    let nearer = |a: &Item, b: &Item| {
        let [p, q] = [a.position, b.position];
        let distance = |p: Vec3| p.distance_squared(middle);
        let place = || p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)).then(p.z.total_cmp(&q.z));
        distance(p).total_cmp(&distance(q)).then_with(place).is_lt()
    };
    let heaviest = items.iter().filter(|item| item.weight == most);
    heaviest.reduce(|best, item| if nearer(item, best) { item } else { best }).unwrap_or(&items[0]).vertex
}

/// One past the last vertex of a node.
fn end_of(nodes: &[Node], node: u32, count: usize) -> u32 {
    nodes.get(nodes[node as usize].end as usize).map_or(count as u32, |n| n.first_vertex)
}

/// Finds the home of every triangle, the deepest node with two of its corners, and sorts them by it.
fn hang(
    mesh: &TriangleMesh,
    kept: Vec<u32>,
    place_of: &[u32],
    count: usize,
    nodes: &mut [Node],
) -> (Vec<[u32; 3]>, Vec<u32>) {
    // The lowest node of each vertex: later ones lie below earlier ones.
    let mut lowest = vec![0; count];
    for node in 0..nodes.len() as u32 {
        let range = nodes[node as usize].first_vertex..end_of(nodes, node, count);
        lowest[range.start as usize..range.end as usize].fill(node);
    }
    let parents: Vec<u32> = nodes.iter().map(|node| node.parent).collect();
    // Numbers are given depth first: the first node at or above `b` that is not numbered behind `a` has all between itself and where it
    // was left, `a` among it, below it.
    let above_both = |a: u32, mut b: u32| {
        while b > a {
            b = parents[b as usize];
        }
        b
    };
    let mut counts = vec![0u32; nodes.len() + 1];
    let homes: Vec<u32> = kept
        .iter()
        .map(|&t| {
            let mut own = mesh.triangles()[t as usize].map(|v| lowest[place_of[v as usize] as usize]);
            own.sort_unstable();
            // That of the outer two lies above one of these, which are on one path to the root; the deepest has the largest number.
            let home = above_both(own[0], own[1]).max(above_both(own[1], own[2]));
            counts[home as usize + 1] += 1;
            home
        })
        .collect();
    for i in 1..counts.len() {
        counts[i] += counts[i - 1];
    }
    nodes.iter_mut().zip(&counts).for_each(|(node, &first)| node.first_triangle = first);
    let (mut triangles, mut original) = (vec![[0; 3]; kept.len()], vec![0; kept.len()]);
    for (t, home) in kept.into_iter().zip(homes) {
        let at = counts[home as usize] as usize;
        counts[home as usize] += 1;
        triangles[at] = mesh.triangles()[t as usize].map(|v| place_of[v as usize]);
        original[at] = t;
    }
    (triangles, original)
}

/// Radii from all vertices of a node; cones from those of what is right below.
fn bound(nodes: &mut [Node], place_of: &[u32], items: &[Item], cone_of: &[Cone]) {
    let mut cones = Vec::with_capacity(8);
    for id in (0..nodes.len()).rev() {
        let node = nodes[id];
        let end = end_of(nodes, id as u32, items.len());
        let representative = place_of[node.representative as usize];
        let position = items[representative as usize].position;
        let center = position.as_dvec3();
        let (mut radius_sq, mut reach) = (0.0f64, 0.0f64);
        for item in &items[node.first_vertex as usize..end as usize] {
            let d_sq = item.position.as_dvec3().distance_squared(center);
            radius_sq = radius_sq.max(d_sq);
            // A root only where it may matter.
            let own = f64::from(item.reach);
            let missing = reach - own;
            if missing < 0.0 || d_sq > missing * missing {
                reach = reach.max(d_sq.sqrt() + own);
            }
        }
        let radius = radius_sq.sqrt();
        cones.clear();
        let (mut child, mut own_end) = (id + 1, end);
        while child < node.end as usize {
            own_end = own_end.min(nodes[child].first_vertex);
            cones.push((nodes[child].cone_axis, nodes[child].cone_angle));
            child = nodes[child].end as usize;
        }
        let own = &items[node.first_vertex as usize..own_end as usize];
        cones.extend(own.iter().map(|item| (cone_of[item.vertex as usize].axis, item.spread)));
        let node = &mut nodes[id];
        (node.representative, node.center) = (representative, position);
        // A few roundings in `f64` lie far below one in `f32`.
        (node.radius, node.reach) = (up(radius * (1.0 + 1e-14)), up(reach * (1.0 + 1e-14)));
        (node.cone_axis, node.cone_angle) = around_cones(&cones);
    }
}

/// A cone around cones.
fn around_cones(cones: &[(Vec3, f32)]) -> (Vec3, f32) {
    let axis = cones.iter().map(|c| c.0).sum::<Vec3>().normalize_or_zero();
    // An angle is at most c + 0.143 c³ with the chord c (equal for opposite vectors), so few have to be computed.
    let at_most = |&(a, width): &(Vec3, f32)| {
        let chord = axis.distance(a);
        let known = axis != Vec3::ZERO && a != Vec3::ZERO;
        if known { chord * (1.0 + 0.143 * chord * chord) + width + 1e-5 } else { f32::INFINITY }
    };
    let first = cones.iter().max_by(|a, b| at_most(a).total_cmp(&at_most(b)));
    let mut widest = first.map_or(0.0, |&(a, width)| angle(axis, a) + width);
    for cone in cones {
        if at_most(cone) > widest {
            widest = widest.max(angle(axis, cone.0) + cone.1);
        }
    }
    (axis, widest.min(std::f32::consts::PI))
}
