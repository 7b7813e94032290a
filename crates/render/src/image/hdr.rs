//! Reader of Radiance pictures (.hdr): RGBE, flat or run-length coded.
//!
//! Written here because the `image` crate's entry that is cheap to compile against stops at 512 MiB, less than the
//! environment maps of 16384 × 8192 pixels that people have. Format: Ward, "Real Pixels", Graphics Gems II, 1991, and
//! the file format chapter of the Radiance documentation.

use super::{ImageError, ReadLimits};

/// True where the bytes start as a Radiance picture does.
pub(super) fn is_hdr(bytes: &[u8]) -> bool {
    bytes.starts_with(b"#?")
}

fn invalid(what: &str) -> ImageError {
    ImageError::Invalid(format!("Radiance picture: {what}"))
}

/// The next line without its end.
fn line<'a>(rest: &mut &'a [u8]) -> Result<&'a str, ImageError> {
    let end = rest.iter().take(4096).position(|&b| b == b'\n').ok_or_else(|| invalid("the header does not end"))?;
    let (line, behind) = (&rest[..end], &rest[end + 1..]);
    *rest = behind;
    std::str::from_utf8(line).map(str::trim_end).map_err(|_| invalid("the header is not text"))
}

/// Width, height and interleaved linear RGB.
pub(super) fn read_hdr(bytes: &[u8], limits: ReadLimits) -> Result<(u32, u32, Vec<f32>), ImageError> {
    let mut rest = bytes;
    let mut exposure = 1.0f32;
    loop {
        let text = line(&mut rest)?;
        if text.is_empty() {
            break;
        }
        if let Some(format) = text.strip_prefix("FORMAT=") {
            if format.trim() != "32-bit_rle_rgbe" {
                return Err(ImageError::Unsupported(format!("Radiance pixels of format {format}")));
            }
        } else if let Some(value) = text.strip_prefix("EXPOSURE=") {
            let value: f32 = value.trim().parse().map_err(|_| invalid("EXPOSURE is not a number"))?;
            exposure *= value;
        }
    }
    if !(exposure.is_finite() && exposure > 0.0) {
        return Err(invalid("EXPOSURE is not positive"));
    }
    let size = line(&mut rest)?;
    let words: Vec<&str> = size.split_whitespace().collect();
    let (width, height) = match words[..] {
        ["-Y", height, "+X", width] => (width.parse::<u32>(), height.parse::<u32>()),
        _ => return Err(ImageError::Unsupported(format!("Radiance picture with the orientation \"{size}\""))),
    };
    let (Ok(width), Ok(height)) = (width, height) else { return Err(invalid("the size is not a number")) };
    let pixels = u64::from(width) * u64::from(height);
    if width.max(height) > limits.max_side || pixels.saturating_mul(12) > limits.max_bytes {
        return Err(ImageError::TooLarge { width: width.into(), height: height.into() });
    }
    // Two bytes for at most 127 equal ones, four planes: no file is shorter than this.
    if pixels == 0 || pixels / 16 > rest.len() as u64 {
        return Err(invalid("shorter than its size"));
    }
    let mut rgb = Vec::with_capacity(pixels as usize * 3);
    let mut row = vec![[0u8; 4]; width as usize];
    for _ in 0..height {
        read_row(&mut rest, &mut row).ok_or_else(|| invalid("truncated or damaged pixels"))?;
        for &[r, g, b, e] in &row {
            // 2^(e − 136), exactly; e = 0 is black.
            let scale = if e == 0 { 0.0 } else { libm::ldexpf(1.0, i32::from(e) - 136) / exposure };
            rgb.extend([r, g, b].map(|m| f32::from(m) * scale));
        }
    }
    Ok((width, height, rgb))
}

fn take<'a>(rest: &mut &'a [u8], count: usize) -> Option<&'a [u8]> {
    let (head, tail) = rest.split_at_checked(count)?;
    *rest = tail;
    Some(head)
}

