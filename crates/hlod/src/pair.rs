//! How far two given surfaces are apart: both certificates, without a history of contractions.

use crate::HlodError;
use crate::cover::Coverer;
use crate::facet::Facet;
use crate::flood::Flood;
use crate::frame::{Frame, SLACK};
use crate::original::{NONE, Original, morton};
use crate::simplify::{measuring, usable_tolerance};
use farsight_geometry::accuracy::{Cost, Counters, ErrorBound, Unit};
use farsight_geometry::distance::{Surface, one_sided};
use farsight_geometry::{MeshError, TriangleMesh};
use glam::{DVec3, Vec3};
use std::time::Instant;

/// What [`certify`] found.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Certification {
    /// Two-sided Hausdorff distance, rounding included. Above the tolerance only where [`measured`](Self::measured) triangles are.
    pub bound: ErrorBound,
    /// Triangles of both surfaces that no certificate was found for; their distance was measured by branch and bound.
    pub measured: u64,
    /// Time; counters `triangles`, `faces`, `measured`, `visits` (of original triangles by floods), `pieces` (that they were cut into).
    pub cost: Cost,
}

impl Certification {
    /// Whether no point of either surface is farther from the other than a tolerance.
    pub fn holds(&self, tolerance: f64) -> bool {
        self.bound.value <= tolerance
    }
}

/// Most triangles of the original that a face looks at along the curve they are sorted by, to each side, for one to start from.
const NEARBY: usize = 8;

/// Certifies that two surfaces are within a tolerance of each other, however the second was made: by this crate, by another, by hand.
///
/// Fast where they are, and where each is a surface rather than loose triangles: a flood over the original below each face of the other, and walls of faces that cut what
/// several of them cover. What cannot be certified so is measured.
///
/// # Accuracy
/// The bound is proven, and is at most the tolerance if everything could be certified; it may then be well above the true distance, but never below. Faces may have turned
/// over: only distance counts.
///
/// # Cost
/// About a microsecond a triangle of the original; see the book. Measuring takes longer where the surfaces are farther apart than the tolerance.
///
/// # Errors
/// As [`simplify`](crate::simplify()): for a tolerance that is no length or below what coordinates can tell apart.
///
/// ```
/// use farsight_geometry::hard_cases::bumpy_ball;
/// use farsight_hlod::{SimplifyOptions, certify, simplify};
///
/// let ball = bumpy_ball(30);
/// let simple = simplify(&ball, 0.01, &SimplifyOptions::default())?;
/// assert!(certify(&ball, &simple.mesh, 0.01)?.holds(0.01));
/// let coarser = simplify(&ball, 0.1, &SimplifyOptions::default())?;
/// assert!(!certify(&ball, &coarser.mesh, 0.01)?.holds(0.01));
/// # Ok::<(), farsight_hlod::HlodError>(())
/// ```
pub fn certify(
    original: &TriangleMesh,
    simplified: &TriangleMesh,
    tolerance: f64,
) -> Result<Certification, HlodError> {
    let start = Instant::now();
    let frame = Frame::of(original);
    let limit = usable_tolerance(original, &frame, tolerance)?;
    let surface = Original::new(original, &frame);
    let mut pair = Pair::new(original, simplified, &frame, &surface, limit * limit);
    pair.flood_faces();
    pair.cover_rest();
    let certified = frame.length_out(pair.reach_sq.sqrt() + SLACK).next_up();
    // Bare lines of the original have no triangle that could be covered.
    let triangles =
        if surface.lines.is_empty() { pair.bad_triangles() } else { original.triangles().to_vec() };
    let faces: Vec<[u32; 3]> = pair.bad_faces.iter().map(|&f| simplified.triangles()[f as usize]).collect();
    let measured = (triangles.len() + faces.len()) as u64;
    let mut value = if certified < tolerance { certified } else { tolerance };
    value = value.max(measure(simplified, faces, original, tolerance)?);
    value = value.max(measure(original, triangles, simplified, tolerance)?);
    let mut counters = Counters::new();
    counters.add("triangles", original.triangles().len() as u64);
    counters.add("faces", simplified.triangles().len() as u64);
    counters.add("measured", measured);
    counters.add("visits", pair.flood.visits);
    counters.add("pieces", pair.coverer.count);
    let cost = Cost { time: start.elapsed(), counters, ..Cost::default() };
    Ok(Certification { bound: ErrorBound::proven(value, Unit::Metres), measured, cost })
}

