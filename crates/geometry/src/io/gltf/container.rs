//! The GLB container, buffers and data URIs.

use super::item;
use crate::io::{ImportError, Siblings};
use ::gltf::json::{self, Root};
use std::borrow::Cow;
use std::collections::HashMap;

const JSON: u32 = u32::from_le_bytes(*b"JSON");
const BIN: u32 = u32::from_le_bytes(*b"BIN\0");

/// The JSON text and the binary chunk, if there is one.
pub(super) fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), ImportError> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None));
    }
    let word = |at: usize| -> Option<u32> {
        Some(u32::from_le_bytes(bytes.get(at..at.checked_add(4)?)?.try_into().ok()?))
    };
    let bad = |at: usize, problem: &str| ImportError::syntax(format!("byte {at}"), problem);
    let version = word(4).ok_or_else(|| bad(4, "the file ends in its header"))?;
    if version != 2 {
        return Err(ImportError::Unsupported { what: format!("glTF version {version}") });
    }
    // The total length in the header is not needed: chunks are checked against the bytes that are there.
    let (mut text, mut chunk) = (None, None);
    let mut at = 12;
    while let (Some(length), Some(kind)) = (word(at), word(at + 4)) {
        let start = at + 8;
        let end = start.checked_add(length as usize).filter(|&end| end <= bytes.len());
        let end = end.ok_or_else(|| bad(at, "a chunk is longer than the file"))?;
        match kind {
            JSON if text.is_none() => text = Some(&bytes[start..end]),
            BIN if chunk.is_none() => chunk = Some(&bytes[start..end]),
            _ => {}
        }
        at = end.next_multiple_of(4);
    }
    Ok((text.ok_or_else(|| bad(12, "there is no JSON chunk"))?, chunk))
}

/// The bytes of all buffers.
pub(super) struct Buffers<'a> {
    blobs: Vec<Cow<'a, [u8]>>,
    /// Blob and length of every buffer.
    of_buffer: Vec<(usize, usize)>,
}

impl<'a> Buffers<'a> {
    /// Loads every buffer once, and tells how many bytes of input there are in all.
    pub(super) fn load(
        root: &Root,
        chunk: Option<&'a [u8]>,
        siblings: Siblings<'_>,
        bytes: u64,
    ) -> Result<(Self, u64), ImportError> {
        let mut out = Self { blobs: vec![], of_buffer: vec![] };
        let mut input = bytes;
        let mut known: HashMap<Option<&str>, usize> = HashMap::new();
        for (number, buffer) in root.buffers.iter().enumerate() {
            let uri = buffer.uri.as_deref();
            let blob = match known.get(&uri) {
                Some(&blob) => blob,
                None => {
                    let blob = match uri {
                        None => Cow::Borrowed(chunk.ok_or_else(|| missing(number))?),
                        Some(uri) => Cow::Owned(fetch(uri, siblings)?),
                    };
                    if uri.is_some() {
                        input += blob.len() as u64;
                    }
                    out.blobs.push(blob);
                    known.insert(uri, out.blobs.len() - 1);
                    out.blobs.len() - 1
                }
            };
            let (declared, there) = (buffer.byte_length.0, out.blobs[blob].len() as u64);
            if declared > there {
                let problem = format!("{declared} bytes declared, {there} are there");
                return Err(ImportError::syntax(format!("buffer {number}"), problem));
            }
            out.of_buffer.push((blob, declared as usize));
        }
        Ok((out, input))
    }

    /// The bytes of a buffer view.
    pub(super) fn view<'b>(
        &'b self,
        root: &'b Root,
        index: usize,
    ) -> Result<(&'b [u8], &'b json::buffer::View), ImportError> {
        let view = item(&root.buffer_views, index, "buffer view")?;
        let &(blob, length) = item(&self.of_buffer, view.buffer.value(), "buffer")?;
        let start = view.byte_offset.map_or(0, |o| o.0);
        let end = start.checked_add(view.byte_length.0).filter(|&end| end <= length as u64);
        let end = end.ok_or_else(|| {
            let problem = format!("it leaves its buffer of {length} bytes");
            ImportError::syntax(format!("buffer view {index}"), problem)
        })?;
        Ok((&self.blobs[blob][start as usize..end as usize], view))
    }
}

