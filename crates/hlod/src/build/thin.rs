//! Thinning clouds of loose parts: leaves, blades, gravel.
//!
//! Contractions keep a loose part, however small, since nothing else is sure to stand for it. Here some of them are chosen to stay; each of the others is dropped if
//! one that stays is near enough, and what stays grows to the area of all that it stands for (after Cook, Halstead, Planck & Ryu 2007, with a bound instead of chance). The distance is two-sided: what is dropped is
//! near to what stays, and what stays moves no farther than it grows.

use crate::cell::{Cell, Lattice, place};
use crate::piece::{Piece, Vertices};
use farsight_geometry::distance::closest_on_triangle;
use farsight_geometry::mesh::DisjointSets;
use glam::DVec3;
use std::collections::HashMap;

/// Most triangles of a part; contractions reduce larger ones first.
const MOST_TRIANGLES: usize = 8;

/// Farthest corner of a part from its middle, over the tolerance.
const RADIUS: f64 = 0.5;

/// Shares of the tolerance: of what is dropped to what stays, and of what grows.
const DROP: f64 = 0.75;
const GROW: f64 = 0.25;

/// Fewer parts are no cloud.
const LEAST_PARTS: usize = 64;

/// Rounding of distances between lattice points, in units.
const SLACK: f64 = 1e-3;

/// A small loose part.
struct Part {
    /// Its triangles in the cloud's list.
    triangles: std::ops::Range<usize>,
    middle: DVec3,
    radius: f64,
    area: f64,
}

/// Small loose parts of a surface.
pub(super) struct Cloud {
    piece: Piece,
    parts: Vec<Part>,
    tolerance: f64,
}

/// What became of a cloud.
pub(super) struct Thinned {
    pub piece: Piece,
    /// Two-sided distance to the cloud, in units.
    pub error: f64,
}

/// Parts a surface from the loose parts in it that are small against a tolerance in units, if these are many. Those at the cell's walls belong to their other halves.
pub(super) fn part(piece: Piece, cell: &Cell, tolerance: f64) -> (Piece, Option<Cloud>) {
    let (corner, edge) = (cell.corner(), cell.edge());
    let inside = |p: Lattice| (0..3).all(|k| p[k] > corner[k] && p[k] < corner[k] + edge);
    let mut loose: Vec<(Vec<usize>, Part)> = Vec::new();
    for triangles in parts(&piece) {
        if triangles.len() > MOST_TRIANGLES {
            continue;
        }
        let corners = || triangles.iter().flat_map(|&t| piece.triangles[t]).map(|v| piece.at[v as usize]);
        let middle = corners().map(place).sum::<DVec3>() / (3 * triangles.len()) as f64;
        let radius = corners().map(|p| place(p).distance(middle)).fold(0.0, f64::max);
        if radius <= RADIUS * tolerance && corners().all(inside) {
            let area = triangles
                .iter()
                .map(|&t| area(piece.triangles[t].map(|v| place(piece.at[v as usize]))))
                .sum();
            loose.push((triangles, Part { triangles: 0..0, middle, radius, area }));
        }
    }
    if loose.len() < LEAST_PARTS {
        return (piece, None);
    }
    let mut is_loose = vec![false; piece.triangles.len()];
    let mut cloud = Cloud {
        piece: Piece { at: piece.at.clone(), looks: piece.looks.clone(), triangles: Vec::new() },
        parts: Vec::with_capacity(loose.len()),
        tolerance,
    };
    for (triangles, part) in loose {
        let first = cloud.piece.triangles.len();
        cloud.piece.triangles.extend(triangles.iter().map(|&t| piece.triangles[t]));
        triangles.iter().for_each(|&t| is_loose[t] = true);
        cloud.parts.push(Part { triangles: first..cloud.piece.triangles.len(), ..part });
    }
    let mut rest = piece;
    let mut next = is_loose.iter();
    rest.triangles.retain(|_| next.next().is_some_and(|loose| !loose));
    (rest.compacted(), Some(cloud))
}

impl Cloud {
    /// Keeps parts such that every other has one of them near, and lets them grow; what grows stays within the cell.
    pub(super) fn thinned(mut self, cell: &Cell) -> Thinned {
        // The largest stay: what is nearly nothing stands for no one.
        self.parts.sort_by(|a, b| b.area.total_cmp(&a.area).then(key(a.middle).cmp(&key(b.middle))));
        let largest = self.parts.iter().map(|p| p.radius).fold(0.0, f64::max);
        let reach = DROP * self.tolerance;
        let grid = Grid { edge: reach + 2.0 * largest };
        let mut kept: Vec<Kept> = Vec::new();
        let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        for (i, part) in self.parts.iter().enumerate() {
            let near = grid.around(part.middle).filter_map(|cell| cells.get(&cell)).flatten();
            let stands = near.copied().find_map(|k| {
                let other = &self.parts[kept[k as usize].part];
                let between = part.middle.distance(other.middle) - part.radius - other.radius;
                let distance = if between > reach { between } else { self.distance(part, other) };
                (distance + SLACK <= reach).then_some((k, distance + SLACK))
            });
            match stands {
                Some((k, distance)) => {
                    let kept = &mut kept[k as usize];
                    kept.farthest = kept.farthest.max(distance);
                    kept.area += part.area;
                }
                None => {
                    cells.entry(grid.cell(part.middle)).or_default().push(kept.len() as u32);
                    kept.push(Kept { part: i, area: part.area, farthest: 0.0 });
                }
            }
        }
        self.grown(&kept, cell)
    }

