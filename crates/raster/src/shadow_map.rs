//! Shadow maps with any matrix.

mod nearest;
mod soft;

pub use soft::Penumbra;

use crate::draw::{Draw, Rasteriser, State};
use crate::{Cull, Outputs, RasterError, Target};
use farsight_geometry::scene::Light;
use farsight_geometry::{Camera, Scene};
use glam::{DMat4, DVec3, DVec4, Mat4, Vec3, Vec4};
use nearest::Nearest;
use std::sync::{Arc, OnceLock};

/// How a lookup avoids shadowing the surface by itself, and how it filters.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ShadowOptions {
    /// Depth added to the receiver, in the map's depth (0 to 1).
    pub constant_bias: f32,
    /// How far the lookup is moved along the surface's normal, over what just keeps a plane from shadowing itself through the farthest texel of the
    /// filter. Warped maps, whose depth changes across the light as well, are accounted for. The default of 1.06 leaves a little for rounding.
    pub normal_offset: f32,
    /// Percentage-closer filtering over (2n + 1)² texels with bilinear weights; 0 is a single comparison.
    pub filter_radius: u32,
    /// Sides that cast no shadow.
    pub cull: Cull,
    /// How large the light is, for soft shadows: the filter becomes as wide as the penumbra, never narrower than `filter_radius` says. `None` casts hard
    /// shadows.
    pub penumbra: Option<Penumbra>,
}

impl Default for ShadowOptions {
    /// A hair of depth bias, 3 x 3 filtering, and an offset that covers the filter's corner.
    fn default() -> Self {
        Self { constant_bias: 1e-5, normal_offset: 1.06, filter_radius: 1, cull: Cull::None, penumbra: None }
    }
}

/// How a map's coordinates change around a point, times w there.
struct Gradients {
    rows: [Vec3; 3],
    w: f32,
}

/// Depth seen from a light.
#[derive(Clone, Debug)]
pub struct ShadowMap {
    target: Arc<Target>,
    /// What lies nearest to the light, region by region; made by the first soft lookup.
    nearest: Arc<OnceLock<Nearest>>,
    /// Places in the unit disk of soft lookups.
    spiral: Arc<[soft::Place]>,
    /// Tangent of the light's angular radius.
    spread: f32,
    /// Map clip space from world coordinates relative to `origin`.
    clip_from_relative: DMat4,
    rounded: Mat4,
    origin: DVec3,
    towards_light: Vec3,
    options: ShadowOptions,
    /// Asked for points outside this map.
    beyond: Option<Box<ShadowMap>>,
    /// The plane, in world coordinates, on whose far side another map is asked: its normal and its place along that.
    end: Option<(DVec3, f64)>,
    /// The same relative to `origin`.
    rounded_end: Option<(Vec3, f32)>,
}

impl ShadowMap {
    /// An empty map of `size` x `size` texels.
    ///
    /// `light_clip_from_relative` takes world coordinates minus `origin` to the light's clip space: any matrix, with
    /// depth from w (nearest the light) to 0 as in [`Draw::clip_from_local`]. `towards_light` scales the normal offset.
    ///
    /// # Errors
    /// [`RasterError::TargetSize`].
    pub fn new(
        size: u32,
        light_clip_from_relative: DMat4,
        origin: DVec3,
        towards_light: DVec3,
        options: ShadowOptions,
    ) -> Result<Self, RasterError> {
        Ok(Self {
            target: Arc::new(Target::new(size, size, Outputs::DEPTH)?),
            nearest: Arc::default(),
            spread: options.penumbra.map_or(0.0, |p| p.angular_radius.tan()),
            spiral: options.penumbra.map_or(Arc::default(), |p| soft::spiral(p.taps)),
            clip_from_relative: light_clip_from_relative,
            rounded: light_clip_from_relative.as_mat4(),
            origin,
            towards_light: towards_light.as_vec3(),
            options,
            beyond: None,
            end: None,
            rounded_end: None,
        })
    }

    /// The map of a parallel light over the sphere of `radius` around `center`, casters of `scene` drawn.
    ///
    /// Casters between the light and the sphere are kept by clamping their depth.
    ///
    /// # Errors
    /// [`RasterError::TargetSize`]; [`RasterError::Option`] when `radius` is not positive or the direction not of unit length.
    pub fn directional(
        rasteriser: &mut Rasteriser,
        scene: &Scene,
        direction: DVec3,
        center: DVec3,
        radius: f64,
        size: u32,
        options: ShadowOptions,
    ) -> Result<Self, RasterError> {
        if !(radius > 0.0 && radius.is_finite()) {
            return Err(RasterError::Option { option: "radius", value: radius, range: "(0, ∞)" });
        }
        let length = direction.length();
        if length.is_nan() || (length - 1.0).abs() > 1e-5 {
            return Err(RasterError::Option {
                option: "length of direction",
                value: length,
                range: "1 ± 1e-5",
            });
        }
        let (right, up) = direction.any_orthonormal_pair();
        let row = |axis: DVec3, w: f64| DVec4::new(axis.x, axis.y, axis.z, w);
        // Depth 1 at the sphere's side towards the light, 0 at the other.
        let rows = [
            row(right / radius, 0.0),
            row(up / radius, 0.0),
            row(-direction * (0.5 / radius), 0.5),
            row(DVec3::ZERO, 1.0),
        ];
        let matrix = DMat4::from_cols(rows[0], rows[1], rows[2], rows[3]).transpose();
        let mut map = Self::new(size, matrix, center, -direction, options)?;
        map.draw_scene(rasteriser, scene);
        Ok(map)
    }

