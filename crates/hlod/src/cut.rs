//! Cutting a surface into the cells of an octree.
//!
//! Triangles that cross a wall are cut there. The new corner is found from the side's ends in an order that does not depend on who asks, so that both
//! neighbours of a side, and both sides of a wall, get the same corner. Pieces stay convex polygons until a leaf triangulates
//! them.

use crate::appearance::Look;
use crate::cell::{Cell, DEEPEST, Lattice};

/// Convex polygons with shared storage.
#[derive(Clone, Debug, Default)]
pub(crate) struct Polygons {
    pub at: Vec<Lattice>,
    /// Empty, or as many as corners.
    pub looks: Vec<Look>,
    /// Where each polygon's corners end.
    pub ends: Vec<u32>,
}

impl Polygons {
    pub(crate) fn len(&self) -> usize {
        self.ends.len()
    }

    /// Triangles that they will be made of.
    pub(crate) fn triangles(&self) -> usize {
        self.at.len() - 2 * self.ends.len()
    }

    fn range(&self, i: usize) -> std::ops::Range<usize> {
        (if i == 0 { 0 } else { self.ends[i - 1] as usize })..self.ends[i] as usize
    }

    /// Corners of each polygon.
    pub(crate) fn iter(&self) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        (0..self.len()).map(|i| self.range(i))
    }

    pub(crate) fn push_triangle(&mut self, at: [Lattice; 3], looks: Option<[Look; 3]>) {
        self.at.extend(at);
        self.looks.extend(looks.into_iter().flatten());
        self.ends.push(self.at.len() as u32);
    }

    fn push_corner(&mut self, at: Lattice, look: Option<Look>) {
        self.at.push(at);
        self.looks.extend(look);
    }

    fn end_polygon(&mut self) {
        self.ends.push(self.at.len() as u32);
    }

    fn look(&self, corner: usize) -> Option<Look> {
        self.looks.get(corner).copied()
    }

    /// Copies another's polygon.
    fn copy(&mut self, from: &Self, range: std::ops::Range<usize>) {
        self.at.extend_from_slice(&from.at[range.clone()]);
        if !from.looks.is_empty() {
            self.looks.extend_from_slice(&from.looks[range]);
        }
        self.end_polygon();
    }

    /// Cuts at the wall where coordinate `axis` is `wall`: what is below, and what is above or on it.
    fn cut(&self, axis: usize, wall: i32) -> [Self; 2] {
        let mut parts = [Self::default(), Self::default()];
        for range in self.iter() {
            let corners = &self.at[range.clone()];
            let below = corners.iter().any(|c| c[axis] < wall);
            let above = corners.iter().any(|c| c[axis] > wall);
            if !(below && above) {
                // Polygons within a wall belong to the upper side alone.
                parts[usize::from(!below)].copy(self, range);
                continue;
            }
            for i in range.clone() {
                let j = if i + 1 == range.end { range.start } else { i + 1 };
                let (a, b) = (self.at[i][axis], self.at[j][axis]);
                if a <= wall {
                    parts[0].push_corner(self.at[i], self.look(i));
                }
                if a >= wall {
                    parts[1].push_corner(self.at[i], self.look(i));
                }
                if (a < wall && b > wall) || (a > wall && b < wall) {
                    let (at, look) = self.crossing(i, j, axis, wall);
                    parts.iter_mut().for_each(|p| p.push_corner(at, look));
                }
            }
            parts.iter_mut().for_each(Self::end_polygon);
        }
        parts
    }

    fn crossing(&self, i: usize, j: usize, axis: usize, wall: i32) -> (Lattice, Option<Look>) {
        let (i, j) = if self.at[i] <= self.at[j] { (i, j) } else { (j, i) };
        let (a, b) = (self.at[i], self.at[j]);
        let t = (f64::from(wall) - f64::from(a[axis])) / (f64::from(b[axis]) - f64::from(a[axis]));
        let mut at = [0, 1, 2].map(|k| {
            let (a, b) = (f64::from(a[k]), f64::from(b[k]));
            (a + (b - a) * t).round() as i32
        });
        at[axis] = wall;
        (at, self.look(i).zip(self.look(j)).map(|(a, b)| a.towards(&b, t as f32)))
    }

    /// The parts in the eight children of a cell.
    pub(crate) fn split(self, cell: &Cell) -> [Self; 8] {
        let middle = cell.middle();
        let x = self.cut(0, middle[0]);
        drop(self);
        let mut parts: [Self; 8] = Default::default();
        for (i, x) in x.into_iter().enumerate() {
            for (j, y) in x.cut(1, middle[1]).into_iter().enumerate() {
                for (k, z) in y.cut(2, middle[2]).into_iter().enumerate() {
                    parts[i | j << 1 | k << 2] = z;
                }
            }
        }
        parts
    }
}

/// Triangles in cells, and in the one with the most.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SplitCounts {
    pub total: usize,
    pub fullest: usize,
    pub cells: usize,
}

impl SplitCounts {
    pub(crate) fn of(counts: impl IntoIterator<Item = usize>) -> Self {
        counts.into_iter().filter(|&n| n > 0).fold(Self::default(), |s, n| Self {
            total: s.total + n,
            fullest: s.fullest.max(n),
            cells: s.cells + 1,
        })
    }

    /// Whether cutting a cell of `triangles` was worth while: what all touch, or lies several times in the same place, only multiplies.
    pub(crate) fn made_progress(&self, triangles: usize) -> bool {
        self.cells <= 1 || (self.fullest < triangles && self.total < 2 * triangles)
    }
}

