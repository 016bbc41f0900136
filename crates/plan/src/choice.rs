//! What is decided, what may be chosen, and why.

use crate::summary::Form;
use farsight_geometry::Millis;
use farsight_geometry::accuracy::ErrorBound;
use std::fmt;

/// What a decision is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Effect {
    /// The shadows of a light.
    Shadow {
        /// Its place in the scene's list.
        light: u32,
    },
    /// Leaving out what is hidden.
    Occlusion,
    /// The points of a cloud.
    Cloud {
        /// Its place in the scene's list.
        cloud: u32,
    },
    /// Keeping frames within their time while they are drawn.
    FrameRate,
    /// The form of an object.
    Object {
        /// Its place in the scene's list.
        object: u32,
    },
}

/// What was chosen for an [`Effect`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Choice {
    /// Not done at all. Many small objects side by side add up to more than the error of each: hand them over as one.
    Nothing,
    /// The shadow map of an earlier frame.
    Reuse,
    /// A shadow map, drawn now.
    Map {
        /// How it lays out its texels.
        layout: Layout,
        /// Side of each map in texels.
        side: u32,
        /// Samples a pixel; one gives hard shadows.
        taps: u32,
        /// Pixels that a caster's surface may be off, as its shadow shows.
        caster_px: f64,
    },
    /// Sets of visible objects computed beforehand.
    Cells,
    /// Occlusion queries.
    Queries,
    /// Queries for what the sets leave.
    CellsAndQueries,
    /// As many points of a cloud as an error takes.
    Points {
        /// Pixels from any point to a drawn one.
        error_px: f64,
        /// Points to draw.
        points: f64,
    },
    /// Estimates are corrected and levels lowered while frames are drawn.
    Control,
    /// The object as it is.
    Full,
    /// A coarser form of it.
    Detail {
        /// Its place in the object's list.
        detail: u32,
        /// What it is made of.
        form: Form,
    },
    /// A picture of it, drawn anew when it is off by more than this.
    Impostor {
        /// Allowed error in pixels.
        error_px: f64,
    },
}

/// How a shadow map lays out its texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Layout {
    /// Evenly over what it covers.
    Uniform,
    /// More of them near the eye.
    Warped,
    /// Several maps, one behind the other.
    Cascades(u32),
}

/// How sure it is that nothing is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Class {
    /// It would contribute nothing: leaving it out changes no pixel.
    Void,
    /// Something cheaper is within the tolerances.
    Dominated,
    /// Time is short.
    Budgeted,
    /// It is worth its time.
    Kept,
}

/// Which comparison decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Rule {
    /// Not in the view volume.
    OutOfView,
    /// Nothing that this light shines on is in view: pixels against none.
    NoReceiver,
    /// Nothing throws a shadow into the view: triangles against none.
    NoCaster,
    /// No pass reads the result.
    NobodyReads,
    /// Light, casters and view stand still.
    Unchanged,
    /// The whole light shows less than the tolerance for areas.
    TooDim,
    /// Error against tolerance, in tolerances.
    Tolerance,
    /// Costs against costs of what was chosen, in milliseconds.
    Dearer,
    /// What is missed of the object where it is left out, in tolerances: of one smaller than a pixel the area, of others all of the size.
    TooSmall,
    /// Pixels to shade against pixels of the image: nothing hides anything.
    NothingHidden,
    /// Objects in view against those that are worth asking.
    FewObjects,
    /// Time saved against time spent, in milliseconds, as measured.
    Saves,
    /// Frames since it was last tried against those to wait.
    Probe,
    /// The eye is in a region whose visible objects are known: what their set may miss, in tolerances, against what is allowed.
    InCell,
    /// Predicted time against the limit, in milliseconds.
    Limit,
    /// There is no limit to keep.
    NoLimit,
    /// How much finer the warp makes the worst texel, against what is worth a moving map.
    Gain,
    /// Only this can be had.
    OnlyOne,
}

/// Why something was chosen, or not.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Reason {
    /// How sure it is that nothing is lost.
    pub class: Class,
    /// Which comparison decided.
    pub rule: Rule,
    /// What was compared.
    pub value: f64,
    /// With what.
    pub limit: f64,
}

impl Reason {
    pub(crate) fn new(class: Class, rule: Rule, value: f64, limit: f64) -> Self {
        Self { class, rule, value, limit }
    }
}

