//! Environment maps drawn from the middles of the objects that show their surroundings.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::environment::{Cube, Environment};
use super::lighting::{Lighting, escaped};
use super::triangles::Triangles;
use super::visible::{draw_scene, surface_at, transmittance};
use super::{Pose, View};
use crate::bsdf::{Bsdf, Lobe};
use crate::integrator::Estimate;
use crate::math::{Aabb, Vec3};
use crate::sampler::{Sampler, SamplerKind};
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// More reflecting objects than this share the sky's map.
const MAX_CAPTURES: usize = 24;
/// Edge of a captured cube's face.
pub(super) const CAPTURE: usize = 256;

/// Environment maps of reflecting objects, by placement and object, each from the object's middle, under the light that there is. `sampled`:
/// whether lights are sampled from everywhere, the sky among them.
pub(super) fn capture(
    lighting: &Lighting,
    sampled: bool,
    scene: &Scene,
    triangles: &Triangles,
    progress: &dyn Fn(&str, f64),
) -> BTreeMap<(u32, u32), Environment> {
    let mut objects = reflecting_objects(scene, triangles);
    objects.sort_by(|a, b| b.bounds.half_area().total_cmp(&a.bounds.half_area()).then(a.key.cmp(&b.key)));
    objects.truncate(MAX_CAPTURES);
    let count = objects.len();
    let mut captured = BTreeMap::new();
    for (i, o) in objects.into_iter().enumerate() {
        progress("environment maps", i as f64 / count as f64);
        captured.insert(o.key, capture_one(lighting, sampled, scene, triangles, &o));
    }
    captured
}

fn capture_one(lighting: &Lighting, sampled: bool, scene: &Scene, triangles: &Triangles, o: &Reflecting) -> Environment {
    let center = o.bounds.center();
    let window = [-1.0, 1.0, -1.0, 1.0];
    let views: Vec<View> =
        (0..6).map(|f| View::perspective(Pose::cube_face(center, f), window, [CAPTURE as u32; 2], 0.0, f64::INFINITY)).collect();
    let buffers: Vec<_> = views.iter().map(|v| draw_scene(scene, triangles, v, 0, Some(o.key))).collect();
    let sampler = Sampler { kind: SamplerKind::Independent, seed: 0, spp: 1 };
    // What surfaces reflect, and what they and the sky send of themselves.
    let texels: Vec<(Spectrum, Spectrum, Spectrum)> = (0..6 * CAPTURE * CAPTURE)
        .into_par_iter()
        .map(|i| {
            let (face, y, x) = (i / (CAPTURE * CAPTURE), i / CAPTURE % CAPTURE, i % CAPTURE);
            let (o, d) = views[face].line_of_sight(glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
            let wi = d.as_vec3().normalize();
            let sky = || (Spectrum::ZERO, Spectrum::ZERO, escaped(scene, center, wi));
            let Some((id, _)) = buffers[face].at(x as u32, y as u32) else { return sky() };
            let Some(s) = surface_at(scene, triangles, id, o, d) else { return sky() };
            let instance = triangles.locate(id).map_or(0, |l| l.instance);
            let mut out = Estimate::default();
            let mut stream = sampler.stream(x as u32, (face * CAPTURE + y) as u32, 0);
            lighting.shade(scene, &s, instance, -wi, &mut stream, &mut out);
            (out.radiance, scene.emitted(&s, -wi), Spectrum::ZERO)
        })
        .collect();
    let at = |face: usize, x: usize, y: usize| texels[(face * CAPTURE + y) * CAPTURE + x];
    let mirror = Cube::new(CAPTURE, |f, x, y, _| {
        let (reflected, emitted, sky) = at(f, x, y);
        reflected + emitted + sky
    });
    // Lights that are sampled reach rough surfaces as lights.
    let rough = Cube::new(CAPTURE, |f, x, y, _| {
        let (reflected, _, sky) = at(f, x, y);
        if sampled { reflected } else { reflected + sky }
    });
    // The surroundings' sides: nearly the farthest that is seen along each axis.
    let side = |face: usize| {
        let mut distances: Vec<f32> = buffers[face].depth.iter().filter(|d| **d > 0.0).map(|d| 1.0 / d).collect();
        distances.sort_by(f32::total_cmp);
        // A side of which little is seen is open: far away.
        let open = distances.len() * 2 < CAPTURE * CAPTURE;
        let at = distances.get(distances.len().saturating_sub(1) * 19 / 20).copied();
        if open { 1e3 * o.bounds.extent().length().max(1e-6) } else { at.unwrap_or(f32::INFINITY) }
    };
    let bounds = Aabb { min: center - Vec3::new(side(1), side(3), side(5)), max: center + Vec3::new(side(0), side(2), side(4)) };
    Environment::new(Some(center), bounds, mirror, &rough)
}

/// An object that shows its surroundings.
struct Reflecting {
    key: (u32, u32),
    bounds: Aabb,
}

fn reflecting_objects(scene: &Scene, triangles: &Triangles) -> Vec<Reflecting> {
    let mut found: BTreeMap<(u32, u32), Option<Aabb>> = BTreeMap::new();
    for part in &triangles.parts {
        let mesh = &triangles.meshes[part.mesh as usize];
        for t in 0..mesh.triangles.len() {
            let key = (part.instance, mesh.object(t));
            let id = part.first + t as u32;
            let bounds = found.entry(key).or_insert_with(|| reflects(scene, triangles, id).then_some(Aabb::EMPTY));
            if let (Some(b), Some(l)) = (bounds, triangles.locate(id)) {
                *b = l.corners.iter().fold(*b, |b, p| b.grow(p.as_vec3()));
            }
        }
    }
    let finite = |b: &Aabb| b.min.is_finite() && b.max.is_finite();
    found.into_iter().filter_map(|(key, b)| b.filter(finite).map(|bounds| Reflecting { key, bounds })).collect()
}

/// Whether the object of a triangle has a mirror, sharp or not very rough.
fn reflects(scene: &Scene, triangles: &Triangles, id: u32) -> bool {
    let Some(l) = triangles.locate(id) else { return false };
    let [a, b, c] = l.corners;
    let n = (b - a).cross(c - a).normalize_or_zero();
    let middle = (a + b + c) / 3.0;
    if !(middle.is_finite() && n.is_finite()) {
        return false;
    }
    // From both sides: one may be black.
    [n, -n].into_iter().any(|n| {
        let Some(s) = surface_at(scene, triangles, id, middle + n * 1e-3, -n) else { return false };
        let wo = n.as_vec3();
        let scatter = scene.materials[s.material as usize].shade(scene, &s, wo);
        let passes = transmittance(scene, &s, wo);
        passes < 1.0
            && scatter.parts.iter().any(|p| {
                let lobes = p.bsdf.lobes();
                (lobes.contains(Lobe::DELTA) && !matches!(p.bsdf, Bsdf::Null(_))) || lobes.contains(Lobe::GLOSSY)
            })
    })
}
