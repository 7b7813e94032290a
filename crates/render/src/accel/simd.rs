//! The vector operations that traversal needs, for each instruction set.
//!
//! [`Isa`] is a closed list of operations; `traverse` is generic over it and is compiled once for each instruction set
//! behind a `#[target_feature]` function, into which everything here is inlined. Box tests may differ in their last bit
//! between instruction sets ([`Isa::mul_add`] is fused where the machine can do it), because they are only ever
//! conservative. Operations of triangle tests ([`Floats`]) never fuse: they give the same bits everywhere.
#![allow(unsafe_code)]

use super::floats::Floats;

/// Triangles in a leaf block.
pub(super) const LANES: usize = 4;
/// Children of a node.
pub(super) const WIDTH: usize = 8;

/// The instruction sets that traversal is compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IsaKind {
    /// Plain Rust; compiled for what the target has at least.
    Portable,
    /// x86-64 with AVX2 and FMA.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// x86-64 with AVX-512 F and VL (256-bit vectors: eight children fill no more).
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl IsaKind {
    /// The fastest one that this machine has.
    pub fn detect() -> Self {
        *Self::available().last().unwrap_or(&Self::Portable)
    }

    /// All that this machine has, slowest first.
    pub fn available() -> Vec<Self> {
        #[allow(unused_mut)]
        let mut found = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = std::is_x86_feature_detected!("avx2")
                && std::is_x86_feature_detected!("fma")
                && std::is_x86_feature_detected!("bmi1")
                && std::is_x86_feature_detected!("popcnt");
            if avx2 {
                found.push(Self::Avx2);
            }
            if avx2 && std::is_x86_feature_detected!("avx512f") && std::is_x86_feature_detected!("avx512vl") {
                found.push(Self::Avx512);
            }
        }
        found
    }
}

/// Vector operations of one instruction set.
///
/// # Safety
/// All functions require that the machine has the instruction set; pointers must be valid for the lanes they stand for.
pub(super) trait Isa: Copy {
    /// Eight numbers: one for each child of a node.
    type F: Copy;
    /// One number for each triangle of a block.
    type B: Floats;
    /// Several such rows, for as many rays.
    type W: Floats;

    unsafe fn splat(x: f32) -> Self::F;
    unsafe fn load(p: *const f32) -> Self::F;
    /// a b + c, fused or not.
    unsafe fn mul_add(a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// Minimum for numbers, not NaN, where all that matters of a negative result is that it is negative: the order of
    /// bits as integers does, which is faster than comparing numbers.
    unsafe fn min(a: Self::F, b: Self::F) -> Self::F;
    /// Maximum, with the same proviso.
    unsafe fn max(a: Self::F, b: Self::F) -> Self::F;
    /// A bit for each lane where a ≤ b, for a not negative.
    unsafe fn le(a: Self::F, b: Self::F) -> u32;
    /// Writes the children in `mask` (at least two bits) in the order of falling distance to `keys` and `children`, for
    /// which eight lanes must be writable, and returns the lane of the nearest, the last one written. Distances are not
    /// negative. A key is the distance with its three low bits replaced by the lane.
    unsafe fn push_sorted(near: Self::F, mask: u32, refs: *const u32, keys: *mut i32, children: *mut u32) -> usize;
    /// Writes the children in `mask` to `children`, for which eight lanes must be writable.
    unsafe fn push(mask: u32, refs: *const u32, children: *mut u32);

    /// As [`Isa::le`]; where it holds, `least` becomes the smaller of itself and a, which is not negative.
    unsafe fn le_min(a: Self::F, b: Self::F, least: &mut Self::F) -> u32;
    /// Writes those of `ids` whose byte in `masks` has the bit `lane`, in their order, and returns how many they are.
    /// Up to sixteen words beyond `ids` and the result and bytes beyond `masks` must be valid, the bytes zero.
    unsafe fn pack(masks: *const u8, ids: *const u32, count: usize, lane: u32, out: *mut u32) -> usize;

    /// Asks for the cache line at an address, which need not be valid.
    #[inline(always)]
    unsafe fn prefetch(_p: *const u8) {}

    /// A row of four numbers.
    unsafe fn row(a: f32, b: f32, c: f32, d: f32) -> Self::B;
}

/// Plain Rust, in loops that the compiler can turn into vectors.
#[derive(Clone, Copy)]
pub(super) struct Portable;

#[inline(always)]
fn map2<const N: usize>(a: [f32; N], b: [f32; N], f: impl Fn(f32, f32) -> f32) -> [f32; N] {
    std::array::from_fn(|i| f(a[i], b[i]))
}

#[inline(always)]
fn mask2<const N: usize>(a: [f32; N], b: [f32; N], f: impl Fn(f32, f32) -> bool) -> u32 {
    (0..N).fold(0, |m, i| m | u32::from(f(a[i], b[i])) << i)
}

// SAFETY of the implementation: only the pointers matter, and callers vouch for them.
impl Isa for Portable {
    type F = [f32; WIDTH];
    type B = [f32; LANES];
    type W = [f32; LANES];

