//! Tables of the noise functions, measured from POV-Ray's output by `bench/noise_tables.py` (`docs/decisions/0004-noise-tables.md`).
//!
//! All but one follow from a rule: shuffles and directions drawn with one linear congruential generator. The 267 coefficients are
//! decimal numbers of six digits without a visible rule, so they are listed.

use std::sync::LazyLock;

/// The generator behind the tables: s ← 1812433253 s + 12345 (mod 2³²), which also is that of `rand()` in scene files.
pub(crate) const fn step(s: u32) -> u32 {
    s.wrapping_mul(1_812_433_253).wrapping_add(12_345)
}

/// Numbers of entries of [`HASH`].
pub(crate) const HASH_SIZE: usize = 4096;

/// Permutation of 0 … 4095 that numbers the lattice points of generators 1 and 2: h(x, y, z) = H[H[H[x] ⊕ y] ⊕ z].
pub(crate) static HASH: [u16; HASH_SIZE] = hash();

/// Swaps every entry, last to first, with one drawn by bits 16 to 27 of the generator's state, from state 0 on.
const fn hash() -> [u16; HASH_SIZE] {
    let mut table = [0; HASH_SIZE];
    let mut i = 0;
    while i < HASH_SIZE {
        table[i] = i as u16;
        i += 1;
    }
    let mut state = 0;
    while i > 0 {
        i -= 1;
        state = step(state);
        let j = (state >> 16) as usize % HASH_SIZE;
        let swap = table[i];
        table[i] = table[j];
        table[j] = swap;
    }
    table
}

/// Numbers of entries of the tables of [`Perlin`].
pub(crate) const PERLIN_SIZE: usize = 2048;

/// Tables of generator 3.
pub(crate) struct Perlin {
    /// Numbers lattice points: P[P[x] + y] + z (mod 2048).
    pub(crate) hash: [u16; PERLIN_SIZE],
    /// Unit vectors, the gradients at lattice points.
    pub(crate) gradient: [[f64; 3]; PERLIN_SIZE],
}

/// Tables of generator 3, computed at the first use.
pub(crate) static PERLIN: LazyLock<Box<Perlin>> = LazyLock::new(|| {
    let mut state = 1;
    let mut draw = |modulus: u32| {
        state = step(state);
        (state >> 16) % modulus
    };
    let mut perlin = Box::new(Perlin { hash: [0; PERLIN_SIZE], gradient: [[0.0; 3]; PERLIN_SIZE] });
    for gradient in &mut perlin.gradient {
        // Directions come from points of a cube's grid, of which those outside the ball are rejected.
        *gradient = loop {
            let v = [0; 3].map(|_: i32| f64::from(draw(4096)) - 2048.0);
            let square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
            if square > 0.0 && square <= 2048.0 * 2048.0 {
                break v.map(|c| c / square.sqrt());
            }
        };
    }
    // Only even entries are swapped, and the first of them lies one past the table and holds 0; so 0 occurs twice and 1017 never.
    let mut hash = [0; PERLIN_SIZE + 1];
    for (i, entry) in (0..).zip(&mut hash[..PERLIN_SIZE]) {
        *entry = i;
    }
    for i in (2..=PERLIN_SIZE).rev().step_by(2) {
        hash.swap(i, draw(PERLIN_SIZE as u32) as usize);
    }
    perlin.hash.copy_from_slice(&hash[..PERLIN_SIZE]);
    perlin
});

/// Coefficients of generators 1 and 2. A lattice point with hash h has the value C[h] / 2 and the gradient (C[h+1], C[h+2], C[h+3]);
/// component k of vector noise has the same at h + 4 k.
pub(crate) static COEFFICIENTS: [f64; 267] = coefficients();

const fn coefficients() -> [f64; 267] {
    let mut table = [0.0; 267];
    let mut i = 0;
    while i < table.len() {
        // Exact integers, so the quotient is the number that the decimal digits mean.
        table[i] = HUNDRED_MILLIONTHS[i] as f64 / 1e8;
        i += 1;
    }
    table
}

