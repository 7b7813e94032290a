//! `light_source`, `light_group`.

use std::sync::Arc;

use glam::DMat4;

use super::super::value::Value;
use super::super::{Parse, Parser, Token};
use super::object::OBJECT_WORDS;
use crate::desc::classic::{AreaLight, Light, LightGroup, LightKind, Object, Solid};

const WORDS: &[&str] = &[
    "spotlight",
    "cylinder",
    "shadowless",
    "parallel",
    "radius",
    "falloff",
    "tightness",
    "point_at",
    "area_light",
    "adaptive",
    "area_illumination",
    "jitter",
    "circular",
    "orient",
    "fade_distance",
    "fade_power",
    "media_attenuation",
    "media_interaction",
    "atmosphere",
    "atmospheric_attenuation",
    "track",
    "colour",
    "color",
];

impl Parser {
    /// `light_source { … }`, as an object of [`crate::desc::classic::Solid::Light`] (a union with it, where it `looks_like` something).
    pub(crate) fn light_source(&mut self) -> Parse<Object> {
        let span = self.span();
        self.expect("light_source")?;
        self.expect("{")?;
        let start = self.accept_value(|v| match v {
            Value::Object(o) if light_of(o).is_some() => Some(o.clone()),
            _ => None,
        })?;
        let (mut light, mut looks) = match &start {
            Some(object) => {
                let mut light = light_of(object).cloned().unwrap_or_default();
                light.group = 0;
                (light, parts_beside_light(object))
            }
            None => {
                let location = self.vector3()?;
                self.comma()?;
                let mut light = Light::new(location, glam::DVec3::ZERO);
                light.color = self.color()?.rgb;
                (light, Vec::new())
            }
        };
        // `adaptive`, `jitter` … may stand before `area_light`.
        let mut area = light.area.unwrap_or(AreaLight {
            axis1: glam::DVec3::ZERO,
            axis2: glam::DVec3::ZERO,
            size: [0, 0],
            adaptive: None,
            jitter: false,
            circular: false,
            orient: false,
            illumination: false,
        });
        let mut cone_given = start.is_some();
        while !self.accept("}")? {
            if let Some(word) = self.accept_any(WORDS)? {
                self.light_word(word, &mut light, &mut area, &mut cone_given)?;
            } else if let Some(m) = self.accept_transform()? {
                let mut axes = light.clone();
                axes.area = Some(area);
                axes.transform(&m);
                area = axes.area.unwrap_or(area);
                light = axes;
                for object in &mut looks {
                    Arc::make_mut(object).transform(&m);
                }
            } else if self.accept("looks_like")? {
                let at = DMat4::from_translation(light.location);
                let mut object = self.braced_object()?;
                object.transform(&at);
                object.no_shadow = true;
                looks.push(Arc::new(object));
            } else if self.accept("projected_through")? {
                light.projected_through = Some(Arc::new(self.braced_object()?));
            } else if self.accept("photons")? {
                self.light_photons(&mut light)?;
            } else {
                return Err(self.unexpected("a light source"));
            }
        }
        light.area = (area.size[0] * area.size[1] > 1).then_some(area);
        let light_span = span;
        if !(light.location.is_finite() && light.color.is_finite()) {
            return Err(self.error(light_span, "the place or the color of a light is not finite"));
        }
        let object = Object::new(span, Solid::Light(Box::new(light)));
        if looks.is_empty() {
            return Ok(object);
        }
        let mut parts = vec![Arc::new(object)];
        parts.extend(looks);
        Ok(Object::new(span, Solid::Union(parts)))
    }

    fn light_word(&mut self, word: &str, light: &mut Light, area: &mut AreaLight, cone_given: &mut bool) -> Parse<()> {
        match word {
            "spotlight" => light.kind = LightKind::Spot,
            "cylinder" => {
                light.kind = LightKind::Cylinder;
                if !*cone_given {
                    [light.radius, light.falloff] = [0.75, 1.0];
                }
            }
            "shadowless" => light.shadowless = true,
            "parallel" => light.parallel = true,
            "radius" => {
                light.radius = self.float()?;
                *cone_given = true;
            }
            "falloff" => {
                light.falloff = self.float()?;
                *cone_given = true;
            }
            "tightness" => light.tightness = self.float()?,
            "point_at" => light.point_at = self.vector3()?,
            "area_light" => {
                area.axis1 = self.vector3()?;
                self.comma()?;
                area.axis2 = self.vector3()?;
                self.comma()?;
                let span = self.span();
                let first = self.float()?;
                self.comma()?;
                let second = self.float()?;
                if !(first * second <= 1e6) {
                    return Err(self.error(span, "an area light has at most a million points"));
                }
                area.size = [first.max(1.0) as u32, second.max(1.0) as u32];
            }
            "adaptive" => area.adaptive = Some(self.float()?.clamp(0.0, 20.0) as u32),
            "area_illumination" => area.illumination = self.flag()?,
            "jitter" => area.jitter = true,
            "circular" => area.circular = true,
            "orient" => area.orient = true,
            "fade_distance" => light.fade_distance = self.float()?,
            "fade_power" => light.fade_power = self.float()?,
            "media_attenuation" | "atmospheric_attenuation" => light.media_attenuation = self.flag()?,
            "media_interaction" | "atmosphere" => light.media_interaction = self.flag()?,
            "track" => {}
            _ => light.color = self.color()?.rgb,
        }
        Ok(())
    }