/// Cuts until every leaf has at most `most` triangles, cannot be divided further, or gains nothing from it. Leaves come in the order of their cells along a
/// Z curve.
pub(crate) fn cut(cell: Cell, polygons: Polygons, most: usize, leaf: &mut dyn FnMut(Cell, Polygons)) {
    let triangles = polygons.triangles();
    if triangles == 0 {
        return;
    }
    if triangles <= most || cell.level == DEEPEST {
        return leaf(cell, polygons);
    }
    let whole = polygons.clone();
    let parts = polygons.split(&cell);
    if !SplitCounts::of(parts.iter().map(Polygons::triangles)).made_progress(triangles) {
        drop(parts);
        return leaf(cell, whole);
    }
    drop(whole);
    for (octant, part) in parts.into_iter().enumerate() {
        cut(cell.child(octant as u32), part, most, leaf);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Cube;
    use farsight_geometry::{TriangleMesh, hard_cases};
    use glam::DVec3;

    fn polygons(mesh: &TriangleMesh, cube: &Cube) -> Polygons {
        let mut all = Polygons::default();
        for c in mesh.corner_iter() {
            all.push_triangle(c.map(|p| cube.enter(mesh.origin() + p.as_dvec3())), None);
        }
        all
    }

    fn area(p: &Polygons) -> f64 {
        let at = |i: usize| DVec3::from_array(p.at[i].map(f64::from));
        let one = |r: std::ops::Range<usize>| {
            let a = at(r.start);
            (r.start + 1..r.end - 1).map(|i| 0.5 * (at(i) - a).cross(at(i + 1) - a).length()).sum::<f64>()
        };
        p.iter().map(one).sum()
    }

    #[test]
    fn pieces_have_the_area_of_the_whole_and_lie_in_their_cells() {
        for hard in hard_cases::meshes() {
            let cube = Cube::around(&hard.mesh.world_bounds());
            let whole = polygons(&hard.mesh, &cube);
            let (expected, count) = (area(&whole), whole.triangles());
            let (mut total, mut triangles) = (0.0, 0);
            cut(Cell::ROOT, whole, 30, &mut |cell, p| {
                total += area(&p);
                triangles += p.triangles();
                let (min, edge) = (cell.corner(), cell.edge());
                for c in &p.at {
                    assert!((0..3).all(|k| c[k] >= min[k] && c[k] <= min[k] + edge), "{}", hard.name);
                }
                assert!(p.iter().all(|r| (3..=12).contains(&r.len())), "{}", hard.name);
            });
            assert!((total - expected).abs() <= 1e-6 * expected, "{}: {total} of {expected}", hard.name);
            assert!(triangles >= count && triangles < 40 * count.max(100), "{}: {triangles}", hard.name);
        }
    }

    #[test]
    fn both_sides_of_a_wall_have_the_same_rim() {
        let ball = hard_cases::bumpy_ball(12);
        let cube = Cube::around(&ball.world_bounds());
        let parts = polygons(&ball, &cube).split(&Cell::ROOT);
        let wall = Cell::ROOT.middle()[0];
        // Sides within the wall x = middle of the octants below and above.
        let rim = |octants: [usize; 4]| {
            let mut sides = Vec::new();
            for p in octants.map(|o| &parts[o]) {
                for r in p.iter() {
                    for i in r.clone() {
                        let j = if i + 1 == r.end { r.start } else { i + 1 };
                        let (a, b) = (p.at[i], p.at[j]);
                        if a[0] == wall && b[0] == wall {
                            sides.push((a.min(b), a.max(b)));
                        }
                    }
                }
            }
            sides.sort_unstable();
            sides
        };
        let (low, high) = (rim([0, 2, 4, 6]), rim([1, 3, 5, 7]));
        assert!(low.len() > 20);
        assert_eq!(low, high);
    }

    #[test]
    fn stacks_and_fans_end() {
        let mut stack = Polygons::default();
        for _ in 0..500 {
            stack.push_triangle([[1 << 20, 1 << 20, 5], [1 << 29, 1 << 21, 99], [1 << 22, 1 << 29, 7]], None);
        }
        let mut leaves = Vec::new();
        cut(Cell::ROOT, stack, 100, &mut |cell, p| leaves.push((cell.level, p.triangles())));
        assert!(leaves.iter().map(|l| l.1).sum::<usize>() < 3000, "{leaves:?}");
        let mut fan = Polygons::default();
        for i in 0..1000 {
            let (s, c) = (f64::from(i) * 0.00628).sin_cos();
            let (t, d) = (f64::from(i + 1) * 0.00628).sin_cos();
            let rim =
                |s: f64, c: f64| [0.5 + 0.4 * c, 0.5 + 0.4 * s, 0.5].map(|x| (x * f64::from(1 << 30)) as i32);
            fan.push_triangle([rim(0.0, 0.0), rim(s, c), rim(t, d)].map(|p| p), None);
        }
        let mut total = 0;
        cut(Cell::ROOT, fan, 50, &mut |_, p| total += p.triangles());
        assert!(total < 4000, "{total}");
    }

    #[test]
    fn polygons_within_a_wall_are_counted_once() {
        let m = 1 << 29;
        let mut flat = Polygons::default();
        flat.push_triangle([[m, 5, 5], [m, 99, 5], [m, 5, 99]], None);
        let parts = flat.split(&Cell::ROOT);
        assert_eq!(parts.iter().map(Polygons::len).collect::<Vec<_>>(), [0, 1, 0, 0, 0, 0, 0, 0]);
    }
}
