//! Decoder of EXT_meshopt_compression and KHR_meshopt_compression, after the extensions' published bitstream specification
//! (appendices A and B). Every read is checked: a hostile stream ends in an error.

/// What is compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Elements of any kind.
    Attributes,
    /// Indices of a list of triangles.
    Triangles,
    /// Other indices.
    Indices,
}

/// What is done to attributes after decoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// Nothing.
    None,
    /// Unit vectors from octahedral coordinates.
    Octahedral,
    /// Unit quaternions from three components.
    Quaternion,
    /// Floats from mantissa and exponent.
    Exponential,
    /// Colors from YCoCg.
    Color,
}

const CUT_OFF: &str = "the compressed data ends too early";
const LEFT_OVER: &str = "the compressed data is longer than what it holds";

/// Decodes `count` elements of `stride` bytes.
///
/// # Errors
/// What is wrong with the stream or its parameters.
pub fn decode(data: &[u8], count: usize, stride: usize, mode: Mode, filter: Filter) -> Result<Vec<u8>, &'static str> {
    let stride_fits = match (mode, filter) {
        (Mode::Attributes, Filter::None | Filter::Exponential) => stride.is_multiple_of(4) && (4..=256).contains(&stride),
        (Mode::Attributes, Filter::Octahedral | Filter::Color) => stride == 4 || stride == 8,
        (Mode::Attributes, Filter::Quaternion) => stride == 8,
        (_, Filter::None) => stride == 2 || stride == 4,
        _ => return Err("only attributes may have a filter"),
    };
    if !stride_fits {
        return Err("byteStride does not fit mode and filter");
    }
    match mode {
        Mode::Attributes => {
            let mut out = attributes(data, count, stride)?;
            super::meshopt_filter::apply(&mut out, stride, filter);
            Ok(out)
        }
        Mode::Triangles if !count.is_multiple_of(3) => Err("count must be a multiple of 3 for triangles"),
        Mode::Triangles => Ok(index_bytes(&triangles(data, count / 3)?, stride)),
        Mode::Indices => Ok(index_bytes(&indices(data, count)?, stride)),
    }
}

fn index_bytes(indices: &[u32], stride: usize) -> Vec<u8> {
    match stride {
        2 => indices.iter().flat_map(|&i| (i as u16).to_le_bytes()).collect(),
        _ => indices.iter().flat_map(|&i| i.to_le_bytes()).collect(),
    }
}

/// Bytes that are read from front to back.
struct Stream<'a> {
    rest: &'a [u8],
}

impl<'a> Stream<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], &'static str> {
        let (head, rest) = self.rest.split_at_checked(n).ok_or(CUT_OFF)?;
        self.rest = rest;
        Ok(head)
    }

    fn byte(&mut self) -> Result<u8, &'static str> {
        Ok(self.take(1)?[0])
    }

    /// Unsigned LEB128 of at most five bytes.
    fn varint(&mut self) -> Result<u32, &'static str> {
        let mut value = 0u32;
        for shift in (0..35).step_by(7) {
            let b = self.byte()?;
            value |= u32::from(b & 0x7F) << shift;
            if b < 0x80 {
                return Ok(value);
            }
        }
        Err("a number of more than five bytes in the compressed data")
    }

    fn finish(&self) -> Result<(), &'static str> {
        if self.rest.is_empty() { Ok(()) } else { Err(LEFT_OVER) }
    }
}

fn zigzag32(v: u32) -> u32 {
    (v >> 1) ^ 0u32.wrapping_sub(v & 1)
}

/// How one byte position of a block is stored: the bit widths that a group's two header bits choose from.
const WIDTHS_V0: [u32; 4] = [0, 2, 4, 8];
const WIDTHS_V1: [[u32; 4]; 2] = [[0, 1, 2, 4], [1, 2, 4, 8]];

