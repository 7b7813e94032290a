//! Numeric expressions: operators, vectors, colors (Numeric, Vector and Color Expressions).
//!
//! Comparisons and logic are allowed in parentheses only, as `<` begins a vector elsewhere.

use glam::{DMat4, DQuat, DVec3};

use super::directive_flow::EPSILON;
use super::parser::{Parse, Parser, Token};
use super::value::{Num, Value};

/// Words that begin a number.
const NUMBER_WORDS: &[&str] = &[
    "abs",
    "acos",
    "acosh",
    "asc",
    "asin",
    "asinh",
    "atan",
    "atan2",
    "atanh",
    "bitwise_and",
    "bitwise_or",
    "bitwise_xor",
    "ceil",
    "clock",
    "clock_delta",
    "clock_on",
    "cos",
    "cosh",
    "defined",
    "degrees",
    "dimension_size",
    "dimensions",
    "div",
    "exp",
    "false",
    "file_exists",
    "final_clock",
    "final_frame",
    "floor",
    "frame_number",
    "image_height",
    "image_width",
    "initial_clock",
    "initial_frame",
    "inside",
    "int",
    "ln",
    "log",
    "max",
    "max_extent",
    "min",
    "min_extent",
    "mod",
    "no",
    "now",
    "off",
    "on",
    "pi",
    "pow",
    "prod",
    "radians",
    "rand",
    "seed",
    "select",
    "sin",
    "sinh",
    "sqr",
    "sqrt",
    "strcmp",
    "strlen",
    "sum",
    "t",
    "tan",
    "tanh",
    "trace",
    "true",
    "u",
    "v",
    "val",
    "vaxis_rotate",
    "vcross",
    "vdot",
    "version",
    "vlength",
    "vnormalize",
    "vrotate",
    "vturbulence",
    "x",
    "y",
    "yes",
    "z",
];

/// Words that begin a color.
pub(super) const COLOR_WORDS: &[&str] =
    &["alpha", "blue", "color", "filter", "green", "red", "rgb", "rgbf", "rgbft", "rgbt", "srgb", "srgbf", "srgbft", "srgbt", "transmit"];

impl Parser {
    /// Whether the next token can begin a numeric expression.
    pub(super) fn at_number(&mut self) -> Parse<bool> {
        Ok(match self.peek()? {
            Token::Number(_) => true,
            Token::Sign(s) => matches!(*s, "(" | "<" | "+" | "-" | "!"),
            Token::Word(w) => NUMBER_WORDS.contains(w),
            Token::Identifier(_, v) => matches!(v, Value::Float(_) | Value::Vector(_) | Value::Function(_) | Value::Spline(_)),
            _ => false,
        })
    }

    /// Terms with `+` and `-`.
    pub(super) fn num(&mut self) -> Parse<Num> {
        self.deeper(|p| {
            let mut left = p.product()?;
            loop {
                let op = match p.peek()? {
                    Token::Sign(s @ ("+" | "-")) => *s,
                    _ => return Ok(left),
                };
                p.next()?;
                let right = p.product()?;
                left = combine(left, right, |a, b| if op == "+" { a + b } else { a - b });
            }
        })
    }

    fn product(&mut self) -> Parse<Num> {
        let mut left = self.factor()?;
        loop {
            let op = match self.peek()? {
                Token::Sign(s @ ("*" | "/")) => *s,
                _ => return Ok(left),
            };
            self.next()?;
            let span = self.span();
            let right = self.factor()?;
            if op == "*" {
                left = combine(left, right, |a, b| a * b);
            } else {
                let len = left.len.max(right.len);
                if right.promoted(len).v[..usize::from(len)].contains(&0.0) {
                    self.warning(span, "division by zero");
                }
                // A quotient by 0 is infinite and positive, whatever is divided (measured).
                left = combine(left, right, |a, b| if b == 0.0 { f64::INFINITY } else { a / b });
            }
        }
    }

    /// Unary operators before an operand. A chain of them is a loop, not a recursion.
    fn factor(&mut self) -> Parse<Num> {
        let mut operators = Vec::new();
        while let Token::Sign(s @ ("+" | "-" | "!")) = self.peek()? {
            let s = *s;
            self.next()?;
            if s != "+" {
                operators.push(s);
            }
        }
        let mut n = self.operand()?;
        for op in operators.iter().rev() {
            for x in &mut n.v[..usize::from(n.len)] {
                *x = if *op == "-" { -*x } else { f64::from(u8::from(x.abs() < EPSILON)) };
            }
        }
        Ok(n)
    }

