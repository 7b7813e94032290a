//! Lights as shadow maps see them: one place to look from, and how large what shines there is.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};

use crate::light::{AreaGeometry, Light, LightContext};
use crate::math::{PiecewiseConstant1D, Vec2, Vec3, fns};
use crate::scene::{LightSource, Scene};
use crate::shape::Shape;

/// Lights that one shadow map serves: a point, a spot, a direction, or all primitives of an emitting object.
#[derive(Clone, Debug)]
pub struct LightGroup {
    /// Indices into the scene's lights.
    pub lights: Vec<u32>,
    /// Chooses one of them by what it gives.
    pub choice: PiecewiseConstant1D,
    /// Where the map looks from.
    pub place: Place,
    /// The object that emits, in the world's geometry: it is not drawn into its own map.
    pub object: Option<u32>,
    /// What it gives into the scene, to know which lights matter most.
    pub power: f32,
}

/// Where a light is and how large.
#[derive(Clone, Debug)]
pub enum Place {
    /// A point that shines all round.
    Point(Vec3),
    /// A point with a cone: position, axis, half-angle in radians.
    Spot(Vec3, Vec3, f32),
    /// Infinitely far: unit direction to the light, tangent of the half-angle that it fills.
    Direction(Vec3, f32),
    /// A surface.
    Area(Extent),
}

/// A surface that emits, as a rectangle, a disk or a ball of about its size.
#[derive(Clone, Debug)]
pub struct Extent {
    /// Center of area.
    pub center: DVec3,
    /// Unit axes; the third is the normal of flat lights.
    pub axes: [DVec3; 3],
    /// Half-edges of the rectangle (radii of the disk) along the first two axes.
    pub half: [f64; 2],
    /// What it is like.
    pub form: Form,
    /// Whether light leaves against the third axis too.
    pub two_sided: bool,
}

/// The form of an area light, as seen from afar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// A flat rectangle, or about one.
    Rectangle,
    /// A flat disk.
    Disk,
    /// Not flat: it counts as a disk that faces whom it lights.
    Round,
}

/// All lights but environments, in the scene's order.
pub fn light_groups(scene: &Scene) -> Vec<LightGroup> {
    let mut groups = Vec::new();
    let mut by_object: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    let (center, radius) = scene.bounds.bounding_sphere();
    let sphere = crate::light::SceneSphere { center, radius: radius.max(1e-6), endless: scene.endless };
    let power = |i: u32| {
        let p = scene.lights[i as usize].power(&sphere).luminance();
        if p.is_finite() { p.max(0.0) } else { 0.0 }
    };
    let single = |i: u32, place: Place| LightGroup {
        lights: vec![i],
        choice: PiecewiseConstant1D::new(&[1.0]),
        place,
        object: None,
        power: power(i),
    };
    let ctx = LightContext { p: Vec3::ZERO, n: Vec3::ZERO };
    for (i, light) in scene.lights.iter().enumerate() {
        let index = i as u32;
        match light {
            Light::Point(l) => groups.push(single(index, Place::Point(l.p))),
            Light::Spot(l) => {
                let b = l.bounds();
                let outer = fns::acos(b.cos_o) + fns::acos(b.cos_e);
                groups.push(single(index, Place::Spot(b.bounds.min, b.axis, outer)));
            }
            Light::Picture(l) => {
                let b = l.bounds();
                let place = if b.cos_o > 0.0 { Place::Spot(b.bounds.min, b.axis, fns::acos(b.cos_o)) } else { Place::Point(b.bounds.min) };
                groups.push(single(index, place));
            }
            Light::Directional(_) | Light::Sun(_) => {
                // The middle of the sun's disk is its sample at zero; its density tells the disk's size.
                let Some(s) = light.sample(&ctx, Vec2::ZERO) else { continue };
                let one_minus_cos = if s.delta { 0.0 } else { crate::math::INV_TAU / s.pdf };
                let cos = 1.0 - one_minus_cos;
                let tan = (one_minus_cos * (2.0 - one_minus_cos)).max(0.0).sqrt() / cos.max(1e-3);
                groups.push(single(index, Place::Direction(s.wi, tan)));
            }
            Light::Area(l) => {
                if let Some(LightSource { object, .. }) = scene.light_sources.get(l.emission_id as usize) {
                    by_object.entry(*object).or_default().push(index);
                }
            }
            Light::Constant(_) | Light::Environment(_) | Light::Portal(_) => {}
        }
    }
    for (object, lights) in by_object {
        let powers: Vec<f32> = lights.iter().map(|i| power(*i)).collect();
        let Some(extent) = extent(scene, &lights) else { continue };
        let sum = powers.iter().sum();
        groups.push(LightGroup {
            lights,
            choice: PiecewiseConstant1D::new(&powers),
            place: Place::Area(extent),
            object: Some(object),
            power: sum,
        });
    }
    groups
}