fn missing(buffer: usize) -> ImportError {
    ImportError::syntax(format!("buffer {buffer}"), "it has no uri, and the file has no binary chunk")
}

/// The bytes behind a URI: inside it, or in a file beside this one.
pub(super) fn fetch(uri: &str, siblings: Siblings<'_>) -> Result<Vec<u8>, ImportError> {
    let Some(data) = uri.strip_prefix("data:") else {
        return siblings(&percent_decoded(uri)?);
    };
    match data.split_once(',') {
        Some((kind, text)) if kind.ends_with(";base64") => {
            base64_decoded(text).ok_or_else(|| ImportError::syntax("data URI", "broken base64"))
        }
        _ => Err(ImportError::Unsupported { what: "a data URI that is not base64".into() }),
    }
}

fn base64_decoded(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches('=').as_bytes();
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 3);
    for group in text.chunks(4) {
        let mut word = 0u32;
        for &letter in group {
            let value = match letter {
                b'A'..=b'Z' => letter - b'A',
                b'a'..=b'z' => letter - b'a' + 26,
                b'0'..=b'9' => letter - b'0' + 52,
                b'+' | b'-' => 62,
                b'/' | b'_' => 63,
                _ => return None,
            };
            word = word << 6 | u32::from(value);
        }
        let be = (word << (6 * (4 - group.len()))).to_be_bytes();
        match group.len() {
            4 => bytes.extend_from_slice(&be[1..4]),
            3 => bytes.extend_from_slice(&be[1..3]),
            2 => bytes.push(be[1]),
            _ => return None,
        }
    }
    Some(bytes)
}

fn percent_decoded(uri: &str) -> Result<String, ImportError> {
    if uri.contains("://") {
        return Err(ImportError::Unsupported { what: "a buffer or picture on another machine".into() });
    }
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&first, tail)) = rest.split_first() {
        rest = tail;
        let hex = |b: u8| (b as char).to_digit(16);
        match (first, tail) {
            (b'%', [a, b, tail @ ..]) if hex(*a).is_some() && hex(*b).is_some() => {
                bytes.push((hex(*a).unwrap_or(0) * 16 + hex(*b).unwrap_or(0)) as u8);
                rest = tail;
            }
            _ => bytes.push(first),
        }
    }
    String::from_utf8(bytes).map_err(|_| ImportError::syntax("uri", "not UTF-8"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_and_percent_signs() {
        for (text, bytes) in
            [("", &b""[..]), ("TQ==", b"M"), ("TWE=", b"Ma"), ("TWFu", b"Man"), ("TWFuTQ", b"ManM")]
        {
            assert_eq!(base64_decoded(text).unwrap(), bytes);
        }
        assert!(base64_decoded("TWFuT").is_none() && base64_decoded("T*==").is_none());
        assert_eq!(percent_decoded("a%20b%zz%").unwrap(), "a b%zz%");
        assert!(percent_decoded("http://x/y").is_err());
    }

    #[test]
    fn containers_are_checked() {
        assert!(split(b"glTF").is_err());
        assert!(split(b"glTF\x02\0\0\0\x0c\0\0\0").is_err());
        assert!(split(b"glTF\x01\0\0\0\x0c\0\0\0").is_err());
        assert!(split(b"glTF\x02\0\0\0\0\0\0\0\xff\xff\xff\xffJSON{}").is_err());
        assert_eq!(split(b"glTF\x02\0\0\0\0\0\0\0\x02\0\0\0JSON{}").unwrap(), (&b"{}"[..], None));
    }
}