fn attributes(data: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, &'static str> {
    let version = match data.first() {
        Some(0xA0) => 0,
        Some(0xA1) => 1,
        _ => return Err("the compressed attributes have an unknown header"),
    };
    let channels = if version == 1 { stride / 4 } else { 0 };
    let tail = (stride + channels).max(if version == 1 { 24 } else { 32 });
    let body_end = data.len().checked_sub(tail).filter(|&e| e >= 1).ok_or(CUT_OFF)?;
    let mut stream = Stream { rest: &data[1..body_end] };
    let baseline_at = data.len() - stride - channels;
    let mut last = data[baseline_at..baseline_at + stride].to_vec();
    let modes = &data[baseline_at + stride..];

    let block_limit = ((8192 / stride) & !15).min(256);
    let mut out = Vec::new();
    // Not more than a stream of this length can hold is reserved at once: 256 elements need at least a byte.
    out.try_reserve(count.saturating_mul(stride).min(data.len().saturating_mul(256 * 4))).map_err(|_| "too large")?;
    let mut deltas = vec![[0u8; 256]; stride];
    let mut rest = count;
    while rest > 0 {
        let n = rest.min(block_limit);
        let control = stream.take(channels)?;
        for (k, bytes) in deltas.iter_mut().enumerate() {
            match control.get(k / 4).map(|c| c >> (2 * (k % 4)) & 3) {
                None => groups(&mut stream, n, &WIDTHS_V0, bytes)?,
                Some(2) => bytes[..n].fill(0),
                Some(3) => bytes[..n].copy_from_slice(stream.take(n)?),
                Some(c) => groups(&mut stream, n, &WIDTHS_V1[usize::from(c)], bytes)?,
            }
        }
        let start = out.len();
        out.resize(start + n * stride, 0);
        for k in (0..stride).step_by(4) {
            let mode = modes.get(k / 4).copied().unwrap_or(0);
            let previous = [last[k], last[k + 1], last[k + 2], last[k + 3]];
            let channel = [&deltas[k], &deltas[k + 1], &deltas[k + 2], &deltas[k + 3]];
            let end = undo_deltas(mode, previous, channel, n, &mut out[start..], stride, k)?;
            last[k..k + 4].copy_from_slice(&end);
        }
        rest -= n;
    }
    stream.finish()?;
    Ok(out)
}

/// Reads the deltas of one byte position: groups of 16, each with its own number of bits.
fn groups(stream: &mut Stream<'_>, n: usize, widths: &[u32; 4], out: &mut [u8; 256]) -> Result<(), &'static str> {
    let count = n.div_ceil(16);
    let header = stream.take(count.div_ceil(4))?;
    for (g, group) in out.chunks_exact_mut(16).take(count).enumerate() {
        let bits = widths[usize::from(header[g / 4] >> (2 * (g % 4)) & 3)];
        match bits {
            0 => group.fill(0),
            8 => group.copy_from_slice(stream.take(16)?),
            _ => {
                let packed = stream.take(2 * bits as usize)?;
                let sentinel = ((1u32 << bits) - 1) as u8;
                let per_byte = 8 / bits as usize;
                for (i, d) in group.iter_mut().enumerate() {
                    let place = (i % per_byte) as u32 * bits;
                    // Single bits stand in the byte from the lowest up, wider deltas from the highest down.
                    let shift = if bits == 1 { place } else { 8 - bits - place };
                    *d = packed[i / per_byte] >> shift & sentinel;
                    if *d == sentinel {
                        *d = stream.byte()?;
                    }
                }
            }
        }
    }
    Ok(())
}

/// Sums up the deltas of a channel (four byte positions) and writes the elements; returns the last element's bytes.
fn undo_deltas(
    mode: u8,
    previous: [u8; 4],
    deltas: [&[u8; 256]; 4],
    n: usize,
    out: &mut [u8],
    stride: usize,
    at: usize,
) -> Result<[u8; 4], &'static str> {
    let zigzag8 = |v: u8| (v >> 1) ^ 0u8.wrapping_sub(v & 1);
    let zigzag16 = |v: u16| (v >> 1) ^ 0u16.wrapping_sub(v & 1);
    let mut p = previous;
    for i in 0..n {
        let d = deltas.map(|d| d[i]);
        p = match (mode & 15, mode >> 4) {
            (0, 0) => std::array::from_fn(|k| p[k].wrapping_add(zigzag8(d[k]))),
            (1, 0) => {
                let half = |a: usize| {
                    let delta = zigzag16(u16::from_le_bytes([d[a], d[a + 1]]));
                    u16::from_le_bytes([p[a], p[a + 1]]).wrapping_add(delta).to_le_bytes()
                };
                let (low, high) = (half(0), half(2));
                [low[0], low[1], high[0], high[1]]
            }
            // Encoders rotate to the left, so this rotates to the right; the specification leaves the sense open.
            (2, r) => (u32::from_le_bytes(p) ^ u32::from_le_bytes(d).rotate_right(u32::from(r))).to_le_bytes(),
            _ => return Err("an unknown channel mode in the compressed data"),
        };
        out[i * stride + at..][..4].copy_from_slice(&p);
    }
    Ok(p)
}

