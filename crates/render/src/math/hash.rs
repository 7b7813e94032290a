//! Integer hashes: the source of everything that looks random.

/// Mixes 64 bits (the finalizer of SplitMix64; Steele, Lea, Flood 2014, doi:10.1145/2660193.2660195).
#[inline]
pub fn mix64(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Mixes 32 bits (the "lowbias32" hash of Chris Wellons, public domain).
#[inline]
pub fn mix32(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// A hash of several words; the order matters.
#[inline]
pub fn hash_words<const N: usize>(words: [u64; N]) -> u64 {
    let mut h = 0x9e37_79b9_7f4a_7c15;
    for w in words {
        h = mix64(h ^ w).wrapping_add(0x9e37_79b9_7f4a_7c15);
    }
    mix64(h)
}

/// A float in [0, 1) from the top 24 bits of a word.
#[inline]
pub fn unit_float(x: u32) -> f32 {
    (x >> 8) as f32 * (1.0 / 16_777_216.0)
}
