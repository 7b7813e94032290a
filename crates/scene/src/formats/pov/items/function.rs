//! `function` and `spline` (sections *Function* and *Splines* of the reference, 3.3.1.8 and 3.3.1.11).
//!
//! Expressions of functions are not those of the rest of the language: all is a float, comparisons and logic need no parentheses
//! and group to the right, and identifiers may be parameters. What holds no parameter (`A[2]`, `V.x`, `image_width` …) is read by the
//! language's own expressions and becomes a constant.

use std::sync::Arc;

use etendue_procedural::function::{Binary, Builder, Component, Internal, Operand, Unary};
use etendue_procedural::{Function, Spline, SplineKind};

use super::super::{Parse, Parser, Token, Value};

/// Most parameters of a function, as in POV-Ray.
const MOST_PARAMETERS: usize = 56;
/// Most points of a spline.
const MOST_POINTS: usize = 1 << 20;

/// Words that may name a parameter.
const PARAMETER_WORDS: &[&str] = &["x", "y", "z", "u", "v", "t"];

/// The kind of spline that a word means.
pub(crate) fn spline_kind(word: &str) -> Option<SplineKind> {
    Some(match word {
        "linear_spline" => SplineKind::Linear,
        "quadratic_spline" => SplineKind::Quadratic,
        "cubic_spline" => SplineKind::Cubic,
        "natural_spline" => SplineKind::Natural,
        _ => return None,
    })
}

/// The words of [`spline_kind`].
pub(crate) const SPLINE_WORDS: &[&str] = &["linear_spline", "quadratic_spline", "cubic_spline", "natural_spline"];

impl Parser {
    /// `function [(a, b, …)] { … }` in all its forms (expression, `pigment`, `pattern`, `transform`, `spline`, `internal`).
    pub(crate) fn function(&mut self) -> Parse<Function> {
        self.expect("function")?;
        let mut parameters = Vec::new();
        if self.accept("(")? {
            while !self.accept(")")? {
                let span = self.span();
                parameters.push(self.parameter_name()?);
                if parameters.len() > MOST_PARAMETERS {
                    return Err(self.error(span, format!("a function of more than {MOST_PARAMETERS} parameters")));
                }
                self.comma()?;
            }
        }
        if parameters.is_empty() {
            parameters = ["x", "y", "z"].map(String::from).to_vec();
        }
        self.function_body(parameters)
    }

    /// `{ … }` of a function with these parameters.
    pub(crate) fn function_body(&mut self, parameters: Vec<String>) -> Parse<Function> {
        self.expect("{")?;
        let span = self.span();
        let function = match self.peek()? {
            Token::Word("pigment") => Function::pigment(Arc::new(self.pigment()?)),
            Token::Word("pattern") => {
                self.next()?;
                self.expect("{")?;
                let pattern = self.pattern()?;
                self.expect("}")?;
                Function::pattern(Arc::new(pattern))
            }
            Token::Word("transform") => Function::transform(self.accept_transform()?.unwrap_or_default()),
            Token::Word("spline") => Function::spline(Arc::new(self.spline()?)),
            Token::Word("internal") => {
                self.next()?;
                self.expect("(")?;
                let number = self.float()?;
                self.expect(")")?;
                match Internal::new(if (0.0..1e6).contains(&number) { number as u32 } else { u32::MAX }) {
                    Some(f) => Function::internal(f),
                    None => return Err(self.error(span, format!("there is no internal function {number}"))),
                }
            }
            _ => {
                let mut builder = Builder::new(parameters);
                let result = self.function_expression(&mut builder)?;
                match builder.finish(result) {
                    Ok(f) => f,
                    Err(_) => return Err(self.error(span, "this function is too long or calls functions too deep")),
                }
            }
        };
        self.expect("}")?;
        Ok(function)
    }

    /// The name of a parameter or running variable, declared elsewhere or not.
    fn parameter_name(&mut self) -> Parse<String> {
        let name = match self.peek()? {
            Token::Word(w) if PARAMETER_WORDS.contains(w) => (*w).to_owned(),
            Token::Unknown(name) | Token::Identifier(name, _) => name.to_string(),
            _ => return Err(self.unexpected("the parameters of a function")),
        };
        self.next()?;
        Ok(name)
    }

    /// Terms joined by `|`.
    fn function_expression(&mut self, b: &mut Builder) -> Parse<Operand> {
        self.deeper(|p| {
            let mut left = p.function_and(b)?;
            while p.accept("|")? {
                let right = p.function_and(b)?;
                left = b.binary(Binary::Or, left, right);
            }
            Ok(left)
        })
    }