/// The form of an emitting object, from its triangles' moments.
fn extent(scene: &Scene, lights: &[u32]) -> Option<Extent> {
    let (mut two_sided, mut is_disk) = (false, false);
    let mut triangles: Vec<[DVec3; 3]> = Vec::new();
    let mut normal = DVec3::ZERO;
    for i in lights {
        let Light::Area(l) = &scene.lights[*i as usize] else { continue };
        two_sided |= l.two_sided;
        match &l.geometry {
            AreaGeometry::Triangle(v) => {
                let v = v.map(Vec3::as_dvec3);
                let n = (v[1] - v[0]).cross(v[2] - v[0]);
                normal += if l.flip_normals { -n } else { n };
                triangles.push(v);
            }
            AreaGeometry::Shape(s) => {
                let (positions, indices) = s.tessellate(0.0);
                is_disk |= matches!(**s, Shape::Disk(_));
                let of = |t: &[u32; 3]| t.map(|k| positions[k as usize].as_dvec3());
                triangles.extend(indices.iter().map(of));
                let is_flat = matches!(**s, Shape::Disk(_) | Shape::Rectangle(_) | Shape::Polygon(_));
                if is_flat {
                    normal += s.surface(s.bounds().center()).ng.as_dvec3() * 2.0 * f64::from(s.area());
                }
            }
        }
    }
    let doubled = |v: &[DVec3; 3]| (v[1] - v[0]).cross(v[2] - v[0]).length();
    let area: f64 = triangles.iter().map(doubled).sum();
    if !(area > 0.0 && area.is_finite()) {
        return None;
    }
    let center = triangles.iter().fold(DVec3::ZERO, |sum, v| sum + (v[0] + v[1] + v[2]) / 3.0 * doubled(v)) / area;
    let is_flat = normal.length() > 0.999 * area;
    let n = if is_flat { normal.normalize() } else { DVec3::Z };
    let (s, t) = axes_in_plane(&triangles, n);
    // Second moments about the center: the mean of x² over a triangle is (Σ xᵢ² + (Σ xᵢ)²) / 12.
    let variance = |axis: DVec3| {
        let of = |v: &[DVec3; 3]| {
            let x = v.map(|p| (p - center).dot(axis));
            let sum: f64 = x.iter().sum();
            (x.iter().map(|x| x * x).sum::<f64>() + sum * sum) / 12.0 * doubled(v)
        };
        triangles.iter().map(of).sum::<f64>() / area
    };
    let (form, half) = match (is_flat, is_disk && lights.len() == 1) {
        // A rectangle's variance is half²/3, a disk's radius²/4, a sphere's radius²/3.
        (true, false) => (Form::Rectangle, [s, t].map(|a| (3.0 * variance(a)).sqrt())),
        (true, true) => (Form::Disk, [s, t].map(|a| 2.0 * variance(a).sqrt())),
        (false, _) => (Form::Round, [(variance(DVec3::X) + variance(DVec3::Y) + variance(DVec3::Z)).sqrt(); 2]),
    };
    Some(Extent { center, axes: [s, t, n], half, form, two_sided })
}

/// Axes of the smallest rectangle around flat triangles that has a side along one of their edges.
fn axes_in_plane(triangles: &[[DVec3; 3]], n: DVec3) -> (DVec3, DVec3) {
    // Edges beyond these are of meshes that have no rectangle's form anyway.
    const EDGES: usize = 96;
    let mut best = (f64::INFINITY, n.any_orthonormal_pair());
    let edges = triangles.iter().flat_map(|v| [v[1] - v[0], v[2] - v[1], v[0] - v[2]]).take(EDGES);
    for edge in edges {
        let s = (edge - n * edge.dot(n)).normalize_or_zero();
        if s == DVec3::ZERO {
            continue;
        }
        let t = n.cross(s);
        let width = |axis: DVec3| {
            let (lo, hi) = triangles.iter().flatten().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), p| {
                let x = p.dot(axis);
                (lo.min(x), hi.max(x))
            });
            hi - lo
        };
        let area = width(s) * width(t);
        if area < best.0 * (1.0 - 1e-6) {
            best = (area, (s, t));
        }
    }
    best.1
}

impl Extent {
    /// World from the light's own axes.
    pub fn rotation(&self) -> DMat3 {
        DMat3::from_cols(self.axes[0], self.axes[1], self.axes[2])
    }
}