    /// A number, identifier, function, vector or parenthesis, with the components picked by dots.
    pub(super) fn operand(&mut self) -> Parse<Num> {
        let mut n = match self.peek()? {
            Token::Number(x) => {
                let x = *x;
                self.next()?;
                return self.dots(Num::float(x));
            }
            Token::Sign("(") => {
                self.next()?;
                let n = self.full()?;
                self.expect(")")?;
                n
            }
            Token::Sign("<") => self.vector_literal()?,
            Token::Identifier(_, Value::Float(x)) => {
                let n = Num::float(*x);
                self.next()?;
                n
            }
            Token::Identifier(_, Value::Vector(v)) => {
                let n = Num::vector(v);
                self.next()?;
                n
            }
            Token::Identifier(_, Value::Function(f)) => {
                let f = f.clone();
                self.next()?;
                self.call_function(&f)?
            }
            Token::Identifier(_, Value::Spline(s)) => {
                let s = s.clone();
                self.next()?;
                self.call_spline(&s)?
            }
            Token::Word(w) if COLOR_WORDS.contains(w) => {
                let w = *w;
                self.next()?;
                let mut color = [0.0; 5];
                self.color_item(w, &mut color, true)?;
                Num { v: color, len: 5 }
            }
            Token::Word(w) if NUMBER_WORDS.contains(w) => {
                let w = *w;
                let span = self.span();
                self.next()?;
                self.word_value(w, span)?
            }
            _ => return Err(self.unexpected("a numeric expression")),
        };
        n = self.dots(n)?;
        Ok(n)
    }

    fn dots(&mut self, mut n: Num) -> Parse<Num> {
        while self.accept(".")? {
            let span = self.span();
            let component = match self.next()? {
                Token::Word(w) => w,
                Token::Unknown(_) | Token::Identifier(..) => "",
                _ => "",
            };
            let v = n.v;
            let x = match component {
                "x" | "u" | "red" => v[0],
                "y" | "v" | "green" => v[1],
                "z" | "blue" => v[2],
                "t" | "filter" => v[3],
                "transmit" => v[4],
                // Measured: what POV-Ray prints.
                "gray" => 0.297 * v[0] + 0.589 * v[1] + 0.114 * v[2],
                _ => return Err(self.error(span, "a dot needs one of x, y, z, t, u, v, red, green, blue, filter, transmit, gray")),
            };
            n = Num::float(x);
        }
        Ok(n)
    }

    /// `< a, b, … >`.
    fn vector_literal(&mut self) -> Parse<Num> {
        self.expect("<")?;
        let mut values = [0.0; 5];
        let mut count = 0;
        loop {
            let span = self.span();
            let n = self.num()?;
            if n.len != 1 {
                return Err(self.error(span, "a component of a vector must be a float"));
            }
            if count == 5 {
                return Err(self.error(span, "a vector of more than five components"));
            }
            values[count] = n.v[0];
            count += 1;
            self.comma()?;
            if self.accept(">")? {
                break;
            }
        }
        if count == 1 {
            let span = self.here();
            return Err(self.error(span, "a vector needs at least two components"));
        }
        Ok(Num::vector(&values[..count]))
    }

    /// A whole expression with comparisons, logic and the conditional operator, as parentheses hold it.
    pub(super) fn full(&mut self) -> Parse<Num> {
        self.deeper(|p| {
            let condition = p.logical()?;
            if !p.accept("?")? {
                return Ok(condition);
            }
            let first = p.full()?;
            p.expect(":")?;
            let second = p.full()?;
            Ok(if condition.v[0].abs() < EPSILON { second } else { first })
        })
    }

    /// A whole expression that is a float.
    pub(super) fn full_float(&mut self) -> Parse<f64> {
        let span = self.span();
        let n = self.full()?;
        if n.len != 1 {
            return Err(self.error(span, "a float is expected, but this is a vector or color"));
        }
        Ok(n.v[0])
    }

    fn logical(&mut self) -> Parse<Num> {
        let mut left = self.relation()?;
        loop {
            let op = match self.peek()? {
                Token::Sign(s @ ("&" | "|")) => *s,
                _ => return Ok(left),
            };
            self.next()?;
            let right = self.relation()?;
            let truth = |x: f64| x.abs() >= EPSILON;
            left = combine(left, right, |a, b| f64::from(u8::from(if op == "&" { truth(a) && truth(b) } else { truth(a) || truth(b) })));
        }
    }

