//! A scene seen by a camera.

use crate::counters::Counters;
use crate::draw::{Blend, Draw, Fragment, Ids, PixelShader, Rasteriser, State};
use crate::quad::QuadDraw;
use crate::shade::Lighting;
use crate::shadow_map::ShadowMap;
use crate::texture::MipMap;
use crate::{Cull, Outputs, RasterError, Target};
use farsight_geometry::scene::{AlphaMode, Instance, Material, Scene};
use farsight_geometry::{Camera, ClipConvention, Containment, Frustum, TriangleMesh};
use glam::{DAffine3, DMat4, DVec2, DVec3, Mat3, Vec2, Vec3, Vec4};
use std::borrow::Cow;
use std::cell::Cell;

/// What ids a scene's image gets. All start at 1; 0 is background.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SceneIds {
    /// Instance number + 1.
    #[default]
    Instances,
    /// Number of the placed triangle + 1, counted through the instances in order (wrapping after 2³²).
    Triangles,
}

/// How a scene is drawn.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct RenderOptions<'a> {
    /// Samples per pixel along each axis: n² samples, averaged in linear light.
    pub supersampling: u32,
    /// What ids are written.
    pub ids: SceneIds,
    /// Buffers of the result. Without colour nothing is shaded.
    pub outputs: Outputs,
    /// Radiance of the ambient light from above and from below.
    pub ambient: [Vec3; 2],
    /// Radiance of white surfaces that face the eye, from a light at the eye that does not fade.
    pub headlight: f32,
    /// Colour of the sky overhead and at the horizon; `None` leaves the background black and transparent.
    pub sky: Option<[Vec3; 2]>,
    /// Distance in metres over which air hides 63 % of a surface behind the horizon's colour; `None` for clear air.
    pub haze: Option<f32>,
    /// Direction away from the ground, of unit length.
    pub up: DVec3,
    /// Factor on all radiance.
    pub exposure: f32,
    /// Shadow maps of the scene's lights, in order; missing ones cast no shadow.
    pub shadows: &'a [ShadowMap],
    /// Instances to draw; `None` draws all. Those outside the view are skipped either way.
    pub only: Option<&'a [u32]>,
    /// Triangles to draw in place of an instance's own, over the same vertices; instances beyond the list's end are drawn as they are.
    pub forms: &'a [Option<&'a [[u32; 3]]>],
    /// Pictures among the instances, drawn after the opaque ones; their matrix is that of the camera.
    pub quads: &'a [QuadDraw<'a>],
    /// Mip-mapped textures of the scene, from [`mip_maps`]; empty to make them on the fly.
    pub textures: &'a [MipMap],
}

impl Default for RenderOptions<'_> {
    /// One sample per pixel, all outputs, a blue sky over z, no haze, no shadows.
    fn default() -> Self {
        Self {
            supersampling: 1,
            ids: SceneIds::Instances,
            outputs: Outputs::ALL,
            ambient: [Vec3::new(0.34, 0.42, 0.56), Vec3::new(0.22, 0.19, 0.15)],
            headlight: 0.0,
            sky: Some([Vec3::new(0.16, 0.36, 0.78), Vec3::new(0.72, 0.80, 0.88)]),
            haze: None,
            up: DVec3::Z,
            exposure: 1.0,
            shadows: &[],
            only: None,
            forms: &[],
            quads: &[],
            textures: &[],
        }
    }
}

/// Decodes all textures of a scene and makes their mip maps.
pub fn mip_maps(scene: &Scene) -> Vec<MipMap> {
    scene.textures().iter().map(MipMap::new).collect()
}

/// Coordinates relative to `origin` from a mesh's local ones, composed in `f64`.
pub fn relative_from_mesh(instance: &Instance, mesh: &TriangleMesh, origin: DVec3) -> DAffine3 {
    let mut relative = instance.world_from_mesh;
    relative.translation = instance.world_from_mesh.transform_point3(mesh.origin()) - origin;
    relative
}

/// Draws a scene as the camera sees it: instances outside the view are skipped, the others go front to back.
///
/// Returns the image and the work. Vertices are transformed by matrices composed in `f64` relative to the eye.
///
/// # Errors
/// [`RasterError::TargetSize`] when the camera's image times the supersampling is too large;
/// [`RasterError::Option`] when the supersampling is not between 1 and 64.
pub fn render_scene(
    rasteriser: &mut Rasteriser,
    scene: &Scene,
    camera: &Camera,
    options: &RenderOptions,
) -> Result<(Target, Counters), RasterError> {
    let n = options.supersampling;
    if !(1..=64).contains(&n) {
        return Err(RasterError::Option { option: "supersampling", value: n.into(), range: "1..=64" });
    }
    let size = |side: u32| side.saturating_mul(n);
    let fine = camera.with_image(size(camera.width()), size(camera.height()))?;
    let mut target = Target::new(fine.width(), fine.height(), options.outputs)?;
    let counters = render_into(rasteriser, &mut target, scene, &fine, options);
    if options.outputs.colour {
        finish(&mut target, &fine, options);
    }
    Ok((if n == 1 { target } else { target.downsampled(n) }, counters))
}

