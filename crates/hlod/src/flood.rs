//! The backward certificate: every point of a facet has a point of the original surface within the tolerance.
//!
//! A flood runs over the original triangles below (and above) the facet: from one whose projection meets the facet across
//! every side whose projection does. The triangles found form a chain whose boundary stays out of the facet's
//! interior, so that the number of its layers, counted with the sign of their orientation, is the same all over the
//! facet. If it is one at a point, every point of the facet is the projection of a point of the chain; and if all heights are
//! within the tolerance, that point is near enough. Heights are linear over a triangle, so corners decide.
//!
//! Where the flood meets a border of the original, the border's edges cut the facet into pieces with a constant number of layers each; the
//! uncovered ones must be near one of those edges, or one triangle: distance to a convex set is convex, so corners decide again.
//!
//! The answer depends on the facet and the original only. It is found once, when the facet is made, and holds for good.

mod border;

use crate::complex::Marks;
use crate::facet::{Facet, Shadow, triangle_distance_sq};
use crate::original::{NONE, Original};
use crate::polygon::Polygon;
use glam::DVec3;

/// How far (in barycentric units) a side may reach into a facet and still count as touching its border only.
const TOUCH: f64 = 1e-12;

/// Barycentric coordinates of the point where layers are counted: inside, and on no line that meshes like to have.
const INNER: [f64; 3] = [0.321_718_5, 0.346_193_7, 0.332_087_8];

/// Triangles that may be left out of the chain.
const MAX_EXCLUDED: usize = 16;

/// Steps of the walk to the triangle below a facet.
const MAX_WALK: usize = 64;

/// A certified facet: what is known of its distance to the original, and a triangle to start from next time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Certified {
    pub reach_sq: f64,
    pub seed: u32,
}

/// Barycentric coordinates (second and third) of the corners of a visited triangle.
type Outline = [[f64; 2]; 3];

/// An edge of the original's border that crosses the facet.
#[derive(Clone, Copy, Debug)]
struct BorderEdge {
    ends: [DVec3; 2],
    outline: [[f64; 2]; 2],
}

/// A part of a facet at a border, and how often it was halved.
type Piece = (Polygon<[f64; 2]>, u8);

/// Floods one facet after the other; keeps its memory.
#[derive(Clone, Debug)]
pub(crate) struct Flood {
    visited: Marks,
    stack: Vec<(u32, [Shadow; 3])>,
    layers: Vec<u32>,
    /// What the chain looks like from the facet, if there are borders.
    outlines: Vec<Outline>,
    borders: Vec<BorderEdge>,
    /// Visited triangles that are too high over the facet and stand on it: not part of the chain.
    excluded: Vec<u32>,
    /// Borders that are due to excluded triangles.
    cliffs: usize,
    pieces: Vec<Piece>,
    /// Whether distance alone counts: facets may then be certified that have turned over or been folded.
    pub any_side: bool,
    /// Triangles visited since the beginning.
    pub visits: u64,
}

impl Flood {
    pub(crate) fn new(original: &Original) -> Self {
        Self {
            visited: Marks::new(original.triangles.len()),
            stack: Vec::new(),
            layers: Vec::new(),
            outlines: Vec::new(),
            borders: Vec::new(),
            excluded: Vec::new(),
            cliffs: 0,
            pieces: Vec::new(),
            any_side: false,
            visits: 0,
        }
    }

    /// Triangles of the last facet's chain.
    pub(crate) fn below(&self) -> &[u32] {
        &self.layers
    }

    pub(crate) fn bytes(&self) -> usize {
        self.visited.bytes()
            + size_of::<(u32, [Shadow; 3])>() * self.stack.capacity()
            + 4 * self.layers.capacity()
    }

    /// Certifies `facet` with the squared tolerance, or returns `None`.
    ///
    /// `hint` is a triangle near by, `nearby` are triangles to start from when it leads nowhere and to measure by where
    /// nothing covers the facet. `visit` sees every triangle of the flood, with what its corners look like from the facet.
    pub(crate) fn certify(
        &mut self,
        original: &Original,
        facet: &Facet,
        hint: u32,
        nearby: &[u32],
        tolerance_sq: f64,
        mut visit: impl FnMut(u32, &[Shadow; 3]),
    ) -> Option<Certified> {
        let (seed, shadows) = self.start(original, facet, hint, nearby)?;
        self.visited.clear();
        self.layers.clear();
        self.borders.clear();
        self.excluded.clear();
        self.stack.clear();
        self.visited.set(seed);
        self.stack.push((seed, shadows));
        let tolerance = tolerance_sq.sqrt();
        let mut certified = Certified { reach_sq: 0.0, seed };
        let mut reach = 0.0f64;
        let mut degree = 0;
        let limit = self.visits + 1000 + 8 * nearby.len() as u64;
        while let Some((t, shadows)) = self.stack.pop() {
            self.visits += 1;
            if self.visits > limit {
                return None;
            }
            visit(t, &shadows);
            let heights = shadows[0].h.abs().max(shadows[1].h.abs()).max(shadows[2].h.abs());
            if heights <= tolerance {
                reach = reach.max(heights);
            } else {
                match steep_reach_sq(original, facet, t, &shadows, tolerance_sq) {
                    Some(r) => certified.reach_sq = certified.reach_sq.max(r),
                    // A cliff at the facet's rim need not be part of the chain; its edge becomes a border of it.
                    None if self.may_exclude(original, facet, t) => {
                        self.excluded.push(t);
                        continue;
                    }
                    None => return None,
                }
            }
            if may_hold_inner(&shadows) {
                let layer = layer_at(&shadows.map(|s| [s.l[1], s.l[2]]), [INNER[1], INNER[2]])?;
                if layer > 0 {
                    certified.seed = t;
                }
                degree += layer;
            }
            self.layers.push(t);
            self.cross_sides(original, facet, t, &shadows);
        }
        certified.reach_sq = certified.reach_sq.max(reach * reach);
        self.cliffs = 0;
        self.border_excluded(original, facet);
        if self.borders.is_empty() {
            if degree == 1 {
                return Some(certified);
            }
            if !self.any_side {
                return None;
            }
        }
        let reach_sq = self.certify_at_border(original, facet, nearby, tolerance_sq)?;
        certified.reach_sq = certified.reach_sq.max(reach_sq);
        Some(certified)
    }

