//! Box with faces along the axes.

use glam::{DVec2, DVec3};

use super::facets::{Facet, has_area, quad};
use super::{Bounds, Crossing, Line, Primitive};

/// Box; the part of a crossing is 2 · axis, + 1 for the upper face.
#[derive(Clone, Debug)]
pub(super) struct Cuboid {
    bounds: Bounds,
}

impl Cuboid {
    /// `None` where a corner is not finite.
    pub(super) fn new(corners: [DVec3; 2]) -> Option<Self> {
        (corners[0].is_finite() && corners[1].is_finite()).then(|| Self { bounds: Bounds::of(corners[0], corners[1]) })
    }

    /// Scaled about the origin by positive factors, then moved.
    pub(super) fn scaled(&self, factor: DVec3, offset: DVec3) -> Self {
        Self { bounds: Bounds { min: self.bounds.min * factor + offset, max: self.bounds.max * factor + offset } }
    }

    /// Entry and exit of the endless line.
    #[inline]
    fn slabs(&self, line: &Line) -> Option<(Crossing, Crossing)> {
        let (mut near, mut far) = (Crossing::new(f64::NEG_INFINITY, 0), Crossing::new(f64::INFINITY, 0));
        for axis in 0..3 {
            let (o, d) = (line.o[axis], line.d[axis]);
            let (lo, hi) = (self.bounds.min[axis], self.bounds.max[axis]);
            if d == 0.0 {
                if o < lo || o > hi {
                    return None;
                }
                continue;
            }
            let inverse = 1.0 / d;
            let (a, b) = ((lo - o) * inverse, (hi - o) * inverse);
            let side = 2 * axis as u32;
            let (a, b, enter, leave) = if d < 0.0 { (b, a, side + 1, side) } else { (a, b, side, side + 1) };
            if a > near.t {
                near = Crossing::new(a, enter);
            }
            if b < far.t {
                far = Crossing::new(b, leave);
            }
        }
        (near.t <= far.t).then_some((near, far))
    }
}

impl Primitive for Cuboid {
    fn facets(&self, _: usize, _: &Bounds) -> Option<Vec<Facet>> {
        let Bounds { min, max } = self.bounds;
        let corner = |x: bool, y: bool, z: bool| DVec3::select(glam::BVec3::new(x, y, z), max, min);
        let around = [(false, false), (true, false), (true, true), (false, true)];
        let mut all = Vec::with_capacity(12);
        for s in [false, true] {
            all.extend(quad(around.map(|(a, b)| corner(s, a, b))));
            all.extend(quad(around.map(|(a, b)| corner(a, s, b))));
            all.extend(quad(around.map(|(a, b)| corner(a, b, s))));
        }
        all.retain(has_area);
        Some(all)
    }

    fn bounds(&self) -> Bounds {
        self.bounds
    }

    #[inline]
    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        if let Some((near, far)) = self.slabs(line) {
            out.extend([near, far].into_iter().filter(|c| c.t > t_min && c.t < t_max));
        }
    }

    #[inline]
    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, _scratch: &mut Vec<Crossing>) -> Option<Crossing> {
        let (near, far) = self.slabs(line)?;
        let c = if near.t > t_min { near } else { far };
        (c.t > t_min && c.t < t_max).then_some(c)
    }

    fn inside(&self, p: DVec3) -> bool {
        self.bounds.contains(p)
    }

    fn normal(&self, _p: DVec3, crossing: &Crossing) -> DVec3 {
        let axis = DVec3::AXES[(crossing.part / 2).min(2) as usize];
        if crossing.part % 2 == 1 { axis } else { -axis }
    }

    /// The faces laid out as a cross of four by three squares.
    fn uv(&self, p: DVec3, crossing: &Crossing) -> DVec2 {
        let size = self.bounds.max - self.bounds.min;
        let q = (p - self.bounds.min) / size.max(DVec3::splat(f64::MIN_POSITIVE));
        let (column, row, u, v) = match crossing.part {
            0 => (0.0, 1.0, q.z, q.y),
            1 => (2.0, 1.0, 1.0 - q.z, q.y),
            2 => (1.0, 0.0, q.x, q.z),
            3 => (1.0, 2.0, q.x, 1.0 - q.z),
            4 => (3.0, 1.0, 1.0 - q.x, q.y),
            _ => (1.0, 1.0, q.x, q.y),
        };
        DVec2::new((column + u) / 4.0, (row + v) / 3.0)
    }
}
