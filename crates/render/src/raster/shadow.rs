//! Shadow maps (Williams 1978, "Casting Curved Shadows on Curved Surfaces", doi:10.1145/800248.807402): what the light does not see
//! is in shadow.
//!
//! The first pass draws the scene from the light and keeps the depths; the second asks, for a point that the camera sees, whether the
//! map holds something nearer to the light. Three things go wrong, and each has its remedy here:
//!
//! - **Bias.** A texel holds the depth of its center, the point lies elsewhere in it, so a lit slope shadows itself ("acne"). The
//!   `hard` filter subtracts a constant and a part that grows with the slope; the others compare with the depth that the *receiver's
//!   own plane* has at the texel's center (Isidoro 2006, "Shadow Mapping: GPU-based Tips and Techniques"), so that flat receivers
//!   need nearly none. All move the point along its normal, by a share of a texel that grows with the slope (Holbert 2011, "Saying
//!   Goodbye to Shadow Acne"). Too much, and shadows leave their casters ("peter-panning").
//! - **Aliasing.** `pcf` averages *results* of comparisons over a small square (Reeves, Salesin, Cook 1987, "Rendering Antialiased
//!   Shadows with Depth Maps", doi:10.1145/37401.37435): depths must not be averaged.
//! - **Penumbras.** `pcss` finds the mean distance of what is in the way, and from it the width of the square over which to average
//!   (Fernando 2005, "Percentage-Closer Soft Shadows", doi:10.1145/1187112.1187153): w = (d_receiver − d_blocker) / d_blocker · w_light.
//!   The kernel here is the light itself, mirrored through the blocker: exact for straight edges parallel to a flat light.

use glam::{DVec2, DVec3};

use super::draw::{DrawOptions, draw};
use super::lights::{Extent, Form, LightGroup, Place};
use super::triangles::Triangles;
use super::view::{Pose, View};
use crate::math::{Vec3, fns, warp};

/// How depths are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum ShadowFilter {
    /// One texel, yes or no.
    Hard,
    /// The mean over 3 × 3 texels about the point, weighted bilinearly.
    Pcf,
    /// Percentage-closer soft shadows.
    #[default]
    Pcss,
}

/// Names that [`ShadowFilter::from_name`] knows.
pub const SHADOW_FILTERS: [&str; 3] = ["hard", "pcf", "pcss"];

impl ShadowFilter {
    /// By the name that the user types.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Hard, Self::Pcf, Self::Pcss].into_iter().zip(SHADOW_FILTERS).find(|(_, n)| *n == name).map(|(f, _)| f)
    }
}

/// Taps of the search for blockers and of the filter.
const SEARCH_TAPS: u32 = 16;
const FILTER_TAPS: u32 = 32;
/// Steeper receivers than this tangent are not followed further: their planes run away.
const MAX_SLOPE: f64 = 8.0;

/// One picture of depths.
#[derive(Clone, Debug)]
struct DepthMap {
    view: View,
    /// As in item buffers: larger is nearer to the light.
    depth: Vec<f32>,
    /// Distance of the nearest thing.
    nearest: f64,
}

/// Which map of several a point is looked up in.
#[derive(Clone, Debug)]
enum Layout {
    /// The first that holds it: one map, or cascades.
    FirstInside,
    /// By the largest of the coordinates in these axes: six faces; unused ones hold nothing.
    Cube([DVec3; 3]),
}

/// What the light looks like from afar.
#[derive(Clone, Debug)]
enum Kernel {
    /// A point.
    Point,
    /// Half-axes in the world; a disk or a rectangle.
    Flat { half: [DVec3; 2], disk: bool },
    /// A ball of this radius.
    Ball(f64),
    /// A disk of the sky: tangent of its half-angle.
    Sky(f64),
}

/// The shadow maps of one light.
#[derive(Clone, Debug)]
pub struct ShadowMap {
    maps: Vec<DepthMap>,
    layout: Layout,
    kernel: Kernel,
    /// Lights of one side: nothing behind this plane is lit, so nothing there is looked up.
    origin: Option<DVec3>,
}

/// What shadow maps are made of.
pub struct Casters<'a> {
    /// The scene's triangles.
    pub triangles: &'a Triangles,
    /// Center and radius of everything bounded.
    pub sphere: (Vec3, f32),
    /// Points that the camera sees, for cascades; may be empty.
    pub seen: &'a [Vec3],
    /// Edge of a map in texels.
    pub resolution: u32,
    /// Whether a triangle that light may pass stands in a texel: view, number, column, row.
    pub keeps: &'a (dyn Fn(&View, u32, u32, u32) -> bool + Sync),
}