    #[inline(always)]
    unsafe fn splat(x: f32) -> Self::F {
        [x; WIDTH]
    }
    #[inline(always)]
    unsafe fn load(p: *const f32) -> Self::F {
        unsafe { p.cast::<Self::F>().read() }
    }
    #[inline(always)]
    unsafe fn mul_add(a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        std::array::from_fn(|i| a[i] * b[i] + c[i])
    }
    #[inline(always)]
    unsafe fn min(a: Self::F, b: Self::F) -> Self::F {
        map2(a, b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    unsafe fn max(a: Self::F, b: Self::F) -> Self::F {
        map2(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    unsafe fn le(a: Self::F, b: Self::F) -> u32 {
        mask2(a, b, |a, b| a <= b)
    }
    #[inline(always)]
    unsafe fn push_sorted(near: Self::F, mask: u32, refs: *const u32, keys: *mut i32, children: *mut u32) -> usize {
        let mut sorted = [0i32; WIDTH];
        let mut n = 0;
        let mut m = mask;
        while m != 0 {
            let lane = m.trailing_zeros() as usize;
            m &= m - 1;
            let key = (near[lane].to_bits() as i32 & !7) | lane as i32;
            let mut i = n;
            while i > 0 && sorted[i - 1] < key {
                sorted[i] = sorted[i - 1];
                i -= 1;
            }
            sorted[i] = key;
            n += 1;
        }
        for (i, &key) in sorted[..n].iter().enumerate() {
            unsafe {
                *keys.add(i) = key;
                *children.add(i) = *refs.add((key & 7) as usize);
            }
        }
        (sorted[n - 1] & 7) as usize
    }
    #[inline(always)]
    unsafe fn push(mask: u32, refs: *const u32, children: *mut u32) {
        let mut m = mask;
        let mut i = 0;
        while m != 0 {
            unsafe { *children.add(i) = *refs.add(m.trailing_zeros() as usize) };
            m &= m - 1;
            i += 1;
        }
    }
    #[inline(always)]
    unsafe fn le_min(a: Self::F, b: Self::F, least: &mut Self::F) -> u32 {
        *least = std::array::from_fn(|i| if a[i] <= b[i] && a[i] < least[i] { a[i] } else { least[i] });
        mask2(a, b, |a, b| a <= b)
    }
    #[inline(always)]
    unsafe fn pack(masks: *const u8, ids: *const u32, count: usize, lane: u32, out: *mut u32) -> usize {
        let mut n = 0;
        for i in 0..count {
            unsafe {
                *out.add(n) = *ids.add(i);
                n += usize::from(*masks.add(i) >> lane & 1);
            }
        }
        n
    }

    #[inline(always)]
    unsafe fn row(a: f32, b: f32, c: f32, d: f32) -> Self::B {
        [a, b, c, d]
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Isa, WIDTH};
    use std::arch::x86_64::*;

    /// AVX2 with FMA.
    #[derive(Clone, Copy)]
    pub(in super::super) struct Avx2;
    /// AVX-512 F and VL in 256-bit vectors.
    #[derive(Clone, Copy)]
    pub(in super::super) struct Avx512;

    /// For each mask the numbers of its bits, packed to the front, one byte each.
    static LANES_OF_MASK: [u64; 256] = {
        let mut table = [0; 256];
        let mut mask = 0;
        while mask < 256 {
            let (mut lane, mut at) = (0, 0);
            while lane < WIDTH as u64 {
                if mask >> lane & 1 == 1 {
                    table[mask] |= lane << (8 * at);
                    at += 1;
                }
                lane += 1;
            }
            mask += 1;
        }
        table
    };

    /// Sorts eight signed keys, largest first: a bitonic network (Batcher 1968), six stages of compare and exchange.
    #[inline(always)]
    unsafe fn sort_falling(k: __m256i) -> __m256i {
        // In each stage `p` holds the partner of each lane; lanes with a set bit in the blend mask keep the smaller one.
        unsafe {
            let p = _mm256_shuffle_epi32::<0b10_11_00_01>(k);
            let k = _mm256_blend_epi32::<0b0110_0110>(_mm256_max_epi32(k, p), _mm256_min_epi32(k, p));
            let p = _mm256_shuffle_epi32::<0b01_00_11_10>(k);
            let k = _mm256_blend_epi32::<0b0011_1100>(_mm256_max_epi32(k, p), _mm256_min_epi32(k, p));
            let p = _mm256_shuffle_epi32::<0b10_11_00_01>(k);
            let k = _mm256_blend_epi32::<0b0101_1010>(_mm256_max_epi32(k, p), _mm256_min_epi32(k, p));
            let p = _mm256_permute2x128_si256::<1>(k, k);
            let k = _mm256_blend_epi32::<0b1111_0000>(_mm256_max_epi32(k, p), _mm256_min_epi32(k, p));
            let p = _mm256_shuffle_epi32::<0b01_00_11_10>(k);
            let k = _mm256_blend_epi32::<0b1100_1100>(_mm256_max_epi32(k, p), _mm256_min_epi32(k, p));
            let p = _mm256_shuffle_epi32::<0b10_11_00_01>(k);
            _mm256_blend_epi32::<0b1010_1010>(_mm256_max_epi32(k, p), _mm256_min_epi32(k, p))
        }
    }

    /// The lane of the smallest key among those seen as unsigned numbers.
    #[inline(always)]
    unsafe fn nearest_lane(k: __m256i) -> usize {
        unsafe {
            let m = _mm_min_epu32(_mm256_castsi256_si128(k), _mm256_extracti128_si256::<1>(k));
            let m = _mm_min_epu32(m, _mm_shuffle_epi32::<0b01_00_11_10>(m));
            let m = _mm_min_epu32(m, _mm_shuffle_epi32::<0b10_11_00_01>(m));
            (_mm_cvtsi128_si32(m) & 7) as usize
        }
    }

    macro_rules! common {
        () => {
            type F = __m256;
            type B = __m128;

            #[inline(always)]
            unsafe fn splat(x: f32) -> __m256 {
                unsafe { _mm256_set1_ps(x) }
            }
            #[inline(always)]
            unsafe fn load(p: *const f32) -> __m256 {
                unsafe { _mm256_load_ps(p) }
            }
            #[inline(always)]
            unsafe fn mul_add(a: __m256, b: __m256, c: __m256) -> __m256 {
                unsafe { _mm256_fmadd_ps(a, b, c) }
            }
            #[inline(always)]
            unsafe fn min(a: __m256, b: __m256) -> __m256 {
                unsafe {
                    let m = _mm256_min_epi32(_mm256_castps_si256(a), _mm256_castps_si256(b));
                    _mm256_castsi256_ps(m)
                }
            }
            #[inline(always)]
            unsafe fn max(a: __m256, b: __m256) -> __m256 {
                unsafe {
                    let m = _mm256_max_epi32(_mm256_castps_si256(a), _mm256_castps_si256(b));
                    _mm256_castsi256_ps(m)
                }
            }
            #[inline(always)]
            unsafe fn prefetch(p: *const u8) {
                unsafe { _mm_prefetch::<_MM_HINT_T0>(p.cast()) }
            }
            #[inline(always)]
            unsafe fn row(a: f32, b: f32, c: f32, d: f32) -> __m128 {
                unsafe { _mm_setr_ps(a, b, c, d) }
            }
        };
    }

    // SAFETY of both implementations: callers vouch for the instruction set and for the pointers.
    impl Isa for Avx2 {
        type W = __m256;
        common!();

        #[inline(always)]
        unsafe fn le(a: __m256, b: __m256) -> u32 {
            unsafe {
                let gt = _mm256_cmpgt_epi32(_mm256_castps_si256(a), _mm256_castps_si256(b));
                !(_mm256_movemask_ps(_mm256_castsi256_ps(gt)) as u32) & 0xff
            }
        }
        #[inline(always)]
        unsafe fn push_sorted(near: __m256, mask: u32, refs: *const u32, keys: *mut i32, children: *mut u32) -> usize {
            unsafe {
                let lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
                let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
                let hit = _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(mask as i32), bits), bits);
                let k = _mm256_or_si256(_mm256_and_si256(_mm256_castps_si256(near), _mm256_set1_epi32(!7)), lanes);
                // Misses become -1: the largest unsigned and the smallest signed number.
                let k = _mm256_or_si256(k, _mm256_xor_si256(hit, _mm256_set1_epi32(-1)));
                let nearest = nearest_lane(k);
                let k = sort_falling(k);
                let r = _mm256_permutevar8x32_epi32(_mm256_load_si256(refs.cast()), k);
                _mm256_storeu_si256(keys.cast(), k);
                _mm256_storeu_si256(children.cast(), r);
                nearest
            }
        }
        #[inline(always)]
        unsafe fn push(mask: u32, refs: *const u32, children: *mut u32) {
            unsafe {
                let order = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(LANES_OF_MASK[(mask & 255) as usize] as i64));
                _mm256_storeu_si256(children.cast(), _mm256_permutevar8x32_epi32(_mm256_load_si256(refs.cast()), order));
            }
        }
        #[inline(always)]
        unsafe fn le_min(a: __m256, b: __m256, least: &mut __m256) -> u32 {
            unsafe {
                let gt = _mm256_castsi256_ps(_mm256_cmpgt_epi32(_mm256_castps_si256(a), _mm256_castps_si256(b)));
                *least = Self::min(*least, _mm256_blendv_ps(a, *least, gt));
                !(_mm256_movemask_ps(gt) as u32) & 0xff
            }
        }
        #[inline(always)]
        unsafe fn pack(masks: *const u8, ids: *const u32, count: usize, lane: u32, out: *mut u32) -> usize {
            let mut n = 0;
            for i in (0..count).step_by(8) {
                unsafe {
                    let m =
                        _mm_cmpeq_epi8(_mm_and_si128(_mm_loadl_epi64(masks.add(i).cast()), _mm_set1_epi8(1 << lane)), _mm_setzero_si128());
                    let k = !_mm_movemask_epi8(m) as usize & 0xff;
                    let order = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(LANES_OF_MASK[k] as i64));
                    let packed = _mm256_permutevar8x32_epi32(_mm256_loadu_si256(ids.add(i).cast()), order);
                    _mm256_storeu_si256(out.add(n).cast(), packed);
                    n += k.count_ones() as usize;
                }
            }
            n
        }
    }

