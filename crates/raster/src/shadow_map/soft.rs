//! Soft shadows: lookups spread over the penumbra, whose width what is in front gives (percentage-closer soft shadows, Fernando 2005).
//!
//! Differs: everything is measured in the world, so that warped maps give the same penumbra as uniform ones; lookups are compared with the receiver's
//! plane, so that wide filters do not shadow what they lie on; and the region that is searched is narrowed by what lies nearest to the light in it.

use super::{Gradients, Nearest, ShadowMap};
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

/// What lookups found in front of the light.
enum Front {
    Nothing,
    /// Wherever they looked.
    All,
    /// In some places, at this distance in the mean.
    Part(f32),
}

impl ShadowMap {
    /// Share of a light of some size that reaches a point, given where that is in the map, texels and depth, and how these change around it.
    pub(super) fn soft(&self, gradients: &Gradients, normal: Vec3, [x, y, depth]: [f32; 3]) -> f32 {
        let hard = || self.filtered(x, y, depth);
        let Some(receiver) = self.receiver(gradients, normal, [x, y, depth]) else { return hard() };
        let spread = self.spread;
        let Some(reach) = receiver.reach(spread) else { return 1.0 };
        if reach <= receiver.least {
            return hard();
        }
        match receiver.in_front(reach, spread) {
            // What is in front may be narrower than lookups are apart.
            Front::Nothing => hard(),
            Front::All => 0.0,
            Front::Part(distance) if spread * distance <= receiver.least => hard(),
            Front::Part(distance) => receiver.filtered(spread * distance),
        }
    }

    fn receiver(&self, gradients: &Gradients, normal: Vec3, [x, y, depth]: [f32; 3]) -> Option<Receiver<'_>> {
        let [gx, gy, gz] = gradients.rows.map(|g| g / gradients.w);
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
            let narrower = reach.min(spread * above / self.rise);
            let settled = narrower <= self.least || narrower > 0.8 * reach;
            reach = narrower;
            if settled {
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

    /// Looks for what is in front of the light.
    fn in_front(&self, reach: f32, spread: f32) -> Front {
        let (mut sum, mut count) = (0.0, 0);
        for place in self.map.spiral.iter() {
            let (at, own) = self.place(place.dense * reach);
            let distance = (self.map.texel(at.x as i32, at.y as i32) - own) / self.rise;
            // What is aside by more than the light at its distance hides nothing of it.
            if distance > 0.0 && place.aside * reach <= spread * distance + self.least {
                (sum, count) = (sum + distance, count + 1);
            }
        }
        match count {
            0 => Front::Nothing,
            all if all == self.map.spiral.len() => Front::All,
            some => Front::Part(sum / some as f32),
        }
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
