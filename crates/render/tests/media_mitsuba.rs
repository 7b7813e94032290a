//! Media scenes against Mitsuba 3.9's `volpath`: one file, the same means.
//!
//! The numbers are printed by `data/media/mitsuba_means.py 2048 16` (Mitsuba 3.9.1, scalar_rgb): means and standard errors of the
//! quadrants of each picture, from 16 runs of 2048 samples a pixel.
//!
//! The volume of the smoke is turned by a right angle: turned by any other, it ends in Mitsuba at the axis-parallel box around it, with its
//! outermost values repeated up to there, and here at its own box.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use std::path::Path;

use etendue_scene::RenderSettings;
use etendue_scene::formats::{ReadOptions, read};
use support::statistics::{Blocks, assert_same};
use support::*;

/// Mean and standard error of a quadrant.
type Quadrant = ([f64; 3], [f64; 3]);

fn check(name: &str, mitsuba: &[Quadrant; 4], spp: u32, most_noise: f64) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/media").join(format!("{name}.xml"));
    let desc = read(&path, &ReadOptions::default()).unwrap();
    assert!(desc.report.losses.is_empty(), "{:?}", desc.report.losses);
    let films: Vec<_> = (0..4).map(|seed| render(&desc, &RenderSettings { seed, ..settings(8, 8, spp) })).collect();
    let ours = Blocks::new(&films, 4);
    let mut theirs = ours.clone();
    for (i, (mean, error)) in mitsuba.iter().enumerate() {
        theirs.mean[i] = *mean;
        theirs.variance[i] = error.map(|e| e * e);
    }
    // Their ray offsets and reflections differ in the last digits.
    assert_same(name, &ours, &theirs, 2e-3, most_noise);
}

#[test]
fn colored_fog_under_a_lamp() {
    let mitsuba = [
        ([0.10062, 0.03977, 0.05004], [0.00095, 0.00015, 0.00023]),
        ([0.08332, 0.03256, 0.04238], [0.00134, 0.00010, 0.00017]),
        ([0.11163, 0.10604, 0.17967], [0.00068, 0.00028, 0.00068]),
        ([0.08375, 0.07995, 0.14958], [0.00067, 0.00024, 0.00058]),
    ];
    check("fog", &mitsuba, 256, 0.06);
}

#[test]
fn smoke_of_a_grid_under_sky_and_point_light() {
    let mitsuba = [
        ([0.36764, 0.34299, 0.34092], [0.00021, 0.00009, 0.00016]),
        ([0.37018, 0.33481, 0.32488], [0.00019, 0.00016, 0.00020]),
        ([0.28780, 0.32414, 0.36215], [0.00007, 0.00008, 0.00015]),
        ([0.28854, 0.32244, 0.35852], [0.00010, 0.00012, 0.00018]),
    ];
    check("smoke", &mitsuba, 256, 0.06);
}

#[test]
fn milk_in_glass_in_haze() {
    let mitsuba = [
        ([0.35142, 0.48562, 0.62995], [0.00068, 0.00060, 0.00135]),
        ([0.35424, 0.48939, 0.63869], [0.00095, 0.00049, 0.00108]),
        ([0.35152, 0.48543, 0.62845], [0.00078, 0.00057, 0.00165]),
        ([0.35889, 0.48691, 0.63206], [0.00728, 0.00062, 0.00128]),
    ];
    check("glass", &mitsuba, 256, 0.06);
}
