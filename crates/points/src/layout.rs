//! How points lie in raw bytes, and taking them out.

use crate::PointsError;

/// Most attribute bytes of a point.
pub const MOST_ATTRIBUTE_BYTES: usize = 64;

/// Where the parts of a point lie in a record of fixed length.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Layout {
    pub stride: usize,
    pub colour: Colour,
    /// Ranges of bytes that are kept as they are, in order. Positions are three `i32` from byte 0 on.
    pub attributes: Vec<std::ops::Range<usize>>,
}

/// Colour of a point in its record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
// Only LAS files come in some of these ways.
#[cfg_attr(not(feature = "las"), allow(dead_code))]
pub(crate) enum Colour {
    /// All points are white.
    None,
    /// Three bytes.
    Bytes(usize),
    /// Three `u16`; see [`Part::wide_colours`](crate::input::Part::wide_colours).
    Words(usize),
}

/// A list of one range, or of none when it is empty.
pub(crate) fn some_range(range: std::ops::Range<usize>) -> Vec<std::ops::Range<usize>> {
    (!range.is_empty()).then_some(range).into_iter().collect()
}

impl Layout {
    /// Positions, colour, fourth byte, attributes: what is staged, and [`Point`](crate::Point) itself.
    pub fn staged(attribute_bytes: usize) -> Self {
        let end = 16 + attribute_bytes;
        Self { stride: end, colour: Colour::Bytes(12), attributes: some_range(16..end) }
    }

    pub fn attribute_bytes(&self) -> usize {
        self.attributes.iter().map(std::ops::Range::len).sum()
    }

    pub fn check(&self) -> Result<(), PointsError> {
        let bytes = self.attribute_bytes();
        if bytes > MOST_ATTRIBUTE_BYTES {
            return Err(PointsError::Attributes { bytes, most: MOST_ATTRIBUTE_BYTES });
        }
        Ok(())
    }

    #[inline(always)]
    pub fn position(record: &[u8]) -> [i32; 3] {
        let (words, _) = record.as_chunks::<4>();
        [i32::from_le_bytes(words[0]), i32::from_le_bytes(words[1]), i32::from_le_bytes(words[2])]
    }

    /// Red, green, blue; 16-bit channels lose `shift` low bits.
    #[inline]
    pub fn rgb(&self, record: &[u8], shift: u32) -> u32 {
        match self.colour {
            Colour::None => 0xff_ffff,
            Colour::Bytes(at) => {
                let &[r, g, b, ..] = &record[at..at + 3] else { return 0 };
                u32::from(r) << 16 | u32::from(g) << 8 | u32::from(b)
            }
            Colour::Words(at) => {
                let &[r, g, b] = record[at..at + 6].as_chunks::<2>().0 else { return 0 };
                let channel = |bytes| u32::from((u16::from_le_bytes(bytes) >> shift).min(255));
                channel(r) << 16 | channel(g) << 8 | channel(b)
            }
        }
    }

    /// Bits that any channel of 16 bits has set.
    #[inline]
    pub fn colour_bits(&self, record: &[u8]) -> u16 {
        match self.colour {
            Colour::Words(at) => (0..3)
                .fold(0, |bits, k| bits | u16::from_le_bytes([record[at + 2 * k], record[at + 2 * k + 1]])),
            _ => 0,
        }
    }

    #[inline]
    pub fn words<const W: usize>(&self, record: &[u8]) -> [u64; W] {
        let mut words = [0; W];
        if W > 0 {
            // One range of whole words is what common formats have.
            if let [range] = &self.attributes[..]
                && range.len() == 8 * W
            {
                let (whole, _) = record[range.clone()].as_chunks::<8>();
                return std::array::from_fn(|i| u64::from_le_bytes(whole[i]));
            }
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut words);
            let mut at = 0;
            for range in &self.attributes {
                bytes[at..at + range.len()].copy_from_slice(&record[range.clone()]);
                at += range.len();
            }
        }
        words
    }
}
