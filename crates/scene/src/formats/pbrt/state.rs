//! The graphics state: what directives set for those that follow.

use std::rc::Rc;

use glam::DMat4;

use super::params::{Parameter, Params};
use super::spectrum::ColorSpace;
use crate::desc::{BsdfId, MediumId};

/// What `AttributeBegin` saves.
#[derive(Clone)]
pub(super) struct State {
    /// World from object, at the start and the end of the shutter's time.
    pub transforms: [DMat4; 2],
    /// Which of the two the next transform directives change.
    pub active: [bool; 2],
    /// Normals point the other way.
    pub reverse_orientation: bool,
    /// Current material; `None` is the default diffuse one.
    pub material: Option<BsdfId>,
    /// Emission of the shapes that follow.
    pub area_light: Option<Rc<Params>>,
    /// Medium inside of the shapes that follow.
    pub interior: Option<MediumId>,
    /// Medium outside.
    pub exterior: Option<MediumId>,
    /// Colors of `rgb` parameters.
    pub color_space: ColorSpace,
    /// Defaults by `Attribute "shape"`, `"light"`, `"material"`, `"medium"`, `"texture"`.
    pub defaults: Rc<Vec<(String, Vec<Parameter>)>>,
}

impl Default for State {
    fn default() -> Self {
        Self {
            transforms: [DMat4::IDENTITY; 2],
            active: [true; 2],
            reverse_orientation: false,
            material: None,
            area_light: None,
            interior: None,
            exterior: None,
            color_space: ColorSpace::Srgb,
            defaults: Rc::default(),
        }
    }
}

impl State {
    /// World from object at the start of the shutter's time.
    pub fn transform(&self) -> DMat4 {
        self.transforms[0]
    }

    /// Appends a transform to the active ones.
    pub fn concat(&mut self, m: DMat4) {
        for i in 0..2 {
            if self.active[i] {
                self.transforms[i] *= m;
            }
        }
    }

    /// Replaces the active transforms.
    pub fn set(&mut self, m: DMat4) {
        for i in 0..2 {
            if self.active[i] {
                self.transforms[i] = m;
            }
        }
    }

    /// Defaults of a kind of directive.
    pub fn defaults_of(&self, kind: &str) -> &[Parameter] {
        self.defaults.iter().find(|(k, _)| k == kind).map_or(&[], |(_, p)| p)
    }
}