/// An upper bound of the distance from some triangles of a surface to another.
fn measure(
    of: &TriangleMesh,
    triangles: Vec<[u32; 3]>,
    to: &TriangleMesh,
    tolerance: f64,
) -> Result<f64, MeshError> {
    if triangles.is_empty() {
        return Ok(0.0);
    }
    let part = TriangleMesh::new(of.positions().to_vec(), triangles)?.with_origin(of.origin())?;
    Ok(one_sided(&part, &Surface::new(to), &measuring(tolerance)).upper)
}

struct Pair<'a> {
    mesh: &'a TriangleMesh,
    frame: &'a Frame,
    original: &'a Original,
    tolerance_sq: f64,
    /// Faces of the other surface; none where they are too thin to certify anything.
    facets: Vec<Option<Facet>>,
    flood: Flood,
    coverer: Coverer,
    /// The face that covers each original triangle alone.
    owner: Vec<u32>,
    /// Original triangles over a face that does not cover them alone.
    straddling: Vec<(u32, u32)>,
    reach_sq: f64,
    bad_faces: Vec<u32>,
    covered: Vec<bool>,
}

impl<'a> Pair<'a> {
    fn new(
        mesh: &'a TriangleMesh,
        simplified: &TriangleMesh,
        frame: &'a Frame,
        original: &'a Original,
        tolerance_sq: f64,
    ) -> Self {
        // Where both have one origin, corners are as exact as the original's.
        let apart = simplified.origin() - mesh.origin();
        let enter = |p: Vec3| match apart == DVec3::ZERO {
            true => frame.enter(p),
            false => frame.enter(Vec3::ZERO) + (p.as_dvec3() + apart) * frame.length_in(1.0),
        };
        // What is far outside of the original is not certified, since rounding grows with coordinates.
        let near = |c: &[DVec3; 3]| c.iter().all(|p| p.abs().max_element() <= 2.0);
        let facet = |c: [Vec3; 3]| Some(c.map(enter)).filter(near).and_then(Facet::new);
        let mut flood = Flood::new(original);
        flood.any_side = true;
        Self {
            mesh,
            frame,
            original,
            tolerance_sq,
            facets: simplified.corner_iter().map(facet).collect(),
            flood,
            coverer: Coverer::default(),
            owner: vec![NONE; original.triangles.len()],
            straddling: Vec::new(),
            reach_sq: 0.0,
            bad_faces: Vec::new(),
            covered: vec![false; original.triangles.len()],
        }
    }

    /// An original triangle near a point: the nearest of those around its place on the curve.
    fn hint(&self, at: DVec3) -> u32 {
        let middle = |t: usize| self.original.corners(t as u32).iter().sum::<DVec3>() / 3.0;
        let (key, count) = (morton(at), self.original.triangles.len());
        let (mut low, mut high) = (0, count);
        while low < high {
            let half = (low + high) / 2;
            if morton(middle(half)) < key { low = half + 1 } else { high = half }
        }
        let around = low.saturating_sub(NEARBY)..(low + NEARBY).min(count);
        let distance = |&t: &usize| middle(t).distance_squared(at);
        around.min_by(|a, b| distance(a).total_cmp(&distance(b))).map_or(NONE, |t| t as u32)
    }

    /// Backward certificates, and forward ones of the triangles that one face covers alone.
    fn flood_faces(&mut self) {
        let mut nearest: Option<(Surface, Vec<u32>)> = None;
        for f in 0..self.facets.len() as u32 {
            let Some(facet) = self.facets[f as usize].take() else {
                self.bad_faces.push(f);
                continue;
            };
            let middle = facet.corners.iter().sum::<DVec3>() / 3.0;
            let hint = self.hint(middle);
            if !self.flood_face(f, &facet, hint) {
                // Sheets may lie close to each other on the curve: the nearest triangle is dearer to find, and right more often.
                let (surface, slots) =
                    nearest.get_or_insert_with(|| (Surface::new(self.mesh), slots(self.mesh, self.original)));
                let world = self.mesh.origin() + self.frame.leave(middle).as_dvec3();
                let found = surface.nearest(world).map_or(NONE, |n| slots[n.triangle as usize]);
                if found == NONE || found == hint || !self.flood_face(f, &facet, found) {
                    self.bad_faces.push(f);
                }
            }
            self.facets[f as usize] = Some(facet);
        }
    }

