//! One house: facades with recessed windows, sills and doors, a gabled roof of wavy tiles.
//!
//! Local coordinates: the street front is y = 0, from x = 0 to the width; z points up.

use super::builder::{Builder, Rgb, shaded};
use crate::random::Random;
use glam::{Vec2, Vec3};

const WALLS: [Rgb; 9] = [
    [222, 205, 172],
    [205, 178, 140],
    [190, 112, 86],
    [233, 224, 205],
    [176, 98, 76],
    [214, 186, 150],
    [168, 176, 170],
    [226, 196, 124],
    [200, 206, 208],
];
const ROOFS: [Rgb; 5] = [[158, 72, 50], [136, 62, 46], [92, 84, 82], [172, 88, 60], [74, 76, 84]];
const DOORS: [Rgb; 4] = [[92, 52, 32], [44, 70, 62], [50, 56, 90], [110, 40, 36]];
const FRAME: Rgb = [236, 234, 228];
const STONE: Rgb = [196, 190, 178];
const GLASS: Rgb = [46, 58, 70];

/// What to build.
#[derive(Clone, Copy, Debug)]
pub(crate) struct House {
    pub(crate) width: f32,
    pub(crate) depth: f32,
    pub(crate) floors: u32,
    /// Windows in the left and right wall (they are party walls otherwise).
    pub(crate) open_left: bool,
    pub(crate) open_right: bool,
    /// Columns of the roof per metre; six of them make a wave of its tiles.
    pub(crate) roof_columns_per_metre: f32,
}

const PLINTH: f32 = 0.45;
const STOREY: f32 = 2.55;
const REVEAL: f32 = 0.14;
const EAVES: f32 = 0.35;
/// Rise of the roof per metre.
const PITCH: f32 = 0.5;

struct Style {
    wall: Rgb,
    door: Rgb,
    roof: Rgb,
    glass: Rgb,
}

impl House {
    /// Appends the house to `out`.
    pub(crate) fn build(&self, random: &mut Random, out: &mut Builder) {
        let tint = random.range_f32(0.9, 1.05);
        let style = Style {
            wall: shaded(WALLS[random.below(WALLS.len())], tint),
            door: DOORS[random.below(DOORS.len())],
            roof: shaded(ROOFS[random.below(ROOFS.len())], random.range_f32(0.85, 1.1)),
            glass: shaded(GLASS, random.range_f32(0.8, 1.3)),
        };
        let eaves = PLINTH + STOREY * self.floors as f32 + random.range_f32(0.1, 0.35);
        let (w, d) = (self.width, self.depth);
        let sides = [
            (Vec3::ZERO, Vec3::X, w, true, true),
            (Vec3::new(w, 0.0, 0.0), Vec3::Y, d, self.open_right, false),
            (Vec3::new(w, d, 0.0), Vec3::NEG_X, w, true, true),
            (Vec3::new(0.0, d, 0.0), Vec3::NEG_Y, d, self.open_left, false),
        ];
        for (corner, along, length, windows, has_door) in sides {
            Facade { corner, along, length, eaves, floors: if windows { self.floors } else { 0 } }
                .build(has_door, &style, random, out);
        }
        let ridge = eaves + 0.5 * d * PITCH;
        let top = |x: f32| [Vec3::new(x, 0.0, eaves), Vec3::new(x, 0.5 * d, ridge), Vec3::new(x, d, eaves)];
        let [a, b, c] = top(0.0);
        out.polygon(&[a, b, c], style.wall);
        let [a, b, c] = top(w);
        out.polygon(&[c, b, a], style.wall);
        self.roof(eaves, &style, random, out);
        if random.chance(0.7) {
            let (x, y) = (random.range_f32(0.2, 0.7) * w, random.range_f32(0.25, 0.4) * d);
            let base = Vec3::new(x, y, eaves);
            let height = ridge - eaves + random.range_f32(0.0, 0.25);
            out.solid(base, Vec3::X * 0.7, Vec3::Y * 0.5, Vec3::Z * height, shaded(style.wall, 0.8));
        }
    }

