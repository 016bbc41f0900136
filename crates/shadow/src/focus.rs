//! What a shadow map has to cover: the receivers that the camera sees, seen from the light, no more.

use crate::ShadowError;
use crate::light::{LightAxes, LightSpace, MAX_COORDINATE, ShadowLight, in_plane};
use crate::skip::{self, Rays};
use farsight_geometry::{Camera, ConvexBody, DAabb, Plane, Projection};
use glam::{DVec2, DVec3};

/// Why a light needs no shadow map for a view. Nothing that is seen changes without it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Skip {
    /// The camera sees no receiver that the light reaches before the shadow distance.
    NothingSeen,
    /// No caster lies between the light and what is seen.
    NoCaster,
}

/// What is looked at, and what may throw shadows.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Scope<'a> {
    /// The eye.
    pub camera: &'a Camera,
    /// Distance from the eye beyond which no shadows are wanted. Finite, whatever the camera's far plane.
    pub shadow_far: f64,
    /// World boxes of what may be seen.
    pub receivers: &'a [DAabb],
    /// World boxes of what may throw shadows.
    pub casters: &'a [DAabb],
    /// Side of the map in texels. It sets the least extent: a texel is never finer than the grain of `f32` coordinates.
    pub map_side: u32,
    /// Cuts the covered area down to where casters are, seen from the light. What the map does not cover is then lit, and
    /// lookups outside of it must say so.
    pub lit_outside: bool,
}

impl<'a> Scope<'a> {
    /// All receivers in view are covered.
    pub fn new(
        camera: &'a Camera,
        shadow_far: f64,
        receivers: &'a [DAabb],
        casters: &'a [DAabb],
        map_side: u32,
    ) -> Self {
        Self { camera, shadow_far, receivers, casters, map_side, lit_outside: false }
    }

    /// See [`lit_outside`](Self::lit_outside).
    #[must_use]
    pub fn with_lit_outside(self) -> Self {
        Self { lit_outside: true, ..self }
    }

    pub(crate) fn check(&self) -> Result<(), ShadowError> {
        let near = self.camera.near();
        if !(self.shadow_far <= MAX_COORDINATE && self.shadow_far > near) {
            return Err(ShadowError::Far { far: self.shadow_far, near });
        }
        let eye = self.camera.eye();
        if eye.abs().max_element() > MAX_COORDINATE {
            return Err(ShadowError::Position { position: eye });
        }
        if self.map_side == 0 {
            return Err(ShadowError::MapSide);
        }
        for (what, boxes) in [("receiver", self.receivers), ("caster", self.casters)] {
            let largest = |b: &DAabb| b.min.abs().max(b.max.abs()).max_element();
            let usable = |b: &DAabb| b.is_empty() || largest(b) <= MAX_COORDINATE;
            if let Some(index) = boxes.iter().position(|b| !usable(b)) {
                return Err(ShadowError::Bounds { what, index });
            }
        }
        Ok(())
    }
}

/// A corner of the receivers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Corner {
    /// Position in light space.
    pub q: DVec3,
    /// World units per unit of light space there, over the distance ahead of the eye (1 for a parallel camera).
    pub scale: f64,
    /// Size of the terms in light space that add up to its position: what `f32` rounding is relative to.
    pub reach: f64,
}

/// What must be in a shadow map, in light space relative to the eye.
///
/// Keep it from frame to frame: its buffers are reused, and it remembers which axes it chose.
#[derive(Clone, Debug, Default)]
pub struct Focus {
    /// World position of the coordinates' origin: the eye.
    pub(crate) origin: DVec3,
    pub(crate) light: Option<ShadowLight>,
    pub(crate) axes: Option<LightAxes>,
    pub(crate) space: LightSpace,
    pub(crate) receivers: Vec<Corner>,
    /// Light space positions of the corners of casters that can matter.
    pub(crate) casters: Vec<DVec3>,
    /// Box of the receivers in light space, grown to a usable size.
    pub(crate) footprint: DAabb,
    pub(crate) inflation: f64,
    /// Stronger warps than this would be finer than `f32` coordinates.
    pub(crate) kappa_most: f64,
    /// Texels on a side times the relative grain of `f32`: extent over reach at which a texel is one step of `f32`.
    pub(crate) grain: f64,
    pub(crate) pixels_per_unit: f64,
    /// Sine of the angle between view and light.
    pub(crate) sin_gamma: f64,
    /// Centre (relative to the eye) and radius of a sphere around the view up to the shadow distance.
    pub(crate) view_sphere: (DVec3, f64),
    /// Corners of the receivers relative to the eye, as they come out of clipping.
    points: Vec<DVec3>,
    light_planes: Vec<Plane>,
    body: ConvexBody,
    skip: skip::Scratch,
    shadow_test: skip::ShadowTest,
}

impl Focus {
    /// Empty; filled by [`fit`](Self::fit).
    pub fn new() -> Self {
        Self::default()
    }