    fn light_photons(&mut self, light: &mut Light) -> Parse<()> {
        self.expect("{")?;
        while !self.accept("}")? {
            match self.accept_any(&["reflection", "refraction", "area_light"])? {
                Some("reflection") => light.photon_reflection = Some(self.flag()?),
                Some("refraction") => light.photon_refraction = Some(self.flag()?),
                Some(_) => light.photon_area = self.flag()?,
                None => return Err(self.unexpected("photons of a light source")),
            }
        }
        Ok(())
    }

    /// `{ OBJECT }`, where the object may be an identifier alone, followed by modifiers.
    fn braced_object(&mut self) -> Parse<Object> {
        self.expect("{")?;
        let named = self.accept_value(|v| if let Value::Object(o) = v { Some((**o).clone()) } else { None })?;
        let mut object = match named {
            Some(object) => object,
            None => self.object()?,
        };
        while !self.accept("}")? {
            match self.accept_transform()? {
                Some(m) => object.transform(&m),
                None => return Err(self.unexpected("an object in braces")),
            }
        }
        Ok(object)
    }

    /// `light_group { … }`: a union with a light group number of its own.
    pub(crate) fn light_group(&mut self) -> Parse<Object> {
        let span = self.span();
        self.expect("light_group")?;
        self.expect("{")?;
        let mut parts = Vec::new();
        let mut global_lights = false;
        let mut transform = DMat4::IDENTITY;
        while !self.accept("}")? {
            if self.accept("global_lights")? {
                global_lights = self.flag()?;
            } else if let Some(m) = self.accept_transform()? {
                transform = m * transform;
            } else {
                let is_object = match self.peek()? {
                    Token::Word(w) => OBJECT_WORDS.contains(w),
                    Token::Identifier(_, Value::Object(_)) => true,
                    _ => false,
                };
                if !is_object {
                    return Err(self.unexpected("a light group"));
                }
                parts.push(Arc::new(self.object()?));
            }
        }
        // The nearest group around a part is the one that lights it; outer groups are found through its parent.
        let groups = &mut self.scene.light_groups;
        groups.push(LightGroup { parent: 0, global_lights });
        let number = groups.len() as u32;
        let mut group = Object::new(span, Solid::Union(parts));
        assign(&mut group, number, groups);
        if transform != DMat4::IDENTITY {
            group.transform(&transform);
        }
        Ok(group)
    }
}

/// Puts an object and its parts into a group; parts that have one already become members of a group within.
fn assign(object: &mut Object, number: u32, groups: &mut [LightGroup]) {
    if object.light_group != 0 {
        if let Some(inner) = groups.get_mut(object.light_group as usize - 1)
            && object.light_group != number
            && inner.parent == 0
        {
            inner.parent = number;
        }
        return;
    }
    object.light_group = number;
    match &mut object.solid {
        Solid::Light(light) => light.group = number,
        Solid::Union(parts) => parts.iter_mut().for_each(|p| assign(Arc::make_mut(p), number, groups)),
        _ => {}
    }
}

/// The light of a light source's object.
fn light_of(object: &Object) -> Option<&Light> {
    match &object.solid {
        Solid::Light(light) => Some(light),
        Solid::Union(parts) => parts.first().and_then(|p| if let Solid::Light(l) = &p.solid { Some(&**l) } else { None }),
        _ => None,
    }
}

/// What a light source looks like.
fn parts_beside_light(object: &Object) -> Vec<Arc<Object>> {
    match &object.solid {
        Solid::Union(parts) => parts.iter().filter(|p| !matches!(p.solid, Solid::Light(_))).cloned().collect(),
        _ => Vec::new(),
    }
}
