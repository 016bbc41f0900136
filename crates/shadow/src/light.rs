//! Lights, and the space in which their rays are parallel to an axis.

use crate::ShadowError;
use farsight_geometry::Plane;
use glam::{DVec2, DVec3, DVec4};

/// A light that a single map can serve.
///
/// A point light needs up to six of them: see [`PointFocus`](crate::PointFocus).
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum ShadowLight {
    /// Parallel light.
    Directional {
        /// Unit direction of travel.
        direction: DVec3,
    },
    /// Light from a point through a pyramid (cube face) or cone around an axis.
    Spot {
        /// Where it is, in the world.
        position: DVec3,
        /// Unit direction of the axis.
        direction: DVec3,
        /// Tangent of half the opening angle.
        tangent: f64,
        /// Whether the opening is round; otherwise it is a square across `side`.
        round: bool,
        /// Direction across the axis that a square's sides follow.
        side: DVec3,
        /// Distance along the axis before which nothing is covered; positive.
        near: f64,
        /// Distance along the axis beyond which nothing is lit; may be infinite.
        range: f64,
    },
}

/// Faces of the cube around a point light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CubeFace {
    /// Towards +x.
    PosX,
    /// Towards −x.
    NegX,
    /// Towards +y.
    PosY,
    /// Towards −y.
    NegY,
    /// Towards +z.
    PosZ,
    /// Towards −z.
    NegZ,
}

impl CubeFace {
    /// All six, in the order of cube maps.
    pub const ALL: [Self; 6] = [Self::PosX, Self::NegX, Self::PosY, Self::NegY, Self::PosZ, Self::NegZ];

    /// Unit direction of the face.
    pub fn direction(self) -> DVec3 {
        match self {
            Self::PosX => DVec3::X,
            Self::NegX => DVec3::NEG_X,
            Self::PosY => DVec3::Y,
            Self::NegY => DVec3::NEG_Y,
            Self::PosZ => DVec3::Z,
            Self::NegZ => DVec3::NEG_Z,
        }
    }
}

impl ShadowLight {
    /// Parallel light that travels in the unit direction `direction`.
    pub fn directional(direction: DVec3) -> Self {
        Self::Directional { direction }
    }

    /// A cone of half angle `half_angle` (radians, below π/2) from `position` around the unit direction `direction`.
    pub fn spot(position: DVec3, direction: DVec3, half_angle: f64, near: f64, range: f64) -> Self {
        let side = frame_of(direction);
        Self::Spot { position, direction, tangent: half_angle.tan(), round: true, side, near, range }
    }

    /// The pyramid of a cube face, wider by `margin` (a share of its half width) for filters that look across its border.
    pub fn cube_face(position: DVec3, face: CubeFace, margin: f64, near: f64, range: f64) -> Self {
        let direction = face.direction();
        let side = DVec3::new(direction.y, direction.z, direction.x).abs();
        Self::Spot { position, direction, tangent: 1.0 + margin, round: false, side, near, range }
    }

    pub(crate) fn check(&self) -> Result<(), ShadowError> {
        let direction = self.direction();
        if !(direction.is_finite() && (direction.length() - 1.0).abs() < 1e-5) {
            return Err(ShadowError::Direction { direction });
        }
        let Self::Spot { position, tangent, side, near, range, .. } = *self else { return Ok(()) };
        if !(position.is_finite() && position.abs().max_element() <= MAX_COORDINATE) {
            return Err(ShadowError::Position { position });
        }
        // Beyond 89.9° a map would be nearly all border.
        if !(tangent > 0.0 && tangent <= 600.0) {
            return Err(ShadowError::Opening { tangent });
        }
        if !(near > 0.0 && near < range && near.is_finite()) {
            return Err(ShadowError::LightRange { near, range });
        }
        let across = side - direction * side.dot(direction);
        if !(side.is_finite() && across.length() > 1e-6) {
            return Err(ShadowError::Direction { direction: side });
        }
        Ok(())
    }

    pub(crate) fn direction(&self) -> DVec3 {
        match *self {
            Self::Directional { direction } | Self::Spot { direction, .. } => direction,
        }
    }

    /// Planes around what the light reaches, relative to `origin`, inside positive.
    pub(crate) fn planes(&self, origin: DVec3, out: &mut Vec<Plane>) {
        out.clear();
        let Self::Spot { position, direction, tangent, round, side, near, range } = *self else { return };
        let axis = direction.normalize();
        let at = position - origin;
        out.push(Plane::through(at + axis * near, axis));
        if range.is_finite() {
            out.push(Plane::through(at + axis * range, -axis));
        }
        let u = (side - axis * side.dot(axis)).normalize();
        let v = axis.cross(u);
        // A cone is cut down to an octagon around it, a cube face to its four sides.
        let (count, step) =
            if round { (8, std::f64::consts::FRAC_PI_4) } else { (4, std::f64::consts::FRAC_PI_2) };
        for i in 0..count {
            let (sin, cos) = (step * f64::from(i)).sin_cos();
            let outward = u * cos + v * sin;
            out.push(Plane::through(at, (axis * tangent - outward).normalize()));
        }
    }
}

