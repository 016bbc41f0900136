//! Filling what moving vertices could not close: a crack that is left open is a border, and a border may move in all further simplification.
//!
//! Triangles between the two rims move nothing. What they cost is that they are not on the surface: every point of one is as near to a side of the crack as the farthest of
//! its corners, since the distance to a side is a convex function.

use super::{Face, Join, Open};
use crate::appearance::Look;
use farsight_geometry::distance::closest_on_segment;
use std::collections::HashMap;

/// Most sides of a crack that is filled; longer ones are between surfaces that do not belong together.
const MOST_SIDES: usize = 64;

/// A side of a crack, in the direction in which a triangle that fills it has it.
#[derive(Clone, Copy)]
struct Side {
    from: u32,
    to: u32,
    /// What the surface looks like at `from`.
    look: Look,
    part: u32,
}

/// A triangle by its corners' places in the crack, and how far its points may be from the sides.
type Filling = ([usize; 3], f64);

impl Join {
    /// Fills the cracks that open sides surround, where no point of a filling is too far from them. Returns the number of triangles.
    pub(super) fn fill(&mut self, open: &[Open]) -> u64 {
        let sides = open.iter().map(|&o| self.side(o)).collect();
        let mut filled = 0;
        for crack in cracks(sides) {
            let one_part = crack.iter().all(|s| s.part == crack[0].part);
            // A hole within one part was there before.
            if one_part || !(3..=MOST_SIDES).contains(&crack.len()) {
                continue;
            }
            let Some(fillings) = self.triangulated(&crack) else { continue };
            filled += fillings.len() as u64;
            let worst =
                |a: u32, b: u32| if self.errors[a as usize] >= self.errors[b as usize] { a } else { b };
            let part = crack.iter().map(|s| s.part).reduce(worst).unwrap_or(0);
            self.faces.extend(fillings.into_iter().map(|(corners, moved)| Face {
                points: corners.map(|i| crack[i].from),
                looks: corners.map(|i| crack[i].look),
                part,
                moved,
            }));
        }
        filled
    }

    fn side(&self, o: Open) -> Side {
        let [to, from] = self.ends(o);
        let face = &self.faces[o.face as usize];
        Side { from, to, look: face.looks[(o.side as usize + 1) % 3], part: face.part }
    }

    /// Cuts ears off, the one nearest to a side first; `None` where one would be too far from all.
    fn triangulated(&self, crack: &[Side]) -> Option<Vec<Filling>> {
        let mut rest: Vec<usize> = (0..crack.len()).collect();
        let mut fillings = Vec::with_capacity(crack.len() - 2);
        while rest.len() >= 3 {
            let count = if rest.len() == 3 { 1 } else { rest.len() };
            let ears = (0..count).map(|i| {
                let ear = [0, 1, 2].map(|k| rest[(i + k) % rest.len()]);
                (ear, self.reach_from_sides(crack, ear), i)
            });
            let (ear, distance, i) = ears.min_by(|a, b| a.1.total_cmp(&b.1))?;
            if distance > self.farthest {
                return None;
            }
            fillings.push((ear, distance));
            rest.remove((i + 1) % rest.len());
        }
        Some(fillings)
    }

    /// Distance from a crack's sides that no point of a triangle exceeds.
    fn reach_from_sides(&self, crack: &[Side], corners: [usize; 3]) -> f64 {
        let corners = corners.map(|i| self.place(crack[i].from));
        let of_side = |s: &Side| {
            let (from, to) = (self.place(s.from), self.place(s.to));
            corners.iter().map(|&p| closest_on_segment(from, to, p).distance(p)).fold(0.0, f64::max)
        };
        crack.iter().map(of_side).fold(f64::INFINITY, f64::min)
    }
}

/// Rings of sides, each of which begins where the one before ends; no ring comes to a point twice.
fn cracks(mut sides: Vec<Side>) -> Vec<Vec<Side>> {
    sides.sort_by_key(|s| (s.from, s.to, s.part));
    let mut used = vec![false; sides.len()];
    let mut rings = Vec::new();
    for start in 0..sides.len() {
        let mut path: Vec<usize> = Vec::new();
        let mut place = HashMap::new();
        let mut here = sides[start].from;
        loop {
            if let Some(first) = place.get(&here).copied() {
                let ring: Vec<Side> = path.drain(first..).map(|i| sides[i]).collect();
                ring.iter().for_each(|s| _ = place.remove(&s.from));
                rings.push(ring);
            }
            let first = sides.partition_point(|s| s.from < here);
            let free = |&i: &usize| !used[i];
            let next = (first..sides.len()).take_while(|&i| sides[i].from == here).find(free);
            if let Some(next) = next {
                used[next] = true;
                place.insert(here, path.len());
                path.push(next);
                here = sides[next].to;
            } else if let Some(dead) = path.pop() {
                // It leads nowhere.
                here = sides[dead].from;
                place.remove(&here);
            } else {
                break;
            }
        }
    }
    rings
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;

    fn sides(pairs: &[(u32, u32)]) -> Vec<Side> {
        let side = |&(from, to): &(u32, u32)| Side { from, to, look: Look::default(), part: from % 2 };
        pairs.iter().map(side).collect()
    }

    fn corners(rings: &[Vec<Side>]) -> Vec<Vec<u32>> {
        rings.iter().map(|r| r.iter().map(|s| s.from).collect()).collect()
    }

    #[test]
    fn rings_are_found_and_dead_ends_are_not() {
        assert_eq!(corners(&cracks(sides(&[(0, 1), (2, 0), (1, 2), (7, 8)]))), [[0, 1, 2]]);
        // Two rings that touch at a point, and a way out of one.
        let eight = [(0, 1), (1, 2), (2, 0), (0, 3), (3, 4), (4, 0), (3, 9)];
        let mut found = corners(&cracks(sides(&eight)));
        found.iter_mut().for_each(|r| r.sort_unstable());
        found.sort();
        assert_eq!(found, [[0, 1, 2], [0, 3, 4]]);
        assert!(cracks(sides(&[(0, 1), (1, 2), (2, 3)])).is_empty());
    }

    #[test]
    fn every_side_is_in_one_ring_at_most() {
        let mut random = Random::new(9);
        for _ in 0..300 {
            let pairs: Vec<(u32, u32)> = (0..40)
                .map(|_| (random.below(12) as u32, random.below(12) as u32))
                .filter(|p| p.0 != p.1)
                .collect();
            let rings = cracks(sides(&pairs));
            let mut left = pairs.clone();
            for ring in &rings {
                for (i, side) in ring.iter().enumerate() {
                    assert_eq!(side.to, ring[(i + 1) % ring.len()].from);
                    let at = left.iter().position(|p| *p == (side.from, side.to)).unwrap();
                    left.remove(at);
                }
                let mut points: Vec<u32> = ring.iter().map(|s| s.from).collect();
                points.sort_unstable();
                points.dedup();
                assert_eq!(points.len(), ring.len());
            }
        }
    }
}