#[rustfmt::skip]
const HUNDRED_MILLIONTHS: [i32; 267] = [
    -100000000, 60497400, -93710200, 41411500, 57622600, -1615930, 43233400, 10368500, 59053900, 2864120, 46981000, -84622000,
    -7341120, -30409700, -40206000, -21013200, -91912700, 65203300, -83151000, -18394800, -67110700, 85247600, 4359500, -40453200,
    75494000, -33565300, 61843300, 60570700, 70858300, -47719500, 89947400, 49062300, 22172900, -40038100, -85372700, -93258600,
    65911300, 96130300, 32594800, -75085100, 84246600, 73440100, -64986600, 39449100, -46605600, -43407300, 10902600, 8470280,
    -73885700, 24150500, 16228000, -71426000, -88366500, -15040800, -90396000, -68654900, -78521400, 48854800, 2464330, 14247300,
    -60213600, 37584500, -779736, 49895500, -26814700, 85638200, -38600700, -59609400, -86773500, -57097700, -91436600, 28896000,
    67220600, -23378300, 94815000, 89526200, 34325200, -17338800, -76797100, -31474800, 82430800, -34209200, 72143100, -24004000,
    -63653000, 55327700, 37627200, 15898400, -45265900, 39632300, -42067600, -45415400, 12217900, 29585700, 6642250, -20207500,
    -72478800, 45351300, 22456700, -90881200, 17634900, -32051600, -69713900, 74270200, -90078600, 47148900, -13353200, 11912700,
    -88976900, -23183000, -66967300, -4689100, -80343300, -96673500, 47557800, -65264400, 1124590, -73000700, 12828300, 14564700,
    -61931800, 27202300, 39296600, 64641800, -2076750, -31590800, 48079700, 53566800, -25017200, -83093000, -65377300, -44380900,
    11998200, -89764200, 89453000, 16578900, 63387500, -88683900, 93087700, -53719400, 58773200, 72201100, -20946100, -4246590,
    -81426700, -91943200, 28026200, -66302000, -55809900, -53746900, -59877900, 92965600, -17079400, -53716300, 31258100, 95944200,
    72265200, 49993100, 17561600, -53487400, -68511500, 44499900, 17171000, 10820200, -76870400, -46382800, 25423100, 54601400,
    86947400, 87521200, -94442700, 13072400, -11018500, 31218400, -33138000, -62920600, 6065460, 72286600, -9794770, 82156100,
    9312580, -97280800, 3181510, -86703300, -38722800, 28099500, -21818900, -53917800, -42735900, -60207500, 31197100, 27797400,
    77315900, 59249300, -3318840, -63085400, -26994700, 33913200, 58107900, 20946100, -31743300, -28499300, 18132300, 34163400,
    80495900, -22957200, -75890700, -33672100, 60546300, -99127200, -1887540, -30019100, 36830700, -17613500, -38320000, -74956900,
    62356000, -57393800, 27830900, -97131300, 83999400, -83068600, 43907800, 66128000, 69451400, 5650420, 54342000, -43880400,
    -2284280, -68706800, 85726700, 30199100, -49425500, -94103900, 77550900, 41057500, -36208100, -67153400, -34837900, 93243300,
    88644200, 86868100, -22566600, -6221100, -9764250, -64144400, -84811200, 72469700, 47350300, 99874900, 17470100, 55962500,
    -2909900, -33739200, -95812900, -65978500, 23604200, -24693700, 65944900, -2751200, 82189700, -22621500, 1817350, 50048100,
    -42012700, -42787800, 56618600,];

/// Number of outputs of [`TWISTER`]; a feature point takes three from its cell's hash on.
const TWISTER_SIZE: usize = HASH_SIZE + 2;

/// First outputs of the Mersenne Twister (Matsumoto and Nishimura 1998, doi:10.1145/272991.272995) of seed 5489.
pub(crate) static TWISTER: [u32; TWISTER_SIZE] = twister();

const fn twister() -> [u32; TWISTER_SIZE] {
    const N: usize = 624;
    let mut state = [5489_u32; N];
    let mut i = 1;
    while i < N {
        state[i] = (state[i - 1] ^ (state[i - 1] >> 30)).wrapping_mul(1_812_433_253).wrapping_add(i as u32);
        i += 1;
    }
    let mut out = [0; TWISTER_SIZE];
    let mut i = 0;
    while i < TWISTER_SIZE {
        let k = i % N;
        let y = (state[k] & 0x8000_0000) | (state[(k + 1) % N] & 0x7fff_ffff);
        state[k] = state[(k + 397) % N] ^ (y >> 1) ^ (if y & 1 == 1 { 0x9908_b0df } else { 0 });
        let mut y = state[k];
        y ^= y >> 11;
        y ^= (y << 7) & 0x9d2c_5680;
        y ^= (y << 15) & 0xefc6_0000;
        y ^= y >> 18;
        out[i] = y;
        i += 1;
    }
    out
}
