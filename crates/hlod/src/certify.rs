//! Certifies a whole surface at once, and takes contractions back where that fails.

use crate::appearance::{Appearance, Look};
use crate::claims::Claims;
use crate::complex::{Complex, Marks};
use crate::cover::Coverer;
use crate::facet::Facet;
use crate::fast::Log;
use crate::flood::Flood;
use crate::original::{NONE, Original};
use farsight_geometry::accuracy::Counters;

/// A surface with both certificates for all of it.
#[derive(Clone, Debug)]
pub(crate) struct CertifiedSurface {
    pub surface: Complex,
    /// Forward: the faces that cover each original triangle.
    pub claims: Claims,
    /// Backward: an original triangle below each face.
    pub seeds: Vec<u32>,
    /// Distance that the certificates of a face need, both directions, squared.
    pub reach_sq: Vec<f64>,
    /// Looks of the faces' corners, and squared errors of appearance; empty when nobody asked.
    pub looks: Vec<[Look; 3]>,
    pub look_sq: Vec<f64>,
}

impl CertifiedSurface {
    /// The largest error of appearance, off and along the surface.
    pub(crate) fn look_error(&self) -> f64 {
        let live = self.surface.faces.iter().zip(&self.look_sq).filter(|(f, _)| f[0] != NONE);
        live.map(|(_, &r)| r).fold(0.0, f64::max).sqrt()
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of::<[Look; 3]>() * self.looks.capacity()
            + self.surface.bytes()
            + self.claims.bytes()
            + 4 * self.seeds.capacity()
            + 8 * self.reach_sq.capacity()
    }

    /// The largest distance of all certificates.
    pub(crate) fn reach(&self) -> f64 {
        let live = self.surface.faces.iter().zip(&self.reach_sq).filter(|(f, _)| f[0] != NONE);
        live.map(|(_, &r)| r).fold(0.0, f64::max).sqrt()
    }
}

/// What [`certify_all`] did.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CertifyCounts {
    pub rounds: u64,
    pub taken_back: u64,
    pub visits: u64,
    pub pieces: u64,
}

impl CertifyCounts {
    pub(crate) fn add_to(&self, counters: &mut Counters) {
        counters.add("taken back", self.taken_back);
        counters.add("visits", self.visits);
        counters.add("pieces", self.pieces);
    }
}

/// Certifies the surface that `log` led to, taking contractions back until everything holds.
///
/// Ends, since a face whose corners are original vertices certifies itself and its own triangle, and every failure has a corner that is
/// not.
pub(crate) fn certify_all(
    original: &Original,
    surface: Complex,
    log: &mut Log,
    tolerance_sq: f64,
    appearance: Option<&Appearance>,
) -> (CertifiedSurface, CertifyCounts) {
    Work::new(original, surface, log, tolerance_sq, appearance).run()
}

/// What has no certificate.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bad {
    pub faces: Vec<u32>,
    pub triangles: Vec<u32>,
}

/// Certifies what can be, by distance alone: faces may have turned over. Takes nothing back.
pub(crate) fn certify_some(
    original: &Original,
    surface: Complex,
    log: &mut Log,
    tolerance_sq: f64,
    appearance: Option<&Appearance>,
) -> (CertifiedSurface, CertifyCounts, Bad) {
    let mut work = Work::new(original, surface, log, tolerance_sq, appearance);
    work.flood.any_side = true;
    let faces: Vec<u32> = work.certified.surface.live_faces().collect();
    work.certify(&faces);
    let counts = work.counts();
    (work.certified, counts, Bad { faces: work.bad_faces, triangles: work.bad_triangles })
}

/// Which of some faces have no certificate within a wider tolerance either, by distance alone; and how far the others are.
pub(crate) fn beyond(
    original: &Original,
    state: &CertifiedSurface,
    faces: &[u32],
    tolerance_sq: f64,
) -> (Vec<u32>, f64) {
    let mut flood = Flood::new(original);
    flood.any_side = true;
    let mut reach_sq = 0.0f64;
    let mut is_beyond = |&f: &u32| {
        let certified = Facet::new(state.surface.corners(f)).and_then(|facet| {
            flood.certify(original, &facet, state.seeds[f as usize], &[f], tolerance_sq, |_, _| {})
        });
        reach_sq = reach_sq.max(certified.map_or(0.0, |c| c.reach_sq));
        certified.is_none()
    };
    let left = faces.iter().copied().filter(|f| is_beyond(f)).collect();
    (left, reach_sq.sqrt())
}

