//! The sheen of cloth: Estevez and Kulla 2017, "Production Friendly Microfacet Sheen BRDF" (SIGGRAPH course notes).

use std::sync::LazyLock;

use crate::math::fns::{self, lerp, safe_sqrt, sqr};
use crate::math::{INV_TAU, PI, Vec3};

const N_ROUGH: usize = 16;
const N_MU: usize = 24;

/// The least perceived roughness.
const MIN_ROUGHNESS: f32 = 0.1;

/// Directional albedo over (roughness, √cos θ), both uniform.
static ALBEDO: LazyLock<[[f32; N_MU]; N_ROUGH]> = LazyLock::new(|| {
    std::array::from_fn(|r| {
        let sheen = Sheen::new(lerp(r as f32 / (N_ROUGH - 1) as f32, MIN_ROUGHNESS, 1.0));
        std::array::from_fn(|m| {
            let mu = sqr(m as f32 / (N_MU - 1) as f32).max(1e-3);
            let wo = Vec3::new(safe_sqrt(1.0 - mu * mu), 0.0, mu);
            let (nt, np) = (40, 12);
            let mut sum = 0.0;
            for i in 0..nt {
                // cos θ = s²: the lobe crowds at the horizon.
                let s = (i as f32 + 0.5) / nt as f32;
                let (z, rho) = (s * s, safe_sqrt(1.0 - s * s * s * s));
                let mut row = 0.0;
                for j in 0..np {
                    // φ = π t²: and about the azimuth of the view.
                    let t = (j as f32 + 0.5) / np as f32;
                    let (sin, cos) = fns::sin_cos(PI * t * t);
                    row += sheen.d(wo + Vec3::new(rho * cos, rho * sin, z)) * t;
                }
                sum += row * sheen.visibility(mu, z) * 4.0 * s;
            }
            sum * 2.0 * PI / (nt * np) as f32
        })
    })
});

/// The lobe without its color.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sheen {
    roughness: f32,
    inv_alpha: f32,
    /// The five numbers of the fit to the masking.
    fit: [f32; 5],
}

impl Sheen {
    pub(super) fn new(roughness: f32) -> Self {
        // alpha = roughness² as the extension says, from 0.01 on.
        let roughness = roughness.clamp(MIN_ROUGHNESS, 1.0);
        let alpha = sqr(roughness);
        let rough = [21.5473, 3.829_87, 0.198_23, -1.977_60, -4.320_54];
        let smooth = [25.3245, 3.324_35, 0.168_01, -1.273_93, -4.859_67];
        let t = sqr(1.0 - alpha);
        Self { roughness, inv_alpha: 1.0 / alpha, fit: std::array::from_fn(|i| lerp(t, rough[i], smooth[i])) }
    }

    fn lambda(&self, cos: f32) -> f32 {
        let [a, b, c, d, e] = self.fit;
        let l = |x: f32| a / (1.0 + b * fns::pow(x, c)) + d * x + e;
        if cos < 0.5 { fns::exp(l(cos)) } else { fns::exp(2.0 * l(0.5) - l(1.0 - cos)) }
    }

    /// D of the half vector `h`, of any length.
    fn d(&self, h: Vec3) -> f32 {
        let sin2 = (h.x * h.x + h.y * h.y) / h.length_squared();
        (2.0 + self.inv_alpha) * fns::pow(sin2, 0.5 * self.inv_alpha) * INV_TAU
    }

    /// G / (4 cos θo): what multiplies D to f |cos θi|.
    fn visibility(&self, cos_o: f32, cos_i: f32) -> f32 {
        1.0 / ((1.0 + self.lambda(cos_o) + self.lambda(cos_i)) * 4.0 * cos_o)
    }

    /// f |cos θi| before normalization; both directions above.
    fn raw(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.d(wo + wi) * self.visibility(wo.z, wi.z)
    }

    /// Directional albedo before it is limited to one.
    fn raw_albedo(&self, mu: f32) -> f32 {
        let (x, y) =
            ((self.roughness - MIN_ROUGHNESS) / (1.0 - MIN_ROUGHNESS) * (N_ROUGH - 1) as f32, safe_sqrt(mu).min(1.0) * (N_MU - 1) as f32);
        let (i, j) = ((x as usize).min(N_ROUGH - 2), (y as usize).min(N_MU - 2));
        let t = &ALBEDO;
        let (fx, fy) = (x - i as f32, y - j as f32);
        lerp(fx, lerp(fy, t[i][j], t[i][j + 1]), lerp(fy, t[i + 1][j], t[i + 1][j + 1]))
    }

    /// Directional albedo, in [0, 1].
    pub(super) fn albedo(&self, mu: f32) -> f32 {
        self.raw_albedo(mu).min(1.0)
    }

    /// f |cos θi|, scaled down where the fit would give back more than it gets.
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.raw(wo, wi) / self.raw_albedo(wo.z).max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::chi2::sphere_integral;

    #[test]
    fn the_table_holds_the_integral() {
        for roughness in [0.0, 0.15, 0.3, 0.5, 0.77, 1.0] {
            let sheen = Sheen::new(roughness);
            for mu in [0.03, 0.07, 0.2, 0.45, 0.8, 1.0f32] {
                let wo = Vec3::new(safe_sqrt(1.0 - mu * mu), 0.0, mu);
                let e = sphere_integral(1e-4, |wi| if wi.z > 0.0 { sheen.raw(wo, wi) } else { 0.0 }) as f32;
                assert!((sheen.raw_albedo(mu) - e).abs() < 0.015 * e.max(1.0), "{roughness} {mu}: {} {e}", sheen.raw_albedo(mu));
            }
        }
    }
}
