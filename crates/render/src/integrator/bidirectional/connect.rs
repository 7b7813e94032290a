//! The techniques: how two walks become a path, what it brings and what it weighs.

use super::mis::{Joint, Origin, Technique};
use super::walk::{Escape, LightStart, Vertex, Walk, light_density};
use super::{Bidirectional, Numbers};
use crate::light::{Light, LightSample};
use crate::math::{Vec2, Vec3};
use crate::sampler::HashRng;
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// Light that a path brings, weighted.
#[derive(Clone, Copy, Debug)]
pub struct Contribution {
    /// How much.
    pub value: Spectrum,
    /// Of which light group.
    pub group: u32,
}

/// The camera's own joint.
const CAMERA: Joint = Joint { light: 0.0, camera: 1.0, connectible: true, in_medium: false };

/// Appends the joints from a vertex of the camera's walk to the camera. `light` is the density of the vertex from the light, `light_back`
/// that of the vertex before it, where it is not the one that the walk itself has led to.
pub fn push_camera_joints(joints: &mut Vec<Joint>, walk: &Walk, v: &Vertex, light: f32, mut light_back: Option<f32>) {
    joints.push(Joint { light, camera: v.own, connectible: true, in_medium: v.in_medium() });
    let mut at = v;
    while let Some(before) = walk.previous(at) {
        joints.push(Joint {
            light: light_back.take().unwrap_or(before.other),
            camera: before.own,
            connectible: !before.delta,
            in_medium: before.in_medium(),
        });
        at = before;
    }
    joints.push(CAMERA);
}

/// Sets the joints from the light to a vertex of its walk. `camera` is the density of the vertex from the camera, `camera_back` that of
/// the vertex before it. Returns what is special about the light.
pub fn set_light_joints(joints: &mut Vec<Joint>, walk: &Walk, start: &LightStart, v: &Vertex, camera: f32, camera_back: f32) -> Origin {
    joints.clear();
    joints.push(Joint { light: v.own, camera, connectible: true, in_medium: v.in_medium() });
    let mut back = Some(camera_back);
    let mut at = v;
    while let Some(before) = walk.previous(at) {
        joints.push(Joint {
            light: before.own,
            camera: back.take().unwrap_or(before.other),
            connectible: !before.delta,
            in_medium: before.in_medium(),
        });
        at = before;
    }
    joints.push(Joint { camera: back.unwrap_or(start.joint.camera), ..start.joint });
    joints.reverse();
    Origin { nee: at.nee, delta: start.delta }
}

impl Bidirectional {
    /// The light's densities for a path that ends on it: of joint 0 by emission, and of joint 1 with cosine `cos` to the light's ray.
    /// `d` is the direction in which the light leaves, `p` the light's point, for infinite lights joint 1.
    #[expect(clippy::too_many_arguments, reason = "private; the numbers of one end of a path")]
    fn emission_densities(&self, scene: &Scene, light: u32, p: Vec3, n: Vec3, d: Vec3, cos: f32, distance_2: f32) -> (f32, f32) {
        let Some(emission) = &self.emission else { return (0.0, 0.0) };
        let pmf = emission.pmf(light);
        let (position, direction) = (emission.pdf_position(scene, light, p, d), emission.pdf_direction(scene, light, n, d));
        if scene.lights[light as usize].is_infinite() {
            (pmf * direction, position * cos)
        } else {
            (pmf * position, direction * cos / distance_2)
        }
    }

