//! Soft shadows: lookups spread over the penumbra, whose width what is in front gives (percentage-closer soft shadows, Fernando 2005).
//!
//! Differs: everything is measured in the world, so that warped maps give the same penumbra as uniform ones; lookups are compared with the receiver's
//! plane, so that wide filters do not shadow what they lie on; and the region that is searched is narrowed by what lies nearest to the light in it.

use super::{Nearest, ShadowMap};
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;
use std::sync::Arc;

/// A light of some size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Penumbra {
    /// Half of the angle that the light spans, in radians; below a right angle.
    pub angular_radius: f32,
    /// Lookups that filter; as many before that look for what is in front. Shades of a penumbra are off by up to half of one in so many.
    pub taps: u32,
}

/// How often the region to search is narrowed.
const ROUNDS: usize = 4;
/// Steepest receivers, as seen from the light: height over breadth. What is steeper is all but dark.
const STEEPEST: f32 = 8.0;

/// Where lookups are made, in the unit disk.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// To filter: of even density.
    even: Vec2,
    /// To search: denser towards the middle, where what is near hides light; with the distance from there.
    dense: Vec2,
    aside: f32,
}

/// The places of so many lookups.
pub fn spiral(taps: u32) -> Arc<[Place]> {
    // The golden angle never lines places up.
    let place = |i: u32| {
        let share = (i as f32 + 0.5) / taps as f32;
        let direction = Vec2::from_angle(i as f32 * 0.381_966 * TAU);
        Place { even: direction * share.sqrt(), dense: direction * share, aside: share }
    };
    (0..taps).map(place).collect()
}

/// What a step of one world unit across the light is in a map: texels, and depth that the receiver's plane gains.
#[derive(Clone, Copy)]
struct Step {
    texels: Vec2,
    depth: f32,
}

/// A receiver in a map.
struct Receiver<'a> {
    map: &'a ShadowMap,
    /// Texels, and depth.
    at: Vec2,
    depth: f32,
    /// Across the light, at right angles.
    steps: [Step; 2],
    /// Depth gained by a world unit towards the light.
    rise: f32,
    /// Smallest radius of the filter, in world units: what hard shadows have.
    least: f32,
}

impl ShadowMap {
    /// Share of a light of some size that reaches a point, given where the point is in the map: texels and depth.
    pub(super) fn soft(&self, penumbra: Penumbra, point: Vec3, normal: Vec3, [x, y, depth]: [f32; 3]) -> f32 {
        let hard = || self.filtered(x, y, depth);
        let Some(receiver) = self.receiver(point, normal, [x, y, depth]) else { return hard() };
        let spread = penumbra.angular_radius.tan();
        let Some(reach) = receiver.reach(spread) else { return 1.0 };
        if reach <= receiver.least {
            return hard();
        }
        // Where nothing was found, what is in front may be narrower than lookups are apart.
        let Some(distance) = receiver.in_front(reach, spread) else { return hard() };
        let width = spread * distance;
        if width <= receiver.least { hard() } else { receiver.filtered(width) }
    }

    fn receiver(&self, point: Vec3, normal: Vec3, [x, y, depth]: [f32; 3]) -> Option<Receiver<'_>> {
        let (gradients, clip) = self.gradients(point);
        let [gx, gy, gz] = gradients.map(|g| g / clip.w);
        // Both are across the ray of light, so their product is along it.
        let along = gx.cross(gy).try_normalize()?;
        let light = if gz.dot(along) < 0.0 { -along } else { along };
        let rise = gz.dot(light);
        let half = 0.5 * self.target.width() as f32;
        let facing = normal.dot(light);
        let step = |across: Vec3| {
            let slope = (-across.dot(normal) / facing).clamp(-STEEPEST, STEEPEST);
            // Of a plane along the light there is no slope.
            let slope = if slope.is_nan() { 0.0 } else { slope };
            let texels = Vec2::new(gx.dot(across), -gy.dot(across)) * half;
            Step { texels, depth: gz.dot(across) + rise * slope }
        };
        let right = gx.try_normalize()?;
        let steps = [step(right), step(light.cross(right))];
        let least = (self.options.filter_radius as f32 + 0.5) / (half * gx.length().max(gy.length()));
        let usable = rise > 0.0 && least.is_finite();
        usable.then_some(Receiver { map: self, at: Vec2::new(x, y), depth, steps, rise, least })
    }
}

impl Receiver<'_> {
    /// How far across the light, in world units, something may be in front of part of it; `None` where nothing is.
    fn reach(&self, spread: f32) -> Option<f32> {
        let nearest = self.map.nearest.get_or_init(|| Nearest::of(&self.map.target));
        // Nothing is nearer to the light than the map begins.
        let mut reach = spread * (1.0 - self.depth).max(0.0) / self.rise;
        for _ in 0..ROUNDS {
            let most = reach.max(self.least);
            let [u, v] = self.steps;
            let texels = (u.texels.abs() + v.texels.abs()) * most;
            let lowest = self.depth - (u.depth.abs() + v.depth.abs()) * most;
            let above = nearest.around(self.at.to_array(), texels.to_array()) - lowest;
            if above <= 0.0 {
                return None;
            }
            reach = reach.min(spread * above / self.rise);
            if reach <= self.least {
                break;
            }
        }
        Some(reach)
    }

    /// Where a lookup is made, and the depth of the receiver's plane there.
    fn place(&self, offset: Vec2) -> (Vec2, f32) {
        let [u, v] = self.steps;
        (
            self.at + u.texels * offset.x + v.texels * offset.y,
            self.depth + u.depth * offset.x + v.depth * offset.y,
        )
    }

    /// Mean distance to what is in front of the light; `None` where no lookup finds anything.
    fn in_front(&self, reach: f32, spread: f32) -> Option<f32> {
        let (mut sum, mut count) = (0.0, 0.0);
        for place in self.map.spiral.iter() {
            let (at, own) = self.place(place.dense * reach);
            let distance = (self.map.texel(at.x as i32, at.y as i32) - own) / self.rise;
            // What is aside by more than the light at its distance hides nothing of it.
            if distance > 0.0 && place.aside * reach <= spread * distance + self.least {
                (sum, count) = (sum + distance, count + 1.0);
            }
        }
        (count > 0.0).then(|| sum / count)
    }

    /// Share of the lookups within `width` that are lit, each with bilinear weights.
    fn filtered(&self, width: f32) -> f32 {
        let mut sum = 0.0;
        for place in self.map.spiral.iter() {
            let (at, own) = self.place(place.even * width);
            let corner = (at - 0.5).floor();
            let f = at - 0.5 - corner;
            let (i, j) = (corner.x as i32, corner.y as i32);
            let lit = |di: i32, dj: i32| if own >= self.map.texel(i + di, j + dj) { 1.0 } else { 0.0 };
            let row = |dj: i32| lit(0, dj) * (1.0 - f.x) + lit(1, dj) * f.x;
            sum += row(0) * (1.0 - f.y) + row(1) * f.y;
        }
        // Rounded weights may add up to a little more than all.
        (sum / self.map.spiral.len() as f32).min(1.0)
    }
}