    /// Certifies a face. What it covers is covered even where it lies off the original itself: that is another question.
    fn flood_face(&mut self, f: u32, facet: &Facet, hint: u32) -> bool {
        if hint == NONE {
            return false;
        }
        let Self { original, tolerance_sq, flood, owner, straddling, reach_sq, .. } = self;
        let certified = flood.certify(original, facet, hint, &[hint], *tolerance_sq, |t, shadows| {
            if owner[t as usize] != NONE {
                return;
            }
            let corners = original.corners(t);
            let farthest = (0..3).map(|i| facet.distance_sq(corners[i], &shadows[i])).fold(0.0, f64::max);
            if farthest <= *tolerance_sq {
                owner[t as usize] = f;
                *reach_sq = reach_sq.max(farthest);
            } else {
                straddling.push((t, f));
            }
        });
        *reach_sq = reach_sq.max(certified.map_or(0.0, |c| c.reach_sq));
        certified.is_some()
    }

    /// Forward certificates of what no face covers alone: by the faces over it, then also by those over its neighbours.
    fn cover_rest(&mut self) {
        let mut straddling = std::mem::take(&mut self.straddling);
        straddling.sort_unstable();
        straddling.dedup();
        let mut first_of = vec![0u32; self.original.triangles.len() + 1];
        straddling.iter().for_each(|s| first_of[s.0 as usize + 1] += 1);
        for t in 1..first_of.len() {
            first_of[t] += first_of[t - 1];
        }
        let over = |t: u32, into: &mut Vec<u32>, owner: &[u32]| {
            if owner[t as usize] != NONE {
                into.push(owner[t as usize]);
            }
            let range = first_of[t as usize] as usize..first_of[t as usize + 1] as usize;
            into.extend(straddling[range].iter().map(|s| s.1));
        };
        let (mut candidates, mut ring, mut wider) = (Vec::new(), Vec::new(), Vec::new());
        for t in 0..self.original.triangles.len() as u32 {
            if self.owner[t as usize] != NONE {
                self.covered[t as usize] = true;
                continue;
            }
            candidates.clear();
            over(t, &mut candidates, &self.owner);
            if self.try_cover(t, &candidates) {
                continue;
            }
            ring.clear();
            ring.push(t);
            for _ in 0..2 {
                wider.clear();
                wider.extend(
                    ring.iter().flat_map(|&t| self.original.neighbours[t as usize]).filter(|&n| n != NONE),
                );
                ring.extend_from_slice(&wider);
                ring.sort_unstable();
                ring.dedup();
            }
            ring.iter().for_each(|&n| over(n, &mut candidates, &self.owner));
            candidates.sort_unstable();
            candidates.dedup();
            self.try_cover(t, &candidates);
        }
    }

    fn try_cover(&mut self, t: u32, candidates: &[u32]) -> bool {
        let facets: Vec<&Facet> =
            candidates.iter().filter_map(|&f| self.facets[f as usize].as_ref()).take(64).collect();
        let cover = self.coverer.cover(self.original.corners(t), &facets, self.tolerance_sq);
        if let Some(cover) = cover {
            self.covered[t as usize] = true;
            self.reach_sq = self.reach_sq.max(cover.reach_sq);
        }
        cover.is_some()
    }

    fn bad_triangles(&self) -> Vec<[u32; 3]> {
        let bad = self.covered.iter().zip(&self.original.source).filter(|(covered, _)| !**covered);
        bad.map(|(_, &source)| self.mesh.triangles()[source as usize]).collect()
    }
}

/// Place along the curve of each triangle of the mesh; none for those that were left out.
fn slots(mesh: &TriangleMesh, original: &Original) -> Vec<u32> {
    let mut slots = vec![NONE; mesh.triangles().len()];
    original.source.iter().enumerate().for_each(|(slot, &t)| slots[t as usize] = slot as u32);
    slots
}
