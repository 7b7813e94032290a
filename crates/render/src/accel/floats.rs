//! Vectors of numbers for triangle tests: a row of [`LANES`] triangles for each of one or more rays.
//!
//! Operations round separately and in the order they are written: the same bits in vectors of any length.
#![allow(unsafe_code)]

use super::simd::LANES;

/// Numbers that [`Floats::gather`] reads for each ray.
pub(super) const RECORD: usize = 8;

/// A vector of [`Floats::ROWS`] rows of [`LANES`] numbers.
///
/// # Safety
/// All functions require that the machine has the instruction set of the type; pointers must be valid and aligned for a row.
pub(super) trait Floats: Copy {
    /// Rows; one for each ray that is tested at the same time.
    const ROWS: usize;

    unsafe fn splat(x: f32) -> Self;
    /// The same row again and again.
    unsafe fn load_row(p: *const f32) -> Self;
    /// For each number of a record a vector with rows of that number, one row for each of the first `ROWS` records.
    unsafe fn gather(records: [*const f32; 4]) -> [Self; RECORD];
    unsafe fn store(p: *mut f32, x: Self);
    unsafe fn add(a: Self, b: Self) -> Self;
    unsafe fn sub(a: Self, b: Self) -> Self;
    unsafe fn mul(a: Self, b: Self) -> Self;
    unsafe fn div(a: Self, b: Self) -> Self;
    unsafe fn min(a: Self, b: Self) -> Self;
    unsafe fn max(a: Self, b: Self) -> Self;
    /// A bit for each number where a ≤ b.
    unsafe fn le(a: Self, b: Self) -> u32;
    /// A bit for each number where a < b.
    unsafe fn lt(a: Self, b: Self) -> u32;
}

#[inline(always)]
fn map2(a: [f32; LANES], b: [f32; LANES], f: impl Fn(f32, f32) -> f32) -> [f32; LANES] {
    std::array::from_fn(|i| f(a[i], b[i]))
}

#[inline(always)]
fn mask2(a: [f32; LANES], b: [f32; LANES], f: impl Fn(f32, f32) -> bool) -> u32 {
    (0..LANES).fold(0, |m, i| m | u32::from(f(a[i], b[i])) << i)
}

// SAFETY of the implementations: only pointers and instruction sets matter, and callers vouch for them.
impl Floats for [f32; LANES] {
    const ROWS: usize = 1;

