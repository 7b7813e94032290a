//! Spectra and colors of parameters → linear Rec. 709.

use glam::{DMat3, DVec3};

use super::Reader;
use super::params::{Parameter, Values};
use crate::formats::Resolver;
use crate::formats::spectrum::{Quantity, blackbody, rgb_from_list};
use crate::ior;
use crate::span::Span;

/// Primaries of `rgb` parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ColorSpace {
    /// Rec. 709 primaries, linear.
    Srgb,
    /// Rec. 2020.
    Rec2020,
    /// DCI-P3 with its own white as D65.
    DciP3,
    /// ACES 2065-1.
    Aces,
}

impl ColorSpace {
    /// By the name in the file, in any case.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name.to_ascii_lowercase().as_str() {
            "srgb" => Self::Srgb,
            "rec2020" => Self::Rec2020,
            "dci-p3" => Self::DciP3,
            "aces2065-1" => Self::Aces,
            _ => return None,
        })
    }

    /// Chromaticities of red, green, blue and white.
    fn primaries(self) -> [[f64; 2]; 4] {
        const D65: [f64; 2] = [0.3127, 0.3290];
        match self {
            Self::Srgb => [[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], D65],
            Self::Rec2020 => [[0.708, 0.292], [0.17, 0.797], [0.131, 0.046], D65],
            Self::DciP3 => [[0.68, 0.32], [0.265, 0.690], [0.15, 0.06], D65],
            Self::Aces => [[0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.077], [0.32168, 0.33767]],
        }
    }

    fn xyz_from_rgb(self) -> DMat3 {
        let xyz = |[x, y]: [f64; 2]| DVec3::new(x / y, 1.0, (1.0 - x - y) / y);
        let [r, g, b, w] = self.primaries().map(xyz);
        let m = DMat3::from_cols(r, g, b);
        m * DMat3::from_diagonal(m.inverse() * w)
    }

    /// The same color by Rec. 709 primaries; whites map to each other (their difference is left out).
    pub fn to_rec709(self, rgb: DVec3) -> DVec3 {
        if self == Self::Srgb {
            return rgb;
        }
        // Von Kries' scaling in XYZ would tint; map white to white by scaling the result's channels.
        let m = Self::Srgb.xyz_from_rgb().inverse() * self.xyz_from_rgb();
        let white = m * DVec3::ONE;
        m * rgb / white
    }
}

/// What a spectrum stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SpectrumKind {
    /// A reflectance, in [0, 1].
    Albedo,
    /// Any numbers: coefficients, refractive indices.
    Unbounded,
    /// Light: spectra that are no `rgb` count by their shape and have luminance 1 (pbrt divides light spectra by it).
    Illuminant,
}

const LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

impl Reader {
    /// The color of a parameter; `None` with a fault.
    pub(super) fn color(&mut self, p: &Parameter, kind: SpectrumKind) -> Option<[f32; 3]> {
        let rgb = match (p.kind.as_str(), &p.values) {
            ("rgb", Values::Numbers(v)) if v.len() == 3 => self.state.color_space.to_rec709(DVec3::new(v[0], v[1], v[2])),
            ("blackbody", Values::Numbers(v)) if v.len() == 1 && v[0] > 0.0 => {
                spectrum_color(&blackbody(v[0], 1.0), SpectrumKind::Illuminant)
            }
            ("float", Values::Numbers(v)) if v.len() == 1 => DVec3::splat(v[0]),
            ("spectrum", Values::Numbers(v)) if v.len() >= 2 && v.len() % 2 == 0 => {
                let mut list: Vec<(f64, f64)> = v.chunks_exact(2).map(|c| (c[0], c[1])).collect();
                list.sort_by(|a, b| a.0.total_cmp(&b.0));
                spectrum_color(&list, kind)
            }
            ("spectrum", Values::Texts(v)) if v.len() == 1 => return self.named_spectrum(&v[0], p, kind),
            _ => {
                self.error(
                    p.span,
                    format!("`{}` is no color: three numbers for rgb, a temperature for blackbody, pairs or a name for spectrum", p.name),
                );
                return None;
            }
        };
        Some(rgb.as_vec3().to_array())
    }

    /// The numbers of a text file, without its comments; `None`, with a fault, where it has something else.
    pub(super) fn numbers_of_file(&mut self, name: &str, span: Span) -> Option<Vec<f64>> {
        let path = self.resolve(name, span)?;
        let bytes = match Resolver::read(&path) {
            Ok(b) => b,
            Err(e) => {
                self.error(span, e.to_string());
                return None;
            }
        };
        let mut numbers = Vec::new();
        for (i, line) in String::from_utf8_lossy(&bytes).lines().enumerate() {
            for word in line.split('#').next().unwrap_or("").split_ascii_whitespace() {
                match word.parse::<f64>() {
                    Ok(v) if v.is_finite() => numbers.push(v),
                    _ => {
                        self.error(span, format!("{name}:{}: `{word}` is no number", i + 1));
                        return None;
                    }
                }
            }
        }
        Some(numbers)
    }

