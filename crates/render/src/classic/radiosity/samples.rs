//! Irradiance at scattered points, and where each may be used.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use etendue_procedural::fns;
use glam::DVec3;

/// Most points of a level.
const POINT_LIMIT: usize = 2_000_000;
/// Largest rotation, as the root of 1 − cos, between a place and a point of the same pixel that stands in for it: 24°.
const SAME_FACE: f64 = 0.3;

/// Irradiance at a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    pub(super) p: DVec3,
    pub(super) n: DVec3,
    /// Irradiance over π.
    pub(super) color: DVec3,
    /// Distance at which the error is 1: the harmonic mean distance to what is around, within limits.
    pub(super) radius: f64,
    /// Width of a pixel of the picture here.
    pub(super) pixel: f64,
}

impl Point {
    /// Ward's error of using the point at another place (1988, eq. 4 without its constant); infinite where the place sees what the point
    /// does not, and where distance alone makes it greater than the bound.
    fn error(&self, p: DVec3, n: DVec3, bound: f64) -> f64 {
        let d = p - self.p;
        let reach = bound * self.radius;
        if d.length_squared() > reach * reach {
            return f64::INFINITY;
        }
        // What lies behind the place sees other things than the point does.
        if d.dot(n + self.n) < -0.05 * self.radius {
            return f64::INFINITY;
        }
        d.length() / self.radius + self.rotation(n)
    }

    fn rotation(&self, n: DVec3) -> f64 {
        (1.0 - n.dot(self.n)).max(0.0).sqrt()
    }
}

/// What several points say of a place.
#[derive(Clone, Copy, Default)]
pub(super) struct Mean {
    weight: f64,
    color: DVec3,
    pub(super) count: u32,
}

impl Mean {
    /// A point with an error below the bound.
    pub(super) fn add(&mut self, point: &Point, error: f64, bound: f64) {
        let w = 1.0 - error / bound;
        let weight = w * w / error.max(1e-3);
        self.weight += weight;
        self.color += point.color * weight;
        self.count += 1;
    }

    /// Adds what other points say.
    pub(super) fn merge(&mut self, other: &Self) {
        self.weight += other.weight;
        self.color += other.color;
        self.count += other.count;
    }

    /// The mean; `None` where nothing counts.
    pub(super) fn color(&self) -> Option<DVec3> {
        (self.weight > 0.0).then(|| self.color / self.weight)
    }
}

/// Keys are hashes already.
#[derive(Default)]
struct Plain(u64);

impl Hasher for Plain {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        for &b in bytes {
            self.0 = self.0.rotate_left(8) ^ u64::from(b);
        }
    }

    fn write_u64(&mut self, key: u64) {
        self.0 = key;
    }
}

/// Points of one recursion level. Each is listed in the cells, up to 27 and as large as its reach, that it reaches; so a place looks into
/// one cell of each size only.
#[derive(Default)]
pub(super) struct Level {
    points: Vec<Point>,
    cells: HashMap<u64, Vec<u32>, BuildHasherDefault<Plain>>,
    /// Sizes of cells in use.
    sizes: Vec<i32>,
    sum: DVec3,
}

impl Level {
    /// Adds a point that is wanted for errors below a bound and throughout its pixel.
    pub(super) fn insert(&mut self, point: Point, bound: f64) {
        let reach = (point.radius * bound).max(1.5 * point.pixel);
        let sane = reach > 0.0 && reach.is_finite() && point.radius > 0.0 && point.p.is_finite() && point.color.is_finite();
        if self.points.len() >= POINT_LIMIT || !sane {
            return;
        }
        // The next power of two above the reach.
        let size = (fns::log2(reach).clamp(-60.0, 60.0) + 1.0).floor() as i32;
        let (a, b) = (cell(point.p - reach, size), cell(point.p + reach, size));
        for x in a[0]..=b[0].min(a[0] + 2) {
            for y in a[1]..=b[1].min(a[1] + 2) {
                for z in a[2]..=b[2].min(a[2] + 2) {
                    self.cells.entry(key([x, y, z], size)).or_default().push(self.points.len() as u32);
                }
            }
        }
        self.sum += point.color;
        self.points.push(point);
        if let Err(at) = self.sizes.binary_search(&size) {
            self.sizes.insert(at, size);
        }
    }

    fn visit(&self, p: DVec3, mut visit: impl FnMut(&Point)) {
        for &size in &self.sizes {
            for &i in self.cells.get(&key(cell(p, size), size)).into_iter().flatten() {
                visit(&self.points[i as usize]);
            }
        }
    }