impl Casters<'_> {
    fn map(&self, view: View, object: Option<u32>) -> DepthMap {
        // Lights are in the world's geometry, which is the first placement.
        let hides = |instance: u32, o: u32| instance == 0 && Some(o) == object;
        let keeps = |id: u32, x: u32, y: u32| (self.keeps)(&view, id, x, y);
        let options = DrawOptions { hides: object.is_some().then_some(&hides), keeps: Some(&keeps) };
        let depth = draw(self.triangles, &view, &options).depth;
        let nearest = depth.iter().fold(f32::NEG_INFINITY, |m, d| m.max(*d));
        let nearest = if nearest.is_finite() { f64::from(view.distance(nearest)) } else { f64::INFINITY };
        DepthMap { view, depth, nearest }
    }

    fn cube(&self, eye: DVec3, axes: [DVec3; 3], faces: [bool; 6], near: f64, object: Option<u32>) -> Vec<DepthMap> {
        (0..6)
            .map(|face| {
                let size = if faces[face] { self.resolution } else { 1 };
                let (forward, up) = (axes[face / 2], axes[(face / 2 + 1) % 3]);
                let forward = if face % 2 == 0 { forward } else { -forward };
                let pose = Pose { eye, right: forward.cross(up), up, forward };
                let view = View::perspective(pose, [-1.0, 1.0, -1.0, 1.0], [size; 2], near, f64::INFINITY);
                match faces[face] {
                    true => self.map(view, object),
                    false => DepthMap { view, depth: vec![f32::NEG_INFINITY], nearest: f64::INFINITY },
                }
            })
            .collect()
    }
}

/// World axes.
const AXES: [DVec3; 3] = [DVec3::X, DVec3::Y, DVec3::Z];
/// Spot lights up to this half-angle (70°) take one map, wider ones a cube.
const WIDEST_SPOT: f32 = 1.22;

impl ShadowMap {
    /// Draws the maps of a light.
    pub fn new(group: &LightGroup, casters: &Casters) -> Self {
        let near = 1e-5 * f64::from(casters.sphere.1).max(1e-20);
        let all = [true; 6];
        let cube = |p: DVec3, axes| (casters.cube(p, axes, all, near, group.object), Layout::Cube(axes));
        let ((maps, layout), kernel, origin) = match &group.place {
            Place::Point(p) => (cube(p.as_dvec3(), AXES), Kernel::Point, Some(p.as_dvec3())),
            Place::Spot(p, axis, outer) if *outer <= WIDEST_SPOT => {
                // A little wider than the cone, so that filters find texels beyond its rim.
                let t = f64::from(fns::tan(*outer)) * 1.05 + 1e-3;
                let view = View::perspective(Pose::along(*p, *axis), [-t, t, -t, t], [casters.resolution; 2], near, f64::INFINITY);
                ((vec![casters.map(view, None)], Layout::FirstInside), Kernel::Point, Some(p.as_dvec3()))
            }
            Place::Spot(p, ..) => (cube(p.as_dvec3(), AXES), Kernel::Point, Some(p.as_dvec3())),
            Place::Direction(to_light, tan) => {
                let kernel = if *tan > 0.0 { Kernel::Sky(f64::from(*tan)) } else { Kernel::Point };
                ((cascades(*to_light, casters), Layout::FirstInside), kernel, None)
            }
            Place::Area(e) => {
                let faces = if e.form == Form::Round { all } else { [true, true, true, true, true, e.two_sided] };
                let maps = casters.cube(e.center, e.axes, faces, near, group.object);
                ((maps, Layout::Cube(e.axes)), Kernel::of(e), Some(e.center))
            }
        };
        Self { maps, layout, kernel, origin }
    }

    /// The map of a place on a light, for methods that draw a new one for each sample: a point, or a direction to it.
    pub fn of_sample(place: &Place, object: Option<u32>, casters: &Casters) -> Self {
        let power = 0.0;
        let choice = crate::math::PiecewiseConstant1D::new(&[1.0]);
        let group = LightGroup { lights: Vec::new(), choice, place: place.clone(), object, power };
        let mut map = Self::new(&group, casters);
        map.kernel = Kernel::Point;
        map
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        self.maps.iter().map(|m| m.depth.len() * 4).sum()
    }

    /// Texels of all maps.
    pub fn count(&self) -> usize {
        self.maps.iter().filter(|m| m.depth.len() > 1).count()
    }

