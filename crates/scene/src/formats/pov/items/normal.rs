//! `normal`.

use std::sync::Arc;

use etendue_procedural::{Normal, NormalFill, PatternKind};

use super::super::{Parse, Parser};
use super::pattern::{DEPTH_LIMIT, change_kind, pick};

impl Parser {
    /// `normal { … }`.
    pub(crate) fn normal(&mut self) -> Parse<Normal> {
        let start = match self.default_texture().as_ref() {
            etendue_procedural::Texture::Layers(layers) => layers.first().and_then(|l| l.normal.clone()),
            etendue_procedural::Texture::Patterned(_) => None,
        };
        self.normal_onto(start)
    }

    /// `normal { … }` that changes an earlier normal.
    pub(super) fn normal_onto(&mut self, start: Option<Normal>) -> Parse<Normal> {
        self.expect("normal")?;
        self.expect("{")?;
        let normal = self.normal_body(start.unwrap_or_default())?;
        self.expect("}")?;
        Ok(normal)
    }

    /// What stands in a normal's braces, up to the closing brace or bracket.
    pub(super) fn normal_body(&mut self, start: Normal) -> Parse<Normal> {
        let span = self.span();
        let mut normal = start;
        let uv_mapping = self.accept("uv_mapping")? && self.flag()?;
        if let Some(copy) = self.accept_value(pick!(Normal))? {
            normal = Normal::clone(&copy);
        }
        normal.uv_mapping |= uv_mapping;
        while !self.at_end_of_body()? {
            if let Some(kind) = self.accept_pattern()? {
                self.normal_pattern(&mut normal, kind)?;
            } else if self.accept_pattern_modifier(&mut normal.pattern)? {
            } else if !self.normal_item(&mut normal)? {
                return Err(self.unexpected("a normal"));
            }
        }
        if normal.settle() > DEPTH_LIMIT {
            return Err(self.error(span, format!("more than {DEPTH_LIMIT} normals inside of one another")));
        }
        Ok(normal)
    }

    fn normal_item(&mut self, normal: &mut Normal) -> Parse<bool> {
        match self.peek_word()? {
            Some("normal_map") => {
                let weighted = matches!(normal.pattern.kind, PatternKind::Average);
                normal.fill = NormalFill::Normals(self.shared_normal_map(weighted)?);
            }
            Some("slope_map") => normal.fill = NormalFill::Slopes(self.shared_slope_map()?),
            Some("bump_map") => {
                self.next()?;
                let (image, size) = self.bump_map_block()?;
                normal.pattern.kind = PatternKind::None;
                normal.fill = NormalFill::Bump(image);
                normal.amount = size.unwrap_or(normal.amount);
                self.amount(normal)?;
            }
            Some("bump_size") => {
                self.next()?;
                normal.amount = self.float()?;
            }
            Some("accuracy") => {
                self.next()?;
                normal.accuracy = self.float()?;
            }
            Some("no_bump_scale") => {
                self.next()?;
                normal.no_bump_scale = self.flag()?;
            }
            Some("uv_mapping") => {
                self.next()?;
                normal.uv_mapping = self.flag()?;
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// The optional depth, and a block pattern's list of normals; for `object` the closing brace.
    fn normal_pattern(&mut self, normal: &mut Normal, kind: PatternKind) -> Parse<()> {
        let is_object = matches!(kind, PatternKind::Object(_));
        let count = kind.blocks().unwrap_or(0);
        change_kind(&mut normal.pattern, kind);
        normal.fill = NormalFill::Pattern;
        let mut list = Vec::new();
        while list.len() < count {
            self.comma()?;
            if self.peek_word()? != Some("normal") {
                break;
            }
            list.push(self.normal()?);
        }
        if is_object {
            self.expect("}")?;
        }
        if list.is_empty() {
            self.amount(normal)?;
        } else {
            list.resize(count, Normal::default());
            normal.fill = NormalFill::List(Arc::new(list));
        }
        Ok(())
    }

    fn amount(&mut self, normal: &mut Normal) -> Parse<()> {
        self.comma()?;
        if self.at_float()? {
            normal.amount = self.float()?;
        }
        Ok(())
    }
}
