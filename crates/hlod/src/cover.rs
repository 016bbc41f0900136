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

/// What has a facet.
pub(crate) trait AsFacet {
    fn facet(&self) -> &Facet;
}

impl AsFacet for &Facet {
    #[inline(always)]
    fn facet(&self) -> &Facet {
        self
    }
}

/// With a number.
impl AsFacet for (u32, Facet) {
    #[inline(always)]
    fn facet(&self) -> &Facet {
        &self.1
    }
}

/// A piece: how many corners it has, how often it was halved, and the facet to try first.
#[derive(Clone, Copy, Debug)]
struct Piece {
    len: usize,
    halvings: u8,
    first: usize,
}

/// A corner of pieces, and which facets (by bit) its distance is known to and within the tolerance of. Neighbouring pieces share corners, so
/// that each distance is found once.
#[derive(Clone, Copy, Debug)]
struct Corner {
    point: DVec3,
    known: u64,
    near: u64,
}

/// Covers triangles; keeps its memory.
#[derive(Clone, Debug, Default)]
pub(crate) struct Coverer {
    corners: Vec<Corner>,
    /// Squared distances of each corner to all facets, as far as they are known.
    distances_sq: Vec<f64>,
    /// Corners of the pieces, the last piece's at the end.
    outlines: Vec<u32>,
    pieces: Vec<Piece>,
    piece: Vec<u32>,
    values: Vec<f64>,
    /// Pieces looked at since the beginning.
    pub count: u64,
}

impl Coverer {
    /// Covers a triangle with at most 64 facets, or returns `None`.
    pub(crate) fn cover(
        &mut self,
        triangle: [DVec3; 3],
        facets: &[impl AsFacet],
        tolerance_sq: f64,
    ) -> Option<Cover> {
        self.corners.clear();
        self.distances_sq.clear();
        triangle.into_iter().for_each(|p| self.add_corner(p, facets.len()));
        self.outlines.clear();
        self.outlines.extend([0, 1, 2]);
        self.pieces.clear();
        self.pieces.push(Piece { len: 3, halvings: 0, first: 0 });
        let mut cover = Cover { facets: 0, reach_sq: 0.0 };
        let mut budget = MAX_PIECES;
        while let Some(&Piece { len, halvings, first }) = self.pieces.last() {
            self.count += 1;
            let start = self.outlines.len() - len;
            let mut done = false;
            // The best facet to cut along: how many corners it has, and the wall.
            let mut best = (0, 0, 0);
            for k in (first..facets.len()).chain(0..first.min(facets.len())) {
                let (near, reach_sq) = self.near(start, k, facets, tolerance_sq);
                if near == len {
                    cover.facets |= 1 << k;
                    cover.reach_sq = cover.reach_sq.max(reach_sq);
                    done = true;
                    break;
                }
                if near > best.0
                    && let Some(wall) = self.wall(start, k, facets[k].facet())
                {
                    best = (near, k, wall);
                }
            }
            if done {
                self.pieces.pop();
                self.outlines.truncate(start);
                continue;
            }
            // A corner far from all facets cannot be helped.
            let lost = self.outlines[start..].iter().any(|&c| self.corners[c as usize].near == 0);
            if lost || budget == 0 || len + 2 > MAX_CORNERS {
                return None;
            }
            budget -= 1;
            let points = self.outlines[start..].iter().map(|&c| self.corners[c as usize].point);
            self.values.clear();
            let (halvings, first) = if best.0 > 0 {
                let (_, k, wall) = best;
                self.values.extend(points.map(|p| facets[k].facet().coordinate(wall, p)));
                (halvings, [k + 1, k])
            } else {
                if halvings >= MAX_HALVINGS {
                    return None;
                }
                let mut outline = [DVec3::ZERO; MAX_CORNERS];
                outline.iter_mut().zip(points.clone()).for_each(|(o, p)| *o = p);
                let (i, j) = farthest_pair(&outline[..len]);
                let (middle, along) = ((outline[i] + outline[j]) * 0.5, outline[j] - outline[i]);
                self.values.extend(points.map(|p| (p - middle).dot(along)));
                (halvings + 1, [first; 2])
            };
            self.split(halvings, first, facets.len())?;
        }
        Some(cover)
    }

