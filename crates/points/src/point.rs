//! Points on an integer grid, and the grid.

use crate::PointsError;
use glam::{DVec3, Vec3};

/// A point: integer position on a [`Grid`], and a colour. 16 bytes, on disk and for a graphics card as well.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Point {
    /// Grid coordinates; see [`Grid::world`].
    pub position: [i32; 3],
    /// sRGB-encoded red, green, blue; the fourth byte is 255.
    pub colour: [u8; 4],
}

impl Point {
    /// An opaque point.
    pub fn new(position: [i32; 3], [r, g, b]: [u8; 3]) -> Self {
        Self { position, colour: [r, g, b, 255] }
    }
}

/// Where integer coordinates lie in the world: `scale · integer + offset` on each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Distance of neighbouring coordinates; positive.
    pub scale: DVec3,
    /// World position of the integer origin.
    pub offset: DVec3,
}

impl Grid {
    /// A grid with checked numbers.
    ///
    /// # Errors
    /// [`PointsError::Grid`] when a scale is not positive or a number not finite.
    pub fn new(scale: DVec3, offset: DVec3) -> Result<Self, PointsError> {
        let grid = Self { scale, offset };
        grid.check("grid").map(|()| grid)
    }

    pub(crate) fn check(&self, what: &str) -> Result<(), PointsError> {
        let usable = self.scale.cmpgt(DVec3::ZERO).all() && self.scale.is_finite() && self.offset.is_finite();
        // The farthest coordinate must be finite as well.
        let reach = self.scale * 2f64.powi(32) + self.offset.abs();
        if usable && reach.is_finite() {
            return Ok(());
        }
        let (scale, offset) = (self.scale.to_array(), self.offset.to_array());
        Err(PointsError::Grid { what: what.to_owned(), scale, offset })
    }

    /// World position of integer coordinates.
    #[inline]
    pub fn world(&self, position: [i32; 3]) -> DVec3 {
        DVec3::from_array(position.map(f64::from)) * self.scale + self.offset
    }

    /// Position relative to a world point near it, such as the eye: `f32` loses nothing that could be seen there.
    #[inline]
    pub fn relative(&self, position: [i32; 3], origin: DVec3) -> Vec3 {
        (DVec3::from_array(position.map(f64::from)) * self.scale + (self.offset - origin)).as_vec3()
    }

    /// Nearest integer coordinates; off by at most half a step of [`scale`](Self::scale). `None` when NaN, infinite or beyond
    /// 32 bits.
    pub fn nearest(&self, world: DVec3) -> Option<[i32; 3]> {
        let exact = ((world - self.offset) / self.scale).round();
        let range = f64::from(i32::MIN)..=f64::from(i32::MAX);
        exact.to_array().iter().all(|v| range.contains(v)).then(|| exact.to_array().map(|v| v as i32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_round_and_refuse() {
        let grid = Grid::new(DVec3::splat(0.001), DVec3::new(5e5, 5e6, 300.0)).unwrap();
        let p = [123_456, -7, i32::MAX];
        assert_eq!(grid.nearest(grid.world(p)), Some(p));
        assert_eq!(grid.nearest(DVec3::splat(1e12)), None);
        assert_eq!(grid.nearest(DVec3::NAN), None);
        for (scale, offset) in [(0.0, 0.0), (-1.0, 0.0), (f64::NAN, 0.0), (1.0, f64::INFINITY)] {
            assert!(Grid::new(DVec3::splat(scale), DVec3::splat(offset)).is_err(), "{scale}");
        }
        assert!(Grid::new(DVec3::splat(1e290), DVec3::ZERO).is_ok());
        assert!(Grid::new(DVec3::splat(1e305), DVec3::ZERO).is_err());
    }
}