    /// The share of a light that a point sees, in [0, 1]. `n` is the unit geometric normal on the light's side, `u` two random
    /// numbers that turn the pattern of taps. `bias` is a factor on all biases.
    pub fn visibility(&self, p: Vec3, n: Vec3, filter: ShadowFilter, bias: f32, u: [f32; 2]) -> f32 {
        let (p, n) = (p.as_dvec3(), n.as_dvec3());
        let Some(at) = self.find(p, 2.0) else { return 1.0 };
        let receiver = Receiver::new(self, at, p, n, f64::from(bias));
        match (filter, &self.kernel) {
            (ShadowFilter::Hard, _) => self.hard(&receiver),
            (ShadowFilter::Pcf, _) | (ShadowFilter::Pcss, Kernel::Point) => self.pcf(&receiver),
            (ShadowFilter::Pcss, _) => self.pcss(&receiver, u),
        }
    }

    /// Map and place of a point; `margin` texels at the edges do not count where another map is.
    fn find(&self, p: DVec3, margin: f64) -> Option<(usize, DVec2, f64)> {
        let project = |m: &DepthMap| m.view.project(p.as_vec3());
        match &self.layout {
            Layout::Cube(axes) => {
                let d = p - self.origin.unwrap_or(DVec3::ZERO);
                let c = axes.map(|a| d.dot(a));
                let k = (0..3).max_by(|a, b| c[*a].abs().total_cmp(&c[*b].abs()))?;
                let i = 2 * k + usize::from(c[k] < 0.0);
                project(&self.maps[i]).map(|(pixel, distance)| (i, pixel, distance))
            }
            Layout::FirstInside => self.maps.iter().enumerate().find_map(|(i, m)| {
                let (pixel, distance) = project(m)?;
                let [w, h] = m.view.size.map(f64::from);
                let inside = |v: f64, n: f64| v >= margin && v <= n - margin;
                (inside(pixel.x, w) && inside(pixel.y, h)).then_some((i, pixel, distance))
            }),
        }
    }

    fn hard(&self, r: &Receiver) -> f32 {
        let map = &self.maps[r.map];
        // The point may lie half a diagonal from the texel's center.
        let bias = r.bias * r.texel * (0.1 + 0.71 * r.slope.min(MAX_SLOPE)) + r.rounding;
        let [x, y] = [r.pixel.x.floor(), r.pixel.y.floor()];
        f32::from(u8::from(!(map.distance(x, y) < r.distance - bias)))
    }

    /// Four by four texels: three by three about the point, moved between texels by bilinear weights.
    fn pcf(&self, r: &Receiver) -> f32 {
        let map = &self.maps[r.map];
        let corner = (r.pixel - 0.5).floor();
        let f = r.pixel - 0.5 - corner;
        let weights = |f: f64| [1.0 - f, 1.0, 1.0, f];
        let mut lit = 0.0;
        for (j, wy) in weights(f.y).into_iter().enumerate() {
            for (i, wx) in weights(f.x).into_iter().enumerate() {
                let texel = corner + DVec2::new(i as f64 - 1.0, j as f64 - 1.0);
                if !r.is_occluded(map, texel) {
                    lit += wx * wy;
                }
            }
        }
        (lit / 9.0) as f32
    }

    fn pcss(&self, r: &Receiver, u: [f32; 2]) -> f32 {
        let map = &self.maps[r.map];
        // The nearest that a blocker may be limits where they may be.
        let nearest = self.maps.iter().map(|m| m.nearest).fold(f64::INFINITY, f64::min);
        if !(nearest < f64::INFINITY) {
            return 1.0;
        }
        let reach = match self.kernel {
            Kernel::Sky(_) => (r.distance - nearest).max(0.0),
            _ => (r.distance / nearest.max(1e-3 * r.distance) - 1.0).max(0.0),
        };
        let search = r.kernel(&self.kernel, reach, 0.25 * f64::from(map.view.size[0]) * r.texel);
        let (mut sum, mut blockers) = (0.0, 0u32);
        for i in 0..SEARCH_TAPS {
            let q = r.p + search.point(tap(i, SEARCH_TAPS, u));
            if let Some((blocker, receiver)) = self.compare(r, q).filter(|(b, c)| b < c) {
                // As shares of the way from the light, which cube faces agree on.
                sum += if matches!(self.kernel, Kernel::Sky(_)) { receiver - blocker } else { blocker / receiver };
                blockers += 1;
            }
        }
        if blockers == 0 {
            return 1.0;
        }
        let mean = sum / f64::from(blockers);
        let spread = match self.kernel {
            Kernel::Sky(_) => mean,
            _ => (1.0 - mean) / mean.max(1e-6),
        };
        let kernel = r.kernel(&self.kernel, spread, f64::INFINITY);
        let mut lit = 0;
        for i in 0..FILTER_TAPS {
            let q = r.p + kernel.point(tap(i, FILTER_TAPS, u));
            lit += u32::from(!self.compare(r, q).is_some_and(|(blocker, receiver)| blocker < receiver));
        }
        lit as f32 / FILTER_TAPS as f32
    }

