//! Attributes of vertices.
//!
//! Each position has a first vertex. Its normal is predicted from the triangles around it, the rest from the corners that its position was predicted
//! from. Where attributes have a seam, further vertices at the
//! same position follow, predicted from the first; corners there say which one they use.

use super::bits::{BitReader, BitWriter, Numbers};
use super::connectivity::{Origin, Walk};
use super::{Lattice, Shape};
use crate::appearance::Look;
use crate::piece::{Attributes, Piece};
use glam::{Vec2, Vec3, Vec4};

/// Steps of a texture coordinate in one.
const UV_STEPS: f32 = 16384.0;

/// How far normals are rounded at most, in radians.
pub(crate) const NORMAL_ROUNDING: f32 = 0.0125;

/// Channels: two for the normal's octahedron, two texture coordinates, four of the colour.
const CHANNELS: usize = 8;

/// Which channels an attribute takes.
fn channels(a: Attributes) -> impl Iterator<Item = usize> {
    let of = |on: bool, range: std::ops::Range<usize>| if on { range } else { 0..0 };
    of(a.normals, 0..2).chain(of(a.uvs, 2..4)).chain(of(a.colours, 4..8))
}

/// Attributes as whole numbers.
type Values = [i32; CHANNELS];

/// Decoded attributes, vertex by vertex; those that the mesh does not have are empty.
#[derive(Clone, Debug, Default)]
pub(crate) struct Looks {
    pub normals: Vec<Vec3>,
    pub uvs: Vec<Vec2>,
    pub colours: Vec<[u8; 4]>,
    values: Vec<Values>,
    /// Where the further vertices of each position begin.
    first_further: Vec<u32>,
    expected: Vec<[i32; 2]>,
    sums: Vec<Vec3>,
}

impl Looks {
    pub(crate) fn look(&self, v: usize) -> Look {
        Look {
            normal: self.normals.get(v).copied().unwrap_or_default(),
            uv: self.uvs.get(v).copied().unwrap_or_default(),
            colour: self.colours.get(v).map_or(Vec4::ZERO, |c| Vec4::from(c.map(f32::from)) / 255.0),
        }
    }

    pub(crate) fn clear(&mut self) {
        self.normals.clear();
        self.uvs.clear();
        self.colours.clear();
        self.values.clear();
    }
}

/// A direction as a point of the octahedron's square: -127 to 127 each; the zero vector has its own.
fn to_octahedron(n: Vec3) -> [i32; 2] {
    let sum = n.x.abs() + n.y.abs() + n.z.abs();
    if sum.is_nan() || sum <= 0.0 {
        return [-128, -128];
    }
    let p = Vec2::new(n.x, n.y) / sum;
    let p = if n.z >= 0.0 {
        p
    } else {
        let sign = |x: f32| if x >= 0.0 { 1.0 } else { -1.0 };
        Vec2::new((1.0 - p.y.abs()) * sign(p.x), (1.0 - p.x.abs()) * sign(p.y))
    };
    let unit = n.normalize();
    // The best of the four grid points around it.
    let base = (p * 127.0).floor();
    let mut best = (f32::NEG_INFINITY, [0, 0]);
    for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        let q = (base + Vec2::new(dx, dy)).clamp(Vec2::splat(-127.0), Vec2::splat(127.0));
        let q = [q.x as i32, q.y as i32];
        let near = from_octahedron(q).dot(unit);
        if near > best.0 {
            best = (near, q);
        }
    }
    best.1
}

#[inline(always)]
fn from_octahedron([x, y]: [i32; 2]) -> Vec3 {
    if x == -128 {
        return Vec3::ZERO;
    }
    let (x, y) = (x as f32 / 127.0, y as f32 / 127.0);
    let z = 1.0 - x.abs() - y.abs();
    let t = (-z).max(0.0);
    let (x, y) = (x - t.copysign(x), y - t.copysign(y));
    let v = Vec3::new(x, y, z);
    v * (1.0 / v.length())
}

/// The octahedron's point of each position's area-weighted normal: what its vertex's normal is expected to be. The same on every machine: `f32` sums in the
/// order of the triangles.
fn expected_normals(at: &[Lattice], indices: &[u32], into: &mut Vec<[i32; 2]>, sums: &mut Vec<Vec3>) {
    sums.clear();
    sums.resize(at.len(), Vec3::ZERO);
    let place = |v: u32| at.get(v as usize).copied().unwrap_or_default();
    let between = |p: Lattice, q: Lattice| {
        let one = |k: usize| q[k].wrapping_sub(p[k]) as f32;
        Vec3::new(one(0), one(1), one(2))
    };
    for &[i, j, k] in indices.as_chunks::<3>().0 {
        let a = place(i);
        let normal = between(a, place(j)).cross(between(a, place(k)));
        for v in [i, j, k] {
            if let Some(sum) = sums.get_mut(v as usize) {
                *sum += normal;
            }
        }
    }
    into.clear();
    into.extend(sums.iter().map(|n| {
        let scale = 127.0 / (n.x.abs() + n.y.abs() + n.z.abs());
        if !scale.is_finite() {
            return [0, 0];
        }
        let (x, y) = (n.x * scale, n.y * scale);
        let fold = |p: f32, q: f32| (127.0 - q.abs()).copysign(p);
        let (x, y) = if n.z >= 0.0 { (x, y) } else { (fold(x, y), fold(y, x)) };
        // Truncated after a shift: the same as rounding, and cheaper.
        [(x + 128.5) as i32 - 128, (y + 128.5) as i32 - 128]
    }));
}

