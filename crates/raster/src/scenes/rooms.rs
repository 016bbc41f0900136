//! The inside of a house: rooms joined by doors.

use super::builder::{Builder, Rgb, shaded};
use super::check;
use crate::RasterError;
use crate::random::Random;
use farsight_geometry::Scene;
use farsight_geometry::scene::{Instance, Light, Material};
use glam::{DAffine3, DVec3, Vec3};

/// One floor of rooms on a grid. Every room can be reached through doors; outer rooms have windows.
///
/// By default 6 x 5 rooms of 5 x 5 x 2.8 m with furniture, a sun that shines through the windows, and a lamp in the
/// middle. An instance per room, per wall and per piece of furniture.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Rooms {
    /// Seed of everything random.
    pub seed: u64,
    /// Rooms along x and y: 1 to 200 each.
    pub rooms: [u32; 2],
    /// Share of walls with a door beyond those needed to reach every room, from 0 to 1.
    pub extra_doors: f64,
    /// Whether there is furniture.
    pub furniture: bool,
}

impl Default for Rooms {
    fn default() -> Self {
        Self { seed: 1, rooms: [6, 5], extra_doors: 0.2, furniture: true }
    }
}

/// Distance between the middles of neighbouring walls, in metres.
const CELL: f32 = 5.0;
const HEIGHT: f32 = 2.8;
const WALL: f32 = 0.2;

#[derive(Clone, Copy, PartialEq)]
enum Opening {
    None,
    Door,
    Window,
}

impl Rooms {
    /// The middle of a room at eye height.
    pub fn eye(&self, x: u32, y: u32) -> DVec3 {
        DVec3::new(f64::from(CELL) * (f64::from(x) + 0.5), f64::from(CELL) * (f64::from(y) + 0.5), 1.6)
    }

    /// Builds the scene.
    ///
    /// # Errors
    /// [`RasterError::Option`] when an option is out of its range.
    pub fn build(&self) -> Result<Scene, RasterError> {
        let [nx, ny] = self.rooms;
        check("rooms", nx.into(), "1..=200", (1..=200).contains(&nx))?;
        check("rooms", ny.into(), "1..=200", (1..=200).contains(&ny))?;
        check("extra_doors", self.extra_doors, "[0, 1]", (0.0..=1.0).contains(&self.extra_doors))?;
        let mut scene = Scene::new();
        let mut random = Random::new(self.seed);
        let (vertical, horizontal) = self.doors(&mut random);
        let mut add = |name: String, builder: Builder| -> Result<(), RasterError> {
            let mesh = scene.add_mesh(builder.build()?);
            let world_from_mesh = DAffine3::IDENTITY;
            if scene.materials().is_empty() {
                let material = Material {
                    name: "room".into(),
                    base_colour: [1.0; 4],
                    two_sided: false,
                    ..Material::default()
                };
                scene.add_material(material)?;
            }
            let material = Some(farsight_geometry::scene::MaterialId(0));
            scene.add_instance(Instance { name, mesh, world_from_mesh, material })?;
            Ok(())
        };
        let paint = |random: &mut Random| -> Rgb {
            const PAINTS: [Rgb; 5] =
                [[232, 226, 212], [214, 220, 224], [226, 210, 186], [206, 218, 200], [222, 204, 204]];
            PAINTS[random.below(PAINTS.len())]
        };
        for y in 0..=ny {
            for x in 0..=nx {
                let corner = Vec3::new(x as f32, y as f32, 0.0) * CELL;
                let mut post = Builder::default();
                let side = Vec3::new(WALL, WALL, 0.0) * 0.5;
                post.solid(corner - side, Vec3::X * WALL, Vec3::Y * WALL, Vec3::Z * HEIGHT, [216, 210, 200]);
                add(format!("post {x} {y}"), post)?;
                let inner = CELL - WALL;
                if x < nx {
                    let outer = y == 0 || y == ny;
                    let opening = if outer { Opening::Window } else { vertical[(y * nx + x) as usize] };
                    let start = corner + Vec3::X * (0.5 * WALL);
                    let mut out = Builder::default();
                    wall(start, Vec3::X, inner, opening, paint(&mut random), &mut out);
                    add(format!("wall x {x} {y}"), out)?;
                }
                if y < ny {
                    let outer = x == 0 || x == nx;
                    let opening =
                        if outer { Opening::Window } else { horizontal[(y * (nx + 1) + x) as usize] };
                    let start = corner + Vec3::Y * (0.5 * WALL);
                    let mut out = Builder::default();
                    wall(start, Vec3::Y, inner, opening, paint(&mut random), &mut out);
                    add(format!("wall y {x} {y}"), out)?;
                }
            }
        }
        for y in 0..ny {
            for x in 0..nx {
                let corner = Vec3::new(x as f32, y as f32, 0.0) * CELL;
                add(
                    format!("room {x} {y}"),
                    floor_and_ceiling(corner, &mut random.fork(u64::from(y * nx + x))),
                )?;
                if self.furniture {
                    let mut random = random.fork(1 << 32 | u64::from(y * nx + x));
                    for (n, piece) in furnish(corner, &mut random).into_iter().enumerate() {
                        add(format!("furniture {x} {y} {n}"), piece)?;
                    }
                }
            }
        }
        scene.add_light(Light::Directional {
            direction: DVec3::new(0.52, 0.38, -0.48).normalize(),
            irradiance: Vec3::new(7.0, 6.3, 5.2),
            angular_radius: 0.00465,
        })?;
        let lamp = self.eye(nx / 2, ny / 2).with_z(f64::from(HEIGHT) - 0.15);
        scene.add_light(Light::Disk {
            center: lamp,
            normal: DVec3::NEG_Z,
            radius: 0.25,
            radiance: Vec3::new(30.0, 26.0, 20.0),
        })?;
        Ok(scene)
    }

