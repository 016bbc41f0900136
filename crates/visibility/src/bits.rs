//! A set of numbers as bits.

/// Numbers below a bound that is fixed when the set is made.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Bits {
    words: Vec<u64>,
    count: u32,
}

impl Bits {
    pub(crate) fn new(bound: u32) -> Self {
        Self { words: vec![0; (bound as usize).div_ceil(64)], count: 0 }
    }

    #[inline]
    pub(crate) fn contains(&self, n: u32) -> bool {
        self.words[n as usize >> 6] >> (n & 63) & 1 != 0
    }

    /// False when it was there already.
    #[inline]
    pub(crate) fn insert(&mut self, n: u32) -> bool {
        let (word, bit) = (&mut self.words[n as usize >> 6], 1u64 << (n & 63));
        if *word & bit != 0 {
            return false;
        }
        *word |= bit;
        self.count += 1;
        true
    }

    pub(crate) fn bytes(&self) -> usize {
        self.words.len() * size_of::<u64>()
    }

    pub(crate) fn len(&self) -> u32 {
        self.count
    }

    /// The numbers in ascending order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = u32> {
        self.words.iter().enumerate().flat_map(|(i, &word)| {
            let mut rest = word;
            std::iter::from_fn(move || {
                let bit = (rest != 0).then(|| rest.trailing_zeros())?;
                rest &= rest - 1;
                Some((i as u32) << 6 | bit)
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back_in_order() {
        let mut bits = Bits::new(200);
        for n in [199, 0, 63, 64, 0, 128] {
            bits.insert(n);
        }
        assert_eq!(bits.iter().collect::<Vec<_>>(), [0, 63, 64, 128, 199]);
        assert!(bits.len() == 5 && bits.contains(63) && !bits.contains(62));
    }
}
