//! Square environment maps with the same solid angle for each pixel.
//!
//! The mapping is that of Clarberg 2008, "Fast Equal-Area Mapping of the (Hemi)Sphere Using SIMD" (doi:10.1080/2151237X.2008.10129263):
//! +z in the middle of the square, −z at its corners.

use rayon::prelude::*;

use super::environment::EnvironmentLight;
use crate::math::{PI, Vec2, Vec3, fns};

/// The point of the unit square for a unit direction (section 3).
pub fn square_from_direction(d: Vec3) -> Vec2 {
    let (x, y, z) = (d.x.abs(), d.y.abs(), d.z.abs());
    // The angle as a share of a quarter turn.
    let (short, long) = (x.min(y), x.max(y));
    let mut phi = if long > 0.0 { fns::atan2(short, long) * (2.0 / PI) } else { 0.0 };
    if x < y {
        phi = 1.0 - phi;
    }
    let r = fns::safe_sqrt(1.0 - z);
    let (mut u, mut v) = (r - phi * r, phi * r);
    if d.z < 0.0 {
        (u, v) = (1.0 - v, 1.0 - u);
    }
    Vec2::new(u.copysign(d.x), v.copysign(d.y)) * 0.5 + 0.5
}

/// The unit direction for a point of the unit square: the inverse of [`square_from_direction`].
pub fn direction_from_square(p: Vec2) -> Vec3 {
    let q = 2.0 * p - 1.0;
    let (u, v) = (q.x.abs(), q.y.abs());
    // Beyond the diagonal lies the lower half.
    let inside = 1.0 - (u + v);
    let r = 1.0 - inside.abs();
    let phi = if r > 0.0 { ((v - u) / r + 1.0) * (0.25 * PI) } else { 0.0 };
    let (sin, cos) = fns::sin_cos(phi);
    let across = r * fns::safe_sqrt(2.0 - r * r);
    Vec3::new((cos * across).copysign(q.x), (sin * across).copysign(q.y), (1.0 - r * r).copysign(inside))
}

/// The same light in latitude and longitude, of the same resolution at the equator's scale: width and height, and the texels. `n`² texels are given.
pub(crate) fn to_equirectangular(n: usize, texels: &[[f32; 3]]) -> ((usize, usize), Vec<[f32; 3]>) {
    // A sphere of 4π over n² pixels has 2n pixels round the equator at this height.
    let (width, height) = (2 * n, n);
    // Texels near the poles cover little of the sphere; at the equator one covers about as much as a texel of the square.
    const SUB: usize = 3;
    let texel = |x: isize, y: isize| texels[wrapped(x, y, n)];
    let lookup = |p: Vec2| {
        let q = p * n as f32 - 0.5;
        let (x, y) = (q.x.floor(), q.y.floor());
        let (fx, fy) = (q.x - x, q.y - y);
        let (x, y) = (x as isize, y as isize);
        let mix = |a: [f32; 3], b: [f32; 3], t: f32| -> [f32; 3] { std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t) };
        mix(mix(texel(x, y), texel(x + 1, y), fx), mix(texel(x, y + 1), texel(x + 1, y + 1), fx), fy)
    };
    let out = (0..width * height)
        .into_par_iter()
        .map(|i| {
            let (x, y) = (i % width, i / width);
            let mut sum = [0.0; 3];
            for k in 0..SUB * SUB {
                let u = Vec2::new(x as f32 + (0.5 + (k % SUB) as f32) / SUB as f32, y as f32 + (0.5 + (k / SUB) as f32) / SUB as f32);
                let (d, _) = EnvironmentLight::direction_from_uv(u / Vec2::new(width as f32, height as f32));
                let c = lookup(square_from_direction(d));
                sum = std::array::from_fn(|i| sum[i] + c[i]);
            }
            sum.map(|v| v / (SUB * SUB) as f32)
        })
        .collect();
    ((width, height), out)
}

