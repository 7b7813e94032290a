//! `color_map`, `pigment_map`, `normal_map`, `texture_map`, `slope_map`, `density_map`.

use std::sync::Arc;

use etendue_procedural::{BlendMap, Color, Normal, Pigment, Texture};

use super::super::{Parse, Parser, Token};
use super::pattern::{COLOR_WORDS, narrow, pick};

/// Most entries of a map. POV-Ray has 256; more do no harm.
const ENTRIES_LIMIT: usize = 65_536;

impl Parser {
    /// `color_map { … }`.
    pub(crate) fn color_map(&mut self) -> Parse<BlendMap<Color>> {
        self.shared_color_map().map(Arc::unwrap_or_clone)
    }

    /// `pigment_map { … }` or `density_map { … }`.
    pub(crate) fn pigment_map(&mut self) -> Parse<BlendMap<Pigment>> {
        self.shared_pigment_map(false).map(Arc::unwrap_or_clone)
    }

    /// `normal_map { … }`.
    pub(crate) fn normal_map(&mut self) -> Parse<BlendMap<Normal>> {
        self.shared_normal_map(false).map(Arc::unwrap_or_clone)
    }

    /// `texture_map { … }`.
    pub(crate) fn texture_map(&mut self) -> Parse<BlendMap<Texture>> {
        self.shared_texture_map(false).map(Arc::unwrap_or_clone)
    }

    /// `slope_map { … }`.
    pub(crate) fn slope_map(&mut self) -> Parse<BlendMap<(f64, f64)>> {
        self.shared_slope_map().map(Arc::unwrap_or_clone)
    }

    pub(super) fn shared_color_map(&mut self) -> Parse<Arc<BlendMap<Color>>> {
        self.expect("color_map")?;
        self.expect("{")?;
        let map = match self.accept_value(pick!(ColorMap))? {
            Some(map) => map,
            None => {
                let mut entries = Vec::new();
                while self.accept("[")? {
                    let place = narrow(self.float()?);
                    self.comma()?;
                    // `[a, b color A color B]`, the form of old scenes, stands for two entries.
                    if matches!(self.peek()?, Token::Number(_)) {
                        let second = self.num()?;
                        if self.at_end_of_body()? {
                            entries.push((place, second.color()));
                        } else {
                            self.comma()?;
                            entries.push((place, self.color()?));
                            self.comma()?;
                            entries.push((narrow(second.v[0]), self.color()?));
                        }
                    } else {
                        entries.push((place, self.color()?));
                    }
                    self.end_of_entry(entries.len())?;
                }
                self.blend_map(entries)?
            }
        };
        self.expect("}")?;
        Ok(map)
    }

    /// A map of pigments; `weighted` for an `average`, where the number may be left out.
    pub(super) fn shared_pigment_map(&mut self, weighted: bool) -> Parse<Arc<BlendMap<Pigment>>> {
        let is_density = self.peek_word()? == Some("density_map");
        self.expect(if is_density { "density_map" } else { "pigment_map" })?;
        self.expect("{")?;
        let map = match self.accept_value(pick!(PigmentMap))? {
            Some(map) => map,
            None => {
                let mut entries = Vec::new();
                while self.accept("[")? {
                    let place = self.place(weighted)?;
                    let pigment = if is_density { self.density_body()? } else { self.pigment_body(None)? };
                    entries.push((place, pigment));
                    self.end_of_entry(entries.len())?;
                }
                self.blend_map(entries)?
            }
        };
        self.expect("}")?;
        Ok(map)
    }

    /// A map of normals; `weighted` for an `average`.
    pub(super) fn shared_normal_map(&mut self, weighted: bool) -> Parse<Arc<BlendMap<Normal>>> {
        self.expect("normal_map")?;
        self.expect("{")?;
        let map = match self.accept_value(pick!(NormalMap))? {
            Some(map) => map,
            None => {
                let mut entries = Vec::new();
                while self.accept("[")? {
                    let place = self.place(weighted)?;
                    entries.push((place, self.normal_body(Normal::default())?));
                    self.end_of_entry(entries.len())?;
                }
                self.blend_map(entries)?
            }
        };
        self.expect("}")?;
        Ok(map)
    }

    /// A map of textures; `weighted` for an `average`.
    pub(super) fn shared_texture_map(&mut self, weighted: bool) -> Parse<Arc<BlendMap<Texture>>> {
        self.expect("texture_map")?;
        self.expect("{")?;
        let map = match self.accept_value(pick!(TextureMap))? {
            Some(map) => map,
            None => {
                let mut entries = Vec::new();
                while self.accept("[")? {
                    let place = self.place(weighted)?;
                    let texture = if self.peek_word()? == Some("texture") { self.texture()? } else { self.texture_body()? };
                    entries.push((place, texture));
                    self.end_of_entry(entries.len())?;
                }
                self.blend_map(entries)?
            }
        };
        self.expect("}")?;
        Ok(map)
    }

    /// A map of heights and slopes.
    pub(super) fn shared_slope_map(&mut self) -> Parse<Arc<BlendMap<(f64, f64)>>> {
        self.expect("slope_map")?;
        self.expect("{")?;
        let map = match self.accept_value(pick!(SlopeMap))? {
            Some(map) => map,
            None => {
                let mut entries = Vec::new();
                while self.accept("[")? {
                    let place = narrow(self.float()?);
                    self.comma()?;
                    entries.push((place, self.vector2()?.into()));
                    self.end_of_entry(entries.len())?;
                }
                self.blend_map(entries)?
            }
        };
        self.expect("}")?;
        Ok(map)
    }

    /// The number of an entry; 1 where it is left out in an `average`.
    fn place(&mut self, weighted: bool) -> Parse<f64> {
        let color_follows = self.peek_word()?.is_some_and(|w| COLOR_WORDS.contains(&w));
        if weighted && (color_follows || !self.at_float()?) {
            return Ok(1.0);
        }
        let place = narrow(self.float()?);
        self.comma()?;
        Ok(place)
    }

    fn end_of_entry(&mut self, count: usize) -> Parse<()> {
        let span = self.span();
        self.expect("]")?;
        self.comma()?;
        if count > ENTRIES_LIMIT {
            return Err(self.error(span, format!("a map may have at most {ENTRIES_LIMIT} entries")));
        }
        Ok(())
    }

    fn blend_map<T>(&mut self, entries: Vec<(f64, T)>) -> Parse<Arc<BlendMap<T>>> {
        if entries.is_empty() {
            return Err(self.unexpected("a map, which needs entries in brackets"));
        }
        Ok(Arc::new(BlendMap { entries }))
    }
}