    #[inline(always)]
    unsafe fn splat(x: f32) -> Self {
        [x; LANES]
    }
    #[inline(always)]
    unsafe fn load_row(p: *const f32) -> Self {
        unsafe { p.cast::<Self>().read() }
    }
    #[inline(always)]
    unsafe fn gather(records: [*const f32; 4]) -> [Self; RECORD] {
        std::array::from_fn(|i| [unsafe { *records[0].add(i) }; LANES])
    }
    #[inline(always)]
    unsafe fn store(p: *mut f32, x: Self) {
        unsafe { p.cast::<Self>().write(x) }
    }
    #[inline(always)]
    unsafe fn add(a: Self, b: Self) -> Self {
        map2(a, b, |a, b| a + b)
    }
    #[inline(always)]
    unsafe fn sub(a: Self, b: Self) -> Self {
        map2(a, b, |a, b| a - b)
    }
    #[inline(always)]
    unsafe fn mul(a: Self, b: Self) -> Self {
        map2(a, b, |a, b| a * b)
    }
    #[inline(always)]
    unsafe fn div(a: Self, b: Self) -> Self {
        map2(a, b, |a, b| a / b)
    }
    #[inline(always)]
    unsafe fn min(a: Self, b: Self) -> Self {
        map2(a, b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    unsafe fn max(a: Self, b: Self) -> Self {
        map2(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    unsafe fn le(a: Self, b: Self) -> u32 {
        mask2(a, b, |a, b| a <= b)
    }
    #[inline(always)]
    unsafe fn lt(a: Self, b: Self) -> u32 {
        mask2(a, b, |a, b| a < b)
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Floats, RECORD};
    use std::arch::x86_64::*;

    /// What differs only in the names of instructions.
    macro_rules! arithmetic {
        ($splat:ident, $store:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $min:ident, $max:ident) => {
            #[inline(always)]
            unsafe fn splat(x: f32) -> Self {
                unsafe { $splat(x) }
            }
            #[inline(always)]
            unsafe fn store(p: *mut f32, x: Self) {
                unsafe { $store(p, x) }
            }
            #[inline(always)]
            unsafe fn add(a: Self, b: Self) -> Self {
                unsafe { $add(a, b) }
            }
            #[inline(always)]
            unsafe fn sub(a: Self, b: Self) -> Self {
                unsafe { $sub(a, b) }
            }
            #[inline(always)]
            unsafe fn mul(a: Self, b: Self) -> Self {
                unsafe { $mul(a, b) }
            }
            #[inline(always)]
            unsafe fn div(a: Self, b: Self) -> Self {
                unsafe { $div(a, b) }
            }
            #[inline(always)]
            unsafe fn min(a: Self, b: Self) -> Self {
                unsafe { $min(a, b) }
            }
            #[inline(always)]
            unsafe fn max(a: Self, b: Self) -> Self {
                unsafe { $max(a, b) }
            }
        };
    }

    /// Comparisons by the mask of signs, for vectors without mask registers.
    macro_rules! comparisons {
        ($cmp:ident, $movemask:ident) => {
            #[inline(always)]
            unsafe fn le(a: Self, b: Self) -> u32 {
                unsafe { $movemask($cmp::<_CMP_LE_OQ>(a, b)) as u32 }
            }
            #[inline(always)]
            unsafe fn lt(a: Self, b: Self) -> u32 {
                unsafe { $movemask($cmp::<_CMP_LT_OQ>(a, b)) as u32 }
            }
        };
    }

    impl Floats for __m128 {
        const ROWS: usize = 1;
        arithmetic!(_mm_set1_ps, _mm_storeu_ps, _mm_add_ps, _mm_sub_ps, _mm_mul_ps, _mm_div_ps, _mm_min_ps, _mm_max_ps);
        comparisons!(_mm_cmp_ps, _mm_movemask_ps);

        #[inline(always)]
        unsafe fn load_row(p: *const f32) -> Self {
            unsafe { _mm_load_ps(p) }
        }
        #[inline(always)]
        unsafe fn gather(records: [*const f32; 4]) -> [Self; RECORD] {
            std::array::from_fn(|i| unsafe { _mm_set1_ps(*records[0].add(i)) })
        }
    }

    /// AVX2: two rays.
    impl Floats for __m256 {
        const ROWS: usize = 2;
        arithmetic!(
            _mm256_set1_ps,
            _mm256_storeu_ps,
            _mm256_add_ps,
            _mm256_sub_ps,
            _mm256_mul_ps,
            _mm256_div_ps,
            _mm256_min_ps,
            _mm256_max_ps
        );
        comparisons!(_mm256_cmp_ps, _mm256_movemask_ps);

        #[inline(always)]
        unsafe fn load_row(p: *const f32) -> Self {
            unsafe { _mm256_broadcast_ps(&*p.cast()) }
        }
        #[inline(always)]
        unsafe fn gather(records: [*const f32; 4]) -> [Self; RECORD] {
            unsafe {
                let (a, b) = (_mm256_loadu_ps(records[0]), _mm256_loadu_ps(records[1]));
                let (lo, hi) = (_mm256_permute2f128_ps::<0x20>(a, b), _mm256_permute2f128_ps::<0x31>(a, b));
                let (k0, k1, k2, k3) = (
                    _mm256_permute_ps::<0x00>(lo),
                    _mm256_permute_ps::<0x55>(lo),
                    _mm256_permute_ps::<0xaa>(lo),
                    _mm256_permute_ps::<0xff>(lo),
                );
                let (k4, k5, k6, k7) = (
                    _mm256_permute_ps::<0x00>(hi),
                    _mm256_permute_ps::<0x55>(hi),
                    _mm256_permute_ps::<0xaa>(hi),
                    _mm256_permute_ps::<0xff>(hi),
                );
                [k0, k1, k2, k3, k4, k5, k6, k7]
            }
        }
    }

    /// AVX-512 F: four rays.
    impl Floats for __m512 {
        const ROWS: usize = 4;
        arithmetic!(
            _mm512_set1_ps,
            _mm512_storeu_ps,
            _mm512_add_ps,
            _mm512_sub_ps,
            _mm512_mul_ps,
            _mm512_div_ps,
            _mm512_min_ps,
            _mm512_max_ps
        );

        #[inline(always)]
        unsafe fn load_row(p: *const f32) -> Self {
            unsafe { _mm512_broadcast_f32x4(_mm_load_ps(p)) }
        }
        #[inline(always)]
        unsafe fn gather(records: [*const f32; 4]) -> [Self; RECORD] {
            unsafe {
                let pair = |a: *const f32, b: *const f32| {
                    let (a, b) = (_mm256_loadu_pd(a.cast()), _mm256_loadu_pd(b.cast()));
                    _mm512_castpd_ps(_mm512_insertf64x4::<1>(_mm512_castpd256_pd512(a), b))
                };
                let (ab, cd) = (pair(records[0], records[1]), pair(records[2], records[3]));
                let first = _mm512_setr_epi32(0, 0, 0, 0, 8, 8, 8, 8, 16, 16, 16, 16, 24, 24, 24, 24);
                std::array::from_fn(|i| {
                    let places = _mm512_add_epi32(first, _mm512_set1_epi32(i as i32));
                    _mm512_permutex2var_ps(ab, places, cd)
                })
            }
        }
        #[inline(always)]
        unsafe fn le(a: Self, b: Self) -> u32 {
            unsafe { u32::from(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b)) }
        }
        #[inline(always)]
        unsafe fn lt(a: Self, b: Self) -> u32 {
            unsafe { u32::from(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b)) }
        }
    }
}
