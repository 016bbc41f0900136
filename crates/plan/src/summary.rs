//! What the planner is told: plain numbers of the scene and of the view.

use crate::PlanError;
use farsight_geometry::Millis;
use farsight_geometry::accuracy::Kind;

/// What stays from frame to frame. Objects, lights and clouds are known by their places in these lists.
#[derive(Clone, Copy, Debug, Default)]
pub struct SceneSummary<'a> {
    /// Everything that is drawn as a whole or not at all.
    pub objects: &'a [ObjectSummary<'a>],
    /// Lights that may throw shadows.
    pub lights: &'a [LightSummary],
    /// Point clouds that come in any number of points.
    pub clouds: &'a [CloudSummary],
}

/// An object and the forms that it can be drawn in.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectSummary<'a> {
    /// Draw calls of the whole.
    pub draws: f64,
    /// Vertices of the whole.
    pub vertices: f64,
    /// Triangles of the whole.
    pub triangles: f64,
    /// Coarser forms, the finest first: errors must not fall, elements must not rise. May be shared among instances.
    pub details: &'a [Detail],
    /// Whether an impostor may stand for it.
    pub impostor: bool,
}

/// A coarser form of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detail {
    /// What it is made of.
    pub form: Form,
    /// How far it is off, in world units.
    pub error: f64,
    /// What stands behind `error`.
    pub kind: Kind,
    /// Triangles, or points.
    pub elements: f64,
}

/// What a [`Detail`] is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Form {
    /// A simplified mesh, or nodes of a hierarchy of them.
    Mesh,
    /// A cut through a vertex hierarchy.
    Cut,
    /// Points.
    Points,
}

/// What a light can be given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSummary {
    /// Largest side of a shadow map, in texels.
    pub most_side: u32,
    /// Most cascades, 1 for none.
    pub most_cascades: u32,
    /// Most samples a pixel for a soft shadow; 0 where only hard ones can be drawn.
    pub most_taps: u32,
}

/// A point cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudSummary {
    /// Points of the whole.
    pub points: f64,
}

/// What this frame's view makes of the scene; lists run along those of the [`SceneSummary`].
#[derive(Clone, Copy, Debug)]
pub struct ViewSummary<'a> {
    /// Pixels of the image.
    pub pixels: f64,
    /// What is made of the image.
    pub outputs: Outputs,
    /// The objects as the view has them.
    pub objects: &'a [ObjectView],
    /// The lights as the view has them.
    pub lights: &'a [LightView],
    /// The clouds as the view has them.
    pub clouds: &'a [CloudView],
    /// The region that the eye is in, if its visible objects were computed beforehand and the others stand still.
    pub cell: Option<CellView>,
    /// Whether the eye has jumped since the last frame, so that what was learned of hidden objects is worth nothing.
    pub jumped: bool,
}

/// What a frame is drawn for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Outputs {
    /// Somebody looks at the colours.
    pub colour: bool,
    /// Somebody reads the depths, as shadow and occlusion passes do.
    pub depth: bool,
}

impl Outputs {
    /// A picture: colours, depths are forgotten.
    pub const PICTURE: Self = Self { colour: true, depth: false };
    /// Depths only.
    pub const DEPTH: Self = Self { colour: false, depth: true };
}

/// An object as a view has it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectView {
    /// Whether its box meets the view volume.
    pub in_view: bool,
    /// Largest extent on the screen, in pixels, never too small.
    pub size_px: f64,
    /// Pixels to shade, hidden ones included.
    pub pixels: f64,
    /// Pixels that a world unit covers where it covers most.
    pub px_per_unit: f64,
    /// Frames for which an impostor made now would be at most one pixel off; proportional to the error allowed.
    pub impostor_frames: f64,
}

/// A light as a view has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightView {
    /// Pixels of what it may shine on in the view; zero when there is nothing.
    pub receiver_pixels: f64,
    /// Triangles of what may throw a shadow into the view; zero when nothing does.
    pub caster_triangles: f64,
    /// Draw calls of these.
    pub caster_draws: f64,
    /// Largest share of the display's range that this light adds anywhere in the view.
    pub contribution: f64,
    /// Pixels that the coarsest texel covers, by layout; proven maxima.
    pub texels: TexelSpread,
    /// Widest penumbra in the view, in pixels, never too small; zero for a light without extent.
    pub penumbra_px: f64,
    /// Whether light, casters and view stand still since its map was drawn.
    pub unchanged: bool,
}

/// Pixels that the coarsest texel of a map covers, times the map's side: divide by a side to have them in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TexelSpread {
    /// Without a warp.
    pub uniform: f64,
    /// With the best warp.
    pub warped: f64,
    /// With 2, 3 and 4 cascades, each warped as it likes best; infinity where unknown.
    pub cascades: [f64; 3],
}

/// A region whose visible objects are known, as a view has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellView {
    /// Share of pixels that show an object which is not in the set, at most; zero for exact sets.
    pub missed: f64,
    /// What stands behind `missed`.
    pub kind: Kind,
}

/// A cloud as a view has it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CloudView {
    /// Points in view that keep every point within one pixel of a drawn one; zero when nothing is in view. For other errors
    /// their number goes with the inverse square.
    pub points_at_one_px: f64,
}

