//! Deterministic mutation of the seed corpus: no reader may panic, hang or reserve more memory than a file can justify.
//!
//! `ETENDUE_FUZZ_ROUNDS=1000000` runs longer. The same entry points have cargo-fuzz targets under `fuzz/`; this runs everywhere, in seconds.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod support;

use std::path::Path;
use std::time::{Duration, Instant};

use etendue_scene::desc::MeshFormat;
use etendue_scene::formats::{ReadOptions, mesh, mitsuba, pbrt, pov};
use support::corpus;

/// SplitMix64 (Steele, Lea, Flood 2014, doi:10.1145/2660193.2660195).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

const WORDS: &[&[u8]] = &[
    b"4294967295",
    b"-1",
    b"1e39",
    b"nan",
    b"inf",
    b"99999999999999999999",
    b"\xff\xff\xff\xff",
    b"\0\0\0\0",
    b"\x7f\xff\xff\xff",
    b"$",
    b"<",
    b">",
    b"\"",
    b"&",
    b"/",
    b"\n",
    b" ",
    b"element vertex 4294967295\n",
    b"property list uchar int vertex_indices\n",
    b"f 1 2 3\n",
    b"f -1 -1 -1\n",
    b"<ref id=\"a\"/>",
    b"]]>",
    b"<!--",
    b"<include filename=\"x.xml\"/>",
    b"0:0,0:0",
    b"AttributeBegin\n",
    b"Include \"a\"\n",
    b"[",
    b"#while(1) ",
    b"#macro M(A) ",
    b"#end ",
    b"M(M(1))",
    b"array[9999999]",
    b"{",
    b"}",
    b"#declare A=",
    b"0/0",
    b"1e300",
];

fn mutate(random: &mut Random, seeds: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = seeds[random.below(seeds.len())].1.clone();
    for _ in 0..=random.below(6) {
        if bytes.is_empty() {
            return bytes;
        }
        let at = random.below(bytes.len());
        match random.below(7) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = random.next() as u8,
            2 => bytes.truncate(at),
            3 => {
                let end = (at + random.below(64)).min(bytes.len());
                bytes.drain(at..end);
            }
            4 => {
                let end = (at + random.below(64)).min(bytes.len());
                let part = bytes[at..end].to_vec();
                let to = random.below(bytes.len());
                bytes.splice(to..to, part);
            }
            5 => {
                let word = WORDS[random.below(WORDS.len())];
                bytes.splice(at..at, word.iter().copied());
            }
            _ => {
                let word = WORDS[random.below(WORDS.len())];
                let end = (at + word.len()).min(bytes.len());
                bytes.splice(at..end, word.iter().copied());
            }
        }
    }
    bytes
}

fn fuzz(kind: &str, seed: u64, rounds: usize, run: impl Fn(&[u8])) {
    let seeds = corpus(kind);
    for (_, bytes) in &seeds {
        // Cut everywhere.
        for n in 0..bytes.len().min(2000) {
            run(&bytes[..n]);
        }
        run(bytes);
    }
    let rounds = std::env::var("ETENDUE_FUZZ_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(rounds);
    let mut random = Random(seed);
    for _ in 0..rounds {
        let bytes = mutate(&mut random, &seeds);
        let start = Instant::now();
        run(&bytes);
        assert!(start.elapsed() < Duration::from_secs(2), "slow: {:?}", String::from_utf8_lossy(&bytes));
    }
}

#[test]
fn mitsuba() {
    fuzz("mitsuba", 1, 4000, |bytes| {
        let _ = mitsuba::read_bytes(Path::new("fuzz.xml"), bytes, &ReadOptions::default());
    });
}

#[test]
fn pbrt_scenes() {
    fuzz("pbrt", 3, 4000, |bytes| {
        let _ = pbrt::read_bytes(Path::new("fuzz.pbrt"), bytes, &ReadOptions::default());
    });
}

#[test]
fn pov_scenes() {
    fuzz("pov", 4, 2000, |bytes| {
        let mut options = ReadOptions::default();
        options.pov.work_limit = 100_000;
        let _ = pov::read_bytes(Path::new("fuzz.pov"), bytes, &options);
    });
}

fn fuzz_mesh(kind: &str, format: MeshFormat) {
    fuzz(kind, 2, 6000, |bytes| {
        let Ok(parsed) = mesh::parse(bytes, format, 0) else { return };
        let n = parsed.data.positions.len();
        assert!(parsed.data.triangles.iter().flatten().all(|i| (*i as usize) < n));
        assert!(parsed.data.normals.is_empty() || parsed.data.normals.len() == n);
        assert!(parsed.data.uvs.is_empty() || parsed.data.uvs.len() == n);
    });
}

#[test]
fn ply() {
    fuzz_mesh("ply", MeshFormat::Ply);
}

#[test]
fn obj() {
    fuzz_mesh("obj", MeshFormat::Obj);
}

#[test]
fn stl() {
    fuzz_mesh("stl", MeshFormat::Stl);
}

#[test]
fn serialized() {
    fuzz_mesh("serialized", MeshFormat::MitsubaSerialized);
}
