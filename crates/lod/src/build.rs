//! Building the tree: octants, representatives, homes of the triangles, bounds.

use crate::hierarchy::{NONE, Node, VertexHierarchy};
use farsight_geometry::TriangleMesh;
use glam::Vec3;

/// Most levels that the octree halves boxes for; what is still together lies within rounding and is dealt out evenly.
const MOST_LEVELS: u32 = 64;

/// What is known of each vertex of the mesh.
struct Surroundings {
    /// Curvature times mean edge length.
    weight: Vec<f32>,
    /// Farthest corner of the triangles around it.
    reach: Vec<f32>,
    /// Cone of the normals of the triangles around it.
    cone: Vec<(Vec3, f32)>,
    used: Vec<bool>,
}

/// Builds the hierarchy over the triangles `kept`, of three different vertices each.
pub(crate) fn build(mesh: &TriangleMesh, kept: Vec<u32>, dropped: usize) -> VertexHierarchy {
    let around = Surroundings::new(mesh, &kept);
    let vertices: Vec<u32> =
        (0..mesh.positions().len() as u32).filter(|&v| around.used[v as usize]).collect();
    let mut tree =
        Octree { positions: mesh.positions(), weight: &around.weight, vertices, nodes: Vec::new() };
    let count = tree.vertices.len();
    tree.cluster(0..count, NONE, 0);
    let Octree { vertices, mut nodes, .. } = tree;
    let positions: Vec<Vec3> = vertices.iter().map(|&v| mesh.positions()[v as usize]).collect();
    let mut place_of = vec![0; mesh.positions().len()];
    vertices.iter().enumerate().for_each(|(place, &v)| place_of[v as usize] = place as u32);
    let (triangles, original) = hang(mesh, kept, &place_of, vertices.len(), &mut nodes);
    bound(&mut nodes, &place_of, &vertices, &positions, &around);
    nodes.shrink_to_fit();
    VertexHierarchy::from_parts(nodes, vertices, positions, triangles, original, dropped)
}

impl Surroundings {
    fn new(mesh: &TriangleMesh, kept: &[u32]) -> Self {
        let n = mesh.positions().len();
        let normals: Vec<Vec3> = kept.iter().map(|&t| normal(mesh.corners(t as usize))).collect();
        let (mut sum, mut length, mut edges) = (vec![Vec3::ZERO; n], vec![0.0f32; n], vec![0u32; n]);
        let (mut reach, mut used) = (vec![0.0f32; n], vec![false; n]);
        for (&t, &normal) in kept.iter().zip(&normals) {
            let corners = mesh.corners(t as usize).map(|p| p.as_dvec3());
            // Of the side across from each corner.
            let side: [f32; 3] =
                std::array::from_fn(|k| up(corners[(k + 1) % 3].distance(corners[(k + 2) % 3])));
            for k in 0..3 {
                let v = mesh.triangles()[t as usize][k] as usize;
                used[v] = true;
                sum[v] += normal;
                let (left, right) = (side[(k + 1) % 3], side[(k + 2) % 3]);
                (length[v], edges[v]) = (length[v] + left + right, edges[v] + 2);
                reach[v] = reach[v].max(left.max(right));
            }
        }
        let axis: Vec<Vec3> = sum.iter().map(|s| s.normalize_or_zero()).collect();
        // The normal farthest from each axis; only that one's angle is computed.
        let mut farthest = vec![(f64::NEG_INFINITY, Vec3::ZERO); n];
        for (&t, &normal) in kept.iter().zip(&normals) {
            for v in mesh.triangles()[t as usize].map(|v| v as usize) {
                let width = width(axis[v], normal);
                if width > farthest[v].0 {
                    farthest[v] = (width, normal);
                }
            }
        }
        let spread: Vec<f32> =
            (0..n).map(|v| if used[v] { angle(axis[v], farthest[v].1) } else { 0.0 }).collect();
        let weight = (0..n).map(|v| spread[v] * length[v] / edges[v].max(1) as f32).collect();
        Self { weight, reach, cone: axis.into_iter().zip(spread).collect(), used }
    }
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

/// The next `f32` that is not below.
fn up(x: f64) -> f32 {
    farsight_geometry::rounding::f32_up(x)
}

/// The tree on its way.
struct Octree<'a> {
    positions: &'a [Vec3],
    weight: &'a [f32],
    vertices: Vec<u32>,
    nodes: Vec<Node>,
}

