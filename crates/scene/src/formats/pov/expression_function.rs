//! Functions and variables that words stand for in numeric expressions.

use etendue_procedural::{Context, Function, Spline, fns, noise};
use glam::DVec3;
use std::sync::Arc;

use super::Probe;
use super::expression::{rotation, rotation_about};
use super::items::{SPLINE_WORDS, spline_kind};
use super::parser::{Parse, Parser, Token};
use super::value::{Num, Value};
use crate::desc::classic::Object;
use crate::span::Span;

impl Parser {
    /// The value of a built-in variable or function; its word has been taken.
    pub(super) fn word_value(&mut self, word: &'static str, span: Span) -> Parse<Num> {
        let o = &self.options;
        let constant = match word {
            "x" => Some(Num::vector(&[1.0, 0.0, 0.0])),
            "y" => Some(Num::vector(&[0.0, 1.0, 0.0])),
            "z" => Some(Num::vector(&[0.0, 0.0, 1.0])),
            "t" => Some(Num::vector(&[0.0, 0.0, 0.0, 1.0])),
            "u" => Some(Num::vector(&[1.0, 0.0])),
            "v" => Some(Num::vector(&[0.0, 1.0])),
            "pi" => Some(Num::float(std::f64::consts::PI)),
            "true" | "yes" | "on" => Some(Num::float(1.0)),
            "false" | "no" | "off" => Some(Num::float(0.0)),
            "clock" => Some(Num::float(o.clock)),
            "clock_on" => Some(Num::float(f64::from(u8::from(o.is_animation)))),
            "clock_delta" => Some(Num::float(o.clock_delta())),
            "frame_number" => Some(Num::float(f64::from(o.frame))),
            "initial_frame" => Some(Num::float(f64::from(o.frames[0]))),
            "final_frame" => Some(Num::float(f64::from(o.frames[1]))),
            "initial_clock" => Some(Num::float(o.clocks[0])),
            "final_clock" => Some(Num::float(o.clocks[1])),
            "image_width" => Some(Num::float(f64::from(o.size[0]))),
            "image_height" => Some(Num::float(f64::from(o.size[1]))),
            "version" => Some(Num::float(f64::from(self.stated_version) / 100.0)),
            "now" => Some(Num::float(super::strings::days_since_2000())),
            _ => None,
        };
        if let Some(n) = constant {
            return Ok(n);
        }
        self.expect("(")?;
        let n = self.function_value(word, span)?;
        self.expect(")")?;
        Ok(n)
    }

    /// A float argument; `first` where no comma comes before it.
    fn argument_float(&mut self, first: bool) -> Parse<f64> {
        if !first {
            self.comma()?;
        }
        self.full_float()
    }

    fn argument_vector(&mut self, first: bool) -> Parse<DVec3> {
        if !first {
            self.comma()?;
        }
        Ok(self.full()?.xyz())
    }

    fn further_floats(&mut self) -> Parse<Vec<f64>> {
        let mut values = vec![self.full_float()?];
        while self.accept(",")? {
            values.push(self.full_float()?);
        }
        Ok(values)
    }

    fn function_value(&mut self, word: &'static str, span: Span) -> Parse<Num> {
        let x = match word {
            "vaxis_rotate" | "vcross" | "vnormalize" | "vrotate" | "vturbulence" | "trace" | "min_extent" | "max_extent" => {
                return self.vector_function(word, span);
            }
            "vdot" => {
                let a = self.argument_vector(true)?;
                a.dot(self.argument_vector(false)?)
            }
            "vlength" => {
                let n = self.full()?;
                let v = n.promoted(3).v;
                v.iter().map(|x| x * x).sum::<f64>().sqrt()
            }
            "max" => self.further_floats()?.into_iter().fold(f64::NEG_INFINITY, f64::max),
            "min" => self.further_floats()?.into_iter().fold(f64::INFINITY, f64::min),
            "bitwise_and" => self.bitwise(|a, b| a & b)?,
            "bitwise_or" => self.bitwise(|a, b| a | b)?,
            "bitwise_xor" => self.bitwise(|a, b| a ^ b)?,
            "select" => {
                let v = self.further_floats()?;
                match v[..] {
                    [a, b, c] => {
                        if a < 0.0 {
                            b
                        } else {
                            c
                        }
                    }
                    [a, b, c, d] => {
                        if a < 0.0 {
                            b
                        } else if a == 0.0 {
                            c
                        } else {
                            d
                        }
                    }
                    _ => return Err(self.error(span, "select takes three or four arguments")),
                }
            }
            "defined" => f64::from(u8::from(self.defined()?)),
            "dimensions" | "dimension_size" => self.dimensions(word, span)?,
            "strcmp" => {
                let a = self.string_value()?;
                self.comma()?;
                let b = self.string_value()?;
                byte_difference(a.as_bytes(), b.as_bytes())
            }
            "strlen" => self.string_value()?.chars().count() as f64,
            "asc" => self.string_value()?.chars().next().map_or(0.0, |c| f64::from(u32::from(c))),
            "val" => super::strings::number(&self.string_value()?),
            "file_exists" => {
                let name = self.string_value()?;
                f64::from(u8::from(self.file_is_there(&name)))
            }
            "inside" => {
                let object = self.object_argument()?;
                let p = self.argument_vector(false)?;
                let Some(probe) = self.options.probe.clone() else { return Err(self.no_probe(span, word)) };
                f64::from(u8::from(probe.inside(&object, p)))
            }
            "seed" => {
                let s = self.full_float()?;
                match self.streams.seed(s) {
                    Some(n) => n,
                    None => return Err(self.error(span, "too many random streams")),
                }
            }
            "rand" => {
                let s = self.full_float()?;
                match self.streams.rand(s) {
                    Some(x) => x,
                    None => return Err(self.error(span, "rand needs the number of a stream that seed has begun")),
                }
            }
            _ => self.plain_function(word, span)?,
        };
        Ok(Num::float(x))
    }

