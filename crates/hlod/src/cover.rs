//! The forward certificate: every point of an original triangle has a point of some facet within the tolerance.
//!
//! Distance to a facet is a convex function, so a convex piece of the triangle is within the tolerance of the facet
//! when its corners are. A triangle over several facets is cut along their walls (planes through a side, along the facet's normal) until every
//! piece has a facet.

use crate::facet::Facet;
use crate::flood::farthest_pair;
use glam::DVec3;

/// Pieces that a triangle may be cut into.
const MAX_PIECES: usize = 96;

/// Corners that a piece may have.
const MAX_CORNERS: usize = 24;

/// Halvings of one piece.
const MAX_HALVINGS: u8 = 5;

/// How far (in barycentric units) a corner must be from a wall for a cut along it to be worth while.
const OFF_WALL: f64 = 1e-9;

/// A cover: which facets (by bit) were needed, and how far the triangle is from them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cover {
    pub facets: u64,
    pub reach_sq: f64,
}

/// A piece: how many corners it has, how often it was halved, and the facet to try first.
#[derive(Clone, Copy, Debug)]
struct Piece {
    len: usize,
    halvings: u8,
    first: usize,
}

/// Covers triangles; keeps its memory.
#[derive(Clone, Debug, Default)]
pub(crate) struct Coverer {
    /// Corners of the pieces, the last piece's at the end.
    corners: Vec<DVec3>,
    pieces: Vec<Piece>,
    piece: Vec<DVec3>,
    values: Vec<f64>,
    /// Pieces looked at since the beginning.
    pub count: u64,
}

impl Coverer {
    /// Covers a triangle with at most 64 facets, or returns `None`.
    pub(crate) fn cover(
        &mut self,
        triangle: [DVec3; 3],
        facets: &[&Facet],
        tolerance_sq: f64,
    ) -> Option<Cover> {
        self.corners.clear();
        self.corners.extend(triangle);
        self.pieces.clear();
        self.pieces.push(Piece { len: 3, halvings: 0, first: 0 });
        let mut cover = Cover { facets: 0, reach_sq: 0.0 };
        let mut budget = MAX_PIECES;
        while let Some(&Piece { len, halvings, first }) = self.pieces.last() {
            self.count += 1;
            let corners = &self.corners[self.corners.len() - len..];
            let all = (1u32 << len) - 1;
            let mut near_any = 0;
            let mut done = false;
            // The best facet to cut along: how many corners it has, and the wall.
            let mut best = (0, 0, None);
            for k in 0..facets.len() {
                let k = if first + k >= facets.len() { first + k - facets.len() } else { first + k };
                let (near, reach_sq, wall) = try_facet(corners, facets[k], tolerance_sq);
                if near == all {
                    cover.facets |= 1 << k;
                    cover.reach_sq = cover.reach_sq.max(reach_sq);
                    done = true;
                    break;
                }
                near_any |= near;
                if wall.is_some() && near.count_ones() > best.0 {
                    best = (near.count_ones(), k, wall);
                }
            }
            if done {
                self.pieces.pop();
                self.corners.truncate(self.corners.len() - len);
                continue;
            }
            // A corner far from all facets cannot be helped.
            if near_any != all || budget == 0 || len + 2 > MAX_CORNERS {
                return None;
            }
            budget -= 1;
            if let (_, k, Some(wall)) = best {
                self.split(|p| facets[k].coordinate(wall, p), halvings, [k + 1, k])?;
            } else {
                if halvings >= MAX_HALVINGS {
                    return None;
                }
                let (i, j) = farthest_pair(corners);
                let (middle, along) = ((corners[i] + corners[j]) * 0.5, corners[j] - corners[i]);
                self.split(|p| (p - middle).dot(along), halvings + 1, [first; 2])?;
            }
        }
        Some(cover)
    }

