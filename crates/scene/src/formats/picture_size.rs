//! Width and height of a picture from its first bytes, without decoding it.

/// Width and height in pixels, where the format is PNG, JPEG, Radiance HDR, EXR or KTX2 and the bytes reach that far.
pub fn picture_size(bytes: &[u8]) -> Option<(u32, u32)> {
    match bytes {
        [0x89, b'P', b'N', b'G', ..] => Some((be32(bytes, 16)?, be32(bytes, 20)?)),
        [0xff, 0xd8, ..] => jpeg(bytes),
        [b'#', b'?', ..] => radiance(bytes),
        [0xab, b'K', b'T', b'X', ..] => Some((u32::try_from(le32(bytes, 20)?).ok()?, u32::try_from(le32(bytes, 24)?).ok()?)),
        [0x76, 0x2f, 0x31, 0x01, ..] => exr(bytes),
        _ => None,
    }
}

fn be32(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_be_bytes(bytes.get(at..at.checked_add(4)?)?.try_into().ok()?))
}

fn be16(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from(u16::from_be_bytes(bytes.get(at..at.checked_add(2)?)?.try_into().ok()?)))
}

fn le32(bytes: &[u8], at: usize) -> Option<i32> {
    Some(i32::from_le_bytes(bytes.get(at..at.checked_add(4)?)?.try_into().ok()?))
}

/// Walks the segments to a start of frame (ISO/IEC 10918-1, table B.1).
fn jpeg(bytes: &[u8]) -> Option<(u32, u32)> {
    let mut at = 2;
    loop {
        if *bytes.get(at)? != 0xff {
            return None;
        }
        let marker = *bytes.get(at + 1)?;
        match marker {
            0xff => at += 1,
            0xc0..=0xcf if !matches!(marker, 0xc4 | 0xc8 | 0xcc) => return Some((be16(bytes, at + 7)?, be16(bytes, at + 5)?)),
            0x01 | 0xd0..=0xd7 => at += 2,
            _ => at += 2 + be16(bytes, at + 2)?.max(2) as usize,
        }
    }
}

fn radiance(bytes: &[u8]) -> Option<(u32, u32)> {
    let line = bytes.split(|b| *b == b'\n').take(100).find(|l| l.starts_with(b"-Y ") || l.starts_with(b"+Y "))?;
    let words: Vec<&str> = std::str::from_utf8(line).ok()?.split_whitespace().collect();
    let [_, height, _, width] = words[..] else { return None };
    Some((width.parse().ok()?, height.parse().ok()?))
}

/// Walks the attributes to the data window.
fn exr(bytes: &[u8]) -> Option<(u32, u32)> {
    let mut at = 8;
    loop {
        let mut text = || {
            let end = at + bytes.get(at..)?.iter().take(256).position(|b| *b == 0)?;
            let text = &bytes[at..end];
            at = end + 1;
            Some(text)
        };
        let name = text()?;
        if name.is_empty() {
            return None;
        }
        text()?;
        let size = usize::try_from(le32(bytes, at)?).ok()?;
        at += 4;
        if name == b"dataWindow" {
            let edge = |a: usize| u32::try_from(i64::from(le32(bytes, at + 8 + a)?) - i64::from(le32(bytes, at + a)?) + 1).ok();
            return Some((edge(0)?, edge(4)?));
        }
        at = at.checked_add(size)?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_found_and_broken_files_have_none() {
        let mut png = vec![0x89, b'P', b'N', b'G', 13, 10, 26, 10, 0, 0, 0, 13, b'I', b'H', b'D', b'R', 0, 0, 1, 0, 0, 0, 0, 128];
        assert_eq!(picture_size(&png), Some((256, 128)));
        png.truncate(20);
        assert_eq!(picture_size(&png), None);
        assert_eq!(picture_size(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 512 +X 1024\n"), Some((1024, 512)));
        let jpeg = [0xff, 0xd8, 0xff, 0xe0, 0, 4, 0, 0, 0xff, 0xc0, 0, 11, 8, 0, 20, 0, 30, 1];
        assert_eq!(picture_size(&jpeg), Some((30, 20)));
        for n in 0..jpeg.len() {
            picture_size(&jpeg[..n]);
        }
    }
}
