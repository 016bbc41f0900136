//! Light from a point into all directions: one map where it suffices, else the faces of a cube.

use crate::ShadowError;
use crate::focus::{Focus, Scope, Skip};
use crate::light::{CubeFace, ShadowLight, frame_of};
use farsight_geometry::{ConvexBody, DAabb};
use glam::DVec3;

/// A light that shines from a point into all directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointLight {
    /// Where it is, in the world.
    pub position: DVec3,
    /// Distance from the light within which nothing casts a shadow. Positive; the maps begin a little before it, since they begin with a plane.
    pub near: f64,
    /// Distance beyond which nothing is lit; may be infinite.
    pub range: f64,
}

/// What the maps of a point light must cover.
///
/// When all that is seen lies within 50° of one direction, a single map aimed there serves it, with its texels where the eye needs
/// them. Otherwise the light or its surroundings are in view, no single projection has w > 0 everywhere, and there
/// is one map for each face of a cube that sees something.
#[derive(Clone, Debug, Default)]
pub struct PointFocus {
    focuses: [Focus; 6],
    used: Vec<(usize, Option<CubeFace>)>,
    body: ConvexBody,
    points: Vec<DVec3>,
}

/// Distance of an octagon's corners from its middle over that of its sides, a little more.
const CORNER: f64 = 1.082_393;

/// Cosine of an angle with a known tangent: a plane that far along the axis is nowhere, within the angle, beyond the unit sphere.
fn least_cosine(tangent: f64) -> f64 {
    1.0 / tangent.hypot(1.0)
}

/// Texels by which cube faces overlap, so that filters do not end at their borders.
const OVERLAP_TEXELS: f64 = 4.0;

impl PointFocus {
    /// Empty; filled by [`fit`](Self::fit).
    pub fn new() -> Self {
        Self::default()
    }

    /// Finds what the maps for `light` must cover. `Some(skip)` says that none is needed.
    ///
    /// # Errors
    /// [`ShadowError`] names a light, distance or box that is not usable.
    pub fn fit(&mut self, light: &PointLight, scope: &Scope) -> Result<Option<Skip>, ShadowError> {
        self.used.clear();
        let &PointLight { position, near, range } = light;
        let margin = OVERLAP_TEXELS / f64::from(scope.map_side.max(1));
        // Refuses bad input before anything is measured.
        let plane = near * least_cosine(std::f64::consts::SQRT_2 * (1.0 + margin));
        let face = |f: CubeFace| ShadowLight::cube_face(position, f, margin, plane, range);
        face(CubeFace::PosX).check()?;
        scope.check()?;
        if let Some((axis, tangent)) = self.cone(light, scope) {
            let side = frame_of(axis);
            let near = near * least_cosine(tangent * CORNER);
            let spot =
                ShadowLight::Spot { position, direction: axis, tangent, round: true, side, near, range };
            let skip = self.focuses[0].fit(&spot, scope)?;
            if skip.is_none() {
                self.used.push((0, None));
            }
            return Ok(skip);
        }
        let mut answer = Skip::NothingSeen;
        for (i, f) in CubeFace::ALL.into_iter().enumerate() {
            match self.focuses[i].fit(&face(f), scope)? {
                None => self.used.push((i, Some(f))),
                Some(Skip::NoCaster) => answer = Skip::NoCaster,
                Some(_) => {}
            }
        }
        Ok(self.used.is_empty().then_some(answer))
    }

    /// The axis and the tangent of the half angle of a cone around all that is seen; `None` when it is wider than 50° or the
    /// light is inside.
    fn cone(&mut self, light: &PointLight, scope: &Scope) -> Option<(DVec3, f64)> {
        const WIDEST: f64 = 0.642_787_609_686_539_4; // cos 50°
        let at = light.position - scope.camera.eye();
        self.points.clear();
        for b in scope.receivers {
            let eye = scope.camera.eye();
            self.body.set_camera(scope.camera, scope.shadow_far, eye);
            self.body.clip_to_box(&DAabb::new(b.min - eye, b.max - eye));
            self.points.extend_from_slice(self.body.vertices());
        }
        let bounds = DAabb::from_points(self.points.iter().copied());
        let distance = bounds.closest_point(at).distance(at);
        if bounds.is_empty() || distance <= 2.0 * light.near {
            return None;
        }
        let axis = (bounds.center() - at).try_normalize()?;
        let least = self.points.iter().map(|&p| (p - at).normalize_or_zero().dot(axis)).fold(1.0, f64::min);
        // A little wider, so that rounding cuts nothing off.
        let tangent = (1.0 - least * least).max(0.0).sqrt() / least;
        (least >= WIDEST).then_some((axis, tangent * 1.000_001 + 1e-9))
    }

    /// The maps' focuses, each with its face; without a face, one map serves all.
    pub fn maps(&self) -> impl Iterator<Item = (&Focus, Option<CubeFace>)> {
        self.used.iter().map(|&(i, face)| (&self.focuses[i], face))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MapOptions, ShadowView};
    use farsight_geometry::Camera;
    use farsight_geometry::sampling::{Random, in_box};
    use glam::dvec3;

