//! Chunks of Blosc 1, in which OpenVDB packs values: blocks of LZ4 or zlib streams over bytes that were sorted by their significance.
//!
//! A chunk is a header of 16 bytes (version, version of the codec, flags, size of a value, then sizes of the content, of a block and of
//! the chunk), the offsets of the blocks, and the blocks. A block is one stream, or one for each byte of a value; a stream has its length
//! before it and is not packed where that is the length of its content.

use std::io::Read;

/// Bits of the flags: bytes sorted, content not packed, bits sorted, blocks are one stream each. The codec is above them.
const SHUFFLED: u8 = 1;
const COPIED: u8 = 2;
const BIT_SHUFFLED: u8 = 4;
const ONE_STREAM: u8 = 16;
/// Blocks of fewer values, or of larger ones, are one stream in any case.
const LEAST_VALUES: usize = 128;
const LARGEST_VALUE: usize = 16;

/// Unpacks a chunk whose content has so many bytes.
///
/// # Errors
/// A sentence.
pub(super) fn unpack(chunk: &[u8], size: usize) -> Result<Vec<u8>, String> {
    let broken = || "a Blosc chunk is broken".to_owned();
    let int = |at: usize| {
        let bytes = at.checked_add(4).and_then(|end| chunk.get(at..end)).and_then(|b| b.try_into().ok());
        bytes.map(u32::from_le_bytes).map(|v| v as usize).ok_or_else(broken)
    };
    let (flags, value_size) = (*chunk.get(2).ok_or_else(broken)?, usize::from(*chunk.get(3).ok_or_else(broken)?));
    let (content, block_size) = (int(4)?, int(8)?);
    if content != size {
        return Err(format!("a Blosc chunk holds {content} bytes instead of {size}"));
    }
    if size == 0 {
        return Ok(Vec::new());
    }
    if flags & COPIED != 0 {
        return chunk.get(16..16 + size).map(<[u8]>::to_vec).ok_or_else(broken);
    }
    if flags & BIT_SHUFFLED != 0 {
        return Err("a Blosc chunk with sorted bits, which OpenVDB does not write".to_owned());
    }
    if block_size == 0 || value_size == 0 {
        return Err(broken());
    }
    let mut out = Vec::with_capacity(size);
    for block in 0..size.div_ceil(block_size) {
        let length = block_size.min(size - block * block_size);
        let mut at = int(16 + 4 * block)?;
        let is_last = length < block_size;
        let is_split = flags & ONE_STREAM == 0 && value_size <= LARGEST_VALUE && length / value_size >= LEAST_VALUES && !is_last;
        let streams = if is_split { value_size } else { 1 };
        if !length.is_multiple_of(streams) {
            return Err(broken());
        }
        let mut bytes = Vec::with_capacity(length);
        for _ in 0..streams {
            let packed = int(at)?;
            let start = at.checked_add(4).ok_or_else(broken)?;
            at = start.checked_add(packed).ok_or_else(broken)?;
            let stream = chunk.get(start..at).ok_or_else(broken)?;
            add_stream(stream, flags >> 5, length / streams, &mut bytes)?;
        }
        if flags & SHUFFLED != 0 && value_size > 1 { unshuffle(&bytes, value_size, &mut out) } else { out.extend_from_slice(&bytes) }
    }
    Ok(out)
}

/// Appends the content, of a known length, of a stream.
fn add_stream(stream: &[u8], codec: u8, length: usize, out: &mut Vec<u8>) -> Result<(), String> {
    if stream.len() == length {
        out.extend_from_slice(stream);
        return Ok(());
    }
    let start = out.len();
    out.resize(start + length, 0);
    let content = &mut out[start..];
    let unpacked = match codec {
        1 => lz4_flex::block::decompress_into(stream, content).map_err(|e| e.to_string())?,
        3 => {
            flate2::read::ZlibDecoder::new(stream).read_exact(content).map_err(|e| e.to_string())?;
            length
        }
        _ => {
            let name = ["BloscLZ", "", "Snappy", "", "Zstandard"].get(usize::from(codec)).copied().unwrap_or("an unknown codec");
            return Err(format!("a Blosc chunk packed by {name}; OpenVDB writes LZ4"));
        }
    };
    if unpacked == length { Ok(()) } else { Err(format!("a Blosc stream holds {unpacked} bytes instead of {length}")) }
}

/// Appends values whose first bytes come first, then the second ones, and so on; what does not fill a value is at the end as it was.
fn unshuffle(bytes: &[u8], value_size: usize, out: &mut Vec<u8>) {
    let values = bytes.len() / value_size;
    for i in 0..values {
        out.extend((0..value_size).map(|k| bytes[k * values + i]));
    }
    out.extend_from_slice(&bytes[values * value_size..]);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chunk of one block as OpenVDB has it made: a stream for each of the four bytes of a value.
    fn chunk(values: &[f32]) -> Vec<u8> {
        let size = 4 * values.len();
        let mut out = vec![2, 1, SHUFFLED | 1 << 5, 4];
        for v in [size, size, 0] {
            out.extend((v as u32).to_le_bytes());
        }
        out.extend(20u32.to_le_bytes());
        for k in 0..4 {
            let plane: Vec<u8> = values.iter().map(|v| v.to_le_bytes()[k]).collect();
            let packed = lz4_flex::block::compress(&plane);
            let stream = if packed.len() < plane.len() { packed } else { plane };
            out.extend((stream.len() as u32).to_le_bytes());
            out.extend(stream);
        }
        out
    }

    #[test]
    fn values_come_back() {
        let values: Vec<f32> = (0..512).map(|i| (i / 7) as f32 * 0.37).collect();
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(unpack(&chunk(&values), 2048).unwrap(), bytes);
        let mut copied = vec![2, 1, COPIED, 4, 3, 0, 0, 0, 3, 0, 0, 0, 19, 0, 0, 0, 7, 8, 9];
        assert_eq!(unpack(&copied, 3).unwrap(), [7, 8, 9]);
        copied.pop();
        assert!(unpack(&copied, 3).is_err());
        copied[2] = 4 << 5;
        copied.extend([0; 8]);
        assert!(unpack(&copied, 3).is_err());
    }

    #[test]
    fn broken_chunks_are_refused() {
        let good = chunk(&[0.5; 256]);
        for n in 0..good.len() {
            assert!(unpack(&good[..n], 1024).is_err(), "{n}");
        }
        for i in 0..good.len() {
            for flip in [1, 0x80, 0xff] {
                let mut bytes = good.clone();
                bytes[i] ^= flip;
                let _ = unpack(&bytes, 1024);
            }
        }
    }
}
