//! What is sorted: the key of a point inside a cell, its colour, and its attributes.

use crate::morton;
use crate::point::Point;

/// Anything with a colour that can represent a cell.
pub(crate) trait Item: Copy {
    /// Red, green, blue in the low 24 bits.
    fn rgb(&self) -> u32;
}

/// A point in the order of keys; ties are broken by colour, then attributes, so that no order of input matters.
pub(crate) trait Record<const W: usize>: Item + Ord + Send + Sync {
    /// Length in 64-bit words.
    const WORDS: usize;
    /// Packs a point; coordinates are those inside its cell.
    fn pack(local: [u32; 3], rgb: u32, attributes: [u64; W]) -> Self;
    /// Packs a point by its key inside its cell.
    fn from_key(key: u128, rgb: u32, attributes: [u64; W]) -> Self;
    /// The key inside the cell.
    fn key(&self) -> u128;
    /// Reads from words.
    fn from_words(words: &[u64]) -> Self;
    /// Writes to words.
    fn to_words(self, words: &mut Vec<u64>);
    /// Coordinates inside the cell.
    fn local(&self) -> [u32; 3];
    /// Attributes.
    fn attributes(&self) -> [u64; W];
    /// Bits of the key from `shift` on.
    fn key_bits(&self, shift: u32) -> u64;
    /// As [`morton::height`].
    fn height(&self, other: &Self) -> u32;
}

/// Coordinates of up to 13 bits in one word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Compact<const W: usize> {
    word: u64,
    attributes: [u64; W],
}

/// Most bits of a coordinate in a [`Compact`] record.
pub(crate) const COMPACT_BITS: u32 = 13;

impl<const W: usize> Item for Compact<W> {
    #[inline]
    fn rgb(&self) -> u32 {
        self.word as u32 & 0xff_ffff
    }
}

impl<const W: usize> Record<W> for Compact<W> {
    const WORDS: usize = 1 + W;

    #[inline]
    fn pack(local: [u32; 3], rgb: u32, attributes: [u64; W]) -> Self {
        Self { word: morton::key39(local) << 24 | u64::from(rgb), attributes }
    }

    #[inline]
    fn from_key(key: u128, rgb: u32, attributes: [u64; W]) -> Self {
        Self { word: (key as u64) << 24 | u64::from(rgb), attributes }
    }

    #[inline]
    fn key(&self) -> u128 {
        u128::from(self.word >> 24)
    }

    #[inline]
    fn from_words(words: &[u64]) -> Self {
        Self { word: words[0], attributes: std::array::from_fn(|i| words[1 + i]) }
    }

    #[inline]
    fn to_words(self, words: &mut Vec<u64>) {
        words.push(self.word);
        words.extend(self.attributes);
    }

    #[inline]
    fn local(&self) -> [u32; 3] {
        morton::coordinates39(self.word >> 24)
    }

    #[inline]
    fn attributes(&self) -> [u64; W] {
        self.attributes
    }

    #[inline]
    fn key_bits(&self, shift: u32) -> u64 {
        self.word >> (24 + shift)
    }

    #[inline]
    fn height(&self, other: &Self) -> u32 {
        let different = (self.word ^ other.word) >> 24;
        (66 - different.leading_zeros()) / 3
    }
}

/// Coordinates of any size in two words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Wide<const W: usize> {
    high: u64,
    low: u64,
    attributes: [u64; W],
}

impl<const W: usize> Item for Wide<W> {
    #[inline]
    fn rgb(&self) -> u32 {
        self.low as u32 & 0xff_ffff
    }
}

impl<const W: usize> Record<W> for Wide<W> {
    const WORDS: usize = 2 + W;

    #[inline]
    fn pack(local: [u32; 3], rgb: u32, attributes: [u64; W]) -> Self {
        Self::from_key(morton::key96(local), rgb, attributes)
    }

    #[inline]
    fn from_key(key: u128, rgb: u32, attributes: [u64; W]) -> Self {
        let bits = key << 24 | u128::from(rgb);
        Self { high: (bits >> 64) as u64, low: bits as u64, attributes }
    }

    #[inline]
    fn key(&self) -> u128 {
        (u128::from(self.high) << 64 | u128::from(self.low)) >> 24
    }

    #[inline]
    fn from_words(words: &[u64]) -> Self {
        Self { high: words[0], low: words[1], attributes: std::array::from_fn(|i| words[2 + i]) }
    }

    #[inline]
    fn to_words(self, words: &mut Vec<u64>) {
        words.extend([self.high, self.low]);
        words.extend(self.attributes);
    }

