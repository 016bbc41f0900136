//! Axis-aligned boxes and spheres.

use crate::rounding::{f32_down, f32_up};
use glam::{DAffine3, DVec3, Vec3};

macro_rules! aabb {
    ($(#[$doc:meta])* $name:ident, $vec:ty, $scalar:ty) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name {
            /// Smallest corner.
            pub min: $vec,
            /// Largest corner.
            pub max: $vec,
        }

        impl Default for $name {
            /// [`EMPTY`](Self::EMPTY).
            fn default() -> Self {
                Self::EMPTY
            }
        }

        impl $name {
            /// Contains nothing; the neutral element of [`union`](Self::union).
            pub const EMPTY: Self = Self {
                min: <$vec>::splat(<$scalar>::INFINITY),
                max: <$vec>::splat(<$scalar>::NEG_INFINITY),
            };

            /// The box between two corners; empty where `min` exceeds `max` on any axis.
            pub const fn new(min: $vec, max: $vec) -> Self {
                Self { min, max }
            }

            /// The smallest box around `points`.
            pub fn from_points(points: impl IntoIterator<Item = $vec>) -> Self {
                points.into_iter().fold(Self::EMPTY, |b, p| b.with_point(p))
            }

            /// Whether the box contains no point. A flat box is not empty.
            pub fn is_empty(&self) -> bool {
                !self.min.cmple(self.max).all()
            }

            /// The box grown to contain `point`.
            #[must_use]
            pub fn with_point(self, point: $vec) -> Self {
                Self { min: self.min.min(point), max: self.max.max(point) }
            }

            /// The smallest box around both.
            #[must_use]
            pub fn union(self, other: Self) -> Self {
                Self { min: self.min.min(other.min), max: self.max.max(other.max) }
            }

            /// What both contain; may be empty.
            #[must_use]
            pub fn intersection(self, other: Self) -> Self {
                Self { min: self.min.max(other.min), max: self.max.min(other.max) }
            }

            /// The box grown by `margin` on all sides.
            #[must_use]
            pub fn inflated(self, margin: $scalar) -> Self {
                if self.is_empty() {
                    return Self::EMPTY;
                }
                Self { min: self.min - <$vec>::splat(margin), max: self.max + <$vec>::splat(margin) }
            }

            /// Centre; meaningless for an empty box.
            pub fn center(&self) -> $vec {
                self.min * 0.5 + self.max * 0.5
            }

            /// Edge lengths; zero for an empty box.
            pub fn extent(&self) -> $vec {
                if self.is_empty() { <$vec>::ZERO } else { self.max - self.min }
            }

            /// Length of the diagonal; zero for an empty box.
            pub fn diagonal(&self) -> $scalar {
                self.extent().length()
            }

            /// Surface area; zero for an empty box.
            pub fn area(&self) -> $scalar {
                let e = self.extent();
                2.0 * (e.x * e.y + e.y * e.z + e.z * e.x)
            }

            /// Whether `point` lies in the box, faces included.
            pub fn contains(&self, point: $vec) -> bool {
                self.min.cmple(point).all() && point.cmple(self.max).all()
            }

            /// Whether `other` lies wholly inside. True for an empty `other`.
            pub fn contains_box(&self, other: &Self) -> bool {
                other.is_empty() || (self.contains(other.min) && self.contains(other.max))
            }

            /// Whether the boxes share a point, touching included.
            pub fn overlaps(&self, other: &Self) -> bool {
                !self.intersection(*other).is_empty()
            }

            /// The point of the box closest to `point`.
            pub fn closest_point(&self, point: $vec) -> $vec {
                point.max(self.min).min(self.max)
            }

            /// The eight corners; bit 0, 1, 2 of the index select `max` on x, y, z.
            pub fn corners(&self) -> [$vec; 8] {
                std::array::from_fn(|i| {
                    <$vec>::new(
                        if i & 1 == 0 { self.min.x } else { self.max.x },
                        if i & 2 == 0 { self.min.y } else { self.max.y },
                        if i & 4 == 0 { self.min.z } else { self.max.z },
                    )
                })
            }
        }
    };
}

aabb!(
    /// Axis-aligned box in `f32`, for local coordinates.
    Aabb, Vec3, f32
);
aabb!(
    /// Axis-aligned box in `f64`, for world coordinates.
    DAabb, DVec3, f64
);

