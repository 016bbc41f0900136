//! Bits, and numbers in few of them.

/// Ones in a row after which a number follows with its size. Three such rows fit in what a reader holds at least.
const ESCAPE: u32 = 16;

/// Most low bits of a number that are written as they are; three times as many fit as well.
const MOST_LOW: u32 = 18;

/// Writes bits, the lowest first.
#[derive(Clone, Debug, Default)]
pub(crate) struct BitWriter {
    bytes: Vec<u8>,
    held: u64,
    count: u32,
}

impl BitWriter {
    /// At most 32 bits.
    pub(crate) fn put(&mut self, value: u32, bits: u32) {
        self.held |= u64::from(value) << self.count;
        self.count += bits;
        while self.count >= 8 {
            self.bytes.push(self.held as u8);
            self.held >>= 8;
            self.count -= 8;
        }
    }

    pub(crate) fn finish(mut self) -> Vec<u8> {
        if self.count > 0 {
            self.bytes.push(self.held as u8);
        }
        self.bytes
    }

    /// A number of unknown size: twice as many bits as it has.
    pub(crate) fn put_gamma(&mut self, value: u32) {
        let bits = 32 - value.leading_zeros();
        self.put(bits, 6);
        self.put(value, bits);
    }
}

/// Appends a block of bytes after its length: seven bits a byte, the highest says whether more follow.
pub(crate) fn put_block(block: &[u8], out: &mut Vec<u8>) {
    let mut length = block.len();
    while length >= 128 {
        out.push(length as u8 | 128);
        length >>= 7;
    }
    out.push(length as u8);
    out.extend_from_slice(block);
}

/// Takes a block from the front. `None` where none is.
pub(crate) fn take_block<'a>(bytes: &mut &'a [u8]) -> Option<&'a [u8]> {
    let mut length = 0usize;
    for shift in [0, 7, 14, 21, 28] {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        length |= usize::from(byte & 127) << shift;
        if byte < 128 {
            let (block, rest) = bytes.split_at_checked(length)?;
            *bytes = rest;
            return Some(block);
        }
    }
    None
}

/// Bits that tell so many apart.
#[inline(always)]
pub(crate) fn bits_for(count: u32) -> u32 {
    32 - (count.max(1) - 1).leading_zeros()
}

/// Reads what a [`BitWriter`] wrote. Past the end there are zeros; [`overran`](Self::overran) says so.
#[derive(Clone, Debug)]
pub(crate) struct BitReader<'a> {
    bytes: &'a [u8],
    at: usize,
    held: u64,
    count: u32,
}

impl<'a> BitReader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, held: 0, count: 0 }
    }

    /// At least 56 bits are held afterwards.
    #[inline(always)]
    fn refill(&mut self) {
        match self.bytes.get(self.at..self.at + 8).and_then(|b| b.first_chunk::<8>()) {
            Some(chunk) => {
                self.held |= u64::from_le_bytes(*chunk) << self.count;
                let taken = (63 - self.count) >> 3;
                self.at += taken as usize;
                self.count += 8 * taken;
            }
            None => {
                while self.count <= 56 {
                    let byte = self.bytes.get(self.at).copied().unwrap_or(0);
                    self.held |= u64::from(byte) << self.count;
                    self.at += 1;
                    self.count += 8;
                }
            }
        }
    }

    #[inline(always)]
    pub(crate) fn take(&mut self, bits: u32) -> u32 {
        self.refill();
        self.take_held(bits)
    }

    #[inline(always)]
    fn take_held(&mut self, bits: u32) -> u32 {
        let value = (self.held & ((1u64 << bits) - 1)) as u32;
        self.skip(bits);
        value
    }

    #[inline(always)]
    fn skip(&mut self, bits: u32) {
        self.held >>= bits;
        self.count -= bits;
    }

    /// The next bits, which stay.
    #[inline(always)]
    pub(crate) fn peek(&mut self, bits: u32) -> u32 {
        self.refill();
        (self.held & ((1u64 << bits) - 1)) as u32
    }

    /// Drops bits that were looked at.
    #[inline(always)]
    pub(crate) fn drop_peeked(&mut self, bits: u32) {
        self.skip(bits);
    }

    pub(crate) fn take_gamma(&mut self) -> u32 {
        let bits = self.take(6).min(32);
        self.take(bits)
    }

    /// Whether more was read than there is.
    pub(crate) fn overran(&self) -> bool {
        self.at * 8 > self.bytes.len() * 8 + self.count as usize
    }
}

/// Numbers around zero, in Rice's code with a parameter that follows their size.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Numbers {
    /// Sixteen times the mean of the zigzag values.
    mean: u32,
}

impl Default for Numbers {
    fn default() -> Self {
        Self { mean: 16 * 32 }
    }
}

#[inline(always)]
fn zigzag(value: i32) -> u32 {
    ((value << 1) ^ (value >> 31)) as u32
}