/// The last 16 of what was pushed; reading what was never pushed is an error.
struct Fifo<T> {
    items: [T; 16],
    pushed: usize,
}

impl<T: Copy + Default> Fifo<T> {
    fn new() -> Self {
        Self { items: [T::default(); 16], pushed: 0 }
    }

    fn push(&mut self, item: T) {
        self.items[self.pushed % 16] = item;
        self.pushed += 1;
    }

    /// The item `back` pushes before the last one.
    fn get(&self, back: usize) -> Result<T, &'static str> {
        let i = self.pushed.checked_sub(back + 1).ok_or("the compressed indices refer to what was not there yet")?;
        Ok(self.items[i % 16])
    }
}

fn triangles(data: &[u8], count: usize) -> Result<Vec<u32>, &'static str> {
    // Version 0 differs in that it has no codes for the neighbors of the last index.
    let neighbors = match data.first() {
        Some(0xE1) => true,
        Some(0xE0) => false,
        _ => return Err("the compressed triangles have an unknown header"),
    };
    let body_end = data.len().checked_sub(16).filter(|&e| e >= 1).ok_or(CUT_OFF)?;
    let table = &data[body_end..];
    let mut stream = Stream { rest: &data[1..body_end] };
    let codes = stream.take(count)?;
    let mut edges = Fifo::<(u32, u32)>::new();
    let mut vertices = Fifo::<u32>::new();
    let (mut next, mut last) = (0u32, 0u32);
    let mut out = Vec::with_capacity(3 * count);
    let explicit = |stream: &mut Stream<'_>, last: &mut u32| {
        *last = last.wrapping_add(zigzag32(stream.varint()?));
        Ok::<u32, &'static str>(*last)
    };
    let fresh = |next: &mut u32| {
        *next = next.wrapping_add(1);
        next.wrapping_sub(1)
    };
    for &code in codes {
        let (high, low) = (usize::from(code >> 4), usize::from(code & 15));
        if high < 15 {
            let (a, b) = edges.get(high)?;
            let c = match low {
                0 => fresh(&mut next),
                13 | 14 if neighbors => {
                    last = if low == 13 { last.wrapping_sub(1) } else { last.wrapping_add(1) };
                    last
                }
                15 => explicit(&mut stream, &mut last)?,
                _ => vertices.get(low)?,
            };
            if low == 0 || low == 15 || (neighbors && low > 12) {
                vertices.push(c);
            }
            edges.push((c, b));
            edges.push((a, c));
            out.extend([a, b, c]);
            continue;
        }
        let pair = if low < 14 { table[low] } else { stream.byte()? };
        if low >= 14 && pair == 0 {
            next = 0;
        }
        let (z, w) = (usize::from(pair >> 4), usize::from(pair & 15));
        if low < 14 && (z == 15 || w == 15) {
            return Err("the compressed triangles have an invalid table");
        }
        let a = if low == 15 { None } else { Some(fresh(&mut next)) };
        // New vertices are numbered before explicit ones are read; FIFO entries count from before this triangle.
        let mut plain = |k: usize| match k {
            0 => Ok(Some(fresh(&mut next))),
            15 => Ok(None),
            k => vertices.get(k - 1).map(Some),
        };
        let (b, c) = (plain(z)?, plain(w)?);
        let a = match a {
            Some(a) => a,
            None => explicit(&mut stream, &mut last)?,
        };
        let b = match b {
            Some(b) => b,
            None => explicit(&mut stream, &mut last)?,
        };
        let c = match c {
            Some(c) => c,
            None => explicit(&mut stream, &mut last)?,
        };
        vertices.push(a);
        if z == 0 || z == 15 {
            vertices.push(b);
        }
        if w == 0 || w == 15 {
            vertices.push(c);
        }
        edges.push((b, a));
        edges.push((c, b));
        edges.push((a, c));
        out.extend([a, b, c]);
    }
    stream.finish()?;
    Ok(out)
}

