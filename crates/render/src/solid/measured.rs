//! Tests against tables that POV-Ray 3.7.0.10 measured: `scripts/measure_solids.py` says how.

use glam::DVec3;

use super::{Crossing, Line, Primitive};

/// What a comparison allows.
pub struct Tolerance {
    /// Distance along the line.
    pub t: f64,
    /// Distance of unit normals.
    pub n: f64,
    /// Lines whose number of crossings may differ: POV-Ray misses some.
    pub lines: usize,
    /// Whether normals may point the other way.
    pub any_side: bool,
}

impl Default for Tolerance {
    fn default() -> Self {
        Self { t: 1e-5, n: 1e-4, lines: 0, any_side: false }
    }
}

/// All crossings of a line, ascending.
pub fn crossings(shape: &dyn Primitive, line: &Line, t_min: f64, t_max: f64) -> Vec<Crossing> {
    let mut out = Vec::new();
    shape.crossings(line, t_min, t_max, &mut out);
    out.sort_by(|a, b| a.t.total_cmp(&b.t));
    out
}

/// Compares a shape with a table.
pub fn compare(shape: &dyn Primitive, table: &str, tolerance: &Tolerance) {
    let mut faults = Vec::new();
    let mut counts = Vec::new();
    for (number, row) in table.lines().enumerate() {
        let mut words = row.split_whitespace();
        let kind = words.next();
        let v: Vec<f64> = words.map(|w| w.parse().unwrap()).collect();
        if kind == Some("I") {
            let p = DVec3::new(v[0], v[1], v[2]);
            if shape.inside(p) != (v[3] > 0.5) {
                faults.push(format!("row {}: inside of {p}", number + 1));
            }
            continue;
        }
        let line = Line { o: DVec3::new(v[0], v[1], v[2]), d: DVec3::new(v[3], v[4], v[5]) };
        let found = crossings(shape, &line, 1e-4, 1e4);
        let bounds = shape.bounds();
        for c in &found {
            let p = line.at(c.t);
            if !(p.cmpge(bounds.min - 1e-6).all() && p.cmple(bounds.max + 1e-6).all()) {
                faults.push(format!("row {}: {p} beyond the bounds {bounds:?}", number + 1));
            }
        }
        let hits = &v[6..];
        // POV-Ray was asked again this far behind each hit.
        let mut last = f64::NEG_INFINITY;
        let apart = found
            .iter()
            .filter(|c| {
                c.t > last + 2e-3 && {
                    last = c.t;
                    true
                }
            })
            .count();
        if apart != hits.len() / 4 && hits.len() / 4 < 8 {
            counts.push(format!(
                "row {}: {:?}, not {:?}",
                number + 1,
                found.iter().map(|c| c.t).collect::<Vec<_>>(),
                hits.chunks(4).map(|h| h[0]).collect::<Vec<_>>()
            ));
        }
        for hit in hits.chunks_exact(4) {
            let n = DVec3::new(hit[1], hit[2], hit[3]);
            let Some(c) = found.iter().min_by(|a, b| (a.t - hit[0]).abs().total_cmp(&(b.t - hit[0]).abs())) else {
                faults.push(format!("row {}: no hit at {}", number + 1, hit[0]));
                continue;
            };
            let m = shape.normal(line.at(c.t), c);
            let off = if tolerance.any_side { (m - n).length().min((m + n).length()) } else { (m - n).length() };
            if !((c.t - hit[0]).abs() < tolerance.t) || !(off < tolerance.n) {
                faults.push(format!("row {}: t {} not {}, normal {m} not {n} (part {})", number + 1, c.t, hit[0], c.part));
            }
        }
    }
    if counts.len() > tolerance.lines {
        faults.extend(counts);
    }
    let head = table.lines().next().unwrap_or_default();
    assert!(faults.is_empty(), "{head}\n{}", faults.join("\n"));
}

/// A linear congruential generator (Knuth, MMIX) in [0, 1).
pub fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*state >> 11) as f64 / (1u64 << 53) as f64
}

/// Random lines through a ball: inside and outside must alternate at the crossings. `allowed` lines may fail.
pub fn alternates(shape: &dyn Primitive, center: DVec3, radius: f64, lines: usize, allowed: usize) {
    let mut s = 99;
    let mut point = || center + radius * (DVec3::new(random(&mut s), random(&mut s), random(&mut s)) * 2.0 - 1.0);
    let mut faults = Vec::new();
    let mut total = 0;
    for _ in 0..lines {
        let (a, b) = (point(), point());
        let line = Line { o: a, d: b - a };
        let found = crossings(shape, &line, 0.0, 1.0);
        total += found.len();
        let mut state = shape.inside(a);
        let mut from = 0.0;
        for to in found.iter().map(|c| c.t).chain([1.0]) {
            if to - from > 1e-5 {
                let mid = shape.inside(line.at(0.5 * (from + to)));
                if mid != state {
                    faults.push(format!("{line:?}: {mid} between {from} and {to}"));
                    break;
                }
            }
            state = !state;
            from = to;
        }
    }
    assert!(total > lines / 20, "only {total} crossings");
    assert!(faults.len() <= allowed, "{} of {lines} lines\n{}", faults.len(), faults[..faults.len().min(12)].join("\n"));
}

/// Lines of no sense: no panic, and no crossing that is not a number.
pub fn hostile_lines(shape: &dyn Primitive) {
    let values = [0.0, 1.0, -0.3, 1e-300, 1e300, f64::INFINITY, f64::NAN];
    let mut s = 5;
    let mut pick = || values[(random(&mut s) * values.len() as f64) as usize];
    for _ in 0..400 {
        let line = Line { o: DVec3::new(pick(), pick(), pick()), d: DVec3::new(pick(), pick(), pick()) };
        for c in crossings(shape, &line, 0.0, pick()) {
            assert!(c.t.is_finite(), "{line:?} {c:?}");
            let _ = (shape.normal(line.at(c.t), &c), shape.uv(line.at(c.t), &c));
        }
        let _ = shape.inside(line.o);
    }
}