    /// Cuts the last piece in two; the part where `value` is positive comes last. `None` when rounding has bent the piece so that
    /// it is crossed more than twice, or not at all.
    fn split(&mut self, value: impl Fn(DVec3) -> f64, halvings: u8, first: [usize; 2]) -> Option<()> {
        let len = self.pieces.pop()?.len;
        let start = self.corners.len() - len;
        self.piece.clear();
        self.piece.extend_from_slice(&self.corners[start..]);
        self.values.clear();
        self.values.extend(self.piece.iter().map(|&p| value(p)));
        self.corners.truncate(start);
        let mut crossings = 0;
        for (sign, first) in [(-1.0, first[0]), (1.0, first[1])] {
            let from = self.corners.len();
            for i in 0..len {
                let j = if i + 1 == len { 0 } else { i + 1 };
                let (a, b) = (self.values[i] * sign, self.values[j] * sign);
                if a >= 0.0 {
                    self.corners.push(self.piece[i]);
                }
                if (a > 0.0 && b < 0.0) || (a < 0.0 && b > 0.0) {
                    crossings += 1;
                    // The same arithmetic on both sides of the cut.
                    let (a, b) = (self.values[i], self.values[j]);
                    self.corners.push(self.piece[i] + (self.piece[j] - self.piece[i]) * (a / (a - b)));
                }
            }
            self.pieces.push(Piece { len: self.corners.len() - from, halvings, first });
        }
        (crossings > 0 && crossings <= 4).then_some(())
    }
}

/// Which corners (by bit) are within the tolerance of the facet, the largest squared distance of those, and the wall that the worst
/// other one is beyond, if there is a corner on this side of it.
#[inline(always)]
fn try_facet(corners: &[DVec3], facet: &Facet, tolerance_sq: f64) -> (u32, f64, Option<usize>) {
    let mut near = 0;
    let mut reach_sq = 0.0f64;
    let mut low = [-OFF_WALL; 3];
    let mut high = [OFF_WALL; 3];
    for (i, &p) in corners.iter().enumerate() {
        let s = facet.shadow(p);
        let d = facet.distance_sq(p, &s);
        if d <= tolerance_sq {
            near |= 1 << i;
            reach_sq = reach_sq.max(d);
        } else {
            for side in 0..3 {
                low[side] = low[side].min(s.l[side]);
            }
        }
        for side in 0..3 {
            high[side] = high[side].max(s.l[side]);
        }
    }
    if near == 0 {
        return (0, 0.0, None);
    }
    let mut wall = None;
    let mut lowest = -OFF_WALL;
    for side in 0..3 {
        if low[side] < lowest && high[side] > OFF_WALL {
            (lowest, wall) = (low[side], Some(side));
        }
    }
    (near, reach_sq, wall)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    #[test]
    fn a_large_triangle_over_a_fan_of_small_ones_is_covered() {
        // Twelve facets around the origin, slightly uneven, below one triangle.
        let ring = |i: i32| {
            let a = f64::from(i) * std::f64::consts::TAU / 12.0;
            dvec3(a.cos() * 2.0, a.sin() * 2.0, 0.01 * f64::from(i % 3))
        };
        let facets: Vec<Facet> =
            (0..12).map(|i| Facet::new([DVec3::ZERO, ring(i), ring(i + 1)]).unwrap()).collect();
        let facets: Vec<&Facet> = facets.iter().collect();
        let triangle = [dvec3(-0.9, -0.8, 0.02), dvec3(1.0, -0.7, 0.02), dvec3(0.1, 1.1, 0.02)];
        let mut coverer = Coverer::default();
        let cover = coverer.cover(triangle, &facets, 0.03f64.powi(2)).unwrap();
        assert!(cover.facets.count_ones() == 12 && cover.reach_sq <= 0.03f64.powi(2));
        // A missing facet leaves a hole, and too small a tolerance is no cover.
        assert_eq!(coverer.cover(triangle, &facets[1..], 0.03f64.powi(2)), None);
        assert_eq!(coverer.cover(triangle, &facets, 0.004f64.powi(2)), None);
    }
}
