//! `text`.

use std::path::Path;
use std::sync::Arc;

use super::super::fonts::{INTERNAL, installed, lay_out};
use super::super::{Parse, Parser};
use crate::desc::classic::Solid;
use crate::formats::Resolver;
use crate::span::Span;

impl Parser {
    pub(super) fn text(&mut self, span: Span) -> Parse<Solid> {
        let font = if self.accept("internal")? {
            let number = self.float()?;
            let name = INTERNAL.get(number as usize).copied().unwrap_or(INTERNAL[0]);
            self.font(name, span)?
        } else {
            self.accept("ttf")?;
            let at = self.span();
            let name = self.string()?;
            self.font(&name, at)?
        };
        self.comma()?;
        let text = self.string()?;
        self.comma()?;
        let thickness = self.float()?;
        self.comma()?;
        let offset = self.vector3()?;
        match lay_out(&font, &text, thickness, offset) {
            Ok(shape) => Ok(Solid::Text(Arc::new(shape))),
            Err(fault) => Err(self.error(span, fault)),
        }
    }

    /// The bytes of a font: from the search path, or one that is installed, or one that stands in for it.
    fn font(&mut self, name: &str, span: Span) -> Parse<Vec<u8>> {
        if self.file_is_there(name) {
            return self.file_bytes(name, span);
        }
        let with_ending = format!("{name}.ttf");
        if Path::new(name).extension().is_none() && self.file_is_there(&with_ending) {
            return self.file_bytes(&with_ending, span);
        }
        let Some(path) = installed(name) else {
            // The search path's own message says where was looked.
            return self.file_bytes(name, span);
        };
        self.warning(span, format!("no font `{name}` in the search path; `{}` is taken", path.display()));
        match Resolver::read(&path) {
            Ok(bytes) => Ok(bytes),
            Err(e) => Err(self.error(span, e.to_string())),
        }
    }
}