    /// Openings of the inner walls along x (by row and column) and along y: a random spanning tree, and some more.
    fn doors(&self, random: &mut Random) -> (Vec<Opening>, Vec<Opening>) {
        let [nx, ny] = self.rooms;
        let mut along_x = vec![Opening::None; ((ny + 1) * nx) as usize];
        let mut along_y = vec![Opening::None; (ny * (nx + 1)) as usize];
        let mut walls = Vec::new();
        for y in 0..ny {
            for x in 0..nx {
                if x > 0 {
                    walls.push((false, x, y, y * nx + x - 1, y * nx + x));
                }
                if y > 0 {
                    walls.push((true, x, y, (y - 1) * nx + x, y * nx + x));
                }
            }
        }
        for i in (1..walls.len()).rev() {
            walls.swap(i, random.below(i + 1));
        }
        let mut group: Vec<u32> = (0..nx * ny).collect();
        for (is_x, x, y, a, b) in walls {
            let (a, b) = (group[a as usize], group[b as usize]);
            if a != b || random.chance(self.extra_doors) {
                group.iter_mut().filter(|g| **g == b).for_each(|g| *g = a);
                if is_x {
                    along_x[(y * nx + x) as usize] = Opening::Door;
                } else {
                    along_y[(y * (nx + 1) + x) as usize] = Opening::Door;
                }
            }
        }
        (along_x, along_y)
    }
}

/// A wall between two posts, `along` from `start` at half its thickness, with an opening in its middle.
fn wall(start: Vec3, along: Vec3, length: f32, opening: Opening, paint: Rgb, out: &mut Builder) {
    let (half, low, high) = match opening {
        Opening::None => (0.0, 0.0, 0.0),
        Opening::Door => (0.5, 0.0, 2.05),
        Opening::Window => (0.8, 0.9, 2.2),
    };
    let across = Vec3::Z.cross(along);
    let mut piece = |from: f32, to: f32, bottom: f32, top: f32, colour: Rgb| {
        if to > from && top > bottom {
            let corner = start + along * from - across * (0.5 * WALL) + Vec3::Z * bottom;
            out.solid(corner, along * (to - from), across * WALL, Vec3::Z * (top - bottom), colour);
        }
    };
    let middle = 0.5 * length;
    if half == 0.0 {
        piece(0.0, length, 0.0, HEIGHT, paint);
        return;
    }
    piece(0.0, middle - half, 0.0, HEIGHT, paint);
    piece(middle + half, length, 0.0, HEIGHT, paint);
    piece(middle - half, middle + half, 0.0, low, paint);
    piece(middle - half, middle + half, high, HEIGHT, paint);
}

