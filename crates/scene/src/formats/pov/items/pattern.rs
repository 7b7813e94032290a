//! Patterns and their modifiers, which pigments, normals, textures and densities share (documentation, "Pattern").

use std::sync::Arc;

use etendue_procedural::noise::Turbulence;
use etendue_procedural::pattern::{
    Coloring, Crackle, DensityFile, DensityInterpolation, Fractal, FractalSet, Pavement, Slope, Turbulent, Wave, WaveForm,
};
use etendue_procedural::warp::{BlackHole, Warp, Wrap};
use etendue_procedural::{Pattern, PatternKind};
use glam::{DVec2, DVec3};

use super::super::{Parse, Parser, Token};

/// The value as `T`, for [`Parser::accept_value`].
macro_rules! pick {
    ($variant:ident) => {
        |v: &$crate::formats::pov::Value| match v {
            $crate::formats::pov::Value::$variant(x) => Some(x.clone()),
            _ => None,
        }
    };
}
pub(super) use pick;

/// Most patterns that may stand inside of one another: every level can double the work at each point.
pub(super) const DEPTH_LIMIT: u32 = 32;

/// Most octaves of turbulence.
const OCTAVES_LIMIT: f64 = 10.0;

/// Words that begin a pattern.
const PATTERN_WORDS: &[&str] = &[
    "agate",
    "aoi",
    "average",
    "boxed",
    "bozo",
    "brick",
    "bumps",
    "cells",
    "checker",
    "crackle",
    "cubic",
    "cylindrical",
    "density_file",
    "dents",
    "facets",
    "gradient",
    "granite",
    "hexagon",
    "image_pattern",
    "julia",
    "leopard",
    "magnet",
    "mandel",
    "marble",
    "object",
    "onion",
    "pavement",
    "pigment_pattern",
    "planar",
    "quilted",
    "radial",
    "ripples",
    "slope",
    "spherical",
    "spiral1",
    "spiral2",
    "spotted",
    "square",
    "tiling",
    "triangular",
    "waves",
    "wood",
    "wrinkles",
];

/// Words that begin a color.
pub(super) const COLOR_WORDS: &[&str] =
    &["color", "rgb", "rgbf", "rgbt", "rgbft", "srgb", "srgbf", "srgbt", "srgbft", "red", "green", "blue", "filter", "transmit", "alpha"];