    /// What the points with errors below the bound say of a place.
    pub(super) fn mean(&self, p: DVec3, n: DVec3, bound: f64) -> Mean {
        let mut mean = Mean::default();
        self.visit(p, |point| {
            let error = point.error(p, n, bound);
            if error < bound {
                mean.add(point, error, bound);
            }
        });
        mean
    }

    /// What points within a pixel and those with errors below twice the bound say of a place.
    pub(super) fn loose_mean(&self, p: DVec3, n: DVec3, bound: f64) -> Mean {
        let mut mean = Mean::default();
        self.visit(p, |point| {
            let wide = point.error(p, n, 2.0 * bound) / (2.0 * bound);
            let near = (p - point.p).length() / (1.5 * point.pixel) + point.rotation(n) / SAME_FACE;
            let error = wide.min(near);
            if error < 1.0 {
                mean.add(point, error, 1.0);
            }
        });
        mean
    }

    /// The points in the order of their insertion.
    pub(super) fn into_points(self) -> Vec<Point> {
        self.points
    }

    /// The mean of all points; black without any.
    pub(super) fn average(&self) -> DVec3 {
        self.sum / (self.points.len() as f64).max(1.0)
    }
}

fn cell(p: DVec3, size: i32) -> [i32; 3] {
    let q = p * fns::exp2(f64::from(-size));
    let index = |v: f64| v.floor().clamp(-1e9, 1e9) as i32;
    [index(q.x), index(q.y), index(q.z)]
}

/// A hash of a cell. Where two cells share one, each lists the other's points, which are then too far away to count.
fn key(cell: [i32; 3], size: i32) -> u64 {
    let [x, y, z] = cell.map(|v| v as u32 as u64);
    let mut h = (x | y << 32).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (z | (size as u32 as u64) << 32).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    h = (h ^ h >> 32).wrapping_mul(0xd6e8_feb8_6659_fd93);
    h ^ h >> 32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(p: DVec3, radius: f64) -> Point {
        Point { p, n: DVec3::Z, color: DVec3::splat(p.x), radius, pixel: 0.0 }
    }

    #[test]
    fn cells_find_every_point_that_reaches() {
        let mut level = Level::default();
        let place = |i: u32| {
            let u = |k: u64| (key([i as i32, 7, 9], 3).rotate_left(16 * k as u32) & 0xffff) as f64 / 65536.0;
            DVec3::new(u(0), u(1), u(2)) * 10.0 - 5.0
        };
        let points: Vec<Point> = (0..400).map(|i| point(place(i), 0.03 * f64::from(i % 50 + 1))).collect();
        for p in &points {
            level.insert(*p, 1.0);
        }
        let mut total = 0;
        for k in 1000..1400 {
            let p = place(k);
            let mut found = Vec::new();
            level.visit(p, |q| found.extend(((q.p - p).length() < q.radius).then_some(q.p.x)));
            let mut all: Vec<f64> = points.iter().filter(|q| (q.p - p).length() < q.radius).map(|q| q.p.x).collect();
            found.sort_by(f64::total_cmp);
            all.sort_by(f64::total_cmp);
            assert_eq!(found, all, "at {p}");
            total += all.len();
        }
        assert!(total > 300, "{total}");
    }

    #[test]
    fn error_grows_with_distance_and_angle() {
        let q = point(DVec3::ZERO, 2.0);
        assert!((q.error(DVec3::X, DVec3::Z, 9.0) - 0.5).abs() < 1e-12);
        assert!(q.error(DVec3::X, DVec3::new(0.6, 0.0, 0.8), 9.0) > 0.9);
        assert_eq!(q.error(DVec3::new(0.0, 0.0, -1.0), DVec3::Z, 9.0), f64::INFINITY);
    }

    #[test]
    fn hostile_points_are_dropped() {
        let mut level = Level::default();
        for bad in [f64::NAN, f64::INFINITY, -1.0, 0.0] {
            level.insert(point(DVec3::ONE, bad), 1.0);
        }
        level.insert(point(DVec3::splat(f64::NAN), 1.0), 1.0);
        level.insert(Point { color: DVec3::splat(f64::INFINITY), ..point(DVec3::ONE, 1.0) }, 1.0);
        assert!(level.points.is_empty());
        level.insert(point(DVec3::splat(1e300), 1e300), 1e6);
        level.insert(point(DVec3::splat(1e300), 1.0), 1.0);
        assert_eq!(level.mean(DVec3::splat(-1e300), DVec3::Z, 0.1).count, 0);
    }
}