fn floor_and_ceiling(corner: Vec3, random: &mut Random) -> Builder {
    let mut out = Builder::default();
    let wood = shaded([150, 108, 72], random.range_f32(0.85, 1.15));
    let planks = 20;
    let width = CELL / planks as f32;
    for i in 0..planks {
        let colour = shaded(wood, random.range_f32(0.9, 1.08));
        out.parallelogram(corner + Vec3::Y * (i as f32 * width), Vec3::X * CELL, Vec3::Y * width, colour);
    }
    // A slab, so that the sun stays outside.
    out.solid(corner + Vec3::Z * HEIGHT, Vec3::X * CELL, Vec3::Y * CELL, Vec3::Z * 0.2, [238, 236, 230]);
    out
}

/// A table with chairs, a shelf with books, a carpet.
fn furnish(corner: Vec3, random: &mut Random) -> Vec<Builder> {
    let mut pieces = Vec::new();
    let wood = shaded([126, 88, 58], random.range_f32(0.75, 1.25));
    let boxed = |out: &mut Builder, min: Vec3, size: Vec3, colour: Rgb| {
        out.solid(min, Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z, colour);
    };
    let mut table = Builder::default();
    let at = corner + Vec3::new(random.range_f32(0.5, 1.0), random.range_f32(0.5, 1.0), 0.0);
    boxed(&mut table, at + Vec3::Z * 0.7, Vec3::new(1.4, 0.8, 0.05), wood);
    for (x, y) in [(0.05, 0.05), (1.28, 0.05), (0.05, 0.68), (1.28, 0.68)] {
        boxed(&mut table, at + Vec3::new(x, y, 0.0), Vec3::new(0.07, 0.07, 0.7), shaded(wood, 0.85));
    }
    pieces.push(table);
    for x in [0.2, 0.8] {
        let mut chair = Builder::default();
        let at = at + Vec3::new(x, 1.0, 0.0);
        boxed(&mut chair, at + Vec3::Z * 0.42, Vec3::new(0.42, 0.42, 0.05), shaded(wood, 1.1));
        boxed(&mut chair, at + Vec3::new(0.0, 0.38, 0.47), Vec3::new(0.42, 0.04, 0.5), shaded(wood, 1.1));
        for (dx, dy) in [(0.0, 0.0), (0.37, 0.0), (0.0, 0.37), (0.37, 0.37)] {
            boxed(&mut chair, at + Vec3::new(dx, dy, 0.0), Vec3::new(0.05, 0.05, 0.42), shaded(wood, 0.9));
        }
        pieces.push(chair);
    }
    let mut shelf = Builder::default();
    let at = corner + Vec3::new(3.4, CELL - 0.5, 0.0);
    boxed(&mut shelf, at, Vec3::new(0.03, 0.32, 1.9), wood);
    boxed(&mut shelf, at + Vec3::X * 1.07, Vec3::new(0.03, 0.32, 1.9), wood);
    for level in 0..5 {
        let z = 0.05 + 0.45 * level as f32;
        boxed(&mut shelf, at + Vec3::new(0.03, 0.0, z), Vec3::new(1.04, 0.32, 0.03), wood);
        let mut x = 0.05;
        while level < 4 && x < 0.98 {
            let width = random.range_f32(0.02, 0.07);
            let colour = [0; 3].map(|_| random.range_f32(50.0, 190.0) as u8);
            let size = Vec3::new(width, 0.2, random.range_f32(0.2, 0.34));
            boxed(&mut shelf, at + Vec3::new(x, 0.08, z + 0.03), size, colour);
            x += width + if random.chance(0.1) { 0.12 } else { 0.004 };
        }
    }
    pieces.push(shelf);
    let mut carpet = Builder::default();
    let colour = [random.range_f32(110.0, 170.0) as u8, random.range_f32(50.0, 90.0) as u8, 60];
    boxed(&mut carpet, corner + Vec3::new(1.3, 1.9, 0.0), Vec3::new(2.4, 1.6, 0.015), colour);
    pieces.push(carpet);
    pieces
}
