//! Impostors: a picture on a plane through the object that faces the eye it was made for, and how wrong it is for another eye.

use crate::angle::{distance, turn_sine};
use crate::placement::SAME_STRETCH;
use crate::{LodError, Placement};
use farsight_geometry::accuracy::{ErrorBound, Unit};
use farsight_geometry::convex::hull_2d;
use farsight_geometry::{Camera, ClipConvention, DAabb, Frustum, Projection};
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec2, DVec3, DVec4};

/// How impostors are made.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ImpostorOptions {
    /// Texels to a pixel in the middle of the image, along each axis.
    pub texels_per_px: f64,
    /// Empty texels around the picture, so that filtering fades into nothing; at least 1.
    pub gutter: u32,
    /// Whether the picture is asked to have depth: other objects may then stand among its parts.
    pub depth: bool,
    /// Longest side of a picture in texels.
    pub max_side: u32,
}

impl Default for ImpostorOptions {
    /// One texel to a pixel, one texel of gutter, no depth, 2048 texels at most.
    fn default() -> Self {
        Self { texels_per_px: 1.0, gutter: 1, depth: false, max_side: 2048 }
    }
}

/// Bytes of a texel: red, green, blue, alpha in 8 bits each.
const COLOUR_BYTES: u64 = 4;
/// Bytes of a texel's depth.
const DEPTH_BYTES: u64 = 4;

/// Where an impostor's picture is, what it shows, and from where: everything but the picture.
///
/// The plane goes through the centre of the object's box and faces the eye; the picture is the smallest rectangle in it, in whole texels and with a gutter around,
/// that holds what is drawn of the object as seen from that eye. All positions are of the object's rigid frame ([`Placement`]).
///
/// # References
/// [Hilbert & Brunnett 2004, section 3]; Schaufler 1995. Differs: errors are bounded in pixels, the rectangle has the smallest area of all directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImpostorView {
    /// What stretches the object.
    stretch: DMat3,
    eye: DVec3,
    bounds: DAabb,
    /// To the right, up, and towards the eye.
    axes: DMat3,
    center: DVec3,
    /// Distance of the plane from the eye.
    distance: f64,
    /// Corners of the picture without gutter, in the plane, around `center`.
    min: DVec2,
    max: DVec2,
    /// Depths of what is drawn, along the view.
    near: f64,
    far: f64,
    /// Side of a texel in the plane.
    texel: f64,
    size: [u32; 2],
    options: ImpostorOptions,
    /// Farthest distance of a point from where the picture has it.
    offset: f64,
}

impl ImpostorView {
    /// The view of an object for the camera's eye. `bounds` is its box, `points` are the corners of the triangles of its current approximation, all in the rigid frame.
    ///
    /// # Cost
    /// About 30 ns a point.
    ///
    /// # Errors
    /// [`LodError::TooNear`] when a point is not before the eye, [`LodError::Parallel`] for a parallel camera, [`LodError::Texture`] when the picture
    /// would be larger than allowed, [`LodError::Placement`] when there is no point or a number is not finite, [`LodError::Option`] for options out of range.
    pub fn new(
        placement: &Placement,
        bounds: &DAabb,
        points: &[DVec3],
        camera: &Camera,
        options: &ImpostorOptions,
    ) -> Result<Self, LodError> {
        if !matches!(camera.projection(), Projection::Perspective { .. }) {
            return Err(LodError::Parallel);
        }
        options.check()?;
        let eye = placement.to_rigid(camera.eye());
        let center = bounds.center();
        let distance = eye.distance(center);
        if points.is_empty() || !(distance.is_finite() && bounds.min.is_finite() && bounds.max.is_finite()) {
            return Err(LodError::Placement);
        }
        // Positions of `f32` and rounding in the world say nothing about so small a distance.
        if distance <= 1e-9 * (center.length() + eye.length()) {
            return Err(LodError::TooNear);
        }
        let normal = (eye - center) / distance;
        let (near, far) = points.iter().fold((f64::INFINITY, 0.0f64), |(near, far), p| {
            let depth = normal.dot(eye - *p);
            (near.min(depth), far.max(depth))
        });
        // Nothing may be so near that the picture has no end.
        if near.is_nan() || near <= 1e-3 * distance {
            return Err(LodError::TooNear);
        }
        let (u, v) = normal.any_orthonormal_pair();
        let flat: Vec<DVec2> = points
            .iter()
            .map(|p| {
                let ray = *p - eye;
                DVec2::new(u.dot(ray), v.dot(ray)) * (distance / -normal.dot(ray))
            })
            .collect();
        let (direction, min, max) = smallest_rectangle(&flat);
        let axes =
            DMat3::from_cols(u * direction.x + v * direction.y, v * direction.x - u * direction.y, normal);
        let texel = distance / (camera.pixels_per_unit() * options.texels_per_px);
        Self {
            stretch: *placement.stretch(),
            eye,
            bounds: *bounds,
            axes,
            center,
            distance,
            min,
            max,
            near,
            far,
            texel,
            size: [0; 2],
            options: *options,
            offset: 0.0,
        }
        .in_whole_texels()
    }

