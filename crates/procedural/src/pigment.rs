//! Pigments: color at every point (documentation, "Pigment").

use std::sync::Arc;

use glam::DMat4;
use serde::{Deserialize, Serialize};

use crate::{BlendMap, Color, Context, ImageMap, Pattern, PatternKind};

/// Color at every point of space or of a surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Pigment {
    /// The same everywhere.
    Solid(Color),
    /// By a pattern.
    Patterned(Box<PatternedPigment>),
}

/// A pattern with the colors it chooses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PatternedPigment {
    /// The pattern.
    pub pattern: Pattern,
    /// The colors.
    pub fill: PigmentFill,
    /// The point is (u, v, 0) of the surface.
    pub uv_mapping: bool,
    /// Color at low quality.
    pub quick_color: Option<Color>,
    /// How deep patterns stand in one another, from 1; kept by [`Pigment::settle`].
    pub depth: u32,
}

/// What a pattern chooses from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum PigmentFill {
    /// The pattern's own colors.
    Default,
    /// Blends of colors.
    Colors(Arc<BlendMap<Color>>),
    /// Blends of pigments; weighted in an `average`.
    Pigments(Arc<BlendMap<Pigment>>),
    /// A pigment for each kind of block.
    List(Arc<Vec<Pigment>>),
    /// A picture; the pattern is only its place.
    Image(ImageMap),
}

impl Default for Pigment {
    fn default() -> Self {
        Self::Solid(Color::default())
    }
}

impl Pigment {
    /// The color at the context's point.
    pub fn color(&self, context: &Context) -> Color {
        match self {
            Self::Solid(c) => *c,
            Self::Patterned(patterned) => patterned.color(context),
        }
    }

    /// Moves the pattern with the object.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        match self {
            Self::Solid(_) => {}
            Self::Patterned(patterned) => patterned.pattern.transform(world_from_old),
        }
    }

    /// How deep patterns stand in one another: 0 for a solid pigment.
    pub fn depth(&self) -> u32 {
        match self {
            Self::Solid(_) => 0,
            Self::Patterned(patterned) => patterned.depth,
        }
    }

    /// Brings the depth up to date after a change of the fill or of the pattern's kind; returns it.
    pub fn settle(&mut self) -> u32 {
        let Self::Patterned(patterned) = self else { return 0 };
        let of_fill = match &patterned.fill {
            PigmentFill::Pigments(map) => map.entries.iter().map(|e| e.1.depth()).max().unwrap_or(0),
            PigmentFill::List(list) => list.iter().map(Self::depth).max().unwrap_or(0),
            PigmentFill::Default | PigmentFill::Colors(_) | PigmentFill::Image(_) => 0,
        };
        patterned.depth = of_fill.max(patterned.pattern.kind.depth()).saturating_add(1);
        patterned.depth
    }

    /// The color at low quality: `quick_color`, or the color of a solid pigment.
    pub fn quick_color(&self) -> Option<Color> {
        match self {
            Self::Solid(c) => Some(*c),
            Self::Patterned(patterned) => patterned.quick_color,
        }
    }
}

impl PatternedPigment {
    /// The pattern with its own colors.
    pub fn new(pattern: Pattern) -> Self {
        Self { pattern, fill: PigmentFill::Default, uv_mapping: false, quick_color: None, depth: 1 }
    }

    /// The color at the context's point. Pigments of maps and lists see the point where the pattern's transforms and warps have
    /// brought it (measured), so they move with it.
    fn color(&self, context: &Context) -> Color {
        let inner = if self.uv_mapping { self.pattern.enter(&context.moved(context.uv.extend(0.0))) } else { self.pattern.enter(context) };
        // Turbulence moves the entries even where it is the pattern's own.
        match &self.fill {
            PigmentFill::Default => self.own_color(&inner),
            PigmentFill::Colors(map) => blend(map, self.pattern.value_here(&inner)),
            PigmentFill::Pigments(map) => {
                if matches!(self.pattern.kind, PatternKind::Average) {
                    return average(map, &inner);
                }
                match map.around(self.pattern.value_here(&inner)) {
                    None => Color::default(),
                    Some((a, _, 0.0)) => a.color(&inner),
                    Some((a, b, weight)) => a.color(&inner).lerp(&b.color(&inner), weight),
                }
            }
            PigmentFill::List(list) => list.get(self.pattern.kind.block(&inner)).map_or_else(Color::default, |p| p.color(&inner)),
            PigmentFill::Image(image) => image.color(&inner).unwrap_or(Color { transmit: 1.0, ..Color::rgb(1.0, 1.0, 1.0) }),
        }
    }

    fn own_color(&self, inner: &Context) -> Color {
        let own = crate::default_colors::of(&self.pattern.kind);
        if self.pattern.kind.blocks().is_some() {
            let index = self.pattern.kind.block(inner);
            return own.get(index).map_or_else(Color::default, |(_, c)| color_of(*c));
        }
        let value = self.pattern.value_here(inner);
        let next = own.iter().position(|e| e.0 > value).unwrap_or(own.len());
        match (next.checked_sub(1).and_then(|i| own.get(i)), own.get(next)) {
            (Some((low, a)), Some((high, b))) => color_of(*a).lerp(&color_of(*b), (value - low) / (high - low)),
            (Some((_, c)), None) | (None, Some((_, c))) => color_of(*c),
            (None, None) => Color::rgb(value, value, value),
        }
    }
}

/// The colors that a block pattern has when none are given; none for other patterns.
pub fn block_colors(kind: &PatternKind) -> Vec<Color> {
    if kind.blocks().is_none() {
        return Vec::new();
    }
    crate::default_colors::of(kind).iter().map(|(_, c)| color_of(*c)).collect()
}

fn color_of(rgb: [f64; 3]) -> Color {
    Color::rgb(rgb[0], rgb[1], rgb[2])
}

fn blend(map: &BlendMap<Color>, value: f64) -> Color {
    match map.around(value) {
        None => Color::default(),
        Some((a, _, 0.0)) => *a,
        Some((a, b, weight)) => a.lerp(b, weight),
    }
}

/// Weighted mean; equal weights where they sum to nothing.
fn average(map: &BlendMap<Pigment>, inner: &Context) -> Color {
    let total = map.total();
    let even = !(total.is_finite() && total != 0.0);
    let scale = if even { 1.0 / map.entries.len().max(1) as f64 } else { 1.0 / total };
    let mut sum = Color::default();
    for (weight, pigment) in &map.entries {
        let share = if even { scale } else { weight * scale };
        let c = pigment.color(inner);
        sum.rgb += c.rgb * share;
        sum.filter += c.filter * share;
        sum.transmit += c.transmit * share;
    }
    sum
}
