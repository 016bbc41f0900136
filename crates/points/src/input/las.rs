//! LAS and LAZ files through the `las` crate, with a header that is checked first.
//!
//! Uncompressed points are not decoded by anyone: the build reads their records from the file where they lie, on all threads.

use super::{Input, Part, RawReader, Source};
use crate::layout::{Colour, Layout, some_range};
use crate::{Grid, PointsError};
use glam::DVec3;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};

/// What is taken from LAS and LAZ files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct LasOptions {
    /// Keep everything else that a record holds (intensity, returns, classification, times, extra bytes) as attribute bytes, in
    /// the order of the file.
    pub attributes: bool,
}

impl Input<'_> {
    /// Opens LAS or LAZ files, which must share scale, record and, up to whole steps, offset.
    ///
    /// Of the header only scale, offset and record layout are believed. Counts are compared with the file's length, boxes are
    /// taken anew.
    ///
    /// # Accuracy
    /// Positions are kept as integers, bit for bit. Colours have 8 bits per channel: where any channel of a file exceeds 255, the high
    /// byte of each is taken. Formats without colour are white.
    ///
    /// # Errors
    /// [`PointsError::Input`] for what is not LAS, is cut off, or promises more points than the file has room for;
    /// [`PointsError::GridsDiffer`], [`PointsError::AttributesDiffer`] when files do not fit together.
    pub fn las(paths: &[impl AsRef<Path>], options: &LasOptions) -> Result<Self, PointsError> {
        let mut all: Option<Self> = None;
        for path in paths {
            let input = Header::read(path.as_ref())?.input(options)?;
            all = Some(match all {
                None => input,
                Some(all) => all.join(input)?,
            });
        }
        all.ok_or(PointsError::Option { option: "paths", value: 0.0, range: "at least one file" })
    }
}

/// What is needed of a header.
struct Header {
    path: PathBuf,
    raw: las::raw::Header,
    format: u8,
    compressed: bool,
    record: usize,
    points: u64,
    file_bytes: u64,
}

/// Length of the records of formats 0 to 10 without extra bytes, and where red stands if anywhere.
const FORMATS: [(usize, Option<usize>); 11] = [
    (20, None),
    (28, None),
    (26, Some(20)),
    (34, Some(28)),
    (57, None),
    (63, Some(28)),
    (30, None),
    (36, Some(30)),
    (38, Some(30)),
    (59, None),
    (67, Some(30)),
];

impl Header {
    fn read(path: &Path) -> Result<Self, PointsError> {
        let bad = |problem: String| PointsError::input(path, problem);
        let metadata = std::fs::metadata(path).map_err(PointsError::io(path))?;
        if !metadata.is_file() {
            return Err(bad("not a regular file".into()));
        }
        let file_bytes = metadata.len();
        let file = File::open(path).map_err(PointsError::io(path))?;
        let raw = las::raw::Header::read_from(BufReader::new(file)).map_err(|e| bad(e.to_string()))?;
        let code = raw.point_data_record_format;
        let format = code & 0x3f;
        let Some(&(least, _)) = FORMATS.get(format as usize) else {
            return Err(bad(format!("point format {code} is unknown")));
        };
        let record = raw.point_data_record_length as usize;
        if record < least {
            return Err(bad(format!("records of {record} bytes; format {format} has at least {least}")));
        }
        // Where both counts are given, the older one stands for files below 2^32 points.
        let legacy = u64::from(raw.number_of_point_records);
        let points = raw.large_file.filter(|_| legacy == 0).map_or(legacy, |l| l.number_of_point_records);
        let header = Self {
            path: path.to_owned(),
            format,
            compressed: code & 0xc0 != 0,
            record,
            points,
            file_bytes,
            raw,
        };
        header.check()?;
        Ok(header)
    }

