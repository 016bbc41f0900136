//! How far the edges of drawn shadows are from where rays say they are, in pixels.

use farsight_geometry::glam::{DVec2, DVec3};
use farsight_geometry::{Camera, Ray, RayCaster, Scene};
use farsight_raster::ShadowMap;
use farsight_shadow::ShadowView;

/// A surface point behind a pixel.
#[derive(Clone, Copy)]
pub struct Seen {
    pub point: DVec3,
    /// Unit normal towards the eye.
    pub normal: DVec3,
}

/// What rays find: the surface behind each pixel that faces the light, and whether light reaches it.
pub struct Truth {
    pub eye: DVec3,
    pub width: u32,
    pub pixels: Vec<Option<(Seen, bool)>>,
}

/// Differences between a picture's shadows and the true ones.
#[derive(Clone, Copy, Debug, Default)]
pub struct Offsets {
    /// Pixels on the wrong side, over the pixels along true edges: how far edges are off on average.
    pub mean_px: f64,
    /// Farthest wrong pixel from where it would be right; at most [`SEARCH`].
    pub max_px: f64,
    pub wrong: u64,
    pub edge: u64,
    /// The mean over surfaces nearer than [`BANDS`] (the last: beyond).
    pub bands_px: [f64; 3],
}

/// Distances from the eye, in metres, that separate near, medium and far.
pub const BANDS: [f64; 2] = [12.0, 60.0];

/// Radius of the search for the true edge.
pub const SEARCH: i64 = 24;

/// Casts a ray for each pixel and one from there to the light, which travels in the unit direction `travel`.
pub fn truth(scene: &Scene, caster: &dyn RayCaster, camera: &Camera, travel: DVec3) -> Truth {
    let (width, height) = (camera.width(), camera.height());
    let pixel = |i: u32| {
        let px = DVec2::new(f64::from(i % width) + 0.5, f64::from(i / width) + 0.5);
        let ray = camera.ray(px);
        let hit = caster.closest(&ray)?;
        let point = ray.at(hit.t);
        let instance = &scene.instances()[hit.instance as usize];
        let [a, b, c] = scene.mesh_of(instance).corners(hit.triangle as usize).map(|p| {
            instance.world_from_mesh.transform_point3(scene.mesh_of(instance).origin() + p.as_dvec3())
        });
        let normal = (b - a).cross(c - a).normalize();
        let normal = if normal.dot(ray.direction()) > 0.0 { -normal } else { normal };
        // Surfaces that hardly face the light are dark with or without shadow.
        if normal.dot(-travel) < 0.05 {
            return None;
        }
        let lifted = point + normal * (1e-6 * (1.0 + hit.t));
        let lit = !caster.occluded(&Ray::new(lifted, -travel)?);
        Some((Seen { point, normal }, lit))
    };
    Truth { eye: camera.eye(), width, pixels: (0..width * height).map(pixel).collect() }
}

/// Compares with what `lit` says of each surface point.
pub fn compare(truth: &Truth, lit: impl Fn(&Seen) -> bool) -> (Offsets, Vec<Option<bool>>) {
    let drawn: Vec<Option<bool>> =
        truth.pixels.iter().map(|p| p.as_ref().map(|(seen, _)| lit(seen))).collect();
    let (width, height) = (i64::from(truth.width), truth.pixels.len() as i64 / i64::from(truth.width));
    let at = |x: i64, y: i64| {
        let inside = x >= 0 && y >= 0 && x < width && y < height;
        if inside { truth.pixels[(y * width + x) as usize].map(|(_, lit)| lit) } else { None }
    };
    let mut o = Offsets::default();
    let mut bands = [[0u64; 2]; 3];
    for y in 0..height {
        for x in 0..width {
            let Some(true_lit) = at(x, y) else { continue };
            let differs = |other: Option<bool>| other.is_some_and(|l| l != true_lit);
            let edge = u64::from(differs(at(x + 1, y)) || differs(at(x, y + 1)));
            o.edge += edge;
            let index = (y * width + x) as usize;
            let distance = truth.pixels[index].map_or(0.0, |(seen, _)| seen.point.distance(truth.eye));
            let band = &mut bands[BANDS.iter().filter(|&&b| distance > b).count()];
            band[1] += edge;
            if drawn[index] != Some(!true_lit) {
                continue;
            }
            o.wrong += 1;
            band[0] += 1;
            let mut nearest = SEARCH * SEARCH;
            for dy in -SEARCH..=SEARCH {
                for dx in -SEARCH..=SEARCH {
                    let d = dx * dx + dy * dy;
                    if d < nearest && differs(at(x + dx, y + dy)) {
                        nearest = d;
                    }
                }
            }
            // To the edge between two pixels, half a pixel less.
            o.max_px = o.max_px.max((nearest as f64).sqrt() - 0.5);
        }
    }
    o.bands_px = bands.map(|[wrong, edge]| wrong as f64 / edge.max(1) as f64);
    o.mean_px = o.wrong as f64 / o.edge.max(1) as f64;
    (o, drawn)
}

/// Whether a map lights a surface point: one comparison, at the depth that the surface's own plane has at the texel's centre, so that no
/// offset is needed to keep surfaces from shadowing themselves and edges are displaced by the map's resolution alone.
pub fn lit(map: &ShadowMap, view: &ShadowView, seen: &Seen) -> bool {
    let m = &view.clip_from_relative;
    let p = (seen.point - view.origin).extend(1.0);
    let clip = *m * p;
    let side = f64::from(map.target().width());
    // Clip coordinate of the texel's centre.
    let centre = |c: f64| (((0.5 + 0.5 * c / clip.w) * side).floor() + 0.5) / side * 2.0 - 1.0;
    let (cx, cy) = (centre(clip.x), centre(clip.y));
    if clip.w <= 0.0 || cx.abs() >= 1.0 || cy.abs() >= 1.0 {
        return true;
    }
    let (u, v) = seen.normal.any_orthonormal_pair();
    let forms = [m.row(0) - m.row(3) * cx, m.row(1) - m.row(3) * cy];
    let columns = [u, v].map(|d| DVec2::new(forms[0].truncate().dot(d), forms[1].truncate().dot(d)));
    let rest = -DVec2::new(forms[0].dot(p), forms[1].dot(p));
    let det = columns[0].perp_dot(columns[1]);
    let (a, b) = (rest.perp_dot(columns[1]) / det, columns[0].perp_dot(rest) / det);
    let q = *m * (p + (u * a + v * b).extend(0.0));
    let at = |c: f64| ((0.5 + 0.5 * c) * side) as u32;
    let stored = f64::from(map.target().depth(at(cx), map.target().height() - 1 - at(cy)));
    q.z / q.w + 1e-5 >= stored
}
