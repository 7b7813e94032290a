//! Distributions of microfacet normals with Smith's shadowing.

use crate::math::fns::{self, safe_sqrt, sqr};
use crate::math::{INV_PI, ONE_MINUS_EPSILON, PI, TAU, Vec2, Vec3};

/// The shape of the distribution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Distribution {
    /// Trowbridge and Reitz 1975, named GGX by Walter et al. 2007: long tails.
    Ggx,
    /// Beckmann and Spizzichino 1963: Gaussian slopes, short tails.
    #[default]
    Beckmann,
}

/// An anisotropic distribution of microfacet normals about +z.
///
/// Directions and normals are local and unit. Shadowing and masking are uncorrelated, G = G1 · G1, as in Walter et al.
/// 2007, "Microfacet Models for Refraction through Rough Surfaces".
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Microfacet {
    /// The shape of the distribution.
    pub distribution: Distribution,
    /// Roughness along x, the root mean square slope times √2 (Beckmann); at least [`Microfacet::MIN_ALPHA`].
    pub alpha_x: f32,
    /// Roughness along y.
    pub alpha_y: f32,
}

impl Microfacet {
    /// The least roughness: below it `f32` cannot resolve the lobe.
    pub const MIN_ALPHA: f32 = 1e-4;

    /// A distribution with the roughness raised to [`Self::MIN_ALPHA`] where it is below.
    #[inline]
    pub fn new(distribution: Distribution, alpha_x: f32, alpha_y: f32) -> Self {
        Self { distribution, alpha_x: alpha_x.max(Self::MIN_ALPHA), alpha_y: alpha_y.max(Self::MIN_ALPHA) }
    }

    /// The same roughness in all directions.
    #[inline]
    pub fn isotropic(distribution: Distribution, alpha: f32) -> Self {
        Self::new(distribution, alpha, alpha)
    }

    /// D(m): area of microfacets with normal `m` per solid angle and area of the surface, ∫ D(m) m.z dm = 1.
    #[inline]
    pub fn d(&self, m: Vec3) -> f32 {
        if m.z <= 0.0 {
            return 0.0;
        }
        let (ax, ay) = (self.alpha_x, self.alpha_y);
        let slope2 = sqr(m.x / ax) + sqr(m.y / ay);
        let z2 = m.z * m.z;
        let d = match self.distribution {
            // Walter et al. 2007, equation 33; anisotropic form: Heitz 2014, appendix A.
            Distribution::Ggx => INV_PI / (ax * ay * sqr(slope2 + z2)),
            // Walter et al. 2007, equation 25; Heitz 2014, appendix A.
            Distribution::Beckmann => fns::exp(-slope2 / z2) * INV_PI / (ax * ay * z2 * z2),
        };
        // At grazing normals the tail underflows into noise.
        if d * m.z > 1e-20 { d } else { 0.0 }
    }

    /// G1(v, m): the share of the microfacets with normal `m` that `v` sees; zero where `v` sees the back of `m`.
    #[inline]
    pub fn g1(&self, v: Vec3, m: Vec3) -> f32 {
        if v.dot(m) * v.z <= 0.0 { 0.0 } else { self.g1_distant(v) }
    }

    /// [`Self::g1`] for any normal whose front `v` sees: Smith's masking does not depend on the normal.
    #[inline]
    pub fn g1_distant(&self, v: Vec3) -> f32 {
        // (alpha tan θ)² along the azimuth of v, without the division.
        let xy = sqr(self.alpha_x * v.x) + sqr(self.alpha_y * v.y);
        let z2 = v.z * v.z;
        if xy == 0.0 {
            return 1.0;
        }
        match self.distribution {
            // Walter et al. 2007, equation 34.
            Distribution::Ggx => {
                let z = v.z.abs();
                2.0 * z / (z + (z2 + xy).sqrt())
            }
            // The rational approximation of Walter et al. 2007 behind equation 27, within 0.35 %.
            Distribution::Beckmann => {
                if z2 >= sqr(1.6) * xy {
                    return 1.0;
                }
                let a = (z2 / xy).sqrt();
                a * (3.535 + 2.181 * a) / (1.0 + a * (2.276 + 2.577 * a))
            }
        }
    }

    /// G(wo, wi, m): the share of the microfacets with normal `m` that both directions see.
    #[inline]
    pub fn g(&self, wo: Vec3, wi: Vec3, m: Vec3) -> f32 {
        self.g1(wo, m) * self.g1(wi, m)
    }

    /// A normal, by the area that `wo` sees of it; `wo.z` must be positive.
    #[inline]
    pub fn sample_visible_normal(&self, wo: Vec3, u: Vec2) -> Vec3 {
        // Roughness stretches space: normals of the distribution with alpha = 1, seen from the stretched direction.
        let v = Vec3::new(self.alpha_x * wo.x, self.alpha_y * wo.y, wo.z).normalize();
        let m = match self.distribution {
            Distribution::Ggx => visible_hemisphere_normal(v, u),
            Distribution::Beckmann => {
                let s = visible_beckmann_slope(v, u);
                Vec3::new(s.x, s.y, 1.0)
            }
        };
        let m = Vec3::new(self.alpha_x * m.x, self.alpha_y * m.y, m.z);
        let len2 = m.length_squared();
        if len2 > 0.0 { m / len2.sqrt() } else { Vec3::Z }
    }

