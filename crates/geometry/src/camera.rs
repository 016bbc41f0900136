//! Cameras: where the eye is, how it projects, and what a pixel is worth in the world.
//!
//! A camera is kept in `f64` and knows nothing of matrices' conventions; [`ClipConvention`] names the one that an
//! engine uses when a matrix is asked for. Matrices come out relative to a point near the eye, so that `f32`
//! entries lose nothing far from the world's origin.
//!
//! View space is right-handed here: x right, y up, the camera looks along −z. Pixels count from the top left
//! corner, pixel centres lie at half-integers.

use crate::bounds::{DAabb, Sphere};
use crate::ray::Ray;
use glam::{DMat4, DQuat, DVec2, DVec3, DVec4, Mat4};

/// How a camera maps view space to its image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Central projection.
    Perspective {
        /// Full vertical opening angle, in radians.
        fov_y: f64,
    },
    /// Parallel projection.
    Orthographic {
        /// Height of the visible rectangle, in world units.
        height: f64,
    },
}

impl Projection {
    /// Half the image's height: a tangent for a perspective, world units for a parallel projection.
    fn half_height(&self) -> f64 {
        match *self {
            Self::Perspective { fov_y } => (0.5 * fov_y).tan(),
            Self::Orthographic { height } => 0.5 * height,
        }
    }
}

/// The range of depth in clip space after division by w.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DepthRange {
    /// 0 to 1: Direct3D, Metal, Vulkan, wgpu.
    ZeroToOne,
    /// −1 to 1: OpenGL.
    MinusOneToOne,
}

/// Handedness of the view space that a matrix expects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Handedness {
    /// The camera looks along −z.
    Right,
    /// The camera looks along +z.
    Left,
}

/// Everything on which graphics interfaces disagree about clip space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ClipConvention {
    /// Handedness of view space.
    pub handedness: Handedness,
    /// Range of depth.
    pub depth: DepthRange,
    /// Whether the near plane has the largest depth.
    pub reversed: bool,
    /// Whether clip space's y points down (Vulkan).
    pub y_down: bool,
}

impl ClipConvention {
    /// wgpu, Direct3D and Metal with reversed depth; what Farsight's own renderer uses.
    pub const REVERSED: Self = Self { reversed: true, ..Self::ZERO_TO_ONE };
    /// wgpu, Direct3D and Metal, nearest depth 0.
    pub const ZERO_TO_ONE: Self =
        Self { handedness: Handedness::Right, depth: DepthRange::ZeroToOne, reversed: false, y_down: false };
    /// OpenGL.
    pub const OPENGL: Self = Self { depth: DepthRange::MinusOneToOne, ..Self::ZERO_TO_ONE };
    /// Vulkan without a flipped viewport.
    pub const VULKAN: Self = Self { y_down: true, ..Self::ZERO_TO_ONE };

    /// All sixteen combinations, for tests.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..16u32).map(|i| Self {
            handedness: if i & 1 == 0 { Handedness::Right } else { Handedness::Left },
            depth: if i & 2 == 0 { DepthRange::ZeroToOne } else { DepthRange::MinusOneToOne },
            reversed: i & 4 != 0,
            y_down: i & 8 != 0,
        })
    }

    /// Depths after division at the near and at the far plane.
    pub fn near_far_depth(&self) -> (f64, f64) {
        let least = match self.depth {
            DepthRange::ZeroToOne => 0.0,
            DepthRange::MinusOneToOne => -1.0,
        };
        if self.reversed { (1.0, least) } else { (least, 1.0) }
    }
}

