//! Which medium a path is in.

use crate::math::Vec3;
use crate::scene::geometry::NONE;
use crate::scene::{Scene, Surface};

/// How many shapes within each other are told apart.
const DEPTH: usize = 8;

/// The media that a path has entered and not left, the innermost last: shapes within shapes, glass in water, smoke in glass.
///
/// A shape that names an interior or an exterior medium is a border. A path that goes in (against the normal) enters the interior; one
/// that goes out leaves it, and is then in the exterior that the shape names, else in what it was in before. So shapes need not name
/// what is around them, and overlapping shapes are left one by one, in whatever order their borders come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MediumStack {
    media: [u32; DEPTH],
    len: u8,
}

impl Default for MediumStack {
    fn default() -> Self {
        Self::VACUUM
    }
}

impl MediumStack {
    /// Empty space.
    pub const VACUUM: Self = Self { media: [NONE; DEPTH], len: 0 };

    /// A path that starts in a medium; [`NONE`] is empty space.
    #[inline]
    pub fn new(medium: u32) -> Self {
        let mut stack = Self::VACUUM;
        if medium != NONE {
            stack.push(medium);
        }
        stack
    }

    /// The medium that the path is in; [`NONE`] for empty space.
    #[inline]
    pub fn top(&self) -> u32 {
        match self.len {
            0 => NONE,
            n => self.media[n as usize - 1],
        }
    }

    /// Crosses a surface along `d`.
    #[inline]
    pub fn cross(&mut self, scene: &Scene, s: &Surface, d: Vec3) {
        let object = s.object(scene);
        if object.interior != NONE || object.exterior != NONE {
            self.cross_border(object.interior, object.exterior, d.dot(s.ng) < 0.0);
        }
    }

    /// Crosses a border between two media; `inward` is the way into the interior.
    pub fn cross_border(&mut self, interior: u32, exterior: u32, inward: bool) {
        if inward {
            // A path that came from nowhere (a light, a camera within a shape) learns here what it was in.
            if self.len == 0 && exterior != NONE {
                self.push(exterior);
            }
            self.push(interior);
            return;
        }
        let n = self.len as usize;
        if let Some(at) = self.media[..n].iter().rposition(|m| *m == interior) {
            self.media.copy_within(at + 1..n, at);
            self.len -= 1;
        }
        if exterior != NONE && self.top() != exterior {
            self.push(exterior);
        }
    }

    fn push(&mut self, medium: u32) {
        if self.len as usize == DEPTH {
            // Forget the outermost.
            self.media.copy_within(1.., 0);
            self.len -= 1;
        }
        self.media[self.len as usize] = medium;
        self.len += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Crosses borders given as (interior, exterior, inward) and lists where the path is after each.
    fn walk(start: u32, borders: &[(u32, u32, bool)]) -> Vec<u32> {
        let mut stack = MediumStack::new(start);
        let mut seen = Vec::new();
        for &(interior, exterior, inward) in borders {
            stack.cross_border(interior, exterior, inward);
            seen.push(stack.top());
        }
        seen
    }

    #[test]
    fn nested_shapes_come_back_to_what_is_around_them() {
        let (fog, glass, wine) = (0, 1, 2);
        let through = [(glass, NONE, true), (wine, NONE, true), (wine, NONE, false), (glass, NONE, false)];
        assert_eq!(walk(fog, &through), [glass, wine, glass, fog]);
        assert_eq!(walk(NONE, &through), [glass, wine, glass, NONE]);
    }

    #[test]
    fn overlapping_shapes_are_left_in_any_order() {
        assert_eq!(walk(NONE, &[(1, NONE, true), (2, NONE, true), (1, NONE, false), (2, NONE, false)]), [1, 2, 2, NONE]);
    }

    #[test]
    fn bubbles_of_nothing_and_named_exteriors() {
        // A bubble in glass, as files say it: the inside is empty, the outside is glass.
        assert_eq!(walk(NONE, &[(1, NONE, true), (NONE, 1, true), (NONE, 1, false), (1, NONE, false)]), [1, NONE, 1, NONE]);
        // From within a shape: what the shape says is outside.
        assert_eq!(walk(NONE, &[(1, 0, false)]), [0]);
        assert_eq!(walk(1, &[(1, 0, false)]), [0]);
        assert_eq!(walk(1, &[(1, NONE, false)]), [NONE]);
    }

    #[test]
    fn too_many_nested_shapes_forget_the_outermost() {
        let mut borders: Vec<_> = (0..40).map(|i| (i, NONE, true)).collect();
        assert_eq!(walk(NONE, &borders).last(), Some(&39));
        borders.extend((0..40).rev().map(|i| (i, NONE, false)));
        assert_eq!(walk(NONE, &borders).last(), Some(&NONE));
    }
}
