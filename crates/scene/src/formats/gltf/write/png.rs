//! Pictures of decoded values as PNG, without compression.

fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for &b in bytes {
        crc ^= u32::from(b);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 & 0u32.wrapping_sub(crc & 1));
        }
    }
    !crc
}

fn chunk(out: &mut Vec<u8>, kind: &[u8; 4], data: &[u8]) {
    out.extend((data.len() as u32).to_be_bytes());
    let start = out.len();
    out.extend(kind);
    out.extend(data);
    let crc = crc32(&out[start..]);
    out.extend(crc.to_be_bytes());
}

/// The transfer function of sRGB (IEC 61966-2-1) as a byte.
fn srgb_byte(v: f32) -> u8 {
    let v = f64::from(v.clamp(0.0, 1.0));
    let encoded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (255.0 * encoded).round() as u8
}

/// Encodes linear values, 1 to 4 to a pixel; alpha (the second of two, the fourth of four) stays linear.
pub fn encode(width: u32, height: u32, channels: u32, data: &[f32], srgb: bool) -> Vec<u8> {
    let n = channels as usize;
    let color_type = [0, 4, 2, 6][n - 1];
    let mut raw = Vec::with_capacity(data.len() + height as usize);
    for row in data.chunks_exact(n * width as usize) {
        raw.push(0);
        for (i, &v) in row.iter().enumerate() {
            let is_alpha = n.is_multiple_of(2) && i % n == n - 1;
            raw.push(if srgb && !is_alpha { srgb_byte(v) } else { (255.0 * v.clamp(0.0, 1.0)).round() as u8 });
        }
    }
    let (mut a, mut b) = (1u32, 0u32);
    for &byte in &raw {
        a = (a + u32::from(byte)) % 65521;
        b = (b + a) % 65521;
    }
    // zlib with stored blocks (RFC 1950, RFC 1951 3.2.4).
    let mut zlib = vec![0x78, 0x01];
    let blocks = raw.chunks(65535).count();
    for (i, block) in raw.chunks(65535).enumerate() {
        zlib.push(u8::from(i + 1 == blocks));
        zlib.extend((block.len() as u16).to_le_bytes());
        zlib.extend((!(block.len() as u16)).to_le_bytes());
        zlib.extend(block);
    }
    zlib.extend((b << 16 | a).to_be_bytes());
    let mut out = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut header = width.to_be_bytes().to_vec();
    header.extend(height.to_be_bytes());
    header.extend([8, color_type, 0, 0, 0]);
    chunk(&mut out, b"IHDR", &header);
    chunk(&mut out, b"IDAT", &zlib);
    chunk(&mut out, b"IEND", &[]);
    out
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_png_has_the_checksums_of_the_standard() {
        let png = super::encode(2, 1, 3, &[0.0, 1.0, 0.0, 1.0, 0.5, 0.0], true);
        // The CRC of an empty IEND is in every PNG.
        assert!(png.ends_with(b"\0\0\0\0IEND\xae\x42\x60\x82"));
        let raw = [0, 0, 255, 0, 255, 188, 0];
        assert!(png.windows(raw.len()).any(|w| w == raw));
    }
}
