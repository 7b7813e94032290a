//! The sheen of cloth: Estevez and Kulla 2017, "Production Friendly Microfacet Sheen BRDF" (SIGGRAPH course notes).

use std::sync::LazyLock;

use crate::math::fns::{self, lerp, safe_sqrt, sqr};
use crate::math::{INV_TAU, PI, Vec3};

const N_ROUGH: usize = 16;
const N_MU: usize = 20;

/// Directional albedo over (roughness, √cos θ), both uniform.
static ALBEDO: LazyLock<[[f32; N_MU]; N_ROUGH]> = LazyLock::new(|| {
    std::array::from_fn(|r| {
        let sheen = Sheen::new(r as f32 / (N_ROUGH - 1) as f32);
        std::array::from_fn(|m| {
            let mu = sqr(m as f32 / (N_MU - 1) as f32).max(1e-3);
            let wo = Vec3::new(safe_sqrt(1.0 - mu * mu), 0.0, mu);
            let (nt, np) = (24, 16);
            let mut sum = 0.0;
            for i in 0..nt {
                // cos θ = s²: the lobe crowds at the horizon.
                let s = (i as f32 + 0.5) / nt as f32;
                let (z, rho) = (s * s, safe_sqrt(1.0 - s * s * s * s));
                for j in 0..np {
                    let (sin, cos) = fns::sin_cos(PI * (j as f32 + 0.5) / np as f32);
                    sum += sheen.raw(wo, Vec3::new(rho * cos, rho * sin, z)) * 2.0 * s;
                }
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
    /// The five numbers of the fit to the masking, equation 3.
    fit: [f32; 5],
}

impl Sheen {
    pub(super) fn new(roughness: f32) -> Self {
        // alpha = roughness² as the extension says, at least 0.01.
        let roughness = roughness.clamp(0.1, 1.0);
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

    /// f |cos θi| before normalization (equations 1 to 3); both directions above.
    fn raw(&self, wo: Vec3, wi: Vec3) -> f32 {
        let h = (wo + wi).normalize();
        let d = (2.0 + self.inv_alpha) * fns::pow(safe_sqrt(1.0 - h.z * h.z), self.inv_alpha) * INV_TAU;
        d / ((1.0 + self.lambda(wo.z) + self.lambda(wi.z)) * 4.0 * wo.z)
    }

    /// Directional albedo before it is limited to one.
    fn raw_albedo(&self, mu: f32) -> f32 {
        let (x, y) = (self.roughness * (N_ROUGH - 1) as f32, safe_sqrt(mu).min(1.0) * (N_MU - 1) as f32);
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
