//! The outer form of a glTF file: GLB chunks, `data:` addresses and base64.

use std::borrow::Cow;

/// The parts of a file.
#[derive(Debug)]
pub struct Container<'a> {
    /// The JSON text's bytes.
    pub json: &'a [u8],
    /// The binary chunk of a GLB.
    pub binary: Option<&'a [u8]>,
    /// Oddities that do no harm.
    pub warnings: Vec<String>,
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    let four = bytes.get(at..at.checked_add(4)?)?;
    Some(u32::from_le_bytes([four[0], four[1], four[2], four[3]]))
}

/// Splits a GLB into its chunks; anything else is JSON as it stands.
///
/// # Errors
/// What is wrong with the GLB, in a sentence.
pub fn split(bytes: &[u8]) -> Result<Container<'_>, String> {
    if !bytes.starts_with(b"glTF") {
        return Ok(Container { json: bytes, binary: None, warnings: Vec::new() });
    }
    let mut warnings = Vec::new();
    let (Some(version), Some(length)) = (u32_at(bytes, 4), u32_at(bytes, 8)) else {
        return Err("a GLB file of fewer than 12 bytes".to_owned());
    };
    if version != 2 {
        return Err(format!("GLB version {version}; only version 2 (glTF 2.0) is read"));
    }
    let body = match bytes.get(..length as usize) {
        None => return Err(format!("the GLB is cut off: its header promises {length} bytes, it has {}", bytes.len())),
        Some(body) => body,
    };
    if body.len() < bytes.len() {
        warnings.push(format!("{} bytes follow the end of the GLB", bytes.len() - body.len()));
    }
    let (mut json, mut binary) = (None, None);
    let mut at = 12;
    while at < body.len() {
        let (Some(size), Some(kind)) = (u32_at(body, at), u32_at(body, at + 4)) else {
            return Err(format!("the GLB is cut off in the head of the chunk at byte {at}"));
        };
        let start = at + 8;
        let Some(chunk) = body.get(start..start.saturating_add(size as usize)) else {
            return Err(format!("the chunk at byte {at} of the GLB promises {size} bytes, {} are left", body.len() - start));
        };
        match kind {
            0x4E4F_534A if json.is_none() => json = Some(chunk),
            0x004E_4942 if binary.is_none() => binary = Some(chunk),
            _ => warnings.push(format!("unknown or repeated chunk at byte {at} of the GLB")),
        }
        at = start + size as usize;
    }
    let json = json.ok_or("the GLB has no JSON chunk")?;
    Ok(Container { json, binary, warnings })
}

/// The bytes of a `data:` address; `None` where it is none.
///
/// # Errors
/// What is wrong with it.
pub fn data_uri(uri: &str) -> Option<Result<Vec<u8>, &'static str>> {
    let rest = uri.strip_prefix("data:")?;
    let Some((head, body)) = rest.split_once(',') else { return Some(Err("a data: address without a comma")) };
    if head.ends_with(";base64") {
        return Some(base64(body.as_bytes()).ok_or("not base64"));
    }
    Some(Ok(percent_decode(body)))
}

/// Decodes base64 with or without padding, in the usual or the URL alphabet.
fn base64(text: &[u8]) -> Option<Vec<u8>> {
    let text = text.trim_ascii();
    let end = text.iter().rposition(|&b| b != b'=').map_or(0, |i| i + 1);
    let mut out = Vec::with_capacity(end / 4 * 3 + 3);
    let (mut bits, mut count) = (0u32, 0);
    for &b in &text[..end] {
        let digit = match b {
            b'A'..=b'Z' => b - b'A',
            b'a'..=b'z' => b - b'a' + 26,
            b'0'..=b'9' => b - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            _ => return None,
        };
        bits = bits << 6 | u32::from(digit);
        count += 6;
        if count >= 8 {
            count -= 8;
            out.push((bits >> count) as u8);
        }
    }
    // A single digit left over carries less than a byte.
    (count != 6).then_some(out)
}

/// Resolves `%20` and the like in a relative address.
pub fn percent_decode(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let hex = |b: u8| (b as char).to_digit(16);
        match bytes[i..] {
            [b'%', a, b, ..] if hex(a).is_some() && hex(b).is_some() => {
                out.push((hex(a).unwrap_or(0) * 16 + hex(b).unwrap_or(0)) as u8);
                i += 3;
            }
            [b, ..] => {
                out.push(b);
                i += 1;
            }
            [] => {}
        }
    }
    out
}

/// The file name that a relative address means.
pub fn file_name(uri: &str) -> Cow<'_, str> {
    if uri.contains('%') { Cow::Owned(String::from_utf8_lossy(&percent_decode(uri)).into_owned()) } else { Cow::Borrowed(uri) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_all_lengths() {
        assert_eq!(base64(b""), Some(vec![]));
        assert_eq!(base64(b"AA=="), Some(vec![0]));
        assert_eq!(base64(b"TWE="), Some(b"Ma".to_vec()));
        assert_eq!(base64(b"TWFu"), Some(b"Man".to_vec()));
        assert_eq!(base64(b"TWFuTQ"), Some(b"ManM".to_vec()));
        assert_eq!(base64(b"-_+/"), Some(vec![0xfb, 0xff, 0xbf]));
        assert_eq!(base64(b"A"), None);
        assert_eq!(base64(b"A*AA"), None);
    }

    #[test]
    fn data_uris() {
        assert_eq!(data_uri("data:application/octet-stream;base64,TWFu"), Some(Ok(b"Man".to_vec())));
        assert_eq!(data_uri("data:text/plain,a%20b"), Some(Ok(b"a b".to_vec())));
        assert!(data_uri("data:nothing").is_some_and(|r| r.is_err()));
        assert_eq!(data_uri("a.bin"), None);
        assert_eq!(file_name("a%20b%zz.png"), "a b%zz.png");
    }

    #[test]
    fn glb_chunks() {
        let mut glb = b"glTF\x02\0\0\0\x20\0\0\0\x04\0\0\0JSON{}  ".to_vec();
        glb.extend(b"\x00\0\0\0BIN\0");
        let length = glb.len() as u32;
        glb[8..12].copy_from_slice(&length.to_le_bytes());
        let c = split(&glb).unwrap();
        assert_eq!(c.json, b"{}  ");
        assert_eq!(c.binary, Some(&b""[..]));
        for n in 4..glb.len() {
            assert!(split(&glb[..n]).is_err(), "{n}");
        }
    }
}