    fn in_whole_texels(mut self) -> Result<Self, LodError> {
        let most = f64::from(self.options.max_side);
        let gutter = 2.0 * f64::from(self.options.gutter);
        // A hundredth of a texel for rounding.
        let count = ((self.max - self.min) / self.texel + 0.01).ceil().max(DVec2::ONE);
        let longest = count.max_element() + gutter;
        if longest.is_nan() || longest > most {
            return Err(LodError::Texture { side: longest, most: self.options.max_side });
        }
        let (middle, half) = (0.5 * (self.min + self.max), 0.5 * count * self.texel);
        (self.min, self.max) = (middle - half, middle + half);
        self.size = [(count.x + gutter) as u32, (count.y + gutter) as u32];
        // A point moves along its line of sight: by its distance from the plane over the cosine of that line, which is least at a corner of the picture.
        let farthest = self.min.abs().max(self.max.abs()).length();
        let off = (self.far - self.distance).max(self.distance - self.near);
        self.offset = off * (farthest / self.distance).hypot(1.0) * (1.0 + 1e-12);
        Ok(self)
    }

    /// The eye that it was made for.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// Box of the object.
    pub fn bounds(&self) -> &DAabb {
        &self.bounds
    }

    /// Width and height of the picture in texels, gutter included.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// How it was asked to be made.
    pub fn options(&self) -> &ImpostorOptions {
        &self.options
    }

    /// Memory of the picture with 8 bits a channel, and 32 for depth if it has that.
    pub fn bytes(&self) -> u64 {
        let depth = if self.options.depth { DEPTH_BYTES } else { 0 };
        u64::from(self.size[0]) * u64::from(self.size[1]) * (COLOUR_BYTES + depth)
    }

    /// The larger of the picture's width and height as shares of the camera's image.
    pub fn resolution_ratio(&self, camera: &Camera) -> f64 {
        let share = |a: u32, b: u32| f64::from(a) / f64::from(b);
        share(self.size[0], camera.width()).max(share(self.size[1], camera.height()))
    }

    /// Half the picture's extent beyond its middle, gutter included.
    fn outer(&self) -> (DVec2, DVec2) {
        let gutter = f64::from(self.options.gutter) * self.texel;
        (self.min - gutter, self.max + gutter)
    }

    /// Top left, top right, bottom right and bottom left corner of the picture, in the rigid frame, gutter included.
    pub fn corners(&self) -> [DVec3; 4] {
        let (min, max) = self.outer();
        let at = |x: f64, y: f64| self.center + self.axes.x_axis * x + self.axes.y_axis * y;
        [at(min.x, max.y), at(max.x, max.y), at(max.x, min.y), at(min.x, min.y)]
    }

    /// Where the centre of a texel is, in the rigid frame. Rows count from the top.
    pub fn texel_center(&self, column: u32, row: u32) -> DVec3 {
        let (min, max) = self.outer();
        let x = min.x + (f64::from(column) + 0.5) * self.texel;
        let y = max.y - (f64::from(row) + 0.5) * self.texel;
        self.center + self.axes.x_axis * x + self.axes.y_axis * y
    }

    /// Unit normal of the picture, towards the eye.
    pub fn normal(&self) -> DVec3 {
        self.axes.z_axis
    }

    /// Height above the picture, along its normal, of what has a depth (that of the view's clip space over its w) in a convention.
    pub fn height_of_depth(&self, depth: f64, convention: ClipConvention) -> f64 {
        let (near, far) = self.range();
        let (at_near, at_far) = convention.near_far_depth();
        // Depth is linear in the reciprocal distance.
        let share = (depth - at_near) / (at_far - at_near);
        self.distance - 1.0 / (1.0 / near + (1.0 / far - 1.0 / near) * share)
    }

    /// Near and far distance of the view volume: what is drawn lies strictly between.
    fn range(&self) -> (f64, f64) {
        (self.near * (1.0 - 1e-6), self.far * (1.0 + 1e-6))
    }