    /// Functions of one or two floats.
    fn plain_function(&mut self, word: &'static str, span: Span) -> Parse<f64> {
        let a = self.full_float()?;
        Ok(match word {
            "abs" => a.abs(),
            "acos" if a.abs() > 1.0 => {
                self.warning(span, format!("the arc cosine of {a} is no number; 0 is taken"));
                0.0
            }
            "acos" => fns::acos(a),
            "asin" if a.abs() > 1.0 => {
                self.warning(span, format!("the arc sine of {a} is no number; 0 is taken"));
                0.0
            }
            "acosh" => fns::acosh(a),
            "asin" => fns::asin(a),
            "asinh" => fns::asinh(a),
            "atan" => fns::atan(a),
            "atanh" => fns::atanh(a),
            "atan2" => fns::atan2(a, self.argument_float(false)?),
            "ceil" => a.ceil(),
            "cos" => fns::cos(a),
            "cosh" => fns::cosh(a),
            "degrees" => a.to_degrees(),
            "div" => {
                let b = self.argument_float(false)?;
                // The quotient becomes a C `int`; what does not fit is its least number (measured).
                let q = (a / b).trunc();
                if q.abs() < 2_147_483_648.0 { q } else { -2_147_483_648.0 }
            }
            "exp" => fns::exp(a),
            "floor" => a.floor(),
            "int" => a.trunc(),
            "ln" | "log" => {
                if !(a > 0.0) {
                    return Err(self.error(span, format!("the logarithm of {a} is no number")));
                }
                if word == "ln" { fns::log(a) } else { fns::log10(a) }
            }
            "mod" => {
                let b = self.argument_float(false)?;
                a % b
            }
            "pow" => fns::pow(a, self.argument_float(false)?),
            "radians" => a.to_radians(),
            "sin" => fns::sin(a),
            "sinh" => fns::sinh(a),
            "sqr" => a * a,
            "sqrt" => {
                if a < 0.0 {
                    return Err(self.error(span, format!("the square root of {a} is no number")));
                }
                a.sqrt()
            }
            "tan" => fns::tan(a),
            "tanh" => fns::tanh(a),
            _ => return Err(self.error(span, format!("`{word}` can stand in a function only"))),
        })
    }

    fn bitwise(&mut self, f: impl Fn(i64, i64) -> i64) -> Parse<f64> {
        let values = self.further_floats()?;
        let mut ints = values.iter().map(|v| *v as i64);
        let first = ints.next().unwrap_or(0);
        Ok(ints.fold(first, f) as f64)
    }

    fn dimensions(&mut self, word: &str, span: Span) -> Parse<f64> {
        let Some(array) = self.accept_value(|v| if let Value::Array(a) = v { Some(a.clone()) } else { None })? else {
            return Err(self.unexpected("a function of arrays"));
        };
        if word == "dimensions" {
            return Ok(array.sizes.len() as f64);
        }
        let i = self.argument_float(false)?;
        match array.sizes.get((i as usize).wrapping_sub(1)) {
            Some(size) => Ok(*size as f64),
            None => Err(self.error(span, format!("the array has {} dimensions; they are numbered from 1", array.sizes.len()))),
        }
    }

    fn no_probe(&mut self, span: Span, word: &str) -> super::Stop {
        self.error(span, format!("`{word}` needs geometry, which this reading of the scene has not"))
    }

    fn object_argument(&mut self) -> Parse<Arc<Object>> {
        if let Some(object) = self.accept_value(|v| if let Value::Object(o) = v { Some(o.clone()) } else { None })? {
            return Ok(object);
        }
        if matches!(self.peek()?, Token::Word(_)) {
            return self.object().map(Arc::new);
        }
        Err(self.unexpected("a function of objects"))
    }