    fn add_corner(&mut self, point: DVec3, facets: usize) {
        self.corners.push(Corner { point, known: 0, near: 0 });
        self.distances_sq.resize(self.corners.len() * facets, 0.0);
    }

    /// How many corners of the last piece are within the tolerance of a facet, and the largest squared distance of those.
    #[inline(always)]
    fn near(&mut self, start: usize, k: usize, facets: &[impl AsFacet], tolerance_sq: f64) -> (usize, f64) {
        let bit = 1 << k;
        let (mut near, mut reach_sq) = (0, 0.0f64);
        for &c in &self.outlines[start..] {
            let corner = &mut self.corners[c as usize];
            let distance_sq = &mut self.distances_sq[c as usize * facets.len() + k];
            if corner.known & bit == 0 {
                corner.known |= bit;
                *distance_sq = facets[k].facet().distance_sq_within(corner.point, tolerance_sq);
                corner.near |= if *distance_sq <= tolerance_sq { bit } else { 0 };
            }
            if corner.near & bit != 0 {
                near += 1;
                reach_sq = reach_sq.max(*distance_sq);
            }
        }
        (near, reach_sq)
    }

    /// The wall of a facet that the last piece's worst corner too far from it is beyond, if there is a corner on this side of it.
    fn wall(&self, start: usize, k: usize, facet: &Facet) -> Option<usize> {
        let mut low = [-OFF_WALL; 3];
        let mut high = [OFF_WALL; 3];
        for &c in &self.outlines[start..] {
            let corner = &self.corners[c as usize];
            let s = facet.shadow(corner.point);
            let far = corner.near >> k & 1 == 0;
            for side in 0..3 {
                low[side] = if far { low[side].min(s.l[side]) } else { low[side] };
                high[side] = high[side].max(s.l[side]);
            }
        }
        let mut wall = None;
        let mut lowest = -OFF_WALL;
        for side in 0..3 {
            if low[side] < lowest && high[side] > OFF_WALL {
                (lowest, wall) = (low[side], Some(side));
            }
        }
        wall
    }

    /// Cuts the last piece in two by the values at its corners; the positive part comes last. `None` when rounding has bent the piece so
    /// that it is crossed more than twice, or not at all.
    fn split(&mut self, halvings: u8, first: [usize; 2], facets: usize) -> Option<()> {
        let len = self.pieces.pop()?.len;
        let start = self.outlines.len() - len;
        self.piece.clear();
        self.piece.extend_from_slice(&self.outlines[start..]);
        self.outlines.truncate(start);
        // The new corners, after those that they follow.
        let mut crossings = [(0, 0); 4];
        let mut count = 0;
        for i in 0..len {
            let j = if i + 1 == len { 0 } else { i + 1 };
            let (a, b) = (self.values[i], self.values[j]);
            if (a > 0.0 && b < 0.0) || (a < 0.0 && b > 0.0) {
                if count == 2 {
                    return None;
                }
                let [p, q] = [i, j].map(|i| self.corners[self.piece[i] as usize].point);
                crossings[count] = (i, self.corners.len() as u32);
                count += 1;
                self.add_corner(p + (q - p) * (a / (a - b)), facets);
            }
        }
        if count == 0 {
            return None;
        }
        for (sign, first) in [(-1.0, first[0]), (1.0, first[1])] {
            let from = self.outlines.len();
            for i in 0..len {
                if self.values[i] * sign >= 0.0 {
                    self.outlines.push(self.piece[i]);
                }
                let crossing = crossings[..count].iter().find(|c| c.0 == i);
                self.outlines.extend(crossing.map(|c| c.1));
            }
            self.pieces.push(Piece { len: self.outlines.len() - from, halvings, first });
        }
        Some(())
    }
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