impl Parser {
    /// The next token's word; `None` where it is none.
    pub(super) fn peek_word(&mut self) -> Parse<Option<&'static str>> {
        Ok(match self.peek()? {
            Token::Word(word) => Some(*word),
            _ => None,
        })
    }

    /// Whether a block ends here: at a closing brace or bracket.
    pub(super) fn at_end_of_body(&mut self) -> Parse<bool> {
        Ok(matches!(self.peek()?, Token::Sign("}" | "]")))
    }

    /// A pattern from its word with its required parameters, where one follows. Of block patterns the list is left to the caller, of
    /// `object` too: its brace is open then.
    pub(super) fn accept_pattern(&mut self) -> Parse<Option<PatternKind>> {
        if self.peek_word()? == Some("function") {
            return Ok(Some(PatternKind::Function(Arc::new(self.function()?))));
        }
        let Some(word) = self.accept_any(PATTERN_WORDS)? else { return Ok(None) };
        Ok(Some(match word {
            "agate" => PatternKind::Agate { turbulence: 1.0 },
            "aoi" => PatternKind::Aoi,
            "average" => PatternKind::Average,
            "boxed" => PatternKind::Boxed,
            "bozo" => PatternKind::Bozo,
            "brick" => PatternKind::Brick { size: DVec3::new(8.0, 3.0, 4.5), mortar: 0.5 },
            "bumps" => PatternKind::Bumps,
            "cells" => PatternKind::Cells,
            "checker" => PatternKind::Checker,
            "crackle" => PatternKind::Crackle(Crackle::default()),
            "cubic" => PatternKind::Cubic,
            "cylindrical" => PatternKind::Cylindrical,
            "density_file" => self.density_file()?,
            "dents" => PatternKind::Dents,
            "facets" => PatternKind::Facets { coords: 0.0, size: 0.1 },
            "gradient" => PatternKind::Gradient(self.vector3()?),
            "granite" => PatternKind::Granite,
            "hexagon" => PatternKind::Hexagon,
            "image_pattern" => PatternKind::Image(Arc::new(self.image_map_block(true)?)),
            "julia" => {
                let c = self.vector2()?;
                self.comma()?;
                self.fractal(FractalSet::Power(2), Some(c))?
            }
            "leopard" => PatternKind::Leopard,
            "magnet" => {
                let span = self.span();
                let set = match self.float()? as i64 {
                    1 => FractalSet::Magnet1,
                    2 => FractalSet::Magnet2,
                    _ => return Err(self.error(span, "`magnet` must be 1 or 2")),
                };
                if self.accept("julia")? {
                    let c = self.vector2()?;
                    self.comma()?;
                    self.fractal(set, Some(c))?
                } else {
                    self.expect("mandel")?;
                    self.fractal(set, None)?
                }
            }
            "mandel" => self.fractal(FractalSet::Power(2), None)?,
            "marble" => PatternKind::Marble,
            "object" => {
                self.expect("{")?;
                let object = match self.accept_value(pick!(Object))? {
                    Some(object) => object,
                    None => Arc::new(self.object()?),
                };
                let id = self.scene.pattern_objects.len() as etendue_procedural::ObjectId;
                self.scene.pattern_objects.push(object);
                PatternKind::Object(id)
            }
            "onion" => PatternKind::Onion,
            "pavement" => PatternKind::Pavement(Pavement::default()),
            "pigment_pattern" => {
                self.expect("{")?;
                let pigment = self.pigment_body(None)?;
                self.expect("}")?;
                PatternKind::Pigment(Arc::new(pigment))
            }
            "planar" => PatternKind::Planar,
            "quilted" => PatternKind::Quilted { control0: 1.0, control1: 1.0 },
            "radial" => PatternKind::Radial,
            "ripples" => PatternKind::Ripples,
            "slope" => PatternKind::Slope(self.slope()?),
            "spherical" => PatternKind::Spherical,
            "spiral1" => PatternKind::Spiral1(self.float()?),
            "spiral2" => PatternKind::Spiral2(self.float()?),
            "spotted" => PatternKind::Spotted,
            "square" => PatternKind::Square,
            "tiling" => {
                let span = self.span();
                let number = self.float()?;
                if !(1.0..28.0).contains(&number) {
                    return Err(self.error(span, "`tiling` must be from 1 to 27"));
                }
                PatternKind::Tiling(number as u8)
            }
            "triangular" => PatternKind::Triangular,
            "waves" => PatternKind::Waves,
            "wood" => PatternKind::Wood,
            // The last of `PATTERN_WORDS`.
            _ => PatternKind::Wrinkles,
        }))
    }

    fn fractal(&mut self, set: FractalSet, julia: Option<DVec2>) -> Parse<PatternKind> {
        let iterations = self.float()?.clamp(1.0, f64::from(u32::MAX)) as u32;
        Ok(PatternKind::Fractal(Fractal { set, julia, iterations, ..Fractal::mandelbrot(iterations) }))
    }

    fn density_file(&mut self) -> Parse<PatternKind> {
        self.expect("df3")?;
        let span = self.span();
        let name = self.string()?;
        let bytes = self.file_bytes(&name, span)?;
        match DensityFile::read_df3(&bytes) {
            Ok(file) => Ok(PatternKind::DensityFile(Arc::new(file))),
            Err(message) => Err(self.error(span, format!("{name}: {message}"))),
        }
    }

    fn slope(&mut self) -> Parse<Slope> {
        let braces = self.accept("{")?;
        let point_at = self.accept("point_at")?;
        let mut slope = Slope {
            direction: self.vector3()?,
            point_at,
            slope_range: DVec2::new(0.0, 1.0),
            altitude: DVec3::ZERO,
            altitude_range: DVec2::new(0.0, 1.0),
        };
        if !braces {
            return Ok(slope);
        }
        slope.slope_range = self.optional_range()?.unwrap_or(slope.slope_range);
        if self.accept("altitude")? {
            slope.altitude = self.vector3()?;
            slope.altitude_range = self.optional_range()?.unwrap_or(slope.altitude_range);
        }
        self.expect("}")?;
        Ok(slope)
    }

    /// `, low, high`, where it follows.
    fn optional_range(&mut self) -> Parse<Option<DVec2>> {
        self.comma()?;
        if !self.at_float()? {
            return Ok(None);
        }
        let low = self.float()?;
        self.comma()?;
        Ok(Some(DVec2::new(low, self.float()?)))
    }

    /// One modifier that all patterns or this kind of pattern have, where one follows.
    pub(super) fn accept_pattern_modifier(&mut self, pattern: &mut Pattern) -> Parse<bool> {
        if let Some(matrix) = self.accept_transform()? {
            pattern.transform(&matrix);
            return Ok(true);
        }
        let Some(word) = self.peek_word()? else { return Ok(false) };
        match word {
            "turbulence" => {
                self.next()?;
                pattern.placement.turbulence.get_or_insert_default().amount = self.vector3()?;
            }
            "octaves" | "omega" | "lambda" => {
                self.next()?;
                let mut walk = pattern.placement.turbulence.unwrap_or_default().walk;
                self.walk_item(word, &mut walk)?;
                pattern.placement.turbulence.get_or_insert_default().walk = walk;
            }
            "warp" => {
                let warp = self.warp()?;
                if let Some(warp) = warp {
                    pattern.placement.warp(warp);
                }
            }
            "frequency" => {
                self.next()?;
                pattern.wave.frequency = narrow(self.float()?);
            }
            "phase" => {
                self.next()?;
                pattern.wave.phase = narrow(self.float()?);
            }
            "ramp_wave" | "triangle_wave" | "sine_wave" | "scallop_wave" | "cubic_wave" => {
                self.next()?;
                pattern.wave.form = match word {
                    "ramp_wave" => WaveForm::Ramp,
                    "triangle_wave" => WaveForm::Triangle,
                    "sine_wave" => WaveForm::Sine,
                    "scallop_wave" => WaveForm::Scallop,
                    _ => WaveForm::Cubic,
                };
            }
            "poly_wave" => {
                self.next()?;
                pattern.wave.form = WaveForm::Poly(if self.at_float()? { narrow(self.float()?) } else { 1.0 });
            }
            "noise_generator" => {
                self.next()?;
                pattern.noise_generator = Some(self.float()?.clamp(1.0, 3.0) as u8);
            }
            _ => return self.accept_kind_modifier(word, &mut pattern.kind),
        }
        Ok(true)
    }

    /// A modifier of one kind of pattern, where `word` is one.
    fn accept_kind_modifier(&mut self, word: &'static str, kind: &mut PatternKind) -> Parse<bool> {
        match (word, kind) {
            ("agate_turb", PatternKind::Agate { turbulence }) => {
                self.next()?;
                *turbulence = self.float()?;
            }
            ("brick_size", PatternKind::Brick { size, .. }) => {
                self.next()?;
                *size = self.vector3()?;
            }
            ("mortar", PatternKind::Brick { mortar, .. }) => {
                self.next()?;
                *mortar = self.float()?;
            }
            ("control0", PatternKind::Quilted { control0, .. }) => {
                self.next()?;
                *control0 = self.float()?;
            }
            ("control1", PatternKind::Quilted { control1, .. }) => {
                self.next()?;
                *control1 = self.float()?;
            }
            ("form" | "metric" | "offset" | "solid", PatternKind::Crackle(crackle)) => {
                self.next()?;
                match word {
                    "form" => crackle.form = self.vector3()?,
                    "metric" => crackle.metric = self.float()?,
                    "offset" => crackle.offset = self.float()?,
                    _ => crackle.solid = self.flag()?,
                }
            }
            ("coords", PatternKind::Facets { coords, .. }) => {
                self.next()?;
                *coords = self.float()?;
            }
            ("size", PatternKind::Facets { coords, size }) => {
                self.next()?;
                (*coords, *size) = (0.0, self.float()?);
            }
            ("exponent", PatternKind::Fractal(fractal)) => {
                self.next()?;
                let span = self.span();
                let exponent = self.float()?;
                if !(2.0..34.0).contains(&exponent) {
                    return Err(self.error(span, "`exponent` must be from 2 to 33"));
                }
                if let FractalSet::Power(n) = &mut fractal.set {
                    *n = exponent as u8;
                }
            }
            ("exterior" | "interior", PatternKind::Fractal(fractal)) => {
                self.next()?;
                let method = self.float()?.clamp(0.0, 8.0) as u8;
                self.comma()?;
                let coloring = Coloring { method, factor: if self.at_float()? { self.float()? } else { 1.0 } };
                *(if word == "exterior" { &mut fractal.exterior } else { &mut fractal.interior }) = coloring;
            }
            ("interpolate", PatternKind::DensityFile(file)) => {
                self.next()?;
                Arc::make_mut(file).interpolation = match self.float()? as i64 {
                    1 => DensityInterpolation::Trilinear,
                    2 => DensityInterpolation::Tricubic,
                    _ => DensityInterpolation::None,
                };
            }
            ("number_of_sides" | "number_of_tiles" | "pattern" | "exterior" | "interior" | "form", PatternKind::Pavement(pavement)) => {
                self.next()?;
                let n = self.float()?.clamp(0.0, 255.0) as u8;
                *match word {
                    "number_of_sides" => &mut pavement.sides,
                    "number_of_tiles" => &mut pavement.tiles,
                    "pattern" => &mut pavement.pattern,
                    "exterior" => &mut pavement.exterior,
                    "interior" => &mut pavement.interior,
                    _ => &mut pavement.form,
                } = n;
            }
            // Without effect where there is no such pattern, as in a solid pigment.
            ("agate_turb" | "mortar" | "control0" | "control1" | "metric", _) => {
                self.next()?;
                self.float()?;
            }
            ("brick_size", _) => {
                self.next()?;
                self.vector3()?;
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn walk_item(&mut self, word: &str, walk: &mut Turbulence) -> Parse<()> {
        let value = self.float()?;
        match word {
            "octaves" => walk.octaves = value.clamp(1.0, OCTAVES_LIMIT) as u32,
            "omega" => walk.omega = narrow(value),
            _ => walk.lambda = narrow(value),
        }
        Ok(())
    }

    /// `warp { … }`; `None` for one without effect.
    fn warp(&mut self) -> Parse<Option<Warp>> {
        self.expect("warp")?;
        self.expect("{")?;
        let Some(word) =
            self.accept_any(&["repeat", "black_hole", "turbulence", "cylindrical", "spherical", "toroidal", "planar", "cubic"])?
        else {
            return Err(self.unexpected("a warp"));
        };
        let warp = match word {
            "repeat" => self.repeat_warp()?,
            "black_hole" => Some(Warp::BlackHole(Box::new(self.black_hole()?))),
            "turbulence" => {
                let mut turbulent = Turbulent { amount: self.vector3()?, ..Turbulent::default() };
                while let Some(word) = self.accept_any(&["octaves", "omega", "lambda"])? {
                    self.walk_item(word, &mut turbulent.walk)?;
                }
                Some(Warp::Turbulence(turbulent))
            }
            "cylindrical" => Some(Warp::Cylindrical(self.wrap()?.0)),
            "spherical" => Some(Warp::Spherical(self.wrap()?.0)),
            "toroidal" => {
                let (wrap, major_radius) = self.wrap()?;
                Some(Warp::Toroidal { wrap, major_radius })
            }
            "planar" => {
                let mut normal = DVec3::Z;
                let mut distance = 0.0;
                if !self.at_end_of_body()? {
                    normal = self.vector3()?;
                    self.comma()?;
                    distance = self.float()?;
                }
                Some(Warp::Planar { normal, distance })
            }
            _ => Some(Warp::Cubic),
        };
        self.expect("}")?;
        Ok(warp)
    }

    fn repeat_warp(&mut self) -> Parse<Option<Warp>> {
        let span = self.span();
        let direction = self.vector3()?;
        let (mut offset, mut flip) = (DVec3::ZERO, [false; 3]);
        while let Some(word) = self.accept_any(&["offset", "flip"])? {
            let v = self.vector3()?;
            match word {
                "offset" => offset = v,
                _ => flip = v.to_array().map(|c| c != 0.0),
            }
        }
        let mut axes = (0..3_u8).filter(|i| direction[usize::from(*i)] != 0.0);
        match (axes.next(), axes.next()) {
            (Some(axis), None) => Ok(Some(Warp::Repeat { axis, width: direction[usize::from(axis)], offset, flip })),
            (None, _) => Ok(None),
            _ => Err(self.error(span, "the vector of `repeat` must lie along an axis")),
        }
    }

    fn black_hole(&mut self) -> Parse<BlackHole> {
        let center = self.vector3()?;
        self.comma()?;
        let mut hole = BlackHole {
            center,
            radius: self.float()?,
            strength: 1.0,
            falloff: 2.0,
            inverse: false,
            repeat: DVec3::ZERO,
            turbulence: DVec3::ZERO,
        };
        while let Some(word) = self.accept_any(&["strength", "falloff", "inverse", "repeat", "turbulence", "type"])? {
            match word {
                "strength" => hole.strength = self.float()?,
                "falloff" => hole.falloff = self.float()?,
                "inverse" => hole.inverse = self.flag()?,
                "repeat" => hole.repeat = self.vector3()?,
                "turbulence" => hole.turbulence = self.vector3()?,
                _ => {
                    self.float()?;
                }
            }
        }
        Ok(hole)
    }

    /// Items of the mapping warps: how they are turned, and the major radius.
    fn wrap(&mut self) -> Parse<(Wrap, f64)> {
        let (mut wrap, mut major_radius) = (Wrap::default(), 1.0);
        while let Some(word) = self.accept_any(&["orientation", "dist_exp", "major_radius"])? {
            match word {
                "orientation" => wrap.orientation = self.vector3()?,
                "dist_exp" => wrap.dist_exp = self.float()?,
                _ => major_radius = self.float()?,
            }
        }
        Ok((wrap, major_radius))
    }

    /// The inside of `pattern { … }` in functions, up to its brace.
    pub(crate) fn pattern(&mut self) -> Parse<Pattern> {
        let Some(kind) = self.accept_pattern()? else { return Err(self.unexpected("a pattern")) };
        if matches!(kind, PatternKind::Object(_)) {
            self.expect("}")?;
        }
        let mut pattern = Pattern::new(kind);
        while !self.at_end_of_body()? {
            if !self.accept_pattern_modifier(&mut pattern)? {
                return Err(self.unexpected("a pattern"));
            }
        }
        Ok(pattern)
    }
}

/// Frequency, phase, places in maps and the like have single precision in POV-Ray (measured: phase 0.3 is 0.300000011920929).
pub(super) fn narrow(v: f64) -> f64 {
    f64::from(v as f32)
}

/// The wave form and the generator of a pattern for another kind in the same place.
pub(super) fn change_kind(pattern: &mut Pattern, kind: PatternKind) {
    pattern.wave = Wave::of(&kind);
    pattern.kind = kind;
}

#[cfg(test)]
mod tests {
    use super::*;
    use etendue_procedural::Context;

    fn numbers(text: &str, separator: char) -> Vec<f64> {
        text.split(separator).map(|n| n.parse().unwrap()).collect()
    }

    /// Every pattern and pigment of the list has POV-Ray's values.
    #[test]
    fn measured_values() {
        let mut points = Vec::new();
        let mut wrong = Vec::new();
        for line in include_str!("../../../../tests/pov/patterns.txt").lines() {
            if let Some(rest) = line.strip_prefix("points ") {
                points = rest.split(' ').map(|p| DVec3::from_slice(&numbers(p, ','))).collect();
                continue;
            }
            let mut parts = line.splitn(3, '|');
            let (kind, body, values) = (parts.next().unwrap(), parts.next(), parts.next());
            let (Some(body), Some(values)) = (body, values) else { continue };
            let mut parser = Parser::from_text(&format!("{body} }}"));
            for (p, expected) in points.iter().zip(values.split(' ')) {
                let expected = numbers(expected, ',');
                let context = Context::at(*p);
                let got = if kind == "pattern" {
                    let mut parser = Parser::from_text(&format!("{body} }}"));
                    parser.pattern().map(|pattern| vec![pattern.value(&context)])
                } else {
                    let pigment = parser.pigment_body(None).map(Some).unwrap_or(None);
                    parser = Parser::from_text(&format!("{body} }}"));
                    pigment
                        .map(|p| p.color(&context))
                        .map(|c| vec![c.rgb.x, c.rgb.y, c.rgb.z, c.filter, c.transmit])
                        .ok_or(super::super::super::Stop)
                };
                let Ok(got) = got else {
                    wrong.push(format!("{body}: not read: {:?}", parser.report));
                    break;
                };
                if expected.iter().zip(&got).any(|(e, g)| (e - g).abs() > 2e-6) {
                    wrong.push(format!("{body} at {p}: {got:?}, measured {expected:?}"));
                }
            }
        }
        assert!(wrong.is_empty(), "{} differ:\n{}", wrong.len(), wrong.join("\n"));
    }

    /// Absurd patterns, maps and warps are errors or harmless numbers: no panic, no endless loop.
    #[test]
    fn hostile_pigments() {
        let mut deep = "rgb 1".to_owned();
        for _ in 0..60 {
            deep = format!("gradient x pigment_map {{ [0 {deep}] [1 rgb 0] }}");
        }
        for (body, valid) in [
            ("gradient x color_map { }", false),
            ("gradient x color_map { [0 rgb 1", false),
            ("gradient x pigment_map { [0 ] }", true),
            ("gradient 0 color_map { [0 rgb 1] }", true),
            ("gradient x frequency 1e300 phase -1e300 scale 1e-300", true),
            ("wood scale 0 turbulence 1e300 octaves 1e9 lambda 1e300 omega 1e300", true),
            ("brick brick_size 0 mortar 1e300", true),
            ("mandel -5 exponent 33", true),
            ("mandel 10 exponent 34", false),
            ("tiling 28", false),
            ("gradient x warp { repeat <1,1,0> }", false),
            ("gradient x warp { repeat 0 } warp { black_hole 0, 0 falloff -1e300 repeat 1e-300 }", true),
            ("crackle metric 0 form 1e300 offset -1 scale 1e-300", true),
            ("spiral2 1e300 poly_wave -1e300", true),
            (deep.as_str(), false),
        ] {
            let pigment = Parser::from_text(&format!("{body} }}")).pigment_body(None);
            assert_eq!(pigment.is_ok(), valid, "{body}");
            if let Ok(pigment) = pigment {
                for v in [0.3, 0.0, -1e300, f64::NAN, f64::INFINITY] {
                    let _ = pigment.color(&Context::at(DVec3::new(v, 0.2, -v)));
                }
            }
        }
    }
}