    fn function_and(&mut self, b: &mut Builder) -> Parse<Operand> {
        let mut left = self.function_relation(b)?;
        while self.accept("&")? {
            let right = self.function_relation(b)?;
            left = b.binary(Binary::And, left, right);
        }
        Ok(left)
    }

    /// Comparisons: POV-Ray's output shows that a < b < c is a < (b < c).
    fn function_relation(&mut self, b: &mut Builder) -> Parse<Operand> {
        let mut left = Vec::new();
        let mut right = self.function_sum(b)?;
        while let Token::Sign(s @ ("<" | "<=" | "=" | "!=" | ">=" | ">")) = self.peek()? {
            left.push((right, *s));
            self.next()?;
            right = self.function_sum(b)?;
        }
        for (a, sign) in left.into_iter().rev() {
            right = match sign {
                "<" => b.binary(Binary::Less, a, right),
                "<=" => b.binary(Binary::LessEqual, a, right),
                "=" => b.binary(Binary::Equal, a, right),
                "!=" => b.binary(Binary::NotEqual, a, right),
                ">=" => b.binary(Binary::LessEqual, right, a),
                _ => b.binary(Binary::Less, right, a),
            };
        }
        Ok(right)
    }

    fn function_sum(&mut self, b: &mut Builder) -> Parse<Operand> {
        let mut left = self.function_product(b)?;
        while let Token::Sign(s @ ("+" | "-")) = self.peek()? {
            let operation = if *s == "+" { Binary::Add } else { Binary::Subtract };
            self.next()?;
            let right = self.function_product(b)?;
            left = b.binary(operation, left, right);
        }
        Ok(left)
    }

    fn function_product(&mut self, b: &mut Builder) -> Parse<Operand> {
        let mut left = self.function_factor(b)?;
        while let Token::Sign(s @ ("*" | "/")) = self.peek()? {
            let operation = if *s == "*" { Binary::Multiply } else { Binary::Divide };
            self.next()?;
            let right = self.function_factor(b)?;
            left = b.binary(operation, left, right);
        }
        Ok(left)
    }

    /// Signs before an operand; a chain of them is a loop, not a recursion.
    fn function_factor(&mut self, b: &mut Builder) -> Parse<Operand> {
        let mut negative = false;
        while let Token::Sign(s @ ("+" | "-")) = self.peek()? {
            negative ^= *s == "-";
            self.next()?;
        }
        let operand = self.function_operand(b)?;
        Ok(if negative { b.unary(Unary::Negate, operand) } else { operand })
    }

    fn function_operand(&mut self, b: &mut Builder) -> Parse<Operand> {
        let span = self.span();
        if b.is_too_long() {
            return Err(self.error(span, "this function is too long"));
        }
        match self.peek()?.clone() {
            Token::Number(n) => {
                self.next()?;
                Ok(b.number(n))
            }
            Token::Sign("(") => {
                self.next()?;
                let inner = self.function_expression(b)?;
                self.expect(")")?;
                Ok(inner)
            }
            Token::Word(w) => self.function_word(b, w),
            Token::Unknown(name) => match b.parameter(&name) {
                Some(parameter) => {
                    self.next()?;
                    Ok(parameter)
                }
                None => Err(self.unexpected("a function")),
            },
            Token::Identifier(name, value) => {
                if let Some(parameter) = b.parameter(&name) {
                    self.next()?;
                    return Ok(parameter);
                }
                match value {
                    Value::Function(f) => {
                        self.next()?;
                        self.function_call(b, &f)
                    }
                    Value::Spline(s) => {
                        self.next()?;
                        self.function_call(b, &Arc::new(Function::spline(s)))
                    }
                    _ => self.function_constant(b),
                }
            }
            _ => Err(self.unexpected("a function")),
        }
    }

    /// What the rest of the language says about it: a float without parameters.
    fn function_constant(&mut self, b: &mut Builder) -> Parse<Operand> {
        let span = self.span();
        let n = self.operand()?;
        if n.len != 1 {
            return Err(self.error(span, "a function is made of floats, but this is a vector or color"));
        }
        Ok(b.number(n.v[0]))
    }