    fn vector_function(&mut self, word: &str, span: Span) -> Parse<Num> {
        Ok(Num::vector3(match word {
            "vcross" => {
                let a = self.argument_vector(true)?;
                a.cross(self.argument_vector(false)?)
            }
            "vnormalize" => {
                let a = self.argument_vector(true)?;
                let length = a.length();
                if length == 0.0 { DVec3::ZERO } else { a / length }
            }
            "vrotate" => {
                let a = self.argument_vector(true)?;
                rotation(self.argument_vector(false)?).transform_vector3(a)
            }
            "vaxis_rotate" => {
                let a = self.argument_vector(true)?;
                let axis = self.argument_vector(false)?;
                let angle = self.argument_float(false)?;
                match axis.try_normalize() {
                    Some(axis) => rotation_about(axis, angle).transform_vector3(a),
                    None => a,
                }
            }
            "vturbulence" => {
                let lambda = self.argument_float(true)?;
                let omega = self.argument_float(false)?;
                let octaves = self.argument_float(false)?.clamp(1.0, 10.0) as u32;
                let p = self.argument_vector(false)?;
                let generator = self.scene.settings.noise_generator;
                noise::vector_turbulence(p, &noise::Turbulence { octaves, lambda, omega }, generator)
            }
            "trace" => {
                let object = self.object_argument()?;
                let origin = self.argument_vector(false)?;
                let direction = self.argument_vector(false)?;
                let normal = if self.accept(",")? { Some(self.variable("trace")?) } else { None };
                let Some(probe) = self.options.probe.clone() else { return Err(self.no_probe(span, word)) };
                let hit = probe.trace(&object, origin, direction);
                self.check_time()?;
                if let Some((place, _)) = normal {
                    let n = hit.map_or(DVec3::ZERO, |h| h.1);
                    self.assign(&place, Num::vector3(n).value(), span)?;
                }
                hit.map_or(DVec3::ZERO, |h| h.0)
            }
            _ => {
                let object = self.object_argument()?;
                let Some(probe) = self.options.probe.clone() else { return Err(self.no_probe(span, word)) };
                let (low, high) = probe.extent(&object);
                if word == "min_extent" { low } else { high }
            }
        }))
    }

    /// The arguments of a user function, and its value.
    pub(super) fn call_function(&mut self, f: &Arc<Function>) -> Parse<Num> {
        let span = self.span();
        self.expect("(")?;
        let mut arguments = Vec::new();
        while !self.accept(")")? {
            arguments.push(self.full_float()?);
            self.comma()?;
        }
        let count = f.parameters.len();
        if arguments.len() != count {
            return Err(self.error(span, format!("the function takes {count} arguments, but here are {}", arguments.len())));
        }
        let probe = self.options.probe.clone();
        let context = self.context(probe.as_deref());
        let values = f.eval_vector(&arguments, &context);
        // A function may be a long computation.
        self.check_time()?;
        let len = f.components().clamp(1, 5);
        Ok(if f.is_vector() { Num::vector(&values[..len.max(2)]) } else { Num::float(values[0]) })
    }

    /// What functions see that are called while the scene is read.
    pub(super) fn context<'p>(&self, probe: Option<&'p dyn Probe>) -> Context<'p> {
        let settings = &self.scene.settings;
        Context {
            images: probe.and_then(|p| p.images()),
            noise_generator: settings.noise_generator,
            number_of_waves: settings.number_of_waves,
            ..Context::at(DVec3::ZERO)
        }
    }

    /// `Spline(t)` or `Spline(t, type)`.
    pub(super) fn call_spline(&mut self, s: &Arc<Spline>) -> Parse<Num> {
        self.expect("(")?;
        let t = self.full_float()?;
        let mut values = None;
        if self.accept(",")? {
            let Some(kind) = self.accept_any(SPLINE_WORDS)?.and_then(spline_kind) else {
                return Err(self.unexpected("a call of a spline, where its type may stand"));
            };
            values = Some(s.with_kind(kind).eval(t));
        }
        self.expect(")")?;
        let values = values.unwrap_or_else(|| s.eval(t));
        Ok(Num::vector(&values[..s.components().clamp(2, 5)]))
    }
}

/// The difference of the first bytes in which two strings differ, as `strcmp` gives it (measured: "abc" after "ab" by 99).
fn byte_difference(a: &[u8], b: &[u8]) -> f64 {
    let at = a.iter().zip(b).position(|(x, y)| x != y).unwrap_or(a.len().min(b.len()));
    let byte = |s: &[u8]| s.get(at).map_or(0.0, |x| f64::from(*x));
    byte(a) - byte(b)
}
