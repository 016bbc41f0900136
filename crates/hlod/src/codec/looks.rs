//! Attributes of vertices.
//!
//! Each position has a first vertex. Its normal is predicted from the triangles around it, the rest from the corners that its position was predicted
//! from. Where attributes have a seam, further vertices at the
//! same position follow, predicted from the first; corners there say which one they use.

use super::bits::{BitReader, BitWriter, Numbers, bits_for, put_block, take_block};
use super::connectivity::{Origin, Walk};
use super::{Lattice, Shape};
use crate::appearance::Look;
use crate::piece::{Attributes, Piece};
use glam::{Vec2, Vec3, Vec4};

/// Steps of a texture coordinate in one.
const UV_STEPS: f32 = 16384.0;

/// How far normals are rounded at most, in radians.
pub(crate) const NORMAL_ROUNDING: f32 = 0.0125;

/// Attributes as whole numbers, in pairs: the normal on the octahedron, texture coordinates, red and green, blue and alpha.
type Pair = [i32; 2];

const NORMAL: usize = 0;
const UV: usize = 1;
const RED_GREEN: usize = 2;
const BLUE_ALPHA: usize = 3;

/// Pairs that attributes take.
fn pairs(a: Attributes) -> impl Iterator<Item = usize> {
    let all = [(NORMAL, a.normals), (UV, a.uvs), (RED_GREEN, a.colours), (BLUE_ALPHA, a.colours)];
    all.into_iter().filter_map(|(pair, there)| there.then_some(pair))
}

/// Decoded attributes, vertex by vertex; those that the mesh does not have are empty.
#[derive(Clone, Debug, Default)]
pub(crate) struct Looks {
    pub normals: Vec<Vec3>,
    pub uvs: Vec<Vec2>,
    pub colours: Vec<[u8; 4]>,
    values: [Vec<Pair>; 4],
    /// Where the further vertices of each position begin.
    first_further: Vec<u32>,
    expected: Vec<Pair>,
    sums: Vec<[f32; 4]>,
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
        self.values.iter_mut().for_each(Vec::clear);
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
        let near = direction(q).dot(unit);
        if near > best.0 {
            best = (near, q);
        }
    }
    best.1
}

/// Directions at a time, for the processor's vectors.
const LANES: usize = 8;

/// The directions of some points of the octahedron.
#[inline(always)]
fn from_octahedron(points: [Pair; LANES]) -> [Vec3; LANES] {
    let [mut x, mut y, mut z] = [[0.0f32; LANES]; 3];
    for i in 0..LANES {
        let [u, v] = points[i];
        (x[i], y[i]) = (u as f32 / 127.0, v as f32 / 127.0);
        z[i] = 1.0 - x[i].abs() - y[i].abs();
        let fold = (-z[i]).max(0.0);
        (x[i], y[i]) = (x[i] - fold.copysign(x[i]), y[i] - fold.copysign(y[i]));
        let scale = 1.0 / (x[i] * x[i] + y[i] * y[i] + z[i] * z[i]).sqrt();
        let scale = if u == -128 { 0.0 } else { scale };
        (x[i], y[i], z[i]) = (x[i] * scale, y[i] * scale, z[i] * scale);
    }
    std::array::from_fn(|i| Vec3::new(x[i], y[i], z[i]))
}

fn direction(point: Pair) -> Vec3 {
    from_octahedron([point; LANES])[0]
}

fn directions(points: &[Pair], into: &mut Vec<Vec3>) {
    let (whole, rest) = points.as_chunks::<LANES>();
    whole.iter().for_each(|&points| into.extend(from_octahedron(points)));
    into.extend(rest.iter().map(|&point| direction(point)));
}

