//! Simplification with an error bound that holds.

use crate::HlodError;
use crate::certify::{CertifiedSurface, certify_all};
use crate::contract::Contractor;
use crate::complex::Complex;
use crate::fast::{FastLimits, Log, contract_fast};
use crate::frame::{Frame, SLACK, resolution};
use crate::original::{NONE, Original};
use farsight_geometry::accuracy::{Cost, Counters, ErrorBound, Unit};
use farsight_geometry::TriangleMesh;
use glam::DVec3;
use std::time::Instant;

/// How much work the bound is worth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Tier {
    /// Every contraction is certified: the fewest triangles for the tolerance.
    #[default]
    Guaranteed,
    /// Quick contractions, then the whole is certified and mended where it fails.
    Verified,
    /// Quick contractions; the bound that they happen to have is found afterwards and may exceed the tolerance.
    Fast,
}

/// What to do besides staying within the tolerance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct SimplifyOptions {
    /// How much work the bound is worth.
    pub tier: Tier,
}

impl SimplifyOptions {
    /// The options with another tier.
    #[must_use]
    pub fn with_tier(self, tier: Tier) -> Self {
        Self { tier }
    }
}

/// A simplified surface and what is known of it.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Simplified {
    /// The surface, in the coordinates (and with the origin) of the input.
    pub mesh: TriangleMesh,
    /// Two-sided Hausdorff distance to the input, at most the tolerance.
    pub geometric: ErrorBound,
    /// What it took.
    pub cost: Cost,
}

/// Simplifies `mesh` until no more triangles can go without a point of either surface being farther than `tolerance` from the other.
pub fn simplify(mesh: &TriangleMesh, tolerance: f64, options: &SimplifyOptions) -> Result<Simplified, HlodError> {
    let start = Instant::now();
    if !(tolerance >= 0.0 && tolerance.is_finite()) {
        return Err(HlodError::Tolerance { tolerance });
    }
    let resolution = resolution(mesh);
    let frame = Frame::of(mesh);
    let inner = frame.length_in(tolerance) - SLACK;
    let smallest = resolution.max(frame.length_out(10.0 * SLACK));
    if !mesh.is_empty() && tolerance < smallest {
        return Err(HlodError::BelowResolution { tolerance, resolution: smallest });
    }
    let original = Original::new(mesh, &frame);
    let mut counters = Counters::new();
    counters.add("triangles", mesh.triangles().len() as u64);
    let mut locked = vec![false; original.points.len()];
    original.lines.iter().flatten().for_each(|&v| locked[v as usize] = true);
    let mut s = Complex::new(original.points.clone(), original.triangles.clone());
    let t0 = Instant::now();
    let limits = match options.tier {
        Tier::Guaranteed => FastLimits { rms: 0.5 * inner, members: 16 },
        Tier::Verified | Tier::Fast => FastLimits { rms: 0.7 * inner, members: u32::MAX },
    };
    let mut log = contract_fast(&original, &mut s, &locked, limits);
    for p in &mut s.points {
        *p = frame.snap(*p);
    }
    let t1 = Instant::now();
    let fast_live = s.live;
    let (mut state, counts) = certify_all(&original, s, &mut log, inner * inner);
    let t2 = Instant::now();
    let cert_live = state.surface.live;
    counters.add("rounds", counts.rounds);
    counters.add("taken back", counts.taken_back);
    counters.add("visits", counts.visits);
    counters.add("pieces", counts.pieces);
    if options.tier == Tier::Guaranteed {
        let contractor = Contractor::new(&original, &frame, state, &locked, inner * inner);
        let (done, counts) = contractor.run();
        state = done;
        counters.add("attempts", counts.attempts);
        counters.add("contractions", counts.contractions);
        counters.add("visits", counts.visits);
        counters.add("pieces", counts.pieces);
        counters.add("quick failures", counts.quick_failures);
    }
    if std::env::var("HLOD_TIMES").is_ok() {
        eprintln!("   prep {:?} fast {:?} -> {fast_live}, certify {:?} -> {cert_live}, contract {:?}", t0 - start, t1 - t0, t2 - t1, t2.elapsed());
    }
    let reach = state.reach_sq.iter().zip(&state.surface.faces).filter(|(_, f)| f[0] != NONE).map(|(r, _)| *r).fold(0.0, f64::max).sqrt();
    let out = output(mesh, &frame, &original, &state)?;
    let value = frame.length_out(reach + SLACK).min(tolerance);
    let cost = Cost { time: start.elapsed(), bytes: out.bytes(), counters };
    Ok(Simplified { mesh: out, geometric: ErrorBound::proven(value, Unit::Metres), cost })
}

fn output(mesh: &TriangleMesh, frame: &Frame, original: &Original, state: &CertifiedSurface) -> Result<TriangleMesh, HlodError> {
    let mut id = vec![NONE; original.points.len()];
    let mut positions = Vec::new();
    let mut number = |v: u32| {
        if id[v as usize] == NONE {
            id[v as usize] = positions.len() as u32;
            positions.push(frame.leave(state.surface.points[v as usize]));
        }
        id[v as usize]
    };
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for f in state.surface.faces.iter().filter(|f| f[0] != NONE) {
        triangles.push(f.map(&mut number));
    }
    for l in &original.lines {
        triangles.push(l.map(&mut number));
    }
    Ok(TriangleMesh::new(positions, triangles)?.with_origin(mesh.origin())?)
}

#[allow(unused)]
const _: (fn(usize) -> Log, DVec3) = (Log::new, DVec3::ZERO);