/// Why a camera was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// The eye is NaN or infinite.
    #[error("the eye {eye} is not finite")]
    Eye {
        /// The eye.
        eye: DVec3,
    },
    /// The orientation is not a unit quaternion, or no direction could be made from the target.
    #[error(
        "the camera has no direction: rotation not of unit length, target at the eye, or up along the view"
    )]
    Orientation,
    /// The opening angle is not between 0 and π, or the height not positive.
    #[error("projection {projection:?}: the angle must lie in (0, π), the height must be positive")]
    Projection {
        /// The projection.
        projection: Projection,
    },
    /// Near and far do not satisfy 0 < near < far (orthographic: near < far, both finite).
    #[error("near {near} and far {far}: perspective needs 0 < near < far, orthographic finite near < far")]
    Range {
        /// Near distance.
        near: f64,
        /// Far distance.
        far: f64,
    },
    /// A side of the image is zero.
    #[error("an image of {width} x {height} pixels: both sides must be at least 1")]
    Image {
        /// Width.
        width: u32,
        /// Height.
        height: u32,
    },
}

/// A validated camera with square pixels.
///
/// ```
/// use farsight_geometry::{Camera, Projection, Sphere, glam::{DVec3, dvec3}};
///
/// let camera = Camera::look_at(DVec3::ZERO, dvec3(0.0, 0.0, -1.0), DVec3::Y)?
///     .with_projection(Projection::Perspective { fov_y: 1.0 })?
///     .with_image(1920, 1080)?;
/// // A ball of 1 m at 10 m, first straight ahead, then off to the side: the edge of the image stretches it.
/// let ahead = camera.sphere_px(&Sphere { center: dvec3(0.0, 0.0, -10.0), radius: 0.5 });
/// let aside = camera.sphere_px(&Sphere { center: dvec3(7.0, 0.0, -7.1), radius: 0.5 });
/// assert!((98.0..100.0).contains(&ahead) && aside > 1.9 * ahead);
/// # Ok::<(), farsight_geometry::CameraError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    eye: DVec3,
    world_from_view: DQuat,
    projection: Projection,
    /// See [`Projection::half_height`]; kept, as everything that is done with a camera asks for it.
    half_height: f64,
    near: f64,
    far: f64,
    width: u32,
    height: u32,
}

impl Camera {
    /// A camera at `eye` that looks at `target`: 60° vertical opening, near 0.1, far infinite, 1280 x 720 pixels.
    ///
    /// # Errors
    /// When the eye is not finite, or `target` or `up` give no direction.
    pub fn look_at(eye: DVec3, target: DVec3, up: DVec3) -> Result<Self, CameraError> {
        if !eye.is_finite() {
            return Err(CameraError::Eye { eye });
        }
        let back = (eye - target).try_normalize().ok_or(CameraError::Orientation)?;
        // Squares of tiny vectors underflow: bring `up` to unit length before the cross product.
        let up = up.try_normalize().ok_or(CameraError::Orientation)?;
        let right = up.cross(back);
        if right.length() < 1e-9 {
            return Err(CameraError::Orientation);
        }
        let right = right.normalize();
        let basis = glam::DMat3::from_cols(right, back.cross(right), back);
        Self::new(eye, DQuat::from_mat3(&basis).normalize())
    }

    /// A camera at `eye` whose axes in the world are `world_from_view` times x (right), y (up), −z (ahead).
    ///
    /// # Errors
    /// When the eye is not finite or the quaternion not of unit length.
    pub fn new(eye: DVec3, world_from_view: DQuat) -> Result<Self, CameraError> {
        if !eye.is_finite() {
            return Err(CameraError::Eye { eye });
        }
        // Quaternions that were normalised in f32 are close enough; the rest is normalised away.
        if !(world_from_view.is_finite() && (world_from_view.length() - 1.0).abs() < 1e-5) {
            return Err(CameraError::Orientation);
        }
        let projection = Projection::Perspective { fov_y: std::f64::consts::FRAC_PI_3 };
        Ok(Self {
            eye,
            world_from_view: world_from_view.normalize(),
            projection,
            half_height: projection.half_height(),
            near: 0.1,
            far: f64::INFINITY,
            width: 1280,
            height: 720,
        })
    }