    impl Isa for Avx512 {
        type W = __m512;
        common!();

        #[inline(always)]
        unsafe fn le(a: __m256, b: __m256) -> u32 {
            unsafe { u32::from(_mm256_cmple_epi32_mask(_mm256_castps_si256(a), _mm256_castps_si256(b))) }
        }
        #[inline(always)]
        unsafe fn push_sorted(near: __m256, mask: u32, refs: *const u32, keys: *mut i32, children: *mut u32) -> usize {
            unsafe {
                let lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
                // (near & !7) | lane in one operation.
                let k = _mm256_ternarylogic_epi32::<0xf4>(lanes, _mm256_castps_si256(near), _mm256_set1_epi32(7));
                let k = _mm256_mask_mov_epi32(_mm256_set1_epi32(-1), mask as __mmask8, k);
                let nearest = nearest_lane(k);
                let k = sort_falling(k);
                let r = _mm256_permutevar8x32_epi32(_mm256_load_si256(refs.cast()), k);
                _mm256_storeu_si256(keys.cast(), k);
                _mm256_storeu_si256(children.cast(), r);
                nearest
            }
        }
        #[inline(always)]
        unsafe fn push(mask: u32, refs: *const u32, children: *mut u32) {
            unsafe {
                let r = _mm256_maskz_compress_epi32(mask as __mmask8, _mm256_load_si256(refs.cast()));
                _mm256_storeu_si256(children.cast(), r);
            }
        }
        #[inline(always)]
        unsafe fn le_min(a: __m256, b: __m256, least: &mut __m256) -> u32 {
            unsafe {
                let mask = _mm256_cmple_epi32_mask(_mm256_castps_si256(a), _mm256_castps_si256(b));
                let l = _mm256_castps_si256(*least);
                *least = _mm256_castsi256_ps(_mm256_mask_min_epi32(l, mask, l, _mm256_castps_si256(a)));
                u32::from(mask)
            }
        }
        #[inline(always)]
        unsafe fn pack(masks: *const u8, ids: *const u32, count: usize, lane: u32, out: *mut u32) -> usize {
            let mut n = 0;
            for i in (0..count).step_by(16) {
                unsafe {
                    let m = _mm512_cvtepu8_epi32(_mm_loadu_si128(masks.add(i).cast()));
                    let k = _mm512_test_epi32_mask(m, _mm512_set1_epi32(1 << lane));
                    let packed = _mm512_maskz_compress_epi32(k, _mm512_loadu_si512(ids.add(i).cast()));
                    _mm512_storeu_si512(out.add(n).cast(), packed);
                    n += k.count_ones() as usize;
                }
            }
            n
        }
    }
}
