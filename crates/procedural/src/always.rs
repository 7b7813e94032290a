//! What holds for a texture at every point, so that renderers need not evaluate it: whether it lets light through, whether it shows light
//! from behind, and whether it looks at surface coordinates. All answers err on the safe side.

use crate::texture::TextureFill;
use crate::{Color, Normal, NormalFill, PatternKind, Pigment, PigmentFill, Texture};

/// Whether a color passes no light, and no blend of it with another such color does.
fn is_opaque(color: &Color) -> bool {
    color.filter == 0.0 && color.transmit == 0.0
}

impl Pigment {
    /// Whether [`Color::passing`] is 0 everywhere.
    pub fn is_opaque(&self) -> bool {
        match self {
            Self::Solid(color) => is_opaque(color),
            Self::Patterned(patterned) => match &patterned.fill {
                PigmentFill::Colors(map) => !map.entries.is_empty() && map.entries.iter().all(|(_, c)| is_opaque(c)),
                PigmentFill::Pigments(map) => !map.entries.is_empty() && map.entries.iter().all(|(_, p)| p.is_opaque()),
                PigmentFill::List(list) => !list.is_empty() && list.iter().all(Self::is_opaque),
                PigmentFill::Default | PigmentFill::Image(_) => false,
            },
        }
    }

    /// Whether surface coordinates may change it.
    pub fn uses_uv(&self) -> bool {
        let Self::Patterned(patterned) = self else { return false };
        let fill = match &patterned.fill {
            PigmentFill::Pigments(map) => map.entries.iter().any(|(_, p)| p.uses_uv()),
            PigmentFill::List(list) => list.iter().any(Self::uses_uv),
            PigmentFill::Default | PigmentFill::Colors(_) | PigmentFill::Image(_) => false,
        };
        patterned.uv_mapping || fill || pattern_uses_uv(&patterned.pattern.kind)
    }
}

/// Patterns that evaluate pigments hand the coordinates on.
fn pattern_uses_uv(kind: &PatternKind) -> bool {
    match kind {
        PatternKind::Pigment(pigment) => pigment.uses_uv(),
        // Functions may hold pigments.
        PatternKind::Function(..) => true,
        _ => false,
    }
}

fn normal_uses_uv(normal: &Normal) -> bool {
    let fill = match &normal.fill {
        NormalFill::Normals(map) => map.entries.iter().any(|(_, n)| normal_uses_uv(n)),
        NormalFill::List(list) => list.iter().any(normal_uses_uv),
        NormalFill::Pattern | NormalFill::Slopes(_) | NormalFill::Bump(_) => false,
    };
    normal.uv_mapping || fill || pattern_uses_uv(&normal.pattern.kind)
}

impl Texture {
    /// Whether it passes no light anywhere: some layer of each of its textures is opaque.
    pub fn is_opaque(&self) -> bool {
        match self {
            Self::Layers(layers) => layers.iter().any(|l| l.pigment.is_opaque()),
            Self::Patterned(patterned) => match &patterned.fill {
                TextureFill::Textures(map) => map.entries.iter().all(|(_, t)| t.is_opaque()),
                TextureFill::List(list) => list.iter().all(Self::is_opaque),
                TextureFill::Image(..) => false,
            },
        }
    }

    /// Whether some layer scatters light that shines on the other side (`diffuse` with a second number).
    pub fn shows_light_behind(&self) -> bool {
        match self {
            Self::Layers(layers) => layers.iter().any(|l| l.finish.diffuse_back != 0.0),
            Self::Patterned(patterned) => match &patterned.fill {
                TextureFill::Textures(map) => map.entries.iter().any(|(_, t)| t.shows_light_behind()),
                TextureFill::List(list) | TextureFill::Image(_, list) => list.iter().any(Self::shows_light_behind),
            },
        }
    }

    /// Whether surface coordinates may change it.
    pub fn uses_uv(&self) -> bool {
        match self {
            Self::Layers(layers) => layers.iter().any(|l| l.pigment.uses_uv() || l.normal.as_ref().is_some_and(normal_uses_uv)),
            Self::Patterned(patterned) => {
                let fill = match &patterned.fill {
                    TextureFill::Textures(map) => map.entries.iter().any(|(_, t)| t.uses_uv()),
                    TextureFill::List(list) | TextureFill::Image(_, list) => list.iter().any(Self::uses_uv),
                };
                patterned.uv_mapping || fill || pattern_uses_uv(&patterned.pattern.kind)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::{BlendMap, Layer, Pattern, PatternedPigment};

    fn map(a: Color, b: Color, uv_mapping: bool) -> Pigment {
        let mut patterned = PatternedPigment::new(Pattern::default());
        patterned.fill = PigmentFill::Colors(Arc::new(BlendMap { entries: vec![(0.0, a), (1.0, b)] }));
        patterned.uv_mapping = uv_mapping;
        Pigment::Patterned(Box::new(patterned))
    }

    #[test]
    fn light_from_behind_shows_in_parts() {
        let layer =
            |diffuse_back| Layer { finish: Arc::new(crate::Finish { diffuse_back, ..crate::Finish::default() }), ..Layer::default() };
        let [plain, both] = [0.0, 0.3].map(|d| Texture::Layers(vec![layer(0.0), layer(d)]));
        assert!(!plain.shows_light_behind() && both.shows_light_behind());
        let list =
            |parts| Texture::Patterned(Box::new(crate::PatternedTexture::new(Pattern::default(), TextureFill::List(Arc::new(parts)))));
        assert!(!list(vec![plain.clone()]).shows_light_behind() && list(vec![plain, both]).shows_light_behind());
    }

    #[test]
    fn one_opaque_layer_blocks_light() {
        let red = Color::rgb(1.0, 0.0, 0.0);
        let glass = Color { filter: 0.5, ..red };
        let layer = |pigment| Layer { pigment, ..Layer::default() };
        assert!(Texture::Layers(vec![layer(map(red, red, false)), layer(Pigment::Solid(glass))]).is_opaque());
        assert!(!Texture::Layers(vec![layer(map(red, glass, false))]).is_opaque());
        assert!(!Texture::Layers(vec![layer(map(red, red, false))]).uses_uv());
        assert!(Texture::Layers(vec![layer(Pigment::Solid(red)), layer(map(red, red, true))]).uses_uv());
    }
}