    #[inline]
    fn local(&self) -> [u32; 3] {
        morton::coordinates96(self.key())
    }

    #[inline]
    fn attributes(&self) -> [u64; W] {
        self.attributes
    }

    #[inline]
    fn key_bits(&self, shift: u32) -> u64 {
        (self.key() >> shift) as u64
    }

    #[inline]
    fn height(&self, other: &Self) -> u32 {
        let different = self.key() ^ other.key();
        (130 - different.leading_zeros()) / 3
    }
}

/// A point as it is stored, with its attributes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Whole<const W: usize> {
    pub point: Point,
    pub attributes: [u64; W],
}

impl<const W: usize> Item for Whole<W> {
    #[inline]
    fn rgb(&self) -> u32 {
        let [r, g, b, _] = self.point.colour;
        u32::from(r) << 16 | u32::from(g) << 8 | u32::from(b)
    }
}

/// The colour of packed red, green, blue.
#[inline]
pub(crate) fn unpack(rgb: u32) -> [u8; 3] {
    [(rgb >> 16) as u8, (rgb >> 8) as u8, rgb as u8]
}

/// Least number of records for which counting passes pay.
const FEW: usize = 512;
/// Bits of a digit: the counters of one pass stay in the first-level cache.
const DIGIT: u32 = 10;

/// Sorts records whose coordinates have at most `bits` bits: by key, then colour, then attributes.
pub(crate) fn sort<const W: usize, R: Record<W>>(records: &mut Vec<R>, scratch: &mut Vec<R>, bits: u32) {
    if records.len() < FEW {
        records.sort_unstable();
        return;
    }
    let key_bits = 3 * bits;
    let passes = key_bits.div_ceil(DIGIT);
    let digit = |r: &R, pass: u32| (r.key_bits(pass * DIGIT) & ((1 << DIGIT) - 1)) as usize;
    // One reading counts for all passes.
    let mut counts = vec![[0u32; 1 << DIGIT]; passes as usize];
    for r in records.iter() {
        for (pass, counts) in counts.iter_mut().enumerate() {
            counts[digit(r, pass as u32)] += 1;
        }
    }
    scratch.clear();
    for (pass, counts) in counts.iter_mut().enumerate() {
        if counts.iter().any(|&c| c as usize == records.len()) {
            continue; // All share this digit.
        }
        if scratch.len() != records.len() {
            scratch.resize(records.len(), records[0]);
        }
        let mut next = 0;
        for c in counts.iter_mut() {
            (*c, next) = (next, next + *c);
        }
        for r in records.iter() {
            let slot = &mut counts[digit(r, pass as u32)];
            scratch[*slot as usize] = *r;
            *slot += 1;
        }
        std::mem::swap(records, scratch);
    }
    for run in records.chunk_by_mut(|a, b| a.height(b) == 0) {
        if run.len() > 1 {
            run.sort_unstable();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check<R: Record<1> + std::fmt::Debug>(bits: u32) {
        let mut random = 1u64;
        let mut next = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            random >> 32
        };
        let mask = (1u64 << bits) - 1;
        for count in [0, 1, 100, 5000] {
            let mut records: Vec<R> = (0..count)
                .map(|i| {
                    let p = [0; 3].map(|_: u32| (next() & mask) as u32 >> (i % 7));
                    let r = R::pack(p, next() as u32 & 3, [next() & 1]);
                    assert_eq!((r.local(), r.attributes()), (p, r.attributes()));
                    assert_eq!(R::from_key(r.key(), r.rgb(), r.attributes()), r);
                    // The lower bits of a key are the key inside the smaller cell.
                    let inside = R::from_key(r.key() & ((1 << (3 * (bits / 2))) - 1), r.rgb(), [0]).local();
                    assert_eq!(inside, p.map(|v| v & ((1 << (bits / 2)) - 1)));
                    let mut words = Vec::new();
                    r.to_words(&mut words);
                    assert_eq!((words.len(), R::from_words(&words)), (R::WORDS, r));
                    r
                })
                .collect();
            for pair in records.windows(2) {
                assert_eq!(pair[0].height(&pair[1]), morton::height(pair[0].local(), pair[1].local()));
            }
            let mut expected = records.clone();
            expected.sort();
            sort(&mut records, &mut Vec::new(), bits);
            assert_eq!(records, expected);
        }
    }

    #[test]
    fn records_sort_by_key_then_colour_then_attributes() {
        check::<Compact<1>>(13);
        check::<Compact<1>>(3);
        check::<Wide<1>>(32);
        check::<Wide<1>>(17);
        check::<Wide<1>>(0);
    }
}
