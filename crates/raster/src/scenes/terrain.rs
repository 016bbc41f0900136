//! Hills as a triangulated irregular network.

use super::builder::{Rgb, shaded};
use super::check;
use crate::RasterError;
use crate::random::{Random, mix};
use farsight_geometry::scene::{Instance, Material};
use farsight_geometry::{Scene, TriangleMesh};
use glam::{DAffine3, DVec2, DVec3, Vec3};
use spade::{DelaunayTriangulation, Point2, Triangulation as _};

/// A Delaunay triangulation of scattered points on an analytic height field, cut into square tiles.
///
/// By default 250,000 points over 4 x 4 km, 500,000 triangles in 64 tiles, heights within about 600 m. Neighbouring tiles
/// meet in the same vertices, so there are no gaps.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Terrain {
    /// Seed of everything random.
    pub seed: u64,
    /// Number of points: 16 to 50 million.
    pub points: u32,
    /// Side of the square in metres; a corner lies at the origin.
    pub side: f64,
    /// Tiles along one side: 1 to 256.
    pub tiles: u32,
    /// Factor on all heights.
    pub relief: f64,
}

impl Default for Terrain {
    fn default() -> Self {
        Self { seed: 1, points: 250_000, side: 4000.0, tiles: 8, relief: 1.0 }
    }
}

impl Terrain {
    /// Height in metres at a point.
    pub fn height(&self, x: f64, y: f64) -> f64 {
        let p = DVec2::new(x, y) / 4000.0 * 3.0;
        // Ridges (folded noise) that fade out in the valleys, after Musgrave's multifractals.
        let (mut sum, mut amplitude, mut frequency, mut weight) = (0.0, 1.0, 1.0, 1.0);
        for octave in 0..8 {
            let n = noise(p * frequency, self.seed.wrapping_add(octave));
            let ridge = (1.0 - n.abs()).powi(2);
            sum += ridge * amplitude * weight;
            weight *= (ridge * 1.4).clamp(0.0, 1.0);
            amplitude *= 0.46;
            frequency *= 2.03;
        }
        self.relief * 380.0 * (sum - 0.5)
    }

    /// Unit normal of the height field.
    fn normal(&self, x: f64, y: f64) -> Vec3 {
        let h = 0.5;
        let dx = (self.height(x + h, y) - self.height(x - h, y)) / (2.0 * h);
        let dy = (self.height(x, y + h) - self.height(x, y - h)) / (2.0 * h);
        DVec3::new(-dx, -dy, 1.0).normalize().as_vec3()
    }

    /// Builds the scene: an instance per tile.
    ///
    /// # Errors
    /// [`RasterError::Option`] when an option is out of its range.
    pub fn build(&self) -> Result<Scene, RasterError> {
        let (points, tiles) = (self.points, self.tiles);
        check("points", points.into(), "16..=50000000", (16..=50_000_000).contains(&points))?;
        check("side", self.side, "[1, 1e6]", (1.0..=1e6).contains(&self.side))?;
        check("tiles", tiles.into(), "1..=256", (1..=256).contains(&tiles))?;
        check("relief", self.relief, "[0, 100]", (0.0..=100.0).contains(&self.relief))?;
        let scattered = self.scatter();
        let sites = scattered.iter().map(|p| Point2::new(p.x, p.y)).collect();
        let network = DelaunayTriangulation::<Point2<f64>>::bulk_load_stable(sites)
            .map_err(|_| RasterError::Option { option: "side", value: self.side, range: "[1, 1e6]" })?;
        let mut triangles = vec![Vec::new(); (tiles * tiles) as usize];
        for face in network.inner_faces() {
            let corners = face.vertices().map(|v| v.index() as u32);
            let center = corners.iter().map(|&i| scattered[i as usize]).sum::<DVec2>() / 3.0;
            let tile = |t: f64| ((t / self.side * f64::from(tiles)) as u32).min(tiles - 1);
            triangles[(tile(center.y) * tiles + tile(center.x)) as usize].push(corners);
        }
        let mut scene = Scene::new();
        let material = Some(scene.add_material(Material {
            name: "ground".into(),
            base_colour: [1.0; 4],
            two_sided: false,
            ..Material::default()
        })?);
        for (i, triangles) in triangles.iter().enumerate().filter(|(_, t)| !t.is_empty()) {
            let mesh = scene.add_mesh(self.tile(&scattered, triangles)?);
            let name = format!("tile {} {}", i % tiles as usize, i / tiles as usize);
            scene.add_instance(Instance { name, mesh, world_from_mesh: DAffine3::IDENTITY, material })?;
        }
        scene.add_light(super::city::sun())?;
        Ok(scene)
    }

