//! Points that stand for all triangles of a node: what a renderer without triangles draws.

use farsight_geometry::glam::Vec3;
use farsight_hlod::NodeMesh;
use std::collections::{BTreeMap, HashMap, HashSet};

/// Points with normals.
#[derive(Default)]
pub struct Points {
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub radius: f64,
}

/// Every triangle divided until the corners of its parts are within `2 · reach` of their barycentres; then points at corners and middles of sides, one a cell of
/// a grid of half the reach. Discs of their radius cover the surface.
pub fn all(mesh: &NodeMesh, reach: f64) -> Points {
    let cell = (0.5 * reach) as f32;
    let mut seen = HashSet::new();
    let mut out = Points { radius: reach * (1.0 + 0.5 * 3f64.sqrt()), ..Points::default() };
    for t in mesh.indices.as_chunks::<3>().0 {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        let middle = (a + b + c) / 3.0;
        let farthest = [a, b, c].iter().map(|p| p.distance(middle)).fold(0.0, f32::max);
        let face = (b - a).cross(c - a).normalize_or_zero();
        let normals = t.map(|v| mesh.normals.get(v as usize).copied().unwrap_or(face));
        // Parts along a side, and two steps to each of them.
        let steps = 2 * ((f64::from(farthest) / (2.0 * reach)).ceil().max(1.0) as u32);
        for i in 0..=steps {
            for j in 0..=steps - i {
                let (u, v) = (i as f32 / steps as f32, j as f32 / steps as f32);
                let at = a + (b - a) * u + (c - a) * v;
                if seen.insert((at / cell).floor().to_array().map(|x| x as i32)) {
                    let n = normals[0] * (1.0 - u - v) + normals[1] * u + normals[2] * v;
                    out.positions.push(at);
                    out.normals.push(n.normalize_or_zero());
                }
            }
        }
    }
    out
}

/// Bits that points take at least when they are stored on their own: which children of an octree over their cells are occupied (Botsch et al. 2002), and normals of
/// one byte an axis of the octahedron by their differences along a Z curve, both at their entropy.
pub fn stored_bits(positions: &[Vec3], normals: &[Vec3], cell: f32) -> f64 {
    let cells =
        positions.iter().map(|p| (*p / cell).floor().to_array().map(|x| (x as i64 + (1 << 20)) as u64));
    let spread = |x: u64| (0..21).fold(0u64, |z, bit| z | (x >> bit & 1) << (3 * bit));
    let code = |[x, y, z]: [u64; 3]| spread(x) | spread(y) << 1 | spread(z) << 2;
    let sorted: BTreeMap<u64, usize> = cells.map(code).zip(0..).collect();
    let mut level: Vec<u64> = sorted.keys().copied().collect();
    let mut bytes: HashMap<u64, u64> = HashMap::new();
    while level.len() > 1 {
        for parent in level.chunk_by(|a, b| a >> 3 == b >> 3) {
            *bytes.entry(parent.iter().fold(0, |byte, child| byte | 1 << (child & 7))).or_default() += 1;
        }
        level.iter_mut().for_each(|c| *c >>= 3);
        level.dedup();
    }
    let mut differences: [HashMap<u64, u64>; 2] = Default::default();
    let mut before = [0i32; 2];
    for n in sorted.values().filter_map(|&i| normals.get(i)) {
        let now = octahedron(*n);
        for k in 0..2 {
            *differences[k].entry((now[k] - before[k]) as u8 as u64).or_default() += 1;
        }
        before = now;
    }
    entropy(&bytes) + differences.iter().map(entropy).sum::<f64>()
}

fn octahedron(n: Vec3) -> [i32; 2] {
    let p = n / (n.x.abs() + n.y.abs() + n.z.abs()).max(1e-9);
    let fold = |a: f32, b: f32| (1.0 - b.abs()).copysign(a);
    let (x, y) = if p.z >= 0.0 { (p.x, p.y) } else { (fold(p.x, p.y), fold(p.y, p.x)) };
    [x, y].map(|x| (127.0 * x).round() as i32)
}

/// Bits of some symbols, each as often as it is counted.
fn entropy(counts: &HashMap<u64, u64>) -> f64 {
    let all = counts.values().sum::<u64>() as f64;
    counts.values().map(|&c| -(c as f64) * (c as f64 / all).log2()).sum()
}
