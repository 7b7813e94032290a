//! Shapes of curves, fields and heights: `lathe`, `sor`, `prism`, `sphere_sweep`, `bicubic_patch`, `blob`, `height_field`, `julia_fractal`.

use std::sync::Arc;

use glam::{DMat4, DVec2, DVec3, DVec4};

use super::super::{Parse, Parser};
use crate::desc::classic::{
    BicubicPatch, Blob, BlobComponent, BlobKind, CurveKind, HeightField, HeightSource, ImageContent, JuliaFractal, JuliaFunction, Object,
    Prism, Solid, SphereSweep, SweepKind,
};
use crate::span::Span;

/// Most samples of a height field's function.
const HEIGHTS_LIMIT: f64 = 6.4e7;

const CURVES: &[(&str, CurveKind)] = &[
    ("linear_spline", CurveKind::Linear),
    ("quadratic_spline", CurveKind::Quadratic),
    ("cubic_spline", CurveKind::Cubic),
    ("bezier_spline", CurveKind::Bezier),
];

impl Parser {
    fn accept_curve(&mut self) -> Parse<Option<CurveKind>> {
        for (word, kind) in CURVES {
            if self.accept(word)? {
                return Ok(Some(*kind));
            }
        }
        Ok(None)
    }

    pub(super) fn lathe(&mut self) -> Parse<Solid> {
        let spline = self.accept_curve()?.unwrap_or_default();
        let count = self.count("points")?;
        Ok(Solid::Lathe { spline, points: self.points2(count)? })
    }

    pub(super) fn sor(&mut self) -> Parse<Solid> {
        let count = self.count("points")?;
        let points = self.points2(count)?;
        Ok(Solid::Sor { points, open: self.accept("open")? })
    }

    pub(super) fn prism(&mut self) -> Parse<Solid> {
        let mut prism = Prism::default();
        loop {
            if let Some(kind) = self.accept_curve()? {
                prism.spline = kind;
            } else if self.accept("conic_sweep")? {
                prism.conic = true;
            } else if self.accept("linear_sweep")? {
                prism.conic = false;
            } else {
                break;
            }
        }
        let a = self.float()?;
        self.comma()?;
        let b = self.float()?;
        self.comma()?;
        prism.heights = [a, b];
        let count = self.count("points")?;
        prism.points = Arc::unwrap_or_clone(self.points2(count)?);
        prism.open = self.accept("open")?;
        Ok(Solid::Prism(Arc::new(prism)))
    }

    pub(super) fn sphere_sweep(&mut self, span: Span) -> Parse<Solid> {
        let spline = match self.accept_any(&["linear_spline", "b_spline", "cubic_spline"])? {
            Some("linear_spline") => SweepKind::Linear,
            Some("b_spline") => SweepKind::BSpline,
            Some(_) => SweepKind::Cubic,
            None => return Err(self.unexpected("a sphere_sweep, which begins with the kind of its spline")),
        };
        let count = self.count("spheres")?;
        let mut spheres = Vec::new();
        for _ in 0..count {
            self.comma()?;
            let center = self.vector3()?;
            self.comma()?;
            spheres.push(center.extend(self.float()?));
        }
        if spheres.len() < if spline == SweepKind::Linear { 2 } else { 4 } {
            return Err(self.error(span, "a sphere_sweep needs two spheres for a linear spline, four for the others"));
        }
        let mut tolerance = 1e-6;
        self.comma()?;
        if self.accept("tolerance")? {
            tolerance = self.float()?;
        }
        Ok(Solid::SphereSweep(Arc::new(SphereSweep { spline, spheres, tolerance })))
    }

