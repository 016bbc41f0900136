//! The Hausdorff distance as an interval, by branch and bound.
//!
//! The distance to a convex set is a convex function, so over a triangle T the distance to one triangle of the other
//! surface is largest at a corner of T. The least such maximum over some candidates bounds the distance over T from
//! above; the distance at any point of T bounds the maximum from below. Triangles whose upper bound exceeds the best lower
//! bound by more than the tolerance are halved across their longest side (after Guthe, Borodin & Klein 2005).

use super::surface::Surface;
use super::triangle::closest_on_triangle;
use crate::accuracy::{Cost, Counters, ErrorBound, Unit};
use crate::mesh::TriangleMesh;
use crate::rounding::{add_up, gamma};
use glam::DVec3;
use std::time::Instant;

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct HausdorffOptions {
    /// Wanted width of the interval, in the units of the meshes.
    pub tolerance: f64,
    /// Most triangle halvings per direction; the interval stays valid when they run out.
    pub max_splits: u64,
    /// Distances up to this are of no interest: where the true one is smaller, `upper` may be as large as this, and `lower` anything below.
    pub floor: f64,
}

impl HausdorffOptions {
    /// Stops at this width, or after fifty million halvings.
    pub fn new(tolerance: f64) -> Self {
        Self { tolerance, max_splits: 50_000_000, floor: 0.0 }
    }

    /// Stops after so many halvings as well.
    #[must_use]
    pub fn with_max_splits(self, max_splits: u64) -> Self {
        Self { max_splits, ..self }
    }

    /// Looks no closer at what is nearer than this: cheaper where something is known to be as far.
    #[must_use]
    pub fn with_floor(self, floor: f64) -> Self {
        Self { floor, ..self }
    }
}

/// The largest distance from a point of one surface to the other surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OneSided {
    /// Certainly not above the true distance.
    pub lower: f64,
    /// Certainly not below the true distance.
    pub upper: f64,
    /// The point whose distance is at least `lower`; `None` when a surface is empty.
    pub witness: Option<DVec3>,
    /// Counters `queries` (points tested) and `splits` (triangles halved).
    pub cost: Cost,
}

/// The two-sided distance: the larger of both directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hausdorff {
    /// Certainly not above the true distance.
    pub lower: f64,
    /// Certainly not below the true distance.
    pub upper: f64,
    /// From the first surface to the second.
    pub forward: OneSided,
    /// From the second surface to the first.
    pub backward: OneSided,
}

impl Hausdorff {
    /// The upper end of the interval as a proven bound.
    pub fn bound(&self) -> ErrorBound {
        ErrorBound::proven(self.upper, Unit::Metres)
    }

    /// What both directions took.
    pub fn cost(&self) -> Cost {
        self.forward.cost.plus(&self.backward.cost)
    }
}

/// Encloses the two-sided Hausdorff distance of two surfaces (not of their vertices).
///
/// ```
/// use farsight_geometry::distance::{HausdorffOptions, hausdorff};
/// use farsight_geometry::{TriangleMesh, glam::{Vec3, vec3}};
///
/// let square = |z: f32| {
///     let p = [vec3(0.0, 0.0, z), vec3(1.0, 0.0, z), vec3(1.0, 1.0, z), vec3(0.0, 1.0, z)];
///     TriangleMesh::from_slices(&p, &[0, 1, 2, 0, 2, 3])
/// };
/// let d = hausdorff(&square(0.0)?, &square(0.25)?, &HausdorffOptions::new(1e-6));
/// assert!(d.lower <= 0.25 && 0.25 <= d.upper && d.upper - d.lower <= 1e-6);
/// # Ok::<(), farsight_geometry::MeshError>(())
/// ```
///
/// # Accuracy
/// `lower` and `upper` always enclose the true distance, rounding included. Their difference is at most the tolerance unless
/// the halvings run out or the tolerance is below the rounding of the coordinates (about 1e-14 of the largest).
/// The distance from an empty surface is zero, that to an empty surface infinite.
///
/// # Cost
/// Falls with the ratio of distance to tolerance; two equal surfaces in different triangulations are the worst case, since
/// every edge has to be followed at the width of the tolerance. See `cargo bench --bench accuracy_vs_time`.
pub fn hausdorff(a: &TriangleMesh, b: &TriangleMesh, options: &HausdorffOptions) -> Hausdorff {
    let forward = one_sided(a, &Surface::new(b), options);
    let backward = one_sided(b, &Surface::new(a), options);
    Hausdorff {
        lower: forward.lower.max(backward.lower),
        upper: forward.upper.max(backward.upper),
        forward,
        backward,
    }
}