/// The octahedron's point of each position's area-weighted normal: what its vertex's normal is expected to be. The same on every machine: `f32` sums in the
/// order of the triangles.
fn expected_normals(at: &[Lattice], triangles: &[[u32; 3]], into: &mut Vec<Pair>, sums: &mut Vec<[f32; 4]>) {
    // Four numbers each, so that they are added at once.
    sums.clear();
    sums.resize(at.len(), [0.0; 4]);
    for &[i, j, k] in triangles {
        let (Some(&a), Some(&b), Some(&c)) = (at.get(i as usize), at.get(j as usize), at.get(k as usize))
        else {
            continue;
        };
        let to = |p: i32, q: i32| q.wrapping_sub(p) as f32;
        let (e, f) = (
            [to(a[0], b[0]), to(a[1], b[1]), to(a[2], b[2])],
            [to(a[0], c[0]), to(a[1], c[1]), to(a[2], c[2])],
        );
        let n = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0], 0.0];
        for v in [i, j, k] {
            let s = &mut sums[v as usize];
            *s = [s[0] + n[0], s[1] + n[1], s[2] + n[2], s[3] + n[3]];
        }
    }
    into.clear();
    let (whole, rest) = sums.as_chunks::<LANES>();
    whole.iter().for_each(|sums| into.extend(points(sums)));
    into.extend(rest.iter().map(|sum| points(&[*sum; LANES])[0]));
}

/// The nearest points of the octahedron to some directions; that of no direction is the middle.
#[inline(always)]
fn points(of: &[[f32; 4]; LANES]) -> [Pair; LANES] {
    let mut points = [[0; 2]; LANES];
    for i in 0..LANES {
        let [x, y, z, _] = of[i];
        let sum = x.abs() + y.abs() + z.abs();
        let scale = if sum > 0.0 { 127.0 / sum } else { 0.0 };
        let (x, y) = (x * scale, y * scale);
        let (u, v) = ((127.0 - y.abs()).copysign(x), (127.0 - x.abs()).copysign(y));
        let (x, y) = if z >= 0.0 { (x, y) } else { (u, v) };
        // Truncated after a shift: the same as rounding, and cheaper.
        points[i] = [(x + 128.5) as i32 - 128, (y + 128.5) as i32 - 128];
    }
    points
}

fn values_of(look: &Look) -> [Pair; 4] {
    let uv = (look.uv * UV_STEPS).round();
    let [r, g, b, a] = look.colour_bytes().map(i32::from);
    [to_octahedron(look.normal), [uv.x as i32, uv.y as i32], [r, g], [b, a]]
}

/// What the codec makes of a look.
#[cfg(test)]
pub(super) fn rounded_look(look: &Look) -> Look {
    let [normal, uv, [r, g], [b, a]] = values_of(look);
    Look {
        normal: direction(normal),
        uv: Vec2::new(uv[0] as f32, uv[1] as f32) / UV_STEPS,
        colour: Vec4::new(r as f32, g as f32, b as f32, a as f32) / 255.0,
    }
}

/// The values expected at a new vertex.
#[inline(always)]
fn predicted<const PAIR: usize>(before: &[Pair], origin: Origin, normal: Pair) -> Pair {
    let of = |v: u32| before.get(v as usize).copied().unwrap_or_default();
    let both = |f: fn(i32, i32) -> i32, a: Pair, b: Pair| [f(a[0], b[0]), f(a[1], b[1])];
    match PAIR {
        NORMAL => normal,
        // Texture coordinates go on as positions do.
        UV => {
            both(i32::wrapping_sub, both(i32::wrapping_add, of(origin.from), of(origin.to)), of(origin.apex))
        }
        _ => both(|a, b| a.wrapping_add(b) >> 1, of(origin.from), of(origin.to)),
    }
}

/// Ranges wrap around for all but texture coordinates.
#[inline(always)]
fn wrapped<const PAIR: usize>(difference: i32) -> i32 {
    if PAIR == UV { difference } else { i32::from(difference as i8) }
}

#[inline(always)]
fn restored<const PAIR: usize>(guess: i32, difference: i32) -> i32 {
    let value = guess.wrapping_add(difference);
    match PAIR {
        NORMAL => i32::from(value as i8),
        UV => value,
        _ => i32::from(value as u8),
    }
}

/// Which numbers of a pair differ between vertices; the others have a value for all.
#[derive(Clone, Copy, Debug)]
struct Varying {
    is: [bool; 2],
    base: Pair,
}

