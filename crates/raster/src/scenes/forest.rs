//! Trees of many disconnected leaves: the case that merges badly and occludes only in sum.

use super::builder::{Builder, shaded};
use super::check;
use crate::RasterError;
use crate::random::Random;
use farsight_geometry::Scene;
use farsight_geometry::scene::{Instance, Material};
use glam::{DAffine3, DQuat, DVec3, Vec3};

/// A wood: instanced trees whose crowns are loose quads, on a floor with slight waves.
///
/// By default 600 trees of 5 kinds with 6,000 leaves each: 7.2 M triangles placed, 61,000 stored.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Forest {
    /// Seed of everything random.
    pub seed: u64,
    /// Number of trees: up to a million.
    pub trees: u32,
    /// Leaves of a tree, two triangles each: 1 to a million.
    pub leaves: u32,
    /// Different trees: 1 to 64.
    pub kinds: u32,
    /// Metres between neighbouring trees on average.
    pub spacing: f64,
}

impl Default for Forest {
    fn default() -> Self {
        Self { seed: 1, trees: 600, leaves: 6000, kinds: 5, spacing: 6.0 }
    }
}

impl Forest {
    /// Side of the square that the wood fills, in metres; a corner lies at the origin.
    pub fn side(&self) -> f64 {
        f64::from(self.trees).sqrt().ceil().max(1.0) * self.spacing
    }

    /// Builds the scene.
    ///
    /// # Errors
    /// [`RasterError::Option`] when an option is out of its range.
    pub fn build(&self) -> Result<Scene, RasterError> {
        let (trees, leaves, kinds) = (self.trees, self.leaves, self.kinds);
        check("trees", trees.into(), "0..=1000000", trees <= 1_000_000)?;
        check("leaves", leaves.into(), "1..=1000000", (1..=1_000_000).contains(&leaves))?;
        check("kinds", kinds.into(), "1..=64", (1..=64).contains(&kinds))?;
        check("spacing", self.spacing, "[0.5, 100]", (0.5..=100.0).contains(&self.spacing))?;
        let mut scene = Scene::new();
        let material = Some(scene.add_material(Material {
            name: "wood".into(),
            base_colour: [1.0; 4],
            ..Material::default()
        })?);
        let mut random = Random::new(self.seed);
        let mut meshes = Vec::new();
        for kind in 0..kinds {
            let mut builder = Builder::default();
            leafy_tree(leaves, &mut random.fork(u64::from(kind)), &mut builder);
            meshes.push(scene.add_mesh(builder.build()?));
        }
        let columns = f64::from(trees).sqrt().ceil().max(1.0) as u32;
        for i in 0..trees {
            let cell = DVec3::new(f64::from(i % columns), f64::from(i / columns), 0.0);
            let jitter = DVec3::new(random.range(0.15, 0.85), random.range(0.15, 0.85), 0.0);
            let at = (cell + jitter) * self.spacing;
            let at = at.with_z(f64::from(floor_height(at.x as f32, at.y as f32)) - 0.1);
            let turn = DQuat::from_rotation_z(random.range(0.0, std::f64::consts::TAU));
            let scale = DVec3::splat(random.range(0.75, 1.25));
            scene.add_instance(Instance {
                name: format!("tree {i}"),
                mesh: meshes[random.below(meshes.len())],
                world_from_mesh: DAffine3::from_scale_rotation_translation(scale, turn, at),
                material,
            })?;
        }
        let mesh = scene.add_mesh(self.floor(&mut random)?);
        scene.add_instance(Instance {
            name: "floor".into(),
            mesh,
            world_from_mesh: DAffine3::IDENTITY,
            material,
        })?;
        scene.add_light(super::city::sun())?;
        Ok(scene)
    }

    fn floor(&self, random: &mut Random) -> Result<farsight_geometry::TriangleMesh, RasterError> {
        let mut out = Builder::default();
        let cells = ((self.side() / 2.0).ceil() as u32).clamp(1, 1000);
        let step = self.side() as f32 / cells as f32;
        out.patch(cells, cells, |i, j| {
            let (x, y) = (i as f32 * step, j as f32 * step);
            let h = |x: f32, y: f32| floor_height(x, y);
            let normal = Vec3::new(h(x - 0.5, y) - h(x + 0.5, y), h(x, y - 0.5) - h(x, y + 0.5), 1.0);
            let colour = shaded([110, 100, 62], random.range_f32(0.8, 1.15));
            (Vec3::new(x, y, h(x, y)), normal.normalize(), colour)
        });
        out.build()
    }
}

fn floor_height(x: f32, y: f32) -> f32 {
    0.9 * (0.045 * x + 0.3).sin() * (0.052 * y).cos() + 0.3 * (0.13 * x - 0.09 * y).sin()
}

/// A tree of 7 to 11 m: trunk, limbs, and leaves in clusters around the limbs' ends.
fn leafy_tree(leaves: u32, random: &mut Random, out: &mut Builder) {
    let height = random.range_f32(7.0, 11.0);
    super::tree::trunk(0.75 * height, 0.024 * height, out);
    let width = random.range_f32(0.24, 0.34) * height;
    let clusters: Vec<(Vec3, f32)> = (0..26)
        .map(|_| {
            let d = random.direction();
            let up = random.range_f32(0.42, 1.0);
            // An egg-shaped crown: widest at about 60 % of the height.
            let reach = width * (1.0 - ((up - 0.62) / 0.45).powi(2)).max(0.05).sqrt();
            let flat = Vec3::new(d.x, d.y, 0.0).normalize_or(Vec3::X) * reach * random.unit().sqrt() as f32;
            (flat + Vec3::Z * (up * height), random.range_f32(0.5, 0.95))
        })
        .collect();
    for &(end, _) in &clusters {
        limb(Vec3::Z * (end.z * 0.72), end, 0.006 * height, out);
    }
    let red = random.range_f32(78.0, 112.0);
    let green = [red as u8, (red + random.range_f32(14.0, 30.0)) as u8, (0.55 * red) as u8];
    let middle = Vec3::Z * (0.62 * height);
    for _ in 0..leaves {
        let (center, radius) = clusters[random.below(clusters.len())];
        let p = center + random.direction() * (radius * random.unit().cbrt() as f32);
        let normal =
            (random.direction() + 0.6 * (p - middle).normalize_or_zero() + Vec3::Z * 0.3).normalize();
        let (u, v) = normal.any_orthonormal_pair();
        let size = random.range_f32(0.05, 0.11) * (6000.0 / leaves as f32).cbrt().clamp(0.5, 3.0);
        // Inner leaves get less of the sky.
        let open = ((p - middle).length() / width).clamp(0.45, 1.1);
        let colour = shaded(green, open * random.range_f32(0.8, 1.2));
        out.parallelogram(p - u * size - v * (0.6 * size), u * (2.0 * size), v * (1.2 * size), colour);
    }
}

/// A thin three-sided limb.
fn limb(from: Vec3, to: Vec3, radius: f32, out: &mut Builder) {
    let axis = (to - from).normalize_or(Vec3::Z);
    let (u, v) = axis.any_orthonormal_pair();
    out.patch(3, 1, |i, j| {
        let (sin, cos) = (std::f32::consts::TAU * (i % 3) as f32 / 3.0).sin_cos();
        let normal = u * cos + v * sin;
        let (at, r) = if j == 0 { (from, radius) } else { (to, 0.4 * radius) };
        (at + normal * r, normal, [88, 70, 52])
    });
}
