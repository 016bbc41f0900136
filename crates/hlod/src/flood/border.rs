//! What a border leaves of a facet: its edges cut the facet into pieces with a constant number of layers each.

use super::{Flood, farthest_pair, layer_at, turn};
use crate::facet::{Facet, segment_distance_sq, triangle_distance_sq};
use crate::original::Original;
use crate::polygon::{CORNERS, Polygon};
use glam::DVec3;

/// Pieces that a facet at a border may be cut into.
const MAX_PIECES: usize = 64;

/// Halvings of a piece.
const MAX_DEPTH: u8 = 6;

impl Flood {
    /// Certifies what the border's edges leave uncovered.
    pub(super) fn certify_at_border(
        &mut self,
        original: &Original,
        facet: &Facet,
        nearby: &[u32],
        tolerance_sq: f64,
    ) -> Option<f64> {
        self.pieces.clear();
        self.pieces.push((Polygon::new([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), 0));
        for edge in &self.borders {
            let [a, b] = edge.outline;
            // The halves lie off the line up to rounding, which must not let it cut them again.
            for i in 0..self.pieces.len() {
                if crosses(&self.pieces[i].0, a, b)
                    && let (Some(up), Some(down)) = self.pieces[i].0.cut(|p| turn(a, b, p))?
                {
                    self.pieces[i].0 = up;
                    self.pieces.push((down, 0));
                }
            }
            if self.pieces.len() > MAX_PIECES {
                return None;
            }
        }
        let outline = |&t: &u32| original.corners(t).map(|p| facet.shadow(p)).map(|s| [s.l[1], s.l[2]]);
        self.outlines.clear();
        self.outlines.extend(self.layers.iter().map(outline));
        let cracks = self.any_side || self.borders.len() > self.cliffs;
        let mut reach_sq = 0.0f64;
        let mut budget = 2 * MAX_PIECES;
        while let Some((piece, depth)) = self.pieces.pop() {
            let corners = piece.corners();
            let inner = corners.iter().fold([0.0; 2], |s, c| {
                [s[0] + c[0] / corners.len() as f64, s[1] + c[1] / corners.len() as f64]
            });
            let layers: Option<i32> = self.outlines.iter().map(|outline| layer_at(outline, inner)).sum();
            if layers == Some(1) {
                continue;
            }
            let mut points = [DVec3::ZERO; CORNERS];
            for (p, c) in points.iter_mut().zip(corners) {
                *p = facet.at([1.0 - c[0] - c[1], c[0], c[1]]);
            }
            let points = &points[..corners.len()];
            let mut best = f64::INFINITY;
            // Squared distances of each corner to the nearest border.
            let mut to_border = [f64::INFINITY; CORNERS];
            for edge in &self.borders {
                let mut farthest = 0.0f64;
                for (to_border, &p) in to_border.iter_mut().zip(points) {
                    let d = segment_distance_sq(edge.ends[0], edge.ends[1], p);
                    *to_border = to_border.min(d);
                    farthest = farthest.max(d);
                }
                best = best.min(farthest);
            }
            if best <= tolerance_sq {
                reach_sq = reach_sq.max(best);
                continue;
            }
            // What covers the piece is near its corner farthest from borders.
            let farther = |i: usize, j: usize| if to_border[j] > to_border[i] { j } else { i };
            let remote = (1..points.len()).fold(0, farther);
            let mut is_lost = to_border[remote] > tolerance_sq;
            // Across a crack, triangles are near that the flood does not reach.
            let around = if cracks { nearby } else { &[] };
            for &t in self.excluded.iter().chain(&self.layers).chain(around) {
                let corners = original.corners(t);
                if box_distance_sq(&corners, points[remote]) > tolerance_sq {
                    continue;
                }
                let prepared = Facet::new(corners);
                let distance_sq = |p: DVec3| match &prepared {
                    Some(facet) => facet.distance_sq_to(p),
                    None => triangle_distance_sq(corners, p),
                };
                if distance_sq(points[remote]) <= tolerance_sq {
                    is_lost = false;
                    best = best.min(farthest(points, distance_sq));
                    if best <= tolerance_sq {
                        break;
                    }
                }
            }
            if best <= tolerance_sq {
                reach_sq = reach_sq.max(best);
                continue;
            }
            // Halving a piece leaves the corner in a half that is covered as often as the whole.
            if is_lost {
                return None;
            }
            if depth >= MAX_DEPTH || budget == 0 {
                return None;
            }
            budget -= 1;
            let (i, j) = farthest_pair(points);
            let (middle, along) = ((points[i] + points[j]) * 0.5, points[j] - points[i]);
            let (up, down) =
                piece.cut(|c| (facet.at([1.0 - c[0] - c[1], c[0], c[1]]) - middle).dot(along))?;
            self.pieces.extend([up, down].into_iter().flatten().map(|p| (p, depth + 1)));
        }
        Some(reach_sq)
    }
}

/// The largest of a squared distance over some points.
#[inline]
fn farthest(points: &[DVec3], distance_sq: impl Fn(DVec3) -> f64) -> f64 {
    points.iter().map(|&p| distance_sq(p)).fold(0.0, f64::max)
}

/// Squared distance to the box around a triangle.
#[inline]
fn box_distance_sq(&[a, b, c]: &[DVec3; 3], p: DVec3) -> f64 {
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    (low - p).max(p - high).max(DVec3::ZERO).length_squared()
}

/// Whether the segment from `a` to `b` runs through the interior of an anticlockwise polygon.
fn crosses(polygon: &Polygon<[f64; 2]>, a: [f64; 2], b: [f64; 2]) -> bool {
    let corners = polygon.corners();
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for i in 0..corners.len() {
        let (p, q) = (corners[i], corners[(i + 1) % corners.len()]);
        let (at_a, at_b) = (turn(p, q, a), turn(p, q, b));
        if at_a <= 0.0 && at_b <= 0.0 {
            return false;
        }
        let t = at_a / (at_a - at_b);
        if at_a < 0.0 {
            from = from.max(t);
        } else if at_b < 0.0 {
            to = to.min(t);
        }
    }
    from < to
}