/// Encloses the largest distance from a point of `from` to `to`. See [`hausdorff`].
pub fn one_sided(from: &TriangleMesh, to: &Surface, options: &HausdorffOptions) -> OneSided {
    let start = Instant::now();
    let mut search = Search::new(from, to);
    if from.is_empty() || to.is_empty() {
        let value = if from.is_empty() { 0.0 } else { f64::INFINITY };
        return OneSided { lower: value, upper: value, witness: None, cost: Cost::default() };
    }
    let upper = search.run(from, options);
    let witness = search.farthest;
    let mut counters = Counters::new();
    counters.add("queries", search.queries);
    counters.add("splits", search.splits);
    let bytes = (search.pending.capacity() * size_of::<Piece>()) as u64;
    // The witness lies on the surface up to the rounding of its halvings.
    let lower = (to.distance_below(witness) - search.rounding).max(0.0);
    OneSided { lower, upper, witness: Some(witness), cost: Cost { time: start.elapsed(), bytes, counters } }
}

/// A corner of a piece: where it is, how far from the other surface, and which triangle is nearest.
#[derive(Clone, Copy, Debug)]
struct Corner {
    point: DVec3,
    nearest: u32,
    distance: f64,
}

/// A part of a triangle, with the upper bound of the distance over it.
#[derive(Clone, Copy, Debug)]
struct Piece {
    corners: [Corner; 3],
    upper: f64,
}

struct Search<'a> {
    to: &'a Surface,
    /// The point with the largest distance so far.
    farthest: DVec3,
    lower: f64,
    /// Pieces whose bound is too high; a heap by that bound.
    pending: std::collections::BinaryHeap<Piece>,
    /// Bound on the rounding of points and distances.
    rounding: f64,
    queries: u64,
    splits: u64,
}

impl<'a> Search<'a> {
    fn new(from: &TriangleMesh, to: &'a Surface) -> Self {
        let b = from.world_bounds();
        let far = if b.is_empty() { DVec3::ZERO } else { b.min.abs().max(b.max.abs()) };
        // Every halving rounds a coordinate once; pieces are never halved more often than a double has bits.
        let rounding =
            to.rounding(to.local(far)) + gamma(64) * (far.max_element() + from.origin().abs().max_element());
        Self {
            to,
            farthest: b.center(),
            lower: -1.0,
            pending: Default::default(),
            rounding,
            queries: 0,
            splits: 0,
        }
    }

    /// Returns the upper bound.
    fn run(&mut self, from: &TriangleMesh, options: &HausdorffOptions) -> f64 {
        let tolerance = options.tolerance.max(0.0);
        let settles = |lower: f64, upper: f64| upper <= options.floor.max(lower + tolerance);
        let pieces = self.first_pieces(from);
        let mut settled = self.lower;
        for piece in pieces {
            if settles(self.lower, piece.upper) {
                settled = settled.max(piece.upper);
            } else {
                self.pending.push(piece);
            }
        }
        while let Some(&top) = self.pending.peek() {
            if settles(self.lower, top.upper) || self.splits >= options.max_splits {
                settled = settled.max(top.upper);
                break;
            }
            self.pending.pop();
            let Some(halves) = self.halve(&top) else {
                // Too small to halve: its bound stands.
                settled = settled.max(top.upper);
                continue;
            };
            for half in halves {
                if settles(self.lower, half.upper) {
                    settled = settled.max(half.upper);
                } else {
                    self.pending.push(half);
                }
            }
        }
        add_up(settled.max(self.lower), self.rounding)
    }

