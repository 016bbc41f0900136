//! Shadows of the sun along the path: casters as coarse as their shadows allow, a map for what is seen, hard or soft lookups.

use crate::path::Cache;
use farsight_geometry::glam::{DMat4, DVec3, Vec3};
use farsight_geometry::{Camera, DAabb};
use farsight_hlod::{CasterLight, Casters, Mesh, Selection, Store, select_casters};
use farsight_raster::{Penumbra, Rasteriser, ShadowMap, ShadowOptions};
use farsight_shadow::penumbra::caster::{Source, Tolerance, tolerance};
use farsight_shadow::{Focus, MapOptions, Scope, ShadowLight};
use std::error::Error;

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
    /// Error of the casters: receivers are lifted by it, or what is drawn below them by less than either error would be dark.
    error: f32,
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
    let view = focus.map(&options, None);
    let mut options = ShadowOptions::default();
    options.penumbra =
        (sun != Sun::Hard).then(|| Penumbra { angular_radius: (0.5 * sun.diameter()) as f32, taps: TAPS });
    let mut map = ShadowMap::new(SIDE, view.clip_from_relative, view.origin, -direction, options)?;
    let mut rasteriser = Rasteriser::new();
    for &n in &casters.drawn {
        let node = cache.mesh(n, Mesh::Shape);
        let relative = DMat4::from_translation(node.origin - view.origin);
        map.draw(&mut rasteriser, &node.positions, node.indices.as_chunks::<3>().0, relative);
    }
    let error = casters.error.map_or(0.0, |e| e.value) as f32;
    Ok(Some(Shadow { map, error }))
}

impl Shadow {
    /// Share of the sun that reaches a point, relative to the map's origin.
    pub fn lit(&self, point: Vec3, normal: Vec3) -> f32 {
        self.map.lit_relative(point + normal * self.error, normal)
    }

    pub fn origin(&self) -> DVec3 {
        self.map.origin()
    }
}
