//! The advanced shapes of the description as primitives.

use std::sync::Arc;

use etendue_procedural::Images;
use etendue_scene::desc::classic::{BlobKind, CurveKind, HeightField, HeightSource, Solid, SweepKind};

use super::curve::SplineKind;
use super::{Primitive, bicubic_patch, blob, height_field, julia, lathe, ovus, poly, prism, sor, sphere_sweep, superellipsoid};

fn kind(kind: CurveKind) -> SplineKind {
    match kind {
        CurveKind::Linear => SplineKind::Linear,
        CurveKind::Quadratic => SplineKind::Quadratic,
        CurveKind::Cubic => SplineKind::Cubic,
        CurveKind::Bezier => SplineKind::Bezier,
    }
}

/// The primitive of an advanced shape; `None` for degenerate numbers and for all other shapes.
pub(super) fn make(solid: &Solid, images: Option<&dyn Images>) -> Option<Arc<dyn Primitive>> {
    Some(match solid {
        Solid::Polynomial { order, coefficients } => Arc::new(poly::Poly::new(*order as usize, coefficients.to_vec())?),
        Solid::Blob(b) => Arc::new(blob::Blob::new(b.threshold, &b.components.iter().map(component).collect::<Vec<_>>())?),
        Solid::Lathe { spline, points } => Arc::new(lathe::Lathe::new(kind(*spline), points)?),
        Solid::Sor { points, open } => Arc::new(sor::Sor::new(points, *open)?),
        Solid::Prism(p) => Arc::new(prism::Prism::new(kind(p.spline), p.conic, p.open, p.heights, &p.points)?),
        Solid::Superellipsoid { e, n } => Arc::new(superellipsoid::Superellipsoid::new(*e, *n)?),
        Solid::BicubicPatch(p) => Arc::new(bicubic_patch::BicubicPatch::new(&p.points, p.u_steps, p.v_steps, p.flatness, p.uv)?),
        Solid::JuliaFractal(j) => {
            Arc::new(julia::Julia::new(j.parameter, j.hypercomplex, j.function, j.max_iteration, j.precision, j.slice, j.distance)?)
        }
        Solid::HeightField(field) => Arc::new(landscape(field, images)?),
        Solid::SphereSweep(s) => {
            let spline = match s.spline {
                SweepKind::Linear => sphere_sweep::SweepSpline::Linear,
                SweepKind::BSpline => sphere_sweep::SweepSpline::BSpline,
                SweepKind::Cubic => sphere_sweep::SweepSpline::Cubic,
            };
            Arc::new(sphere_sweep::SphereSweep::new(spline, &s.spheres)?)
        }
        Solid::Ovus { bottom, top } => Arc::new(ovus::Ovus::new(*bottom, *top)?),
        _ => return None,
    })
}

fn component(c: &etendue_scene::desc::classic::BlobComponent) -> blob::Component {
    blob::Component {
        core: match c.kind {
            BlobKind::Sphere(p) => blob::Core::Point(p),
            BlobKind::Cylinder(a, b) => blob::Core::Segment(a, b),
        },
        radius: c.radius,
        strength: c.strength,
        blob_from_component: c.blob_from_component,
        texture: c.texture.clone(),
    }
}

/// Heights in the levels that POV-Ray stores.
fn landscape(field: &HeightField, images: Option<&dyn Images>) -> Option<height_field::HeightField> {
    match &field.source {
        HeightSource::Values { width, height, values } => {
            if values.len() != (*width as usize).checked_mul(*height as usize)? {
                return None;
            }
            let heights: Vec<f64> = values.iter().map(|v| height_field::from_function(*v)).collect();
            height_field::HeightField::new(*width as usize, &heights, field.smooth, field.water_level)
        }
        HeightSource::Potential(id) => {
            let images = images?;
            let [width, height] = images.size(*id)?;
            let half = width / 2;
            let count = u64::from(half) * u64::from(height);
            if count > height_field::MOST as u64 {
                return None;
            }
            let byte = |x: u32, y: u32| f64::from(images.index(*id, x, y).unwrap_or(0));
            let mut heights = Vec::with_capacity(count as usize);
            for y in 0..height {
                heights.extend((0..half).map(|x| (256.0 * byte(x, y) + byte(x + half, y)) / 65536.0));
            }
            height_field::HeightField::new(half as usize, &heights, field.smooth, field.water_level)
        }
        HeightSource::Image(id) => {
            let images = images?;
            let [width, height] = images.size(*id)?;
            if u64::from(width) * u64::from(height) > height_field::MOST as u64 {
                return None;
            }
            let mut heights = Vec::with_capacity(width as usize * height as usize);
            let mut bytes = true;
            for y in 0..height {
                for x in 0..width {
                    let value = match images.index(*id, x, y) {
                        Some(index) => f64::from(index) / 255.0,
                        None => {
                            let c = images.pixel(*id, x, y);
                            (256.0 * c.rgb.x + c.rgb.y) / 257.0
                        }
                    };
                    bytes &= ((value * 255.0).round() - value * 255.0).abs() < 1e-4;
                    heights.push(value);
                }
            }
            for value in &mut heights {
                *value = if bytes {
                    height_field::from_gray((*value * 255.0).round() as u8)
                } else {
                    height_field::from_function(value.clamp(0.0, 1.0))
                };
            }
            height_field::HeightField::new(width as usize, &heights, field.smooth, field.water_level)
        }
    }
}

#[cfg(test)]
mod tests {
    use etendue_procedural::{Color, ImageId};

    use super::*;

    /// Four columns of palette indices: 64, 0 in the upper bytes, 0, 128 in the lower ones.
    struct Potentials;

    impl Images for Potentials {
        fn size(&self, _: ImageId) -> Option<[u32; 2]> {
            Some([4, 2])
        }
        fn pixel(&self, _: ImageId, _: u32, _: u32) -> Color {
            Color::default()
        }
        fn index(&self, _: ImageId, x: u32, _: u32) -> Option<u32> {
            [64, 0, 0, 128].get(x as usize).copied()
        }
    }

    #[test]
    fn potentials_have_two_bytes() {
        let field = HeightField { source: HeightSource::Potential(0), smooth: false, water_level: 0.0 };
        let field = landscape(&field, Some(&Potentials)).unwrap();
        let b = field.bounds();
        assert!((b.max.y - 0.25).abs() < 1e-6 && (b.min.y - 128.0 / 65536.0).abs() < 1e-6, "{b:?}");
    }
}
