//! A scene seen by a camera.

use crate::counters::Counters;
use crate::draw::{Blend, Draw, Ids, Rasteriser, State};
use crate::line::LineDraw;
use crate::quad::QuadDraw;
use crate::shade::Lighting;
use crate::shadow_map::ShadowMap;
use crate::surface::{Side, Surface, SurfaceShader};
use crate::texture::MipMap;
use crate::{Cull, Outputs, RasterError, Target};
use farsight_geometry::scene::{AlphaMode, Instance, Material, Scene};
use farsight_geometry::{Camera, ClipConvention, Containment, Frustum, TriangleMesh};
use glam::{DAffine3, DMat4, DVec2, DVec3, Vec3, Vec4};
use std::borrow::Cow;

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
    /// Surfaces to draw with instances, sorted by these; [`forms`](Self::forms) says what else is drawn of an instance, perhaps nothing.
    pub parts: &'a [Part<'a>],
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
            parts: &[],
            quads: &[],
            textures: &[],
        }
    }
}

/// A surface that is drawn in an instance's material, where and when that is: a node of a hierarchy that stands for it.
#[derive(Clone, Copy, Debug)]
pub struct Part<'a> {
    /// Whose material.
    pub instance: u32,
    /// The surface, in world coordinates.
    pub mesh: &'a TriangleMesh,
    /// Sides that are drawn as lines as well, shaded like their triangles: they close what is between parts that do not quite fit.
    pub sides: &'a [Side],
    /// Samples across these lines.
    pub width_px: u32,
    /// Whether backs are left out, whatever the material says: where nobody can see them.
    pub cull_backs: bool,
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
/// `only`, `forms`, `parts` and `quads` do not count.
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
pub(crate) struct View<'a> {
    scene: &'a Scene,
    pub textures: &'a [MipMap],
    pub lighting: &'a Lighting<'a>,
    pub options: &'a RenderOptions<'a>,
    clip_from_relative: DMat4,
    eye: DVec3,
}

impl View<'_> {
    fn draw_instance(&self, rasteriser: &mut Rasteriser, target: &mut Target, i: usize, first_id: u32) {
        let own = || self.scene.mesh_of(&self.scene.instances()[i]).triangles();
        let triangles = self.options.forms.get(i).copied().flatten().unwrap_or_else(own);
        self.draw_form(rasteriser, target, i, triangles, first_id);
        let parts = self.options.parts;
        let first = parts.partition_point(|p| (p.instance as usize) < i);
        let mine = parts[first..].iter().take_while(|p| p.instance as usize == i);
        let material = material_of(self.scene, i);
        mine.for_each(|part| self.draw_part(rasteriser, target, part, &material, first_id));
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
        let ids = match self.options.ids {
            SceneIds::Instances => Ids::Constant(first_id),
            SceneIds::Triangles => Ids::PerTriangle(first_id),
        };
        self.draw_surface(
            rasteriser,
            target,
            &Surface { mesh, triangles, material: &material, relative },
            ids,
        );
    }

    /// Draws a part, then the sides of it that neighbours may not fit.
    fn draw_part(
        &self,
        rasteriser: &mut Rasteriser,
        target: &mut Target,
        part: &Part,
        material: &Material,
        id: u32,
    ) {
        let Part { mesh, sides, width_px, cull_backs, .. } = *part;
        let one_sided;
        let material = if cull_backs && material.two_sided {
            one_sided = Material { two_sided: false, ..material.clone() };
            &one_sided
        } else {
            material
        };
        let relative = DAffine3::from_translation(mesh.origin() - self.eye);
        let surface = Surface { mesh, triangles: mesh.triangles(), material, relative };
        let state = self.draw_surface(rasteriser, target, &surface, Ids::Constant(id));
        let segments: Vec<[Vec3; 2]> =
            sides.iter().map(|s| s.corners().map(|c| mesh.corners(s.triangle as usize)[c])).collect();
        // Behind the surface by a line's width: only where there is a gap are lines nearer than what is drawn.
        let px = 2.0 / (f64::from(target.height()) * self.clip_from_relative.row(1).truncate().length());
        let recede = DVec3::new(1.0, 1.0, 1.0 - f64::from(width_px) * px);
        let clip_from_local = DMat4::from_scale(recede) * self.clip_from_relative * DMat4::from(relative);
        let lines = LineDraw { segments: &segments, colour: Vec4::ONE, width_px, clip_from_local, state };
        let shader = SurfaceShader::new(&surface, self);
        rasteriser.draw_lines_shaded(target, &lines, |segment, t, step| {
            shader.shade_side(sides[segment as usize], t, step)
        });
    }

    fn draw_surface(
        &self,
        rasteriser: &mut Rasteriser,
        target: &mut Target,
        surface: &Surface,
        ids: Ids,
    ) -> State {
        let Surface { mesh, triangles, material, relative } = *surface;
        let mirrored = relative.matrix3.determinant() < 0.0;
        let cull = match (material.two_sided, mirrored) {
            (true, _) => Cull::None,
            (false, false) => Cull::Back,
            (false, true) => Cull::Front,
        };
        let blend = if material.alpha == AlphaMode::Blend { Blend::Over } else { Blend::Replace };
        let state = State { cull, ids, blend, depth_write: blend == Blend::Replace, ..State::default() };
        let clip_from_local = self.clip_from_relative * DMat4::from(relative);
        let draw = Draw { positions: mesh.positions(), triangles, clip_from_local, state };
        let masked = matches!(material.alpha, AlphaMode::Mask { .. });
        if self.options.outputs.colour || masked {
            rasteriser.draw_shaded(target, &draw, &SurfaceShader::new(surface, self));
        } else {
            rasteriser.draw(target, &draw);
        }
        state
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
