//! User functions: expressions of x, y, z and further parameters, and what else can be called like one.
//!
//! A function is flat, serialisable data: a [`Program`] of three-address instructions over a register file, built by
//! [`Builder`], or a pigment, pattern, transform, spline or [`Internal`] function. Evaluation allocates nothing up to
//! 512 registers. After the section *Function* of POV-Ray 3.7's reference (3.3.1.8); where that is silent, after the output of the
//! program: domain errors give NaN or infinity, comparisons give 1 or 0 and know no tolerance.

mod builder;
mod internal;
mod operation;
mod program;

use std::cell::Cell;
use std::sync::Arc;

use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

pub use builder::{Builder, Loop, Operand, Select, TooLong};
pub use internal::Internal;
pub use operation::{Binary, Component, Unary};
pub use program::Program;

use crate::{Context, Pattern, Pigment, Spline};

/// Calls may be nested this deep, functions within pigments within functions included; deeper ones have the value NaN.
pub const MAX_DEPTH: u32 = 64;

/// Instructions that one evaluation may take, loops included; then it ends with NaN. About a fifth of a second.
const FUEL: u64 = 1 << 26;

thread_local! {
    // Functions call pigments, whose patterns call functions: no argument goes through all of them, so the depth is kept here. It
    // bounds the stack only and never shows in a value of a function within the bound.
    static DEPTH: Cell<u32> = const { Cell::new(0) };
}

/// A function of numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Function {
    /// Names of the parameters; `x`, `y`, `z` where none are declared.
    pub parameters: Vec<String>,
    body: Body,
    /// Length of the longest chain of functions that it calls, itself included.
    depth: u32,
}

/// What a function computes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum Body {
    Program(Program),
    Internal(Internal),
    Pigment(Arc<Pigment>),
    Pattern(Arc<Pattern>),
    Transform(DMat4),
    Spline(Arc<Spline>),
}

impl Default for Function {
    /// The constant 0 of x, y, z.
    fn default() -> Self {
        Self::constant(0.0)
    }
}

fn xyz() -> Vec<String> {
    ["x", "y", "z"].map(String::from).to_vec()
}

impl Function {
    /// The same number everywhere, as a function of x, y, z.
    pub fn constant(value: f64) -> Self {
        Self { parameters: xyz(), body: Body::Program(Program::constant(3, value)), depth: 1 }
    }

    /// What a [`Builder`] has made. `depth` is [`Builder`]'s.
    pub(crate) fn from_program(parameters: Vec<String>, program: Program, depth: u32) -> Self {
        Self { parameters, body: Body::Program(program), depth }
    }

    /// One of POV-Ray's internal functions; further parameters are named `p0`, `p1` …
    pub fn internal(function: Internal) -> Self {
        let parameters = xyz().into_iter().chain((0..function.extra_parameters()).map(|i| format!("p{i}"))).collect();
        Self { parameters, body: Body::Internal(function), depth: 1 }
    }

    /// The color of a pigment at (x, y, z): five components.
    pub fn pigment(pigment: Arc<Pigment>) -> Self {
        Self { parameters: xyz(), body: Body::Pigment(pigment), depth: 1 }
    }

    /// The value of a pattern at (x, y, z).
    pub fn pattern(pattern: Arc<Pattern>) -> Self {
        Self { parameters: xyz(), body: Body::Pattern(pattern), depth: 1 }
    }

    /// The point (x, y, z) transformed: three components.
    pub fn transform(matrix: DMat4) -> Self {
        Self { parameters: xyz(), body: Body::Transform(matrix), depth: 1 }
    }

    /// A spline at its parameter: as many components as the spline has.
    pub fn spline(spline: Arc<Spline>) -> Self {
        Self { parameters: vec!["x".into()], body: Body::Spline(spline), depth: 1 }
    }

    /// How many numbers the function returns: 1 for expressions and patterns, 5 for pigments, 3 for transforms, 1 to 5 for splines.
    pub fn components(&self) -> usize {
        match &self.body {
            Body::Program(_) | Body::Internal(_) | Body::Pattern(_) => 1,
            Body::Pigment(_) => 5,
            Body::Transform(_) => 3,
            Body::Spline(s) => s.components(),
        }
    }

    /// Whether calls inside of expressions must name a component (`f(x, y, z).red`).
    pub fn is_vector(&self) -> bool {
        matches!(self.body, Body::Pigment(_) | Body::Transform(_) | Body::Spline(_))
    }

    /// False for the internal functions that have the value 0 because their formula is not known.
    pub fn is_known(&self) -> bool {
        !matches!(self.body, Body::Internal(f) if !f.is_known())
    }

    /// Length of the longest chain of functions that it calls, itself included.
    pub fn depth(&self) -> u32 {
        self.depth
    }

    /// The instructions, where it is an expression.
    pub(crate) fn program(&self) -> Option<&Program> {
        match &self.body {
            Body::Program(p) => Some(p),
            _ => None,
        }
    }

    /// The value for arguments (as many as parameters; missing ones are 0, further ones are not looked at); of a vector the first
    /// component. NaN where a domain is left or a limit is met.
    pub fn eval(&self, arguments: &[f64], context: &Context) -> f64 {
        self.eval_vector(arguments, context)[0]
    }

    /// The value at a point, for functions of x, y, z.
    pub fn eval3(&self, p: DVec3, context: &Context) -> f64 {
        self.eval(&[p.x, p.y, p.z], context)
    }

    /// All components, the rest 0; see [`Self::components`].
    pub fn eval_vector(&self, arguments: &[f64], context: &Context) -> [f64; 5] {
        let mut fuel = FUEL;
        self.call(arguments, context, &mut fuel)
    }

    fn call(&self, arguments: &[f64], context: &Context, fuel: &mut u64) -> [f64; 5] {
        let depth = DEPTH.get();
        if depth >= MAX_DEPTH {
            return [f64::NAN; 5];
        }
        DEPTH.set(depth + 1);
        let argument = |i: usize| arguments.get(i).copied().unwrap_or(0.0);
        let p = || DVec3::new(argument(0), argument(1), argument(2));
        let scalar = |v: f64| [v, 0.0, 0.0, 0.0, 0.0];
        let value = match &self.body {
            Body::Program(program) => scalar(program.run(arguments, context, fuel)),
            Body::Internal(f) => scalar(f.eval(arguments, context)),
            Body::Pattern(pattern) => scalar(pattern.value(&context.moved(p()))),
            Body::Pigment(pigment) => {
                let c = pigment.color(&context.moved(p()));
                [c.rgb.x, c.rgb.y, c.rgb.z, c.filter, c.transmit]
            }
            Body::Transform(m) => {
                let q = m.transform_point3(p());
                [q.x, q.y, q.z, 0.0, 0.0]
            }
            Body::Spline(s) => s.eval(argument(0)),
        };
        DEPTH.set(depth);
        value
    }
}

#[cfg(test)]
mod tests;