    /// Nothing may be promised that the file has no room for.
    fn check(&self) -> Result<(), PointsError> {
        let (raw, size) = (&self.raw, self.file_bytes);
        let bad = |problem: String| Err(PointsError::input(&self.path, problem));
        let offset = u64::from(raw.offset_to_point_data);
        if offset > size || offset < u64::from(raw.header_size) {
            return bad(format!("points at byte {offset} of {size}"));
        }
        let room = size - offset;
        // A compressed point takes a bit at the very least; whole chunks of equal points come close.
        let most = if self.compressed { room.saturating_mul(4096) } else { room / self.record as u64 };
        if self.points > most {
            let declared = self.points;
            return bad(format!(
                "{declared} points declared, but there is room for {most} at most: cut off or damaged"
            ));
        }
        if let Some(evlr) = &raw.evlr {
            let start = evlr.start_of_first_evlr;
            let fits = start >= offset && start.checked_add(60).is_some_and(|end| end <= size);
            if evlr.number_of_evlrs > 0 && (!fits || !self.extended_record_fits(start)?) {
                return bad(format!("an extended record at byte {start} of {size}"));
            }
        }
        Ok(())
    }

    /// Whether the extended variable length record at an offset ends inside the file.
    fn extended_record_fits(&self, start: u64) -> Result<bool, PointsError> {
        let io = || PointsError::io(&self.path);
        let mut file = File::open(&self.path).map_err(io())?;
        let mut length = [0; 8];
        // Two reserved bytes, user id (16), record id (2), then the length.
        file.seek(SeekFrom::Start(start + 20)).map_err(io())?;
        file.read_exact(&mut length).map_err(io())?;
        Ok(start
            .checked_add(60 + u64::from_le_bytes(length).min(1 << 62))
            .is_some_and(|end| end <= self.file_bytes))
    }

    fn grid(&self) -> Result<Grid, PointsError> {
        let raw = &self.raw;
        let grid = Grid {
            scale: DVec3::new(raw.x_scale_factor, raw.y_scale_factor, raw.z_scale_factor),
            offset: DVec3::new(raw.x_offset, raw.y_offset, raw.z_offset),
        };
        grid.check(&self.path.display().to_string())?;
        Ok(grid)
    }

    fn layout(&self, options: &LasOptions) -> Result<Layout, PointsError> {
        let red = FORMATS[self.format as usize].1;
        let attributes = match red {
            _ if !options.attributes => vec![],
            Some(red) => [12..red, red + 6..self.record].into_iter().filter(|r| !r.is_empty()).collect(),
            None => some_range(12..self.record),
        };
        let layout =
            Layout { stride: self.record, colour: red.map_or(Colour::None, Colour::Words), attributes };
        layout.check()?;
        Ok(layout)
    }

    /// The box in the header, if it can be one.
    fn guess(&self, grid: &Grid) -> Option<([i32; 3], [i32; 3])> {
        let raw = &self.raw;
        let lo = grid.nearest(DVec3::new(raw.min_x, raw.min_y, raw.min_z))?;
        let hi = grid.nearest(DVec3::new(raw.max_x, raw.max_y, raw.max_z))?;
        (0..3).all(|k| lo[k] <= hi[k]).then_some((lo, hi))
    }

    fn input<'a>(self, options: &LasOptions) -> Result<Input<'a>, PointsError> {
        let (grid, layout) = (self.grid()?, self.layout(options)?);
        let name = if options.attributes { format!("las:{}", self.format) } else { String::new() };
        let part = if self.compressed {
            let decoder = Decoder::open(&self, layout)?;
            let layout = decoder.kept();
            let source = Source::Raw(Box::new(decoder));
            Part { name: self.path, source, layout, count: 0, shift: [0; 3], guess: None }
        } else {
            let source =
                Source::File { path: self.path.clone(), offset: self.raw.offset_to_point_data.into() };
            let guess = self.guess(&grid);
            Part { name: self.path, source, layout, count: self.points, shift: [0; 3], guess }
        };
        Ok(Input::of_part(grid, name, part))
    }
}

/// Points decoded at once: several chunks of the usual 50,000, so that threads have something to share.
const AT_ONCE: u64 = 400_000;

/// A LAZ file that is being decoded.
struct Decoder {
    path: PathBuf,
    reader: las::Reader,
    records: las::PointData,
    layout: Layout,
    left: u64,
}