/// An effect, what was chosen for it, and why.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Decision {
    /// What it is about.
    pub effect: Effect,
    /// What was chosen.
    pub choice: Choice,
    /// Why.
    pub because: Reason,
    /// What it takes, by the cost model; negative for what saves more than it costs.
    pub cost: Millis,
    /// By how much the result may be off.
    pub error: ErrorBound,
    /// The same in tolerances: up to one is within them.
    pub strain: f64,
    pub(crate) rejected: (u32, u32),
}

/// What was not chosen, and why.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Rejected {
    /// The alternative.
    pub choice: Choice,
    /// What was against it.
    pub because: Reason,
}

impl fmt::Display for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Effect::Shadow { light } => write!(f, "shadow of light {light}"),
            Effect::Occlusion => f.write_str("occlusion"),
            Effect::Cloud { cloud } => write!(f, "cloud {cloud}"),
            Effect::FrameRate => f.write_str("frame rate"),
            Effect::Object { object } => write!(f, "object {object}"),
        }
    }
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Choice::Nothing => f.write_str("nothing"),
            Choice::Reuse => f.write_str("the last map"),
            Choice::Map { layout, side, taps, .. } => {
                let soft = if *taps > 1 { format!("soft, {taps} samples") } else { "hard".into() };
                write!(f, "{layout} {side}², {soft}")
            }
            Choice::Cells => f.write_str("visible sets"),
            Choice::Queries => f.write_str("queries"),
            Choice::CellsAndQueries => f.write_str("visible sets, then queries"),
            Choice::Points { error_px, points } => write!(f, "{points:.0} points for {error_px:.3} px"),
            Choice::Control => f.write_str("control"),
            Choice::Full => f.write_str("all of it"),
            Choice::Detail { detail, form } => write!(f, "{form} {detail}"),
            Choice::Impostor { error_px } => write!(f, "impostor to {error_px:.3} px"),
        }
    }
}

impl fmt::Display for Form {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Form::Mesh => "mesh",
            Form::Cut => "cut",
            Form::Points => "points",
        })
    }
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Layout::Uniform => f.write_str("uniform"),
            Layout::Warped => f.write_str("warped"),
            Layout::Cascades(n) => write!(f, "{n} ×"),
        }
    }
}

impl fmt::Display for Class {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Class::Void => "void",
            Class::Dominated => "dominated",
            Class::Budgeted => "budgeted",
            Class::Kept => "kept",
        })
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (value, limit) = (Short(self.value), Short(self.limit));
        match self.rule {
            Rule::OutOfView => f.write_str("out of view"),
            Rule::NoReceiver => f.write_str("nothing that it lights is in view"),
            Rule::NoCaster => f.write_str("nothing throws a shadow into the view"),
            Rule::NobodyReads => f.write_str("nobody reads it"),
            Rule::Unchanged => f.write_str("light, casters and view stand still"),
            Rule::TooDim => write!(f, "adds {value} of the display's range, {limit} go unseen"),
            Rule::Tolerance => write!(f, "error of {value} tolerances, {limit} allowed"),
            Rule::Dearer => write!(f, "{value} ms against {limit} ms"),
            Rule::TooSmall => write!(f, "leaving it out is an error of {value} tolerances, {limit} allowed"),
            Rule::NothingHidden => write!(f, "{value} pixels to shade in an image of {limit}"),
            Rule::FewObjects => write!(f, "{value} objects in view, worth asking from {limit}"),
            Rule::Saves => write!(f, "saves {value} ms for {limit} ms"),
            Rule::Probe => write!(f, "tried again after {value} of {limit} frames"),
            Rule::InCell => write!(
                f,
                "the eye is in a region whose set misses {value} tolerances at most, {limit} allowed"
            ),
            Rule::Limit => write!(f, "{value} ms predicted, limit {limit} ms"),
            Rule::NoLimit => f.write_str("no limit to keep"),
            Rule::Gain => write!(f, "gains {value}×, worth it from {limit}×"),
            Rule::OnlyOne => f.write_str("no alternative"),
        }
    }
}

impl fmt::Display for Decision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { effect, choice, because, cost, error, .. } = self;
        let (value, cost) = (Short(error.value), Short(cost.0));
        write!(f, "{effect}: {choice} ({}: {because}); {cost} ms", because.class)?;
        if error.value > 0.0 { write!(f, ", off by {value} {} ({})", error.unit, error.kind) } else { Ok(()) }
    }
}

/// A number with three digits that mean something.
struct Short(f64);

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let x = self.0;
        if !x.is_finite() || x == 0.0 {
            return write!(f, "{x}");
        }
        let decimals = (2.0 - x.abs().log10().floor()).clamp(0.0, 9.0) as usize;
        write!(f, "{x:.decimals$}")
    }
}
