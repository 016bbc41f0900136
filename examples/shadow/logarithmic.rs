//! A logarithmic shadow map, which no matrix can give: the chapter's open question, answered in software.
//!
//! Over a perspective warp with w = 1 + κu, the place along the map is s = ln w / ln W with W the largest w. Graphics cards
//! draw straight edges only; here every triangle is cut until an edge that is straight in the map is as good as the true
//! curve, and each receiver looks its own place up exactly.

use super::offset::Seen;
use farsight_geometry::glam::{DMat4, DVec2, DVec3, DVec4, Vec3};
use farsight_geometry::{Camera, Scene};
use farsight_raster::{Draw, Outputs, RasterError, Rasteriser, State, Target, relative_from_mesh};
use farsight_shadow::{Focus, MapOptions, ShadowView, Warp};

/// An edge whose ends' w differ by this share is drawn straight: it is off by (ln 1.005)²/8 = 3e-6 of the map's ln W.
const STRAIGHT: f64 = 1.005;

/// The map.
pub struct Logarithmic {
    view: ShadowView,
    /// ln W.
    ln_most: f64,
    target: Target,
    /// Largest extent of a texel over the receivers' corners, in pixels.
    pub texel_px: f64,
    /// Triangles that were drawn, after cutting.
    pub triangles: usize,
}

impl Logarithmic {
    /// Draws `scene` for the strength that makes the worst texel smallest.
    pub fn new(scene: &Scene, camera: &Camera, focus: &Focus, side: u32) -> Result<Self, RasterError> {
        let options = |kappa| MapOptions::new(side).with_warp(Warp::Kappa(kappa));
        let candidates = (-40..60).map(|i| {
            let view = focus.map(&options((0.25 * f64::from(i)).exp2() / focus.extent().y), None);
            (worst_texel(&view, camera, focus), view)
        });
        let (texel_px, view) = candidates.min_by(|a, b| a.0.total_cmp(&b.0)).expect("there are candidates");
        let ln_most = ln_most(&view, focus);
        let target = Target::new(side, side, Outputs { colour: false, depth: true, id: false })?;
        let mut map = Self { view, ln_most, target, texel_px, triangles: 0 };
        map.draw(scene);
        Ok(map)
    }

    /// Place in the map, −1 to 1 in x and y, and depth, of a clip position.
    fn place(&self, clip: DVec4) -> DVec3 {
        let t = clip.x / clip.w;
        DVec3::new(t, 2.0 * clip.w.ln() / self.ln_most - 1.0, clip.z / clip.w)
    }

