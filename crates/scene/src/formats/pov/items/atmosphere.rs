//! `fog`, `sky_sphere`, `rainbow`, `background`.

use std::sync::Arc;

use glam::DVec3;

use super::super::value::Value;
use super::super::{Parse, Parser, Token};
use crate::desc::classic::{Fog, Rainbow, SkySphere};

const FOG: &[&str] = &["fog_type", "distance", "turbulence", "turb_depth", "omega", "lambda", "octaves", "fog_offset", "fog_alt", "up"];

const RAINBOW: &[&str] = &["direction", "angle", "width", "distance", "jitter", "up", "arc_angle", "falloff_angle"];

impl Parser {
    /// `fog { … }`.
    pub(crate) fn fog(&mut self) -> Parse<Fog> {
        self.expect("fog")?;
        self.expect("{")?;
        let span = self.span();
        let start = self.accept_value(|v| if let Value::Fog(f) = v { Some(f.clone()) } else { None })?;
        let mut fog = start.map(Arc::unwrap_or_clone).unwrap_or_default();
        while !self.accept("}")? {
            match self.accept_any(FOG)? {
                Some("fog_type") => fog.kind = self.float()?.clamp(0.0, 255.0) as u8,
                Some("distance") => fog.distance = self.float()?,
                Some("turbulence") => fog.turbulence = self.vector3()?,
                Some("turb_depth") => fog.turb_depth = self.float()?,
                Some("omega") => fog.octaves.omega = self.float()?,
                Some("lambda") => fog.octaves.lambda = self.float()?,
                Some("octaves") => fog.octaves.octaves = self.float()?.clamp(1.0, 10.0) as u32,
                Some("fog_offset") => fog.offset = self.float()?,
                Some("fog_alt") => fog.altitude = self.float()?,
                Some(_) => fog.up = self.vector3()?.normalize_or(DVec3::Y),
                None => {
                    if let Some(m) = self.accept_transform()? {
                        fog.transform(&m);
                    } else {
                        fog.color = self.color()?;
                    }
                }
            }
        }
        if !(1..=2).contains(&fog.kind) {
            return Err(self.error(span, format!("there are fogs of type 1 and 2, not {}", fog.kind)));
        }
        Ok(fog)
    }

    /// `sky_sphere { … }`.
    pub(crate) fn sky_sphere(&mut self) -> Parse<SkySphere> {
        self.expect("sky_sphere")?;
        self.expect("{")?;
        let start = self.accept_value(|v| if let Value::SkySphere(s) = v { Some(s.clone()) } else { None })?;
        let mut sky = start.map(Arc::unwrap_or_clone).unwrap_or_default();
        while !self.accept("}")? {
            if let Some(m) = self.accept_transform()? {
                sky.transform(&m);
            } else if self.accept("emission")? {
                sky.emission = self.color()?.rgb;
            } else if matches!(self.peek()?, Token::Word("pigment")) {
                sky.pigments.push(Arc::new(self.pigment()?));
            } else {
                return Err(self.unexpected("a sky sphere"));
            }
        }
        Ok(sky)
    }

    /// `rainbow { … }`.
    pub(crate) fn rainbow(&mut self) -> Parse<Rainbow> {
        self.expect("rainbow")?;
        self.expect("{")?;
        let span = self.span();
        let start = self.accept_value(|v| if let Value::Rainbow(r) = v { Some(r.clone()) } else { None })?;
        let mut rainbow = start.map(Arc::unwrap_or_clone).unwrap_or_default();
        while !self.accept("}")? {
            match self.accept_any(RAINBOW)? {
                Some("direction") => rainbow.direction = self.vector3()?,
                Some("angle") => rainbow.angle = self.float()?,
                Some("width") => rainbow.width = self.float()?,
                Some("distance") => rainbow.distance = self.float()?,
                Some("jitter") => rainbow.jitter = self.float()?,
                Some("up") => rainbow.up = self.vector3()?,
                Some("arc_angle") => rainbow.arc_angle = self.float()?,
                Some(_) => rainbow.falloff_angle = self.float()?,
                None => {
                    if let Some(m) = self.accept_transform()? {
                        rainbow.transform(&m);
                    } else if matches!(self.peek()?, Token::Word("color_map" | "colour_map")) {
                        rainbow.colors = Some(Arc::new(self.color_map()?));
                    } else {
                        return Err(self.unexpected("a rainbow"));
                    }
                }
            }
        }
        if rainbow.direction.normalize_or_zero() == DVec3::ZERO || rainbow.colors.is_none() {
            self.warning(span, "a rainbow without direction or colors does not show");
        }
        Ok(rainbow)
    }

    /// `background { … }`, into the scene.
    pub(crate) fn background(&mut self) -> Parse<()> {
        self.expect("background")?;
        self.expect("{")?;
        let color = self.color()?;
        self.expect("}")?;
        self.scene.background = Some(color);
        Ok(())
    }
}