    /// One map per directional light of a scene, around all of it: the simple choice for pictures.
    ///
    /// Stops at the first light of another kind, since maps belong to lights by position.
    ///
    /// # Errors
    /// As [`directional`](Self::directional).
    pub fn for_scene(
        rasteriser: &mut Rasteriser,
        scene: &Scene,
        size: u32,
        options: ShadowOptions,
    ) -> Result<Vec<Self>, RasterError> {
        let bounds = scene.bounds();
        let radius = (0.5 * bounds.diagonal()).max(1e-3);
        let mut maps = Vec::new();
        for light in scene.lights() {
            let Light::Directional { direction, .. } = *light else { break };
            let direction = direction.normalize();
            maps.push(Self::directional(
                rasteriser,
                scene,
                direction,
                bounds.center(),
                radius,
                size,
                options,
            )?);
        }
        Ok(maps)
    }

    /// As [`for_scene`](Self::for_scene), with a second map of the same size for what is within `distance` of the eye.
    ///
    /// # Errors
    /// As [`directional`](Self::directional).
    pub fn for_view(
        rasteriser: &mut Rasteriser,
        scene: &Scene,
        camera: &Camera,
        distance: f64,
        size: u32,
        options: ShadowOptions,
    ) -> Result<Vec<Self>, RasterError> {
        let center = camera.eye() + camera.forward() * (0.5 * distance);
        let mut maps = Self::for_scene(rasteriser, scene, size, options)?;
        for map in &mut maps {
            let direction = -map.towards_light.as_dvec3().normalize();
            let radius = 0.55 * distance;
            let near = Self::directional(rasteriser, scene, direction, center, radius, size, options)?;
            let far = std::mem::replace(map, near);
            map.beyond = Some(Box::new(far));
        }
        Ok(maps)
    }

    /// The map with another one that is asked for points outside of this one, as cascades do.
    #[must_use]
    pub fn with_beyond(self, beyond: Self) -> Self {
        Self { beyond: Some(Box::new(beyond.relative_to(self.origin))), ..self }
    }

    /// The map for points no farther than `distance` ahead of an eye, as a cascade is; others are asked of the map [beyond](Self::with_beyond).
    #[must_use]
    pub fn until(self, eye: DVec3, forward: DVec3, distance: f64) -> Self {
        let end = Some((forward, forward.dot(eye) + distance));
        let rounded_end = end_around(end, self.origin);
        Self { end, rounded_end, ..self }
    }

    /// Draws casters: triangles with a matrix from their coordinates to those relative to the map's origin.
    pub fn draw(
        &mut self,
        rasteriser: &mut Rasteriser,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        relative_from_local: DMat4,
    ) {
        let state = State { cull: self.options.cull, depth_clamp: true, ..State::default() };
        let clip_from_local = self.clip_from_relative * relative_from_local;
        // What was known of the depths holds no longer.
        self.nearest = Arc::default();
        rasteriser
            .draw(Arc::make_mut(&mut self.target), &Draw { positions, triangles, clip_from_local, state });
    }

    /// Draws all instances of a scene as casters.
    pub fn draw_scene(&mut self, rasteriser: &mut Rasteriser, scene: &Scene) {
        let frustum = farsight_geometry::Frustum::from_matrix(&self.clip_from_relative, self.origin, 0.0);
        let sides = &frustum.planes()[..frustum.planes().len().min(4)];
        for (instance, bounds) in scene.instances().iter().zip(scene.instance_bounds()) {
            // Only the four side planes count: depth is clamped, so casters before the map's volume still cast.
            let (center, half) = (bounds.center() - self.origin, 0.5 * bounds.extent());
            if sides.iter().any(|p| p.distance(center) < -1.001 * p.normal.abs().dot(half) - 1e-3) {
                continue;
            }
            let mesh = scene.mesh_of(instance);
            let relative = crate::render::relative_from_mesh(instance, mesh, self.origin);
            self.draw(rasteriser, mesh.positions(), mesh.triangles(), DMat4::from(relative));
        }
    }

    /// The depths: 1 nearest the light, 0 where nothing casts.
    pub fn target(&self) -> &Target {
        &self.target
    }

