//! A low-rise town: blocks of houses around courtyards, streets with pavements, trees.

use super::builder::{Builder, Rgb, shaded};
use super::check;
use super::house::House;
use crate::RasterError;
use crate::random::Random;
use farsight_geometry::scene::{Instance, Light, Material, MaterialId, MeshId, Scene};
use glam::{DAffine3, DQuat, DVec3, Vec3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Side of a block without its streets, in metres.
pub(crate) const BLOCK: u32 = 40;
/// Width of a street between house fronts, in metres.
pub(crate) const STREET: u32 = 11;
const PITCH: u32 = BLOCK + STREET;
/// Place across itself of the middle of street `n`, in metres; streets along x and y have the same.
pub(super) fn street_middle(n: f64) -> f64 {
    0.5 * f64::from(STREET) + f64::from(PITCH) * n
}

const PAVEMENT: u32 = 2;
const KERB: f32 = 0.14;

/// A low-rise town on a street grid.
///
/// With the default options 317 x 317 x 9 m, about 1.4 M triangles in about 800 objects: houses (closed, with windows,
/// sills, doors and wavy roofs), sheds, trees and ground of 1 m tiles. Streets run along x = 5.5 + 51 i and
/// y = 5.5 + 51 j. The town can be repeated by instances up to 100 M triangles and more.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct City {
    /// Seed of everything random.
    pub seed: u64,
    /// Blocks along one side: 1 to 64.
    pub blocks: u32,
    /// How often the town is repeated along each side, by instances: 1 to 64. Nine gives 100 M triangles.
    pub repeat: u32,
    /// Roof columns per metre: the finer, the more triangles. 0.5 to 100.
    pub roof_columns_per_metre: f32,
    /// Whether trees stand along the streets.
    pub trees: bool,
}

impl Default for City {
    /// The town of 1.4 M triangles.
    fn default() -> Self {
        Self { seed: 1, blocks: 6, repeat: 1, roof_columns_per_metre: 12.0, trees: true }
    }
}

/// Everything that is placed in one block, kept to place it again.
type Placed = (MeshId, DAffine3, String);

impl City {
    /// A town of few blocks with plain roofs, for tests: about 98,000 triangles.
    pub fn small() -> Self {
        Self { blocks: 2, roof_columns_per_metre: 2.0, ..Self::default() }
    }

    /// Length of the town's side in metres.
    pub fn side(&self) -> f64 {
        f64::from(self.blocks * self.repeat * PITCH + STREET)
    }

    /// The middle of a street: its x where it runs along y, its y where it runs along x.
    pub fn street(&self, number: u32) -> f64 {
        street_middle(f64::from(number))
    }

    /// Builds the scene.
    ///
    /// # Errors
    /// [`RasterError::Option`] when an option is out of its range.
    pub fn build(&self) -> Result<Scene, RasterError> {
        self.check()?;
        let mut scene = Scene::new();
        let material = scene.add_material(Material {
            name: "town".into(),
            base_colour: [1.0; 4],
            two_sided: false,
            ..Material::default()
        })?;
        let mut town: Vec<Placed> = Vec::new();
        let trees = if self.trees { self.tree_meshes(&mut scene)? } else { Vec::new() };
        for by in 0..self.blocks {
            for bx in 0..self.blocks {
                self.block(bx, by, &trees, &mut scene, &mut town)?;
            }
        }
        self.place(&mut scene, &town, material)?;
        self.border(&mut scene, material)?;
        scene.add_light(sun())?;
        Ok(scene)
    }

    fn check(&self) -> Result<(), RasterError> {
        let (blocks, repeat) = (self.blocks, self.repeat);
        let roof = self.roof_columns_per_metre;
        check("blocks", blocks.into(), "1..=64", (1..=64).contains(&blocks))?;
        check("repeat", repeat.into(), "1..=64", (1..=64).contains(&repeat))?;
        check("roof_columns_per_metre", roof.into(), "0.5..=100", (0.5..=100.0).contains(&roof))
    }