    /// The density of [`Self::sample_visible_normal`] per solid angle of `m` (Heitz and d'Eon 2014).
    #[inline]
    pub fn pdf_visible(&self, wo: Vec3, m: Vec3) -> f32 {
        let cos = wo.dot(m);
        if wo.z <= 0.0 || cos <= 0.0 { 0.0 } else { self.d(m) * self.g1_distant(wo) * cos / wo.z }
    }
}

/// A normal of the hemisphere (GGX with alpha = 1) by the area visible from `v`: half vector of `v` and a point of a
/// spherical cap; not normalized (Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with Spherical Caps", listing 3,
/// doi:10.1111/cgf.14867).
#[inline]
fn visible_hemisphere_normal(v: Vec3, u: Vec2) -> Vec3 {
    let (sin, cos) = fns::sin_cos(TAU * u.y);
    let h = (1.0 - u.x) * (1.0 + v.z);
    let z = h - v.z;
    let r = safe_sqrt((1.0 - z) * (1.0 + z));
    Vec3::new(r * cos + v.x, r * sin + v.y, h)
}

/// A slope (x, y) of the normal (x, y, 1) of the Beckmann distribution with alpha = 1 by the area visible from `v`
/// (Heitz and d'Eon 2014, "Importance Sampling Microfacet-Based BSDFs using the Distribution of Visible Normals",
/// doi:10.1111/cgf.12417; iterated over the error function's value as in Jakob 2014, "An Improved Visible Normal Sampling
/// Routine for the Beckmann Distribution").
#[inline]
fn visible_beckmann_slope(v: Vec3, u: Vec2) -> Vec2 {
    const QUARTER_SQRT_PI: f32 = 0.443_113_46;
    let sin = (v.x * v.x + v.y * v.y).sqrt();
    if sin < 1e-4 {
        // Seen from above all facets count by their projected area.
        let r = safe_sqrt(-fns::ln(1.0 - u.x));
        let (s, c) = fns::sin_cos(TAU * u.y);
        return Vec2::new(r * c, r * s);
    }
    // In the frame where v = (sin, 0, cos), p(x, y) is proportional to (cos + x sin) exp(−x² − y²) for x ≥ −cot. The
    // cumulative distribution over b = erf x has the derivative (cos + x sin) / 2 and no singularity.
    let cos = v.z;
    let cot = cos / sin;
    let half_inv_sqrt_pi = 0.5 / PI.sqrt();
    let b_min = -libm::erff(cot);
    let tail = fns::exp(-cot * cot);
    let norm = 0.5 * cos * (1.0 - b_min) + half_inv_sqrt_pi * sin * tail;
    let target = u.x.max(1e-6) * norm;
    let (mut lo, mut hi) = (b_min, ONE_MINUS_EPSILON);
    // Start: the quantile of the unweighted slopes, moved to the right as the view becomes grazing.
    let mut b = b_min + (hi - b_min) * (u.x + (1.0 - u.x) * 0.3 * sin * sin);
    let mut x = erf_inv(b);
    for _ in 0..10 {
        let gauss = fns::exp(-x * x);
        let f = 0.5 * cos * (b - b_min) + half_inv_sqrt_pi * sin * (tail - gauss) - target;
        if f.abs() < 1e-5 * norm {
            break;
        }
        if f > 0.0 {
            hi = b
        } else {
            lo = b
        }
        // Halley's step: the second derivative over the first is sin √π exp(x²) / (2 (cos + x sin)).
        let slope = cos + x * sin;
        let newton = 2.0 * f / slope;
        let next = b - newton / (1.0 - newton * sin * QUARTER_SQRT_PI / (gauss * slope)).max(0.5);
        // Halves where the step leaves the bracket.
        b = if next > lo && next < hi { next } else { 0.5 * (lo + hi) };
        x = erf_inv(b);
    }
    let y = erf_inv((2.0 * u.y - 1.0).clamp(-ONE_MINUS_EPSILON, ONE_MINUS_EPSILON));
    let (c, s) = (v.x / sin, v.y / sin);
    Vec2::new(c * x - s * y, s * x + c * y)
}