    pub(super) fn bicubic_patch(&mut self) -> Parse<Solid> {
        let mut patch = BicubicPatch {
            kind: 0,
            flatness: 0.0,
            u_steps: 0,
            v_steps: 0,
            points: [DVec3::ZERO; 16],
            uv: [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y],
        };
        loop {
            match self.accept_any(&["type", "flatness", "u_steps", "v_steps", "uv_vectors", "accuracy"])? {
                Some("type") => patch.kind = self.float()? as u32,
                Some("flatness") => patch.flatness = self.float()?,
                Some("u_steps") => patch.u_steps = self.float()? as u32,
                Some("v_steps") => patch.v_steps = self.float()? as u32,
                Some("uv_vectors") => {
                    for uv in &mut patch.uv {
                        *uv = self.vector2()?;
                        self.comma()?;
                    }
                }
                Some(_) => {
                    self.float()?;
                }
                None => break,
            }
            self.comma()?;
        }
        patch.points = self.vectors3()?;
        Ok(Solid::BicubicPatch(Arc::new(patch)))
    }

    pub(super) fn blob(&mut self) -> Parse<Solid> {
        let mut blob = Blob { threshold: 1.0, components: Vec::new() };
        loop {
            let span = self.span();
            match self.accept_any(&["threshold", "sphere", "cylinder", "component"])? {
                Some("threshold") => blob.threshold = self.float()?,
                Some("component") => {
                    let strength = self.float()?;
                    self.comma()?;
                    let radius = self.float()?;
                    self.comma()?;
                    let kind = BlobKind::Sphere(self.vector3()?);
                    blob.components.push(BlobComponent { kind, radius, strength, blob_from_component: DMat4::IDENTITY, texture: None });
                }
                Some(word) => {
                    self.expect("{")?;
                    let a = self.vector3()?;
                    self.comma()?;
                    let kind = if word == "sphere" { BlobKind::Sphere(a) } else { BlobKind::Cylinder(a, self.vector3()?) };
                    self.comma()?;
                    let radius = self.float()?;
                    self.comma()?;
                    self.accept("strength")?;
                    let strength = self.float()?;
                    self.comma()?;
                    let mut part = Object::new(span, Solid::Union(Vec::new()));
                    self.component_modifiers(&mut part)?;
                    blob.components.push(BlobComponent {
                        kind,
                        radius,
                        strength,
                        blob_from_component: part.world_from_solid,
                        texture: part.texture,
                    });
                }
                None => break,
            }
        }
        Ok(Solid::Blob(Arc::new(blob)))
    }

    pub(super) fn height_field(&mut self, span: Span) -> Parse<Solid> {
        let source = if self.peek_word()? == Some("function") {
            self.height_function(span)?
        } else {
            let kind = self.accept_any(&["exr", "gif", "hdr", "iff", "jpeg", "pgm", "png", "pot", "ppm", "sys", "tga", "tiff", "bmp"])?;
            let at = self.span();
            let name = self.string()?;
            let options = self.image_options()?;
            let image = self.image(&name, at, ImageContent::Data, options)?;
            if kind == Some("pot") || name.to_ascii_lowercase().ends_with(".pot") {
                HeightSource::Potential(image)
            } else {
                HeightSource::Image(image)
            }
        };
        let mut field = HeightField { source, smooth: false, water_level: 0.0 };
        loop {
            if self.accept("smooth")? {
                field.smooth = self.flag()?;
            } else if self.accept("water_level")? {
                field.water_level = self.float()?;
            } else {
                break;
            }
        }
        Ok(Solid::HeightField(Arc::new(field)))
    }