    /// Two slabs with wavy tops; the flat undersides are sunk into the walls, so nothing gapes.
    fn roof(&self, eaves: f32, style: &Style, random: &mut Random, out: &mut Builder) {
        const THICKNESS: f32 = 0.16;
        let sag = random.range_f32(0.0, 0.07);
        let half = 0.5 * self.depth;
        let columns = (self.width * self.roof_columns_per_metre).ceil().max(2.0) as u32;
        let rows = 3;
        let wave = std::f32::consts::TAU * self.roof_columns_per_metre / 6.0;
        for side in [-1.0f32, 1.0] {
            // `run` grows from the ridge to the eaves; x is mirrored on one side so that fronts point up.
            let place = |x: f32, run: f32, lift: f32| {
                let run_y = half + side * run;
                Vec3::new(x, run_y, eaves + (half - run) * PITCH + lift)
            };
            let x_of = |t: f32| if side < 0.0 { (1.0 - t) * self.width } else { t * self.width };
            let length = half + EAVES;
            let slope_normal = Vec3::new(0.0, side * PITCH, 1.0).normalize();
            out.patch(rows, columns, |i, j| {
                let x = x_of(j as f32 / columns as f32);
                let run = (1.0 - i as f32 / rows as f32) * length;
                let sink = sag * (std::f32::consts::PI * x / self.width).sin() * (run / length);
                let phase = wave * x;
                let lift = THICKNESS + 0.035 * phase.sin() - sink;
                let normal = (slope_normal - Vec3::X * (0.035 * wave * phase.cos() * 0.6)).normalize();
                (place(x, run, lift), normal, shaded(style.roof, 0.92 + 0.08 * phase.sin()))
            });
            let under = |x: f32, run: f32| place(x, run, -0.02);
            let (x0, x1) = (x_of(0.0), x_of(1.0));
            let edge = shaded(style.roof, 0.7);
            let over = |x: f32, run: f32| place(x, run, THICKNESS + 0.02);
            out.polygon(&[under(x0, length), under(x1, length), under(x1, 0.0), under(x0, 0.0)], STONE);
            out.polygon(&[over(x0, length), over(x1, length), under(x1, length), under(x0, length)], edge);
            out.polygon(&[over(x0, 0.0), over(x0, length), under(x0, length), under(x0, 0.0)], edge);
            out.polygon(&[over(x1, length), over(x1, 0.0), under(x1, 0.0), under(x1, length)], edge);
        }
        let y = half - 0.12;
        let z = eaves + half * PITCH + 0.08;
        out.solid(
            Vec3::new(0.0, y, z),
            Vec3::X * self.width,
            Vec3::Y * 0.24,
            Vec3::Z * 0.16,
            shaded(style.roof, 0.8),
        );
    }
}

/// One wall: a grid of cells, each solid or an opening. All cells of a row and column share their cuts, so
/// that there are no T-junctions within the wall.
struct Facade {
    corner: Vec3,
    along: Vec3,
    length: f32,
    eaves: f32,
    floors: u32,
}

impl Facade {
    fn at(&self, p: Vec2, inward: f32) -> Vec3 {
        self.corner + self.along * p.x + Vec3::Z * p.y - self.outward() * inward
    }

    fn outward(&self) -> Vec3 {
        self.along.cross(Vec3::Z)
    }

    fn rectangle(&self, min: Vec2, max: Vec2, inward: f32, colour: Rgb, out: &mut Builder) {
        let corners = [min, Vec2::new(max.x, min.y), max, Vec2::new(min.x, max.y)];
        out.polygon(&corners.map(|p| self.at(p, inward)), colour);
    }