fn render_into(
    rasteriser: &mut Rasteriser,
    target: &mut Target,
    scene: &Scene,
    camera: &Camera,
    options: &RenderOptions,
) -> Counters {
    let before = std::mem::take(&mut rasteriser.counters);
    let frustum = Frustum::from_camera(camera);
    let bounds = scene.instance_bounds();
    let candidates: Box<dyn Iterator<Item = usize>> = match options.only {
        Some(list) => Box::new(list.iter().map(|&i| i as usize).filter(|&i| i < bounds.len())),
        None => Box::new(0..bounds.len()),
    };
    let mut order: Vec<(f64, usize)> = candidates
        .filter(|&i| frustum.classify(&bounds[i]) != Containment::Outside)
        .map(|i| (camera.distance_to_box(&bounds[i]), i))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let first_ids = first_ids(scene, options.ids);
    let clip_from_relative = camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye());
    let is_blended = |i: usize| material_of(scene, i).alpha == AlphaMode::Blend;
    with_view(scene, options, camera.eye(), clip_from_relative, |view| {
        for &(_, i) in order.iter().filter(|o| !is_blended(o.1)) {
            view.draw_instance(rasteriser, target, i, first_ids[i]);
        }
        for quad in options.quads {
            rasteriser.draw_quad(target, quad);
        }
        for &(_, i) in order.iter().rev().filter(|o| is_blended(o.1)) {
            view.draw_instance(rasteriser, target, i, first_ids[i]);
        }
    });
    let mut counters = std::mem::replace(&mut rasteriser.counters, before);
    counters.instances += bounds.len() as u64;
    counters.instances_drawn += order.len() as u64;
    rasteriser.counters += counters;
    counters
}

/// Draws an instance by itself, over transparent black, with any matrix from coordinates relative to `eye`: a picture that may stand for it.
///
/// `triangles` are over the vertices of its mesh. It is lit as [`render_scene`] would light it for an eye there; of the options, supersampling, sky, ids,
/// `only`, `forms` and `quads` do not count.
///
/// # Errors
/// [`RasterError::TargetSize`].
///
/// # Panics
/// When there is no such instance, or an index of `triangles` leads nowhere.
pub fn render_picture(
    rasteriser: &mut Rasteriser,
    scene: &Scene,
    instance: u32,
    triangles: &[[u32; 3]],
    eye: DVec3,
    clip_from_relative: DMat4,
    size: [u32; 2],
    options: &RenderOptions,
) -> Result<Target, RasterError> {
    let mut target = Target::new(size[0], size[1], options.outputs)?;
    with_view(scene, options, eye, clip_from_relative, |view| {
        view.draw_form(rasteriser, &mut target, instance as usize, triangles, 1);
    });
    Ok(target)
}

/// Gets ready what does not change from instance to instance.
fn with_view(
    scene: &Scene,
    options: &RenderOptions,
    eye: DVec3,
    clip_from_relative: DMat4,
    draw: impl FnOnce(&View),
) {
    let own_textures;
    let textures = if options.textures.is_empty() && options.outputs.colour {
        own_textures = mip_maps(scene);
        &own_textures[..]
    } else {
        options.textures
    };
    let shadows: Vec<ShadowMap> = options.shadows.iter().map(|s| s.relative_to(eye)).collect();
    let up = options.up.as_vec3();
    let lighting =
        Lighting::new(scene.lights(), &shadows, options.ambient, up, eye).with_headlight(options.headlight);
    draw(&View { scene, textures, lighting: &lighting, options, clip_from_relative, eye });
}

fn first_ids(scene: &Scene, ids: SceneIds) -> Vec<u32> {
    let mut next = 1u32;
    let step = |instance: &Instance| match ids {
        SceneIds::Instances => 1,
        SceneIds::Triangles => scene.mesh_of(instance).triangles().len() as u32,
    };
    let mut take = |instance: &Instance| {
        let first = next;
        next = next.wrapping_add(step(instance));
        first
    };
    scene.instances().iter().map(&mut take).collect()
}

