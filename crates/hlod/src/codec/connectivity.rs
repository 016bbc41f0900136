//! Which corners form triangles: a walk over the surface, one letter a triangle.
//!
//! A closed front of sides runs around what has been walked over. At the side where the walk stands, the triangle beyond it has a new corner (C), or one of the
//! front's next or previous side (R, L; E: of both, which closes the front), or some other known one (S); or there is none (B). After Gumhold & Straßer
//! 1998 and Rossignac 1999; any soup can be walked over, since a front need not be a simple curve.

use super::bits::{BitReader, BitWriter, bits_for, put_block, take_block};

const NONE: u32 = u32::MAX;

/// What is beyond a side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Letter {
    New,
    Right,
    Left,
    Close,
    Known,
    Border,
}

use Letter::{Border, Close, Known, Left, New, Right};

const LETTERS: [Letter; 6] = [New, Right, Left, Close, Known, Border];

/// Longest code of a letter.
const LONGEST: u32 = 5;

/// The front's sides.
#[derive(Clone, Copy, Debug)]
struct Side {
    from: u32,
    to: u32,
    /// Third corner of the triangle on the near side.
    apex: u32,
    previous: u32,
    next: u32,
}

#[derive(Clone, Debug, Default)]
struct Front {
    sides: Vec<Side>,
}

impl Front {
    /// The front around a first triangle; returns a side of it.
    fn begin(&mut self, [a, b, c]: [u32; 3]) -> u32 {
        // Fronts do not touch, and one is walked along at a time.
        self.sides.clear();
        let side = |from, to, apex, previous, next| Side { from, to, apex, previous, next };
        self.sides.extend([side(b, a, c, 2, 1), side(a, c, b, 0, 2), side(c, b, a, 1, 0)]);
        0
    }

    /// A corner that is not on a neighbouring side: the side becomes two; returns the second.
    #[inline(always)]
    fn divide(&mut self, at: u32, corner: u32) -> u32 {
        let Side { from, to, previous, next, .. } = self.sides[at as usize];
        let new = self.sides.len() as u32;
        self.sides[at as usize] = Side { from, to: corner, apex: to, previous, next: new };
        self.sides.push(Side { from: corner, to, apex: from, previous: at, next });
        self.sides[if next == at { new } else { next } as usize].previous = new;
        if next == at {
            // A front of one side.
            self.sides[new as usize].next = at;
            self.sides[at as usize].previous = new;
        }
        new
    }

    /// The triangle has the next side as well: both become one.
    #[inline(always)]
    fn join_next(&mut self, at: u32) {
        let Side { to, next, .. } = self.sides[at as usize];
        let gone = self.sides[next as usize];
        let side = &mut self.sides[at as usize];
        (side.to, side.apex) = (gone.to, to);
        self.unlink(next);
    }

    #[inline(always)]
    fn join_previous(&mut self, at: u32) {
        let Side { from, previous, .. } = self.sides[at as usize];
        let gone = self.sides[previous as usize];
        let side = &mut self.sides[at as usize];
        (side.from, side.apex) = (gone.from, from);
        self.unlink(previous);
    }

    /// Takes a side out of the front; returns the one after it, if there is another.
    #[inline(always)]
    fn unlink(&mut self, at: u32) -> u32 {
        let Side { previous, next, .. } = self.sides[at as usize];
        if next == at {
            return NONE;
        }
        self.sides[previous as usize].next = next;
        self.sides[next as usize].previous = previous;
        next
    }

    /// Takes out a side and both its neighbours.
    fn close(&mut self, at: u32) -> u32 {
        let Side { previous, next, .. } = self.sides[at as usize];
        let mut left = self.unlink(at);
        for gone in [previous, next] {
            if left != NONE && gone != at {
                left = self.unlink(gone);
            }
        }
        left
    }
}

/// The corners that a new one is predicted from: a side and the corner opposite to it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Origin {
    pub from: u32,
    pub to: u32,
    pub apex: u32,
}

/// Codes of letters, one set for each letter before.
#[derive(Clone, Debug)]
struct Alphabet {
    /// Code length of each letter after each letter; zero where it does not occur.
    lengths: [[u32; 6]; 6],
}

impl Alphabet {
    /// Lengths by Huffman's rule, cut off at [`LONGEST`] by flattening the counts.
    fn fitting(mut counts: [[u32; 6]; 6]) -> Self {
        let mut lengths = [[0; 6]; 6];
        for (context, counts) in counts.iter_mut().enumerate() {
            loop {
                lengths[context] = huffman(counts);
                if lengths[context].iter().all(|&l| l <= LONGEST) {
                    break;
                }
                counts.iter_mut().filter(|c| **c > 0).for_each(|c| *c = *c / 2 + 1);
            }
        }
        Self { lengths }
    }

