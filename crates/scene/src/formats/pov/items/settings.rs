//! `global_settings`.

use super::super::{Parse, Parser};
use crate::desc::classic::{Photons, Subsurface};

const SETTINGS: &[&str] = &[
    "adc_bailout",
    "ambient_light",
    "assumed_gamma",
    "hf_gray_16",
    "irid_wavelength",
    "charset",
    "max_intersections",
    "max_trace_level",
    "mm_per_unit",
    "number_of_waves",
    "noise_generator",
    "radiosity",
    "photons",
    "subsurface",
];

const RADIOSITY: &[&str] = &[
    "adc_bailout",
    "always_sample",
    "brightness",
    "count",
    "error_bound",
    "gray_threshold",
    "low_error_factor",
    "max_sample",
    "maximum_reuse",
    "media",
    "minimum_reuse",
    "nearest_count",
    "normal",
    "pretrace_start",
    "pretrace_end",
    "recursion_limit",
    "subsurface",
    "distance_maximum",
    "save_file",
    "load_file",
];

const PHOTONS: &[&str] = &[
    "spacing",
    "count",
    "gather",
    "media",
    "jitter",
    "max_trace_level",
    "adc_bailout",
    "save_file",
    "load_file",
    "autostop",
    "expand_thresholds",
    "radius",
];

impl Parser {
    /// `global_settings { … }`, into the scene.
    pub(crate) fn global_settings(&mut self) -> Parse<()> {
        self.expect("global_settings")?;
        self.expect("{")?;
        while !self.accept("}")? {
            let span = self.span();
            let Some(word) = self.accept_any(SETTINGS)? else { return Err(self.unexpected("the global settings")) };
            match word {
                "adc_bailout" => self.scene.settings.adc_bailout = self.float()?,
                "ambient_light" => self.scene.settings.ambient_light = self.color()?.rgb,
                "assumed_gamma" => {
                    self.scene.settings.gamma_given = true;
                    self.scene.settings.assumed_srgb = self.accept("srgb")?;
                    if !self.scene.settings.assumed_srgb {
                        let gamma = self.float()?;
                        if !(gamma > 0.0 && gamma.is_finite()) {
                            return Err(self.error(span, format!("an assumed_gamma of {gamma} is not possible")));
                        }
                        self.scene.settings.assumed_gamma = gamma;
                    }
                }
                "hf_gray_16" => {
                    self.flag()?;
                    self.warning(span, "hf_gray_16 has no effect since version 3.7");
                }
                "irid_wavelength" => self.scene.settings.irid_wavelength = self.color()?.rgb,
                "charset" => {
                    if self.accept_any(&["ascii", "utf8", "sys"])?.is_none() {
                        return Err(self.unexpected("a character set (ascii, utf8, sys)"));
                    }
                }
                "max_intersections" => {
                    self.float()?;
                }
                "max_trace_level" => {
                    let level = self.float()?;
                    if !(1.0..=256.0).contains(&level) {
                        self.warning(span, format!("a max_trace_level of {level} is not possible: 1 to 256"));
                    }
                    self.scene.settings.max_trace_level = level.clamp(1.0, 256.0) as u32;
                }
                "mm_per_unit" => self.scene.settings.mm_per_unit = self.float()?,
                "number_of_waves" => self.scene.settings.number_of_waves = self.float()?.clamp(1.0, 1000.0) as u32,
                "noise_generator" => {
                    self.scene.settings.noise_generator = self.float()?.clamp(1.0, 3.0) as u8;
                    self.noise_generator_given = true;
                }
                "radiosity" => self.radiosity()?,
                "photons" => self.photons()?,
                _ => self.subsurface()?,
            }
        }
        Ok(())
    }