/// Largest coordinate that is accepted, in world units.
pub(crate) const MAX_COORDINATE: f64 = 1e15;

/// Axes of light space: `y` points against the light, `z` along the warp, `x` completes a right-handed frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightAxes {
    /// Across.
    pub x: DVec3,
    /// Against the light (a spot's axis).
    pub y: DVec3,
    /// Along the warp: away from the viewer where `from_view`.
    pub z: DVec3,
    /// Whether `z` follows the view; otherwise it depends on the light alone.
    pub from_view: bool,
}

/// Sine of the angle between view and light from which on the axes follow the view.
const FOLLOW_FROM: f64 = 0.02;
/// Sine below which they stop following it.
const FOLLOW_UNTIL: f64 = 0.01;

impl LightAxes {
    /// Axes for light that travels in the unit direction `light`, seen by a camera that looks in the unit direction `view`.
    ///
    /// The warp needs `z` to follow the view. When view and light are nearly parallel that direction would spin (by 1/sin γ
    /// of any turn), and the axes then depend on the light alone. `followed` says what the previous frame did: between the
    /// two thresholds it is kept.
    pub fn new(light: DVec3, view: DVec3, followed: bool) -> Self {
        let across = view - light * view.dot(light);
        Self::along(light, across, followed)
    }

    /// Axes for a spot light: `z` is the direction in which the image, seen from the light, of `point` (relative to the light)
    /// moves when the point moves along `view`.
    pub(crate) fn of_spot(light: DVec3, view: DVec3, point: DVec3, followed: bool) -> Self {
        let ahead = point.dot(light);
        let aside = point - light * ahead;
        let across = view - light * view.dot(light);
        let moved = (across * ahead - aside * view.dot(light)) / point.length().max(f64::MIN_POSITIVE);
        Self::along(light, moved, followed)
    }

    /// Axes that depend on the light alone.
    pub fn of_light(light: DVec3) -> Self {
        Self::along(light, DVec3::ZERO, false)
    }

    fn along(light: DVec3, across: DVec3, followed: bool) -> Self {
        let y = -light;
        let sin = across.length();
        let from_view = sin >= if followed { FOLLOW_UNTIL } else { FOLLOW_FROM };
        // Projecting twice removes what rounding left along the light.
        let z = if from_view { (across - light * across.dot(light)).normalize() } else { frame_of(y) };
        Self { x: y.cross(z), y, z, from_view }
    }
}

/// A unit vector across `n` that varies continuously with it, but for one direction that no light is likely to have.
pub(crate) fn frame_of(n: DVec3) -> DVec3 {
    // A light shining up from this side; a frame on the whole sphere must break somewhere (hairy ball theorem).
    const POLE: DVec3 = DVec3::new(-0.36, -0.48, -0.8);
    const ACROSS: DVec3 = DVec3::new(0.8, -0.6, 0.0);
    // Rotating −POLE onto n along the great circle carries ACROSS to a vector across n.
    let from = -POLE;
    let c = from.dot(n);
    let axis = from.cross(n);
    if c <= -1.0 + 1e-12 {
        return ACROSS;
    }
    let rotated = ACROSS * c + axis.cross(ACROSS) + axis * (axis.dot(ACROSS) / (1.0 + c));
    (rotated - n * rotated.dot(n)).normalize()
}

/// Linear forms (x, y, z, h) on points relative to the eye. In x/h and z/h a light ray is one point; y/h grows towards
/// the light. Parallel light: h = 1. A light at a point: y = 1 and h is the distance along the axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct LightSpace {
    pub x: DVec4,
    pub y: DVec4,
    pub z: DVec4,
    pub h: DVec4,
}

impl LightSpace {
    pub fn new(light: &ShadowLight, axes: &LightAxes, origin: DVec3) -> Self {
        match *light {
            ShadowLight::Directional { .. } => {
                Self { x: axes.x.extend(0.0), y: axes.y.extend(0.0), z: axes.z.extend(0.0), h: DVec4::W }
            }
            ShadowLight::Spot { position, .. } => {
                let at = position - origin;
                let form = |axis: DVec3| axis.extend(-axis.dot(at));
                Self { x: form(axes.x), y: DVec4::W, z: form(axes.z), h: form(-axes.y) }
            }
        }
    }

    /// (x, y, z)/h and h of a point relative to the eye.
    pub fn project(&self, p: DVec3) -> (DVec3, f64) {
        let p = p.extend(1.0);
        let h = self.h.dot(p);
        (DVec3::new(self.x.dot(p), self.y.dot(p), self.z.dot(p)) / h, h)
    }

    /// The plane on which `form` − `at`·h is zero, positive side kept (`sign` 1) or dropped (−1), moved out by `grain`.
    pub fn plane(&self, form: DVec4, at: f64, sign: f64, grain: f64) -> Plane {
        let row = (form - self.h * at) * sign;
        let length = row.truncate().length().max(f64::MIN_POSITIVE);
        Plane { normal: row.truncate() / length, offset: row.w / length + grain }
    }
}

/// Two-dimensional position of a projected point in the map's plane.
pub(crate) fn in_plane(q: DVec3) -> DVec2 {
    DVec2::new(q.x, q.z)
}
