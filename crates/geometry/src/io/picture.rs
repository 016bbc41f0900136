//! PNG and JPEG to texels.

use super::{Budget, ImportError};
use crate::scene::Texture;

/// Longest side of a picture, in texels.
const MAX_SIDE: u32 = 16_384;
/// Most texels that one byte of a compressed picture can stand for. Deflate gives at most 1032 bytes a byte; a JPEG
/// spends at least a bit on each block of 64.
const MAX_TEXELS_PER_BYTE: u64 = 1_100;

/// Bytes of texels that all pictures of a small file may have together: one of 4096 x 4096.
pub(super) const PICTURES_FLOOR: u64 = 1 << 26;

/// Decodes a picture; the first bytes tell the format.
///
/// # Errors
/// [`ImportError::Unsupported`] for other formats, [`ImportError::Syntax`] for damaged ones,
/// [`ImportError::Limit`] for sizes that the bytes cannot hold or above 16,384 texels a side or above `budget`.
pub(super) fn decode(bytes: &[u8], budget: &mut Budget) -> Result<Texture, ImportError> {
    if bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
        decode_png(bytes, budget)
    } else if bytes.starts_with(&[0xff, 0xd8]) {
        decode_jpeg(bytes, budget)
    } else {
        Err(ImportError::Unsupported { what: "a picture that is neither PNG nor JPEG".into() })
    }
}

fn check_size(width: u32, height: u32, bytes: usize, budget: &mut Budget) -> Result<(), ImportError> {
    let side = width.max(height);
    if side > MAX_SIDE {
        let (count, limit) = (u64::from(side), u64::from(MAX_SIDE));
        return Err(ImportError::Limit { what: "texels on a side", count, limit });
    }
    let (count, limit) = (u64::from(width) * u64::from(height), bytes as u64 * MAX_TEXELS_PER_BYTE);
    if count > limit {
        return Err(ImportError::Limit { what: "texels in a picture of this file size", count, limit });
    }
    budget.take(count * 4)
}

fn decode_png(bytes: &[u8], budget: &mut Budget) -> Result<Texture, ImportError> {
    let bad = |e: png::DecodingError| ImportError::syntax("PNG picture", e.to_string());
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::normalize_to_color8() | png::Transformations::ALPHA);
    decoder.set_ignore_text_chunk(true);
    let mut reader = decoder.read_info().map_err(bad)?;
    let (width, height) = reader.info().size();
    check_size(width, height, bytes.len(), budget)?;
    let size = reader.output_buffer_size().ok_or(ImportError::syntax("PNG picture", "too large"))?;
    let mut raw = vec![0; size];
    let frame = reader.next_frame(&mut raw).map_err(bad)?;
    let raw = &raw[..frame.buffer_size()];
    let texels = match frame.color_type {
        png::ColorType::GrayscaleAlpha => raw.as_chunks().0.iter().map(|&[l, a]| [l, l, l, a]).collect(),
        png::ColorType::Rgba => raw.as_chunks().0.to_vec(),
        other => return Err(ImportError::Unsupported { what: format!("PNG colour type {other:?}") }),
    };
    Ok(Texture::new(width, height, texels)?)
}

fn decode_jpeg(bytes: &[u8], budget: &mut Budget) -> Result<Texture, ImportError> {
    let bad = |e: jpeg_decoder::Error| ImportError::syntax("JPEG picture", e.to_string());
    let mut decoder = jpeg_decoder::Decoder::new(bytes);
    decoder.read_info().map_err(bad)?;
    let info = decoder.info().ok_or(ImportError::syntax("JPEG picture", "no size"))?;
    let (width, height) = (u32::from(info.width), u32::from(info.height));
    check_size(width, height, bytes.len(), budget)?;
    decoder.set_max_decoding_buffer_size(width as usize * height as usize * 4);
    let raw = decoder.decode().map_err(bad)?;
    use jpeg_decoder::PixelFormat;
    let texels = match info.pixel_format {
        PixelFormat::L16 => {
            return Err(ImportError::Unsupported { what: "JPEG with more than 8 bits".into() });
        }
        PixelFormat::L8 => raw.iter().map(|&l| [l, l, l, 255]).collect(),
        PixelFormat::RGB24 => raw.as_chunks().0.iter().map(|&[r, g, b]| [r, g, b, 255]).collect(),
        // Amounts of ink, after the decoder has undone Adobe's inversion.
        PixelFormat::CMYK32 => raw
            .as_chunks()
            .0
            .iter()
            .map(|&[c, m, y, k]| {
                let light = |ink: u8| (u16::from(255 - ink) * u16::from(255 - k) / 255) as u8;
                [light(c), light(m), light(y), 255]
            })
            .collect(),
    };
    Ok(Texture::new(width, height, texels)?)
}
