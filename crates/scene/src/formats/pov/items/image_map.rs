//! `image_map`, `image_pattern`, `bump_map` and `material_map`: pictures and the way they are mapped.

use etendue_procedural::ImageMap;
use etendue_procedural::image_map::{Channel, Interpolation, Projection};

use super::super::{Parse, Parser, Token};
use crate::desc::classic::{ImageContent, ImageGamma};

/// Most palette entries that may be given a transparency.
const PALETTE_LIMIT: usize = 65_536;

const FILE_TYPES: &[&str] = &["exr", "gif", "hdr", "iff", "jpeg", "pgm", "png", "pot", "ppm", "sys", "tga", "tiff"];

impl Parser {
    /// The block after `image_map` or, with `is_data`, `image_pattern`.
    pub(super) fn image_map_block(&mut self, is_data: bool) -> Parse<ImageMap> {
        self.expect("{")?;
        let (map, _) = self.image_map_items(is_data)?;
        self.expect("}")?;
        Ok(map)
    }

    /// The block after `bump_map`, with its `bump_size`.
    pub(super) fn bump_map_block(&mut self) -> Parse<(ImageMap, Option<f64>)> {
        self.expect("{")?;
        let items = self.image_map_items(true)?;
        self.expect("}")?;
        Ok(items)
    }

    /// The items of a bitmap of colors or data, up to what is none of them.
    pub(super) fn image_map_items(&mut self, is_data: bool) -> Parse<(ImageMap, Option<f64>)> {
        // The version at the place of the picture counts (measured).
        let content = match self.version() {
            _ if is_data => ImageContent::Data,
            ..370 => ImageContent::OldColors,
            _ => ImageContent::Colors,
        };
        let mut map = ImageMap::new(0);
        let (mut found, mut bump_size) = (false, None);
        let start = self.span();
        loop {
            if self.accept_any(FILE_TYPES)?.is_some() || matches!(self.peek()?, Token::Text(_)) {
                map.image = self.image_file(content)?;
                found = true;
                continue;
            }
            match self.peek_word()? {
                Some("map_type") => {
                    self.next()?;
                    map.projection = match self.float()? as i64 {
                        1 => Projection::Spherical,
                        2 => Projection::Cylindrical,
                        5 => Projection::Toroidal,
                        7 => Projection::Angular,
                        _ => Projection::Planar,
                    };
                }
                Some("interpolate") => {
                    self.next()?;
                    map.interpolation = match self.float()? as i64 {
                        2 => Interpolation::Bilinear,
                        3 => Interpolation::Bicubic,
                        4 => Interpolation::NormalizedDistance,
                        _ => Interpolation::None,
                    };
                }
                Some("once") => {
                    self.next()?;
                    map.once = self.flag()?;
                }
                Some("use_color") => {
                    self.next()?;
                    map.channel = Channel::Gray;
                }
                Some("use_index") => {
                    self.next()?;
                    map.channel = Channel::Index;
                }
                Some("use_alpha") => {
                    self.next()?;
                    map.channel = Channel::Alpha;
                }
                Some("bump_size") => {
                    self.next()?;
                    bump_size = Some(self.float()?);
                }
                Some(word @ ("filter" | "transmit")) => {
                    self.next()?;
                    self.image_transparency(word, &mut map)?;
                }
                Some("function") => {
                    return Err(self.error(start, "pictures made by a function are not supported yet"));
                }
                _ => break,
            }
        }
        if !found {
            return Err(self.unexpected("a picture, which needs a file name"));
        }
        map.transparency.filter.sort_by_key(|e| e.0);
        map.transparency.transmit.sort_by_key(|e| e.0);
        Ok((map, bump_size))
    }

    fn image_file(&mut self, content: ImageContent) -> Parse<etendue_procedural::ImageId> {
        let span = self.span();
        let name = self.string()?;
        let options = self.image_options()?;
        self.image(&name, span, content, options)
    }

    /// `gamma` and `premultiplied` after the name of a picture.
    pub(super) fn image_options(&mut self) -> Parse<(Option<ImageGamma>, Option<bool>)> {
        let (mut gamma, mut premultiplied) = (None, None);
        while let Some(word) = self.accept_any(&["gamma", "premultiplied"])? {
            match word {
                "gamma" => gamma = Some(if self.accept("srgb")? { ImageGamma::Srgb } else { ImageGamma::Power(self.float()?) }),
                _ => premultiplied = Some(self.flag()?),
            }
        }
        Ok((gamma, premultiplied))
    }

    /// What follows `filter` or `transmit`: `all` or a palette index, and the amount.
    fn image_transparency(&mut self, word: &str, map: &mut ImageMap) -> Parse<()> {
        let t = &mut map.transparency;
        let (all, some) = if word == "filter" { (&mut t.filter_all, &mut t.filter) } else { (&mut t.transmit_all, &mut t.transmit) };
        if self.accept("all")? {
            *all = Some(self.float()?);
            return Ok(());
        }
        let span = self.span();
        let index = self.float()?.clamp(0.0, f64::from(u32::MAX)) as u32;
        self.comma()?;
        some.push((index, self.float()?));
        if some.len() > PALETTE_LIMIT {
            return Err(self.error(span, "too many palette entries"));
        }
        Ok(())
    }
}
