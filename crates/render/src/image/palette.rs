//! Palette indices of pictures, for what goes by index: the readers of pictures give colors alone.

use std::io::Cursor;

use super::ReadLimits;

/// The palette index of each pixel, row by row from the top, of a PNG or GIF file with a palette (its first frame); `None` for others, and for
/// files that cannot be read or exceed the default [`ReadLimits`].
pub(crate) fn palette_indices(bytes: &[u8]) -> Option<Vec<u8>> {
    if bytes.starts_with(b"\x89PNG") {
        png_indices(bytes)
    } else if bytes.starts_with(b"GIF8") {
        gif_indices(bytes)
    } else {
        None
    }
}

/// Number of pixels, where the limits allow as many.
fn area(width: u32, height: u32) -> Option<usize> {
    let limits = ReadLimits::default();
    let pixels = u64::from(width) * u64::from(height);
    (width.max(height) <= limits.max_side && pixels <= limits.max_bytes).then_some(usize::try_from(pixels).ok()?)
}

fn png_indices(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::IDENTITY);
    let mut reader = decoder.read_info().ok()?;
    let (color, depth) = reader.output_color_type();
    if color != png::ColorType::Indexed {
        return None;
    }
    let (width, height) = (reader.info().width, reader.info().height);
    area(width, height)?;
    let mut packed = vec![0; reader.output_buffer_size()?];
    let info = reader.next_frame(&mut packed).ok()?;
    let bits = usize::from(depth as u8).clamp(1, 8);
    let mask = (0xff_u16 >> (8 - bits)) as u8;
    let mut indices = Vec::with_capacity(width as usize * height as usize);
    for row in packed.chunks_exact(info.line_size).take(height as usize) {
        for x in 0..width as usize {
            let at = x * bits;
            let byte = row.get(at / 8)?;
            indices.push(byte >> (8 - bits - at % 8) & mask);
        }
    }
    Some(indices)
}

fn gif_indices(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::Indexed);
    let mut decoder = options.read_info(Cursor::new(bytes)).ok()?;
    let (width, height) = (usize::from(decoder.width()), usize::from(decoder.height()));
    let mut indices = vec![0; area(width as u32, height as u32)?];
    let frame = decoder.read_next_frame().ok()??;
    let (left, columns) = (usize::from(frame.left), usize::from(frame.width));
    for (y, line) in frame.buffer.chunks_exact(columns.max(1)).enumerate() {
        let start = (y + usize::from(frame.top)) * width + left;
        if let Some(row) = indices.get_mut(start..start + columns.min(width.saturating_sub(left))) {
            row.iter_mut().zip(line).for_each(|(to, from)| *to = *from);
        }
    }
    Some(indices)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A PNG of 5 × 2 pixels with 2 bits each.
    fn small(color: png::ColorType) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 5, 2);
        encoder.set_color(color);
        encoder.set_depth(png::BitDepth::Two);
        encoder.set_palette(vec![0, 0, 0, 9, 9, 9, 99, 99, 99, 255, 255, 255]);
        encoder.write_header().unwrap().write_image_data(&[0b0001_1011, 0b1100_0000, 0b1111_0000, 0b0100_0000]).unwrap();
        bytes
    }

    #[test]
    fn png_with_and_without_palette() {
        let bytes = small(png::ColorType::Indexed);
        assert_eq!(palette_indices(&bytes).unwrap(), [0, 1, 2, 3, 3, 3, 3, 0, 0, 1]);
        assert!(palette_indices(&small(png::ColorType::Grayscale)).is_none());
        for end in 0..bytes.len() - 12 {
            let _ = palette_indices(&bytes[..end]);
        }
    }

    #[test]
    fn gif_frames_lie_in_their_place() {
        let mut bytes = Vec::new();
        let palette = [0, 0, 0, 10, 20, 30, 40, 50, 60, 70, 80, 90];
        let mut encoder = gif::Encoder::new(&mut bytes, 3, 2, &palette).unwrap();
        let frame = gif::Frame { left: 1, top: 1, width: 2, height: 1, buffer: vec![2, 3].into(), ..gif::Frame::default() };
        encoder.write_frame(&frame).unwrap();
        drop(encoder);
        assert_eq!(palette_indices(&bytes).unwrap(), [0, 0, 0, 0, 2, 3]);
        for end in 0..bytes.len() {
            let _ = palette_indices(&bytes[..end]);
        }
    }
}