fn material_of(scene: &Scene, instance: usize) -> Cow<'_, Material> {
    let id = scene.instances()[instance].material;
    id.map_or_else(|| Cow::Owned(Material::default()), |id| Cow::Borrowed(&scene.materials()[id.0 as usize]))
}

/// What does not change from instance to instance.
struct View<'a> {
    scene: &'a Scene,
    textures: &'a [MipMap],
    lighting: &'a Lighting<'a>,
    options: &'a RenderOptions<'a>,
    clip_from_relative: DMat4,
    eye: DVec3,
}

impl View<'_> {
    fn draw_instance(&self, rasteriser: &mut Rasteriser, target: &mut Target, i: usize, first_id: u32) {
        let own = || self.scene.mesh_of(&self.scene.instances()[i]).triangles();
        let triangles = self.options.forms.get(i).copied().flatten().unwrap_or_else(own);
        self.draw_form(rasteriser, target, i, triangles, first_id);
    }

    fn draw_form(
        &self,
        rasteriser: &mut Rasteriser,
        target: &mut Target,
        i: usize,
        triangles: &[[u32; 3]],
        first_id: u32,
    ) {
        let instance = &self.scene.instances()[i];
        let mesh = self.scene.mesh_of(instance);
        let material = material_of(self.scene, i);
        let relative = relative_from_mesh(instance, mesh, self.eye);
        let mirrored = relative.matrix3.determinant() < 0.0;
        let cull = match (material.two_sided, mirrored) {
            (true, _) => Cull::None,
            (false, false) => Cull::Back,
            (false, true) => Cull::Front,
        };
        let ids = match self.options.ids {
            SceneIds::Instances => Ids::Constant(first_id),
            SceneIds::Triangles => Ids::PerTriangle(first_id),
        };
        let blend = if material.alpha == AlphaMode::Blend { Blend::Over } else { Blend::Replace };
        let state = State { cull, ids, blend, depth_write: blend == Blend::Replace, ..State::default() };
        let clip_from_local = self.clip_from_relative * DMat4::from(relative);
        let draw = Draw { positions: mesh.positions(), triangles, clip_from_local, state };
        let masked = matches!(material.alpha, AlphaMode::Mask { .. });
        if self.options.outputs.colour || masked {
            let shader = SurfaceShader::new(mesh, triangles, &material, relative, self);
            rasteriser.draw_shaded(target, &draw, &shader);
        } else {
            rasteriser.draw(target, &draw);
        }
    }
}

/// Albedo times light.
struct SurfaceShader<'a> {
    mesh: &'a TriangleMesh,
    triangles: &'a [[u32; 3]],
    material: &'a Material,
    texture: Option<&'a MipMap>,
    lighting: &'a Lighting<'a>,
    relative: DAffine3,
    normal_matrix: Mat3,
    haze: Option<(f32, Vec3)>,
    exposure: f32,
    /// The last triangle that was shaded, and its normal: of the mesh, and in world axes.
    face: Cell<(u32, [Vec3; 2])>,
}

impl<'a> SurfaceShader<'a> {
    fn new(
        mesh: &'a TriangleMesh,
        triangles: &'a [[u32; 3]],
        material: &'a Material,
        relative: DAffine3,
        view: &View<'a>,
    ) -> Self {
        let inverse = relative.matrix3.inverse().transpose();
        let horizon = view.options.sky.map_or(Vec3::ZERO, |s| s[1]);
        Self {
            mesh,
            triangles,
            material,
            texture: material.texture.and_then(|t| view.textures.get(t.0 as usize)),
            lighting: view.lighting,
            relative,
            normal_matrix: if inverse.is_finite() { inverse.as_mat3() } else { Mat3::IDENTITY },
            haze: view.options.haze.map(|d| (d, horizon)),
            exposure: view.options.exposure,
            face: Cell::new((u32::MAX, [Vec3::ZERO; 2])),
        }
    }

    fn albedo(&self, fragment: &Fragment, corners: [usize; 3], weights: Vec3) -> Vec4 {
        let mut albedo = Vec4::from_array(self.material.base_colour);
        if let (Some(texture), Some(uvs)) = (self.texture, self.mesh.uvs()) {
            let uv = corners.map(|i| uvs[i]);
            let mix = |w: Vec3| -> Vec2 { uv[0] * w.x + uv[1] * w.y + uv[2] * w.z };
            let [dx, dy] = fragment.weight_gradients();
            albedo *= texture.sample(mix(weights), texture.level_of(mix(dx), mix(dy)));
        }
        if let Some(colours) = self.mesh.colours() {
            let c = corners.map(|i| linear_colour(colours[i]));
            albedo *= c[0] * weights.x + c[1] * weights.y + c[2] * weights.z;
        }
        albedo
    }