    /// Farthest that a point of a part is from another: that of a corner from a triangle, since the distance to that is convex.
    fn distance(&self, part: &Part, to: &Part) -> f64 {
        let corners = |t: usize| self.piece.triangles[t].map(|v| place(self.piece.at[v as usize]));
        let between = |t: usize, other: usize| {
            let triangle = corners(other);
            corners(t).iter().map(|&p| closest_on_triangle(triangle, p).distance(p)).fold(0.0, f64::max)
        };
        let nearest =
            |t: usize| to.triangles.clone().map(|other| between(t, other)).fold(f64::INFINITY, f64::min);
        part.triangles.clone().map(nearest).fold(0.0, f64::max)
    }

    fn grown(&self, kept: &[Kept], cell: &Cell) -> Thinned {
        let (low, high) = (place(cell.corner()), place(cell.corner()) + f64::from(cell.edge()));
        let mut out = Piece::default();
        let mut error = 0.0f64;
        for k in kept {
            let part = &self.parts[k.part];
            let wanted = if part.area > 0.0 { (k.area / part.area).sqrt() } else { 1.0 };
            let most = if part.radius > 0.0 { 1.0 + GROW * self.tolerance / part.radius } else { 1.0 };
            let scale = wanted.clamp(1.0, most);
            let mut moved = 0.0f64;
            let mut new: Vec<(u32, u32)> = Vec::new();
            for t in part.triangles.clone() {
                let triangle = self.piece.triangles[t].map(|v| {
                    if let Some(&(_, id)) = new.iter().find(|n| n.0 == v) {
                        return id;
                    }
                    let from = place(self.piece.at[v as usize]);
                    let to = (part.middle + (from - part.middle) * scale).clamp(low, high).round();
                    // As it is stored: whole units.
                    moved = moved.max(to.distance(from));
                    let id = out.at.len() as u32;
                    out.at.push(to.to_array().map(|x| x as i32));
                    out.looks.extend(self.piece.looks.get(v as usize));
                    new.push((v, id));
                    id
                });
                out.triangles.push(triangle);
            }
            error = error.max(k.farthest + moved + SLACK);
        }
        Thinned { piece: out, error }
    }
}

/// A part that stays.
struct Kept {
    part: usize,
    /// Of all that it stands for.
    area: f64,
    /// Farthest of these.
    farthest: f64,
}

/// Cells that what can be near a point is in, or beside.
struct Grid {
    edge: f64,
}

impl Grid {
    fn cell(&self, p: DVec3) -> [i64; 3] {
        (p / self.edge).floor().to_array().map(|x| x as i64)
    }

    fn around(&self, p: DVec3) -> impl Iterator<Item = [i64; 3]> + use<> {
        let [x, y, z] = self.cell(p);
        (0..27).map(move |i| [x + i % 3 - 1, y + i / 3 % 3 - 1, z + i / 9 - 1])
    }
}

/// An order that does not depend on the order of the input.
fn key(p: DVec3) -> [u64; 3] {
    p.to_array().map(f64::to_bits)
}

fn area([a, b, c]: [DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

/// Triangles that hang together by common positions, in the order of their first ones.
fn parts(piece: &Piece) -> Vec<Vec<usize>> {
    // Vertices at one position are one, whatever they look like.
    let mut places = Vertices::default();
    let place_of: Vec<u32> = piece.at.iter().map(|&p| places.add(p, None)).collect();
    let mut sets = DisjointSets::new(places.at.len());
    for t in &piece.triangles {
        let [a, b, c] = t.map(|v| place_of[v as usize]);
        sets.join(a, b);
        sets.join(a, c);
    }
    let mut number = vec![u32::MAX; places.at.len()];
    let mut parts: Vec<Vec<usize>> = Vec::new();
    for (i, t) in piece.triangles.iter().enumerate() {
        let number = &mut number[sets.lowest(place_of[t[0] as usize]) as usize];
        if *number == u32::MAX {
            *number = parts.len() as u32;
            parts.push(Vec::new());
        }
        parts[*number as usize].push(i);
    }
    parts
}