    /// Clip space of the picture from the rigid frame: the view volume from the eye through the picture.
    pub fn clip_from_rigid(&self, convention: ClipConvention) -> DMat4 {
        let (near, far) = self.range();
        let (min, max) = self.outer();
        let (min, max) = (min / self.distance, max / self.distance);
        // A view straight ahead that is wide enough for all, of which the picture is a part.
        let half = min.abs().max(max.abs()).max_element();
        let ahead = Camera::new(self.eye, DQuat::from_mat3(&self.axes))
            .and_then(|c| c.with_image(1, 1))
            .and_then(|c| c.with_projection(Projection::Perspective { fov_y: 2.0 * half.atan() }))
            .and_then(|c| c.with_range(near, far))
            .expect("the view was checked when it was made");
        let (scale, shift) = (2.0 * half / (max - min), -(max + min) / (max - min));
        let down = if convention.y_down { -1.0 } else { 1.0 };
        // Clip coordinates are shifted by a share of their w.
        let crop = DMat4::from_cols(
            DVec4::X * scale.x,
            DVec4::Y * scale.y,
            DVec4::Z,
            DVec4::new(shift.x, down * shift.y, 0.0, 1.0),
        );
        crop * ahead.clip_from_relative_f64(convention, DVec3::ZERO)
    }

    /// Clip space of the picture from positions relative to the mesh's origin: what a renderer needs.
    pub fn clip_from_mesh(&self, placement: &Placement, convention: ClipConvention) -> DMat4 {
        self.clip_from_rigid(convention) * DMat4::from_mat3(*placement.stretch())
    }

    /// The part of the world between the eye and the picture's outline, from the nearest to the farthest depth of what is drawn. Whatever stays out of it is
    /// nearer or farther than all of the object wherever both are seen, from any eye, and than the picture too.
    pub fn slab(&self, placement: &Placement) -> Frustum {
        let convention = ClipConvention::REVERSED;
        let rigid_from_relative = DAffine3::from_mat3(placement.rotation().transpose());
        let matrix = self.clip_from_rigid(convention) * DMat4::from(rigid_from_relative);
        Frustum::from_matrix(&matrix, placement.anchor(), 0.0)
    }

    /// Largest distance on the image, in pixels, between where the camera sees a point of the object that the picture shows, and where it sees it in the picture.
    ///
    /// # Accuracy
    /// Proven for every point that is in the image in either place, rounding included. The point P was moved along its line of sight from the old eye by at most
    /// δ, so that the two lines of sight from the new eye enclose an angle ψ with sin ψ ≤ δ·sin θ / d, θ the angle under which P sees the two eyes
    /// ([`view_angle`](crate::view_angle)) and d a distance from the new eye that no shown point falls below. Infinite with an eye so near that this says nothing, and for an object
    /// that has been stretched otherwise since.
    pub fn parallax(&self, placement: &Placement, camera: &Camera) -> ErrorBound {
        if !self.is_of(placement) {
            return ErrorBound::proven(f64::INFINITY, Unit::Pixels);
        }
        let sine = self
            .parallax_sine(placement.to_rigid(camera.eye()), placement.rounding(camera.eye(), &self.bounds));
        ErrorBound::proven(self.turned_px(sine, placement, camera), Unit::Pixels)
    }

    /// Whether the object is still stretched as it was when the view was made.
    pub(crate) fn is_of(&self, placement: &Placement) -> bool {
        placement.is_stretched_by(&self.stretch)
    }

    /// A bound on the sine of the angle between a point and its image, for an eye in the rigid frame; infinite where there is none.
    pub(crate) fn parallax_sine(&self, eye: DVec3, rounding: f64) -> f64 {
        let box_distance = distance(&self.bounds, eye) * (1.0 - 1e-12) - rounding;
        let offset = self.offset + rounding;
        if box_distance.is_nan() || box_distance <= offset {
            return f64::INFINITY;
        }
        // The line from the new eye to a shown point: not shorter than to the picture, nor than to the object less the way between.
        let to_picture = self.distance_to_picture(eye) * (1.0 - 1e-12) - rounding;
        let nearest = to_picture.max(box_distance - offset);
        let turned = self.offset * turn_sine(&self.bounds, self.eye, eye);
        (turned * (1.0 + 1e-12) + 2.0 * rounding) / nearest
    }

    /// Pixels that a direction turned by an angle of a known sine moves by, wherever in the image the object can be.
    pub(crate) fn turned_px(&self, sine: f64, placement: &Placement, camera: &Camera) -> f64 {
        if sine == 0.0 {
            return 0.0;
        }
        let corners = self.bounds.corners().into_iter().chain(self.corners());
        let around = DAabb::from_points(corners.map(|c| placement.to_world(c)));
        let distance = camera.distance_to_box(&around);
        let px = if distance > 0.0 {
            camera.box_error_px(sine * distance, &around)
        } else {
            camera.error_px(sine, 1.0)
        };
        px * SAME_STRETCH
    }

    /// Pixels between neighbouring texels in the middle of the image; towards its corners up to 1/cos² of the angle off the axis times that.
    pub fn texel_px(&self, eye: DVec3, camera: &Camera) -> f64 {
        camera.pixels_per_unit() * self.texel / self.distance_to_picture(eye)
    }