impl Varying {
    fn put(self, numbers: &mut [Numbers; 2], writer: &mut BitWriter, off: Pair) {
        let [first, second] = numbers.each_mut().map(std::array::from_mut);
        match self.is {
            [true, true] => Numbers::put(numbers, writer, off),
            [true, false] => Numbers::put(first, writer, [off[0]]),
            [false, true] => Numbers::put(second, writer, [off[1]]),
            [false, false] => {}
        }
    }

    /// The next values of a pair.
    #[inline(always)]
    fn take<const PAIR: usize>(
        self,
        numbers: &mut [Numbers; 2],
        reader: &mut BitReader,
        guess: Pair,
    ) -> Pair {
        if self.is == [true, true] {
            let off = Numbers::take(numbers, reader);
            return [restored::<PAIR>(guess[0], off[0]), restored::<PAIR>(guess[1], off[1])];
        }
        let mut values = self.base;
        for k in 0..2 {
            if self.is[k] {
                let [off] = Numbers::take(std::array::from_mut(&mut numbers[k]), reader);
                values[k] = restored::<PAIR>(guess[k], off);
            }
        }
        values
    }
}

/// Calls a function that is made for each pair.
macro_rules! for_pair {
    ($pair:expr, $function:ident($($argument:expr),*)) => {
        match $pair {
            NORMAL => $function::<NORMAL>($($argument),*),
            UV => $function::<UV>($($argument),*),
            RED_GREEN => $function::<RED_GREEN>($($argument),*),
            _ => $function::<BLUE_ALPHA>($($argument),*),
        }
    };
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
    let mut at_position: Vec<Vec<[Pair; 4]>> = vec![Vec::new(); walk.order.len()];
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
    let further: u32 = at_position.iter().map(|v| v.len() as u32 - 1).sum();
    let (mut normals, mut sums) = (Vec::new(), Vec::new());
    expected_normals(at, &walk.triangles, &mut normals, &mut sums);
    let (mut head, mut body) = (BitWriter::default(), Vec::new());
    for pair in pairs(attributes) {
        let mut values = at_position.iter().flatten().map(|v| v[pair]);
        let base = values.next().unwrap_or_default();
        let is = [0, 1].map(|k| at_position.iter().flatten().any(|v| v[pair][k] != base[k]));
        let varying = Varying { is, base };
        (0..2).for_each(|k| match is[k] {
            true => head.put(1, 1),
            false => {
                head.put(0, 1);
                head.put(base[k] as u32, 32);
            }
        });
        let mut stream = BitWriter::default();
        for_pair!(pair, put_pair(&mut stream, varying, pair, &at_position, &walk.origins, &normals));
        put_block(&stream.finish(), &mut body);
    }
    head.put_gamma(further);
    if further > 0 {
        for (position, which) in uses {
            head.put(which, bits_for(at_position[position as usize].len() as u32));
        }
        let mut counts = [Numbers::default()];
        let mut stream = BitWriter::default();
        at_position.iter().for_each(|here| Numbers::put(&mut counts, &mut stream, [here.len() as i32 - 1]));
        put_block(&stream.finish(), &mut body);
    }
    let mut bytes = Vec::new();
    put_block(&head.finish(), &mut bytes);
    bytes.extend(body);
    (bytes, walk.order.len() as u32 + further)
}