    /// What the map holds on the line from the light to `q`, and where the receiver's plane is on it less the bias, as distances;
    /// `None` beyond the maps.
    fn compare(&self, r: &Receiver, q: DVec3) -> Option<(f64, f64)> {
        let (map, pixel, distance) = match self.layout {
            Layout::Cube(_) => self.find(q, 0.0)?,
            Layout::FirstInside => {
                let (pixel, distance) = self.maps[r.map].view.project(q.as_vec3())?;
                (r.map, pixel, distance)
            }
        };
        let texel = pixel.floor();
        let map = &self.maps[map];
        let receiver = plane_distance(&map.view, r.p, r.n, texel + 0.5, distance, (q - r.p).length() + r.texel);
        Some((map.distance(texel.x, texel.y), receiver - r.constant()))
    }
}

/// The i-th of n points of a plane set (Hammersley 1960) in [−1, 1]², moved by `u`.
fn tap(i: u32, n: u32, u: [f32; 2]) -> Vec2d {
    let x = (i as f32 + 0.5) / n as f32 + u[0];
    let y = i.reverse_bits() as f32 / 4_294_967_296.0 + u[1];
    Vec2d::new(2.0 * (x - x.floor()) - 1.0, 2.0 * (y - y.floor()) - 1.0)
}

type Vec2d = crate::math::Vec2;

/// Half-axes of the square or disk over which is averaged.
struct Taps {
    half: [DVec3; 2],
    disk: bool,
}

impl Taps {
    #[inline]
    fn point(&self, t: Vec2d) -> DVec3 {
        let t = if self.disk { warp::disk_concentric(0.5 * t + 0.5) } else { t };
        self.half[0] * f64::from(t.x) + self.half[1] * f64::from(t.y)
    }
}

impl Kernel {
    fn of(e: &Extent) -> Self {
        match e.form {
            Form::Round => Self::Ball(e.half[0]),
            Form::Rectangle | Form::Disk => Self::Flat { half: [e.axes[0] * e.half[0], e.axes[1] * e.half[1]], disk: e.form == Form::Disk },
        }
    }
}

impl DepthMap {
    /// Distance of what a texel holds; infinite where it holds nothing. Beyond the edges the outermost texels count.
    #[inline]
    fn distance(&self, x: f64, y: f64) -> f64 {
        let [w, h] = self.view.size;
        let (x, y) = (x.clamp(0.0, f64::from(w - 1)) as usize, y.clamp(0.0, f64::from(h - 1)) as usize);
        let depth = self.depth[y * w as usize + x];
        if depth == f32::NEG_INFINITY { f64::INFINITY } else { f64::from(self.view.distance(depth)) }
    }
}

/// Distance of the plane through `p` with normal `n` on the line of sight through a place of the map. Planes that are seen nearly
/// along themselves are limited: they may not be farther from `distance` than the slope allows over `lateral`.
#[inline]
fn plane_distance(view: &View, p: DVec3, n: DVec3, pixel: DVec2, distance: f64, lateral: f64) -> f64 {
    let (o, d) = view.line_of_sight(pixel);
    let t = n.dot(p - o) / n.dot(d);
    let limit = MAX_SLOPE * lateral;
    // A plane that is not met at all is NaN or behind: the point's own distance is as good as any.
    if t > 0.0 || !view.is_perspective() && t.is_finite() { t.clamp(distance - limit, distance + limit) } else { distance }
}

/// A point that asks, moved along its normal.
struct Receiver {
    p: DVec3,
    n: DVec3,
    map: usize,
    pixel: DVec2,
    distance: f64,
    /// Size of a texel at the point.
    texel: f64,
    /// Unit direction in which the light comes.
    towards: DVec3,
    /// By how much the plane's distance along the map's axis changes across it.
    slope: f64,
    bias: f64,
    /// What `f32` coordinates and depths may err by.
    rounding: f64,
}

