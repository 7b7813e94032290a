//! The filters of EXT_meshopt_compression and KHR_meshopt_compression (appendix B).

use super::meshopt::Filter;

/// Undoes a filter in place; `stride` fits the filter.
pub fn apply(data: &mut [u8], stride: usize, filter: Filter) {
    match filter {
        Filter::None => {}
        Filter::Exponential => data.chunks_exact_mut(4).for_each(exponential),
        Filter::Quaternion => each_i16(data, quaternion),
        Filter::Octahedral if stride == 4 => each_i8(data, |v| octahedral(v, 127.0)),
        Filter::Octahedral => each_i16(data, |v| octahedral(v, 32767.0)),
        Filter::Color if stride == 4 => {
            for e in data.chunks_exact_mut(4) {
                let v = color([i32::from(e[0]), i32::from(e[1] as i8), i32::from(e[2] as i8), i32::from(e[3])], 255.0);
                e.copy_from_slice(&v.map(|x| x as u8));
            }
        }
        Filter::Color => {
            for e in data.chunks_exact_mut(8) {
                let u = |k: usize| u16::from_le_bytes([e[2 * k], e[2 * k + 1]]);
                let v = color([i32::from(u(0)), i32::from(u(1) as i16), i32::from(u(2) as i16), i32::from(u(3))], 65535.0);
                for (o, x) in e.chunks_exact_mut(2).zip(v) {
                    o.copy_from_slice(&(x as u16).to_le_bytes());
                }
            }
        }
    }
}

fn each_i8(data: &mut [u8], f: impl Fn([i32; 4]) -> [i32; 4]) {
    for e in data.chunks_exact_mut(4) {
        let v = f([e[0], e[1], e[2], e[3]].map(|b| i32::from(b as i8)));
        e.copy_from_slice(&v.map(|x| x as u8));
    }
}

fn each_i16(data: &mut [u8], f: impl Fn([i32; 4]) -> [i32; 4]) {
    for e in data.chunks_exact_mut(8) {
        let v = f(std::array::from_fn(|k| i32::from(i16::from_le_bytes([e[2 * k], e[2 * k + 1]]))));
        for (o, x) in e.chunks_exact_mut(2).zip(v) {
            o.copy_from_slice(&(x as u16).to_le_bytes());
        }
    }
}

/// Two octahedral coordinates and their unit become a unit vector; the fourth number passes.
fn octahedral(v: [i32; 4], max: f32) -> [i32; 4] {
    let one = v[2] as f32;
    let (mut x, mut y) = (v[0] as f32 / one, v[1] as f32 / one);
    let z = 1.0 - x.abs() - y.abs();
    let t = z.min(0.0);
    x -= t.copysign(x);
    y -= t.copysign(y);
    // NaN of a broken element becomes 0 in the conversion.
    let scale = max / (x * x + y * y + z * z).sqrt();
    let round = |c: f32| (c * scale).round().clamp(-max, max) as i32;
    [round(x), round(y), round(z), v[3]]
}

/// Three components of a unit quaternion, scaled by √2, and the number of the largest, which is left out.
fn quaternion(v: [i32; 4]) -> [i32; 4] {
    let scale = std::f32::consts::FRAC_1_SQRT_2 / (v[3] | 3) as f32;
    let [x, y, z] = [v[0], v[1], v[2]].map(|c| c as f32 * scale);
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    let largest = (v[3] & 3) as usize;
    let mut out = [0; 4];
    for (k, c) in [w, x, y, z].into_iter().enumerate() {
        out[(largest + k) % 4] = (c * 32767.0).round().clamp(-32767.0, 32767.0) as i32;
    }
    out
}

/// A signed mantissa of 24 bits and a signed exponent of 8 bits.
fn exponential(e: &mut [u8]) {
    let v = i32::from_le_bytes([e[0], e[1], e[2], e[3]]);
    let (exponent, mantissa) = ((v >> 24).clamp(-100, 100), (v << 8) >> 8);
    let power = f32::from_bits(((exponent + 127) as u32) << 23);
    e.copy_from_slice(&(power * mantissa as f32).to_le_bytes());
}

/// Y, Co, Cg and alpha; the highest bit of alpha tells the number of bits.
fn color([y, co, cg, a]: [i32; 4], max: f32) -> [i32; 4] {
    let bits = 32 - (a.max(1) as u32).leading_zeros();
    let all = (1i32 << bits) - 1;
    let scale = max / all as f32;
    let alpha = a & (all >> 1);
    let alpha = alpha << 1 | alpha & 1;
    [y + co - cg, y + cg, y - co - cg, alpha].map(|c| (c as f32 * scale).round().clamp(0.0, max) as i32)
}
