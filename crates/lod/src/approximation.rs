//! What may stand for an object, how wrong that may be, and how wrong it is.

use crate::angle::growth;
use crate::placement::SAME_STRETCH;
use crate::{DecisionOptions, ImpostorOptions, ImpostorView, Kind, LodError, Placement, Tolerance};
use farsight_geometry::accuracy::{ErrorBound, Unit};
use farsight_geometry::{Camera, DAabb};
use glam::{DMat3, DVec3};

/// When a picture is too old.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParallaxTest {
    /// When points may be seen this many pixels from where they are: proven.
    Pixels(f64),
    /// When a corner of the object's box sees both eyes under this angle, in radians: the paper's test. Bounds nothing (see [`corner_angle`](crate::corner_angle)).
    Corners(f64),
}

/// What approximations may get wrong, and when they are made.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ApproximationOptions {
    /// Displacement of triangles in pixels, for the eye that they are made for.
    pub tolerance_px: f64,
    /// Triangles serve while that grows by no more than this factor for another eye...
    pub growth: f64,
    /// ...and does not shrink by more than this one: then fewer triangles would do.
    pub excess: f64,
    /// Pictures serve while this test holds...
    pub parallax: ParallaxTest,
    /// ...their texels are at most this many times as large as asked for...
    pub magnification: f64,
    /// ...and not smaller than asked for by more than this factor: then a smaller picture would do.
    pub minification: f64,
    /// How pictures are made.
    pub impostor: ImpostorOptions,
    /// When pictures are chosen.
    pub decision: DecisionOptions,
    /// Frames between two considerations of a picture while triangles still serve.
    pub reconsider: u32,
}

impl Default for ApproximationOptions {
    /// A pixel of displacement that may grow by a quarter, a pixel of parallax, texels a quarter too large at most.
    fn default() -> Self {
        Self {
            tolerance_px: 1.0,
            growth: 1.25,
            excess: 2.0,
            parallax: ParallaxTest::Pixels(1.0),
            magnification: 1.25,
            minification: 2.0,
            impostor: ImpostorOptions::default(),
            decision: DecisionOptions::default(),
            reconsider: 8,
        }
    }
}

/// What stands for an object.
#[derive(Clone, Debug, PartialEq)]
// Pictures and lists of triangles are far larger than either.
#[allow(clippy::large_enum_variant)]
pub enum Approximation<I> {
    /// Triangles of the mesh's vertices.
    Geometry {
        /// Corners. None when the whole object is within the tolerance of one vertex ([`Cut::point`](crate::Cut::point)).
        triangles: Vec<[u32; 3]>,
        /// The eye they were made for, in the rigid frame.
        eye: DVec3,
        /// What the object was stretched by.
        stretch: DMat3,
        /// Largest displacement, as a share of the distance from that eye.
        share: f64,
    },
    /// A picture.
    Impostor {
        /// Where it is and what it shows.
        view: ImpostorView,
        /// The picture, or the engine's handle of it.
        image: I,
        /// Displacement of the triangles in it, as a share of the distance from its eye.
        share: f64,
        /// How many triangles it shows.
        triangles: usize,
    },
}

impl<I> Approximation<I> {
    /// What it is.
    pub fn kind(&self) -> Kind {
        match self {
            Self::Geometry { .. } => Kind::Geometry,
            Self::Impostor { .. } => Kind::Impostor,
        }
    }

    /// The eye it was made for, in the rigid frame.
    pub fn eye(&self) -> DVec3 {
        match self {
            Self::Geometry { eye, .. } => *eye,
            Self::Impostor { view, .. } => view.eye(),
        }
    }

    /// Whether the object is still stretched as it was when this was made.
    pub(crate) fn is_of(&self, placement: &Placement) -> bool {
        match self {
            Self::Geometry { stretch, .. } => placement.is_stretched_by(stretch),
            Self::Impostor { view, .. } => view.is_of(placement),
        }
    }

    /// How far, in pixels of the camera's image, a shown point may be from where it belongs: displacement and, for a picture, parallax. Texels are not counted;
    /// see [`ImpostorView::texel_px`]. Infinite for an object that has been stretched otherwise since.
    pub fn error_px(&self, bounds: &DAabb, placement: &Placement, camera: &Camera) -> ErrorBound {
        let eye = placement.to_rigid(camera.eye());
        let (made_for, share, parallax) = match self {
            Self::Geometry { eye, share, .. } => (*eye, *share, ErrorBound::proven(0.0, Unit::Pixels)),
            Self::Impostor { view, share, .. } => (view.eye(), *share, view.parallax(placement, camera)),
        };
        if !self.is_of(placement) {
            return ErrorBound::proven(f64::INFINITY, Unit::Pixels);
        }
        let share = share * growth(bounds, made_for, eye) * SAME_STRETCH;
        let moved = ErrorBound::proven(Tolerance::displacement_px(share, camera), Unit::Pixels);
        moved.plus(parallax).unwrap_or(moved)
    }
}

impl ApproximationOptions {
    pub(crate) fn check(&self) -> Result<(), LodError> {
        let (limit, name) = match self.parallax {
            ParallaxTest::Pixels(px) => (px, "parallax px"),
            ParallaxTest::Corners(angle) => (angle, "parallax angle"),
        };
        let positive = ("tolerance_px", self.tolerance_px, f64::MIN_POSITIVE, "above 0 and finite");
        let factor = |option, value| (option, value, 1.0, "at least 1 and finite");
        let least = [
            positive,
            factor("growth", self.growth),
            factor("excess", self.excess),
            // A limit on what turns may be zero.
            (name, limit, 0.0, "at least 0 and finite"),
            factor("magnification", self.magnification),
            factor("minification", self.minification),
        ];
        for (option, value, least, range) in least {
            if !(value.is_finite() && value >= least) {
                return Err(LodError::Option { option, value, range });
            }
        }
        let margin = self.decision.margin;
        if !(0.0..1.0).contains(&margin) {
            return Err(LodError::Option { option: "margin", value: margin, range: "0 to below 1" });
        }
        self.impostor.check()
    }
}