impl Decoder {
    fn open(header: &Header, layout: Layout) -> Result<Self, PointsError> {
        let path = header.path.clone();
        check_chunk_table(header)?;
        // The decoder is written for sound files; what it does with others must not end the program.
        let opened = std::panic::catch_unwind(AssertUnwindSafe(|| las::Reader::from_path(&path)));
        let reader =
            opened.map_err(|_| broken(&path))?.map_err(|e| PointsError::input(&path, e.to_string()))?;
        let records = las::PointDataBuilder::new().for_header(reader.header()).build();
        if records.record_len() != layout.stride {
            return Err(PointsError::input(&path, format!("records of {} bytes", layout.stride)));
        }
        Ok(Self { path, reader, records, layout, left: header.points })
    }

    /// Layout of what is kept of a record: position, colour, attributes.
    fn kept(&self) -> Layout {
        let (colour, end) = match self.layout.colour {
            Colour::Words(_) => (Colour::Words(12), 18),
            other => (other, 12),
        };
        let stride = end + self.layout.attribute_bytes();
        Layout { stride, colour, attributes: some_range(end..stride) }
    }
}

fn broken(path: &Path) -> PointsError {
    PointsError::input(path, "compressed points that cannot be decoded")
}

/// The table of chunks is allocated as long as it claims to be: it must fit in the file.
fn check_chunk_table(header: &Header) -> Result<(), PointsError> {
    let path = &header.path;
    let io = || PointsError::io(path);
    let mut file = File::open(path).map_err(io())?;
    let read = |file: &mut File, at: u64, bytes: &mut [u8]| {
        file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(bytes)).map_err(io())
    };
    if header.points == 0 {
        return Ok(());
    }
    let (start, mut table) = (u64::from(header.raw.offset_to_point_data), [0; 8]);
    read(&mut file, start, &mut table)?;
    // A writer that could not go back leaves the offset at the end.
    if i64::from_le_bytes(table) <= start as i64 {
        read(&mut file, header.file_bytes - 8, &mut table)?;
    }
    let at = u64::from_le_bytes(table);
    if at.checked_add(8).is_none_or(|end| end > header.file_bytes) {
        return Err(PointsError::input(
            path,
            format!("a table of chunks at byte {at} of {}", header.file_bytes),
        ));
    }
    let mut count = [0; 4];
    read(&mut file, at + 4, &mut count)?;
    let count = u64::from(u32::from_le_bytes(count));
    // A chunk has at least its first point, uncompressed.
    if count * header.record as u64 > header.file_bytes {
        return Err(PointsError::input(path, format!("{count} chunks in {} bytes", header.file_bytes)));
    }
    Ok(())
}

impl RawReader for Decoder {
    fn read(&mut self, bytes: &mut Vec<u8>) -> Result<bool, PointsError> {
        let wanted = self.left.min(AT_ONCE);
        if wanted == 0 {
            return Ok(false);
        }
        let (reader, records) = (&mut self.reader, &mut self.records);
        let decoded = std::panic::catch_unwind(AssertUnwindSafe(|| reader.fill_points(wanted, records)));
        let got = decoded.map_err(|_| broken(&self.path))?;
        let got = got.map_err(|e| {
            PointsError::input(&self.path, format!("{} points before the end: {e}", self.left))
        })?;
        if got != wanted {
            return Err(PointsError::input(
                &self.path,
                format!("cut off {} points before the end", self.left - got),
            ));
        }
        self.left -= got;
        let layout = &self.layout;
        bytes.reserve(got as usize * self.kept().stride);
        for record in self.records.raw_bytes().chunks_exact(layout.stride) {
            bytes.extend_from_slice(&record[..12]);
            if let Colour::Words(at) = layout.colour {
                bytes.extend_from_slice(&record[at..at + 6]);
            }
            for range in &layout.attributes {
                bytes.extend_from_slice(&record[range.clone()]);
            }
        }
        Ok(self.left > 0)
    }
}
