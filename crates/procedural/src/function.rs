//! User functions: expressions of x, y, z and further parameters.

use serde::{Deserialize, Serialize};

use crate::Context;

/// A function of numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Function {
    /// Names of the parameters; `x`, `y`, `z` where none are declared.
    pub parameters: Vec<String>,
}

impl Function {
    /// The value for arguments (as many as parameters; missing ones are 0).
    pub fn eval(&self, arguments: &[f64], context: &Context) -> f64 {
        let _ = (arguments, context);
        0.0
    }
}
