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
pub(crate) enum Colour {
    /// All points are white.
    None,
    /// Three bytes.
    Bytes(usize),
    /// Three `u16`; see [`Part::wide_colours`](crate::input::Part::wide_colours).
    Words(usize),
}

impl Layout {
    /// Positions, colour, fourth byte, attributes: what is staged, and [`Point`](crate::Point) itself.
    pub fn staged(attribute_bytes: usize) -> Self {
        let end = 16 + attribute_bytes;
        let attributes = if attribute_bytes > 0 { vec![16..end] } else { vec![] };
        Self { stride: end, colour: Colour::Bytes(12), attributes }
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

    #[inline]
    pub fn position(&self, record: &[u8]) -> [i32; 3] {
        let word = |i: usize| i32::from_le_bytes([record[i], record[i + 1], record[i + 2], record[i + 3]]);
        [word(0), word(4), word(8)]
    }

    /// Red, green, blue; 16-bit channels lose `shift` low bits.
    #[inline]
    pub fn rgb(&self, record: &[u8], shift: u32) -> u32 {
        match self.colour {
            Colour::None => 0xff_ffff,
            Colour::Bytes(at) => {
                u32::from(record[at]) << 16 | u32::from(record[at + 1]) << 8 | u32::from(record[at + 2])
            }
            Colour::Words(at) => {
                let channel = |k: usize| {
                    let v = u16::from_le_bytes([record[at + 2 * k], record[at + 2 * k + 1]]) >> shift;
                    u32::from(v.min(255))
                };
                channel(0) << 16 | channel(1) << 8 | channel(2)
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
