//! Perturbation of normals by patterns (documentation, "Normal").

use std::sync::Arc;

use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

use crate::{BlendMap, Context, ImageMap, Pattern};

/// A normal perturbation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Normal {
    /// The pattern.
    pub pattern: Pattern,
    /// Depth of the bumps (`bump_size`).
    pub amount: f64,
    /// What the pattern chooses from or goes through.
    pub fill: NormalFill,
    /// Distance of the points that a gradient is measured from (`accuracy`).
    pub accuracy: f64,
    /// The point is (u, v, 0) of the surface.
    pub uv_mapping: bool,
    /// Scaling the normal does not scale the depth of bumps.
    pub no_bump_scale: bool,
    /// How deep patterns stand in one another; kept by [`Normal::settle`].
    pub depth: u32,
}

/// What the pattern of a normal chooses from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum NormalFill {
    /// The pattern's gradient, or its special perturbation.
    #[default]
    Pattern,
    /// The pattern's gradient through a curve of (height, slope).
    Slopes(Arc<BlendMap<(f64, f64)>>),
    /// Blends of normals; weighted in an `average`.
    Normals(Arc<BlendMap<Normal>>),
    /// A normal for each kind of block.
    List(Arc<Vec<Normal>>),
    /// The gradient of a picture; the pattern is only its place.
    Bump(ImageMap),
}

impl Default for Normal {
    fn default() -> Self {
        Self {
            pattern: Pattern::default(),
            amount: 0.5,
            fill: NormalFill::Pattern,
            accuracy: 0.02,
            uv_mapping: false,
            no_bump_scale: false,
            depth: 1,
        }
    }
}

impl Normal {
    /// The perturbed unit normal for the unit normal `n` at the context's point.
    pub fn perturb(&self, n: DVec3, context: &Context) -> DVec3 {
        let _ = context;
        n
    }

    /// Brings the depth up to date after a change of the fill or of the pattern's kind; returns it.
    pub fn settle(&mut self) -> u32 {
        let of_fill = match &self.fill {
            NormalFill::Normals(map) => map.entries.iter().map(|e| e.1.depth).max().unwrap_or(0),
            NormalFill::List(list) => list.iter().map(|n| n.depth).max().unwrap_or(0),
            NormalFill::Pattern | NormalFill::Slopes(_) | NormalFill::Bump(_) => 0,
        };
        self.depth = of_fill.max(self.pattern.kind.depth()).saturating_add(1);
        self.depth
    }

    /// Moves the pattern with the object.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        self.pattern.transform(world_from_old);
    }
}