    fn draw(&mut self, scene: &Scene) {
        let mut corners: Vec<Vec3> = Vec::new();
        for instance in scene.instances() {
            let mesh = scene.mesh_of(instance);
            let relative = relative_from_mesh(instance, mesh, self.view.origin);
            let clip_from_mesh = self.view.clip_from_relative * DMat4::from(relative);
            for i in 0..mesh.triangles().len() {
                let clip = mesh.corners(i).map(|c| clip_from_mesh * c.as_dvec3().extend(1.0));
                // Before w = 1 lies what is nearer than all receivers.
                let ahead = ahead_of_receivers(clip);
                for k in 2..ahead.len() {
                    self.cut([ahead[0], ahead[k - 1], ahead[k]], &mut corners);
                }
            }
        }
        let triangles: Vec<[u32; 3]> =
            (0..corners.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let mut state = State::default();
        state.depth_clamp = true;
        let draw =
            Draw { positions: &corners, triangles: &triangles, clip_from_local: DMat4::IDENTITY, state };
        Rasteriser::new().draw(&mut self.target, &draw);
        self.triangles = triangles.len();
    }

    /// Cuts the edge along which w changes most, in the middle of its image, until none changes much; drops what is outside of the map.
    fn cut(&self, clip: [DVec4; 3], out: &mut Vec<Vec3>) {
        let outside = |form: fn(&DVec4) -> f64| clip.iter().all(|c| form(c) < 0.0);
        if outside(|c| c.w - c.x) || outside(|c| c.w + c.x) || outside(|c| c.w - c.y) {
            return;
        }
        let ends = |i: usize| [clip[i], clip[(i + 1) % 3]];
        let growth = |i: usize| {
            let [a, b] = ends(i);
            a.w.max(b.w) / a.w.min(b.w)
        };
        let i = (0..3).fold(0, |best, i| if growth(i) > growth(best) { i } else { best });
        if growth(i) <= STRAIGHT {
            out.extend(clip.map(|c| self.place(c).as_vec3()));
            return;
        }
        let ([a, b], c) = (ends(i), clip[(i + 2) % 3]);
        let middle = a.lerp(b, ((a.w * b.w).sqrt() - a.w) / (b.w - a.w));
        self.cut([a, middle, c], out);
        self.cut([middle, b, c], out);
    }

    /// Whether the map lights a surface point: one comparison, at the depth of the surface's own plane at the texel's centre.
    pub fn lit(&self, seen: &Seen) -> bool {
        let at = |p: DVec3| self.view.clip_from_relative * (p - self.view.origin).extend(1.0);
        let clip = at(seen.point);
        if clip.w < 1.0 {
            return true;
        }
        let place = self.place(clip);
        let side = f64::from(self.target.width());
        let texel = ((place.truncate() * 0.5 + 0.5) * side).floor();
        if texel.min_element() < 0.0 || texel.max_element() >= side {
            return true;
        }
        let wanted = (texel + 0.5) / side * 2.0 - 1.0;
        let (u, v) = seen.normal.any_orthonormal_pair();
        // Two steps of Newton's method along the plane.
        let mut point = seen.point;
        for _ in 0..2 {
            let here = self.place(at(point));
            let step = 1e-6 * (1.0 + point.distance(self.view.origin));
            let slope = |d: DVec3| (self.place(at(point + d * step)) - here).truncate() / step;
            let (du, dv, rest): (DVec2, DVec2, DVec2) = (slope(u), slope(v), wanted - here.truncate());
            let det = du.perp_dot(dv);
            point += (u * rest.perp_dot(dv) + v * du.perp_dot(rest)) / det;
        }
        let stored = self.target.depth(texel.x as u32, self.target.height() - 1 - texel.y as u32);
        let depth = self.place(at(point)).z;
        !depth.is_finite() || depth + 1e-5 >= f64::from(stored)
    }
}

/// The part of a triangle with w ≥ 1, a convex polygon.
fn ahead_of_receivers(clip: [DVec4; 3]) -> Vec<DVec4> {
    let mut kept = Vec::with_capacity(4);
    for i in 0..3 {
        let [a, b] = [clip[i], clip[(i + 1) % 3]];
        if a.w >= 1.0 {
            kept.push(a);
        }
        if (a.w >= 1.0) != (b.w >= 1.0) {
            kept.push(a.lerp(b, (1.0 - a.w) / (b.w - a.w)));
        }
    }
    kept
}

fn ln_most(view: &ShadowView, focus: &Focus) -> f64 {
    let w = |c: &DVec3| view.clip_from_relative.row(3).dot(c.extend(1.0));
    focus.corners().iter().map(w).fold(1.0 + 1e-9, f64::max).ln()
}

/// As [`ShadowView::texel_at`] has it, with the gradient of ln w / ln W along the map.
fn worst_texel(view: &ShadowView, camera: &Camera, focus: &Focus) -> f64 {
    let row = view.clip_from_relative.row(3);
    let ln_most = ln_most(view, focus);
    let texel = |&corner: &DVec3| {
        let Some([_, t]) = view.gradients(corner + view.origin) else { return f64::INFINITY };
        let s = row.truncate() / (row.dot(corner.extend(1.0)) * ln_most);
        let ahead = camera.forward().dot(corner).max(camera.near());
        let extent = s.length().max(t.length()) / s.cross(t).length();
        extent / f64::from(view.side) * camera.pixels_per_unit() / ahead
    };
    focus.corners().iter().map(texel).fold(0.0, f64::max)
}