#[inline(always)]
fn unzigzag(value: u32) -> i32 {
    (value >> 1) as i32 ^ -((value & 1) as i32)
}

impl Numbers {
    /// Low bits that are written as they are: the best number for a geometric distribution is the mean's power of two.
    #[inline(always)]
    fn low_bits(&self) -> u32 {
        (31 - ((self.mean >> 4) | 1).leading_zeros()).min(MOST_LOW)
    }

    #[inline(always)]
    fn learn(&mut self, z: u32) {
        // Outliers are cut off, so that one does not spoil the next dozen, and nothing overflows.
        self.mean = self.mean - (self.mean >> 4) + z.min(1 << 20);
    }

    /// Writes a few numbers, each with its own parameter: first what is above the low bits of each, in ones that a zero ends, then all low bits.
    pub(crate) fn put<const N: usize>(all: &mut [Self; N], writer: &mut BitWriter, values: [i32; N]) {
        let (z, k) = (values.map(zigzag), all.map(|n| n.low_bits()));
        for i in 0..N {
            match z[i] >> k[i] {
                high if high < ESCAPE => writer.put((1u32 << high) - 1, high + 1),
                _ => writer.put((1u32 << ESCAPE) - 1, ESCAPE),
            }
        }
        for i in 0..N {
            if z[i] >> k[i] < ESCAPE {
                writer.put(z[i] & ((1 << k[i]) - 1), k[i]);
            } else {
                writer.put_gamma(z[i]);
            }
            all[i].learn(z[i]);
        }
    }

    /// Reads at most three numbers.
    #[inline(always)]
    pub(crate) fn take<const N: usize>(all: &mut [Self; N], reader: &mut BitReader) -> [i32; N] {
        const { assert!(N as u32 * ESCAPE <= 56 && N as u32 * MOST_LOW <= 56) };
        reader.refill();
        let (mut z, mut longest, mut used) = ([0; N], 0, 0);
        let mut held = reader.held;
        for z in &mut z {
            *z = (!held).trailing_zeros();
            longest = longest.max(*z);
            held = held >> (*z & 31) >> 1;
            used += *z + 1;
        }
        if longest >= ESCAPE {
            return Self::take_long(all, reader);
        }
        (reader.held, reader.count) = (held, reader.count - used);
        let low: [u32; N] = std::array::from_fn(|i| all[i].low_bits());
        if reader.count < low.iter().sum() {
            reader.refill();
        }
        for i in 0..N {
            z[i] = z[i] << low[i] | reader.take_held(low[i]);
            all[i].learn(z[i]);
        }
        z.map(unzigzag)
    }

    /// The same for numbers of any length.
    #[cold]
    fn take_long<const N: usize>(all: &mut [Self; N], reader: &mut BitReader) -> [i32; N] {
        let high: [u32; N] = std::array::from_fn(|_| {
            let ones = (!reader.peek(ESCAPE)).trailing_zeros().min(ESCAPE);
            reader.skip((ones + 1).min(ESCAPE));
            ones
        });
        std::array::from_fn(|i| {
            let k = all[i].low_bits();
            let z = if high[i] < ESCAPE { high[i] << k | reader.take(k) } else { reader.take_gamma() };
            all[i].learn(z);
            unzigzag(z)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back() {
        let mut seed = 7u64;
        let mut random = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) as u32
        };
        let values: Vec<i32> = (0..5000)
            .map(|i| {
                let size = random() % if i % 50 == 0 { 31 } else { 9 };
                (random() as i32) >> (31 - size) >> (i % 2)
            })
            .chain([i32::MIN, i32::MAX, 0, -1, 1])
            .collect();
        let mut writer = BitWriter::default();
        let mut numbers = [Numbers::default(); 3];
        for v in values.windows(3) {
            Numbers::put(&mut numbers, &mut writer, [v[0], v[1], v[2]]);
            writer.put_gamma(v[1] as u32);
        }
        writer.put(5, 3);
        let bytes = writer.finish();
        let (mut reader, mut numbers) = (BitReader::new(&bytes), [Numbers::default(); 3]);
        for v in values.windows(3) {
            assert_eq!(Numbers::take(&mut numbers, &mut reader), v);
            assert_eq!(reader.take_gamma(), v[1] as u32);
        }
        assert_eq!(reader.take(3), 5);
        assert!(!reader.overran());
        (0..9).for_each(|_| assert!(reader.take(32) == 0));
        assert!(reader.overran());
    }

    #[test]
    fn small_numbers_take_few_bits() {
        let mut writer = BitWriter::default();
        let mut numbers = [Numbers::default()];
        for i in 0..8000 {
            Numbers::put(&mut numbers, &mut writer, [[0, 1, -1, 2, -2, 0, 3, -3][i % 8]]);
        }
        let bits = writer.finish().len() * 8;
        assert!(bits < 8000 * 13 / 4, "{bits}");
    }
}