    fn first_pieces(&mut self, from: &TriangleMesh) -> Vec<Piece> {
        let mut corner_of: Vec<Option<Corner>> = vec![None; from.positions().len()];
        // Neighbours in the list tend to be neighbours in space: the last nearest triangle is a good first guess.
        let mut last = 0;
        let mut corner = |search: &mut Self, i: u32| {
            let corner = *corner_of[i as usize].get_or_insert_with(|| {
                search.corner(from.origin() + from.positions()[i as usize].as_dvec3(), &[last])
            });
            last = corner.nearest;
            corner
        };
        let triangles: Vec<[Corner; 3]> =
            from.triangles().iter().map(|t| t.map(|i| corner(self, i))).collect();
        triangles.into_iter().map(|corners| self.piece(corners, f64::INFINITY)).collect()
    }

    /// Measures a point; `hints` are triangles that are probably near.
    fn corner(&mut self, point: DVec3, hints: &[u32]) -> Corner {
        self.queries += 1;
        let nearest = self.to.nearest_from(point, hints);
        if nearest.distance > self.lower {
            self.lower = nearest.distance;
            self.farthest = point;
        }
        Corner { point, nearest: nearest.slot, distance: nearest.distance }
    }

    /// The piece with its bound; a part of a piece is never worse than the whole.
    fn piece(&self, corners: [Corner; 3], whole: f64) -> Piece {
        let mut upper = whole;
        for candidate in corners.map(|c| c.nearest) {
            let triangle = self.to.corners_of(candidate as usize);
            let to_candidate = |c: &Corner| {
                if c.nearest == candidate {
                    return c.distance;
                }
                let p = self.to.local(c.point);
                closest_on_triangle(triangle, p).distance(p)
            };
            let at_corners = corners.iter().map(to_candidate).fold(0.0, f64::max);
            upper = upper.min(at_corners);
        }
        // The distance grows by at most 1 per unit of way from the nearest corner.
        let farthest = corners.iter().map(|c| c.distance).fold(0.0, f64::max);
        Piece { corners, upper: upper.min(farthest + covering_radius(corners.map(|c| c.point))) }
    }

    /// Two halves across the longest side; `None` when its middle is one of its ends.
    fn halve(&mut self, piece: &Piece) -> Option<[Piece; 2]> {
        let c = piece.corners;
        let length = |i: usize| c[i].point.distance_squared(c[(i + 1) % 3].point);
        let longest = (0..3).fold(0, |best, i| if length(i) > length(best) { i } else { best });
        let [a, b, apex] = [c[longest], c[(longest + 1) % 3], c[(longest + 2) % 3]];
        let middle = a.point * 0.5 + b.point * 0.5;
        if middle == a.point || middle == b.point || length(longest).sqrt() <= self.rounding {
            return None;
        }
        self.splits += 1;
        let m = self.corner(middle, &[a.nearest, b.nearest, apex.nearest]);
        Some([self.piece([a, m, apex], piece.upper), self.piece([m, b, apex], piece.upper)])
    }
}

/// Radius around the corners that covers the triangle: half the longest side of a blunt one, the circumradius of an acute one,
/// which is at most the longest side / √3.
fn covering_radius([a, b, c]: [DVec3; 3]) -> f64 {
    let sides = [a.distance(b), b.distance(c), c.distance(a)];
    let longest = sides.iter().copied().fold(0.0, f64::max);
    longest * (1.0 / 3f64.sqrt()).next_up()
}

impl PartialEq for Piece {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Piece {}

impl PartialOrd for Piece {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Piece {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.upper.total_cmp(&other.upper)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hard_cases;
    use glam::{Vec3, vec3};

    fn mesh(positions: &[Vec3], triangles: &[[u32; 3]]) -> TriangleMesh {
        TriangleMesh::new(positions.to_vec(), triangles.to_vec()).unwrap()
    }

    fn assert_encloses(a: &TriangleMesh, b: &TriangleMesh, exact: f64, tolerance: f64) -> Hausdorff {
        let d = hausdorff(a, b, &HausdorffOptions::new(tolerance));
        assert!(d.lower <= exact && exact <= d.upper, "[{}, {}] should contain {exact}", d.lower, d.upper);
        assert!(d.upper - d.lower <= tolerance * 1.001 + 1e-12, "[{}, {}] is too wide", d.lower, d.upper);
        d
    }

