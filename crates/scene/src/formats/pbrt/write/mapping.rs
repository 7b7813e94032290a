//! Where textures take their place from: texture coordinates, projections, the space of patterns.

use std::fmt::Write as _;

use etendue_procedural::SolidPattern;
use glam::{Mat3, Mat4, Vec3};

use super::Writer;
use crate::desc::{Color, PatternSpace, Projection, TextureDesc};
use crate::span::Span;

impl<'d> Writer<'d> {
    /// A projected texture as its projection and what is projected, where pbrt can project that; else the texture itself.
    pub(super) fn projected(&mut self, texture: &'d TextureDesc, span: Span) -> (Option<(Projection, Mat4)>, &'d TextureDesc) {
        let TextureDesc::Projected { texture: id, projection, pattern_from_world } = texture else { return (None, texture) };
        let inner = &self.desc[*id].value;
        let plain = |c: &Color| matches!(c, Color::Constant(_));
        let fits = matches!(inner, TextureDesc::Bitmap(_))
            || matches!(inner, TextureDesc::Checkerboard { color0, color1, .. } if plain(color0) && plain(color1))
            || matches!(inner, TextureDesc::Solid { pattern: SolidPattern::Dots | SolidPattern::Coordinate, space: PatternSpace::Uv(_) });
        if !fits {
            return (None, texture);
        }
        if *projection != Projection::Planar && invertible(*pattern_from_world).is_none() {
            self.lose(span, "flat space of a projected texture", "texture coordinates");
            return (None, inner);
        }
        (Some((*projection, *pattern_from_world)), inner)
    }

    /// The transform, `world_from_pattern`, under which a texture has to stand.
    pub(super) fn texture_space(&mut self, texture: &TextureDesc, projected: Option<(Projection, Mat4)>, span: Span) -> Option<Mat4> {
        match (projected, texture) {
            // Planes are written by their axes.
            (Some((Projection::Planar, _)), _) => None,
            (Some((_, m)), _) => invertible(m),
            (None, TextureDesc::Solid { pattern: SolidPattern::Dots | SolidPattern::Coordinate, .. }) => None,
            (None, TextureDesc::Solid { space: PatternSpace::World(m), .. }) => {
                let world_from_pattern = invertible(*m);
                if world_from_pattern.is_none() {
                    self.lose(span, "flat space of a pattern", "the world's");
                }
                world_from_pattern.filter(|m| *m != Mat4::IDENTITY)
            }
            (None, TextureDesc::Solid { space: PatternSpace::Uv(_), .. }) => {
                self.lose(span, "pattern over texture coordinates", "over the place");
                None
            }
            _ => None,
        }
    }

    /// Parameters of the mapping by `m`, times a factor.
    pub(super) fn mapping(&mut self, m: Mat3, factor: f32, projected: Option<(Projection, Mat4)>, span: Span) {
        match projected {
            Some((Projection::Planar, pattern_from_world)) => {
                self.string("mapping", "planar");
                let place = pattern_from_world.transpose();
                for (row, [axis, delta]) in [(m.row(0), ["v1", "udelta"]), (m.row(1), ["v2", "vdelta"])] {
                    let row = (place.x_axis * row.x + place.y_axis * row.y) * factor;
                    let _ = write!(self.text, " \"vector3 {axis}\" [{} {} {}]", row.x, row.y, row.z);
                    self.float(delta, row.w + factor * if axis == "v1" { m.z_axis.x } else { m.z_axis.y });
                }
            }
            Some((projection, _)) => {
                self.string("mapping", if projection == Projection::Spherical { "spherical" } else { "cylindrical" });
                if !is_identity(m, factor) {
                    self.lose(span, "scaled coordinates of a projected texture", "not scaled");
                }
            }
            None => {
                if m.x_axis.y != 0.0 || m.y_axis.x != 0.0 {
                    self.lose(span, "turned texture", "not turned");
                }
                for (name, v, default) in [
                    ("uscale", m.x_axis.x * factor, 1.0),
                    ("vscale", m.y_axis.y * factor, 1.0),
                    ("udelta", m.z_axis.x * factor, 0.0),
                    ("vdelta", m.z_axis.y * factor, 0.0),
                ] {
                    if v != default {
                        self.float(name, v);
                    }
                }
            }
        }
    }

    /// The class and parameters of a pattern.
    pub(super) fn pattern(
        &mut self,
        i: usize,
        float: bool,
        pattern: &SolidPattern,
        space: PatternSpace,
        projected: Option<(Projection, Mat4)>,
        span: Span,
    ) {
        if let SolidPattern::Marble { octaves, roughness, scale, variation } = *pattern {
            if float {
                // Nothing that is read takes marble for a number.
                let _ = write!(self.text, " \"constant\" \"float value\" {}", pattern.mean()[0]);
            } else {
                self.text.push_str(" \"marble\"");
                self.octaves(octaves, roughness);
                self.float("scale", scale);
                self.float("variation", variation);
            }
            return;
        }
        if !float {
            self.mixed(i);
            return;
        }
        // Patterns over two coordinates, of the place or of the shape.
        let (m, projected) = match space {
            PatternSpace::Uv(m) => (m, projected),
            PatternSpace::World(m) => (Mat3::IDENTITY, Some((Projection::Planar, m))),
        };
        match *pattern {
            SolidPattern::Fbm { octaves, roughness } => {
                self.text.push_str(" \"fbm\"");
                self.octaves(octaves, roughness);
            }
            SolidPattern::Turbulence { octaves, roughness } => {
                self.text.push_str(" \"wrinkled\"");
                self.octaves(octaves, roughness);
            }
            SolidPattern::Windy => self.text.push_str(" \"windy\""),
            SolidPattern::Cubes => self.text.push_str(" \"checkerboard\" \"integer dimension\" 3 \"float tex1\" 0 \"float tex2\" 1"),
            SolidPattern::Dots => {
                self.text.push_str(" \"dots\" \"float inside\" 1 \"float outside\" 0");
                self.mapping(m, 1.0, projected, span);
            }
            SolidPattern::Coordinate => {
                // One row of the matrix is a plane over the unit square.
                let row = m.row(0);
                self.text.push_str(" \"bilerp\"");
                for (name, [u, v]) in [("v00", [0.0, 0.0]), ("v01", [0.0, 1.0]), ("v10", [1.0, 0.0]), ("v11", [1.0, 1.0])] {
                    self.float(name, row.dot(Vec3::new(u, v, 1.0)));
                }
                self.mapping(Mat3::IDENTITY, 1.0, projected, span);
            }
            SolidPattern::Marble { .. } => {}
        }
    }

    /// The float texture of the same number as a gray color.
    pub(super) fn mixed(&mut self, i: usize) {
        let _ = write!(self.text, " \"mix\" \"rgb tex1\" [0 0 0] \"rgb tex2\" [1 1 1] \"texture amount\" \"f{i}\"");
    }

    fn octaves(&mut self, octaves: u32, roughness: f32) {
        let _ = write!(self.text, " \"integer octaves\" {octaves}");
        self.float("roughness", roughness);
    }
}

fn invertible(m: Mat4) -> Option<Mat4> {
    let inverse = m.as_dmat4().inverse().as_mat4();
    inverse.is_finite().then_some(inverse)
}

/// Whether the upper two rows, times a factor, pass coordinates on.
fn is_identity(m: Mat3, factor: f32) -> bool {
    let rows = [m.row(0) * factor, m.row(1) * factor];
    rows == [Vec3::X, Vec3::Y]
}