/// Facets of faces that were asked for not long ago: neighbouring triangles need the same.
struct Recent(Vec<Option<(u32, Facet)>>);

impl Recent {
    /// Faces on the curve within which each has a place of its own.
    const COUNT: usize = 512;

    fn new() -> Self {
        Self(vec![None; Self::COUNT])
    }

    /// Forgets all: the surface has changed.
    fn clear(&mut self) {
        self.0.fill_with(|| None);
    }

    /// The facet of a face; `None` where it is too thin for one.
    fn facet(&mut self, face: u32, surface: &Complex) -> Option<&(u32, Facet)> {
        let slot = &mut self.0[face as usize % Self::COUNT];
        if slot.as_ref().is_none_or(|s| s.0 != face) {
            *slot = Facet::new(surface.corners(face)).map(|facet| (face, facet));
        }
        slot.as_ref()
    }
}

struct Work<'a> {
    original: &'a Original,
    appearance: Option<&'a Appearance<'a>>,
    log: &'a mut Log,
    flood: Flood,
    coverer: Coverer,
    covered: Vec<bool>,
    /// Triangles over a facet that does not cover them alone.
    straddling: Vec<(u32, u32)>,
    /// Corners of bad faces that will be taken back: what lies around them waits until that is done.
    doomed: Marks,
    recent: Recent,
    /// Those that the triangle at hand is to be covered by.
    facets: Vec<(u32, Facet)>,
    certified: CertifiedSurface,
    tolerance_sq: f64,
    bad_faces: Vec<u32>,
    bad_triangles: Vec<u32>,
    counts: CertifyCounts,
}

impl<'a> Work<'a> {
    fn new(
        original: &'a Original,
        surface: Complex,
        log: &'a mut Log,
        tolerance_sq: f64,
        appearance: Option<&'a Appearance<'a>>,
    ) -> Self {
        let count = original.triangles.len();
        let looks: Vec<[Look; 3]> =
            appearance.map_or(vec![], |a| (0..count as u32).map(|t| a.corners(original, t)).collect());
        Self {
            original,
            log,
            flood: Flood::new(original),
            coverer: Coverer::default(),
            covered: vec![false; count],
            straddling: Vec::new(),
            doomed: Marks::new(original.points.len()),
            recent: Recent::new(),
            facets: Vec::new(),
            certified: CertifiedSurface {
                surface,
                claims: Claims::new(count),
                seeds: (0..count as u32).collect(),
                reach_sq: vec![0.0; count],
                look_sq: vec![0.0; looks.len()],
                looks,
            },
            tolerance_sq,
            appearance,
            bad_faces: Vec::new(),
            bad_triangles: Vec::new(),
            counts: CertifyCounts { rounds: 1, ..CertifyCounts::default() },
        }
    }

    /// Certifies faces, and the triangles that are not covered.
    fn certify(&mut self, faces: &[u32]) {
        self.flood_faces(faces);
        self.doomed.clear();
        if !self.flood.any_side {
            for &f in &self.bad_faces {
                self.certified.surface.faces[f as usize].iter().for_each(|&v| _ = self.doomed.set(v));
            }
        }
        self.cover(0..self.original.triangles.len() as u32);
    }

    fn counts(&self) -> CertifyCounts {
        CertifyCounts { visits: self.flood.visits, pieces: self.coverer.count, ..self.counts }
    }

    /// Certifies everything, taking contractions back until nothing is bad.
    fn run(mut self) -> (CertifiedSurface, CertifyCounts) {
        let faces: Vec<u32> = self.certified.surface.live_faces().collect();
        self.certify(&faces);
        let mut failures = vec![0u8; self.original.points.len()];
        let mut asked = Marks::new(self.original.points.len());
        loop {
            let mut guilty: Vec<u32> = Vec::new();
            for f in std::mem::take(&mut self.bad_faces) {
                guilty.extend(self.certified.surface.faces[f as usize]);
            }
            for t in std::mem::take(&mut self.bad_triangles) {
                guilty.extend(self.original.triangles[t as usize].map(|v| self.log.representative(v)));
            }
            if self.counts.taken_back > 0 {
                guilty.extend(self.tangled());
            }
            asked.clear();
            let mut taken_back = Vec::new();
            for v in guilty {
                if v != NONE && !self.log.is_single(v) && asked.set(v) {
                    // One contraction the first time, then twice as many each time; after many rounds all of them.
                    let doublings = u64::from(failures[v as usize]) + self.counts.rounds / 8;
                    failures[v as usize] = failures[v as usize].saturating_add(1);
                    self.take_back(v, 1u32 << doublings.min(30), &mut taken_back);
                }
            }
            if taken_back.is_empty() {
                let counts = self.counts();
                return (self.certified, counts);
            }
            self.counts.taken_back += taken_back.len() as u64;
            self.counts.rounds += 1;
            let changed = self.rebuild(&taken_back);
            self.certify(&changed);
        }
    }