    fn relation(&mut self) -> Parse<Num> {
        if self.at_string()? {
            let a = self.string_value()?;
            let op = self.comparison()?;
            let Some(op) = op else {
                let span = self.here();
                return Err(self.error(span, "a string is no number; it can only be compared"));
            };
            let b = self.string_value()?;
            let order = a.as_bytes().cmp(b.as_bytes()) as i32;
            return Ok(Num::float(compare(op, f64::from(order), 0.0)));
        }
        let mut left = self.num()?;
        while let Some(op) = self.comparison()? {
            let right = self.num()?;
            left = combine(left, right, |a, b| compare(op, a, b));
        }
        Ok(left)
    }

    fn comparison(&mut self) -> Parse<Option<&'static str>> {
        let op = match self.peek()? {
            Token::Sign(s @ ("<" | "<=" | "=" | ">=" | ">" | "!=")) => *s,
            _ => return Ok(None),
        };
        self.next()?;
        Ok(Some(op))
    }

    /// A color in all its forms, as five numbers, or as the number or vector that stands there.
    pub(super) fn color_num(&mut self) -> Parse<Num> {
        self.deeper(|p| {
            let mut color = [0.0; 5];
            let mut items = 0;
            loop {
                let is_first = items == 0;
                let (word, is_color) = match p.peek()? {
                    Token::Word(w) => (*w, false),
                    Token::Identifier(_, Value::Vector(v)) => ("", v.len() == 5),
                    _ => ("", false),
                };
                let is_channel = matches!(word, "red" | "green" | "blue" | "filter" | "transmit" | "alpha");
                // After a whole color only single channels belong to it: `rgb 1 rgb 2` are two.
                if word == "color" && is_first {
                    p.next()?;
                    if matches!(p.peek()?, Token::Word("color")) {
                        return Err(p.unexpected("a color"));
                    }
                    continue;
                } else if COLOR_WORDS.contains(&word) && word != "color" && (is_first || is_channel) {
                    p.next()?;
                    p.color_item(word, &mut color, false)?;
                } else if is_first && (is_color || p.at_number()?) {
                    color = p.num()?.promoted(5).v;
                } else {
                    break;
                }
                items += 1;
            }
            if items == 0 {
                return Err(p.unexpected("a color"));
            }
            Ok(Num { v: color, len: 5 })
        })
    }

    /// Words such as `filter 0.5` after a color.
    pub(super) fn color_words(&mut self, color: Num) -> Parse<Num> {
        let mut v = color.promoted(5).v;
        while let Some(word) = self.accept_any(&["red", "green", "blue", "filter", "transmit", "alpha"])? {
            self.color_item(word, &mut v, false)?;
        }
        Ok(Num { v, len: 5 })
    }

    /// What follows a word of a color; `is_factor` where an operator may follow that binds less tightly.
    fn color_item(&mut self, word: &str, color: &mut [f64; 5], is_factor: bool) -> Parse<()> {
        let span = self.span();
        if word == "color" {
            *color = self.color_num()?.v;
            return Ok(());
        }
        let n = if is_factor { self.factor()? } else { self.num()? };
        let single =
            |p: &mut Self| if n.len == 1 { Ok(n.v[0]) } else { Err(p.error(span, "a float is expected, but this is a vector or color")) };
        match word {
            "red" => color[0] = single(self)?,
            "green" => color[1] = single(self)?,
            "blue" => color[2] = single(self)?,
            "filter" | "alpha" => color[3] = single(self)?,
            "transmit" => color[4] = single(self)?,
            _ => {
                let is_srgb = word.starts_with('s');
                let (len, to_transmit) = match word.trim_start_matches('s') {
                    "rgb" => (3, false),
                    "rgbf" => (4, false),
                    "rgbt" => (4, true),
                    _ => (5, false),
                };
                let v = n.promoted(len).v;
                *color = match (len, to_transmit) {
                    (3, _) => [v[0], v[1], v[2], 0.0, 0.0],
                    (4, true) => [v[0], v[1], v[2], 0.0, v[3]],
                    (4, false) => [v[0], v[1], v[2], v[3], 0.0],
                    _ => v,
                };
                if is_srgb {
                    for c in &mut color[..3] {
                        *c = self.linear_of_srgb(*c);
                    }
                }
            }
        }
        Ok(())
    }

    /// From the sRGB transfer curve to the working space.
    fn linear_of_srgb(&self, c: f64) -> f64 {
        let linear = decode_srgb(c);
        let gamma = self.scene.settings.assumed_gamma;
        if (gamma - 1.0).abs() < 1e-6 || !(gamma > 0.0) { linear } else { etendue_procedural::fns::pow(linear.max(0.0), 1.0 / gamma) }
    }

    /// One transformation, if one follows.
    pub(super) fn transform_item(&mut self) -> Parse<Option<DMat4>> {
        let Some(word) = self.accept_any(&["translate", "rotate", "scale", "matrix", "transform"])? else { return Ok(None) };
        let span = self.here();
        Ok(Some(match word {
            "translate" => DMat4::from_translation(self.vector3()?),
            "rotate" => rotation(self.vector3()?),
            "scale" => {
                let mut s = self.vector3()?;
                for i in 0..3 {
                    if s[i] == 0.0 {
                        self.warning(span, "scaled by 0 in one direction; 1 is taken there");
                        s[i] = 1.0;
                    }
                }
                DMat4::from_scale(s)
            }
            "matrix" => self.matrix()?,
            _ => self.transform_block()?,
        }))
    }

    /// `< 12 floats >`, rows of the documentation's matrix.
    fn matrix(&mut self) -> Parse<DMat4> {
        self.expect("<")?;
        let mut m = [0.0; 12];
        for (i, v) in m.iter_mut().enumerate() {
            if i > 0 {
                self.comma()?;
            }
            *v = self.float()?;
        }
        self.expect(">")?;
        let column = |i: usize, w: f64| glam::DVec4::new(m[3 * i], m[3 * i + 1], m[3 * i + 2], w);
        Ok(DMat4::from_cols(column(0, 0.0), column(1, 0.0), column(2, 0.0), column(3, 1.0)))
    }

    /// What follows `transform`: an identifier or a block.
    pub(super) fn transform_block(&mut self) -> Parse<DMat4> {
        let pick = |v: &Value| if let Value::Transform(m) = v { Some(**m) } else { None };
        if let Some(m) = self.accept_value(pick)? {
            return Ok(m);
        }
        self.expect("{")?;
        let mut m = DMat4::IDENTITY;
        let mut is_inverse = false;
        loop {
            if let Some(next) = self.transform_item()? {
                m = next * m;
            } else if let Some(next) = self.accept_value(pick)? {
                m = next * m;
            } else if self.accept("inverse")? {
                is_inverse = !is_inverse;
            } else {
                break;
            }
        }
        let span = self.span();
        self.expect("}")?;
        if is_inverse {
            if m.determinant() == 0.0 || !m.is_finite() {
                return Err(self.error(span, "this transformation has no inverse"));
            }
            m = m.inverse();
        }
        Ok(m)
    }
}