fn indices(data: &[u8], count: usize) -> Result<Vec<u32>, &'static str> {
    if !matches!(data.first(), Some(0xD0 | 0xD1)) {
        return Err("the compressed indices have an unknown header");
    }
    let body_end = data.len().checked_sub(4).filter(|&e| e >= 1).ok_or(CUT_OFF)?;
    let mut stream = Stream { rest: &data[1..body_end] };
    if count > stream.rest.len() {
        return Err(CUT_OFF);
    }
    let mut last = [0u32; 2];
    let mut out = Vec::with_capacity(count);
    for _ in 0..count {
        let v = stream.varint()?;
        let baseline = &mut last[(v & 1) as usize];
        *baseline = baseline.wrapping_add(zigzag32(v >> 1));
        out.push(*baseline);
    }
    stream.finish()?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(hex: &str) -> Vec<u8> {
        hex.as_bytes().chunks(2).map(|c| u8::from_str_radix(std::str::from_utf8(c).unwrap(), 16).unwrap()).collect()
    }

    /// Mode, filter, byteStride, count, encoded and decoded bytes, made with the reference encoder and decoder (meshoptimizer 1.x).
    fn vectors() -> impl Iterator<Item = (Mode, Filter, usize, usize, Vec<u8>, Vec<u8>)> {
        include_str!("meshopt_vectors.txt").lines().map(|line| {
            let f: Vec<&str> = line.split(' ').collect();
            let mode = match f[0] {
                "attributes" => Mode::Attributes,
                "triangles" => Mode::Triangles,
                _ => Mode::Indices,
            };
            let filter = match f[1] {
                "octahedral" => Filter::Octahedral,
                "quaternion" => Filter::Quaternion,
                "exponential" => Filter::Exponential,
                "color" => Filter::Color,
                _ => Filter::None,
            };
            (mode, filter, f[2].parse().unwrap(), f[3].parse().unwrap(), bytes(f[4]), bytes(f[5]))
        })
    }

    #[test]
    fn decodes_what_the_reference_encodes() {
        let mut count = 0;
        for (mode, filter, stride, n, encoded, decoded) in vectors() {
            assert_eq!(decode(&encoded, n, stride, mode, filter).as_deref(), Ok(&decoded[..]), "{mode:?} {filter:?} {stride}");
            count += 1;
        }
        assert_eq!(count, 17);
    }

    #[test]
    fn cut_and_changed_streams_end_in_errors_or_other_bytes() {
        let mut state = 1u32;
        for (mode, filter, stride, n, encoded, decoded) in vectors() {
            for cut in 0..encoded.len() {
                assert!(decode(&encoded[..cut], n, stride, mode, filter).is_err());
            }
            for _ in 0..2000 {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let mut changed = encoded.clone();
                let at = (state >> 8) as usize % changed.len();
                changed[at] ^= (state >> 3) as u8 | 1;
                if let Ok(out) = decode(&changed, n, stride, mode, filter) {
                    assert_eq!(out.len(), decoded.len());
                }
            }
            assert!(decode(&encoded, usize::MAX / stride / 3 * 3, stride, mode, filter).is_err());
        }
    }
}
