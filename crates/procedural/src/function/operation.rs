//! The operations of functions.

use serde::{Deserialize, Serialize};

use crate::fns;

/// Operations of one number. Angles in radians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[allow(missing_docs, reason = "named as in the language")]
pub enum Unary {
    Negate,
    Abs,
    Acos,
    Acosh,
    Asin,
    Asinh,
    Atan,
    Atanh,
    Ceil,
    Cos,
    Cosh,
    Degrees,
    Exp,
    Floor,
    Int,
    Ln,
    Log,
    Radians,
    Sin,
    Sinh,
    Sqr,
    Sqrt,
    Tan,
    Tanh,
}

/// Operations of two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[allow(missing_docs, reason = "named as in the language")]
pub enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    Less,
    LessEqual,
    Equal,
    NotEqual,
    And,
    Or,
    Atan2,
    Div,
    Max,
    Min,
    Mod,
    Pow,
}

/// What is taken of a vector or color that a function returns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Component {
    /// One of the five numbers.
    Number(u8),
    /// Brightness: 0.297 red + 0.589 green + 0.114 blue.
    Gray,
    /// Height as height fields take it of a 16-bit picture: red the coarse, green the fine part.
    Height,
}

impl Component {
    /// By its name behind the dot; `None` for other words.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "x" | "u" | "red" => Self::Number(0),
            "y" | "v" | "green" => Self::Number(1),
            "z" | "blue" => Self::Number(2),
            "t" | "filter" => Self::Number(3),
            "transmit" => Self::Number(4),
            "gray" | "grey" => Self::Gray,
            "hf" => Self::Height,
            _ => return None,
        })
    }

    /// Factors of the five numbers whose sum it is. Those of `hf` were measured: (red + green / 255) · 0.996093.
    pub fn weights(self) -> [f64; 5] {
        match self {
            Self::Number(i) => std::array::from_fn(|k| f64::from(u8::from(k == usize::from(i)))),
            Self::Gray => [0.297, 0.589, 0.114, 0.0, 0.0],
            Self::Height => [0.996093, 0.996093 / 255.0, 0.0, 0.0, 0.0],
        }
    }

    /// The component of a value.
    pub fn of(self, value: &[f64; 5]) -> f64 {
        match self {
            Self::Number(i) => value.get(usize::from(i)).copied().unwrap_or(0.0),
            _ => self.weights().iter().zip(value).map(|(w, v)| if *w == 0.0 { 0.0 } else { w * v }).sum(),
        }
    }
}

/// Conversion to a 32-bit integer towards zero; what does not fit becomes the least one, as POV-Ray's output shows.
fn truncated(x: f64) -> f64 {
    let t = x.trunc();
    if t > -2_147_483_649.0 && t < 2_147_483_648.0 { t } else { -2_147_483_648.0 }
}

impl Unary {
    /// By its name in the language; `None` for other words.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "abs" => Self::Abs,
            "acos" => Self::Acos,
            "acosh" => Self::Acosh,
            "asin" => Self::Asin,
            "asinh" => Self::Asinh,
            "atan" => Self::Atan,
            "atanh" => Self::Atanh,
            "ceil" => Self::Ceil,
            "cos" => Self::Cos,
            "cosh" => Self::Cosh,
            "degrees" => Self::Degrees,
            "exp" => Self::Exp,
            "floor" => Self::Floor,
            "int" => Self::Int,
            "ln" => Self::Ln,
            "log" => Self::Log,
            "radians" => Self::Radians,
            "sin" => Self::Sin,
            "sinh" => Self::Sinh,
            "sqr" => Self::Sqr,
            "sqrt" => Self::Sqrt,
            "tan" => Self::Tan,
            "tanh" => Self::Tanh,
            _ => return None,
        })
    }

    /// The value; NaN or infinite outside of the domain.
    #[inline]
    pub fn apply(self, a: f64) -> f64 {
        match self {
            Self::Negate => -a,
            Self::Abs => a.abs(),
            Self::Acos => fns::acos(a),
            Self::Acosh => fns::acosh(a),
            Self::Asin => fns::asin(a),
            Self::Asinh => fns::asinh(a),
            Self::Atan => fns::atan(a),
            Self::Atanh => fns::atanh(a),
            Self::Ceil => a.ceil(),
            Self::Cos => fns::cos(a),
            Self::Cosh => fns::cosh(a),
            Self::Degrees => a * (180.0 / std::f64::consts::PI),
            Self::Exp => fns::exp(a),
            Self::Floor => a.floor(),
            Self::Int => truncated(a),
            Self::Ln => fns::log(a),
            Self::Log => fns::log10(a),
            Self::Radians => a * (std::f64::consts::PI / 180.0),
            Self::Sin => fns::sin(a),
            Self::Sinh => fns::sinh(a),
            Self::Sqr => a * a,
            Self::Sqrt => a.sqrt(),
            Self::Tan => fns::tan(a),
            Self::Tanh => fns::tanh(a),
        }
    }
}

impl Binary {
    /// By its name in the language, of those written as calls; `None` for other words.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "atan2" => Self::Atan2,
            "div" => Self::Div,
            "max" => Self::Max,
            "min" => Self::Min,
            "mod" => Self::Mod,
            "pow" => Self::Pow,
            _ => return None,
        })
    }

    /// The value; NaN or infinite outside of the domain, 1 or 0 for comparisons and logic.
    #[inline]
    pub fn apply(self, a: f64, b: f64) -> f64 {
        let flag = |f: bool| if f { 1.0 } else { 0.0 };
        match self {
            Self::Add => a + b,
            Self::Subtract => a - b,
            Self::Multiply => a * b,
            Self::Divide => a / b,
            Self::Less => flag(a < b),
            Self::LessEqual => flag(a <= b),
            Self::Equal => flag(a == b),
            Self::NotEqual => flag(a != b),
            Self::And => flag(a != 0.0 && b != 0.0),
            Self::Or => flag(a != 0.0 || b != 0.0),
            Self::Atan2 => fns::atan2(a, b),
            Self::Div => truncated(a / b),
            // With a NaN the other one, on either side.
            Self::Max => {
                if a > b || b.is_nan() {
                    a
                } else {
                    b
                }
            }
            Self::Min => {
                if a < b || b.is_nan() {
                    a
                } else {
                    b
                }
            }
            Self::Mod => a % b,
            Self::Pow => fns::pow(a, b),
        }
    }
}
