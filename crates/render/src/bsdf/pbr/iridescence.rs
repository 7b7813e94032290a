//! Reflectance of a surface under a thin film: Belcour and Barla 2017, "A Practical Extension to Microfacet Theory for the
//! Modeling of Varying Iridescence", doi:10.1145/3072959.3073620, in the form of KHR_materials_iridescence.

use crate::bsdf::fresnel::{eta_from_f0, f0_from_eta, schlick_weight};
use crate::math::TAU;
use crate::math::fns::{self, lerp, safe_sqrt, sqr};
use crate::spectrum::Spectrum;

/// The Fourier transform of the CIE color matching functions as sums of Gaussians (in their section on spectral integration):
/// amplitude, center, variance for X, Y, Z and the second lobe of X.
const SENSITIVITY: [[f32; 3]; 4] = [
    [5.4856e-13, 1.6810e6, 4.3278e9],
    [4.4201e-13, 1.7953e6, 9.3046e9],
    [5.2481e-13, 2.2084e6, 6.6121e9],
    [9.7470e-14, 2.2399e6, 4.5282e9],
];
/// The integral of the matching function Y in the units of the amplitudes.
const NORMALIZATION: f32 = 1.0685e-7;

/// The color of interference (linear Rec. 709) at an optical path difference in nanometers, without a phase shift.
fn sensitivity(opd_nm: f32) -> Spectrum {
    let phase = TAU * opd_nm * 1e-9;
    let lobe = |[val, pos, var]: [f32; 3]| {
        let amplitude = val / NORMALIZATION * (TAU * var).sqrt();
        amplitude * fns::cos(pos * phase) * fns::exp(-var * phase * phase)
    };
    let xyz = [lobe(SENSITIVITY[0]) + lobe(SENSITIVITY[3]), lobe(SENSITIVITY[1]), lobe(SENSITIVITY[2])];
    // CIE XYZ to linear Rec. 709.
    Spectrum::from_rgb([
        3.240_454_2 * xyz[0] - 1.537_138_5 * xyz[1] - 0.498_531_4 * xyz[2],
        -0.969_266 * xyz[0] + 1.876_010_8 * xyz[1] + 0.041_556 * xyz[2],
        0.055_643_4 * xyz[0] - 0.204_025_9 * xyz[1] + 1.057_225_2 * xyz[2],
    ])
}

/// Reflectance in [0, 1] of a base with the reflectance `f0` under a film, seen from air under the cosine `cos`.
pub(super) fn reflectance(cos: f32, f0: Spectrum, film_ior: f32, thickness_nm: f32) -> Spectrum {
    // A film that vanishes takes the index of air with it.
    let x = (thickness_nm / 0.03).clamp(0.0, 1.0);
    let film = lerp(x * x * (3.0 - 2.0 * x), 1.0, film_ior.max(1.0));
    let cos_film_sqr = 1.0 - (1.0 - cos * cos) / sqr(film);
    if cos_film_sqr <= 0.0 {
        return Spectrum::ONE;
    }
    let cos_film = safe_sqrt(cos_film_sqr);
    let r12 = lerp(schlick_weight(cos), f0_from_eta(film), 1.0);
    let t121 = 1.0 - r12;
    let opd = 2.0 * film * thickness_nm * cos_film;
    let orders = [sensitivity(opd), sensitivity(2.0 * opd)];
    let lane = |f0: f32, channel: usize| {
        let base = eta_from_f0(f0.clamp(0.0, 0.9999));
        let r23 = lerp(schlick_weight(cos_film), f0_from_eta(base / film), 1.0);
        let r123 = (r12 * r23).clamp(1e-5, 0.9999);
        let rs = t121 * t121 * r23 / (1.0 - r123);
        // Airy summation: the constant term and two orders of interference. The film's back turns the phase by π, and so
        // does a base that is denser: the shift is a sign, except for the second order.
        let c1 = (rs - t121) * r123.sqrt();
        let sign = if base < film { 1.0 } else { -1.0 };
        let sum = r12 + rs + 2.0 * c1 * (sign * orders[0][channel] + r123.sqrt() * orders[1][channel]);
        sum.clamp(0.0, 1.0)
    };
    Spectrum::from_rgb([lane(f0[0], 0), lane(f0[1], 1), lane(f0[2], 2)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_film_is_no_change() {
        // Without thickness the base alone. Two orders of interference and Schlick's curve hold away from grazing.
        for cos in [1.0, 0.9, 0.8] {
            let r = reflectance(cos, Spectrum::from_rgb([0.04, 0.3, 0.9]), 1.8, 0.0);
            for (got, f0) in r.rgb().into_iter().zip([0.04, 0.3, 0.9]) {
                let want = lerp(schlick_weight(cos), f0, 1.0);
                assert!((got - want).abs() < 0.02, "{cos} {got} {want}");
            }
        }
    }

    #[test]
    fn thickness_changes_the_hue() {
        let at = |nm| reflectance(0.9, Spectrum::from_rgb([0.04; 3]), 1.8, nm).rgb();
        let (a, b) = (at(250.0), at(400.0));
        assert!((a[0] / a[2] - b[0] / b[2]).abs() > 0.2, "{a:?} {b:?}");
        assert!(reflectance(0.0, Spectrum::ZERO, 1.0, 500.0).is_finite());
    }
}
