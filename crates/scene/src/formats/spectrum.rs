//! Spectra → linear Rec. 709, as Mitsuba's RGB mode converts them.

use glam::DVec3;

use super::cie::{FIRST_NM, OBSERVER_D65, STEP_NM};

/// What a spectrum says; emission and reflectance are white-balanced differently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Radiance and the like: a flat spectrum has the (pinkish) color of the equal-energy white.
    Emission,
    /// A reflectance, refractive index or coefficient: a flat spectrum is gray, seen under D65.
    Reflectance,
}

/// Linear Rec. 709 of CIE XYZ (IEC 61966-2-1).
fn rgb_from_xyz(xyz: DVec3) -> DVec3 {
    DVec3::new(
        3.240479 * xyz.x - 1.537150 * xyz.y - 0.498535 * xyz.z,
        -0.969256 * xyz.x + 1.875991 * xyz.y + 0.041556 * xyz.z,
        0.055648 * xyz.x - 0.204043 * xyz.y + 1.057311 * xyz.z,
    )
}

/// Color of a spectrum given as (wavelength in nm, value), ascending, linear in between and 0 outside. Negative channels of reflectances
/// are clamped.
pub fn rgb_from_list(list: &[(f64, f64)], quantity: Quantity) -> DVec3 {
    let value = |nm: f64| {
        let i = list.partition_point(|(w, _)| *w <= nm);
        match (i.checked_sub(1).map(|j| list[j]), list.get(i)) {
            (Some((w0, v0)), Some((w1, v1))) => v0 + (v1 - v0) * (nm - w0) / (w1 - w0),
            (Some((w0, v0)), None) if w0 == nm => v0,
            _ => 0.0,
        }
    };
    let mut sum = DVec3::ZERO;
    let mut normalization = 0.0;
    // The tables are linear between their rows; steps of 1 nm resolve jumps of the list.
    const STEPS: usize = 5;
    for i in 0..(OBSERVER_D65.len() - 1) * STEPS + 1 {
        let (row, t) = (i / STEPS, (i % STEPS) as f64 / STEPS as f64);
        let a = OBSERVER_D65[row];
        let b = OBSERVER_D65[(row + 1).min(OBSERVER_D65.len() - 1)];
        let at = |c: usize| a[c] + (b[c] - a[c]) * t;
        let light = if quantity == Quantity::Reflectance { at(3) } else { 1.0 };
        let v = value(FIRST_NM + i as f64 * STEP_NM / STEPS as f64);
        sum += DVec3::new(at(0), at(1), at(2)) * (v * light);
        normalization += at(1) * light;
    }
    let rgb = rgb_from_xyz(sum / normalization);
    if quantity == Quantity::Reflectance { rgb.max(DVec3::ZERO) } else { rgb }
}

/// Color of a spectrum that is the same at every wavelength.
pub fn rgb_from_uniform(value: f64, quantity: Quantity) -> DVec3 {
    match quantity {
        Quantity::Reflectance => DVec3::splat(value),
        Quantity::Emission => rgb_from_list(&[(300.0, value), (900.0, value)], quantity),
    }
}

/// Planck's law in W·m⁻²·sr⁻¹·nm⁻¹ at a temperature in kelvin, every 5 nm.
pub fn blackbody(kelvin: f64, scale: f64) -> Vec<(f64, f64)> {
    const C: f64 = 299_792_458.0;
    const H: f64 = 6.626_070_15e-34;
    const K: f64 = 1.380_649e-23;
    let radiance = |nm: f64| {
        let l = nm * 1e-9;
        let value = 2.0 * H * C * C / l.powi(5) / ((H * C / (l * K * kelvin.max(1.0))).exp() - 1.0) * 1e-9;
        if value.is_finite() { scale * value } else { 0.0 }
    };
    (0..OBSERVER_D65.len()).map(|i| FIRST_NM + i as f64 * STEP_NM).map(|nm| (nm, radiance(nm))).collect()
}

/// The linear value of an sRGB-encoded one (IEC 61966-2-1).
pub fn linear_from_srgb(v: f64) -> f64 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: DVec3, b: [f64; 3], tolerance: f64) {
        assert!(a.abs_diff_eq(DVec3::from(b), tolerance), "{a} is not {b:?}");
    }

    /// Expected values are Mitsuba 3.9's in its RGB mode.
    #[test]
    fn lists_become_the_colors_that_mitsuba_gives() {
        let list = [(400.0, 0.1), (500.0, 0.2), (600.0, 0.8), (700.0, 0.9)];
        close(rgb_from_list(&list, Quantity::Reflectance), [0.958689, 0.446356, 0.10571], 2e-3);
        close(rgb_from_list(&list, Quantity::Emission), [1.10355, 0.428732, 0.0887223], 2e-3);
        close(rgb_from_uniform(2.0, Quantity::Emission), [2.40959, 1.89658, 1.81783], 2e-3);
    }

    #[test]
    fn black_bodies_of_6500_k_are_nearly_white_and_cool_ones_red() {
        let white = rgb_from_list(&blackbody(6500.0, 1.0), Quantity::Emission);
        assert!((white.x / white.z - 1.0).abs() < 0.1, "{white}");
        let red = rgb_from_list(&blackbody(2000.0, 1.0), Quantity::Emission);
        assert!(red.x > 4.0 * red.z.max(0.0), "{red}");
    }
}