    /// One point in each cell of a grid, on the border for cells there.
    fn scatter(&self) -> Vec<DVec2> {
        let n = f64::from(self.points).sqrt().round() as u32;
        let mut random = Random::new(self.seed);
        let step = self.side / f64::from(n - 1);
        let mut points = Vec::with_capacity((n * n) as usize);
        for j in 0..n {
            for i in 0..n {
                let mut along = |k: u32| {
                    let jitter = random.range(-0.46, 0.46);
                    if k == 0 || k == n - 1 { f64::from(k) } else { f64::from(k) + jitter }
                };
                points.push(
                    (DVec2::new(along(i), along(j)) * step).clamp(DVec2::ZERO, DVec2::splat(self.side)),
                );
            }
        }
        points
    }

    fn tile(&self, points: &[DVec2], triangles: &[[u32; 3]]) -> Result<TriangleMesh, RasterError> {
        let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        let local = |i: u32| used.binary_search(&i).map_or(0, |k| k as u32);
        let triangles: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(local)).collect();
        // f32 positions straight from the origin, so that tiles agree in their common vertices to the bit.
        let place = |&i: &u32| {
            let p = points[i as usize];
            Vec3::new(p.x as f32, p.y as f32, self.height(p.x, p.y) as f32)
        };
        let positions: Vec<Vec3> = used.iter().map(place).collect();
        let normals: Vec<Vec3> =
            used.iter().map(|&i| self.normal(points[i as usize].x, points[i as usize].y)).collect();
        let colours = positions.iter().zip(&normals).map(|(p, n)| self.colour(*p, *n)).collect();
        Ok(TriangleMesh::new(positions, triangles)?.with_normals(normals)?.with_colours(colours)?)
    }

    fn colour(&self, p: Vec3, n: Vec3) -> [u8; 4] {
        const MEADOW: Rgb = [104, 124, 66];
        const FOREST: Rgb = [66, 88, 50];
        const ROCK: Rgb = [132, 124, 114];
        const SNOW: Rgb = [236, 240, 246];
        let blend = |a: Rgb, b: Rgb, t: f32| -> Rgb {
            let t = t.clamp(0.0, 1.0);
            std::array::from_fn(|k| (f32::from(a[k]) + (f32::from(b[k]) - f32::from(a[k])) * t) as u8)
        };
        let patch = noise(DVec2::new(f64::from(p.x), f64::from(p.y)) / 90.0, !self.seed) as f32;
        let height = p.z / self.relief.max(1e-3) as f32 + 40.0 * patch;
        let green = blend(MEADOW, FOREST, 0.5 + patch);
        let soil = blend(green, ROCK, (0.86 - n.z) * 7.0 + (height - 190.0) / 80.0);
        let [r, g, b] = blend(soil, SNOW, (height - 250.0) / 40.0 * ((n.z - 0.55) * 4.0).clamp(0.0, 1.0));
        let [r, g, b] = shaded([r, g, b], 1.0 + 0.08 * patch);
        [r, g, b, 255]
    }
}

/// Smooth noise of unit scale: gradients at whole coordinates (Perlin 2002), about −1 to 1.
fn noise(p: DVec2, seed: u64) -> f64 {
    let cell = p.floor();
    let f = p - cell;
    let gradient = |dx: f64, dy: f64| {
        let (x, y) = ((cell.x + dx) as i64 as u64, (cell.y + dy) as i64 as u64);
        let h = mix(seed ^ mix(x ^ mix(y)));
        let part = |bits: u64| (bits & 0xffff) as f64 / 32768.0 - 1.0;
        DVec2::new(part(h), part(h >> 16)).dot(f - DVec2::new(dx, dy))
    };
    let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v) = (fade(f.x), fade(f.y));
    let low = gradient(0.0, 0.0) * (1.0 - u) + gradient(1.0, 0.0) * u;
    let high = gradient(0.0, 1.0) * (1.0 - u) + gradient(1.0, 1.0) * u;
    1.6 * (low * (1.0 - v) + high * v)
}