    fn build(&self, has_door: bool, style: &Style, random: &mut Random, out: &mut Builder) {
        let openings = if self.floors == 0 { 0 } else { ((self.length - 0.6) / 1.75) as u32 };
        let pitch = self.length / openings.max(1) as f32;
        let mut x_cuts = vec![0.0];
        for i in 0..openings {
            let middle = (i as f32 + 0.5) * pitch;
            x_cuts.extend([middle - 0.5, middle + 0.5]);
        }
        x_cuts.push(self.length);
        let mut z_cuts = vec![0.0, PLINTH];
        for floor in 0..self.floors {
            let base = PLINTH + STOREY * floor as f32;
            z_cuts.extend([base + 0.75, base + 2.15]);
        }
        z_cuts.push(self.eaves);
        let door = (has_door && openings > 0).then(|| random.below(openings as usize));
        for (column, xs) in x_cuts.windows(2).enumerate() {
            for (row, zs) in z_cuts.windows(2).enumerate() {
                let (min, max) = (Vec2::new(xs[0], zs[0]), Vec2::new(xs[1], zs[1]));
                let in_opening = column % 2 == 1 && openings > 0;
                let of_door = in_opening && door == Some(column / 2);
                if of_door && (1..=2).contains(&row) {
                    if row == 1 {
                        let top = Vec2::new(xs[1], z_cuts[3]);
                        self.door(min, top, style, out);
                    }
                } else if in_opening && row >= 2 && row % 2 == 0 && row < z_cuts.len() - 2 {
                    self.window(min, max, style, out);
                } else {
                    let colour = if row == 0 { shaded(STONE, 0.75) } else { style.wall };
                    self.rectangle(min, max, 0.0, colour, out);
                }
            }
        }
    }

    fn reveal(&self, min: Vec2, max: Vec2, colour: Rgb, out: &mut Builder) {
        let corners = [min, Vec2::new(max.x, min.y), max, Vec2::new(min.x, max.y)];
        for i in 0..4 {
            let (p, q) = (corners[i], corners[(i + 1) % 4]);
            out.polygon(&[self.at(p, 0.0), self.at(q, 0.0), self.at(q, REVEAL), self.at(p, REVEAL)], colour);
        }
    }

    fn window(&self, min: Vec2, max: Vec2, style: &Style, out: &mut Builder) {
        self.reveal(min, max, shaded(style.wall, 0.9), out);
        const BAR: f32 = 0.07;
        let middle = 0.5 * (min.x + max.x);
        let (inner_min, inner_max) = (min + BAR, max - BAR);
        let bars = [
            (min, Vec2::new(max.x, inner_min.y)),
            (Vec2::new(min.x, inner_max.y), max),
            (Vec2::new(min.x, inner_min.y), Vec2::new(inner_min.x, inner_max.y)),
            (Vec2::new(inner_max.x, inner_min.y), Vec2::new(max.x, inner_max.y)),
            (Vec2::new(middle - 0.5 * BAR, inner_min.y), Vec2::new(middle + 0.5 * BAR, inner_max.y)),
        ];
        for (a, b) in bars {
            self.rectangle(a, b, REVEAL, FRAME, out);
        }
        let panes = [(inner_min.x, middle - 0.5 * BAR), (middle + 0.5 * BAR, inner_max.x)];
        for (a, b) in panes {
            self.rectangle(Vec2::new(a, inner_min.y), Vec2::new(b, inner_max.y), REVEAL, style.glass, out);
        }
        let sill = self.at(min - Vec2::new(0.08, 0.09), 0.02);
        let width = max.x - min.x + 0.16;
        out.solid(sill, self.along * width, Vec3::Z * 0.08, self.outward() * 0.14, STONE);
    }

    fn door(&self, min: Vec2, max: Vec2, style: &Style, out: &mut Builder) {
        self.reveal(min, max, shaded(style.wall, 0.85), out);
        self.rectangle(min, max, REVEAL, style.door, out);
        let step = self.at(min - Vec2::new(0.1, PLINTH), 0.0);
        let width = max.x - min.x + 0.2;
        out.solid(step, self.along * width, Vec3::Z * (0.5 * PLINTH), self.outward() * 0.7, STONE);
        out.solid(step, self.along * width, Vec3::Z * PLINTH, self.outward() * 0.35, STONE);
    }
}