    /// The camera with another projection.
    ///
    /// # Errors
    /// When the angle is not in (0, π), the height not positive, or the planes do not suit the projection.
    pub fn with_projection(self, projection: Projection) -> Result<Self, CameraError> {
        let usable = match projection {
            Projection::Perspective { fov_y } => fov_y > 0.0 && fov_y < std::f64::consts::PI,
            Projection::Orthographic { height } => height > 0.0 && height.is_finite(),
        };
        if !usable {
            return Err(CameraError::Projection { projection });
        }
        // A parallel projection has no infinite far plane; leave that to an explicit call of `with_range`.
        let far = match projection {
            Projection::Orthographic { .. } if self.far.is_infinite() => 1e6 * self.near.abs().max(1.0),
            _ => self.far,
        };
        Self { projection, half_height: projection.half_height(), ..self }.with_range(self.near, far)
    }

    /// The camera with other near and far distances; `far` may be infinite for a perspective.
    ///
    /// # Errors
    /// When 0 < near < far does not hold (orthographic: near < far, both finite).
    pub fn with_range(self, near: f64, far: f64) -> Result<Self, CameraError> {
        let usable = match self.projection {
            Projection::Perspective { .. } => near > 0.0 && near.is_finite() && far > near,
            Projection::Orthographic { .. } => near.is_finite() && far.is_finite() && near < far,
        };
        if usable { Ok(Self { near, far, ..self }) } else { Err(CameraError::Range { near, far }) }
    }

    /// The camera with another image size.
    ///
    /// # Errors
    /// When a side is zero.
    pub fn with_image(self, width: u32, height: u32) -> Result<Self, CameraError> {
        if width == 0 || height == 0 {
            return Err(CameraError::Image { width, height });
        }
        Ok(Self { width, height, ..self })
    }

    /// The eye.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// Rotation from view to world axes.
    pub fn world_from_view(&self) -> DQuat {
        self.world_from_view
    }

    /// The projection.
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// Near distance.
    pub fn near(&self) -> f64 {
        self.near
    }

    /// Far distance; may be infinite.
    pub fn far(&self) -> f64 {
        self.far
    }

    /// Image width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Image height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Unit vector to the right of the image.
    pub fn right(&self) -> DVec3 {
        self.world_from_view * DVec3::X
    }

    /// Unit vector to the top of the image.
    pub fn up(&self) -> DVec3 {
        self.world_from_view * DVec3::Y
    }

    /// Unit vector ahead.
    pub fn forward(&self) -> DVec3 {
        self.world_from_view * DVec3::NEG_Z
    }

    /// Half-width and half-height of the image: tangents for a perspective, world units for a parallel projection.
    pub fn half_extent(&self) -> DVec2 {
        let half = self.half_height;
        DVec2::new(half * f64::from(self.width) / f64::from(self.height), half)
    }

    /// Pixels per unit of tangent (perspective) or per world unit (parallel).
    pub fn pixels_per_unit(&self) -> f64 {
        0.5 * f64::from(self.height) / self.half_height
    }

    /// A world point in view space.
    pub fn to_view(&self, point: DVec3) -> DVec3 {
        self.world_from_view.conjugate() * (point - self.eye)
    }

    /// Clip space from view space, in the convention's handedness.
    pub fn clip_from_view(&self, convention: ClipConvention) -> DMat4 {
        let half = self.half_extent();
        let (near_depth, far_depth) = convention.near_far_depth();
        let (near, far) = (self.near, self.far);
        // Depth is a + b·d for distance d ahead (parallel), or (a·d + b) / d (perspective).
        let (row_z, row_w) = match self.projection {
            Projection::Perspective { .. } if far.is_infinite() => {
                ((far_depth, near * (near_depth - far_depth)), (1.0, 0.0))
            }
            Projection::Perspective { .. } => {
                let a = (far * far_depth - near * near_depth) / (far - near);
                ((a, near * (near_depth - a)), (1.0, 0.0))
            }
            Projection::Orthographic { .. } => {
                let slope = (far_depth - near_depth) / (far - near);
                ((slope, near_depth - near * slope), (0.0, 1.0))
            }
        };
        let ahead = match convention.handedness {
            Handedness::Right => -1.0,
            Handedness::Left => 1.0,
        };
        let y = if convention.y_down { -1.0 } else { 1.0 };
        DMat4::from_cols(
            DVec4::new(1.0 / half.x, 0.0, 0.0, 0.0),
            DVec4::new(0.0, y / half.y, 0.0, 0.0),
            DVec4::new(0.0, 0.0, row_z.0 * ahead, row_w.0 * ahead),
            DVec4::new(0.0, 0.0, row_z.1, row_w.1),
        )
    }

