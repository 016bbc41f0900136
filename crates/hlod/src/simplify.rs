//! Simplification with an error bound that holds.

use crate::HlodError;
use crate::appearance::{Appearance, Gathering};
use crate::certify::{Bad, CertifiedSurface, certify_all, certify_some};
use crate::complex::Complex;
use crate::contract::{Contractor, Pairs};
use crate::fast::{FastLimits, Log, contract_fast};
use crate::frame::{Frame, SLACK, resolution};
use crate::measure::Measure;
use crate::original::{NONE, Original};
use crate::roles::{Roles, Walls};
use farsight_geometry::TriangleMesh;
use farsight_geometry::accuracy::{Cost, Counters, ErrorBound, Unit};
use farsight_geometry::distance::HausdorffOptions;
use std::time::Instant;

/// How much work the bound is worth. All tiers return a proven bound; they differ in whether it is asked for or only found out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Tier {
    /// Every contraction is certified: the fewest triangles for the tolerance.
    #[default]
    Guaranteed,
    /// Quick contractions, then the whole is certified and taken back where that fails: within the tolerance too, with more
    /// triangles.
    Verified,
    /// Quick contractions, ordered and limited by quadrics only. The bound that the result happens to have is found
    /// afterwards and may exceed the tolerance.
    Fast,
}

/// What to do besides staying within the tolerance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct SimplifyOptions {
    /// How much work the bound is worth.
    pub tier: Tier,
    /// Whether normals, texture coordinates and colours are kept, and count: the way along the surface to where an attribute belongs and
    /// the distance off the surface, added as squares, then stay within the tolerance too (by estimate). Otherwise the result has
    /// positions only, and fewer triangles.
    pub appearance: bool,
}

impl SimplifyOptions {
    /// The options with another tier.
    #[must_use]
    pub fn with_tier(self, tier: Tier) -> Self {
        Self { tier, ..self }
    }

    /// The options with attributes kept, or not.
    #[must_use]
    pub fn with_appearance(self, appearance: bool) -> Self {
        Self { appearance, ..self }
    }
}

/// A simplified surface and what is known of it.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Simplified {
    /// The surface, with the origin of the input, welded; with attributes if they were asked for. Vertices are parted where
    /// attributes have a seam.
    pub mesh: TriangleMesh,
    /// Two-sided Hausdorff distance to the input, in its units.
    pub geometric: ErrorBound,
    /// Distance along and off the surface to where an attribute belongs, at most the tolerance ([`Tier::Fast`]: may exceed it); `None` unless
    /// asked for, and without attributes.
    pub appearance: Option<ErrorBound>,
    /// Vertices of the input that were merged with another at the same position.
    pub welded: usize,
    /// Triangles of the input that repeated another and were dropped.
    pub doubled: usize,
    /// Bytes of the tables that it worked on.
    pub working_bytes: u64,
    /// Time, bytes of the result, and the counters `triangles` (of the input), `contractions`, `attempts`, `taken back`, `visits`
    /// (triangles that floods met) and `pieces` (that covers were made of).
    pub cost: Cost,
}

/// Root of the mean squared distance to the planes, over the tolerance, up to which quick contractions go.
///
/// Measured on a scan and a mechanical part at three tolerances: 0.3 leaves up to twice as many contractions to the slow phase, with
/// 0.7 four times as many are taken back; the triangles kept differ by a few in a hundred either way.
const QUICK_SHARE: f64 = 0.5;

/// The same where attributes count.
const QUICK_SHARE_WITH_LOOKS: f64 = 0.2;

/// Original vertices that one may stand for where attributes count.
const QUICK_MEMBERS_WITH_LOOKS: u32 = 4;

/// Way along the surface, over the tolerance, within which looks of a vertex's corners become one.
const ALIKE: f64 = 0.1;

/// Width of the interval that a bound found afterwards lies in, over the tolerance.
const MEASURE_SHARE: f64 = 0.02;

/// Halvings for that; the bound holds, and is only wider, when they run out.
const MEASURE_SPLITS: u64 = 500_000;

/// Original vertices that one vertex may stand for before contractions are certified one by one. 64 instead of 16 saves a fifth of
/// the time at coarse tolerances; more brings little and lets single failures cost more.
const QUICK_MEMBERS: u32 = 64;

/// Corners are numbered by 4 · face + corner in 32 bits, and the cover relation may need several pairs a triangle.
const MOST_TRIANGLES: usize = 1 << 28;