    fn may_exclude(&self, original: &Original, facet: &Facet, t: u32) -> bool {
        if self.any_side {
            return self.excluded.len() < 8 * MAX_EXCLUDED;
        }
        self.excluded.len() < MAX_EXCLUDED && is_steep(original, facet, t)
    }

    /// Makes the sides between the chain and excluded triangles borders.
    fn border_excluded(&mut self, original: &Original, facet: &Facet) {
        for &t in &self.excluded {
            let shadows = original.corners(t).map(|p| facet.shadow(p));
            for i in 0..3 {
                let j = (i + 1) % 3;
                let neighbour = original.neighbours[t as usize][i];
                let in_chain =
                    neighbour != NONE && self.visited.has(neighbour) && !self.excluded.contains(&neighbour);
                if in_chain && meets_interior(&shadows[i], &shadows[j]) {
                    let corners = &original.triangles[t as usize];
                    self.cliffs += 1;
                    self.borders.push(BorderEdge {
                        ends: [corners[i], corners[j]].map(|v| original.points[v as usize]),
                        outline: [&shadows[i], &shadows[j]].map(|s| [s.l[1], s.l[2]]),
                    });
                }
            }
        }
    }

    /// Goes on over every side of `t` that meets the facet's interior.
    #[inline]
    fn cross_sides(&mut self, original: &Original, facet: &Facet, t: u32, shadows: &[Shadow; 3]) {
        for i in 0..3 {
            let j = (i + 1) % 3;
            let neighbour = original.neighbours[t as usize][i];
            if (neighbour != NONE && self.visited.has(neighbour)) || !meets_interior(&shadows[i], &shadows[j])
            {
                continue;
            }
            let corners = &original.triangles[t as usize];
            if neighbour == NONE {
                self.borders.push(BorderEdge {
                    ends: [corners[i], corners[j]].map(|v| original.points[v as usize]),
                    outline: [&shadows[i], &shadows[j]].map(|s| [s.l[1], s.l[2]]),
                });
                continue;
            }
            self.visited.set(neighbour);
            let theirs = &original.triangles[neighbour as usize];
            let Some(k) = (0..3).find(|&k| theirs[k] == corners[j] && theirs[(k + 1) % 3] == corners[i])
            else {
                continue;
            };
            let mut next = [Shadow::default(); 3];
            next[k] = shadows[j];
            next[(k + 1) % 3] = shadows[i];
            next[(k + 2) % 3] = facet.shadow(original.points[theirs[(k + 2) % 3] as usize]);
            self.stack.push((neighbour, next));
        }
    }

    /// A triangle whose projection meets the facet's interior.
    fn start(
        &self,
        original: &Original,
        facet: &Facet,
        hint: u32,
        nearby: &[u32],
    ) -> Option<(u32, [Shadow; 3])> {
        let shadows_of = |t: u32| original.corners(t).map(|p| facet.shadow(p));
        let mut t = hint;
        for _ in 0..MAX_WALK {
            if t == NONE {
                break;
            }
            let shadows = shadows_of(t);
            let outline = shadows.map(|s| [s.l[1], s.l[2]]);
            let up = turn(outline[0], outline[1], outline[2]).signum();
            let sides: [f64; 3] =
                std::array::from_fn(|i| up * turn(outline[i], outline[(i + 1) % 3], [INNER[1], INNER[2]]));
            let worst = if sides[0] <= sides[1] && sides[0] <= sides[2] {
                0
            } else if sides[1] <= sides[2] {
                1
            } else {
                2
            };
            if sides[worst] >= 0.0 {
                if up > 0.0 {
                    return Some((t, shadows));
                }
                break;
            }
            t = original.neighbours[t as usize][worst];
        }
        // A triangle with the right side up is what is wanted; any that meets the facet will do.
        let meets = |t: u32| {
            let s = shadows_of(t);
            let inside = s.iter().any(|s| s.l.iter().all(|&l| l > TOUCH));
            (inside || (0..3).any(|i| meets_interior(&s[i], &s[(i + 1) % 3]))).then_some((t, s))
        };
        let upright = |s: &[Shadow; 3]| turn2(s) > 0.0;
        let found: Option<(u32, [Shadow; 3])> =
            nearby.iter().filter_map(|&t| meets(t)).find(|(_, s)| upright(s));
        found.or_else(|| if hint == NONE { None } else { meets(hint) })
    }
}