    /// View space, in the given handedness, from world coordinates relative to `origin`.
    pub fn view_from_relative(&self, handedness: Handedness, origin: DVec3) -> DMat4 {
        let rotation = self.world_from_view.conjugate();
        let view = DMat4::from_rotation_translation(rotation, rotation * (origin - self.eye));
        match handedness {
            Handedness::Right => view,
            Handedness::Left => DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0)) * view,
        }
    }

    /// Clip space from world coordinates relative to `origin`, built in `f64`.
    ///
    /// With `origin` at or near the eye, or at the mesh's own origin, the `f32` matrix of
    /// [`clip_from_relative`](Self::clip_from_relative) stays accurate anywhere in the world.
    pub fn clip_from_relative_f64(&self, convention: ClipConvention, origin: DVec3) -> DMat4 {
        self.clip_from_view(convention) * self.view_from_relative(convention.handedness, origin)
    }

    /// [`clip_from_relative_f64`](Self::clip_from_relative_f64) rounded to `f32`, as graphics interfaces take it.
    pub fn clip_from_relative(&self, convention: ClipConvention, origin: DVec3) -> Mat4 {
        self.clip_from_relative_f64(convention, origin).as_mat4()
    }

    /// Pixel position of a world point, and its distance along the view direction. `None` unless it lies ahead of
    /// the eye (perspective). Points outside the image or before the near plane are projected as well.
    pub fn project(&self, point: DVec3) -> Option<(DVec2, f64)> {
        let view = self.to_view(point);
        self.view_to_px(view).map(|px| (px, -view.z))
    }

    fn view_to_px(&self, view: DVec3) -> Option<DVec2> {
        let scale = match self.projection {
            Projection::Perspective { .. } if view.z < 0.0 => self.pixels_per_unit() / -view.z,
            Projection::Perspective { .. } => return None,
            Projection::Orthographic { .. } => self.pixels_per_unit(),
        };
        let center = 0.5 * DVec2::new(f64::from(self.width), f64::from(self.height));
        Some(center + DVec2::new(view.x, -view.y) * scale)
    }

    /// The ray through a pixel position, from the eye (perspective) or the near plane (parallel) on.
    pub fn ray(&self, px: DVec2) -> Ray {
        let center = 0.5 * DVec2::new(f64::from(self.width), f64::from(self.height));
        let offset = (px - center) / self.pixels_per_unit();
        let (origin, direction) = match self.projection {
            Projection::Perspective { .. } => (DVec3::ZERO, DVec3::new(offset.x, -offset.y, -1.0)),
            Projection::Orthographic { .. } => (DVec3::new(offset.x, -offset.y, -self.near), DVec3::NEG_Z),
        };
        Ray::new(self.eye + self.world_from_view * origin, self.world_from_view * direction)
            .expect("a validated camera has finite rays")
    }

    /// Exact length in pixels of the longest extent of a sphere's image: the major axis of its ellipse.
    ///
    /// Infinite when the sphere reaches the plane of the eye, since its image is then unbounded. The image is not
    /// clipped by the screen.
    pub fn sphere_px(&self, sphere: &Sphere) -> f64 {
        let r = sphere.radius;
        let view = self.to_view(sphere.center);
        match self.projection {
            Projection::Orthographic { .. } => 2.0 * r * self.pixels_per_unit(),
            Projection::Perspective { .. } => {
                let (x_sq, z) = (view.x * view.x + view.y * view.y, -view.z);
                if z <= r {
                    return if r == 0.0 && z > 0.0 { 0.0 } else { f64::INFINITY };
                }
                // tan(θ + α) − tan(θ − α) for axis angle θ and half-angle α = asin(r / distance).
                let denominator = (z - r) * (z + r);
                2.0 * self.pixels_per_unit() * r * (x_sq + denominator).sqrt() / denominator
            }
        }
    }

    /// Exact diameter in pixels of the image of that part of a box that lies beyond the near plane; zero when no
    /// part does. The image is not clipped by the screen.
    pub fn box_px(&self, b: &DAabb) -> f64 {
        if b.is_empty() {
            return 0.0;
        }
        let corners = b.corners().map(|c| self.to_view(c));
        let near = match self.projection {
            Projection::Perspective { .. } => self.near,
            Projection::Orthographic { .. } => f64::NEG_INFINITY,
        };
        // The convex hull of the clipped box is spanned by its corners ahead and its edges' cuts.
        let mut points = [DVec2::ZERO; 20];
        let mut count = 0;
        let mut push = |view: DVec3| {
            if let Some(px) = self.view_to_px(view) {
                points[count] = px;
                count += 1;
            }
        };
        corners.iter().filter(|c| -c.z >= near).for_each(|&c| push(c));
        for i in 0..8usize {
            for axis in [1, 2, 4] {
                let j = i | axis;
                let (di, dj) = (-corners[i].z - near, -corners[j].z - near);
                if j != i && (di < 0.0) != (dj < 0.0) {
                    push(corners[i].lerp(corners[j], di / (di - dj)).with_z(-near));
                }
            }
        }
        let points = &points[..count];
        let farthest =
            |(i, p): (usize, &DVec2)| points[i..].iter().map(|q| p.distance(*q)).fold(0.0, f64::max);
        points.iter().enumerate().map(farthest).fold(0.0, f64::max)
    }

    /// Largest angle between the view direction and a visible point, in radians: half the opening along the image's diagonal. Zero for a parallel
    /// projection.
    pub fn half_diagonal(&self) -> f64 {
        match self.projection {
            Projection::Perspective { .. } => self.half_extent().length().atan(),
            Projection::Orthographic { .. } => 0.0,
        }
    }

    /// Distance from the eye to the nearest point of a box; zero inside.
    pub fn distance_to_box(&self, b: &DAabb) -> f64 {
        b.closest_point(self.eye).distance(self.eye)
    }

    /// How many pixels a point may move on the screen when it moves by `error` in the world, wherever on the screen it is.
    ///
    /// `distance` is that from the eye to the point; take the nearest point of a box for all its points. Sound for
    /// every point that is seen before or after it moves, off-axis stretch included; infinite when the move may
    /// leave the half-space ahead. A ball of radius e at distance d and angle θ off the axis covers the angles θ ± α with
    /// α = asin(e/d), so f·(tan(θ + α) − tan θ) at the image's corner bounds the shift.
    pub fn error_px(&self, error: f64, distance: f64) -> f64 {
        self.error_px_within(error, distance, self.half_diagonal())
    }

    /// [`error_px`](Self::error_px) for all points of a box, using where on the screen the box can be.
    pub fn box_error_px(&self, error: f64, b: &DAabb) -> f64 {
        let sphere = Sphere::around_box(b);
        let view = self.to_view(sphere.center);
        let from_axis = view.truncate().length().atan2(-view.z);
        let spread = sphere.radius / view.length();
        let largest = if spread < 1.0 { from_axis + spread.asin() } else { f64::INFINITY };
        self.error_px_within(error, self.distance_to_box(b), largest.min(self.half_diagonal()))
    }

    fn error_px_within(&self, error: f64, distance: f64, off_axis: f64) -> f64 {
        match self.projection {
            Projection::Orthographic { .. } => error * self.pixels_per_unit(),
            Projection::Perspective { .. } => {
                if error == 0.0 {
                    return 0.0;
                }
                if error >= distance {
                    return f64::INFINITY;
                }
                let outer = off_axis + (error / distance).asin();
                if outer >= std::f64::consts::FRAC_PI_2 {
                    return f64::INFINITY;
                }
                self.pixels_per_unit() * (outer.tan() - off_axis.tan())
            }
        }
    }

    /// The largest world error that moves a point at `distance` by at most `px` pixels anywhere on the screen: the inverse of [`error_px`](Self::error_px).
    pub fn world_error(&self, px: f64, distance: f64) -> f64 {
        match self.projection {
            Projection::Orthographic { .. } => px / self.pixels_per_unit(),
            Projection::Perspective { .. } => {
                let corner = self.half_diagonal();
                let outer = (corner.tan() + px / self.pixels_per_unit()).atan();
                distance * (outer - corner).sin()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    fn camera() -> Camera {
        Camera::look_at(dvec3(1.0, 2.0, 3.0), dvec3(4.0, -1.0, -7.0), DVec3::Y)
            .unwrap()
            .with_image(800, 600)
            .unwrap()
            .with_range(0.5, 100.0)
            .unwrap()
    }

    fn variants() -> Vec<Camera> {
        let c = camera();
        vec![
            c,
            c.with_range(0.5, f64::INFINITY).unwrap(),
            c.with_projection(Projection::Orthographic { height: 12.0 }).unwrap(),
        ]
    }

    #[test]
    fn near_and_far_reach_the_ends_of_every_convention() {
        for camera in variants() {
            for convention in ClipConvention::all() {
                let m = camera.clip_from_relative_f64(convention, DVec3::ZERO);
                let depth = |d: f64| {
                    let clip = m * (camera.eye() + camera.forward() * d).extend(1.0);
                    clip.z / clip.w
                };
                let (near, far) = convention.near_far_depth();
                assert!((depth(camera.near()) - near).abs() < 1e-9, "{convention:?}");
                let last = if camera.far().is_finite() { camera.far() } else { 1e12 };
                assert!((depth(last) - far).abs() < 1e-9, "{convention:?}");
            }
        }
    }

    #[test]
    fn matrix_projection_and_rays_agree() {
        for camera in variants() {
            for convention in ClipConvention::all() {
                let point = dvec3(3.5, -0.2, -6.0);
                let clip = camera.clip_from_relative_f64(convention, camera.eye())
                    * (point - camera.eye()).extend(1.0);
                let (px, depth) = camera.project(point).unwrap();
                let y = if convention.y_down { clip.y / clip.w } else { -clip.y / clip.w };
                let from_clip = DVec2::new((clip.x / clip.w + 1.0) * 400.0, (y + 1.0) * 300.0);
                assert!(px.distance(from_clip) < 1e-8 && depth > 0.0);
                let ray = camera.ray(px);
                let along = (point - ray.origin()).dot(ray.direction());
                assert!((ray.origin() + along * ray.direction()).distance(point) < 1e-9);
            }
        }
    }

    #[test]
    fn f32_matrices_stay_accurate_far_from_the_origin() {
        let far = dvec3(4.8e5, 5.4e6, 120.0);
        let camera = Camera::look_at(far, far + dvec3(1.0, 0.2, -0.3), DVec3::Z).unwrap();
        let point = far + dvec3(20.0, 3.0, -4.0);
        let clip =
            camera.clip_from_relative(ClipConvention::REVERSED, far) * (point - far).as_vec3().extend(1.0);
        let px = (f64::from(clip.x / clip.w) + 1.0) * 640.0;
        assert!((px - camera.project(point).unwrap().0.x).abs() < 1e-3);
    }

    /// Extent of a sphere's image by sampling its silhouette densely.
    fn sampled_sphere_px(camera: &Camera, sphere: &Sphere) -> f64 {
        let mut points = Vec::new();
        for i in 0..400 {
            let (theta, rest) = (std::f64::consts::PI * f64::from(i) / 399.0, 400);
            for j in 0..rest {
                let phi = std::f64::consts::TAU * f64::from(j) / f64::from(rest);
                let n = dvec3(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
                points.push(camera.project(sphere.center + n * sphere.radius).unwrap().0);
            }
        }
        // The major axis points away from the image's centre.
        let axis = (camera.project(sphere.center).unwrap().0 - DVec2::new(400.0, 300.0)).normalize();
        let along = points.iter().map(|p| p.dot(axis));
        along.clone().fold(f64::MIN, f64::max) - along.fold(f64::MAX, f64::min)
    }

    #[test]
    fn sphere_size_matches_sampling_even_off_axis() {
        let camera = camera();
        for (right, ahead, radius) in [(0.5, 8.0, 1.0), (6.0, 7.0, 1.0), (2.0, 1.6, 1.0), (9.0, 6.0, 0.1)] {
            let center = camera.eye() + camera.right() * right + camera.forward() * ahead;
            let sphere = Sphere { center, radius };
            let (exact, sampled) = (camera.sphere_px(&sphere), sampled_sphere_px(&camera, &sphere));
            assert!(sampled <= exact * (1.0 + 1e-9) && exact < sampled * 1.001, "{exact} {sampled}");
        }
        let around_eye = Sphere { center: camera.eye(), radius: 1.0 };
        assert!(camera.sphere_px(&around_eye).is_infinite());
    }

    #[test]
    fn box_size_is_the_diameter_of_the_clipped_image() {
        let camera =
            Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y).unwrap().with_image(800, 800).unwrap();
        let f = camera.pixels_per_unit();
        let b = DAabb::new(dvec3(-1.0, -1.0, -12.0), dvec3(1.0, 1.0, -10.0));
        assert!((camera.box_px(&b) - f * 2.0 * 2f64.sqrt() / 10.0).abs() < 1e-9);
        let through_the_eye = DAabb::new(dvec3(-1.0, -1.0, -1.0), dvec3(1.0, 1.0, 1.0));
        assert!((camera.box_px(&through_the_eye) - f * 2.0 * 2f64.sqrt() / camera.near()).abs() < 1e-6);
        let behind = DAabb::new(dvec3(-1.0, -1.0, 1.0), dvec3(1.0, 1.0, 2.0));
        assert_eq!((camera.box_px(&behind), camera.box_px(&DAabb::EMPTY)), (0.0, 0.0));
    }

    #[test]
    fn pixel_error_is_never_exceeded_and_its_inverse_agrees() {
        let camera = camera();
        let corner = camera.half_extent();
        let mut seed = 1u64;
        let mut random = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0
        };
        let mut tightest = 0.0f64;
        for _ in 0..20_000 {
            let ahead = 5.0 * (random() * 2.0).exp2();
            let view = dvec3(random() * corner.x * ahead, random() * corner.y * ahead, -ahead);
            let point = camera.eye() + camera.world_from_view() * view;
            let error = 0.3 * random().abs() * ahead;
            let moved = point + dvec3(random(), random(), random()).normalize() * error;
            let Some((after, _)) = camera.project(moved) else { continue };
            let shift = camera.project(point).unwrap().0.distance(after);
            let bound = camera.error_px(error, view.length());
            assert!(shift <= bound, "{shift} > {bound}");
            assert!(shift <= camera.box_error_px(error, &DAabb::from_points([point])) * (1.0 + 1e-9));
            tightest = tightest.max(shift / bound);
            let back = camera.error_px(camera.world_error(2.0, view.length()), view.length());
            assert!((back - 2.0).abs() < 1e-6);
        }
        assert!(tightest > 0.5, "the bound should not be loose: {tightest}");
        assert!(camera.error_px(2.0, 1.0).is_infinite() && camera.error_px(0.0, 0.0) == 0.0);
    }

    #[test]
    fn unusable_cameras_are_refused() {
        assert!(Camera::look_at(DVec3::ZERO, DVec3::ZERO, DVec3::Y).is_err());
        assert!(Camera::look_at(DVec3::ZERO, DVec3::Y, DVec3::Y).is_err());
        assert!(Camera::look_at(DVec3::NAN, DVec3::Y, DVec3::X).is_err());
        assert!(Camera::new(DVec3::ZERO, DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0)).is_err());
        let c = camera();
        assert!(c.with_projection(Projection::Perspective { fov_y: 3.2 }).is_err());
        assert!(c.with_projection(Projection::Orthographic { height: 0.0 }).is_err());
        assert!(c.with_range(0.0, 1.0).is_err() && c.with_range(2.0, 1.0).is_err());
        assert!(c.with_range(f64::NAN, 1.0).is_err() && c.with_image(0, 5).is_err());
    }
}
