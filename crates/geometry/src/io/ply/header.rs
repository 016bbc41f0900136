//! The header of a PLY: what the bytes after it mean.

use crate::io::ImportError;
use glam::DVec3;

/// Longest header, in bytes.
const MAX_HEADER: usize = 1 << 16;

/// How values are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number in the first bytes; `f64` holds all types exactly.
    ///
    /// Missing bytes count as zero.
    pub(super) fn decode(self, bytes: &[u8], big_endian: bool) -> f64 {
        let mut raw = [0; 8];
        for (to, from) in raw.iter_mut().zip(&bytes[..self.bytes().min(bytes.len())]) {
            *to = *from;
        }
        if big_endian {
            raw[..self.bytes()].reverse();
        }
        let [a, b, c, d, ..] = raw;
        match self {
            Self::I8 => f64::from(a as i8),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(raw),
        }
    }

    /// A colour channel of this type as 0..=255; NaN is 0.
    pub(super) fn to_byte(self, value: f64) -> u8 {
        let unit = match self {
            Self::F32 | Self::F64 => value,
            Self::U16 | Self::I16 => value / 65_535.0,
            Self::U32 | Self::I32 => value / 4_294_967_295.0,
            Self::U8 | Self::I8 => value / 255.0,
        };
        (unit.clamp(0.0, 1.0) * 255.0).round() as u8
    }
}

/// One number or a list of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

#[derive(Clone, Debug)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
}

impl Property {
    pub(super) fn is_scalar(&self) -> bool {
        self.scalar().is_some()
    }

    pub(super) fn scalar(&self) -> Option<Scalar> {
        match self.kind {
            Kind::Scalar(kind) => Some(kind),
            Kind::List { .. } => None,
        }
    }

    /// Fewest bytes that a binary value takes.
    pub(super) fn least_bytes(&self) -> u64 {
        match self.kind {
            Kind::Scalar(kind) | Kind::List { count: kind, .. } => kind.bytes() as u64,
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) origin: Option<DVec3>,
    pub(super) elements: Vec<Element>,
}

/// Splits a file into its header and the bytes after it.
pub(super) fn parse(bytes: &[u8]) -> Result<(Header, &[u8]), ImportError> {
    let mut rest = bytes;
    let mut encoding = None;
    let mut header = Header { encoding: Encoding::Ascii, origin: None, elements: vec![] };
    for number in 1.. {
        let place = || format!("header line {number}");
        let end = rest.iter().take(MAX_HEADER).position(|&b| b == b'\n');
        let end = end.ok_or_else(|| ImportError::syntax(place(), "there is no 'end_header'"))?;
        let line = String::from_utf8_lossy(&rest[..end]).into_owned();
        rest = &rest[end + 1..];
        if bytes.len() - rest.len() > MAX_HEADER {
            return Err(ImportError::syntax(place(), "the header is longer than 64 KiB"));
        }
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["ply"] if number == 1 => {}
            _ if number == 1 => {
                return Err(ImportError::syntax(place(), "the file does not begin with 'ply'"));
            }
            ["format", name, _] => encoding = Some(parse_encoding(name, &place())?),
            ["comment", "origin", x, y, z] => header.origin = parse_origin([x, y, z]).or(header.origin),
            ["comment" | "obj_info", ..] | [] => {}
            ["element", name, count] => {
                let bad = || ImportError::syntax(place(), format!("'{count}' is not a count"));
                let count = count.parse().map_err(|_| bad())?;
                header.elements.push(Element { name: name.into(), count, properties: vec![] });
            }
            ["property", ref property @ ..] => {
                let bad =
                    || ImportError::syntax(place(), format!("'{line}' is not a property of an element"));
                let element = header.elements.last_mut().ok_or_else(bad)?;
                element.properties.push(parse_property(property).ok_or_else(bad)?);
            }
            ["end_header"] => break,
            _ => return Err(ImportError::syntax(place(), format!("'{line}' is not understood"))),
        }
    }
    header.encoding = encoding.ok_or_else(|| ImportError::syntax("header", "there is no 'format' line"))?;
    Ok((header, rest))
}

fn parse_encoding(name: &str, place: &str) -> Result<Encoding, ImportError> {
    match name {
        "ascii" => Ok(Encoding::Ascii),
        "binary_little_endian" => Ok(Encoding::LittleEndian),
        "binary_big_endian" => Ok(Encoding::BigEndian),
        _ => Err(ImportError::syntax(place, format!("unknown format '{name}'"))),
    }
}

fn parse_origin(words: [&str; 3]) -> Option<DVec3> {
    let [x, y, z] = words.map(|w| w.parse::<f64>().ok().filter(|v| v.is_finite()));
    Some(DVec3::new(x?, y?, z?))
}

fn parse_property(words: &[&str]) -> Option<Property> {
    let (kind, name) = match *words {
        ["list", count, item, name] => {
            (Kind::List { count: Scalar::parse(count)?, item: Scalar::parse(item)? }, name)
        }
        [kind, name] => (Kind::Scalar(Scalar::parse(kind)?), name),
        _ => return None,
    };
    Some(Property { name: name.into(), kind })
}