/// Writes a pair: of the first vertex of each position, then of all further ones.
fn put_pair<const PAIR: usize>(
    writer: &mut BitWriter,
    varying: Varying,
    pair: usize,
    at_position: &[Vec<[Pair; 4]>],
    origins: &[Origin],
    normals: &[Pair],
) {
    let off = |value: Pair, guess: Pair| [0, 1].map(|k| wrapped::<PAIR>(value[k].wrapping_sub(guess[k])));
    let mut numbers = [Numbers::default(); 2];
    let first: Vec<Pair> = at_position.iter().map(|v| v[0][pair]).collect();
    for v in 0..first.len() {
        let guess = predicted::<PAIR>(&first[..v], origins[v], normals[v]);
        varying.put(&mut numbers, writer, off(first[v], guess));
    }
    let mut numbers = [Numbers::default(); 2];
    for here in at_position {
        for other in &here[1..] {
            varying.put(&mut numbers, writer, off(other[pair], here[0][pair]));
        }
    }
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
    let mut rest = bytes;
    let mut head = BitReader::new(take_block(&mut rest)?);
    let mut varying = [Varying { is: [false; 2], base: [0; 2] }; 4];
    let mut streams: [&[u8]; 4] = [&[]; 4];
    for pair in pairs(attributes) {
        for k in 0..2 {
            varying[pair].is[k] = head.take(1) == 1;
            if !varying[pair].is[k] {
                varying[pair].base[k] = head.take(32) as i32;
            }
        }
        streams[pair] = take_block(&mut rest)?;
    }
    let further = head.take_gamma();
    if head.overran() || (positions as u32).checked_add(further)? != vertices {
        return None;
    }
    if attributes.normals {
        // Before seams part corners: a normal is expected where all triangles at a position face.
        expected_normals(&shape.at, shape.indices.as_chunks::<3>().0, &mut into.expected, &mut into.sums);
    }
    into.first_further.clear();
    if further > 0 {
        part(&mut head, take_block(&mut rest)?, vertices, shape, &mut into.first_further)?;
    }
    for pair in pairs(attributes) {
        let values = &mut into.values[pair];
        values.resize(vertices as usize, [0; 2]);
        let further = &into.first_further;
        for_pair!(
            pair,
            take_pair(streams[pair], varying[pair], &shape.origins, &into.expected, further, values)
        )?;
    }
    let [normals, uvs, red_green, blue_alpha] = &into.values;
    directions(normals, &mut into.normals);
    into.uvs.extend(uvs.iter().map(|v| Vec2::new(v[0] as f32, v[1] as f32) / UV_STEPS));
    let colour = |(x, y): (&Pair, &Pair)| [x[0], x[1], y[0], y[1]].map(|x| x as u8);
    into.colours.extend(red_green.iter().zip(blue_alpha).map(colour));
    Some(())
}

/// Reads a pair of all vertices, the first of each position and then further ones.
fn take_pair<const PAIR: usize>(
    stream: &[u8],
    varying: Varying,
    origins: &[Origin],
    normals: &[Pair],
    first_further: &[u32],
    values: &mut [Pair],
) -> Option<()> {
    let mut reader = BitReader::new(stream);
    let mut numbers = [Numbers::default(); 2];
    for (v, &origin) in origins.iter().enumerate() {
        let normal = if PAIR == NORMAL { normals[v] } else { [0; 2] };
        let guess = predicted::<PAIR>(values, origin, normal);
        values[v] = varying.take::<PAIR>(&mut numbers, &mut reader, guess);
    }
    let mut numbers = [Numbers::default(); 2];
    for (p, ends) in first_further.windows(2).enumerate() {
        for further in ends[0]..ends[1] {
            values[further as usize] = varying.take::<PAIR>(&mut numbers, &mut reader, values[p]);
        }
    }
    (!reader.overran()).then_some(())
}

/// Makes further vertices, and reads which corner uses which.
fn part(
    head: &mut BitReader,
    counts: &[u8],
    vertices: u32,
    shape: &mut Shape,
    first_further: &mut Vec<u32>,
) -> Option<()> {
    let positions = shape.at.len();
    let mut reader = BitReader::new(counts);
    let mut numbers = [Numbers::default()];
    for p in 0..positions {
        let first = shape.at.len() as u32;
        first_further.push(first);
        let [more] = Numbers::take(&mut numbers, &mut reader);
        if more < 0 || more as u32 > vertices - first {
            return None;
        }
        shape.at.resize((first + more as u32) as usize, shape.at[p]);
    }
    first_further.push(shape.at.len() as u32);
    if shape.at.len() as u32 != vertices || reader.overran() {
        return None;
    }
    for corner in &mut shape.indices {
        let p = *corner as usize;
        let first = *first_further.get(p)?;
        let more = *first_further.get(p + 1)? - first;
        if more > 0 {
            let which = head.take(bits_for(more + 1));
            if which > more {
                return None;
            }
            if which > 0 {
                *corner = first + which - 1;
            }
        }
    }
    (!head.overran()).then_some(())
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