    /// The code of each letter, lowest bit first.
    fn codes(lengths: &[u32; 6]) -> [u32; 6] {
        let mut codes = [0; 6];
        let mut code = 0u32;
        for length in 1..=LONGEST {
            for letter in 0..6 {
                if lengths[letter] == length {
                    codes[letter] = code.reverse_bits() >> (32 - length);
                    code += 1;
                }
            }
            code <<= 1;
        }
        codes
    }

    fn put(&self, writer: &mut BitWriter) {
        self.lengths.iter().flatten().for_each(|&l| writer.put(l, 3));
    }

    /// For every context and next five bits, letter and length (times eight); `None` for what is no code.
    fn table(reader: &mut BitReader) -> Option<[[u8; 32]; 6]> {
        let mut table = [[0; 32]; 6];
        for row in &mut table {
            let lengths: [u32; 6] = std::array::from_fn(|_| reader.take(3));
            let weight: u32 = lengths.iter().filter(|&&l| l > 0).map(|&l| 32 >> l.min(6)).sum();
            if lengths.iter().any(|&l| l > LONGEST) || weight > 32 {
                return None;
            }
            let codes = Self::codes(&lengths);
            for letter in 0..6 {
                if lengths[letter] > 0 {
                    (0..32u32)
                        .filter(|i| i & ((1 << lengths[letter]) - 1) == codes[letter])
                        .for_each(|i| row[i as usize] = letter as u8 | (lengths[letter] as u8) << 3);
                }
            }
        }
        Some(table)
    }
}

/// Code lengths for some counts.
fn huffman(counts: &[u32; 6]) -> [u32; 6] {
    let mut lengths = [0; 6];
    let mut trees: Vec<(u32, Vec<usize>)> =
        (0..6).filter(|&i| counts[i] > 0).map(|i| (counts[i], vec![i])).collect();
    if let [(_, one)] = &trees[..] {
        lengths[one[0]] = 1;
    }
    while trees.len() > 1 {
        trees.sort_by_key(|t| (std::cmp::Reverse(t.0), t.1[0]));
        let (Some(a), Some(b)) = (trees.pop(), trees.pop()) else { break };
        let both: Vec<usize> = a.1.into_iter().chain(b.1).collect();
        both.iter().for_each(|&i| lengths[i] += 1);
        trees.push((a.0 + b.0, both));
    }
    lengths
}

/// What an encoding decided: the order that the decoder will see.
#[derive(Clone, Debug, Default)]
pub(super) struct Walk {
    /// Old number of each new vertex.
    pub order: Vec<u32>,
    /// Where each new vertex came from.
    pub origins: Vec<Origin>,
    /// Triangles in new numbers.
    pub triangles: Vec<[u32; 3]>,
    /// Old triangle, and the corner of it that is the first now.
    pub source: Vec<(u32, u8)>,
    pub bytes: Vec<u8>,
}

/// Walks over triangles whose corners are below `vertices`.
pub(super) fn encode(vertices: usize, triangles: &[[u32; 3]]) -> Walk {
    Encoder::new(vertices, triangles).run()
}

struct Encoder<'a> {
    triangles: &'a [[u32; 3]],
    /// (from, to), 4 · triangle + corner; sorted.
    sides: Vec<(u64, u32)>,
    is_done: Vec<bool>,
    new_id: Vec<u32>,
    walk: Walk,
    letters: Vec<Letter>,
    /// For each start and each S: distances back to known corners, zero for new ones.
    references: BitWriter,
}

fn is_flat([a, b, c]: [u32; 3]) -> bool {
    a == b || b == c || c == a
}

impl<'a> Encoder<'a> {
    fn new(vertices: usize, triangles: &'a [[u32; 3]]) -> Self {
        let mut sides: Vec<(u64, u32)> = Vec::with_capacity(3 * triangles.len());
        for (t, c) in triangles.iter().enumerate().filter(|(_, c)| !is_flat(**c)) {
            for i in 0..3 {
                let key = u64::from(c[i]) << 32 | u64::from(c[(i + 1) % 3]);
                sides.push((key, (t as u32) << 2 | i as u32));
            }
        }
        sides.sort_unstable();
        Self {
            triangles,
            sides,
            is_done: vec![false; triangles.len()],
            new_id: vec![NONE; vertices],
            walk: Walk::default(),
            letters: Vec::with_capacity(triangles.len() * 5 / 4),
            references: BitWriter::default(),
        }
    }