    /// Distance of the picture, without its gutter, from a point.
    fn distance_to_picture(&self, point: DVec3) -> f64 {
        let p = self.axes.transpose() * (point - self.center);
        let flat = p.truncate();
        (flat - flat.clamp(self.min, self.max)).extend(p.z).length()
    }
}

impl ImpostorOptions {
    pub(crate) fn check(&self) -> Result<(), LodError> {
        let bad = |option, value, range| Err(LodError::Option { option, value, range });
        if !(self.texels_per_px > 0.0 && self.texels_per_px.is_finite()) {
            return bad("texels_per_px", self.texels_per_px, "above 0 and finite");
        }
        if self.gutter == 0 {
            return bad("gutter", 0.0, "at least 1");
        }
        if self.max_side == 0 {
            return bad("max_side", 0.0, "at least 1");
        }
        Ok(())
    }
}

/// What an engine does to make an impostor's picture.
///
/// ```
/// use farsight_geometry::{ClipConvention, TriangleMesh};
/// use farsight_lod::{ImpostorRenderer, ImpostorView, Placement};
///
/// /// Draws into textures of some graphics interface.
/// struct Engine<'a> { meshes: &'a [TriangleMesh] }
///
/// impl ImpostorRenderer for Engine<'_> {
///     type Image = u32; // a handle
///     type Error = String;
///     fn render(&mut self, object: u32, view: &ImpostorView, place: &Placement, triangles: &[[u32; 3]]) -> Result<u32, String> {
///         let [width, height] = view.size();
///         let matrix = view.clip_from_mesh(place, ClipConvention::REVERSED);
///         // Clear a texture of width x height texels to transparent black; draw the triangles of `self.meshes[object]` with the matrix and
///         // with alpha 1 (premultiplied), lit as the object is; keep depth where `view.options().depth`.
///         # let _ = (matrix, width, height, triangles, self.meshes.get(object as usize));
///         Ok(7)
///     }
/// }
/// ```
pub trait ImpostorRenderer {
    /// A picture, or the engine's handle of one.
    type Image;
    /// Why there is none.
    type Error;

    /// Draws triangles of an object, its current approximation, into a picture of `view.size()` texels: premultiplied colour over transparent black.
    ///
    /// # Errors
    /// The engine's.
    fn render(
        &mut self,
        object: u32,
        view: &ImpostorView,
        placement: &Placement,
        triangles: &[[u32; 3]],
    ) -> Result<Self::Image, Self::Error>;
}

/// The direction, and the corners in its axes, of the rectangle of smallest area around points.
///
/// One side of it lies along a side of the points' hull (Freeman & Shapira 1975).
fn smallest_rectangle(points: &[DVec2]) -> (DVec2, DVec2, DVec2) {
    let outline = outline(points);
    let hull: Vec<DVec2> = hull_2d(&outline).into_iter().map(|i| outline[i as usize]).collect();
    let along = |x: DVec2| {
        let start = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        hull.iter().fold(start, |(min, max), p| {
            let q = DVec2::new(x.dot(*p), x.perp_dot(*p));
            (min.min(q), max.max(q))
        })
    };
    let mut best = (f64::INFINITY, DVec2::X);
    for i in 0..hull.len() {
        let side = (hull[(i + 1) % hull.len()] - hull[i]).normalize_or(DVec2::X);
        let (min, max) = along(side);
        let area = (max - min).element_product();
        if area < best.0 {
            best = (area, side);
        }
    }
    let (min, max) = along(best.1);
    (best.1, min, max)
}

/// The points that are not strictly inside the polygon of those farthest in eight directions: all that a hull needs.
fn outline(points: &[DVec2]) -> Vec<DVec2> {
    const DIRECTIONS: usize = 8;
    if points.len() < 8 * DIRECTIONS {
        return points.to_vec();
    }
    let directions: [DVec2; DIRECTIONS] =
        std::array::from_fn(|i| DVec2::from_angle(std::f64::consts::TAU * i as f64 / DIRECTIONS as f64));
    let mut farthest = [(f64::NEG_INFINITY, DVec2::ZERO); DIRECTIONS];
    for p in points {
        for (d, best) in directions.iter().zip(&mut farthest) {
            let along = d.dot(*p);
            if along > best.0 {
                *best = (along, *p);
            }
        }
    }
    let polygon = farthest.map(|f| f.1);
    let inside = |p: &DVec2| {
        (0..DIRECTIONS).all(|i| {
            let (a, b) = (polygon[i], polygon[(i + 1) % DIRECTIONS]);
            a == b || (b - a).perp_dot(*p - a) > 0.0
        })
    };
    points.iter().copied().filter(|p| !inside(p)).chain(polygon).collect()
}

#[cfg(test)]
mod tests;
