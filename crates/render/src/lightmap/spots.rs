//! Where in the world the light of a texel is measured, so that none leaks and none is lost.
//!
//! A texel's center may lie inside of another body that stands on the surface: it is moved out of it if the body ends within the texel,
//! else it is left to its neighbors. Where anything stands within the texel, its light is taken at that one point only, as the rest
//! of it may lie behind a wall. Where slabs touch, whole charts are buried or all but a far corner: such texels borrow the light of the
//! nearest texels of their surface, as a viewer's pixels at the crack between the slabs show it.

use rayon::prelude::*;

use super::flatten::Flat;
use super::layout::{Layout, Texel};
use crate::accel::{Hit, Ray};
use crate::math::{Aabb, Frame, Vec2, Vec3};
use crate::scene::{Scene, Surface};

/// Rays start this share of a texel above the surface.
const LIFT: f32 = 0.01;
/// So many texels to each side are looked at for the nearest one: for the rest of a huge surface, one that is near will do.
const MOST_LOOKS: usize = 1 << 15;
/// Half of a texel's diagonal with some room.
const REACH: f32 = 0.75;

/// Where a texel's light is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// The position; the texel's own point where it has not been moved.
    pub p: Vec3,
    /// Lies inside of another body: its light means nothing.
    pub is_buried: bool,
    /// Nothing stands within the texel: the light of all of it may be taken.
    pub is_clear: bool,
    /// The texel whose light it borrows.
    pub lender: Option<u32>,
}

/// The flat scene compiled, with what connects the two.
pub struct World<'a> {
    /// The compiled scene, with hidden lights.
    pub scene: &'a Scene,
    /// What it was compiled from.
    pub flat: &'a Flat,
}

impl World<'_> {
    /// The surface at a point of a triangle, with normals on the side that is baked.
    pub fn surface(&self, shape: u32, triangle: u32, bary: Vec2, back: bool) -> Surface {
        let object = &self.scene.geometries[0].objects[shape as usize];
        let hit = Hit { t: 0.0, u: bary.x, v: bary.y, prim: object.first_primitive + triangle, instance: 0 };
        let mut s = self.scene.surface(&Ray::new(Vec3::ZERO, Vec3::Z), &hit);
        if back {
            s.ng = -s.ng;
            s.frame = Frame::from_normal(-s.frame.n);
        }
        s
    }

    /// Whether a ray's first hit shows that it starts inside of a closed body: it sees the inside of it.
    fn exit(&self, ray: &Ray) -> Option<f32> {
        let s = self.scene.intersect(ray)?;
        (s.ng.dot(ray.d) > 0.0 && self.flat.shapes[s.object as usize].solid).then_some(s.t)
    }

    /// Whether a point above a surface lies inside of a closed body.
    pub fn is_inside(&self, p: Vec3, n: Vec3) -> bool {
        let frame = Frame::from_normal(n);
        // One ray is enough unless another body stands in the first; some more for that.
        const LOCAL: [[f32; 3]; 5] = [[0.0, 0.0, 1.0], [0.8, 0.1, 0.6], [-0.7, 0.4, 0.6], [0.1, -0.8, 0.6], [-0.3, 0.74, 0.6]];
        LOCAL.iter().any(|d| self.exit(&Ray::new(p, frame.world_from_local(Vec3::from_array(*d)).normalize())).is_some())
    }
}

/// Finds the spots of all texels.
pub fn spots(world: &World, layout: &Layout) -> Vec<Spot> {
    let mut spots: Vec<Spot> = layout.texels.par_iter().map(|t| spot(world, layout, t)).collect();
    lend(layout, &mut spots);
    spots
}

/// Finds the lenders of buried texels: the nearest texels of their surface, where those are not of the same chart. In the chart, neighbors
/// fill them.
fn lend(layout: &Layout, spots: &mut [Spot]) {
    let chart_of = |i: usize| layout.texels[i].chart as usize;
    let side_of = |i: usize| layout.charts[chart_of(i)].side as usize;
    let mut lenders: Vec<Vec<usize>> = vec![Vec::new(); layout.sides.len()];
    (0..spots.len()).filter(|&i| !spots[i].is_buried).for_each(|i| lenders[side_of(i)].push(i));
    let sides: Vec<Lenders> = lenders.into_par_iter().map(|all| Lenders::new(spots, all)).collect();
    let find = |(i, spot): (usize, &Spot)| {
        let lender = spot.is_buried.then(|| sides[side_of(i)].nearest(spot.p)).flatten()?;
        (chart_of(lender as usize) != chart_of(i)).then_some(lender)
    };
    let found: Vec<Option<u32>> = spots.par_iter().enumerate().map(find).collect();
    spots.iter_mut().zip(found).for_each(|(spot, lender)| spot.lender = lender);
}

