//! Sets as bits: gaps and lengths of runs in Rice codes.

use crate::pvs::Pvs;

/// Quotients from here on are escaped: the number follows in 32 bits.
const ESCAPE: u32 = 24;

/// A set of numbers in as few bits as its runs allow: two bytes of parameters, then gap and length of every run.
pub(crate) fn encode(set: &Pvs) -> Vec<u8> {
    let numbers = || {
        let mut end = 0;
        set.runs().iter().map(move |&[first, last]| {
            // Only the first gap can be zero, and no length is.
            let gap = first - end;
            end = last.wrapping_add(1);
            [gap, last - first - 1]
        })
    };
    let best = |which: usize| {
        let cost = |k: &u8| numbers().map(|n| u64::from(bits_of(n[which], *k))).sum::<u64>();
        (0..32).min_by_key(cost).unwrap_or(0)
    };
    let parameters = [best(0), best(1)];
    let mut out = Writer { bytes: parameters.to_vec(), used: 0 };
    for numbers in numbers() {
        for (n, k) in numbers.into_iter().zip(parameters) {
            out.rice(n, k);
        }
    }
    out.bytes
}

/// The set of `len` numbers below `bound` that the bytes hold; `None` when they hold none such. A run takes two bits at least, and eight bytes of memory.
pub(crate) fn decode(bytes: &[u8], len: u32, bound: u32) -> Option<Pvs> {
    let (parameters, bytes) = bytes.split_first_chunk::<2>()?;
    if parameters.iter().any(|&k| k >= 32) {
        return None;
    }
    let mut bits = Reader { bytes, at: 0 };
    let (mut runs, mut end, mut count) = (Vec::new(), 0u32, 0u32);
    while count < len {
        let first = end.checked_add(bits.rice(parameters[0])?)?;
        let length = bits.rice(parameters[1])?.checked_add(1)?;
        let last = first.checked_add(length)?;
        count = count.checked_add(length)?;
        if last > bound {
            return None;
        }
        runs.push([first, last]);
        end = last.saturating_add(1);
    }
    // Nothing but padding is left.
    let ends = count == len && bits.at.div_ceil(8) == bytes.len();
    if ends { Pvs::from_runs(runs).ok() } else { None }
}

fn bits_of(n: u32, k: u8) -> u32 {
    let quotient = n >> k;
    if quotient < ESCAPE { quotient + 1 + u32::from(k) } else { ESCAPE + 32 }
}

struct Writer {
    bytes: Vec<u8>,
    /// Bits used of the last byte, zero when it is full.
    used: u32,
}

impl Writer {
    fn rice(&mut self, n: u32, k: u8) {
        let quotient = n >> k;
        if quotient < ESCAPE {
            (0..quotient).for_each(|_| self.bit(1));
            self.bit(0);
            self.low(n, k.into());
        } else {
            (0..ESCAPE).for_each(|_| self.bit(1));
            self.low(n, 32);
        }
    }

    fn low(&mut self, n: u32, count: u32) {
        (0..count).for_each(|i| self.bit(n >> i & 1));
    }

    fn bit(&mut self, bit: u32) {
        if self.used == 0 {
            self.bytes.push(0);
        }
        if let Some(last) = self.bytes.last_mut() {
            *last |= (bit as u8) << self.used;
        }
        self.used = (self.used + 1) % 8;
    }
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn rice(&mut self, k: u8) -> Option<u32> {
        let quotient = self.window().trailing_ones().min(ESCAPE);
        if quotient == ESCAPE {
            self.skip(ESCAPE)?;
            return self.low(32);
        }
        self.skip(quotient + 1)?;
        // Fits, or the file lies.
        quotient.checked_mul(1 << k)?.checked_add(self.low(k.into())?)
    }

    fn low(&mut self, count: u32) -> Option<u32> {
        let bits = self.window() & ((1 << count) - 1);
        self.skip(count)?;
        u32::try_from(bits).ok()
    }

    /// The next 57 bits or more; zeros after the end.
    fn window(&self) -> u64 {
        let rest = self.bytes.get(self.at >> 3..).unwrap_or_default();
        let bytes: [u8; 8] = match rest.first_chunk() {
            Some(&eight) => eight,
            None => std::array::from_fn(|i| rest.get(i).copied().unwrap_or(0)),
        };
        u64::from_le_bytes(bytes) >> (self.at & 7)
    }

    /// Goes on by some bits; `None` past the end.
    fn skip(&mut self, count: u32) -> Option<()> {
        self.at += count as usize;
        (self.at <= self.bytes.len() * 8).then_some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;

    #[test]
    fn sets_come_back() {
        let mut random = Random::new(3);
        let mut sets = vec![Pvs::new(), Pvs::from_sorted([0]), Pvs::from_sorted([u32::MAX - 1])];
        sets.push(Pvs::from_runs(vec![[0, 1], [2, u32::MAX - 5], [u32::MAX - 1, u32::MAX]]).unwrap());
        for _ in 0..300 {
            let density = random.unit();
            sets.push(Pvs::from_sorted((0..2000).filter(|_| random.unit() < density)));
        }
        for set in sets {
            let bytes = encode(&set);
            assert_eq!(decode(&bytes, set.len(), set.bound()), Some(set.clone()));
            if !set.is_empty() {
                assert_eq!(decode(&bytes, set.len(), set.bound() - 1), None);
                assert_eq!(decode(&bytes[..bytes.len() - 1], set.len(), set.bound()), None);
            }
            assert_eq!(decode(&[&bytes[..], &[0]].concat(), set.len(), set.bound()), None);
        }
    }

    #[test]
    fn scattered_numbers_take_about_their_entropy() {
        let mut random = Random::new(4);
        let set = Pvs::from_sorted((0..1_000_000).filter(|_| random.unit() < 0.01));
        let entropy = 1e6 * -(0.01 * 0.01f64.log2() + 0.99 * 0.99f64.log2()) / 8.0;
        assert!((encode(&set).len() as f64) < 1.2 * entropy);
    }
}