fn read_row(rest: &mut &[u8], row: &mut [[u8; 4]]) -> Option<()> {
    let width = row.len();
    let coded = (8..0x8000).contains(&width)
        && matches!(rest.get(..4), Some(&[2, 2, hi, lo]) if hi < 128 && usize::from(hi) << 8 | usize::from(lo) == width);
    if !coded {
        return read_flat_row(rest, row);
    }
    take(rest, 4)?;
    for plane in 0..4 {
        let mut x = 0;
        while x < width {
            let count = usize::from(take(rest, 1)?[0]);
            if count > 128 {
                let value = take(rest, 1)?[0];
                row.get_mut(x..x + count - 128)?.iter_mut().for_each(|p| p[plane] = value);
                x += count - 128;
            } else {
                let values = take(rest, count)?;
                row.get_mut(x..x + count)?.iter_mut().zip(values).for_each(|(p, v)| p[plane] = *v);
                // A run of no pixels would go on for as long as the file does.
                x += if count == 0 { return None } else { count };
            }
        }
    }
    Some(())
}

/// Plain pixels, and the older run-length code in which (1, 1, 1, n) repeats the pixel before it.
fn read_flat_row(rest: &mut &[u8], row: &mut [[u8; 4]]) -> Option<()> {
    let (mut x, mut shift) = (0, 0);
    while x < row.len() {
        let pixel: [u8; 4] = take(rest, 4)?.try_into().ok()?;
        if let [1, 1, 1, count] = pixel {
            let count = usize::from(count).checked_shl(shift)?;
            let previous = *row.get(x.checked_sub(1)?)?;
            row.get_mut(x..x.checked_add(count)?)?.fill(previous);
            x += count;
            shift = if shift < 24 { shift + 8 } else { return None };
        } else {
            row[x] = pixel;
            x += 1;
            shift = 0;
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> Result<(u32, u32, Vec<f32>), ImageError> {
        read_hdr(bytes, ReadLimits::default())
    }

    #[test]
    fn flat_old_and_new_coding() {
        let head = |size: &str| format!("#?RADIANCE\n# made\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n{size}\n").into_bytes();
        let mut flat = head("-Y 1 +X 3");
        flat.extend([128, 64, 0, 129, 1, 1, 1, 1, 255, 255, 255, 0]);
        assert_eq!(read(&flat).unwrap(), (3, 1, vec![0.5, 0.25, 0.0, 0.5, 0.25, 0.0, 0.0, 0.0, 0.0]));
        let mut coded = head("-Y 1 +X 9");
        coded.extend([2, 2, 0, 9, 137, 128, 128 + 8, 64, 1, 32, 9, 0, 1, 2, 3, 4, 5, 6, 7, 8, 137, 129]);
        let (_, _, rgb) = read(&coded).unwrap();
        assert_eq!(rgb[..6], [0.5, 0.25, 0.0, 0.5, 0.25, 1.0 / 256.0]);
        assert_eq!(rgb[25], 32.0 / 256.0);
        for length in 0..coded.len() {
            assert!(read(&coded[..length]).is_err());
        }
    }

    #[test]
    fn hostile_headers() {
        for size in ["-Y 99999999 +X 99999999", "-Y 100000 +X 100000", "-Y -1 +X 4", "-Y 0 +X 4", "+X 4 -Y 3", "", "-Y 4 +X 20000"] {
            assert!(read(format!("#?RADIANCE\n\n{size}\n").as_bytes()).is_err(), "{size}");
        }
        assert!(read(b"#?RADIANCE\nEXPOSURE=0\n\n-Y 1 +X 1\n\x01\x01\x01\x01").is_err());
        assert!(read(b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n\x01\x02\x01\x01").is_err());
        // A run before any pixel, and one beyond the row.
        assert!(read(b"#?RADIANCE\n\n-Y 1 +X 1\n\x01\x01\x01\x01").is_err());
        assert!(read(b"#?RADIANCE\n\n-Y 1 +X 2\n\x05\x01\x01\x01\x01\x01\x01\xff").is_err());
    }
}