    /// Shading normal and face normal, in world axes.
    fn normals(&self, triangle: u32, corners: [usize; 3], weights: Vec3, point: Vec3) -> [Vec3; 2] {
        let smooth = self.mesh.normals().map_or(Vec3::ZERO, |n| {
            n[corners[0]] * weights.x + n[corners[1]] * weights.y + n[corners[2]] * weights.z
        });
        let (known, mut faces) = self.face.get();
        if known != triangle {
            let p = corners.map(|i| self.mesh.positions()[i].as_dvec3());
            let local = (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero().as_vec3();
            faces = [local, (self.normal_matrix * local).normalize_or_zero()];
            self.face.set((triangle, faces));
        }
        let [local, face] = faces;
        let normal = if smooth == Vec3::ZERO { local } else { smooth };
        let normal = (self.normal_matrix * normal).normalize_or_zero();
        // Data need not wind its triangles to suit its normals.
        let face = if face.dot(normal) < 0.0 { -face } else { face };
        // A surface seen from behind is lit from behind.
        let behind = self.material.two_sided && face.dot(point) > 0.0;
        if behind { [-normal, -face] } else { [normal, face] }
    }
}

fn linear_colour([r, g, b, a]: [u8; 4]) -> Vec4 {
    // Decoding a byte takes a power; 256 of them are kept.
    static TABLE: std::sync::LazyLock<[f32; 256]> =
        std::sync::LazyLock::new(|| std::array::from_fn(|i| crate::linear_of(i as u8)));
    let t = &*TABLE;
    Vec4::new(t[r as usize], t[g as usize], t[b as usize], f32::from(a) / 255.0)
}

impl PixelShader for SurfaceShader<'_> {
    fn shade(&self, fragment: &Fragment) -> Option<Vec4> {
        let corners = self.triangles[fragment.triangle as usize].map(|i| i as usize);
        let weights = fragment.weights();
        let albedo = self.albedo(fragment, corners, weights);
        let alpha = match self.material.alpha {
            AlphaMode::Mask { cutoff } if albedo.w < cutoff => return None,
            AlphaMode::Blend => albedo.w.clamp(0.0, 1.0),
            _ => 1.0,
        };
        let p = corners.map(|i| self.mesh.positions()[i]);
        let local = p[0] * weights.x + p[1] * weights.y + p[2] * weights.z;
        let point = self.relative.transform_point3(local.as_dvec3()).as_vec3();
        let [normal, face] = self.normals(fragment.triangle, corners, weights, point);
        let light = self.lighting.radiance(point, normal, face);
        let mut colour = albedo.truncate() * light * self.exposure;
        if let Some((distance, horizon)) = self.haze {
            colour = colour.lerp(horizon, 1.0 - (-point.length() / distance).exp());
        }
        Some((colour * alpha).extend(alpha))
    }
}

/// Puts the sky behind everything.
fn finish(target: &mut Target, camera: &Camera, options: &RenderOptions) {
    let Some([zenith, horizon]) = options.sky else { return };
    // Directions to one unit ahead change evenly over the image.
    let at = |x: f64, y: f64| {
        let direction = camera.ray(DVec2::new(x, y)).direction();
        (direction / direction.dot(camera.forward())).as_vec3()
    };
    let first = at(0.5, 0.5);
    let (width, height) = (f64::from(target.width()), f64::from(target.height()));
    let right = (at(0.5 + width, 0.5) - first) / width as f32;
    let down = (at(0.5, 0.5 + height) - first) / height as f32;
    let up = options.up.as_vec3();
    for y in 0..target.height() {
        for x in 0..target.width() {
            let colour = Vec4::from_array(target.colour(x, y));
            if colour.w < 1.0 {
                let direction = first + right * x as f32 + down * y as f32;
                let height = direction.dot(up) / direction.length();
                let sky = sky_colour(zenith, horizon, height).extend(1.0);
                target.set_colour(x, y, (colour + sky * (1.0 - colour.w)).to_array());
            }
        }
    }
}

/// Colour of the sky at a sine of elevation; below the horizon the haze over distant ground.
fn sky_colour(zenith: Vec3, horizon: Vec3, height: f32) -> Vec3 {
    // Reaches half of the change 20° above and 5° below the horizon.
    let (colour, half) = if height >= 0.0 { (zenith, 0.35) } else { (horizon * 0.45, 0.09) };
    let t = height.abs();
    horizon.lerp(colour, t / (t + half))
}
