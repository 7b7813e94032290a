//! `image_map`, `image_pattern`, `bump_map` and `material_map`: pictures and the way they are mapped.

use std::sync::Arc;

use etendue_procedural::image_map::{Channel, Interpolation, Projection};
use etendue_procedural::{Color, ImageId, ImageMap};

use super::super::{Parse, Parser, Token};
use super::solids_large::height_level;
use crate::desc::classic::{ClassicImage, ImageContent, ImageGamma, ImageSource};

/// Most palette entries that may be given a transparency.
const PALETTE_LIMIT: usize = 65_536;

/// Most pixels of a picture that a function makes.
const PIXEL_LIMIT: f64 = 16_777_216.0;

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
                    map.image = self.image_function(content)?;
                    found = true;
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

    fn image_file(&mut self, content: ImageContent) -> Parse<ImageId> {
        let span = self.span();
        let name = self.string()?;
        let options = self.image_options()?;
        self.image(&name, span, content, options)
    }

    /// `function width, height { … }`: a picture of a function of x and y, both from 0 to 1 from the upper left pixel to the lower right
    /// one. Numbers are gray values, as in a height field of a function; pigments are colors without filter (both measured).
    fn image_function(&mut self, content: ImageContent) -> Parse<ImageId> {
        let span = self.span();
        self.expect("function")?;
        let width = self.float()?;
        self.comma()?;
        let height = self.float()?;
        self.comma()?;
        if !(width >= 1.0 && height >= 1.0 && width * height <= PIXEL_LIMIT) {
            return Err(self.error(span, format!("the function of a picture needs 1 by 1 to {PIXEL_LIMIT} samples in all")));
        }
        let function = self.function_body(["x", "y", "z"].map(String::from).to_vec())?;
        let probe = self.options.probe.clone();
        let context = self.context(probe.as_deref());
        let (width, height) = (width as u32, height as u32);
        let mut colors = Vec::with_capacity(width as usize * height as usize);
        let step = |i: u32, n: u32| f64::from(i) / f64::from(n.saturating_sub(1).max(1));
        for row in 0..height {
            for column in 0..width {
                let values = function.eval_vector(&[step(column, width), step(row, height), 0.0], &context);
                colors.push(match function.components() {
                    0..=2 => gray(height_level(values[0])),
                    _ => Color { transmit: values[4], ..Color::rgb(values[0], values[1], values[2]) },
                });
            }
            self.check_time()?;
        }
        let source = ImageSource::Made { width, colors: Arc::new(colors) };
        Ok(self.add_image(ClassicImage { source, span, gamma: None, content, premultiplied: None }))
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

fn gray(v: f64) -> Color {
    Color::rgb(v, v, v)
}