    fn radiosity(&mut self) -> Parse<()> {
        self.expect("{")?;
        let mut r = self.scene.settings.radiosity.clone().unwrap_or_default();
        while !self.accept("}")? {
            let span = self.span();
            let Some(word) = self.accept_any(RADIOSITY)? else { return Err(self.unexpected("radiosity")) };
            match word {
                "adc_bailout" => r.adc_bailout = self.float()?,
                "always_sample" => r.always_sample = self.flag()?,
                "brightness" => r.brightness = self.float()?,
                "count" => {
                    r.count = self.float()?.clamp(1.0, 1e5) as u32;
                    r.directions = if self.second()? { self.float()?.clamp(0.0, 1e7) as u32 } else { 0 };
                }
                "error_bound" => r.error_bound = self.float()?,
                "gray_threshold" => r.gray_threshold = self.float()?.clamp(0.0, 1.0),
                "low_error_factor" => r.low_error_factor = self.float()?,
                "max_sample" => r.max_sample = self.float()?,
                "maximum_reuse" => r.maximum_reuse = self.float()?,
                "media" => r.media = self.flag()?,
                "minimum_reuse" => r.minimum_reuse = self.float()?,
                "nearest_count" => {
                    r.nearest_count = self.float()?.clamp(1.0, 20.0) as u32;
                    if self.second()? {
                        self.float()?;
                    }
                }
                "normal" => r.normal = self.flag()?,
                "pretrace_start" => r.pretrace_start = self.float()?,
                "pretrace_end" => r.pretrace_end = self.float()?,
                "recursion_limit" => r.recursion_limit = self.float()?.clamp(1.0, 20.0) as u32,
                "subsurface" => r.subsurface = self.flag()?,
                "distance_maximum" => {
                    self.float()?;
                    self.warning(span, "distance_maximum has no effect since version 3.7");
                }
                _ => self.no_map_file(word, "radiosity")?,
            }
        }
        self.scene.settings.radiosity = Some(r);
        Ok(())
    }

    fn photons(&mut self) -> Parse<()> {
        self.expect("{")?;
        let mut p: Photons = self.scene.settings.photons.clone().unwrap_or_default();
        while !self.accept("}")? {
            let Some(word) = self.accept_any(PHOTONS)? else { return Err(self.unexpected("photons")) };
            match word {
                "spacing" => p.spacing = self.float()?,
                "count" => p.count = self.float()?.clamp(0.0, 1e9) as u32,
                "gather" => {
                    p.gather[0] = self.float()?.clamp(1.0, 1e6) as u32;
                    self.comma()?;
                    p.gather[1] = (self.float()?.clamp(1.0, 1e6) as u32).max(p.gather[0]);
                }
                "media" => {
                    p.media = self.float()?.clamp(0.0, 1e6) as u32;
                    if self.second()? {
                        p.media_factor = self.float()?;
                    }
                }
                "jitter" => p.jitter = self.float()?,
                "max_trace_level" => p.max_trace_level = Some(self.float()?.clamp(0.0, 256.0) as u32),
                "adc_bailout" => p.adc_bailout = Some(self.float()?),
                "autostop" => p.autostop = self.float()?,
                "expand_thresholds" => {
                    p.expand_thresholds[0] = self.float()?;
                    self.comma()?;
                    p.expand_thresholds[1] = self.float()?;
                }
                "radius" => {
                    // Any of the four may be left out: `radius , 0.5`.
                    for (i, value) in [(0, 0.0), (1, 1.0), (2, 0.0), (3, 1.0)] {
                        p.radius[i] = if self.at_float()? { self.float()? } else { value };
                        if !self.accept(",")? {
                            break;
                        }
                    }
                }
                _ => self.no_map_file(word, "photons")?,
            }
        }
        self.scene.settings.photons = Some(p);
        Ok(())
    }

    fn subsurface(&mut self) -> Parse<()> {
        self.expect("{")?;
        let mut s = Subsurface::default();
        while !self.accept("}")? {
            match self.accept_any(&["samples", "radiosity"])? {
                Some("samples") => {
                    s.samples[0] = self.float()?.clamp(0.0, 1e6) as u32;
                    self.comma()?;
                    s.samples[1] = self.float()?.clamp(0.0, 1e6) as u32;
                }
                Some(_) => s.radiosity = self.flag()?,
                None => return Err(self.unexpected("subsurface")),
            }
        }
        self.scene.settings.subsurface = Some(s);
        Ok(())
    }

    /// Takes a comma and says whether a number follows; numbers may also follow without one.
    fn second(&mut self) -> Parse<bool> {
        self.comma()?;
        self.at_float()
    }

    /// `save_file` and `load_file`: maps are computed anew.
    fn no_map_file(&mut self, word: &str, what: &str) -> Parse<()> {
        let span = self.span();
        self.string()?;
        self.loss(span, format!("{word} of {what}"), "the map is computed anew and not saved");
        Ok(())
    }
}