    /// Light that a vertex of the camera's walk sends itself: the walk has met a light by chance.
    pub fn hit(&self, scene: &Scene, walk: &Walk, v: &Vertex, joints: &mut Vec<Joint>) -> Option<Contribution> {
        let s = v.surface()?;
        let emission = s.object(scene).emission.as_ref()?;
        if v.depth == 1 && scene.hides(s) {
            return None;
        }
        let radiance = scene.emitted(s, v.wo);
        if radiance.is_black() {
            return None;
        }
        let weight = match (walk.previous(v), s.light(scene)) {
            (Some(before), Some(light)) => {
                let ctx = before.context();
                let distance_2 = (s.p - before.p).length_squared();
                let to_light = s.ng.dot(v.wo).abs() / distance_2;
                let cos = before.cos(v.wo);
                let (own, first) = self.emission_densities(scene, light, s.p, s.ng, v.wo, cos, distance_2);
                joints.clear();
                joints.push(Joint { light: own, camera: v.own, connectible: true, in_medium: false });
                push_camera_joints(joints, walk, before, first, None);
                joints[1].connectible = !before.delta;
                let pmf = scene.light_sampler.pmf(&ctx, light);
                let nee = pmf * light_density(&scene.lights[light as usize], &ctx, s.p, s.ng, -v.wo) * to_light;
                self.techniques.weight(joints, &Origin { nee, delta: false }, Technique::Connect(0))
            }
            _ => 1.0,
        };
        Some(Contribution { value: v.beta * radiance * weight, group: emission.group })
    }

    /// Light of all infinite lights where the camera's walk has left the scene.
    pub fn escape(&self, scene: &Scene, walk: &Walk, e: &Escape, joints: &mut Vec<Joint>, mut add: impl FnMut(Contribution)) {
        let before = walk.vertices.get(e.previous as usize);
        if before.is_none() && scene.hide_lights {
            return;
        }
        for &light in &scene.infinite_lights {
            let radiance = scene.lights[light as usize].escaped(before.map_or(e.from, |v| v.p), e.d);
            if radiance.is_black() {
                continue;
            }
            let weight = before.map_or(1.0, |before| {
                let ctx = before.context();
                let cos = before.cos(e.d);
                let (own, first) = self.emission_densities(scene, light, before.p, Vec3::ZERO, -e.d, cos, 1.0);
                joints.clear();
                joints.push(Joint { light: own, camera: e.pdf, connectible: true, in_medium: false });
                push_camera_joints(joints, walk, before, first, None);
                joints[1].connectible = !before.delta;
                let nee = scene.light_sampler.pmf(&ctx, light) * scene.lights[light as usize].pdf_escaped(&ctx, e.d);
                self.techniques.weight(joints, &Origin { nee, delta: false }, Technique::Connect(0))
            });
            add(Contribution { value: e.beta * radiance * weight, group: scene.light_groups[light as usize] });
        }
    }

    /// Light that comes to a vertex of the camera's walk from a light that is sampled for it. Always draws three numbers.
    pub fn direct(
        &self,
        scene: &Scene,
        walk: &Walk,
        v: &Vertex,
        numbers: &mut impl Numbers,
        joints: &mut Vec<Joint>,
    ) -> Option<Contribution> {
        let mut rng = if scene.has_media { numbers.rng() } else { HashRng::default() };
        let (u_light, u) = (numbers.next_1d(), numbers.next_2d());
        if v.depth > self.max_depth || !v.is_smooth_anywhere() {
            return None;
        }
        let ctx = v.context();
        let (index, pmf) = scene.light_sampler.sample(&ctx, u_light)?;
        let light = &scene.lights[index as usize];
        let sample = light.sample(&ctx, u)?;
        let (f, pdf) = v.eval(scene, sample.wi);
        if f.is_black() {
            return None;
        }
        let radiance = scene.light_radiance(index, &sample);
        let distance_2 = if sample.dist.is_finite() { sample.dist * sample.dist } else { 1.0 };
        let to_light = if matches!(light, Light::Area(_)) { sample.n.dot(sample.wi).abs() / distance_2 } else { 1.0 };
        let cos = v.cos(sample.wi);
        let point = if light.is_infinite() { v.p } else { sample.p };
        let (own, first) = self.emission_densities(scene, index, point, sample.n, -sample.wi, cos, distance_2);
        let nee = pmf * sample.pdf * to_light;
        if radiance.is_black() || !(nee > 0.0) {
            return None;
        }
        joints.clear();
        joints.push(Joint { light: own, camera: pdf * to_light, connectible: true, in_medium: false });
        let back = v.pdf_back(scene, sample.wi) * v.to_previous;
        push_camera_joints(joints, walk, v, first, Some(back));
        let weight = self.techniques.weight(joints, &Origin { nee, delta: light.is_delta() }, Technique::Connect(1));
        let value = v.beta * f * radiance * (weight / (pmf * sample.pdf));
        if value.is_black() {
            return None;
        }
        let value = value * v.visibility(scene, &sample, &mut rng);
        (!value.is_black()).then(|| Contribution { value, group: scene.light_groups[index as usize] })
    }