    /// Finds what a map for `light` must cover. `Some(skip)` says that no map is needed.
    ///
    /// Receivers are cut down to what the camera sees before the shadow distance and to what the light reaches, casters to those
    /// over the receivers' footprint and not below all of them; all before anything is divided.
    ///
    /// # Cost
    /// About 0.7 µs for one box each; no allocation in steady state.
    ///
    /// # Errors
    /// [`ShadowError`] names a light, distance or box that is not usable.
    pub fn fit(&mut self, light: &ShadowLight, scope: &Scope) -> Result<Option<Skip>, ShadowError> {
        self.receivers.clear();
        self.casters.clear();
        light.check()?;
        scope.check()?;
        let camera = scope.camera;
        self.origin = camera.eye();
        self.pixels_per_unit = camera.pixels_per_unit();
        self.view_sphere = view_sphere(camera, scope.shadow_far);
        light.planes(self.origin, &mut self.light_planes);
        self.light = Some(*light);
        self.gather_points(scope);
        if self.points.is_empty() {
            return Ok(Some(Skip::NothingSeen));
        }
        self.choose_axes(light, camera);
        self.project_receivers(camera);
        self.shadow_test.set_receivers(&self.points);
        if !self.gather_casters(scope.casters) {
            return Ok(Some(Skip::NoCaster));
        }
        if scope.lit_outside {
            self.clip_to_casters(scope);
            if self.receivers.is_empty() {
                return Ok(Some(Skip::NoCaster));
            }
        }
        self.grow_footprint(scope.map_side);
        Ok(None)
    }

    /// Corners of what is seen and lit.
    fn gather_points(&mut self, scope: &Scope) {
        self.points.clear();
        for b in scope.receivers {
            self.body.set_camera(scope.camera, scope.shadow_far, self.origin);
            self.shadow_test.set_view(self.body.planes());
            self.body.clip_to_box(&relative(b, self.origin));
            self.light_planes.iter().for_each(|p| self.body.clip(p));
            self.points.extend_from_slice(self.body.vertices());
        }
    }

    fn choose_axes(&mut self, light: &ShadowLight, camera: &Camera) {
        let followed = self.axes.is_some_and(|a| a.from_view);
        let direction = light.direction().normalize();
        let view = camera.forward();
        self.sin_gamma = view.cross(direction).length();
        let axes = match *light {
            ShadowLight::Directional { .. } => LightAxes::new(direction, view, followed),
            ShadowLight::Spot { position, .. } => {
                // The centre of the box along the light's own axes: it lies ahead of the light, and moves steadily.
                let own = LightAxes::of_light(direction);
                let at = position - self.origin;
                let local = |&p: &DVec3| DVec3::new(own.x.dot(p - at), own.y.dot(p - at), own.z.dot(p - at));
                let c = DAabb::from_points(self.points.iter().map(local)).center();
                LightAxes::of_spot(direction, view, own.x * c.x + own.y * c.y + own.z * c.z, followed)
            }
        };
        self.axes = Some(axes);
        self.space = LightSpace::new(light, &axes, self.origin);
    }

    fn project_receivers(&mut self, camera: &Camera) {
        let perspective = matches!(camera.projection(), Projection::Perspective { .. });
        let ahead = camera.forward();
        let near = camera.near();
        self.receivers.clear();
        self.receivers.extend(self.points.iter().map(|&p| {
            let (q, h) = self.space.project(p);
            // Rounding may leave a corner a hair before the near plane.
            let eye_depth = if perspective { ahead.dot(p).max(near) } else { 1.0 };
            Corner { q, scale: h / eye_depth, reach: reach(&self.space, p, q, h) }
        }));
        self.footprint = DAabb::from_points(self.receivers.iter().map(|c| c.q));
    }

    /// Keeps the parts of the casters over the receivers' footprint, not below all receivers. Returns whether any of them can throw
    /// a shadow on what is seen.
    fn gather_casters(&mut self, casters: &[DAabb]) -> bool {
        let Self { footprint, space, points, body, light_planes, origin, shadow_test, .. } = self;
        let (b, s) = (*footprint, *space);
        // A caster that only touches the footprint from outside still counts: its shadow's edge may show.
        let largest = points.iter().fold(1.0, |m: f64, p| m.max(p.abs().max_element()));
        let planes = [
            (s.x, b.min.x, 1.0),
            (s.x, b.max.x, -1.0),
            (s.z, b.min.z, 1.0),
            (s.z, b.max.z, -1.0),
            (s.y, b.min.y, 1.0),
        ]
        .map(|(form, at, sign)| s.plane(form, at, sign, 1e-12 * largest));
        let rays = self.light.map_or(Rays::Parallel(DVec3::ZERO), |l| Rays::of(&l, *origin));
        let mut outlines_meet = false;
        for caster in casters {
            let caster = relative(caster, *origin);
            body.set_box(&caster);
            light_planes.iter().take(1).for_each(|p| body.clip(p));
            if shadow_test.misses(&caster, body.vertices(), points, rays) {
                continue;
            }
            // A receiver's corner in the caster settles it; outlines take longer.
            outlines_meet = outlines_meet || points.iter().any(|&p| caster.contains(p));
            if !outlines_meet {
                let outline = |c: &Corner| in_plane(c.q);
                self.skip.set_receivers(self.receivers.iter().map(outline));
                outlines_meet = self.skip.meets(body.vertices().iter().map(|&v| in_plane(s.project(v).0)));
            }
            planes.iter().for_each(|p| body.clip(p));
            self.casters.extend(body.vertices().iter().map(|&v| s.project(v).0));
        }
        outlines_meet && !self.casters.is_empty()
    }