impl Receiver {
    fn new(maps: &ShadowMap, (map, pixel, distance): (usize, DVec2, f64), p: DVec3, n: DVec3, bias: f64) -> Self {
        let view = &maps.maps[map].view;
        let (o, d) = view.line_of_sight(pixel);
        let towards = d.normalize();
        let cos = n.dot(towards).abs().min(1.0);
        let texel = view.pixel_size(distance);
        // d has length 1 along the axis, also where it is far from it.
        let pose = view.pose();
        let slope = DVec2::new(n.dot(pose.right), n.dot(pose.up)).length() / n.dot(d).abs().max(1e-9);
        // Grazing light needs most, and none that comes straight on.
        let moved = p + n * (bias * 0.5 * texel * (1.0 - cos * cos).sqrt());
        let rounding = bias * 4.0 * f64::from(f32::EPSILON) * (p.abs().max_element() + (p - o).length());
        let (pixel, distance) = view.project(moved.as_vec3()).unwrap_or((pixel, distance));
        Self { p: moved, n, map, pixel, distance, texel, towards, slope, bias, rounding }
    }

    #[inline]
    fn constant(&self) -> f64 {
        self.bias * 0.05 * self.texel + self.rounding
    }

    fn is_occluded(&self, map: &DepthMap, texel: DVec2) -> bool {
        let center = texel + 0.5;
        let lateral = (center - self.pixel).length() * self.texel;
        let receiver = plane_distance(&map.view, self.p, self.n, center, self.distance, lateral);
        map.distance(texel.x, texel.y) < receiver - self.constant()
    }

    /// The light's image at the point, scaled by `spread`, no smaller than a texel and no larger than `limit`.
    fn kernel(&self, kernel: &Kernel, spread: f64, limit: f64) -> Taps {
        let (half, disk) = match kernel {
            Kernel::Flat { half, disk } => (half.map(|h| h * spread), *disk),
            Kernel::Ball(radius) | Kernel::Sky(radius) => {
                // Across the direction in which the map looks: the light faces the point.
                let (s, t) = self.towards.any_orthonormal_pair();
                ([s * (radius * spread), t * (radius * spread)], true)
            }
            Kernel::Point => ([DVec3::ZERO; 2], false),
        };
        let fit = |h: DVec3, fallback: DVec3| {
            let length = h.length();
            if length > limit {
                h * (limit / length)
            } else if length < self.texel {
                h.normalize_or(fallback) * self.texel
            } else {
                h
            }
        };
        let (s, t) = self.n.any_orthonormal_pair();
        Taps { half: [fit(half[0], s), fit(half[1], t)], disk }
    }
}

/// Cascades fitted to what the camera sees.
const CASCADES: usize = 3;

/// Parallel maps for a direction to the light: some that hold the nearer and the farther of the points that the camera sees (after
/// Lauritzen, Salvi and Lefohn 2010, "Sample Distribution Shadow Maps", without their clustering), and one for the whole scene.
fn cascades(to_light: Vec3, casters: &Casters) -> Vec<DepthMap> {
    let (center, radius) = casters.sphere;
    let radius = f64::from(radius).max(1e-6);
    let pose = Pose::along(center, -to_light);
    // Everything that may stand in the way is within the sphere; planes beyond it receive.
    let (near, far) = (-1.01 * radius, 1e3 * radius);
    let view = |window: [f64; 4]| View::orthographic(pose, window, [casters.resolution; 2], near, far);
    let mut maps = Vec::new();
    let count = casters.seen.len();
    for i in 0..CASCADES {
        // Points come sorted by their distance from the eye: equal shares of the picture.
        let part = &casters.seen[count * i / CASCADES..count * (i + 1) / CASCADES];
        let (mut lo, mut hi) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for p in part {
            let d = p.as_dvec3() - pose.eye;
            let q = DVec2::new(d.dot(pose.right), d.dot(pose.up));
            (lo, hi) = (lo.min(q), hi.max(q));
        }
        // Nothing outside of the scene's own shadow needs a map.
        let bound = DVec2::splat(1.01 * radius);
        let (lo, hi) = (lo.max(-bound), hi.min(bound));
        let size = (hi - lo).max_element();
        if part.is_empty() || !(size > 0.0) {
            continue;
        }
        let margin = 0.05 * size + 1e-9 * radius;
        // Square, so that texels are.
        let (c, half) = ((lo + hi) * 0.5, 0.5 * size + margin);
        if half < 0.9 * radius {
            maps.push(casters.map(view([c.x - half, c.x + half, c.y - half, c.y + half]), None));
        }
    }
    let all = 1.01 * radius;
    maps.push(casters.map(view([-all, all, -all, all]), None));
    maps
}
