//! `color_map`, `pigment_map`, `normal_map`, `texture_map`, `slope_map`, `density_map`.

use etendue_procedural::{BlendMap, Color, Normal, Pigment, Texture};

use super::super::{Parse, Parser};

impl Parser {
    /// `color_map { … }`.
    pub(crate) fn color_map(&mut self) -> Parse<BlendMap<Color>> {
        Err(self.unexpected("the scene"))
    }

    /// `pigment_map { … }` or `density_map { … }`.
    pub(crate) fn pigment_map(&mut self) -> Parse<BlendMap<Pigment>> {
        Err(self.unexpected("the scene"))
    }

    /// `normal_map { … }`.
    pub(crate) fn normal_map(&mut self) -> Parse<BlendMap<Normal>> {
        Err(self.unexpected("the scene"))
    }

    /// `texture_map { … }`.
    pub(crate) fn texture_map(&mut self) -> Parse<BlendMap<Texture>> {
        Err(self.unexpected("the scene"))
    }

    /// `slope_map { … }`.
    pub(crate) fn slope_map(&mut self) -> Parse<BlendMap<(f64, f64)>> {
        Err(self.unexpected("the scene"))
    }
}