/// Whether a triangle is inclined to the facet by more than 60°.
fn is_steep(original: &Original, facet: &Facet, t: u32) -> bool {
    let [a, b, c] = original.corners(t);
    let normal = (b - a).cross(c - a);
    normal.dot(facet.normal) < 0.5 * normal.length()
}

/// The two points that are farthest apart.
pub(crate) fn farthest_pair(points: &[DVec3]) -> (usize, usize) {
    let mut best = (0, 0, -1.0);
    for i in 0..points.len() {
        for j in 0..i {
            let d = points[i].distance_squared(points[j]);
            if d > best.2 {
                best = (i, j, d);
            }
        }
    }
    (best.0, best.1)
}

/// Twice the signed area of a triangle in the plane.
#[inline(always)]
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn turn2(s: &[Shadow; 3]) -> f64 {
    turn([s[0].l[1], s[0].l[2]], [s[1].l[1], s[1].l[2]], [s[2].l[1], s[2].l[2]])
}

/// Whether the projected triangle's box in barycentric coordinates holds the point where layers are counted.
#[inline(always)]
fn may_hold_inner(s: &[Shadow; 3]) -> bool {
    // Far more than rounding.
    const MARGIN: f64 = 1e-7;
    (1..3).all(|i| {
        let (a, b, c) = (s[0].l[i] - INNER[i], s[1].l[i] - INNER[i], s[2].l[i] - INNER[i]);
        !((a > MARGIN && b > MARGIN && c > MARGIN) || (a < -MARGIN && b < -MARGIN && c < -MARGIN))
    })
}

/// 1 when the outline runs around `p` anticlockwise, −1 when clockwise, 0 when not, `None` when rounding may decide.
#[inline(always)]
fn layer_at(outline: &Outline, p: [f64; 2]) -> Option<i32> {
    let s = [0, 1, 2].map(|i| turn(outline[i], outline[(i + 1) % 3], p));
    let (low, high) = (s[0].min(s[1]).min(s[2]), s[0].max(s[1]).max(s[2]));
    let size = outline.iter().flatten().fold(1.0f64, |m, x| m.max(x.abs()));
    let unsure = 1e-14 * size * size;
    if low > unsure {
        Some(1)
    } else if high < -unsure {
        Some(-1)
    } else if low < -unsure && high > unsure {
        Some(0)
    } else {
        None
    }
}

/// Whether a side, projected, meets the facet's interior.
#[inline(always)]
fn meets_interior(a: &Shadow, b: &Shadow) -> bool {
    for i in 0..3 {
        if a.l[i] <= TOUCH && b.l[i] <= TOUCH {
            return false;
        }
    }
    // On which side of the side's line do the facet's corners lie?
    let at0 = a.l[1] * b.l[2] - a.l[2] * b.l[1];
    let at1 = at0 - b.l[2] + a.l[2];
    let at2 = at0 - a.l[1] + b.l[1];
    !((at0 >= 0.0 && at1 >= 0.0 && at2 >= 0.0) || (at0 <= 0.0 && at1 <= 0.0 && at2 <= 0.0))
}

/// The squared distance that a triangle proves for the part of the facet below it; `None` above the tolerance.
pub(crate) fn steep_reach_sq(
    original: &Original,
    facet: &Facet,
    t: u32,
    shadows: &[Shadow; 3],
    tolerance_sq: f64,
) -> Option<f64> {
    if (0..3).any(|i| shadows.iter().all(|s| s.l[i] <= TOUCH)) {
        return Some(0.0);
    }
    let mut part = Polygon::new(shadows.map(|s| [s.l[0], s.l[1], s.l[2], s.h]));
    for i in 0..3 {
        if !part.clip(|c| c[i])? {
            return Some(0.0);
        }
    }
    let mut reach_sq = 0.0f64;
    let corners = original.corners(t);
    let mut prepared = None;
    for c in part.corners() {
        let mut r = c[3] * c[3];
        if r > tolerance_sq {
            // The foot's distance to the triangle is at most the height above it.
            let foot = facet.at([c[0], c[1], c[2]]);
            r = match prepared.get_or_insert_with(|| Facet::new(corners)) {
                Some(triangle) => triangle.distance_sq_to(foot),
                None => triangle_distance_sq(corners, foot),
            };
            if r > tolerance_sq {
                return None;
            }
        }
        reach_sq = reach_sq.max(r);
    }
    Some(reach_sq)
}