    /// Light along the connection of a vertex of the light's walk to one of the camera's.
    pub fn connect(
        &self,
        scene: &Scene,
        (light_walk, start, y): (&Walk, &LightStart, &Vertex),
        (camera_walk, z): (&Walk, &Vertex),
        rng: &mut HashRng,
        joints: &mut Vec<Joint>,
    ) -> Option<Contribution> {
        if y.depth.saturating_add(z.depth) > self.max_depth {
            return None;
        }
        let to = y.p - z.p;
        let distance_2 = to.length_squared();
        let w = to / distance_2.sqrt();
        let (f_z, pdf_z) = z.eval(scene, w);
        if !w.is_finite() || f_z.is_black() {
            return None;
        }
        let (f_y, back_y) = y.eval_light(scene, -w);
        let value = y.beta * f_y * f_z * z.beta / distance_2;
        if value.is_black() || !value.is_finite() {
            return None;
        }
        let pdf_y = y.pdf_light(scene, -w);
        let back_z = z.pdf_back(scene, w);
        let (cos_y, cos_z) = (y.cos(w), z.cos(w));
        let origin = set_light_joints(joints, light_walk, start, y, pdf_z * cos_y / distance_2, back_y * y.to_previous);
        push_camera_joints(joints, camera_walk, z, pdf_y * cos_z / distance_2, Some(back_z * z.to_previous));
        let weight = self.techniques.weight(joints, &origin, Technique::Connect(y.depth as usize + 1));
        let value = value * weight;
        if value.is_black() {
            return None;
        }
        let p = y.origin(-w);
        let value = value * z.visibility(scene, &target(p, w, (p - z.p).length()), rng);
        (!value.is_black()).then_some(Contribution { value, group: start.group })
    }

    /// Light that a vertex of the light's walk sends to the camera: the point of the picture, and what a pixel there gets if each pixel
    /// has one such walk. Always draws three numbers.
    pub fn to_camera(
        &self,
        scene: &Scene,
        (walk, start, y): (&Walk, &LightStart, &Vertex),
        numbers: &mut impl Numbers,
        joints: &mut Vec<Joint>,
    ) -> Option<(Vec2, Contribution)> {
        let mut rng = if scene.has_media { numbers.rng() } else { HashRng::default() };
        let (u_lens, u) = (numbers.next_2d(), numbers.next_1d());
        if y.depth > self.max_depth || !y.is_smooth_anywhere() {
            return None;
        }
        let seen = scene.camera.connect(y.p, u_lens, self.margin, u)?;
        let (f, back) = y.eval_light(scene, seen.w);
        let per_area = seen.per_area / scene.camera.pixels();
        let value = y.beta * f * (per_area * seen.places);
        if value.is_black() || !value.is_finite() {
            return None;
        }
        let cos = y.cos(seen.w);
        let origin = set_light_joints(joints, walk, start, y, per_area * cos, back * y.to_previous);
        joints.push(CAMERA);
        let weight = self.techniques.weight(joints, &origin, Technique::Connect(y.depth as usize + 1));
        let value = value * weight;
        if value.is_black() {
            return None;
        }
        let sample = target(seen.o - seen.w * seen.near, seen.w, seen.dist - seen.near);
        let value = value * y.visibility(scene, &sample, &mut rng);
        (!value.is_black()).then_some((seen.picture, Contribution { value, group: start.group }))
    }
}

/// A point to look at.
fn target(p: Vec3, wi: Vec3, dist: f32) -> LightSample {
    LightSample { wi, dist, p, n: -wi, uv: Vec2::ZERO, radiance: Spectrum::ONE, pdf: 1.0, delta: false }
}