    /// The point that [`lit_relative`](Self::lit_relative) is relative to.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// The map for points relative to another origin.
    #[must_use]
    pub fn relative_to(&self, origin: DVec3) -> Self {
        let clip_from_relative = self.clip_from_relative * DMat4::from_translation(origin - self.origin);
        let beyond = self.beyond.as_ref().map(|b| Box::new(b.relative_to(origin)));
        let rounded = clip_from_relative.as_mat4();
        let rounded_end = end_around(self.end, origin);
        Self { clip_from_relative, rounded, origin, beyond, rounded_end, ..self.clone() }
    }

    /// Share of the light that reaches a point (relative to the origin), from 0 to 1. Outside the map the one [beyond](Self::with_beyond) is asked; without
    /// one, everything there is lit.
    pub fn lit_relative(&self, point: Vec3, normal: Vec3) -> f32 {
        let outside = || self.beyond.as_ref().map_or(1.0, |b| b.lit_relative(point, normal));
        if self.rounded_end.is_some_and(|(ahead, end)| ahead.dot(point) > end) {
            return outside();
        }
        let reach = (self.options.filter_radius + 1) as f32;
        let gradients = self.gradients(point);
        let moved =
            point + normal * (self.options.normal_offset * reach * self.clearance(&gradients, normal));
        let clip: Vec4 = self.rounded * moved.extend(1.0);
        if clip.w <= 0.0 {
            return outside();
        }
        let size = self.target.width() as f32;
        let x = (0.5 + 0.5 * clip.x / clip.w) * size;
        let y = (0.5 - 0.5 * clip.y / clip.w) * size;
        let depth = clip.z / clip.w + self.options.constant_bias;
        if !(x >= 0.0 && x < size && y >= 0.0 && y < size && depth > 0.0) {
            return outside();
        }
        match self.options.penumbra {
            None => self.filtered(x, y, depth),
            Some(_) => self.soft(&gradients, normal, [x, y, depth]),
        }
    }

    /// How far a plane through a point must be lifted along its normal to lie before its own depth a texel farther in both directions.
    ///
    /// A step of one texel across the light is a, and on the plane, with the light's direction l, a − l·(a·n)/(l·n); depth changes by ∇z along
    /// it. A lift of e along n is as good as one of e/(l·n) along l. Uniform maps have ∇z along l, so that ∣a·n∣ is left; warped ones have not.
    fn clearance(&self, gradients: &Gradients, normal: Vec3) -> f32 {
        let Gradients { rows: [gx, gy, gz], w } = *gradients;
        // Both are across the ray of light, so their product is along it, and the steps of one texel are their duals.
        let light = gx.cross(gy);
        let step = 2.0 * w / (self.target.width() as f32 * light.length_squared());
        let (fall, facing) = (gz.dot(light), normal.dot(light));
        let rise = |across: Vec3| (across.dot(gz) * facing / fall - across.dot(normal)).abs();
        let lift = (rise(gy.cross(light)) + rise(light.cross(gx))) * step.abs();
        if lift.is_finite() { lift } else { 0.0 }
    }

    fn gradients(&self, point: Vec3) -> Gradients {
        let clip = self.rounded * point.extend(1.0);
        let w_row = self.rounded.row(3).truncate();
        let gradient = |row: usize, value: f32| self.rounded.row(row).truncate() - w_row * (value / clip.w);
        Gradients { rows: [gradient(0, clip.x), gradient(1, clip.y), gradient(2, clip.z)], w: clip.w }
    }

    /// The depth of a texel; beyond the border that of the nearest one.
    #[inline]
    fn texel(&self, i: i32, j: i32) -> f32 {
        let last = self.target.width() as i32 - 1;
        self.target.depth[j.clamp(0, last) as usize * self.target.stride() + i.clamp(0, last) as usize]
    }

    fn filtered(&self, x: f32, y: f32, depth: f32) -> f32 {
        let lit = |i: i32, j: i32| if depth >= self.texel(i, j) { 1.0 } else { 0.0 };
        let radius = self.options.filter_radius as i32;
        if radius == 0 {
            return lit(x as i32, y as i32);
        }
        // Bilinear weights of a box as wide as 2·radius + 1 texels: the outer ones count by how far the box reaches.
        let (fx, fy) = (x - 0.5 - (x - 0.5).floor(), y - 0.5 - (y - 0.5).floor());
        let (x0, y0) = ((x - 0.5).floor() as i32, (y - 0.5).floor() as i32);
        let weight = |k: i32, f: f32| match k {
            k if k == -radius => 1.0 - f,
            k if k == radius + 1 => f,
            _ => 1.0,
        };
        let mut sum = 0.0;
        for j in -radius..=radius + 1 {
            for i in -radius..=radius + 1 {
                sum += weight(i, fx) * weight(j, fy) * lit(x0 + i, y0 + j);
            }
        }
        let side = (2 * radius + 1) as f32;
        // Rounded weights may add up to a little more than all.
        (sum / (side * side)).min(1.0)
    }
}

/// A plane relative to an origin.
fn end_around(end: Option<(DVec3, f64)>, origin: DVec3) -> Option<(Vec3, f32)> {
    end.map(|(normal, place)| (normal.as_vec3(), (place - normal.dot(origin)) as f32))
}