    fn function_word(&mut self, b: &mut Builder, word: &'static str) -> Parse<Operand> {
        if let Some(parameter) = b.parameter(word) {
            self.next()?;
            return Ok(parameter);
        }
        let span = self.span();
        if let Some(operation) = Unary::from_name(word) {
            self.next()?;
            self.expect("(")?;
            let a = self.function_expression(b)?;
            self.expect(")")?;
            return Ok(b.unary(operation, a));
        }
        if let Some(operation) = Binary::from_name(word) {
            self.next()?;
            let mut left = None;
            let count = self.function_arguments(b, |b, _, a| left = Some(left.map_or(a, |l| b.binary(operation, l, a))))?;
            let is_variadic = matches!(operation, Binary::Min | Binary::Max);
            return match left {
                Some(value) if count == 2 || (is_variadic && count > 2) => Ok(value),
                _ => Err(self.error(span, format!("`{word}` of {count} values"))),
            };
        }
        match word {
            "select" => self.function_select(b),
            "sum" | "prod" => {
                self.next()?;
                self.expect("(")?;
                let name = self.parameter_name()?;
                self.expect(",")?;
                let first = self.function_expression(b)?;
                self.expect(",")?;
                let last = self.function_expression(b)?;
                self.expect(",")?;
                let l = b.begin_loop(name, first, last, word == "prod");
                let term = self.function_expression(b)?;
                self.expect(")")?;
                Ok(b.end_loop(l, term))
            }
            _ if PARAMETER_WORDS.contains(&word) => Err(self.error(span, format!("`{word}` is no parameter of this function"))),
            _ => self.function_constant(b),
        }
    }

    /// `( a, b, … )`; visits each with its number, returns how many there are.
    fn function_arguments(&mut self, b: &mut Builder, mut visit: impl FnMut(&mut Builder, usize, Operand)) -> Parse<usize> {
        self.expect("(")?;
        let mut count = 0;
        while !self.accept(")")? {
            let a = self.function_expression(b)?;
            visit(b, count, a);
            count += 1;
            if !self.accept(",")? {
                self.expect(")")?;
                break;
            }
        }
        Ok(count)
    }

    /// `select(a, negative, not_negative)` or `select(a, negative, zero, positive)`.
    fn function_select(&mut self, b: &mut Builder) -> Parse<Operand> {
        self.next()?;
        self.expect("(")?;
        let condition = self.function_expression(b)?;
        self.expect(",")?;
        let mut select = b.begin_select(condition);
        let first = self.function_expression(b)?;
        self.expect(",")?;
        b.next_case(&mut select, first);
        let mut last = self.function_expression(b)?;
        if self.accept(",")? {
            b.next_case(&mut select, last);
            last = self.function_expression(b)?;
        }
        self.expect(")")?;
        Ok(b.end_select(select, last))
    }

    /// The arguments of a function's call, and the component where it returns several.
    fn function_call(&mut self, b: &mut Builder, f: &Arc<Function>) -> Parse<Operand> {
        let span = self.span();
        let mut arguments = Vec::new();
        let count = self.function_arguments(b, |_, _, a| arguments.push(a))?;
        if count != f.parameters.len() {
            let wanted = f.parameters.len();
            return Err(self.error(span, format!("this function has {wanted} parameters, but {count} are given")));
        }
        if !f.is_known() {
            self.loss(span, "f_comma or f_helical_torus", "is 0 everywhere");
        }
        let mut component = Component::Number(0);
        if f.is_vector() {
            self.expect(".")?;
            let span = self.span();
            component = match self.next()? {
                Token::Word(w) => Component::from_name(w),
                Token::Unknown(w) | Token::Identifier(w, _) => Component::from_name(&w),
                _ => None,
            }
            .ok_or_else(|| self.error(span, "a call of a vector function needs one component, such as .x or .red"))?;
        }
        Ok(b.call(f, &arguments, component))
    }

    /// `spline { … }`.
    pub(crate) fn spline(&mut self) -> Parse<Spline> {
        self.expect("spline")?;
        self.expect("{")?;
        let (mut kind, mut points, mut components) = (SplineKind::Linear, Vec::new(), 2);
        if let Some(s) = self.accept_value(|v| if let Value::Spline(s) = v { Some(s.clone()) } else { None })? {
            (kind, points, components) = (s.kind(), s.points().to_vec(), s.components());
        }
        if let Some(k) = self.accept_any(SPLINE_WORDS)?.and_then(spline_kind) {
            kind = k;
        }
        let span = self.span();
        self.comma()?;
        while !self.accept("}")? {
            let t = self.float()?;
            self.expect(",")?;
            let n = self.num()?;
            components = components.max(usize::from(n.len));
            points.push((t, n.v));
            if points.len() > MOST_POINTS {
                return Err(self.error(span, format!("a spline of more than {MOST_POINTS} points")));
            }
            self.comma()?;
        }
        if points.is_empty() {
            return Err(self.error(span, "a spline without points"));
        }
        Ok(Spline::new(kind, points, components))
    }
}

#[cfg(test)]
mod tests;
