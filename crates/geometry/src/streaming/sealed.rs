//! A file that is whole if its last bytes say so: magic, payload, index, footer, little-endian.

/// Bytes of a footer: offset and length of the index, its checksum, the footer's own, end mark.
pub const FOOTER: usize = 8 + 8 + 4 + 4 + 8;

/// How a kind of file begins and ends. A file without a whole footer is unfinished.
#[derive(Clone, Copy, Debug)]
pub struct Sealed {
    /// What such a file is called, with its article: "a hierarchy".
    pub kind: &'static str,
    /// First bytes.
    pub magic: &'static [u8; 16],
    /// Last bytes.
    pub end: &'static [u8; 8],
    /// Bytes that an index has at least.
    pub least_index: usize,
    /// Checksum of bytes, a CRC-32 say.
    pub checksum: fn(&[u8]) -> u32,
}

impl Sealed {
    /// Appends the footer to an index that will stand at `offset`.
    pub fn close(&self, index: &mut Vec<u8>, offset: u64) {
        let (length, sum) = (index.len() as u64, (self.checksum)(index));
        let footer = index.len();
        index.extend(offset.to_le_bytes());
        index.extend(length.to_le_bytes());
        index.extend(sum.to_le_bytes());
        index.extend((self.checksum)(&index[footer..]).to_le_bytes());
        index.extend(self.end);
    }

    /// Reads and checks magic, footer and index of a file of `length` bytes that may hold anything: the index's offset and bytes.
    ///
    /// # Errors
    /// Those of `read`, which gets an offset and a number of bytes, and what `damaged` makes of a place and what is wrong there.
    pub fn index<E>(
        &self,
        length: u64,
        read: impl Fn(u64, usize) -> Result<Vec<u8>, E>,
        damaged: impl Fn(u64, &str) -> E,
    ) -> Result<(u64, Vec<u8>), E> {
        let begin = self.magic.len() as u64;
        if length < begin + (self.least_index + FOOTER) as u64 {
            return Err(damaged(length, &format!("too short for {}", self.kind)));
        }
        if read(0, self.magic.len())? != self.magic {
            return Err(damaged(0, &format!("not {}, or of another version", self.kind)));
        }
        let at = length - FOOTER as u64;
        let bytes = read(at, FOOTER)?;
        let mut footer = Cursor(&bytes);
        let (Some(offset), Some(size), Some(sum), Some(own)) =
            (footer.u64(), footer.u64(), footer.u32(), footer.u32())
        else {
            return Err(damaged(at, "no footer"));
        };
        if footer.0 != self.end || (self.checksum)(&bytes[..20]) != own {
            return Err(damaged(at, "no footer: the file is cut off or was never finished"));
        }
        if offset < begin || offset.checked_add(size) != Some(at) || size < self.least_index as u64 {
            return Err(damaged(at, "the index is not where the footer says"));
        }
        let index = read(offset, size as usize)?;
        if (self.checksum)(&index) != sum {
            return Err(damaged(offset, "the checksum of the index is wrong"));
        }
        Ok((offset, index))
    }
}

/// Little-endian numbers from the front of a slice, which gets shorter; `None` where it is too short.
#[derive(Clone, Copy, Debug)]
pub struct Cursor<'a>(pub &'a [u8]);

impl<'a> Cursor<'a> {
    /// So many bytes.
    pub fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (now, later) = self.0.split_at_checked(count)?;
        self.0 = later;
        Some(now)
    }

    /// As many bytes as are asked for by type.
    pub fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    /// An unsigned number of four bytes.
    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    /// A signed number of four bytes.
    pub fn i32(&mut self) -> Option<i32> {
        self.array().map(i32::from_le_bytes)
    }

    /// An unsigned number of eight bytes.
    pub fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// A float of four bytes.
    pub fn f32(&mut self) -> Option<f32> {
        self.array().map(f32::from_le_bytes)
    }

    /// A float of eight bytes.
    pub fn f64(&mut self) -> Option<f64> {
        self.array().map(f64::from_le_bytes)
    }

    /// Three of the same.
    pub fn triple<T>(&mut self, one: impl Fn(&mut Self) -> Option<T>) -> Option<[T; 3]> {
        Some([one(self)?, one(self)?, one(self)?])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOTES: Sealed = Sealed {
        kind: "a notebook",
        magic: b"farsight-notes-1",
        end: b"fs-notes",
        least_index: 3,
        checksum: |bytes| bytes.iter().fold(7, |sum, b| (sum ^ u32::from(*b)).wrapping_mul(16_777_619)),
    };

    fn index(file: &[u8]) -> Result<(u64, Vec<u8>), String> {
        let read = |at: u64, size: usize| Ok(file[at as usize..at as usize + size].to_vec());
        NOTES.index(file.len() as u64, read, |_, problem| problem.to_owned())
    }

    #[test]
    fn what_was_closed_is_read_and_no_damage_goes_unseen() {
        let mut tail = vec![1, 2, 3, 4];
        let payload = [NOTES.magic.as_slice(), b"payload"].concat();
        NOTES.close(&mut tail, payload.len() as u64);
        let file = [payload, tail].concat();
        assert_eq!(index(&file), Ok((23, vec![1, 2, 3, 4])));
        for length in 0..file.len() {
            assert!(index(&file[..length]).is_err());
        }
        for at in (0..16).chain(23..file.len()) {
            let mut bad = file.clone();
            bad[at] ^= 0x10;
            assert!(index(&bad).is_err(), "byte {at}");
        }
        assert_eq!(index(&[0; 100]).unwrap_err(), "not a notebook, or of another version");
        assert_eq!(index(&[0; 40]).unwrap_err(), "too short for a notebook");
    }
}