    /// Cuts the receivers down to the casters' rectangle in light space.
    fn clip_to_casters(&mut self, scope: &Scope) {
        let b = DAabb::from_points(self.casters.iter().copied());
        let s = self.space;
        let planes = [(s.x, b.min.x, 1.0), (s.x, b.max.x, -1.0), (s.z, b.min.z, 1.0), (s.z, b.max.z, -1.0)]
            .map(|(form, at, sign)| s.plane(form, at, sign, 0.0));
        self.points.clear();
        for receiver in scope.receivers {
            self.body.set_camera(scope.camera, scope.shadow_far, self.origin);
            self.body.clip_to_box(&relative(receiver, self.origin));
            self.light_planes.iter().chain(&planes).for_each(|p| self.body.clip(p));
            self.points.extend_from_slice(self.body.vertices());
        }
        self.project_receivers(scope.camera);
    }

    fn grow_footprint(&mut self, map_side: u32) {
        let reach = self.receivers.iter().map(|c| c.reach).fold(0.0, f64::max);
        self.grain = f64::from(map_side) * f64::from(f32::EPSILON);
        let least = self.grain * reach.max(f64::from(f32::MIN_POSITIVE));
        let missing = (DVec3::splat(least) - self.footprint.extent()).max(DVec3::ZERO) * 0.5;
        self.inflation = missing.x.max(missing.z);
        self.footprint = DAabb::new(self.footprint.min - missing, self.footprint.max + missing);
        self.kappa_most = self.strongest();
    }

    /// The κ up to which `f32` rounding of κ·u, relative to w, moves no corner by more than about half a texel.
    fn strongest(&self) -> f64 {
        let near = self.footprint.min.z;
        let limits = self.receivers.iter().map(|c| 2.0 * self.grain * c.reach - (c.q.z - near));
        1.0 / limits.fold(0.0, f64::max).max(f64::MIN_POSITIVE)
    }

    /// The axes of light space; `None` before the first use.
    pub fn axes(&self) -> Option<LightAxes> {
        self.axes
    }

    /// The light that was fitted last.
    pub fn light(&self) -> Option<ShadowLight> {
        self.light
    }

    /// By how much (units of light space, each side) the covered area had to grow to have an extent at all; usually zero.
    pub fn inflation(&self) -> f64 {
        self.inflation
    }

    /// Corners of the receivers that are covered, relative to the eye.
    pub fn corners(&self) -> &[DVec3] {
        if self.receivers.is_empty() { &[] } else { &self.points }
    }

    /// Extent of the covered area across and along the warp axis, in units of light space (world units for parallel
    /// light, tangents for a spot).
    pub fn extent(&self) -> DVec2 {
        in_plane(self.footprint.extent())
    }
}

/// See [`Corner::reach`]; of a point relative to the eye, its place `q` in light space and its h.
fn reach(space: &LightSpace, p: DVec3, q: DVec3, h: f64) -> f64 {
    let offset = space.x.w.abs().max(space.z.w.abs());
    let p = p.abs().max_element();
    // Parallel light has no h but 1; that of a spot is rounded like the rest.
    let of_h = if space.h.truncate() == DVec3::ZERO { 1.0 } else { (p + space.h.w.abs()) / h };
    (p + offset) / h + in_plane(q).abs().max_element() * of_h
}

/// The smallest sphere on the view axis around the view up to `far`. Its size does not depend on where the camera looks.
fn view_sphere(camera: &Camera, far: f64) -> (DVec3, f64) {
    let (near, far) = (camera.near(), camera.far().min(far));
    let half = camera.half_extent().length();
    let (ahead, radius) = match camera.projection() {
        Projection::Orthographic { .. } => (0.5 * (near + far), (0.5 * (far - near)).hypot(half)),
        Projection::Perspective { .. } => {
            let center = (0.5 * (near + far) * (1.0 + half * half)).min(far);
            (center, (far - center).hypot(half * far))
        }
    };
    (camera.forward() * ahead, radius)
}

fn relative(b: &DAabb, eye: DVec3) -> DAabb {
    DAabb::new(b.min - eye, b.max - eye)
}