    /// Backward certificates of the faces, forward ones of the triangles that one of them covers alone.
    fn flood_faces(&mut self, faces: &[u32]) {
        let CertifiedSurface { surface, claims, seeds, reach_sq, looks, look_sq } = &mut self.certified;
        let original = self.original;
        for &f in faces {
            let corners = surface.faces[f as usize];
            if corners[0] == NONE {
                continue;
            }
            if corners == self.original.triangles[f as usize]
                && corners.iter().all(|&v| self.log.is_single(v))
            {
                seeds[f as usize] = f;
                reach_sq[f as usize] = 0.0;
                if let Some(appearance) = self.appearance {
                    (looks[f as usize], look_sq[f as usize]) = (appearance.corners(original, f), 0.0);
                }
                if !std::mem::replace(&mut self.covered[f as usize], true) {
                    claims.add(f, f);
                }
                continue;
            }
            let Some(facet) = Facet::new(surface.corners(f)) else {
                self.bad_faces.push(f);
                continue;
            };
            let mut reach = 0.0f64;
            let (covered, straddling, tolerance_sq) =
                (&mut self.covered, &mut self.straddling, self.tolerance_sq);
            let before = straddling.len();
            let mut taken: Vec<u32> = Vec::new();
            let certified =
                self.flood.certify(original, &facet, seeds[f as usize], &[f], tolerance_sq, |t, shadows| {
                    if covered[t as usize] {
                        return;
                    }
                    let corners = original.corners(t);
                    let farthest =
                        (0..3).map(|i| facet.distance_sq(corners[i], &shadows[i])).fold(0.0, f64::max);
                    if farthest <= tolerance_sq {
                        covered[t as usize] = true;
                        reach = reach.max(farthest);
                        taken.push(t);
                    } else {
                        straddling.push((t, f));
                    }
                });
            let limit_sq = if self.flood.any_side { f64::INFINITY } else { tolerance_sq };
            let judged = self
                .appearance
                .map(|a| a.judge(original, &facet, self.flood.below(), limit_sq, &mut (NONE, 0)));
            // By distance alone: what it looks like is reported, and holds nothing up.
            let certified = certified.filter(|_| {
                self.flood.any_side || judged.is_none_or(|(_, error_sq)| error_sq <= tolerance_sq)
            });
            if let Some(judged) = judged {
                (looks[f as usize], look_sq[f as usize]) = judged;
            }
            match certified {
                Some(c) => {
                    seeds[f as usize] = c.seed;
                    reach_sq[f as usize] = reach.max(c.reach_sq);
                    taken.iter().for_each(|&t| claims.add(t, f));
                }
                // What a face covers is covered even where it lies off the original itself, if it stays.
                None if self.flood.any_side => {
                    reach_sq[f as usize] = reach;
                    taken.iter().for_each(|&t| claims.add(t, f));
                    self.bad_faces.push(f);
                }
                None => {
                    straddling.truncate(before);
                    taken.iter().for_each(|&t| covered[t as usize] = false);
                    self.bad_faces.push(f);
                }
            }
        }
    }

