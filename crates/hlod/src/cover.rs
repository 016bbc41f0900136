//! The forward certificate: every point of an original triangle has a point of some facet within the tolerance.
//!
//! Distance to a facet is a convex function, so a convex piece of the triangle is within the tolerance of the facet
//! when its corners are. A triangle over several facets is cut along their walls (planes through a side, along the facet's normal) until every
//! piece has a facet.

use crate::facet::{Facet, Shadow};
use crate::flood::farthest_pair;
use crate::polygon::{CORNERS, Polygon};
use glam::DVec3;

/// Pieces that a triangle may be cut into.
const MAX_PIECES: usize = 96;

/// Halvings of one piece.
const MAX_HALVINGS: u8 = 5;

/// A cover: which facets (by bit) were needed, and how far the triangle is from them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cover {
    pub facets: u64,
    pub reach_sq: f64,
}

/// Covers triangles; keeps its memory.
#[derive(Clone, Debug, Default)]
pub(crate) struct Coverer {
    pending: Vec<(Polygon<DVec3>, u8)>,
    /// Pieces looked at since the beginning.
    pub pieces: u64,
    /// The point that the last cover failed at.
    pub culprit: DVec3,
}

impl Coverer {
    /// Covers a triangle with at most 64 facets, or returns `None`.
    pub(crate) fn cover(&mut self, triangle: [DVec3; 3], facets: &[&Facet], tolerance_sq: f64) -> Option<Cover> {
        self.pending.clear();
        self.pending.push((Polygon::new(triangle), 0));
        let mut cover = Cover { facets: 0, reach_sq: 0.0 };
        let mut budget = MAX_PIECES;
        let mut first = 0;
        while let Some((piece, halvings)) = self.pending.pop() {
            self.pieces += 1;
            let corners = piece.corners();
            let all = (1u32 << corners.len()) - 1;
            let mut near_any = 0;
            let mut done = false;
            // The best facet to cut along: how many corners it has, and the wall.
            let mut best: Option<(u32, usize, usize)> = None;
            for k in 0..facets.len() {
                let k = if first + k >= facets.len() { first + k - facets.len() } else { first + k };
                let (near, reach_sq, wall) = try_facet(corners, facets[k], tolerance_sq);
                if near == all {
                    cover.facets |= 1 << k;
                    cover.reach_sq = cover.reach_sq.max(reach_sq);
                    first = k;
                    done = true;
                    break;
                }
                near_any |= near;
                if let Some(wall) = wall
                    && best.is_none_or(|b| near.count_ones() > b.0)
                {
                    best = Some((near.count_ones(), k, wall));
                }
            }
            if done {
                continue;
            }
            if near_any != all {
                self.culprit = corners[(!near_any).trailing_zeros() as usize];
                return None;
            }
            self.culprit = corners[0];
            if budget == 0 {
                return None;
            }
            budget -= 1;
            if let Some((_, k, wall)) = best
                && let (Some(inner), Some(outer)) = piece.cut(|p| facets[k].shadow(p).l[wall])?
            {
                first = k;
                self.pending.push((outer, halvings));
                self.pending.push((inner, halvings));
                continue;
            }
            if halvings >= MAX_HALVINGS {
                return None;
            }
            let (i, j) = farthest_pair(corners);
            let (middle, along) = ((corners[i] + corners[j]) * 0.5, corners[j] - corners[i]);
            let (up, down) = piece.cut(|p| (p - middle).dot(along))?;
            self.pending.extend([up, down].into_iter().flatten().map(|p| (p, halvings + 1)));
        }
        Some(cover)
    }
}

/// Which corners (by bit) are within the tolerance of the facet, the largest squared distance of those, and the wall that the worst
/// other one is beyond, if a near corner is on this side of it.
#[inline]
fn try_facet(corners: &[DVec3], facet: &Facet, tolerance_sq: f64) -> (u32, f64, Option<usize>) {
    let mut near = 0;
    let mut reach_sq = 0.0f64;
    let mut shadows = [Shadow::default(); CORNERS];
    for (i, &p) in corners.iter().enumerate() {
        shadows[i] = facet.shadow(p);
        let d = facet.distance_sq(p, &shadows[i]);
        if d <= tolerance_sq {
            near |= 1 << i;
            reach_sq = reach_sq.max(d);
        }
    }
    if near == 0 || near == (1 << corners.len()) - 1 {
        return (near, reach_sq, None);
    }
    let shadows = &shadows[..corners.len()];
    // Walls that a corner is hardly beyond would cut off nothing.
    let mut worst = (-1e-9, None);
    for (i, s) in shadows.iter().enumerate() {
        if near & 1 << i != 0 {
            continue;
        }
        for side in 0..3 {
            if s.l[side] < worst.0 && shadows.iter().any(|s| s.l[side] > 1e-9) {
                worst = (s.l[side], Some(side));
            }
        }
    }
    (near, reach_sq, worst.1)
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