fn values_of(look: &Look) -> Values {
    let [x, y] = to_octahedron(look.normal);
    let uv = (look.uv * UV_STEPS).round();
    let c = look.colour_bytes().map(i32::from);
    [x, y, uv.x as i32, uv.y as i32, c[0], c[1], c[2], c[3]]
}

/// What the codec makes of a look.
#[cfg(test)]
pub(super) fn rounded_look(look: &Look) -> Look {
    let v = values_of(look);
    Look {
        normal: from_octahedron([v[0], v[1]]),
        uv: Vec2::new(v[2] as f32, v[3] as f32) / UV_STEPS,
        colour: Vec4::new(v[4] as f32, v[5] as f32, v[6] as f32, v[7] as f32) / 255.0,
    }
}

/// The values expected at a new vertex, channel by channel.
#[inline(always)]
fn predicted(values: &[Values], origin: Origin, normal: [i32; 2], channel: usize) -> i32 {
    if channel < 2 {
        return normal[channel];
    }
    let of = |v: u32| values.get(v as usize).map_or(0, |v| v[channel]);
    let (a, b) = (of(origin.from), of(origin.to));
    match channel {
        // Texture coordinates go on as positions do.
        2 | 3 => a.wrapping_add(b).wrapping_sub(of(origin.apex)),
        _ => (a + b) >> 1,
    }
}

/// Ranges wrap around for all but texture coordinates.
#[inline(always)]
fn wrapped(channel: usize, difference: i32) -> i32 {
    match channel {
        2 | 3 => difference,
        _ => i32::from(difference as i8),
    }
}

#[inline(always)]
fn restored(channel: usize, guess: i32, difference: i32) -> i32 {
    match channel {
        0 | 1 => i32::from(guess.wrapping_add(difference) as i8),
        2 | 3 => guess.wrapping_add(difference),
        _ => i32::from(guess.wrapping_add(difference) as u8),
    }
}

/// Codes the looks of a mesh that was walked over, its positions as the decoder will have them; returns the bytes and the number of vertices.
pub(super) fn encode(
    piece: &Piece,
    position_of: &[u32],
    walk: &Walk,
    at: &[Lattice],
    attributes: Attributes,
) -> (Vec<u8>, u32) {
    // For each new position, its different values in order of use, and which one each corner uses.
    let mut at_position: Vec<Vec<Values>> = vec![Vec::new(); walk.order.len()];
    let mut uses: Vec<(u32, u32)> = Vec::with_capacity(3 * walk.source.len());
    for (triangle, &(source, corner)) in walk.triangles.iter().zip(&walk.source) {
        let old = piece.triangles[source as usize];
        for i in 0..3 {
            let vertex = old[(corner as usize + i) % 3];
            debug_assert_eq!(walk.order[triangle[i] as usize], position_of[vertex as usize]);
            let values = values_of(&piece.looks[vertex as usize]);
            let here = &mut at_position[triangle[i] as usize];
            let which = here.iter().position(|v| *v == values).unwrap_or_else(|| {
                here.push(values);
                here.len() - 1
            });
            uses.push((triangle[i], which as u32));
        }
    }
    let first: Vec<Values> = at_position.iter().map(|v| v[0]).collect();
    let constant: Vec<usize> =
        channels(attributes).filter(|&c| at_position.iter().flatten().all(|v| v[c] == first[0][c])).collect();
    let further: u32 = at_position.iter().map(|v| v.len() as u32 - 1).sum();
    let mut writer = BitWriter::default();
    writer.put(constant.iter().map(|c| 1u32 << c).sum(), CHANNELS as u32);
    for &c in &constant {
        writer.put(first[0][c] as u32, 32);
    }
    let varying: Vec<usize> = channels(attributes).filter(|c| !constant.contains(c)).collect();
    let mut numbers = [Numbers::default(); CHANNELS];
    let (mut normals, mut sums) = (Vec::new(), Vec::new());
    expected_normals(at, walk.triangles.as_flattened(), &mut normals, &mut sums);
    for v in 0..first.len() {
        for &c in &varying {
            let guess = predicted(&first[..v], walk.origins[v], normals[v], c);
            numbers[c].put(&mut writer, wrapped(c, first[v][c].wrapping_sub(guess)));
        }
    }
    writer.put_gamma(further);
    if further > 0 {
        let mut counts = Numbers::default();
        let mut numbers = [Numbers::default(); CHANNELS];
        for here in &at_position {
            counts.put(&mut writer, here.len() as i32 - 1);
            for other in &here[1..] {
                for &c in &varying {
                    numbers[c].put(&mut writer, wrapped(c, other[c].wrapping_sub(here[0][c])));
                }
            }
        }
        for (position, which) in uses {
            let count = at_position[position as usize].len() as u32;
            writer.put(which, bits_for(count));
        }
    }
    (writer.finish(), first.len() as u32 + further)
}