    /// Everything in one block and in the streets at its west and south.
    fn block(
        &self,
        bx: u32,
        by: u32,
        trees: &[MeshId],
        scene: &mut Scene,
        town: &mut Vec<Placed>,
    ) -> Result<(), RasterError> {
        let corner = DVec3::new(f64::from(bx * PITCH), f64::from(by * PITCH), 0.0);
        let random = Random::new(self.seed).fork(u64::from(by) << 32 | u64::from(bx));
        let name = |what: &str, n: usize| format!("{what} {bx}.{by}.{n}");
        let ground = ground(&mut random.fork(1), PITCH, PITCH, true)?;
        town.push((scene.add_mesh(ground), DAffine3::from_translation(corner), name("ground", 0)));
        let inner = corner + DVec3::new(f64::from(STREET), f64::from(STREET), 0.0);
        for (n, lot) in lots(&mut random.fork(2)).iter().enumerate() {
            let mut random = random.fork(100 + n as u64);
            let mut builder = Builder::default();
            let house = House {
                width: lot.width,
                depth: lot.depth,
                floors: lot.floors,
                open_left: lot.open_left,
                open_right: lot.open_right,
                roof_columns_per_metre: self.roof_columns_per_metre,
            };
            house.build(&mut random, &mut builder);
            let mesh = scene.add_mesh(builder.build()?);
            let turn = DAffine3::from_rotation_z(f64::from(lot.quarter_turns) * FRAC_PI_2);
            let at = DAffine3::from_translation(inner + lot.corner + DVec3::Z * f64::from(KERB)) * turn;
            town.push((mesh, at, name("house", n)));
        }
        let mut random = random.fork(3);
        for n in 0..6 {
            if trees.is_empty() {
                break;
            }
            let along = f64::from(STREET) + 4.0 + 13.0 * f64::from(n / 2) + random.range(-1.0, 1.0);
            let kerb = f64::from(STREET) - 1.5;
            let spot = match n {
                0 | 2 | 4 => DVec3::new(along, kerb, 0.0),
                1 => DVec3::new(f64::from(STREET) + random.range(14.0, 18.0), f64::from(STREET) + 15.0, 0.0),
                _ => DVec3::new(kerb, along, 0.0),
            };
            let turn = DQuat::from_rotation_z(random.range(0.0, TAU));
            let scale = DVec3::splat(random.range(0.8, 1.15));
            let at = DAffine3::from_scale_rotation_translation(scale, turn, corner + spot);
            town.push((trees[random.below(trees.len())], at, name("tree", n as usize)));
        }
        Ok(())
    }

    fn tree_meshes(&self, scene: &mut Scene) -> Result<Vec<MeshId>, RasterError> {
        (0..4)
            .map(|n| {
                let mut builder = Builder::default();
                super::tree::round_tree(&mut Random::new(self.seed).fork(1 << 40 | n), &mut builder);
                Ok(scene.add_mesh(builder.build()?))
            })
            .collect()
    }

    fn place(&self, scene: &mut Scene, town: &[Placed], material: MaterialId) -> Result<(), RasterError> {
        let period = f64::from(self.blocks * PITCH);
        for ty in 0..self.repeat {
            for tx in 0..self.repeat {
                let shift = DVec3::new(f64::from(tx), f64::from(ty), 0.0) * period;
                for (mesh, at, name) in town {
                    let at = DAffine3::from_translation(shift) * *at;
                    let name = if self.repeat == 1 { name.clone() } else { format!("{name} ({tx}, {ty})") };
                    scene.add_instance(Instance {
                        name,
                        mesh: *mesh,
                        world_from_mesh: at,
                        material: Some(material),
                    })?;
                }
            }
        }
        Ok(())
    }

    /// The streets at the far ends, which no block brings with it.
    fn border(&self, scene: &mut Scene, material: MaterialId) -> Result<(), RasterError> {
        let mut random = Random::new(self.seed).fork(1 << 41);
        let cells = self.blocks * self.repeat;
        let end = f64::from(cells * PITCH);
        let east = scene.add_mesh(ground(&mut random, STREET, PITCH, false)?);
        let north = scene.add_mesh(ground(&mut random, PITCH, STREET, false)?);
        let corner = scene.add_mesh(ground(&mut random, STREET, STREET, false)?);
        let mut add = |mesh, at: DVec3, name: String| {
            let world_from_mesh = DAffine3::from_translation(at);
            scene.add_instance(Instance { name, mesh, world_from_mesh, material: Some(material) })
        };
        for i in 0..cells {
            let along = f64::from(i * PITCH);
            add(east, DVec3::new(end, along, 0.0), format!("street east {i}"))?;
            add(north, DVec3::new(along, end, 0.0), format!("street north {i}"))?;
        }
        add(corner, DVec3::new(end, end, 0.0), "corner".into())?;
        Ok(())
    }
}

/// A low afternoon sun.
pub(crate) fn sun() -> Light {
    Light::Directional {
        direction: DVec3::new(0.55, 0.35, -0.65).normalize(),
        irradiance: Vec3::new(3.0, 2.75, 2.35),
        angular_radius: 0.00465,
    }
}

/// Where a house stands in its block: front corner, orientation, size.
struct Lot {
    corner: DVec3,
    quarter_turns: u32,
    width: f32,
    depth: f32,
    floors: u32,
    open_left: bool,
    open_right: bool,
}

