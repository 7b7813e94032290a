//! `interior`, `media`, `material`.

use std::sync::Arc;

use glam::DVec3;

use super::super::value::{Material, Value};
use super::super::{Parse, Parser, Token};
use crate::desc::classic::{Interior, Media, Scattering};

const INTERIOR: &[&str] =
    &["ior", "caustics", "dispersion", "dispersion_samples", "fade_distance", "fade_power", "fade_color", "fade_colour", "refraction"];

const MEDIA: &[&str] = &[
    "method",
    "intervals",
    "samples",
    "confidence",
    "variance",
    "ratio",
    "jitter",
    "absorption",
    "emission",
    "aa_threshold",
    "aa_level",
    "scattering",
    "collect",
];

impl Parser {
    /// `interior { … }`.
    pub(crate) fn interior(&mut self) -> Parse<Interior> {
        self.expect("interior")?;
        self.expect("{")?;
        let start = self.accept_value(|v| if let Value::Interior(i) = v { Some(i.clone()) } else { None })?;
        let mut interior = start.map(Arc::unwrap_or_clone).unwrap_or_default();
        while !self.accept("}")? {
            match self.accept_any(INTERIOR)? {
                Some("ior") => interior.ior = self.float()?,
                Some("caustics") => interior.caustics = self.float()?,
                Some("dispersion") => interior.dispersion = self.float()?,
                Some("dispersion_samples") => interior.dispersion_samples = self.float()?.clamp(2.0, 1000.0) as u32,
                Some("fade_distance") => interior.fade_distance = self.float()?,
                Some("fade_power") => interior.fade_power = self.float()?,
                Some("refraction") => interior.refraction = self.float()?,
                Some(_) => interior.fade_color = self.color()?.rgb,
                None => {
                    if let Some(m) = self.accept_transform()? {
                        interior.transform(&m);
                    } else if matches!(self.peek()?, Token::Word("media")) {
                        interior.media.push(self.media()?);
                    } else {
                        return Err(self.unexpected("an interior"));
                    }
                }
            }
        }
        Ok(interior)
    }

    /// `media { … }`.
    pub(crate) fn media(&mut self) -> Parse<Media> {
        self.expect("media")?;
        self.expect("{")?;
        let start = self.accept_value(|v| if let Value::Media(m) = v { Some(m.clone()) } else { None })?;
        let mut media = start.map(Arc::unwrap_or_clone).unwrap_or_default();
        while !self.accept("}")? {
            if let Some(word) = self.accept_any(MEDIA)? {
                self.media_word(word, &mut media)?;
            } else if let Some(m) = self.accept_transform()? {
                media.transform(&m);
            } else if matches!(self.peek()?, Token::Word("density")) {
                media.densities.push(Arc::new(self.density()?));
            } else {
                return Err(self.unexpected("media"));
            }
        }
        Ok(media)
    }

    fn media_word(&mut self, word: &str, media: &mut Media) -> Parse<()> {
        match word {
            "method" => {
                let span = self.span();
                let method = self.float()?;
                if !(1.0..4.0).contains(&method) {
                    return Err(self.error(span, format!("media are sampled by method 1, 2 or 3, not {method}")));
                }
                media.method = method as u8;
            }
            "intervals" => media.intervals = self.float()?.clamp(1.0, 1e4) as u32,
            "samples" => {
                media.samples[0] = self.float()?.clamp(1.0, 1e5) as u32;
                self.comma()?;
                media.samples[1] = if self.at_float()? { self.float()?.clamp(1.0, 1e5) as u32 } else { media.samples[0] };
                media.samples[1] = media.samples[1].max(media.samples[0]);
            }
            "confidence" => media.confidence = self.float()?,
            "variance" => media.variance = self.float()?,
            "ratio" => media.ratio = self.float()?,
            "jitter" => media.jitter = self.float()?,
            "absorption" => media.absorption = self.color()?.rgb,
            "emission" => media.emission = self.color()?.rgb,
            "aa_threshold" => media.aa_threshold = self.float()?,
            "aa_level" => media.aa_level = self.float()?.clamp(0.0, 10.0) as u32,
            "scattering" => media.scattering = Some(self.scattering()?),
            _ => media.collect_photons = self.flag()?,
        }
        Ok(())
    }

    fn scattering(&mut self) -> Parse<Scattering> {
        self.expect("{")?;
        let span = self.span();
        let phase = self.float()?;
        if !(1.0..6.0).contains(&phase) {
            return Err(self.error(span, format!("scattering is of type 1 to 5, not {phase}")));
        }
        self.comma()?;
        let color = self.color()?.rgb;
        let mut scattering = Scattering { phase: phase as u8, color, eccentricity: 0.0, extinction: 1.0 };
        while !self.accept("}")? {
            match self.accept_any(&["eccentricity", "extinction"])? {
                Some("eccentricity") => scattering.eccentricity = self.float()?.clamp(-0.999_999, 0.999_999),
                Some(_) => scattering.extinction = self.float()?,
                None => return Err(self.unexpected("scattering")),
            }
        }
        if scattering.color == DVec3::ZERO && scattering.extinction == 0.0 {
            self.warning(span, "this scattering has no effect");
        }
        Ok(scattering)
    }

    /// `material { … }`.
    pub(crate) fn material(&mut self) -> Parse<Material> {
        self.expect("material")?;
        self.expect("{")?;
        let start = self.accept_value(|v| if let Value::Material(m) = v { Some(m.clone()) } else { None })?;
        let mut material = start.map(Arc::unwrap_or_clone).unwrap_or_default();
        while !self.accept("}")? {
            if let Some(m) = self.accept_transform()? {
                for texture in [&mut material.texture, &mut material.interior_texture].into_iter().flatten() {
                    Arc::make_mut(texture).transform(&m);
                }
                if let Some(interior) = &mut material.interior {
                    Arc::make_mut(interior).transform(&m);
                }
                continue;
            }
            match self.peek()? {
                Token::Word("texture") => material.texture = Some(Arc::new(self.texture()?)),
                Token::Word("interior") => material.interior = Some(Arc::new(self.interior()?)),
                _ => return Err(self.unexpected("a material")),
            }
        }
        Ok(material)
    }
}