/// Bits that tell so many apart.
#[inline(always)]
fn bits_for(count: u32) -> u32 {
    32 - (count - 1).leading_zeros()
}

/// Decodes the looks of a shape that was decoded for it; adds positions and changes indices where there are seams. `false` for what
/// no encoder wrote.
pub(crate) fn decode_looks(
    bytes: &[u8],
    vertices: u32,
    attributes: Attributes,
    shape: &mut Shape,
    into: &mut Looks,
) -> bool {
    decode(bytes, vertices, attributes, shape, into).is_some()
}

fn decode(
    bytes: &[u8],
    vertices: u32,
    attributes: Attributes,
    shape: &mut Shape,
    into: &mut Looks,
) -> Option<()> {
    into.clear();
    let positions = shape.at.len();
    if u64::from(vertices) > 8 * bytes.len() as u64 + positions as u64 {
        return None;
    }
    let mut reader = BitReader::new(bytes);
    let constant = reader.take(CHANNELS as u32);
    let mut base: Values = [0; CHANNELS];
    for c in channels(attributes).filter(|c| constant >> c & 1 == 1) {
        base[c] = reader.take(32) as i32;
    }
    let mut varying = [0usize; CHANNELS];
    let mut count = 0;
    for c in channels(attributes).filter(|c| constant >> c & 1 == 0) {
        varying[count] = c;
        count += 1;
    }
    let varying = &varying[..count];
    let values = &mut into.values;
    values.reserve(vertices as usize);
    let mut numbers = [Numbers::default(); CHANNELS];
    if attributes.normals {
        expected_normals(&shape.at, &shape.indices, &mut into.expected, &mut into.sums);
    } else {
        into.expected.clear();
        into.expected.resize(positions, [0; 2]);
    }
    for (origin, normal) in shape.origins.iter().zip(&into.expected) {
        let mut new = base;
        for &c in varying {
            new[c] = restored(c, predicted(values, *origin, *normal, c), numbers[c].take(&mut reader));
        }
        values.push(new);
    }
    let further = reader.take_gamma();
    if reader.overran() || (positions as u32).checked_add(further)? != vertices {
        return None;
    }
    if further > 0 {
        part(&mut reader, varying, shape, into, vertices)?;
    }
    let values = &into.values;
    if attributes.normals {
        into.normals.extend(values.iter().map(|v| from_octahedron([v[0], v[1]])));
    }
    if attributes.uvs {
        into.uvs.extend(values.iter().map(|v| Vec2::new(v[2] as f32, v[3] as f32) / UV_STEPS));
    }
    if attributes.colours {
        into.colours.extend(values.iter().map(|v| [v[4], v[5], v[6], v[7]].map(|x| x as u8)));
    }
    Some(())
}

/// Reads further vertices, and which corner uses which.
fn part(
    reader: &mut BitReader,
    varying: &[usize],
    shape: &mut Shape,
    into: &mut Looks,
    vertices: u32,
) -> Option<()> {
    let Looks { values, first_further, .. } = into;
    let positions = shape.at.len();
    let mut counts = Numbers::default();
    let mut numbers = [Numbers::default(); CHANNELS];
    first_further.clear();
    for p in 0..positions {
        first_further.push(values.len() as u32);
        let more = u32::try_from(counts.take(reader)).ok()?;
        if more > vertices - values.len() as u32 {
            return None;
        }
        for _ in 0..more {
            let mut new = values[p];
            for &c in varying {
                new[c] = restored(c, values[p][c], numbers[c].take(reader));
            }
            values.push(new);
            let at: Lattice = shape.at[p];
            shape.at.push(at);
        }
    }
    first_further.push(values.len() as u32);
    if values.len() as u32 != vertices {
        return None;
    }
    for corner in &mut shape.indices {
        let p = *corner as usize;
        let first = *first_further.get(p)?;
        let more = *first_further.get(p + 1)? - first;
        if more > 0 {
            let which = reader.take(bits_for(more + 1));
            if which > more {
                return None;
            }
            if which > 0 {
                *corner = first + which - 1;
            }
        }
    }
    (!reader.overran()).then_some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_come_back_within_a_degree() {
        let mut worst = 1.0f32;
        for i in 0..20_000 {
            let t = i as f32;
            let n = Vec3::new((t * 0.7).sin(), (t * 1.3).cos(), (t * 0.37).sin() * 1.2);
            let n = n.normalize();
            let back = rounded_look(&Look { normal: n, ..Look::default() });
            worst = worst.min(back.normal.dot(n));
            // Rounding twice changes nothing.
            assert!(rounded_look(&back).normal.distance(back.normal) < 1e-6);
        }
        assert!(worst.acos() < NORMAL_ROUNDING, "{}", worst.acos());
        assert_eq!(rounded_look(&Look::default()).normal, Vec3::ZERO);
    }
}
