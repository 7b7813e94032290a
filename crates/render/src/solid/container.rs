//! What limits the surfaces of functions: a box or a ball.

use etendue_scene::desc::classic;
use glam::DVec3;

use super::cuboid::Cuboid;
use super::sphere::Sphere;
use super::{Bounds, Crossing, Line, Primitive};

/// A box or a ball.
#[derive(Clone, Debug)]
pub(super) enum Container {
    /// Box.
    Box(Cuboid),
    /// Ball.
    Sphere(Sphere),
}

impl Container {
    /// `None` where it is degenerate.
    pub(super) fn new(container: &classic::Container) -> Option<Self> {
        Some(match container {
            classic::Container::Box(corners) => Self::Box(Cuboid::new(*corners)?),
            classic::Container::Sphere { center, radius } => Self::Sphere(Sphere::new(*center, *radius)?),
        })
    }

    fn primitive(&self) -> &dyn Primitive {
        match self {
            Self::Box(b) => b,
            Self::Sphere(s) => s,
        }
    }

    /// Box around it.
    pub(super) fn bounds(&self) -> Bounds {
        self.primitive().bounds()
    }

    /// Whether a point is inside.
    pub(super) fn contains(&self, p: DVec3) -> bool {
        self.primitive().inside(p)
    }

    /// Where the endless line enters and leaves.
    pub(super) fn span(&self, line: &Line) -> Option<[Crossing; 2]> {
        // Two entries at most, so this does not grow.
        let mut found = Vec::with_capacity(2);
        self.primitive().crossings(line, f64::NEG_INFINITY, f64::INFINITY, &mut found);
        match found[..] {
            [a, b] if a.t <= b.t => Some([a, b]),
            [a, b] => Some([b, a]),
            _ => None,
        }
    }

    /// Unit normal at a crossing, to the outside.
    pub(super) fn normal(&self, p: DVec3, crossing: &Crossing) -> DVec3 {
        self.primitive().normal(p, crossing)
    }
}
