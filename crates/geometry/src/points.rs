//! Validated point clouds.

use crate::bounds::{Aabb, DAabb};
use crate::mesh::MAX_COORDINATE;
use glam::{DVec3, Vec3};

/// Points: an `f64` origin and `f32` positions relative to it, with an optional colour each.
///
/// Checked once, when it is built: no coordinate is NaN, infinite or beyond [`MAX_COORDINATE`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    origin: DVec3,
    positions: Vec<Vec3>,
    colours: Option<Vec<[u8; 3]>>,
}

/// Why a point cloud was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PointsError {
    /// A position is NaN, infinite or beyond [`MAX_COORDINATE`].
    #[error(
        "point {point} is at {position}; coordinates must be finite and at most {MAX_COORDINATE:e} from the origin"
    )]
    Position {
        /// The point.
        point: usize,
        /// Its position.
        position: DVec3,
    },
    /// The origin is NaN or infinite.
    #[error("the origin {origin} is not finite")]
    Origin {
        /// The origin.
        origin: DVec3,
    },
    /// There are more or fewer colours than points.
    #[error("{colours} colours for {points} points")]
    ColourCount {
        /// Number of colours.
        colours: usize,
        /// Number of points.
        points: usize,
    },
    /// More points than 32-bit indices can name.
    #[error("{count} points are more than 32-bit indices can name")]
    TooMany {
        /// How many.
        count: usize,
    },
}

impl PointCloud {
    /// Takes positions relative to `origin`, checking both.
    ///
    /// # Errors
    /// Names the first bad point.
    pub fn new(origin: DVec3, positions: Vec<Vec3>) -> Result<Self, PointsError> {
        if u32::try_from(positions.len()).is_err() {
            return Err(PointsError::TooMany { count: positions.len() });
        }
        if !origin.is_finite() {
            return Err(PointsError::Origin { origin });
        }
        let in_range = |p: &Vec3| p.abs().cmple(Vec3::splat(MAX_COORDINATE)).all();
        if let Some(point) = positions.iter().position(|p| !in_range(p)) {
            return Err(PointsError::Position { point, position: positions[point].as_dvec3() });
        }
        Ok(Self { origin, positions, colours: None })
    }

    /// Takes world positions; the origin becomes the centre of their box, so that little precision is lost.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn from_world(positions: &[DVec3]) -> Result<Self, PointsError> {
        if let Some(point) = positions.iter().position(|p| !p.is_finite()) {
            return Err(PointsError::Position { point, position: positions[point] });
        }
        let bounds = DAabb::from_points(positions.iter().copied());
        let origin = if bounds.is_empty() { DVec3::ZERO } else { bounds.center().as_vec3().as_dvec3() };
        if !origin.is_finite() {
            return Err(PointsError::Origin { origin });
        }
        Self::new(origin, positions.iter().map(|&p| (p - origin).as_vec3()).collect())
    }

    /// Adds a colour per point: sRGB-encoded red, green, blue.
    ///
    /// # Errors
    /// When the count differs from the points'.
    pub fn with_colours(self, colours: Vec<[u8; 3]>) -> Result<Self, PointsError> {
        if colours.len() != self.positions.len() {
            return Err(PointsError::ColourCount { colours: colours.len(), points: self.positions.len() });
        }
        Ok(Self { colours: Some(colours), ..self })
    }

    /// World position of the local origin.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Positions relative to [`origin`](Self::origin).
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Colours, if there are any.
    pub fn colours(&self) -> Option<&[[u8; 3]]> {
        self.colours.as_deref()
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Local box around the points.
    pub fn bounds(&self) -> Aabb {
        Aabb::from_points(self.positions.iter().copied())
    }

    /// World box around the points.
    pub fn world_bounds(&self) -> DAabb {
        self.bounds().to_world(self.origin)
    }

    /// Bytes that the arrays hold.
    pub fn bytes(&self) -> u64 {
        (self.positions.len() * 12 + self.colours.as_ref().map_or(0, |c| c.len() * 3)) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_points_are_named() {
        let bad = vec![Vec3::ZERO, Vec3::NAN];
        assert!(matches!(PointCloud::new(DVec3::ZERO, bad), Err(PointsError::Position { point: 1, .. })));
        assert!(PointCloud::new(DVec3::INFINITY, vec![]).is_err());
        let two = PointCloud::new(DVec3::ZERO, vec![Vec3::ZERO; 2]).unwrap();
        assert_eq!(two.with_colours(vec![[0; 3]]).unwrap_err().to_string(), "1 colours for 2 points");
        assert!(PointCloud::from_world(&[DVec3::splat(f64::NAN)]).is_err());
    }

    #[test]
    fn world_positions_survive_large_offsets() {
        let utm = DVec3::new(480_000.001, 5_400_000.002, 120.003);
        let cloud = PointCloud::from_world(&[utm, utm + DVec3::ONE]).unwrap();
        let world = cloud.origin() + cloud.positions()[0].as_dvec3();
        assert!(world.distance(utm) < 1e-6 && cloud.world_bounds().contains(utm + DVec3::splat(0.5)));
        assert!(PointCloud::from_world(&[]).unwrap().world_bounds().is_empty());
    }
}