    /// A rhombus of `n` slices in the plane z, as a fan around its centre.
    fn rhombus(n: u32, radius: f32, z: f32) -> TriangleMesh {
        let mut p = vec![vec3(0.0, 0.0, z)];
        let corners = [Vec3::X, Vec3::Y, -Vec3::X, -Vec3::Y];
        p.extend((0..4 * n).map(|i| {
            let along = (i % n) as f32 / n as f32;
            let (a, b) = (corners[(i / n) as usize], corners[((i / n + 1) % 4) as usize]);
            (a * (1.0 - along) + b * along) * radius + Vec3::Z * z
        }));
        mesh(&p, &(0..4 * n).map(|i| [0, 1 + i, 1 + (i + 1) % (4 * n)]).collect::<Vec<_>>())
    }

    #[test]
    fn what_is_below_the_floor_is_not_looked_at() {
        let ball = hard_cases::bumpy_ball(8);
        let coarse = Surface::new(&hard_cases::bumpy_ball(5));
        let options = HausdorffOptions::new(1e-6);
        let exact = one_sided(&ball, &coarse, &options);
        for share in [0.5, 0.999, 1.001, 2.0] {
            let floor = share * exact.upper;
            let rough = one_sided(&ball, &coarse, &options.with_floor(floor));
            assert!(rough.lower <= exact.upper && rough.upper >= exact.lower);
            // Not above both the truth and the floor, and with less work.
            assert!(rough.upper <= exact.upper.max(floor) + 2e-6, "{} {floor}", rough.upper);
            let splits = |d: &OneSided| d.cost.counters.get("splits");
            assert!(splits(&rough) <= splits(&exact));
            assert!(share < 1.0 || splits(&rough) == 0 || splits(&rough) < splits(&exact));
        }
    }

    #[test]
    fn closed_forms_are_enclosed_down_the_ladder() {
        let unit = mesh(&[Vec3::ZERO, Vec3::X, Vec3::Y], &[[0, 1, 2]]);
        for exponent in 1..=6 {
            let tolerance = 10f64.powi(-exponent);
            // A shifted copy; a rhombus and a larger one; one triangle and a point far from it.
            let shifted = mesh(&[Vec3::Z, vec3(1., 0., 1.), vec3(0., 1., 1.)], &[[0, 1, 2]]);
            assert_encloses(&unit, &shifted, 1.0, tolerance);
            let d = assert_encloses(&rhombus(1, 1.0, 0.0), &rhombus(2, 2.0, 0.0), 1.0, tolerance);
            assert_eq!(d.forward.lower, 0.0);
            // The middle of a hat lies deepest inside: the maximum is no vertex of either surface.
            let roof = mesh(
                &[vec3(-1., 0., 0.), vec3(1., 0., 0.), vec3(0., 0., 1.), vec3(0., 1., 1.)],
                &[[0, 1, 2]],
            );
            let posts = mesh(
                &[vec3(-1., 0., 0.), vec3(-1., 0., 0.), vec3(-1., 0., 0.), vec3(1., 0., 0.)],
                &[[0, 1, 2], [3, 3, 3]],
            );
            // From the roof, the farthest point is its tip at (0, 0, 1): √2 to both posts.
            assert_encloses(&roof, &posts, 2f64.sqrt(), tolerance);
        }
    }

    #[test]
    fn a_maximum_inside_a_triangle_is_found() {
        // A triangle above three points: the farthest point is its circumcentre, not a vertex.
        let h = 3f32.sqrt();
        let corners = [vec3(-1., 0., 0.), vec3(1., 0., 0.), vec3(0., h, 0.)];
        let big = mesh(&corners, &[[0, 1, 2]]);
        let points = mesh(&corners, &[[0, 0, 0], [1, 1, 1], [2, 2, 2]]);
        let exact = 2.0 / 3f64.sqrt();
        let d = hausdorff(&big, &points, &HausdorffOptions::new(1e-4));
        assert!(d.lower <= exact + 1e-6 && exact - 1e-6 <= d.upper && d.upper - d.lower < 1.01e-4);
    }

