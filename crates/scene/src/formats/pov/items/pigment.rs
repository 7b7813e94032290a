//! `pigment` and `density`.

use std::sync::Arc;

use etendue_procedural::{BlendMap, Color, Pattern, PatternKind, PatternedPigment, Pigment, PigmentFill, Texture};

use super::super::{Parse, Parser};
use super::pattern::{COLOR_WORDS, DEPTH_LIMIT, change_kind, pick};

impl Parser {
    /// `pigment { … }`; begins with the default texture's pigment unless an identifier starts the block.
    pub(crate) fn pigment(&mut self) -> Parse<Pigment> {
        self.pigment_onto(None)
    }

    /// `pigment { … }` that changes an earlier pigment; `None` for the default texture's.
    pub(super) fn pigment_onto(&mut self, start: Option<Pigment>) -> Parse<Pigment> {
        self.expect("pigment")?;
        self.expect("{")?;
        let pigment = self.pigment_body(start)?;
        self.expect("}")?;
        Ok(pigment)
    }

    /// `density { … }` of media: a pigment whose default map runs from black to white.
    pub(crate) fn density(&mut self) -> Parse<Pigment> {
        self.expect("density")?;
        self.expect("{")?;
        let pigment = self.density_body()?;
        self.expect("}")?;
        Ok(pigment)
    }

    pub(super) fn density_body(&mut self) -> Parse<Pigment> {
        let mut pigment = self.pigment_body(Some(Pigment::Solid(Color::rgb(1.0, 1.0, 1.0))))?;
        if let Pigment::Patterned(patterned) = &mut pigment
            && matches!(patterned.fill, PigmentFill::Default)
            && patterned.pattern.kind.blocks().is_none()
        {
            let ends = [0.0, 1.0].map(|v| (v, Color::rgb(v, v, v)));
            patterned.fill = PigmentFill::Colors(Arc::new(BlendMap { entries: ends.to_vec() }));
        }
        Ok(pigment)
    }

    /// What stands in a pigment's braces, up to the closing brace or bracket. `start` is what it changes; `None` for the default
    /// texture's pigment.
    pub(super) fn pigment_body(&mut self, start: Option<Pigment>) -> Parse<Pigment> {
        let start = start.unwrap_or_else(|| match self.default_texture().as_ref() {
            Texture::Layers(layers) => layers.first().map(|l| l.pigment.clone()).unwrap_or_default(),
            Texture::Patterned(_) => Pigment::default(),
        });
        let span = self.span();
        let mut draft = Draft::from(start);
        let mut uv_mapping = self.accept("uv_mapping")? && self.flag()?;
        if let Some(copy) = self.accept_value(pick!(Pigment))? {
            draft = Draft::from(Pigment::clone(&copy));
        }
        while !self.at_end_of_body()? {
            if let Some(kind) = self.accept_pattern()? {
                self.pigment_pattern(&mut draft, kind)?;
            } else if self.accept_pattern_modifier(&mut draft.patterned.pattern)? {
            } else if !self.pigment_item(&mut draft, &mut uv_mapping)? {
                return Err(self.unexpected("a pigment"));
            }
        }
        let mut pigment = draft.finish(uv_mapping);
        if pigment.settle() > DEPTH_LIMIT {
            return Err(self.error(span, format!("more than {DEPTH_LIMIT} pigments inside of one another")));
        }
        Ok(pigment)
    }

    fn pigment_item(&mut self, draft: &mut Draft, uv_mapping: &mut bool) -> Parse<bool> {
        let word = self.peek_word()?;
        match word {
            Some("color_map") => {
                draft.solid = None;
                draft.patterned.fill = PigmentFill::Colors(self.shared_color_map()?);
            }
            Some("pigment_map" | "density_map") => {
                draft.solid = None;
                let weighted = matches!(draft.patterned.pattern.kind, PatternKind::Average);
                draft.patterned.fill = PigmentFill::Pigments(self.shared_pigment_map(weighted)?);
            }
            Some("image_map") => {
                self.next()?;
                let image = self.image_map_block(false)?;
                draft.solid = None;
                draft.patterned.pattern.kind = PatternKind::None;
                draft.patterned.fill = PigmentFill::Image(image);
            }
            Some("quick_color") => {
                self.next()?;
                draft.patterned.quick_color = Some(self.color()?);
            }
            Some("uv_mapping") => {
                self.next()?;
                *uv_mapping = self.flag()?;
            }
            _ if word.is_some_and(|w| COLOR_WORDS.contains(&w)) || self.at_float()? => draft.solid = Some(self.color()?),
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// A pattern's list of colors or pigments, for block patterns, and for `object` the closing brace.
    fn pigment_pattern(&mut self, draft: &mut Draft, kind: PatternKind) -> Parse<()> {
        let is_object = matches!(kind, PatternKind::Object(_));
        let count = kind.blocks().unwrap_or(0);
        change_kind(&mut draft.patterned.pattern, kind);
        draft.solid = None;
        draft.patterned.fill = PigmentFill::Default;
        let mut list = Vec::new();
        while list.len() < count {
            self.comma()?;
            let word = self.peek_word()?;
            if matches!(word, Some("pigment" | "density")) {
                list.push(if word == Some("density") { self.density()? } else { self.pigment()? });
            } else if word.is_some_and(|w| COLOR_WORDS.contains(&w)) || self.at_float()? {
                list.push(Pigment::Solid(self.color()?));
            } else {
                break;
            }
        }
        if is_object {
            self.expect("}")?;
        }
        if !list.is_empty() {
            let own = etendue_procedural::pigment::block_colors(&draft.patterned.pattern.kind);
            list.extend(own.into_iter().skip(list.len()).map(Pigment::Solid));
            draft.patterned.fill = PigmentFill::List(Arc::new(list));
        }
        Ok(())
    }
}

/// A pigment in the making: a color takes the place of the pattern, and a pattern that of the color.
struct Draft {
    solid: Option<Color>,
    patterned: PatternedPigment,
}

impl From<Pigment> for Draft {
    fn from(pigment: Pigment) -> Self {
        match pigment {
            Pigment::Solid(color) => Self { solid: Some(color), patterned: PatternedPigment::new(Pattern::default()) },
            Pigment::Patterned(patterned) => Self { solid: None, patterned: *patterned },
        }
    }
}

impl Draft {
    fn finish(mut self, uv_mapping: bool) -> Pigment {
        self.patterned.uv_mapping |= uv_mapping;
        match self.solid {
            Some(color) if self.patterned.quick_color.is_none() => Pigment::Solid(color),
            Some(color) => {
                self.patterned.pattern = Pattern::default();
                self.patterned.fill = PigmentFill::Colors(Arc::new(BlendMap { entries: vec![(0.0, color)] }));
                Pigment::Patterned(Box::new(self.patterned))
            }
            None => Pigment::Patterned(Box::new(self.patterned)),
        }
    }
}