    pub(super) fn julia_fractal(&mut self, span: Span) -> Parse<Solid> {
        let mut julia = JuliaFractal {
            parameter: self.vector4()?,
            hypercomplex: false,
            function: JuliaFunction::Sqr,
            max_iteration: 20,
            precision: 20.0,
            slice: DVec4::W,
            distance: 0.0,
        };
        const FUNCTIONS: &[(&str, JuliaFunction)] = &[
            ("sqr", JuliaFunction::Sqr),
            ("cube", JuliaFunction::Cube),
            ("exp", JuliaFunction::Exp),
            ("reciprocal", JuliaFunction::Reciprocal),
            ("sin", JuliaFunction::Sin),
            ("asin", JuliaFunction::Asin),
            ("sinh", JuliaFunction::Sinh),
            ("asinh", JuliaFunction::Asinh),
            ("cos", JuliaFunction::Cos),
            ("acos", JuliaFunction::Acos),
            ("cosh", JuliaFunction::Cosh),
            ("acosh", JuliaFunction::Acosh),
            ("tan", JuliaFunction::Tan),
            ("atan", JuliaFunction::Atan),
            ("tanh", JuliaFunction::Tanh),
            ("atanh", JuliaFunction::Atanh),
            ("ln", JuliaFunction::Ln),
        ];
        'items: loop {
            self.comma()?;
            for (word, function) in FUNCTIONS {
                if self.accept(word)? {
                    julia.function = *function;
                    continue 'items;
                }
            }
            match self.accept_any(&["quaternion", "hypercomplex", "max_iteration", "precision", "slice", "pwr"])? {
                Some("quaternion") => julia.hypercomplex = false,
                Some("hypercomplex") => julia.hypercomplex = true,
                Some("max_iteration") => {
                    let n = self.float()?;
                    if !(1.0..=1e6).contains(&n) {
                        return Err(self.error(span, "max_iteration must be between 1 and 1000000"));
                    }
                    julia.max_iteration = n as u32;
                }
                Some("precision") => julia.precision = self.float()?.max(1.0),
                Some("slice") => {
                    julia.slice = self.vector4()?;
                    self.comma()?;
                    julia.distance = self.float()?;
                    if julia.slice.w.abs() < 1e-10 {
                        return Err(self.error(span, "the fourth component of a slice's normal must not be 0"));
                    }
                }
                Some(_) => {
                    self.expect("(")?;
                    let x = self.float()?;
                    self.comma()?;
                    let y = self.float()?;
                    self.expect(")")?;
                    julia.function = JuliaFunction::Pwr(x, y);
                }
                None => break,
            }
        }
        Ok(Solid::JuliaFractal(Arc::new(julia)))
    }

    /// `function width, height { … }` of a height field: sampled here.
    fn height_function(&mut self, span: Span) -> Parse<HeightSource> {
        self.expect("function")?;
        let width = self.float()?;
        self.comma()?;
        let height = self.float()?;
        self.comma()?;
        if !(width >= 2.0 && height >= 2.0 && width * height <= HEIGHTS_LIMIT) {
            return Err(self.error(span, format!("the function of a height_field needs 2 by 2 to {HEIGHTS_LIMIT} samples in all")));
        }
        let function = self.function_body(["x", "y", "z"].map(String::from).to_vec())?;
        let probe = self.options.probe.clone();
        let context = self.context(probe.as_deref());
        let (width, height) = (width as u32, height as u32);
        let mut values = Vec::with_capacity(width as usize * height as usize);
        for row in 0..height {
            for column in 0..width {
                let x = f64::from(column) / f64::from(width - 1);
                let y = f64::from(row) / f64::from(height - 1);
                values.push(height_level(function.eval(&[x, y, 0.0], &context)));
            }
            self.check_time()?;
        }
        Ok(HeightSource::Values { width, height, values })
    }
}

/// A function's value as one of 65536 levels. Values beyond 0 to 1 wrap around, whole numbers above 0 to 1 (measured: 2 gives 1, −1 gives 0,
/// 1.25 gives 0.25).
pub(super) fn height_level(value: f64) -> f64 {
    let part = value - value.floor();
    let part = if part == 0.0 && value > 0.0 { 1.0 } else { part };
    if part.is_finite() { (part * 65535.0).floor() / 65535.0 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels() {
        let near = |a: f64, b: f64| (a - b).abs() < 2e-5;
        for (value, level) in [(0.5, 0.5), (1.0, 1.0), (2.0, 1.0), (0.0, 0.0), (-1.0, 0.0), (-0.25, 0.75), (1.25, 0.25)] {
            assert!(near(height_level(value), level), "{value}");
        }
        assert_eq!(height_level(f64::NAN), 0.0);
    }
}