/// The inverse of the error function for arguments in (−1, 1), relative error below 1e-6 (Giles 2012, "Approximating the
/// erfinv Function", GPU Computing Gems Jade Edition, chapter 10).
#[inline]
pub fn erf_inv(x: f32) -> f32 {
    let w = -fns::ln((1.0 - x) * (1.0 + x));
    // Estrin's scheme: Horner's waits for each product in turn.
    let poly = |t: f32, [c8, c7, c6, c5, c4, c3, c2, c1, c0]: [f32; 9]| {
        let t2 = t * t;
        let t4 = t2 * t2;
        let low = (c0 + c1 * t) + (c2 + c3 * t) * t2;
        let high = (c4 + c5 * t) + (c6 + c7 * t) * t2;
        low + (high + c8 * t4) * t4
    };
    let p = if w < 5.0 {
        poly(
            w - 2.5,
            [
                2.810_226_36e-8,
                3.432_739_39e-7,
                -3.523_387_7e-6,
                -4.391_506_54e-6,
                2.185_808_7e-4,
                -1.253_725_03e-3,
                -4.177_681_64e-3,
                0.246_640_727,
                1.501_409_41,
            ],
        )
    } else {
        poly(
            w.sqrt() - 3.0,
            [
                -2.002_142_57e-4,
                1.009_505_58e-4,
                1.349_343_22e-3,
                -3.673_428_44e-3,
                5.739_507_73e-3,
                -7.622_461_3e-3,
                9.438_870_47e-3,
                1.001_674_06,
                2.832_976_82,
            ],
        )
    };
    p * x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash;

    const BOTH: [Distribution; 2] = [Distribution::Ggx, Distribution::Beckmann];

    fn sphere_integral(f: impl Fn(Vec3) -> f32) -> f64 {
        let (nz, np) = (2000, 200);
        let mut sum = 0.0;
        for i in 0..nz {
            // Quadratic spacing: smooth lobes crowd at the pole.
            let s = (i as f32 + 0.5) / nz as f32;
            let z = 1.0 - s * s;
            let r = safe_sqrt(1.0 - z * z);
            for j in 0..np {
                let (sin, cos) = fns::sin_cos(TAU * (j as f32 + 0.5) / np as f32);
                sum += f64::from(f(Vec3::new(r * cos, r * sin, z)) * 2.0 * s);
            }
        }
        sum * f64::from(TAU) / f64::from(nz * np)
    }

    #[test]
    fn normals_cover_the_projected_area() {
        for dist in BOTH {
            for (ax, ay) in [(0.1, 0.1), (0.5, 0.2), (1.0, 1.0)] {
                let mf = Microfacet::new(dist, ax, ay);
                let area = sphere_integral(|m| mf.d(m) * m.z);
                assert!((area - 1.0).abs() < 2e-3, "{mf:?} {area}");
                for v in [Vec3::Z, Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.36, 0.9216, 0.144).normalize()] {
                    let seen = sphere_integral(|m| mf.pdf_visible(v, m));
                    assert!((seen - 1.0).abs() < 5e-3, "{mf:?} {v} {seen}");
                }
            }
        }
    }

    #[test]
    fn sampled_normals_have_the_mean_of_their_density() {
        for dist in BOTH {
            for (ax, ay) in [(0.2, 0.2), (0.7, 0.15)] {
                let mf = Microfacet::new(dist, ax, ay);
                for v in [Vec3::Z, Vec3::new(0.0, 0.6, 0.8), Vec3::new(0.9, 0.3, 0.05).normalize()] {
                    let n = 100_000u64;
                    let mut mean = [0.0f64; 3];
                    for i in 0..n {
                        let h = hash::hash_words([7, i]);
                        let m = mf.sample_visible_normal(v, Vec2::new(hash::unit_float(h as u32), hash::unit_float((h >> 32) as u32)));
                        assert!(m.is_normalized() && m.z >= 0.0 && v.dot(m) > -1e-4, "{mf:?} {v} {m}");
                        for (a, c) in mean.iter_mut().zip(m.to_array()) {
                            *a += f64::from(c) / n as f64;
                        }
                    }
                    for (axis, mean) in [(Vec3::X, mean[0]), (Vec3::Y, mean[1]), (Vec3::Z, mean[2])] {
                        let expected = sphere_integral(|m| mf.pdf_visible(v, m) * m.dot(axis));
                        assert!((mean - expected).abs() < 6e-3, "{mf:?} {v} {axis} {mean} {expected}");
                    }
                }
            }
        }
    }

    #[test]
    fn erf_inv_inverts_erf() {
        for i in -999..=999 {
            let x = i as f32 / 1000.0;
            assert!((libm::erff(erf_inv(x)) - x).abs() < 3e-7, "{x}");
        }
        assert!(erf_inv(ONE_MINUS_EPSILON).is_finite());
    }

    #[test]
    fn extreme_input_stays_finite() {
        for dist in BOTH {
            for alpha in [0.0, 1e-4, 0.5, 10.0] {
                let mf = Microfacet::isotropic(dist, alpha);
                for z in [1e-20f32, 1e-6, 0.5, 1.0] {
                    let v = Vec3::new((1.0 - z * z).sqrt(), 0.0, z);
                    for u in [Vec2::ZERO, Vec2::splat(ONE_MINUS_EPSILON), Vec2::new(0.0, ONE_MINUS_EPSILON), Vec2::splat(0.5)] {
                        let m = mf.sample_visible_normal(v, u);
                        assert!(m.is_finite() && mf.pdf_visible(v, m).is_finite() && mf.g(v, v, m) <= 1.0, "{mf:?} {v} {u} {m}");
                    }
                }
            }
        }
    }
}