    /// A triangle that has not been walked over with a side in this direction (old numbers), and where in it the side is.
    fn beyond(&self, from: u32, to: u32) -> Option<(u32, u8)> {
        let key = u64::from(from) << 32 | u64::from(to);
        let first = self.sides.partition_point(|s| s.0 < key);
        let same = self.sides[first..].iter().take_while(|s| s.0 == key);
        same.map(|s| (s.1 >> 2, (s.1 & 3) as u8)).find(|s| !self.is_done[s.0 as usize])
    }

    fn create(&mut self, old: u32, origin: Origin) -> u32 {
        let new = self.walk.order.len() as u32;
        self.new_id[old as usize] = new;
        self.walk.order.push(old);
        self.walk.origins.push(origin);
        new
    }

    fn emit(&mut self, triangle: [u32; 3], source: (u32, u8)) {
        self.is_done[source.0 as usize] = true;
        self.walk.triangles.push(triangle);
        self.walk.source.push(source);
    }

    fn begin(&mut self, t: u32) -> [u32; 3] {
        let mut corners = [NONE; 3];
        let old = self.triangles[t as usize];
        for i in 0..3 {
            let known = self.new_id[old[i] as usize];
            let now = self.walk.order.len() as u32;
            corners[i] = if known == NONE {
                self.references.put(0, bits_for(now + 1));
                let last = if i > 0 { corners[i - 1] } else { now.saturating_sub(1) };
                self.create(old[i], Origin { from: last, to: last, apex: last })
            } else {
                self.references.put(now - known, bits_for(now + 1));
                known
            };
        }
        self.emit(corners, (t, 0));
        corners
    }

    fn run(mut self) -> Walk {
        let mut front = Front::default();
        for t in 0..self.triangles.len() as u32 {
            if self.is_done[t as usize] {
                continue;
            }
            let corners = self.begin(t);
            if is_flat(corners) {
                continue;
            }
            let mut at = front.begin(corners);
            while at != NONE {
                at = self.step(&mut front, at);
            }
        }
        self.finish()
    }

    fn step(&mut self, front: &mut Front, at: u32) -> u32 {
        let Side { from, to, apex, previous, next } = front.sides[at as usize];
        let old = [from, to].map(|v| self.walk.order[v as usize]);
        let Some(source) = self.beyond(old[0], old[1]) else {
            self.letters.push(Border);
            return front.unlink(at);
        };
        let tip = self.triangles[source.0 as usize][(source.1 as usize + 2) % 3];
        let known = self.new_id[tip as usize];
        if known == NONE {
            self.letters.push(New);
            let v = self.create(tip, Origin { from, to, apex });
            self.emit([from, to, v], source);
            return front.divide(at, v);
        }
        self.emit([from, to, known], source);
        let (before, after) = (front.sides[previous as usize], front.sides[next as usize]);
        let is_left = previous != at && before.to == from && before.from == known;
        let is_right = next != at && after.from == to && after.to == known;
        if is_left && is_right && previous != next {
            self.letters.push(Close);
            front.close(at)
        } else if is_right {
            self.letters.push(Right);
            front.join_next(at);
            at
        } else if is_left {
            self.letters.push(Left);
            front.join_previous(at);
            at
        } else {
            self.letters.push(Known);
            let now = self.walk.order.len() as u32;
            self.references.put(now - known, bits_for(now + 1));
            front.divide(at, known)
        }
    }

    fn finish(mut self) -> Walk {
        let mut counts = [[0u32; 6]; 6];
        let mut before = Border;
        for &letter in &self.letters {
            counts[before as usize][letter as usize] += 1;
            before = letter;
        }
        let alphabet = Alphabet::fitting(counts);
        let codes = alphabet.lengths.map(|l| Alphabet::codes(&l));
        let mut letters = BitWriter::default();
        alphabet.put(&mut letters);
        before = Border;
        for &letter in &self.letters {
            let (context, letter_index) = (before as usize, letter as usize);
            letters.put(codes[context][letter_index], alphabet.lengths[context][letter_index]);
            before = letter;
        }
        put_block(&letters.finish(), &mut self.walk.bytes);
        self.walk.bytes.extend(std::mem::take(&mut self.references).finish());
        self.walk
    }
}

/// Buffers of a decoder.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    front: Front,
}