impl Aabb {
    /// The box in world coordinates: `origin` added, rounded outward in `f64`.
    pub fn to_world(self, origin: DVec3) -> DAabb {
        if self.is_empty() {
            return DAabb::EMPTY;
        }
        let (min, max) = (origin + self.min.as_dvec3(), origin + self.max.as_dvec3());
        DAabb::new(map(min, f64::next_down), map(max, f64::next_up))
    }
}

impl DAabb {
    /// Triangles of a box over its [`corners`](Self::corners), counter-clockwise from outside.
    pub const TRIANGLES: [[u32; 3]; 12] = [
        [0, 4, 6],
        [0, 6, 2],
        [1, 3, 7],
        [1, 7, 5],
        [0, 1, 5],
        [0, 5, 4],
        [2, 6, 7],
        [2, 7, 3],
        [0, 2, 3],
        [0, 3, 1],
        [4, 5, 7],
        [4, 7, 6],
    ];

    /// The smallest `f32` box that contains this one after subtracting `origin`.
    pub fn to_local(self, origin: DVec3) -> Aabb {
        if self.is_empty() {
            return Aabb::EMPTY;
        }
        let (min, max) = (map(self.min - origin, f64::next_down), map(self.max - origin, f64::next_up));
        Aabb::new(
            Vec3::new(f32_down(min.x), f32_down(min.y), f32_down(min.z)),
            Vec3::new(f32_up(max.x), f32_up(max.y), f32_up(max.z)),
        )
    }

    /// The box around the transformed box.
    ///
    /// Contains the image of every point up to the rounding of one matrix product per corner (a few ulp of the
    /// largest coordinate).
    pub fn transformed(&self, transform: &DAffine3) -> DAabb {
        if self.is_empty() {
            return DAabb::EMPTY;
        }
        DAabb::from_points(self.corners().map(|c| transform.transform_point3(c)))
    }
}

fn map(v: DVec3, f: impl Fn(f64) -> f64) -> DVec3 {
    DVec3::new(f(v.x), f(v.y), f(v.z))
}

/// A sphere in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Centre.
    pub center: DVec3,
    /// Radius; never negative.
    pub radius: f64,
}

impl Sphere {
    /// The sphere around a box, through its corners.
    pub fn around_box(b: &DAabb) -> Self {
        Self { center: b.center(), radius: 0.5 * b.diagonal() }
    }

    /// Whether `point` lies in the sphere, surface included.
    pub fn contains(&self, point: DVec3) -> bool {
        self.center.distance_squared(point) <= self.radius * self.radius
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_is_neutral() {
        let b = Aabb::new(Vec3::ZERO, Vec3::ONE);
        assert_eq!(Aabb::EMPTY.union(b), b);
        assert!(Aabb::EMPTY.is_empty() && Aabb::EMPTY.inflated(1e9).is_empty());
        assert_eq!((Aabb::EMPTY.diagonal(), Aabb::EMPTY.area()), (0.0, 0.0));
        assert!(!Aabb::EMPTY.overlaps(&b) && b.contains_box(&Aabb::EMPTY));
    }

    #[test]
    fn flat_and_point_boxes_are_not_empty() {
        let point = DAabb::from_points([DVec3::splat(3.0)]);
        assert!(!point.is_empty() && point.contains(DVec3::splat(3.0)) && point.diagonal() == 0.0);
    }

    #[test]
    fn local_round_trip_contains_the_original_far_from_the_origin() {
        let origin = DVec3::new(4.8e5, 5.4e6, 120.0);
        let world = DAabb::new(origin + DVec3::splat(0.1), origin + DVec3::new(1.0 / 3.0, 7.7, 1e-9 + 0.1));
        assert!(world.to_local(origin).to_world(origin).contains_box(&world));
    }

    #[test]
    fn transformed_box_contains_transformed_points() {
        let t = DAffine3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
        let b = DAabb::new(DVec3::new(-1.0, 0.0, 2.0), DVec3::new(1.0, 5.0, 3.0));
        let inside = t.transform_point3(DVec3::new(0.3, 4.0, 2.5));
        assert!(b.transformed(&t).contains(inside));
    }
}