    fn covers(view: &ShadowView, p: DVec3) -> bool {
        let clip = view.matrix() * (p - view.origin).as_vec3().extend(1.0);
        clip.w > 0.0 && clip.x.abs() <= clip.w && clip.y.abs() <= clip.w
    }

    /// What is just beyond the near distance casts, in the corners of a cube's faces and at the edge of a single map's cone too.
    #[test]
    fn what_is_beyond_the_near_distance_casts() {
        let light = PointLight { position: DVec3::ZERO, near: 1.0, range: f64::INFINITY };
        // The eye behind the light sees a receiver in the corner of a cube, far away; all around for the cube.
        let corner = dvec3(1.0, 1.0, 1.0).normalize();
        let camera = Camera::look_at(-20.0 * corner, corner, DVec3::Y).unwrap();
        let far = DAabb::from_points([10.0 * corner]).inflated(1.0);
        let around = DAabb::from_points([DVec3::ZERO]).inflated(15.0);
        let casters = [DAabb::from_points([1.05 * corner]).inflated(0.02)];
        for (receivers, maps) in [([far], 1), ([around], 6)] {
            let scope = Scope::new(&camera, 100.0, &receivers, &casters, 1024);
            let mut focus = PointFocus::new();
            assert_eq!(focus.fit(&light, &scope), Ok(None));
            assert!(focus.maps().count() <= maps);
        }
        let within = [DAabb::from_points([0.3 * corner]).inflated(0.02)];
        let receivers = [around];
        let scope = Scope::new(&camera, 100.0, &receivers, &within, 1024);
        assert_eq!(PointFocus::new().fit(&light, &scope), Ok(Some(Skip::NoCaster)));
    }

    /// Every point that is seen and lit lies in the map of its face, wherever the light is.
    #[test]
    fn maps_cover_what_is_seen_from_any_place_of_the_light() {
        let eye = dvec3(1e5, 2e5, -3e5);
        let camera = Camera::look_at(eye, eye + dvec3(1.0, 0.1, 0.2), DVec3::Y).unwrap();
        let room = DAabb::from_points([eye]).inflated(20.0);
        let center = eye + camera.forward() * 10.0;
        let places = [
            eye,
            center,
            eye + camera.forward() * camera.near(),
            eye + DVec3::Y * 19.0,
            eye + DVec3::X * 500.0,
        ];
        let mut random = Random::new(4);
        let mut single = 0;
        for position in places {
            let light = PointLight { position, near: 0.05, range: f64::INFINITY };
            let mut point = PointFocus::new();
            let boxes = [room];
            let scope = Scope::new(&camera, 30.0, &boxes, &boxes, 1024);
            assert_eq!(point.fit(&light, &scope).unwrap(), None);
            let views: Vec<_> =
                point.maps().map(|(f, face)| (f.map(&MapOptions::new(1024), None), face)).collect();
            single += usize::from(views[0].1.is_none());
            let mut tested = 0;
            for _ in 0..20_000 {
                let p = in_box(&room, random.units());
                let to = p - position;
                let seen = camera.project(p).is_some_and(|(px, depth)| {
                    depth > camera.near() && px.x > 0.0 && px.y > 0.0 && px.x < 1280.0 && px.y < 720.0
                });
                if !seen || to.abs().max_element() < 0.0501 {
                    continue;
                }
                let largest = to.abs().max_element();
                let own = |face: Option<CubeFace>| face.is_none_or(|f| f.direction().dot(to) == largest);
                let view = views.iter().find(|v| own(v.1));
                assert!(view.is_some_and(|(v, _)| covers(v, p)), "{position} {p}");
                tested += 1;
            }
            assert!(tested > 300, "{tested}");
        }
        assert_eq!(single, 1);
    }

    #[test]
    fn what_needs_no_map_gets_none() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::X, DVec3::Y).unwrap();
        let boxes = [DAabb::new(dvec3(5.0, -1.0, -1.0), dvec3(7.0, 1.0, 1.0))];
        let behind = [DAabb::new(dvec3(-7.0, -1.0, -1.0), dvec3(-5.0, 1.0, 1.0))];
        let mut point = PointFocus::new();
        let light = PointLight { position: dvec3(4.0, 3.0, 0.0), near: 0.1, range: 1.0 };
        assert_eq!(
            point.fit(&light, &Scope::new(&camera, 30.0, &boxes, &boxes, 64)),
            Ok(Some(Skip::NothingSeen))
        );
        let light = PointLight { range: 100.0, ..light };
        assert_eq!(
            point.fit(&light, &Scope::new(&camera, 30.0, &boxes, &behind, 64)),
            Ok(Some(Skip::NoCaster))
        );
        assert_eq!(
            point.fit(&light, &Scope::new(&camera, 30.0, &behind, &boxes, 64)),
            Ok(Some(Skip::NothingSeen))
        );
        assert!(point.maps().next().is_none());
        let bad = PointLight { near: 0.0, ..light };
        assert!(point.fit(&bad, &Scope::new(&camera, 30.0, &boxes, &boxes, 64)).is_err());
        let bad = PointLight { position: DVec3::NAN, ..light };
        assert!(point.fit(&bad, &Scope::new(&camera, 30.0, &boxes, &boxes, 64)).is_err());
    }
}