/// Simplifies `mesh` as long as no point of either surface gets farther than `tolerance` from the other (two-sided
/// Hausdorff distance of the surfaces, not of their vertices).
///
/// Any soup is taken: borders, T-junctions, non-manifold edges, zero-area triangles, unconnected parts. Vertices at the same position are
/// merged first. The topology of manifold parts is kept, and away from borders no triangle turns over.
///
/// ```
/// use farsight_geometry::{TriangleMesh, glam::vec3};
/// use farsight_hlod::{SimplifyOptions, simplify};
///
/// // A flat square of 200 triangles needs two.
/// let p = (0..121).map(|i| vec3((i % 11) as f32, (i / 11) as f32, 0.0)).collect();
/// let t = (0..110).filter(|i| i % 11 < 10).flat_map(|i| [[i, i + 1, i + 12], [i, i + 12, i + 11]]).collect();
/// let simple = simplify(&TriangleMesh::new(p, t)?, 0.01, &SimplifyOptions::default())?;
/// assert_eq!(simple.mesh.triangles().len(), 2);
/// assert!(simple.geometric.value <= 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Accuracy
/// `tolerance` is in the units of the mesh. The returned bound is proven, rounding included, and at most the tolerance
/// ([`Tier::Fast`]: may exceed it). It bounds the distance of the meshes as they are returned, with `f32` positions.
///
/// # Cost
/// One thread; 150 to 240 bytes a triangle for its tables. Rates and triangle counts are in the book.
///
/// # Errors
/// [`HlodError::Tolerance`] for a tolerance that is negative or not finite, [`HlodError::BelowResolution`] for one below the
/// rounding of the coordinates, [`HlodError::TooLarge`] for more than 2²⁸ triangles.
///
/// # References
/// [Guthe 2004], section 3; quadrics by [Garland & Heckbert 1997]. Differs: the distance is bounded in both directions, to the surface
/// and not to vertices, by the certificates that the book describes.
pub fn simplify(
    mesh: &TriangleMesh,
    tolerance: f64,
    options: &SimplifyOptions,
) -> Result<Simplified, HlodError> {
    simplify_between(mesh, tolerance, options, None)
}

/// [`simplify`]; rims at walls become what is made of them on the other side too, wherever that can be certified.
pub(crate) fn simplify_between(
    mesh: &TriangleMesh,
    tolerance: f64,
    options: &SimplifyOptions,
    walls: Option<&Walls>,
) -> Result<Simplified, HlodError> {
    let start = Instant::now();
    if mesh.triangles().len() > MOST_TRIANGLES {
        return Err(HlodError::TooLarge { triangles: mesh.triangles().len(), limit: MOST_TRIANGLES });
    }
    let frame = Frame::of(mesh);
    let limit = usable_tolerance(mesh, &frame, tolerance)?;
    let original = Original::new(mesh, &frame);
    let appearance = if options.appearance { Appearance::new(mesh, tolerance) } else { None };
    let appearance = appearance.map(|a| a.with_rounding(walls.map_or(0.0, |w| w.normal_rounding)));
    let appearance = appearance.as_ref();
    let mut roles = Roles::free(original.points.len());
    if let Some(walls) = walls {
        roles.add_rims(&original, mesh, appearance, walls);
    }
    original.lines.iter().flatten().for_each(|&v| roles.lock(v));
    let mut counters = Counters::new();
    counters.add("triangles", mesh.triangles().len() as u64);
    let Reduced { state, unproven, bytes } =
        reduce(&original, &frame, &roles, appearance, limit, options.tier, &mut counters);
    let simple = match appearance {
        Some(a) => output_with_looks(mesh, &frame, &original, &state, a, ALIKE * limit)?,
        None => output(mesh, &frame, &original, &state)?,
    };
    let measured = match unproven {
        Some((bad, log)) => {
            let (simple, original, frame) = (&simple, &original, &frame);
            let measure = Measure { mesh, simple, original, frame, log, tolerance };
            Some(measure.bound(&state, bad)?)
        }
        None => None,
    };
    let proven = frame.length_out(state.reach() + SLACK).next_up();
    let value = measured.map_or(proven.min(tolerance), |m| m.max(proven));
    let cost = Cost { time: start.elapsed(), bytes: simple.bytes(), counters };
    let geometric = ErrorBound::proven(value, Unit::Metres);
    let look_error = || ErrorBound::estimated(frame.length_out(state.look_error()), Unit::Metres);
    let working_bytes = (original.bytes() + bytes) as u64;
    Ok(Simplified {
        mesh: simple,
        geometric,
        appearance: appearance.map(|_| look_error()),
        welded: original.welded,
        doubled: original.doubled,
        working_bytes,
        cost,
    })
}

/// What the phases lead to.
struct Reduced {
    state: CertifiedSurface,
    /// What the fast tier could not certify, and what led to it.
    unproven: Option<(Bad, Log)>,
    bytes: usize,
}