/// Texels of a side that have light of their own, along the axis of their largest extent.
struct Lenders {
    axis: usize,
    /// Places and texels, by coordinate.
    sorted: Vec<(Vec3, u32)>,
}

impl Lenders {
    fn new(spots: &[Spot], all: Vec<usize>) -> Self {
        let extent = Aabb::from_points(all.iter().map(|&i| spots[i].p)).extent();
        let axis = (0..3).fold(0, |best, k| if extent[k] > extent[best] { k } else { best });
        let mut sorted: Vec<(Vec3, u32)> = all.into_iter().map(|i| (spots[i].p, i as u32)).collect();
        sorted.sort_unstable_by(|a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
        Self { axis, sorted }
    }

    fn nearest(&self, p: Vec3) -> Option<u32> {
        let middle = self.sorted.partition_point(|(q, _)| q[self.axis] < p[self.axis]);
        let mut best: Option<(f32, u32)> = None;
        let mut look = |(q, i): &(Vec3, u32)| {
            let (along, distance) = (crate::math::fns::sqr(q[self.axis] - p[self.axis]), q.distance_squared(p));
            if best.is_none_or(|b| (distance, *i) < b) {
                best = Some((distance, *i));
            }
            best.is_some_and(|b| along > b.0)
        };
        // Both ways, until nothing nearer can come.
        let _ = self.sorted[middle..].iter().take(MOST_LOOKS).any(&mut look);
        let _ = self.sorted[..middle].iter().rev().take(MOST_LOOKS).any(&mut look);
        best.map(|b| b.1)
    }
}

fn spot(world: &World, layout: &Layout, texel: &Texel) -> Spot {
    let chart = &layout.charts[texel.chart as usize];
    let side = layout.sides[chart.side as usize];
    let triangle = chart.chart.triangles[texel.triangle as usize];
    let s = world.surface(side.shape, triangle, texel.bary, side.back);
    let axes = texel_axes(world, layout, texel);
    let size = axes[0].length().max(axes[1].length());
    // At least what the offset of any ray is.
    let o = s.offset_origin(s.ng) + s.ng * (LIFT * size);
    let directions: [Vec3; 8] = std::array::from_fn(|i| {
        let (x, y) = [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)][i];
        let d = axes[0] * x as f32 + axes[1] * y as f32;
        (d - s.ng * s.ng.dot(d)).normalize_or_zero()
    });
    let reach = REACH * size;
    if !world.is_inside(o, s.ng) {
        let meets = |d: &Vec3| *d != Vec3::ZERO && world.scene.accel.occluded(&Ray { t_max: reach, ..Ray::new(o, *d) });
        let is_clear = !directions.iter().any(meets);
        // From a point on the rim of a wall rays would start in the wall.
        return Spot { p: s.p, is_buried: false, is_clear, lender: None };
    }
    let mut best: Option<(f32, Vec3)> = None;
    for d in directions.iter().filter(|d| **d != Vec3::ZERO) {
        if let Some(t) = world.exit(&Ray { t_max: reach, ..Ray::new(o, *d) })
            && best.is_none_or(|(nearest, _)| t < nearest)
        {
            let out = s.p + *d * (t + LIFT * size);
            // Beyond the rim of the surface it would be in the light of other places.
            let above = out + (o - s.p);
            let down = Ray { t_max: LIFT * size + reach, ..Ray::new(above, -s.ng) };
            if !world.is_inside(above, s.ng) && world.scene.intersect(&down).is_some_and(|hit| hit.object == side.shape) {
                best = Some((t, out));
            }
        }
    }
    match best {
        Some((_, p)) => Spot { p, is_buried: false, is_clear: false, lender: None },
        None => Spot { p: s.p, is_buried: true, is_clear: false, lender: None },
    }
}

/// How the point in the world moves for one texel to the right and one down.
pub fn texel_axes(world: &World, layout: &Layout, texel: &Texel) -> [Vec3; 2] {
    let chart = &layout.charts[texel.chart as usize];
    let mesh = world.flat.mesh(layout.sides[chart.side as usize].shape as usize);
    let c = chart.corners(texel.triangle);
    let p = mesh.triangles[chart.chart.triangles[texel.triangle as usize] as usize].map(|i| mesh.positions[i as usize]);
    let (d1, d2) = (c[1] - c[0], c[2] - c[0]);
    let (e1, e2) = (p[1] - p[0], p[2] - p[0]);
    let det = d1.perp_dot(d2);
    let axes = [(e1 * d2.y - e2 * d1.y) / det, (e2 * d1.x - e1 * d2.x) / det];
    if axes.iter().all(|a| a.is_finite()) {
        return axes;
    }
    let size = e1.length().max(e2.length());
    let f = Frame::from_normal(e1.cross(e2).normalize_or(Vec3::Z));
    [f.s * size, f.t * size]
}
