//! POV-Ray's internal functions: what `functions.inc` gives names to.
//!
//! The list and the meaning of the parameters are those of POV-Ray 3.7's reference, section *Internal Functions* (3.4.9.1.7.9), and
//! of the comments of `functions.inc`. Neither gives formulas: they were found by fitting polynomials and the distance functions that
//! the parameters suggest to values that the program writes (`#write`), and agree with those to 1e-9 or better. Some are not
//! what the name says in every detail (`f_odd` is `f_cushion`, for one); they are kept as the program computes them.

mod algebraic;
mod noise;
mod shape;

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

/// Most extra parameters of a function.
const MOST: usize = 10;

impl Internal {
    /// By number; `None` where there is no such function.
    pub fn new(number: u32) -> Option<Self> {
        let extra = EXTRA.get(number as usize)?;
        (*extra != 255).then_some(Self(number as u8))
    }

    /// Whether its formula is known; `f_comma` and `f_helical_torus` are not yet, and have the value 0.
    pub fn is_known(self) -> bool {
        !matches!(self.0, 9 | 24)
    }

    /// How many parameters follow x, y, z.
    pub fn extra_parameters(self) -> u32 {
        EXTRA.get(usize::from(self.0)).map_or(0, |e| u32::from(*e))
    }

    /// The value for x, y, z and the extra parameters; missing ones are 0.
    pub(in super::super) fn eval(self, arguments: &[f64], context: &Context) -> f64 {
        let argument = |i: usize| arguments.get(i).copied().unwrap_or(0.0);
        let [x, y, z] = [0, 1, 2].map(argument);
        let p: [f64; MOST] = std::array::from_fn(|i| argument(i + 3));
        match self.0 {
            6 => shape::blob([x, y, z], &p),
            7 => shape::blob2([x, y, z], &p),
            9 | 24 => 0.0,
            10 => p[3] - p[2] * shape::fade(p[1], shape::ellipsoids([x, y, z], p[0]).into_iter().fold(f64::INFINITY, f64::min)),
            17 => shape::length(p[0] * x, p[1] * y, p[2] * z),
            19 => p[3] - p[2] * shape::ellipsoids([x, y, z], p[0]).into_iter().map(|q| shape::fade(p[1], q)).sum::<f64>(),
            25 => shape::helix1([x, y, z], &p),
            26 => shape::helix2([x, y, z], &p),
            27 => shape::hex_x(x, y),
            28 => shape::hex_y(x, y),
            29 => noise::hetero_mf([x, y, z], &p),
            32 => p[3] - p[2] * shape::fade(p[1], shape::ellipsoids([x, y, z], p[0]).into_iter().fold(f64::NEG_INFINITY, f64::max)),
            40 => shape::mesh1([x, y, z], &p),
            47 => crate::fns::atan2(shape::length(x, 0.0, z), y),
            51 => shape::length(x, 0.0, z) - shape::quartic([p[0], p[1], p[2], p[3], p[4]], y),
            52 => shape::polytubes([x, y, z], &p),
            53 => shape::quantum([x, y, z]),
            57 => shape::length(x, y, z),
            58 => noise::ridge([x, y, z], &p),
            59 => noise::ridged_mf([x, y, z], &p),
            60 => shape::rounded_box([x, y, z], &p),
            61 => shape::length(x, y, z) - p[0],
            62 => shape::spikes([x, y, z], &p),
            63 => shape::spikes_2d([x, y, z], &p),
            64 => shape::spiral([x, y, z], &p),
            68 => shape::superellipsoid([x, y, z], p[0], p[1]),
            69 => crate::fns::atan2(x, z),
            70 => shape::length(shape::length(x, 0.0, z) - p[0], y, 0.0) - p[1],
            76 => crate::noise::noise(glam::DVec3::new(x, y, z), context.noise_generator),
            78 => crate::noise::noise(glam::DVec3::new(x, y, z), noise::generator(p[0])),
            number => algebraic::eval(number, [x, y, z], &p),
        }
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

#[cfg(test)]
mod tests;