impl Octree<'_> {
    /// Makes the node of some vertices and all below it.
    fn cluster(&mut self, range: std::ops::Range<usize>, parent: u32, level: u32) {
        let id = self.nodes.len() as u32;
        let bounds = self.bounds(range.clone());
        let representative = self.heaviest(range.clone(), bounds);
        self.nodes.push(Node {
            parent,
            end: id + 1,
            first_vertex: range.start as u32,
            first_triangle: 0,
            representative: range.start as u32,
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
        // Vertices have found their places below by now.
        let end = self.nodes.len() as u32;
        let node = &mut self.nodes[id as usize];
        (node.representative, node.end) = (representative, end);
    }

    /// The mesh vertex that stands for all: the heaviest, then the one nearest to the middle, then by place, so that
    /// neither the order of vertices nor that of threads matters.
    fn heaviest(&self, range: std::ops::Range<usize>, (low, high): (Vec3, Vec3)) -> u32 {
        let own = &self.vertices[range];
        let most = own.iter().map(|&v| self.weight[v as usize]).fold(f32::NEG_INFINITY, f32::max);
        let middle = low + (high - low) * 0.5;
        let nearer = |a: u32, b: u32| {
            let [p, q] = [a, b].map(|v| self.positions[v as usize]);
            let distance = |p: Vec3| p.distance_squared(middle);
            let place = || p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)).then(p.z.total_cmp(&q.z));
            distance(p).total_cmp(&distance(q)).then_with(place).is_lt()
        };
        let heaviest = own.iter().copied().filter(|&v| self.weight[v as usize] == most);
        heaviest.reduce(|best, v| if nearer(v, best) { v } else { best }).unwrap_or(own[0])
    }

    fn bounds(&self, range: std::ops::Range<usize>) -> (Vec3, Vec3) {
        let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let points = self.vertices[range].iter().map(|&v| self.positions[v as usize]);
        points.fold(start, |(lo, hi), p| (lo.min(p), hi.max(p)))
    }

    /// Sorts vertices by the octants of their box: first those that are alone in theirs. The parts that are not empty.
    fn split(
        &mut self,
        range: std::ops::Range<usize>,
        (low, high): (Vec3, Vec3),
        level: u32,
    ) -> Vec<std::ops::Range<usize>> {
        // Halved first, so that the largest coordinates do not overflow.
        let middle = low * 0.5 + high * 0.5;
        let octant = |p: Vec3| {
            usize::from(p.x > middle.x) | usize::from(p.y > middle.y) << 1 | usize::from(p.z > middle.z) << 2
        };
        let own = self.vertices[range.clone()].to_vec();
        let mut part_of: Vec<usize> = own.iter().map(|&v| octant(self.positions[v as usize])).collect();
        if level >= MOST_LEVELS || part_of.iter().all(|&o| o == part_of[0]) {
            // All in one place, or in places that no number lies between.
            let size = own.len().div_ceil(8);
            part_of = (0..own.len()).map(|i| i / size).collect();
        }
        let mut counts = [0; 8];
        part_of.iter().for_each(|&p| counts[p] += 1);
        let mut order: Vec<usize> = (0..8).filter(|&p| counts[p] > 0).collect();
        order.sort_by_key(|&p| counts[p] > 1);
        let (mut next, mut parts) = ([0; 8], Vec::with_capacity(8));
        let mut start = range.start;
        for p in order {
            next[p] = start;
            parts.push(start..start + counts[p]);
            start += counts[p];
        }
        for (v, p) in own.into_iter().zip(part_of) {
            self.vertices[next[p]] = v;
            next[p] += 1;
        }
        parts
    }
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
    let above_both = |nodes: &[Node], a: u32, b: u32| {
        let mut node = lowest[a as usize];
        while !(nodes[node as usize].first_vertex..end_of(nodes, node, count)).contains(&b) {
            node = nodes[node as usize].parent;
        }
        node
    };
    let mut counts = vec![0u32; nodes.len() + 1];
    let homes: Vec<u32> = kept
        .iter()
        .map(|&t| {
            let [a, b, c] = mesh.triangles()[t as usize].map(|v| place_of[v as usize]);
            // All three are on one path to the root; the deepest has the largest number.
            let home = above_both(nodes, a, b).max(above_both(nodes, b, c)).max(above_both(nodes, c, a));
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
fn bound(nodes: &mut [Node], place_of: &[u32], vertices: &[u32], positions: &[Vec3], around: &Surroundings) {
    // In the tree's order, as each level asks for all.
    let reach_of: Vec<f64> = vertices.iter().map(|&v| around.reach[v as usize].into()).collect();
    let mut cones = Vec::with_capacity(8);
    for id in (0..nodes.len()).rev() {
        let node = nodes[id];
        let representative = place_of[node.representative as usize];
        let center = positions[representative as usize].as_dvec3();
        let (mut radius_sq, mut reach) = (0.0f64, 0.0f64);
        for v in node.first_vertex as usize..end_of(nodes, id as u32, vertices.len()) as usize {
            let d_sq = positions[v].as_dvec3().distance_squared(center);
            radius_sq = radius_sq.max(d_sq);
            // A root only where it may matter.
            let missing = reach - reach_of[v];
            if missing < 0.0 || d_sq > missing * missing {
                reach = reach.max(d_sq.sqrt() + reach_of[v]);
            }
        }
        let radius = radius_sq.sqrt();
        cones.clear();
        let (mut child, mut own_end) = (id + 1, end_of(nodes, id as u32, vertices.len()));
        while child < node.end as usize {
            own_end = own_end.min(nodes[child].first_vertex);
            cones.push((nodes[child].cone_axis, nodes[child].cone_angle));
            child = nodes[child].end as usize;
        }
        let own = &vertices[node.first_vertex as usize..own_end as usize];
        cones.extend(own.iter().map(|&v| around.cone[v as usize]));
        let node = &mut nodes[id];
        (node.representative, node.center) = (representative, positions[representative as usize]);
        // A few roundings in `f64` lie far below one in `f32`.
        (node.radius, node.reach) = (up(radius * (1.0 + 1e-14)), up(reach * (1.0 + 1e-14)));
        (node.cone_axis, node.cone_angle) = around_cones(&cones);
    }
}

/// A cone around cones.
fn around_cones(cones: &[(Vec3, f32)]) -> (Vec3, f32) {
    let axis = cones.iter().map(|c| c.0).sum::<Vec3>().normalize_or_zero();
    let widest = cones.iter().map(|&(a, width)| angle(axis, a) + width).fold(0.0, f32::max);
    (axis, widest.min(std::f32::consts::PI))
}