    #[test]
    fn equal_surfaces_in_other_triangulations_are_close() {
        let coarse = mesh(
            &[Vec3::ZERO, vec3(4., 0., 0.), vec3(4., 4., 0.), vec3(0., 4., 0.)],
            &[[0, 1, 2], [0, 2, 3]],
        );
        let (mut p, mut t) = (vec![], vec![]);
        for j in 0..=4u32 {
            for i in 0..=4u32 {
                p.push(vec3(i as f32, j as f32, 0.0));
                if i < 4 && j < 4 {
                    let a = j * 5 + i;
                    t.extend([[a, a + 1, a + 5], [a + 1, a + 6, a + 5]]);
                }
            }
        }
        let d = hausdorff(&coarse, &mesh(&p, &t), &HausdorffOptions::new(1e-3));
        assert!(d.lower == 0.0 && d.upper <= 1.001e-3);
    }

    #[test]
    fn the_distance_to_itself_is_rounding_on_every_hard_mesh() {
        for hard in hard_cases::meshes() {
            let b = hard.mesh.world_bounds();
            let size = b.diagonal();
            let options = HausdorffOptions::new(1e-3 * size).with_max_splits(100_000);
            let d = hausdorff(&hard.mesh, &hard.mesh, &options);
            let rounding = 1e-13 * (size + if b.is_empty() { 0.0 } else { b.center().length() });
            assert!(d.lower <= rounding, "{} {}", hard.name, d.lower);
            assert!(d.upper <= 1e-3 * size + 3.0 * rounding, "{} {}", hard.name, d.upper);
        }
    }

    #[test]
    fn moved_balls_are_enclosed_by_sampling() {
        let ball = hard_cases::bumpy_ball(6);
        let p: Vec<Vec3> = ball.positions().iter().map(|&p| p * 1.1 + vec3(0.05, 0.0, 0.0)).collect();
        let other = TriangleMesh::new(p, ball.triangles().to_vec()).unwrap();
        let d = hausdorff(&ball, &other, &HausdorffOptions::new(1e-4));
        // Brute force over all pairs, at many points of each triangle.
        let mut sampled = 0.0f64;
        for corners in ball.corner_iter().map(|c| c.map(|v| v.as_dvec3())) {
            for (v, w) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.3, 0.3), (0.5, 0.5), (0.1, 0.6)] {
                let p = corners[0] + (corners[1] - corners[0]) * v + (corners[2] - corners[0]) * w;
                let others =
                    other.corner_iter().map(|c| closest_on_triangle(c.map(|v| v.as_dvec3()), p).distance(p));
                sampled = sampled.max(others.fold(f64::INFINITY, f64::min));
            }
        }
        assert!(d.forward.upper >= sampled && d.forward.lower <= sampled * 1.1);
        assert!(d.upper - d.lower <= 1.01e-4);
        let again = hausdorff(&ball, &other, &HausdorffOptions::new(1e-4));
        assert_eq!(d.cost().counters, again.cost().counters);
    }

    #[test]
    fn nothing_is_at_no_distance_from_anything() {
        let triangle = mesh(&[Vec3::ZERO, Vec3::X, Vec3::Y], &[[0, 1, 2]]);
        let d = hausdorff(&TriangleMesh::default(), &triangle, &HausdorffOptions::new(0.1));
        assert_eq!((d.forward.upper, d.backward.lower, d.upper), (0.0, f64::INFINITY, f64::INFINITY));
    }

    #[test]
    fn running_out_of_halvings_leaves_a_valid_interval() {
        let (a, b) = (rhombus(12, 1.0, 0.0), rhombus(2, 1.3, 0.2));
        let exact = hausdorff(&a, &b, &HausdorffOptions::new(1e-6));
        let short = hausdorff(&a, &b, &HausdorffOptions::new(0.0).with_max_splits(5));
        assert!(short.lower <= exact.upper && exact.lower <= short.upper);
        assert!(short.upper - short.lower > exact.upper - exact.lower);
    }
}
