//! Cameras from matrices, for engines that have nothing else at hand.

use crate::ShadowError;
use farsight_geometry::camera::DepthRange;
use farsight_geometry::{Camera, Projection};
use glam::{DMat3, DMat4, DQuat, DVec3, DVec4};

/// The camera of a view-projection matrix from world coordinates minus `origin`.
///
/// Any perspective of a symmetric frustum will do: right- or left-handed view space, y up or down, forward or reversed depth,
/// finite or infinite far plane. The range of depth must be said, since the matrix does not show it. `image_height` is that of the
/// image in pixels; its width follows from the matrix, rounded up so that nothing seen is left out.
///
/// # Accuracy
/// Eye and directions are as good as the matrix. The far distance is not: from an `f32` matrix with forward depth and a ratio of
/// far to near of 1e6 it comes back 9 % wrong, from 1e8 on as infinite. Only the near distance matters here:
/// the shadow distance is given in [`Scope`](crate::Scope).
///
/// # Errors
/// [`ShadowError::Matrix`] when the matrix is not finite, not invertible, not a perspective or not symmetric.
pub fn camera_from_matrix(
    clip_from_relative: &DMat4,
    origin: DVec3,
    depth: DepthRange,
    image_height: u32,
) -> Result<Camera, ShadowError> {
    let fail = |reason| ShadowError::Matrix { reason };
    let m = clip_from_relative;
    if !m.is_finite() {
        return Err(fail("an entry is not finite"));
    }
    let (x, y, z, w) = (m.row(0), m.row(1), m.row(2), m.row(3));
    let scale = w.truncate().length();
    if scale <= 1e-12 * w.w.abs() || scale == 0.0 {
        return Err(fail("the last row does not depend on the point: no perspective"));
    }
    let eye = eye(x, y, w).ok_or(fail("no eye: the rows of x, y and w are not independent"))?;
    let forward = w.truncate() / scale;
    let (right, tan_x) = axis(x, forward, scale).ok_or(fail("the frustum is not symmetric"))?;
    let (up, tan_y) = axis(y, forward, scale).ok_or(fail("the frustum is not symmetric"))?;
    if right.dot(up).abs() > 1e-3 {
        return Err(fail("the image's axes are not perpendicular"));
    }
    // Clip space may be mirrored (y down); the camera's image is not.
    let basis = DMat3::from_cols(right, right.cross(forward), -forward);
    // Depth = a + b / distance.
    let a = z.truncate().dot(forward) / scale;
    let b = z.dot(eye.extend(1.0)) / scale;
    let least = if depth == DepthRange::ZeroToOne { 0.0 } else { -1.0 };
    let (near_depth, far_depth) = if b > 0.0 { (1.0, least) } else { (least, 1.0) };
    let near = b / (near_depth - a);
    let far = b / (far_depth - a);
    if !(near > 0.0 && near.is_finite()) {
        return Err(fail("the near plane does not lie ahead of the eye"));
    }
    let far = if far > near && far.is_finite() { far } else { f64::INFINITY };
    let width = (f64::from(image_height) * tan_x / tan_y * (1.0 - 1e-6)).ceil();
    Camera::new(origin + eye, DQuat::from_mat3(&basis).normalize())
        .and_then(|c| c.with_projection(Projection::Perspective { fov_y: 2.0 * tan_y.atan() }))
        .and_then(|c| c.with_range(near, far))
        .and_then(|c| c.with_image(width as u32, image_height))
        .map_err(|_| fail("no camera has such a frustum"))
}

/// The point where x, y and w vanish.
fn eye(x: DVec4, y: DVec4, w: DVec4) -> Option<DVec3> {
    let rows = DMat3::from_cols(x.truncate(), y.truncate(), w.truncate()).transpose();
    let size = x.truncate().length() * y.truncate().length() * w.truncate().length();
    (rows.determinant().abs() > 1e-9 * size).then(|| rows.inverse() * -DVec3::new(x.w, y.w, w.w))
}

/// Unit direction of an image axis and the tangent of half its opening.
fn axis(row: DVec4, forward: DVec3, scale: f64) -> Option<(DVec3, f64)> {
    let row = row.truncate();
    let off_centre = row.dot(forward);
    let across = row - forward * off_centre;
    let length = across.length();
    (off_centre.abs() <= 1e-4 * scale && length > 0.0).then(|| (across / length, scale / length))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Focus, MapOptions, Scope, ShadowLight};
    use farsight_geometry::{ClipConvention, DAabb};
    use glam::dvec3;

    /// The same map, to 0.01 texel, whatever the convention of the matrix that the camera comes from.
    #[test]
    fn all_conventions_give_the_same_map() {
        let light = ShadowLight::directional(dvec3(0.3, -1.0, 0.2).normalize());
        for (far, eye) in
            [(200.0, DVec3::ZERO), (f64::INFINITY, dvec3(1e6, -4e5, 3.0)), (1e5, dvec3(9.0, 8.0, 7.0))]
        {
            let camera = Camera::look_at(eye, eye + dvec3(1.0, -0.1, 0.4), DVec3::Y)
                .unwrap()
                .with_range(0.1, far)
                .unwrap()
                .with_image(1920, 1080)
                .unwrap();
            let ground = [DAabb::new(eye - dvec3(300.0, 2.0, 300.0), eye + dvec3(300.0, 1.0, 300.0))];
            let map = |camera: &Camera| {
                let mut focus = Focus::new();
                let scope = Scope::new(camera, 150.0, &ground, &ground, 4096);
                assert_eq!(focus.fit(&light, &scope).unwrap(), None);
                (focus.map(&MapOptions::new(4096), None), focus)
            };
            let (expected, focus) = map(&camera);
            for convention in ClipConvention::all() {
                let matrix = camera.clip_from_relative_f64(convention, eye);
                let back = camera_from_matrix(&matrix, eye, convention.depth, 1080).unwrap();
                assert_eq!((back.width(), back.height()), (1920, 1080));
                assert!((back.near() / 0.1 - 1.0).abs() < 1e-6);
                let (view, _) = map(&back);
                for &p in focus.corners() {
                    let (a, b) =
                        (expected.map_position(eye + p).unwrap(), view.map_position(eye + p).unwrap());
                    let shift = (a[0] - b[0]).abs().max((a[1] - b[1]).abs()) * 4096.0;
                    assert!(shift < 0.01, "{convention:?} {far}: {shift} texels");
                }
            }
        }
    }

    #[test]
    fn matrices_that_are_no_camera_are_refused() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::X, DVec3::Y).unwrap();
        let good = camera.clip_from_relative_f64(ClipConvention::REVERSED, DVec3::ZERO);
        let from = |m: DMat4| camera_from_matrix(&m, DVec3::ZERO, DepthRange::ZeroToOne, 720);
        assert!(from(good).is_ok());
        let flat = camera.with_projection(Projection::Orthographic { height: 3.0 }).unwrap();
        let flat = flat.clip_from_relative_f64(ClipConvention::REVERSED, DVec3::ZERO);
        let mut asymmetric = good;
        asymmetric.x_axis.x += 0.2;
        for bad in [DMat4::ZERO, DMat4::IDENTITY, good * f64::NAN, flat, asymmetric] {
            assert!(matches!(from(bad), Err(ShadowError::Matrix { .. })), "{bad}");
        }
        assert!(camera_from_matrix(&good, DVec3::ZERO, DepthRange::ZeroToOne, 0).is_err());
    }
}