/// Decodes triangles over vertices, as many as there are slots for. `borders` gets the sides that nothing is beyond. `None` for what no encoder wrote; a vertex
/// only has an origin among those before it, the first one itself.
pub(super) fn decode(
    bytes: &[u8],
    scratch: &mut Scratch,
    triangles: &mut [[u32; 3]],
    origins: &mut [Origin],
    borders: &mut Vec<[u32; 2]>,
) -> Option<()> {
    let mut rest = bytes;
    let mut letters = BitReader::new(take_block(&mut rest)?);
    let mut references = BitReader::new(rest);
    let table = Alphabet::table(&mut letters)?;
    let front = &mut scratch.front;
    let (mut known, mut at) = (0u32, NONE);
    let mut context = Border as usize;
    let mut slots = triangles.iter_mut();
    loop {
        if at == NONE {
            let Some(slot) = slots.next() else { break };
            for i in 0..3 {
                let back = references.take(bits_for(known + 1));
                slot[i] = known.checked_sub(back)?;
                if back == 0 {
                    let last = if i > 0 { slot[i - 1] } else { known.saturating_sub(1) };
                    *origins.get_mut(known as usize)? = Origin { from: last, to: last, apex: last };
                    known += 1;
                }
            }
            if !is_flat(*slot) {
                at = front.begin(*slot);
            }
            if references.overran() {
                return None;
            }
            continue;
        }
        let entry = table[context][letters.peek(LONGEST) as usize];
        if entry == 0 {
            return None;
        }
        letters.drop_peeked(u32::from(entry >> 3));
        context = usize::from(entry & 7);
        let Side { from, to, apex, previous, next } = front.sides[at as usize];
        if context == Border as usize {
            borders.push([from, to]);
            at = front.unlink(at);
            if letters.overran() {
                return None;
            }
            continue;
        }
        let tip;
        match LETTERS[context] {
            New => {
                *origins.get_mut(known as usize)? = Origin { from, to, apex };
                tip = known;
                known += 1;
                at = front.divide(at, tip);
            }
            Right => {
                tip = front.sides[next as usize].to;
                front.join_next(at);
            }
            Left => {
                tip = front.sides[previous as usize].from;
                front.join_previous(at);
            }
            Close => {
                tip = front.sides[next as usize].to;
                at = front.close(at);
            }
            Known => {
                tip = known.checked_sub(references.take(bits_for(known + 1)))?;
                if tip >= known {
                    return None;
                }
                at = front.divide(at, tip);
            }
            Border => return None,
        }
        *slots.next()? = [from, to, tip];
    }
    (known as usize == origins.len() && !letters.overran() && !references.overran()).then_some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::hard_cases;

    /// Triangles as sorted cycles, the smallest corner first.
    fn cycles(triangles: impl Iterator<Item = [u32; 3]>) -> Vec<[u32; 3]> {
        let mut all: Vec<[u32; 3]> =
            triangles.map(|[a, b, c]| [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap()).collect();
        all.sort_unstable();
        all
    }

    #[test]
    fn every_soup_comes_back() {
        let meshes = hard_cases::meshes().into_iter().map(|h| (h.name, h.mesh.welded().mesh));
        for (name, mesh) in meshes.chain([("ball", hard_cases::bumpy_ball(20))]) {
            let walk = encode(mesh.positions().len(), mesh.triangles());
            let mut out = vec![[0; 3]; mesh.triangles().len()];
            let (mut origins, mut borders) = (vec![Origin::default(); walk.order.len()], Vec::new());
            decode(&walk.bytes, &mut Scratch::default(), &mut out, &mut origins, &mut borders)
                .unwrap_or_else(|| panic!("{name}"));
            let old = out.iter().map(|t| t.map(|v| walk.order[v as usize]));
            assert_eq!(cycles(old), cycles(mesh.triangles().iter().copied()), "{name}");
            if name == "ball" {
                assert!(borders.len() < 40, "{}", borders.len());
                let bits = walk.bytes.len() as f64 * 8.0 / out.len() as f64;
                assert!(bits < 2.0, "{bits} bits a triangle");
            }
        }
    }

    #[test]
    fn nonsense_ends_without_an_answer() {
        let ball = hard_cases::bumpy_ball(6);
        let walk = encode(ball.positions().len(), ball.triangles());
        let vertices = walk.order.len();
        let mut seed = 3u64;
        for i in 0..20_000u64 {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(i | 1);
            let mut bytes = walk.bytes.clone();
            let at = (seed >> 32) as usize % bytes.len();
            bytes[at] ^= 1 << (seed >> 20 & 7);
            bytes.truncate(bytes.len() - (seed >> 50) as usize % 3);
            let mut out = vec![[0; 3]; ball.triangles().len()];
            let (mut origins, mut borders) = (vec![Origin::default(); vertices], Vec::new());
            if decode(&bytes, &mut Scratch::default(), &mut out, &mut origins, &mut borders).is_some() {
                let sides = out.as_flattened().iter().chain(borders.as_flattened());
                let all = sides.chain(origins.iter().flat_map(|o| [&o.from, &o.to, &o.apex]));
                assert!(all.into_iter().all(|&v| (v as usize) < vertices));
            }
            assert!(borders.len() <= 3 * out.len());
        }
    }
}