/// Houses on the four sides of a block, fronts to the street, and sheds in the courtyard.
fn lots(random: &mut Random) -> Vec<Lot> {
    let mut lots = Vec::new();
    let side = f64::from(BLOCK);
    const DEPTH: f64 = 9.5;
    for turn in 0..4u32 {
        // The sides to the south and north own the corners of the block.
        let (from, to) = if turn % 2 == 0 { (0.0, side) } else { (DEPTH, side - DEPTH) };
        let count = if turn % 2 == 0 { 4 } else { 2 };
        let mut cuts: Vec<f64> =
            (0..=count).map(|i| from + (to - from) * f64::from(i) / f64::from(count)).collect();
        for cut in &mut cuts[1..count as usize] {
            *cut += random.range(-1.2, 1.2);
        }
        let gap = random.chance(0.5).then(|| random.below(count as usize));
        for i in 0..count as usize {
            let narrower = if gap == Some(i) && turn % 2 == 1 { 2.5 } else { 0.0 };
            let (a, b) = (cuts[i], cuts[i + 1] - narrower);
            // The front's left corner, seen along the facade, in the frame of this side.
            let local = DVec3::new(a, 0.0, 0.0);
            let (corner, turned) = match turn {
                0 => (local, 0),
                1 => (DVec3::new(side, a, 0.0), 1),
                2 => (DVec3::new(side - a, side, 0.0), 2),
                _ => (DVec3::new(0.0, side - a, 0.0), 3),
            };
            lots.push(Lot {
                corner,
                quarter_turns: turned,
                width: (b - a) as f32,
                depth: DEPTH as f32,
                floors: if random.chance(0.75) { 2 } else { 1 },
                open_left: turn % 2 == 0 && i == 0,
                open_right: (turn % 2 == 0 && i + 1 == count as usize) || narrower > 0.0,
            });
        }
    }
    for _ in 0..4 {
        let corner = DVec3::new(random.range(11.5, 24.0), random.range(11.5, 24.0), 0.0);
        let shed = Lot {
            corner,
            quarter_turns: 0,
            width: random.range_f32(2.4, 4.0),
            depth: random.range_f32(2.4, 3.6),
            floors: 1,
            open_left: true,
            open_right: true,
        };
        let clear = |o: &Lot| {
            let (dx, dy) = ((o.corner.x - corner.x).abs(), (o.corner.y - corner.y).abs());
            o.depth > 5.0 || dx > 4.5 || dy > 4.5
        };
        if lots.iter().all(clear) {
            lots.push(shed);
        }
    }
    lots
}

const ASPHALT: Rgb = [84, 84, 88];
const PAVING: Rgb = [166, 160, 150];
const GRASS: Rgb = [98, 122, 62];
const COBBLES: Rgb = [132, 122, 110];

/// Ground of 1 m tiles: roads in the first [`STREET`] metres of each axis, pavements a kerb higher, a courtyard of grass.
///
/// With `block` false everything is street: the border of the town.
fn ground(
    random: &mut Random,
    width: u32,
    depth: u32,
    block: bool,
) -> Result<farsight_geometry::TriangleMesh, RasterError> {
    let mut out = Builder::default();
    let road = |t: u32| (PAVEMENT..STREET - PAVEMENT).contains(&t);
    let is_road = |x: u32, y: u32| road(x) || road(y);
    let height = |x: u32, y: u32| if is_road(x, y) { 0.0 } else { KERB };
    for y in 0..depth {
        for x in 0..width {
            let inside = block && x >= STREET && y >= STREET;
            let edge = |t: u32| !(STREET + 10..PITCH - 10).contains(&t);
            let colour = if is_road(x, y) {
                let stripe = x == STREET / 2 && y % 4 < 2 && y >= STREET
                    || y == STREET / 2 && x % 4 < 2 && x >= STREET;
                if stripe { shaded(ASPHALT, 1.25) } else { ASPHALT }
            } else if inside && !(edge(x) || edge(y)) {
                GRASS
            } else if inside {
                COBBLES
            } else {
                PAVING
            };
            let colour = shaded(colour, random.range_f32(0.93, 1.05));
            let z = height(x, y);
            let corner = Vec3::new(x as f32, y as f32, z);
            out.parallelogram(corner, Vec3::X, Vec3::Y, colour);
            let kerb = shaded(PAVING, 0.85);
            // Kerbs towards the neighbours at the east and north; each step is seen once.
            if x + 1 < width && height(x + 1, y) != z {
                wall_x(&mut out, corner + Vec3::X, height(x + 1, y) - z, kerb);
            }
            if y + 1 < depth && height(x, y + 1) != z {
                wall_y(&mut out, corner + Vec3::Y, height(x, y + 1) - z, kerb);
            }
        }
    }
    out.build()
}

/// A step across x at `corner`, facing the lower side.
fn wall_x(out: &mut Builder, corner: Vec3, rise: f32, colour: Rgb) {
    if rise > 0.0 {
        out.parallelogram(corner, Vec3::Z * rise, Vec3::Y, colour);
    } else {
        out.parallelogram(corner + Vec3::Z * rise, Vec3::Y, Vec3::Z * -rise, colour);
    }
}

/// A step across y at `corner`, facing the lower side.
fn wall_y(out: &mut Builder, corner: Vec3, rise: f32, colour: Rgb) {
    if rise > 0.0 {
        out.parallelogram(corner, Vec3::X, Vec3::Z * rise, colour);
    } else {
        out.parallelogram(corner + Vec3::Z * rise, Vec3::Z * -rise, Vec3::X, colour);
    }
}
