//! Textures that look at the place in the world: patterns in space, and projections of other textures.

use etendue_procedural::SolidPattern;
use etendue_scene::desc::{PatternSpace, Projection, TextureId};

use crate::math::{INV_PI, Mat4, PI, TAU, Vec2, Vec3, fns};
use crate::scene::Surface;
use crate::spectrum::Spectrum;

/// A pattern that is a function of a place.
#[derive(Clone, Debug)]
pub struct Solid {
    /// The function.
    pub pattern: SolidPattern,
    /// Of which place.
    pub space: PatternSpace,
}

impl Solid {
    /// The color at a surface point.
    pub fn color(&self, s: &Surface) -> Spectrum {
        let place = match self.space {
            PatternSpace::World(pattern_from_world) => pattern_from_world.transform_point3(s.p),
            PatternSpace::Uv(pattern_from_uv) => (pattern_from_uv * Vec3::new(s.uv.x, s.uv.y, 1.0)).truncate().extend(0.0),
        };
        Spectrum::from_rgb(self.pattern.color(place))
    }
}

/// A texture whose coordinates follow from the place.
#[derive(Clone, Debug)]
pub struct Projected {
    /// What is projected.
    pub texture: TextureId,
    /// How.
    pub projection: Projection,
    /// To the projection's space.
    pub pattern_from_world: Mat4,
}

impl Projected {
    /// The surface point with the projected coordinates. Its footprint is gone: pictures are looked up in full, and samples average them.
    pub fn surface(&self, s: &Surface) -> Surface {
        let uv = project(self.projection, self.pattern_from_world.transform_point3(s.p));
        Surface { uv, footprint: 0.0, ..s.clone() }
    }
}

/// Texture coordinates of a place in the projection's space; the origin of spheres has those of +z.
fn project(projection: Projection, p: Vec3) -> Vec2 {
    match projection {
        Projection::Planar => p.truncate(),
        Projection::Spherical => {
            let phi = fns::atan2(p.y, p.x);
            let phi = if phi < 0.0 { phi + TAU } else { phi };
            Vec2::new(fns::acos(p.normalize_or(Vec3::Z).z.clamp(-1.0, 1.0)) * INV_PI, phi / TAU)
        }
        Projection::Cylindrical => Vec2::new((PI + fns::atan2(p.y, p.x)) / TAU, p.z),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_have_the_coordinates_of_their_angles() {
        let close = |projection, p: [f32; 3], uv: [f32; 2]| {
            let found = project(projection, Vec3::from(p));
            assert!((found - Vec2::from(uv)).length() < 1e-6, "{projection:?} {p:?}: {found}");
        };
        close(Projection::Planar, [3.0, -2.0, 9.0], [3.0, -2.0]);
        close(Projection::Spherical, [0.0, 0.0, 5.0], [0.0, 0.0]);
        close(Projection::Spherical, [2.0, 0.0, 0.0], [0.5, 0.0]);
        close(Projection::Spherical, [0.0, 2.0, 0.0], [0.5, 0.25]);
        close(Projection::Spherical, [0.0, -2.0, -2.0], [0.75, 0.75]);
        close(Projection::Cylindrical, [2.0, 0.0, 7.0], [0.5, 7.0]);
        close(Projection::Cylindrical, [0.0, -2.0, 7.0], [0.25, 7.0]);
        for projection in [Projection::Spherical, Projection::Cylindrical] {
            assert!(project(projection, Vec3::ZERO).is_finite());
        }
    }
}