/// sRGB (IEC 61966-2-1) decoding.
fn decode_srgb(c: f64) -> f64 {
    if c <= 0.04045 { c / 12.92 } else { etendue_procedural::fns::pow((c + 0.055) / 1.055, 2.4) }
}

/// Rotation about x, then y, then z by angles in degrees, in the left-handed sense.
pub(super) fn rotation(degrees: DVec3) -> DMat4 {
    // A left-handed system mirrors the right-handed one; the matrices of rotations are the same.
    rotation_about(DVec3::Z, degrees.z) * rotation_about(DVec3::Y, degrees.y) * rotation_about(DVec3::X, degrees.x)
}

/// Rotation about a unit axis by an angle in degrees.
pub(super) fn rotation_about(axis: DVec3, degrees: f64) -> DMat4 {
    let (s, c) = etendue_procedural::fns::sin_cos(degrees.to_radians() * 0.5);
    DMat4::from_quat(DQuat::from_xyzw(axis.x * s, axis.y * s, axis.z * s, c))
}

fn combine(a: Num, b: Num, f: impl Fn(f64, f64) -> f64) -> Num {
    let len = a.len.max(b.len);
    let (a, b) = (a.promoted(len), b.promoted(len));
    let mut v = [0.0; 5];
    for (i, v) in v.iter_mut().enumerate().take(usize::from(len)) {
        *v = f(a.v[i], b.v[i]);
    }
    Num { v, len }
}

/// Comparisons: all but `<` and `>` take close numbers for equal (measured).
fn compare(op: &str, a: f64, b: f64) -> f64 {
    let equal = (a - b).abs() < EPSILON;
    f64::from(u8::from(match op {
        "<" => a < b,
        "<=" => a < b || equal,
        "=" => equal,
        ">=" => a > b || equal,
        ">" => a > b,
        _ => !equal,
    }))
}