    fn named_spectrum(&mut self, name: &str, p: &Parameter, kind: SpectrumKind) -> Option<[f32; 3]> {
        if let Some(v) = known_spectrum(name) {
            return Some(v);
        }
        if name.starts_with("stdillum-") || name.starts_with("illum-") {
            let color = match name {
                "stdillum-A" => spectrum_color(&blackbody(2856.0, 1.0), kind),
                "stdillum-D65" | "illum-acesD60" => DVec3::ONE,
                "stdillum-D50" => spectrum_color(&blackbody(5003.0, 1.0), kind),
                _ => {
                    self.loss(p.span, format!("spectrum \"{name}\""), "white");
                    DVec3::ONE
                }
            };
            return Some(color.as_vec3().to_array());
        }
        let numbers = self.numbers_of_file(name, p.span)?;
        let mut list: Vec<(f64, f64)> = numbers.chunks_exact(2).map(|c| (c[0], c[1])).collect();
        if list.is_empty() || numbers.len() % 2 != 0 {
            self.error(p.span, format!("`{name}` holds no pairs of wavelength and value"));
            return None;
        }
        list.sort_by(|a, b| a.0.total_cmp(&b.0));
        Some(spectrum_color(&list, kind).as_vec3().to_array())
    }

    /// A refractive index that is a number or a spectrum; the mean of its channels.
    pub(super) fn refractive_index(&mut self, p: &Parameter) -> Option<f32> {
        if let ("spectrum", Some(name)) = (p.kind.as_str(), p.text())
            && name.starts_with("glass-")
        {
            self.loss(p.span, format!("dispersion of \"{name}\""), "its refractive index at 587.6 nm");
        }
        self.color(p, SpectrumKind::Unbounded).map(|c| (c[0] + c[1] + c[2]) / 3.0)
    }
}

fn spectrum_color(list: &[(f64, f64)], kind: SpectrumKind) -> DVec3 {
    match kind {
        SpectrumKind::Illuminant => {
            let rgb = rgb_from_list(list, Quantity::Emission);
            let luminance = LUMINANCE.dot(rgb);
            if luminance > 0.0 { rgb / luminance } else { DVec3::ZERO }
        }
        _ => rgb_from_list(list, Quantity::Reflectance),
    }
}

/// Named spectra of pbrt-v4: metals' `eta` and `k`, and glasses at 587.6 nm (refractiveindex.info).
fn known_spectrum(name: &str) -> Option<[f32; 3]> {
    if let Some(metal) = name.strip_prefix("metal-") {
        let (metal, part) = metal.rsplit_once('-')?;
        let (eta, k) = match metal {
            // Brass (Querry 1985), as RGB.
            "CuZn" => ([0.444, 0.527, 1.094], [3.695, 2.765, 1.829]),
            _ => ior::conductor(metal)?,
        };
        return match part {
            "eta" => Some(eta),
            "k" => Some(k),
            _ => None,
        };
    }
    let n = match name {
        "glass-BK7" => 1.5168,
        "glass-BAF10" => 1.67,
        "glass-FK51A" => 1.4866,
        "glass-LASF9" => 1.8503,
        "glass-F5" | "glass-SF5" => 1.6727,
        "glass-F10" | "glass-SF10" => 1.7283,
        "glass-F11" | "glass-SF11" => 1.7847,
        _ => return None,
    };
    Some([n; 3])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn color_spaces_keep_white_and_know_their_primaries() {
        for space in [ColorSpace::Srgb, ColorSpace::Rec2020, ColorSpace::DciP3, ColorSpace::Aces] {
            assert!((space.to_rec709(DVec3::ONE) - DVec3::ONE).length() < 1e-12, "{space:?}");
        }
        // ITU-R BT.2087: the green of Rec. 2020 lies far outside of Rec. 709.
        let green = ColorSpace::Rec2020.to_rec709(DVec3::Y);
        assert!((green - DVec3::new(-0.5876, 1.1329, -0.1006)).length() < 1e-3, "{green}");
    }

    #[test]
    fn light_spectra_count_by_their_shape() {
        let one = spectrum_color(&[(300.0, 1.0), (900.0, 1.0)], SpectrumKind::Illuminant);
        let ten = spectrum_color(&[(300.0, 10.0), (900.0, 10.0)], SpectrumKind::Illuminant);
        assert!((one - ten).length() < 1e-9 && (LUMINANCE.dot(one) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn named_metals_and_glasses_are_known() {
        assert_eq!(known_spectrum("metal-Au-eta"), ior::conductor("Au").map(|c| c.0));
        assert_eq!(known_spectrum("glass-BK7"), Some([1.5168; 3]));
        assert_eq!(known_spectrum("metal-Au-mu"), None);
    }
}