/// The index of a texel, which may lie one beyond an edge: there the square joins itself, mirrored at the middle of the edge.
fn wrapped(mut x: isize, mut y: isize, n: usize) -> usize {
    let last = n as isize - 1;
    if x < 0 {
        (x, y) = (-1 - x, last - y);
    } else if x > last {
        (x, y) = (2 * last + 1 - x, last - y);
    }
    if y < 0 {
        (x, y) = (last - x, -1 - y);
    } else if y > last {
        (x, y) = (last - x, 2 * last + 1 - y);
    }
    (y.clamp(0, last) * n as isize + x.clamp(0, last)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_lie_where_the_mapping_puts_them() {
        for (d, p) in [
            (Vec3::Z, [0.5, 0.5]),
            (Vec3::X, [1.0, 0.5]),
            (Vec3::NEG_X, [0.0, 0.5]),
            (Vec3::Y, [0.5, 1.0]),
            (Vec3::NEG_Y, [0.5, 0.0]),
            (Vec3::NEG_Z, [1.0, 1.0]),
        ] {
            let q = square_from_direction(d);
            assert!((q - Vec2::from(p)).length() < 1e-6, "{d}: {q}");
        }
    }

    #[test]
    fn directions_come_back() {
        for i in 0..10_000 {
            let u = Vec2::new((i as f32 + 0.5) / 10_000.0, (f64::from(i) * 0.618_033_988_749_894_8).fract() as f32);
            let d = crate::math::warp::uniform_sphere(u);
            let back = direction_from_square(square_from_direction(d));
            assert!((back - d).length() < 2e-3 && (back.length() - 1.0).abs() < 1e-5, "{d} {back}");
        }
    }

    #[test]
    fn areas_are_equal() {
        // Uniform directions fill the cells of the square evenly.
        let n = 8;
        let mut counts = vec![0u32; n * n];
        let total = 200_000;
        for i in 0..total {
            let u = Vec2::new((i as f32 + 0.5) / total as f32, (f64::from(i) * 0.618_033_988_749_894_8).fract() as f32);
            let p = square_from_direction(crate::math::warp::uniform_sphere(u)) * n as f32;
            counts[(p.y as usize).min(n - 1) * n + (p.x as usize).min(n - 1)] += 1;
        }
        let expected = total as f32 / (n * n) as f32;
        assert!(counts.iter().all(|c| (*c as f32 / expected - 1.0).abs() < 0.05), "{counts:?}");
    }

    #[test]
    fn a_smooth_light_is_the_same_after_resampling() {
        let n = 64;
        let radiance = |d: Vec3| [1.0 + 0.5 * d.x, 1.0 + 0.5 * d.y, 1.0 + 0.5 * d.z];
        // The inverse by search: the square's texels from many directions.
        let mut texels = vec![[0.0f32; 3]; n * n];
        let mut counts = vec![0.0f32; n * n];
        for i in 0..400_000 {
            let u = Vec2::new((i as f32 + 0.5) / 400_000.0, (f64::from(i) * 0.618_033_988_749_894_8).fract() as f32);
            let d = crate::math::warp::uniform_sphere(u);
            let p = square_from_direction(d) * n as f32;
            let at = (p.y as usize).min(n - 1) * n + (p.x as usize).min(n - 1);
            let c = radiance(d);
            texels[at] = std::array::from_fn(|i| texels[at][i] + c[i]);
            counts[at] += 1.0;
        }
        for (t, c) in texels.iter_mut().zip(&counts) {
            *t = t.map(|v| v / c.max(1.0));
        }
        let ((w, h), map) = to_equirectangular(n, &texels);
        for y in 2..h - 2 {
            for x in 0..w {
                let (d, _) = EnvironmentLight::direction_from_uv(Vec2::new((x as f32 + 0.5) / w as f32, (y as f32 + 0.5) / h as f32));
                let (a, b) = (map[y * w + x], radiance(d));
                assert!((0..3).all(|i| (a[i] - b[i]).abs() < 0.03), "{x} {y}: {a:?} {b:?}");
            }
        }
    }
}