    /// Forward certificates of those of some triangles, in order, that have none.
    fn cover(&mut self, triangles: impl Iterator<Item = u32>) {
        self.recent.clear();
        let mut straddling = std::mem::take(&mut self.straddling);
        straddling.sort_unstable();
        let mut at = 0;
        let mut candidates: Vec<u32> = Vec::new();
        for t in triangles {
            while straddling.get(at).is_some_and(|s| s.0 < t) {
                at += 1;
            }
            let first = at;
            while straddling.get(at).is_some_and(|s| s.0 == t) {
                at += 1;
            }
            if self.covered[t as usize] {
                continue;
            }
            let corners = self.original.triangles[t as usize].map(|v| self.log.representative(v));
            if corners.iter().any(|&v| self.doomed.has(v)) {
                continue;
            }
            candidates.clear();
            candidates.extend(straddling[first..at].iter().map(|s| s.1));
            if self.try_cover(t, &candidates) {
                continue;
            }
            for v in corners {
                let faces = self.certified.surface.faces_at(v);
                candidates.extend(faces.filter(|f| !straddling[first..at].iter().any(|s| s.1 == *f)));
            }
            candidates.sort_unstable();
            candidates.dedup();
            candidates.truncate(64);
            if !self.try_cover(t, &candidates) {
                self.bad_triangles.push(t);
            }
        }
    }

    fn try_cover(&mut self, t: u32, candidates: &[u32]) -> bool {
        self.facets.clear();
        for &f in candidates {
            self.facets.extend(self.recent.facet(f, &self.certified.surface).cloned());
        }
        self.facets.truncate(64);
        let corners = self.original.corners(t);
        let Some(cover) = self.coverer.cover(corners, &self.facets, self.tolerance_sq) else {
            return false;
        };
        self.covered[t as usize] = true;
        for (i, (f, _)) in self.facets.iter().enumerate() {
            if cover.facets & 1 << i != 0 {
                self.certified.claims.add(t, *f);
                let reach = &mut self.certified.reach_sq[*f as usize];
                *reach = reach.max(cover.reach_sq);
            }
        }
        true
    }

    /// Vertices where taking back contractions in another order than they were made left more faces at an edge than the
    /// original has anywhere, or two faces with the same corners.
    fn tangled(&self) -> Vec<u32> {
        let mut sides: Vec<(u64, u32)> = Vec::new();
        let surface = &self.certified.surface;
        for (f, &c) in surface.faces.iter().enumerate().filter(|(_, c)| c[0] != NONE) {
            for i in 0..3 {
                // Where the original is not a manifold, the result need not be one.
                if self.original.neighbours[f][i] != NONE {
                    sides.push((u64::from(c[i]) << 32 | u64::from(c[(i + 1) % 3]), f as u32));
                }
            }
        }
        sides.sort_unstable();
        let mut guilty = Vec::new();
        for same in sides.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 1) {
            guilty.extend(same.iter().flat_map(|s| surface.faces[s.1 as usize]));
        }
        guilty
    }

    fn take_back(&mut self, v: u32, rounds: u32, taken_back: &mut Vec<u32>) {
        let mut free = vec![v];
        for _ in 0..rounds {
            // The one with the most contractions left, so that halves fall apart evenly.
            let Some(i) = (0..free.len())
                .filter(|&i| !self.log.is_single(free[i]))
                .max_by_key(|&i| self.log.members_of(free[i]))
            else {
                break;
            };
            let parted = self.log.take_back(free[i], &mut self.certified.surface.points);
            free.extend(parted);
        }
        taken_back.extend(free);
    }

    /// Rebuilds the surface after taking back; returns the faces that changed.
    fn rebuild(&mut self, moved: &[u32]) -> Vec<u32> {
        let mut is_moved = vec![false; self.original.points.len()];
        for &v in moved {
            is_moved[v as usize] = true;
        }
        let representatives: Vec<u32> =
            (0..self.original.points.len() as u32).map(|v| self.log.representative(v)).collect();
        let mut changed = Vec::new();
        let CertifiedSurface { surface, claims, .. } = &mut self.certified;
        for (f, triangle) in self.original.triangles.iter().enumerate() {
            let old = surface.faces[f];
            let mut new = triangle.map(|v| representatives[v as usize]);
            if new[0] == new[1] || new[1] == new[2] || new[2] == new[0] {
                new = [NONE; 3];
            }
            if new[0] == NONE && old[0] == NONE {
                continue;
            }
            if new != old || new.iter().any(|&v| v != NONE && is_moved[v as usize]) {
                surface.faces[f] = new;
                changed.push(f as u32);
                let freed: Vec<u32> = claims.triangles_of(f as u32).collect();
                for t in freed {
                    self.covered[t as usize] = false;
                    claims.release(t);
                }
                claims.clear_face(f as u32);
            }
        }
        surface.relink();
        changed
    }
}
