//! `finish`.

use std::sync::Arc;

use etendue_procedural::finish::{Finish, Irid, Reflection};
use glam::DVec3;

use super::super::{Parse, Parser};
use super::pattern::pick;

impl Parser {
    /// `finish { … }`; begins with the default texture's finish unless an identifier starts the block.
    pub(crate) fn finish(&mut self) -> Parse<Finish> {
        let start = match self.default_texture().as_ref() {
            etendue_procedural::Texture::Layers(layers) => layers.first().map(|l| l.finish.clone()).unwrap_or_default(),
            etendue_procedural::Texture::Patterned(_) => Arc::default(),
        };
        self.finish_onto(Finish::clone(&start))
    }

    /// `finish { … }` that changes an earlier finish.
    pub(super) fn finish_onto(&mut self, start: Finish) -> Parse<Finish> {
        self.expect("finish")?;
        self.expect("{")?;
        let mut finish = start;
        loop {
            if let Some(copy) = self.accept_value(pick!(Finish))? {
                finish = Finish::clone(&copy);
            } else if !self.finish_item(&mut finish)? {
                break;
            }
            self.comma()?;
        }
        if !self.accept("}")? {
            return Err(self.unexpected("a finish"));
        }
        Ok(finish)
    }

    fn finish_item(&mut self, f: &mut Finish) -> Parse<bool> {
        let Some(word) = self.peek_word()? else { return Ok(false) };
        if !matches!(
            word,
            "ambient"
                | "emission"
                | "diffuse"
                | "brilliance"
                | "crand"
                | "phong"
                | "phong_size"
                | "specular"
                | "roughness"
                | "metallic"
                | "reflection"
                | "reflection_exponent"
                | "conserve_energy"
                | "irid"
                | "subsurface"
                | "use_alpha"
                | "ior"
                | "refraction"
                | "caustics"
                | "fade_distance"
                | "fade_power"
        ) {
            return Ok(false);
        }
        let span = self.span();
        self.next()?;
        match word {
            "ambient" => f.ambient = self.rgb_color()?,
            "emission" => f.emission = self.rgb_color()?,
            "diffuse" => {
                f.diffuse_albedo = self.accept("albedo")?;
                f.diffuse = self.float()?;
                if self.accept(",")? {
                    f.diffuse_back = self.float()?;
                }
            }
            "brilliance" => f.brilliance = self.float()?,
            "crand" => f.crand = self.float()?,
            "phong" => {
                f.phong_albedo = self.accept("albedo")?;
                f.phong = self.float()?;
            }
            "phong_size" => f.phong_size = self.float()?,
            "specular" => {
                f.specular_albedo = self.accept("albedo")?;
                f.specular = self.float()?;
            }
            "roughness" => {
                f.roughness = self.float()?;
                if f.roughness == 0.0 || f.roughness.is_nan() {
                    self.warning(span, "`roughness` 0 is taken for 0.0001");
                    f.roughness = 1e-4;
                }
            }
            "metallic" => f.metallic = if self.at_float()? { self.float()? } else { 1.0 },
            "reflection" => {
                if self.accept("{")? {
                    f.reflection = self.reflection()?;
                } else {
                    let color = self.rgb_color()?;
                    // An exponent that was said before stays.
                    f.reflection = Reflection { min: color, max: color, exponent: f.reflection.exponent, ..Reflection::default() };
                }
            }
            "reflection_exponent" => f.reflection.exponent = self.float()?,
            "conserve_energy" => f.conserve_energy = self.flag()?,
            "irid" => f.irid = Some(self.irid()?),
            "subsurface" => {
                self.expect("{")?;
                if self.accept("translucency")? {
                    f.translucency = Some(self.rgb_color()?);
                }
                self.expect("}")?;
            }
            "use_alpha" => f.use_alpha = self.flag()?,
            "ior" => f.old_interior.ior = Some(self.float()?),
            "refraction" => f.old_interior.refraction = Some(self.float()?),
            "caustics" => f.old_interior.caustics = Some(self.float()?),
            "fade_distance" => f.old_interior.fade_distance = Some(self.float()?),
            // The last of the words above: `fade_power`.
            _ => f.old_interior.fade_power = Some(self.float()?),
        }
        Ok(true)
    }

    fn rgb_color(&mut self) -> Parse<DVec3> {
        Ok(self.color()?.rgb)
    }

    /// The inside of `reflection { … }` with its closing brace.
    fn reflection(&mut self) -> Parse<Reflection> {
        let first = self.rgb_color()?;
        self.comma()?;
        let mut r = Reflection { min: first, max: first, ..Reflection::default() };
        let mut two = false;
        loop {
            match self.accept_any(&["fresnel", "falloff", "exponent", "metallic"])? {
                Some("fresnel") => r.fresnel = self.flag()?,
                Some("falloff") => r.falloff = self.float()?,
                Some("exponent") => r.exponent = self.float()?,
                Some(_) => r.metallic = if self.at_float()? { self.float()? } else { 1.0 },
                None => {
                    if self.accept("}")? {
                        break;
                    }
                    if two {
                        return Err(self.unexpected("a reflection"));
                    }
                    r.max = self.rgb_color()?;
                    two = true;
                }
            }
            self.comma()?;
        }
        // A Fresnel mirror with one color goes from nothing to it.
        if r.fresnel && !two {
            r.min = DVec3::ZERO;
        }
        Ok(r)
    }

    fn irid(&mut self) -> Parse<Irid> {
        self.expect("{")?;
        let mut irid = Irid { amount: self.float()?, ..Irid::default() };
        while let Some(word) = self.accept_any(&["thickness", "turbulence"])? {
            match word {
                "thickness" => irid.thickness = self.float()?,
                _ => irid.turbulence = self.float()?,
            }
        }
        self.expect("}")?;
        Ok(irid)
    }
}
