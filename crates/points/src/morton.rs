//! Morton keys: the bits of three coordinates interleaved, so that sorting by key is a walk through an octree.
//!
//! An octal digit of a key is `z << 2 | y << 1 | x`; the most significant digit says in which octant of the whole cube a
//! point lies.

/// Spreads the low 13 bits so that two zeros follow each.
#[inline]
pub(crate) fn spread13(v: u32) -> u64 {
    let v = u64::from(v & 0x1fff);
    let v = (v | v << 16) & 0x1f00_00ff;
    let v = (v | v << 8) & 0x10_0f00_f00f;
    let v = (v | v << 4) & 0x10_c30c_30c3;
    (v | v << 2) & 0x12_4924_9249
}

/// The inverse of [`spread13`], for every third bit of a 39-bit key.
#[inline]
pub(crate) fn gather13(v: u64) -> u32 {
    let v = v & 0x12_4924_9249;
    let v = (v | v >> 2) & 0x10_c30c_30c3;
    let v = (v | v >> 4) & 0x10_0f00_f00f;
    let v = (v | v >> 8) & 0x1f00_00ff;
    ((v | v >> 16) & 0x1fff) as u32
}

/// Spreads 32 bits over 96.
#[inline]
fn spread32(v: u32) -> u128 {
    let part = |shift: u32| u128::from(spread13(v >> shift & 0x7ff));
    part(0) | part(11) << 33 | part(22) << 66
}

/// The key of three coordinates below 2³².
#[inline]
pub(crate) fn key96([x, y, z]: [u32; 3]) -> u128 {
    spread32(x) | spread32(y) << 1 | spread32(z) << 2
}

/// The coordinates of a 96-bit key.
#[inline]
pub(crate) fn coordinates96(key: u128) -> [u32; 3] {
    let axis = |shift: u32| {
        let k = key >> shift;
        let part = |i: u32| gather13((k >> (33 * i)) as u64 & 0x1_ffff_ffff);
        part(0) | part(1) << 11 | part(2) << 22
    };
    [axis(0), axis(1), axis(2)]
}

/// The 39-bit key of three coordinates below 2¹³.
#[inline]
pub(crate) fn key39([x, y, z]: [u32; 3]) -> u64 {
    spread13(x) | spread13(y) << 1 | spread13(z) << 2
}

/// The coordinates of a 39-bit key.
#[inline]
pub(crate) fn coordinates39(key: u64) -> [u32; 3] {
    [gather13(key), gather13(key >> 1), gather13(key >> 2)]
}

/// Height of the smallest cell that holds two points: 0 when they are equal, else one more than the place of the highest bit
/// in which a coordinate differs.
#[inline]
pub(crate) fn height(a: [u32; 3], b: [u32; 3]) -> u32 {
    let different = (a[0] ^ b[0]) | (a[1] ^ b[1]) | (a[2] ^ b[2]);
    32 - different.leading_zeros()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slow(p: [u32; 3]) -> u128 {
        (0..32).fold(0, |key, bit| {
            (0..3).fold(key, |key, axis| key | u128::from(p[axis] >> bit & 1) << (3 * bit + axis))
        })
    }

    #[test]
    fn keys_interleave_bits_and_come_back() {
        let mut seed = 1u64;
        for _ in 0..2000 {
            let p = [0; 3].map(|_: u32| {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (seed >> 32) as u32
            });
            assert_eq!(key96(p), slow(p));
            assert_eq!(coordinates96(key96(p)), p);
            let small = p.map(|v| v & 0x1fff);
            assert_eq!(u128::from(key39(small)), slow(small));
            assert_eq!(coordinates39(key39(small)), small);
        }
        assert_eq!(key96([u32::MAX; 3]), (1 << 96) - 1);
    }

    #[test]
    fn height_counts_differing_digits() {
        assert_eq!(height([5, 6, 7], [5, 6, 7]), 0);
        assert_eq!(height([5, 6, 7], [5, 6, 6]), 1);
        assert_eq!(height([0; 3], [1 << 31, 0, 0]), 32);
    }
}