/// How far results may be off before anyone minds.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Tolerances {
    /// How far a surface may appear from where it is, in pixels.
    pub position_px: f64,
    /// Pixels that a texel of a shadow map may cover.
    pub texel_px: f64,
    /// By how much a pixel may change along an edge, as a share of the display's range.
    pub edge_shade: f64,
    /// By how much whole areas may change.
    pub area_shade: f64,
}

impl Default for Tolerances {
    fn default() -> Self {
        Self { position_px: 0.5, texel_px: 1.0, edge_shade: 1.0 / 32.0, area_shade: 0.5 / 255.0 }
    }
}

impl Tolerances {
    /// All tolerances times a factor.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self {
            position_px: self.position_px * factor,
            texel_px: self.texel_px * factor,
            edge_shade: self.edge_shade * factor,
            area_shade: self.area_shade * factor,
        }
    }

    /// With another [`position_px`](Self::position_px).
    #[must_use]
    pub fn with_position_px(self, position_px: f64) -> Self {
        Self { position_px, ..self }
    }

    /// With another [`texel_px`](Self::texel_px).
    #[must_use]
    pub fn with_texel_px(self, texel_px: f64) -> Self {
        Self { texel_px, ..self }
    }
}

/// What a frame may take.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Budget {
    /// The time there is, without one as much as the tolerances ask for.
    pub limit: Option<Millis>,
    /// Tolerances that hold unless time is short.
    pub tolerances: Tolerances,
}

impl Budget {
    /// As long as it takes.
    pub fn unlimited(tolerances: Tolerances) -> Self {
        Self { limit: None, tolerances }
    }

    /// At most `limit`.
    pub fn within(limit: Millis, tolerances: Tolerances) -> Self {
        Self { limit: Some(limit), tolerances }
    }
}

/// A number that must be finite and not negative.
fn number(what: &'static str, place: usize, value: f64) -> Result<(), PlanError> {
    if value.is_finite() && value >= 0.0 { Ok(()) } else { Err(PlanError::Number { what, place, value }) }
}

/// Refuses numbers that mean nothing, so that no rule needs to think of them.
pub fn check(scene: &SceneSummary, view: &ViewSummary, budget: &Budget) -> Result<(), PlanError> {
    let lists = [
        ("objects", scene.objects.len(), view.objects.len()),
        ("lights", scene.lights.len(), view.lights.len()),
        ("clouds", scene.clouds.len(), view.clouds.len()),
    ];
    for (what, scene, view) in lists {
        if scene != view {
            return Err(PlanError::Mismatch { what, scene, view });
        }
    }
    number("pixels of the image", 0, view.pixels)?;
    number("missed", 0, view.cell.map_or(0.0, |c| c.missed))?;
    let t = budget.tolerances;
    for (what, value) in [
        ("position_px", t.position_px),
        ("texel_px", t.texel_px),
        ("edge_shade", t.edge_shade),
        ("area_shade", t.area_shade),
        ("limit", budget.limit.map_or(0.0, |l| l.0)),
    ] {
        number(what, 0, value)?;
    }
    let mut known: &[Detail] = &[];
    for (i, (o, v)) in scene.objects.iter().zip(view.objects).enumerate() {
        object(i, o, v)?;
        // Instances share their details.
        if !std::ptr::eq(known, o.details) {
            details(i, o.details)?;
            known = o.details;
        }
    }
    view.lights.iter().enumerate().try_for_each(|(i, v)| light(i, v))?;
    for (i, (cloud, seen)) in scene.clouds.iter().zip(view.clouds).enumerate() {
        number("points of a cloud", i, cloud.points)?;
        number("points_at_one_px", i, seen.points_at_one_px)?;
    }
    Ok(())
}

fn object(i: usize, o: &ObjectSummary, v: &ObjectView) -> Result<(), PlanError> {
    // One sum tells that all are fine: NaN and infinity stay in it, and a minimum finds what is negative.
    let all = [o.draws, o.vertices, o.triangles, v.size_px, v.pixels, v.px_per_unit, v.impostor_frames];
    let sum: f64 = all.iter().sum();
    let least = all.iter().copied().fold(0.0, f64::min);
    if !(sum.is_finite() && least >= 0.0) {
        let names = ["draws", "vertices", "triangles", "size_px", "pixels", "px_per_unit", "impostor_frames"];
        names.into_iter().zip(all).try_for_each(|(what, value)| number(what, i, value))?;
        return Err(PlanError::Number { what: "an object's numbers together", place: i, value: sum });
    }
    Ok(())
}

fn details(i: usize, details: &[Detail]) -> Result<(), PlanError> {
    let (mut error, mut elements) = (0.0, f64::INFINITY);
    for d in details {
        let ordered = d.error >= error && d.elements <= elements && d.elements >= 0.0 && d.error.is_finite();
        if !ordered {
            return Err(PlanError::Details { object: i });
        }
        (error, elements) = (d.error, d.elements);
    }
    Ok(())
}

fn light(i: usize, v: &LightView) -> Result<(), PlanError> {
    number("receiver_pixels", i, v.receiver_pixels)?;
    number("caster_triangles", i, v.caster_triangles)?;
    number("caster_draws", i, v.caster_draws)?;
    number("contribution", i, v.contribution)?;
    number("penumbra_px", i, v.penumbra_px)?;
    let spread = v.texels;
    // Infinite is what a layout is that cannot be had.
    for value in [spread.uniform, spread.warped].into_iter().chain(spread.cascades) {
        if value.is_nan() || value < 0.0 {
            return Err(PlanError::Number { what: "texel spread", place: i, value });
        }
    }
    Ok(())
}