/// The phases that the tier asks for.
fn reduce(
    original: &Original,
    frame: &Frame,
    roles: &Roles,
    appearance: Option<&Appearance>,
    limit: f64,
    tier: Tier,
    counters: &mut Counters,
) -> Reduced {
    let mut surface = Complex::new(original.points.clone(), original.triangles.clone());
    let members = if tier == Tier::Guaranteed { QUICK_MEMBERS } else { u32::MAX };
    // Planes know nothing of attributes: less is left to them.
    let limits = match appearance {
        Some(_) => FastLimits { rms: QUICK_SHARE_WITH_LOOKS * limit, members: QUICK_MEMBERS_WITH_LOOKS },
        None => FastLimits { rms: QUICK_SHARE * limit, members },
    };
    let mut log = contract_fast(original, frame, &mut surface, roles, limits);
    let limit_sq = limit * limit;
    if tier == Tier::Fast {
        let (state, counts, bad) = certify_some(original, surface, &mut log, limit_sq, appearance);
        counts.add_to(counters);
        return Reduced { bytes: state.bytes(), state, unproven: Some((bad, log)) };
    }
    let (state, counts) = certify_all(original, surface, &mut log, limit_sq, appearance);
    drop(log);
    counts.add_to(counters);
    if tier == Tier::Verified && !roles.any_rims() {
        return Reduced { bytes: state.bytes(), state, unproven: None };
    }
    let contractor = Contractor::new(original, frame, state, roles, appearance, limit_sq);
    let pairs = if tier == Tier::Verified { Pairs::Rims } else { Pairs::All };
    let (state, counts, bytes) = contractor.run(pairs);
    counts.add_to(counters);
    Reduced { state, unproven: None, bytes }
}

/// How exactly what was not certified is measured.
pub(crate) fn measuring(tolerance: f64) -> HausdorffOptions {
    HausdorffOptions::new(MEASURE_SHARE * tolerance).with_max_splits(MEASURE_SPLITS)
}

/// The tolerance in the frame, what rounding may need taken off.
pub(crate) fn usable_tolerance(mesh: &TriangleMesh, frame: &Frame, tolerance: f64) -> Result<f64, HlodError> {
    if !(tolerance >= 0.0 && tolerance.is_finite()) {
        return Err(HlodError::Tolerance { tolerance });
    }
    let resolution = resolution(mesh).max(frame.length_out(10.0 * SLACK));
    if !mesh.is_empty() && tolerance < resolution {
        return Err(HlodError::BelowResolution { tolerance, resolution });
    }
    // Nothing is gained beyond the extent, and squares stay finite.
    Ok((frame.length_in(tolerance) - SLACK).min(4.0))
}

/// The surface as a mesh: faces in the order of the curve that the original was sorted along, vertices in order of use.
fn output(
    mesh: &TriangleMesh,
    frame: &Frame,
    original: &Original,
    state: &CertifiedSurface,
) -> Result<TriangleMesh, HlodError> {
    let mut new_id = vec![NONE; original.points.len()];
    let mut positions = Vec::new();
    let mut number = |v: u32| {
        let new = &mut new_id[v as usize];
        if *new == NONE {
            *new = positions.len() as u32;
            positions.push(frame.leave(state.surface.points[v as usize]));
        }
        *new
    };
    let faces = state.surface.faces.iter().filter(|f| f[0] != NONE);
    let triangles = faces.chain(&original.lines).map(|f| f.map(&mut number)).collect();
    Ok(TriangleMesh::new(positions, triangles)?.with_origin(mesh.origin())?)
}

/// [`output`] with attributes.
fn output_with_looks(
    mesh: &TriangleMesh,
    frame: &Frame,
    original: &Original,
    state: &CertifiedSurface,
    appearance: &Appearance,
    tolerance: f64,
) -> Result<TriangleMesh, HlodError> {
    let mut gathering = Gathering::new(original.points.len());
    let mut triangles = Vec::with_capacity(state.surface.live);
    for (f, corners) in state.surface.faces.iter().enumerate().filter(|(_, c)| c[0] != NONE) {
        let points = state.surface.corners(f as u32);
        triangles.push(gathering.face(frame, *corners, points, &state.looks[f], tolerance));
    }
    for line in &original.lines {
        let points = line.map(|v| original.points[v as usize]);
        let looks = line.map(|v| appearance.vertex(original.vertex[v as usize]));
        triangles.push(gathering.face(frame, *line, points, &looks, tolerance));
    }
    Ok(gathering.mesh(triangles, mesh)?)
}
