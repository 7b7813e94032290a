//! Refractive indices by the names that scene files use.

use super::ior_data::{CONDUCTORS, DIELECTRICS};
use crate::spectrum::Spectrum;

/// The refractive index of a dielectric against vacuum, as `"bk7"` or `"Water Ice"`; `None` for an unknown name.
pub fn dielectric(name: &str) -> Option<f32> {
    DIELECTRICS.iter().find(|d| d.0.eq_ignore_ascii_case(name)).map(|d| d.1)
}

/// Real and imaginary part of the refractive index of a metal against vacuum in RGB, by its chemical formula, as `"Au"`;
/// `"none"` is a perfect mirror. The suffix `_palik` selects a data source where there are two. `None` for an unknown name.
pub fn conductor(name: &str) -> Option<(Spectrum, Spectrum)> {
    let find = |name: &str| CONDUCTORS.iter().find(|c| c.0 == name);
    find(name).or_else(|| find(name.strip_suffix("_palik")?)).map(|c| (Spectrum::from_rgb(c.1), Spectrum::from_rgb(c.2)))
}

/// The names that [`dielectric`] knows, for error messages.
pub fn dielectric_names() -> impl Iterator<Item = &'static str> {
    DIELECTRICS.iter().map(|d| d.0)
}

/// The names that [`conductor`] knows, for error messages.
pub fn conductor_names() -> impl Iterator<Item = &'static str> {
    CONDUCTORS.iter().map(|c| c.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::fresnel;

    fn reflectance(name: &str) -> [f32; 3] {
        let (eta, k) = conductor(name).unwrap();
        fresnel::conductor(1.0, eta, k).rgb()
    }

    #[test]
    fn names_are_found() {
        assert_eq!(dielectric("bk7"), Some(1.5046));
        assert_eq!(dielectric("Water Ice"), Some(1.31));
        assert_eq!(dielectric("nonsense"), None);
        assert_eq!(conductor("au"), None);
        assert_eq!(conductor("Ag_palik"), conductor("Ag"));
        assert_ne!(conductor("Cu_palik"), conductor("Cu"));
        for (names, count) in [(dielectric_names().collect::<Vec<_>>(), 23), (conductor_names().collect(), 47)] {
            assert_eq!(names.len(), count);
            assert!(names.iter().all(|n| names.iter().filter(|o| *o == n).count() == 1));
        }
    }

    #[test]
    fn metals_have_their_colors() {
        assert_eq!(reflectance("none"), [1.0; 3]);
        let [r, g, b] = reflectance("Au");
        assert!(r > 0.9 && r > g && g > b && b < 0.5, "{r} {g} {b}");
        let [r, g, b] = reflectance("Cu");
        assert!(r > g && g > b, "{r} {g} {b}");
        for (name, low, high) in [("Ag", 0.9, 1.0), ("Al", 0.85, 0.97), ("Fe", 0.4, 0.65), ("Ti", 0.4, 0.7), ("Pt", 0.55, 0.8)] {
            assert!(reflectance(name).iter().all(|&v| v > low && v < high), "{name} {:?}", reflectance(name));
        }
    }
}
