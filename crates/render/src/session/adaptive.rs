//! Adaptive sampling: pixels whose error is small enough take no more samples.
//!
//! After every [`STEP`] samples the error of each block of [`BLOCK`] × [`BLOCK`] pixels is estimated, relative to what is seen there
//! ([`Film::relative_error_within`]), and blocks in which it is at most the goal are done. Blocks and not pixels, after Dammertz et al. 2010
//! ("A Hierarchical Automatic Stopping Condition for Monte Carlo Global Illumination", WSCG): the error of one pixel of few samples is
//! itself noise. To stop by what has been found is a bias all the same, as blocks that have missed a rare bright path look done: it grows
//! with the goal.
//!
//! Whether a block goes on is a function of its own samples, so a film holds the same samples whoever renders which tile of it and
//! however often it is resumed. The samples of a pixel are the first ones, without holes: a range that begins later cannot be rendered alone.

use super::tiles_of;
use crate::film::{Film, Rect};

/// Samples between decisions, and the least number of samples of a pixel. A multiple of what passes end at.
pub(super) const STEP: u32 = 16;
/// Edge of a block in pixels; tiles are a multiple of it.
pub(super) const BLOCK: u32 = 8;

/// The blocks of a rectangle that take the sample after the first `count`; its corner is one of the grid of blocks.
pub(super) fn open_blocks(film: &Film, rect: Rect, count: u32, goal: f64) -> impl Iterator<Item = Rect> {
    tiles_of(rect, BLOCK).filter(move |&block| is_open(film, block, count, goal))
}

/// Whether a part of a crop has whole blocks of it.
pub(super) fn is_on_grid(part: Rect, crop: Rect) -> bool {
    let fits = |at: u32, from: u32, to: u32| at == to || at.wrapping_sub(from).is_multiple_of(BLOCK);
    let fits_x = fits(part.x0, crop.x0, crop.x1) && fits(part.x1, crop.x0, crop.x1);
    fits_x && fits(part.y0, crop.y0, crop.y1) && fits(part.y1, crop.y0, crop.y1)
}

fn is_open(film: &Film, block: Rect, count: u32, goal: f64) -> bool {
    let held = film.sample_count(block.x0, block.y0);
    // A resumed film may know that it went on.
    let decides = held == count && count > 0 && count.is_multiple_of(STEP);
    held > count || held == count && !(decides && film.relative_error_within(block) <= goal)
}
