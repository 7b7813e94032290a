//! Colors that patterns have when a pigment gives none (documentation, "General Patterns"; the colors are measured).

use crate::PatternKind;
use crate::pattern::{Fractal, FractalSet};

type Colors = [(f64, [f64; 3])];

const AGATE: &Colors = &[
    (0.0, [1.0, 1.0, 1.0]),
    (0.5, [0.95, 0.75, 0.5]),
    (0.5, [0.9, 0.7, 0.5]),
    (0.6, [0.9, 0.7, 0.4]),
    (0.6, [1.0, 0.7, 0.4]),
    (1.0, [0.6, 0.3, 0.0]),
];
const BOZO: &Colors = &[
    (0.4, [1.0, 1.0, 1.0]),
    (0.4, [0.0, 1.0, 0.0]),
    (0.6, [0.0, 1.0, 0.0]),
    (0.6, [0.0, 0.0, 1.0]),
    (0.8, [0.0, 0.0, 1.0]),
    (0.8, [1.0, 0.0, 0.0]),
    (1.0, [1.0, 0.0, 0.0]),
];
const MANDELBROT: &Colors =
    &[(0.001, [0.0, 0.0, 0.0]), (0.001, [0.0, 1.0, 1.0]), (0.012, [1.0, 1.0, 0.0]), (0.015, [1.0, 0.0, 1.0]), (0.1, [0.0, 1.0, 1.0])];
const MARBLE: &Colors = &[(0.0, [0.9, 0.8, 0.8]), (0.9, [0.9, 0.08, 0.08]), (0.9, [0.0, 0.0, 0.0])];
const RADIAL: &Colors = &[(0.0, [0.0, 1.0, 1.0]), (0.333, [1.0, 1.0, 0.0]), (0.666, [1.0, 0.0, 1.0]), (1.0, [0.0, 1.0, 1.0])];
const WOOD: &Colors = &[(0.6, [0.666, 0.312, 0.2]), (0.6, [0.4, 0.1333, 0.066])];

const BRICK: &Colors = &[(0.0, [0.5, 0.5, 0.5]), (1.0, [0.6, 0.15, 0.15])];
const CHECKER: &Colors = &[(0.0, [0.0, 0.0, 1.0]), (1.0, [0.0, 1.0, 0.0])];
const HEXAGON: &Colors = &[(0.0, [0.0, 0.0, 1.0]), (1.0, [0.0, 1.0, 0.0]), (2.0, [1.0, 0.0, 0.0])];
const SIX: &Colors = &[
    (0.0, [1.0, 0.0, 0.0]),
    (1.0, [0.0, 1.0, 0.0]),
    (2.0, [0.0, 0.0, 1.0]),
    (3.0, [1.0, 1.0, 0.0]),
    (4.0, [0.0, 1.0, 1.0]),
    (5.0, [1.0, 0.0, 1.0]),
];
const OBJECT: &Colors = &[(0.0, [0.0, 0.0, 0.0]), (1.0, [1.0, 1.0, 1.0])];

/// (place, color) of a pattern's own map, or of its blocks in their order; empty for patterns whose own map runs from black to white.
pub(crate) fn of(kind: &PatternKind) -> &'static Colors {
    match kind {
        PatternKind::Agate { .. } => AGATE,
        PatternKind::Bozo => BOZO,
        PatternKind::Brick { .. } => BRICK,
        PatternKind::Checker => CHECKER,
        PatternKind::Cubic | PatternKind::Triangular => SIX,
        PatternKind::Fractal(Fractal { set: FractalSet::Power(_), julia: None, .. }) => MANDELBROT,
        PatternKind::Hexagon => HEXAGON,
        PatternKind::Marble => MARBLE,
        PatternKind::Object(_) => OBJECT,
        PatternKind::Radial => RADIAL,
        PatternKind::Square => &SIX[..4],
        PatternKind::Wood => WOOD,
        _ => &[],
    }
}
