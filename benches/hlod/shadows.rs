//! Shadows of the sun along the path: casters as coarse as their shadows allow, a map for what is seen, hard or soft lookups.

use crate::path::Cache;
use farsight_geometry::glam::{DMat4, DVec3, Vec3};
use farsight_geometry::{Camera, DAabb};
use farsight_hlod::{CasterLight, Casters, Mesh, Selection, Store, select_casters};
use farsight_raster::{Rasteriser, ShadowMap, ShadowOptions};
use farsight_shadow::penumbra::caster::{Source, Tolerance, tolerance};
use farsight_shadow::{Focus, MapOptions, Scope, ShadowLight, Warp};
use std::error::Error;
use std::f32::consts::TAU;

/// Texels on a side of the map.
const SIDE: u32 = 2048;
/// Change of brightness in a penumbra that casters may make.
const INTENSITY: f64 = 0.05;
/// Lookups of a soft shadow: to find what is in front, and to filter.
const TAPS: u32 = 16;

/// The light of a column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sun {
    /// Without shadows.
    Open,
    /// A sun without size.
    Hard,
    /// A sun of this diameter in radians.
    Soft(f64),
}

impl Sun {
    fn diameter(self) -> f64 {
        if let Self::Soft(diameter) = self { diameter } else { 0.0 }
    }
}

/// A map and how to ask it.
pub struct Shadow {
    map: ShadowMap,
    matrix: DMat4,
    /// Error of the casters: receivers are lifted by it, or what is drawn below them by less than either error would be dark.
    error: f32,
    soft: Option<Penumbra>,
}

#[derive(Clone, Copy)]
struct Penumbra {
    /// Texels of penumbra on either side of the edge per unit of depth between caster and receiver.
    texels_per_depth: f32,
    /// Offset along the normal that keeps a plane from shadowing itself.
    lift: f32,
    /// Widest search, in texels.
    most: f32,
}

/// How fine casters may be left, with the least distance of what is seen.
fn allowed(sun: Sun, camera: &Camera, receivers: &[DAabb], caster: &DAabb) -> f64 {
    let nearest = receivers.iter().map(|r| camera.distance_to_box(r)).fold(f64::INFINITY, f64::min);
    let edge = camera.world_error(0.5, nearest.max(camera.near()));
    let gap = |r: &DAabb| (r.min - caster.max).max(caster.min - r.max).max(DVec3::ZERO).length();
    let least = receivers.iter().map(gap).fold(f64::INFINITY, f64::min);
    let most = receivers.iter().map(|r| r.union(*caster).diagonal()).fold(0.0, f64::max);
    let asked = Tolerance { edge, intensity: INTENSITY };
    tolerance(&asked, &Source::sun(sun.diameter()), [least, most])
}

/// Chooses casters; their triangles are drawn by [`draw`].
pub fn casters(
    sun: Sun,
    direction: DVec3,
    camera: &Camera,
    store: &Store,
    selection: &Selection,
    receivers: &[DAabb],
) -> Casters {
    let mut casters = Casters::default();
    select_casters(
        store.tree(),
        CasterLight::Directional(direction),
        &selection.receiver_boxes(store.tree(), camera),
        |_, bounds| allowed(sun, camera, receivers, bounds),
        |_| true,
        &mut casters,
    );
    casters
}

/// Fits a map and draws casters into it; `None` where nothing can be in shadow.
pub fn draw(
    sun: Sun,
    direction: DVec3,
    camera: &Camera,
    receivers: &[DAabb],
    casters: &Casters,
    cache: &Cache,
    focus: &mut Focus,
) -> Result<Option<Shadow>, Box<dyn Error>> {
    let boxes: Vec<DAabb> = casters.drawn.iter().map(|&n| cache.store.tree().bounds(n)).collect();
    let scope = Scope::new(camera, camera.far(), receivers, &boxes, SIDE).with_lit_outside();
    if focus.fit(&ShadowLight::directional(direction), &scope)?.is_some() {
        return Ok(None);
    }
    let options = MapOptions::new(SIDE);
    // A penumbra is as wide in all texels of a uniform map.
    let options = if sun == Sun::Hard { options } else { options.with_warp(Warp::Uniform) };
    let view = focus.map(&options, None);
    let matrix = view.clip_from_relative;
    let mut map = ShadowMap::new(SIDE, matrix, view.origin, -direction, ShadowOptions::default())?;
    let mut rasteriser = Rasteriser::new();
    for &n in &casters.drawn {
        let node = cache.mesh(n, Mesh::Shape);
        let relative = DMat4::from_translation(node.origin - view.origin);
        map.draw(&mut rasteriser, &node.positions, node.indices.as_chunks::<3>().0, relative);
    }
    let per_unit = |row: usize| matrix.row(row).truncate().length();
    let texels = 0.5 * f64::from(SIDE) * per_unit(0).max(per_unit(1));
    let soft = (sun != Sun::Hard).then(|| Penumbra {
        texels_per_depth: (texels * (0.5 * sun.diameter()).tan() / per_unit(2)) as f32,
        lift: (3.0 / texels) as f32,
        most: 48.0,
    });
    let error = casters.error.map_or(0.0, |e| e.value) as f32;
    Ok(Some(Shadow { map, matrix, error, soft }))
}

impl Shadow {
    /// Share of the sun that reaches a point, relative to the map's origin.
    pub fn lit(&self, point: Vec3, normal: Vec3) -> f32 {
        let point = point + normal * self.error;
        match self.soft {
            None => self.map.lit_relative(point, normal),
            Some(penumbra) => self.soft_lit(penumbra, point + normal * penumbra.lift),
        }
    }

    pub fn origin(&self) -> DVec3 {
        self.map.origin()
    }

    /// Percentage-closer soft shadows: the mean depth of what is in front gives the penumbra's width, and that the filter's.
    fn soft_lit(&self, penumbra: Penumbra, point: Vec3) -> f32 {
        let side = SIDE as f32;
        let clip = self.matrix.as_mat4() * point.extend(1.0);
        let (x, y) = ((0.5 + 0.5 * clip.x) * side, (0.5 - 0.5 * clip.y) * side);
        let target = self.map.target();
        let depth_at = |radius: f32, i: u32| {
            // A spiral of even density.
            let (r, angle) = (radius * ((i as f32 + 0.5) / TAPS as f32).sqrt(), i as f32 * 0.381_966 * TAU);
            let (u, v) = (x + r * angle.cos(), y + r * angle.sin());
            let inside = u >= 0.0 && v >= 0.0 && u < side && v < side;
            if inside { target.depth(u as u32, v as u32) } else { 0.0 }
        };
        // Below the map's range lies what nothing was drawn into.
        let own = clip.z.max(0.0);
        let reach = (penumbra.texels_per_depth * (1.0 - clip.z)).clamp(1.0, penumbra.most);
        let (mut sum, mut count) = (0.0, 0.0);
        for depth in (0..TAPS).map(|i| depth_at(reach, i)).filter(|&d| d > own) {
            (sum, count) = (sum + depth, count + 1.0);
        }
        if count == 0.0 {
            return 1.0;
        }
        let width = (penumbra.texels_per_depth * (sum / count - clip.z)).clamp(1.0, penumbra.most);
        let dark = (0..TAPS).filter(|&i| depth_at(width, i) > own).count();
        1.0 - dark as f32 / TAPS as f32
    }
}
