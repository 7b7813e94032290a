//! The light of a z-buffer's picture: shadow maps, environment maps, and how a surface answers them.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::ambient::ambient;
use super::capture::{CAPTURE, capture};
use super::environment::{Correction, Cube, Environment, ReflectanceTable};
use super::lights::{LightGroup, Place, light_groups};
use super::shadow::{Casters, ShadowFilter, ShadowMap};
use super::triangles::Triangles;
use super::visible::is_there;
use super::{Pose, View};
use crate::bsdf::{Lobe, TransportMode};
use crate::integrator::Estimate;
use crate::light::{AreaGeometry, Light, LightContext, LightSample};
use crate::lightmap::SurfaceLight;
use crate::material::Part;
use crate::math::hash::hash_words;
use crate::math::{Aabb, INV_PI, ONE_MINUS_EPSILON, PI, Vec2, Vec3};
use crate::sampler::{SampleStream, Sampler, SamplerKind};
use crate::scene::{Scene, Surface};
use crate::shape::triangle;
use crate::spectrum::Spectrum;

/// Where environment maps come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum EnvironmentSource {
    /// None: mirrors are black.
    None,
    /// The scene's infinite lights alone.
    Sky,
    /// A map of its own for each reflecting object, drawn from its middle.
    #[default]
    Object,
}

/// Names that [`EnvironmentSource::from_name`] knows.
pub const ENVIRONMENT_SOURCES: [&str; 3] = ["none", "sky", "object"];

impl EnvironmentSource {
    /// By the name that the user types.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::None, Self::Sky, Self::Object].into_iter().zip(ENVIRONMENT_SOURCES).find(|(_, n)| *n == name).map(|(s, _)| s)
    }
}

/// How light is computed.
#[derive(Clone, Debug)]
pub struct LightingOptions {
    /// How shadow maps are compared.
    pub filter: ShadowFilter,
    /// Edge of a shadow map in texels.
    pub resolution: u32,
    /// Factor on all biases.
    pub bias: f32,
    /// Maps from a new random place of each light (and of the sky) with every sample, instead of one from its middle.
    pub sampled: bool,
    /// Where environment maps come from.
    pub environment: EnvironmentSource,
    /// How their reflections are corrected.
    pub correction: Correction,
}

impl Default for LightingOptions {
    fn default() -> Self {
        Self {
            filter: ShadowFilter::Pcss,
            resolution: 1024,
            bias: 1.0,
            sampled: false,
            environment: EnvironmentSource::Object,
            correction: Correction::Box,
        }
    }
}

/// Memory for shadow maps; resolutions are halved until they fit.
const MAX_BYTES: u64 = 1 << 29;
/// More lights than this are not all asked at every point: some are chosen.
const MAX_GROUPS: usize = 16;
/// Samples of an area light at a point.
const AREA_SAMPLES: u32 = 4;

/// A light at one random place, with the map from there.
struct PassLight {
    light: u32,
    /// Density of choosing the light and its place (by area, or by solid angle for infinite lights).
    pdf: f32,
    sample: LightSample,
    map: ShadowMap,
}

/// All light of a scene, ready for shading.
pub struct Lighting {
    options: LightingOptions,
    groups: Vec<LightGroup>,
    /// One for each group: where the memory did not suffice, none.
    maps: Vec<Option<ShadowMap>>,
    resolution: u32,
    group_of_light: BTreeMap<u32, usize>,
    /// In `sampled` mode, the places of the present pass.
    pass: Vec<PassLight>,
    sky: Option<Environment>,
    /// By placement and object.
    captured: BTreeMap<(u32, u32), Environment>,
    table: ReflectanceTable,
    /// Whether there are portals, whose light is seen alone.
    has_portals: bool,
    /// Light that has been solved beforehand and takes the place of all lights but mirrors'.
    solved: Option<Arc<dyn SurfaceLight>>,
}

impl Lighting {
    /// Draws shadow maps and environment maps. `seen` are points that the camera sees, nearest first.
    pub fn new(
        scene: &Scene,
        triangles: &Triangles,
        options: LightingOptions,
        solved: Option<Arc<dyn SurfaceLight>>,
        seen: &[Vec3],
        progress: &dyn Fn(&str, f64),
    ) -> Self {
        let mut groups = light_groups(scene);
        // The strongest first: they get maps while there is memory.
        groups.sort_by(|a, b| b.power.total_cmp(&a.power).then(a.lights.cmp(&b.lights)));
        let group_of_light = groups.iter().enumerate().flat_map(|(g, group)| group.lights.iter().map(move |l| (*l, g))).collect();
        let resolution = resolution(&groups, options.resolution);
        let mut all = Self {
            groups,
            maps: Vec::new(),
            resolution,
            group_of_light,
            pass: Vec::new(),
            sky: None,
            captured: BTreeMap::new(),
            table: ReflectanceTable::default(),
            has_portals: false,
            solved,
            options,
        };
        if all.solved.is_none() && !all.options.sampled {
            all.draw_maps(scene, triangles, seen, progress);
        }
        all.draw_sky(scene);
        if all.options.sampled {
            // Captured reflections are of the first pass's light.
            all.begin_pass(scene, triangles, seen, 0, 0);
        }
        if all.options.environment == EnvironmentSource::Object {
            all.captured = capture(&all, all.options.sampled, scene, triangles, progress);
        }
        all
    }

    fn draw_maps(&mut self, scene: &Scene, triangles: &Triangles, seen: &[Vec3], progress: &dyn Fn(&str, f64)) {
        let mut budget = MAX_BYTES;
        for (i, group) in self.groups.iter().enumerate() {
            progress("shadow maps", i as f64 / self.groups.len() as f64);
            let bytes = faces(&group.place) * u64::from(self.resolution).pow(2) * 4;
            let fits = bytes <= budget;
            budget = budget.saturating_sub(bytes);
            let map = || with_casters(scene, triangles, seen, self.resolution, i as u64, |casters| ShadowMap::new(group, casters));
            self.maps.push(fits.then(map));
        }
    }

    /// The surroundings that are infinitely far.
    fn draw_sky(&mut self, scene: &Scene) {
        self.has_portals = scene.lights.iter().any(|l| matches!(l, Light::Portal(_)));
        let is_sky = |l: &Light| matches!(l, Light::Constant(_) | Light::Environment(_));
        if self.options.environment == EnvironmentSource::None || !scene.lights.iter().any(is_sky) {
            return;
        }
        let escaped = |d: Vec3| scene.lights.iter().filter(|l| is_sky(l)).fold(Spectrum::ZERO, |sum, l| sum + l.escaped(Vec3::ZERO, d));
        // Four directions a texel: pictures may be finer than the cube.
        let cube = Cube::new(CAPTURE, |face, x, y, _| {
            let at = |dx: f32, dy: f32| escaped(direction(CAPTURE, face, x as f32 + dx, y as f32 + dy));
            (at(0.25, 0.25) + at(0.75, 0.25) + at(0.25, 0.75) + at(0.75, 0.75)) * 0.25
        });
        self.sky = Some(Environment::new(None, Aabb::EMPTY, cube.clone(), &cube));
    }

    /// Chooses new places on lights and draws their maps; only for `sampled` maps.
    pub fn begin_pass(&mut self, scene: &Scene, triangles: &Triangles, seen: &[Vec3], seed: u64, index: u32) {
        if !self.options.sampled || self.solved.is_some() {
            return;
        }
        // What comes through a portal differs from place to place: no map of one direction shows it.
        let has_map = |l: &&u32| !self.group_of_light.contains_key(l) && !matches!(scene.lights[**l as usize], Light::Portal(_));
        let sky = scene.infinite_lights.iter().filter(has_map);
        let all: Vec<Vec<u32>> = self.groups.iter().map(|g| g.lights.clone()).chain(sky.map(|l| vec![*l])).collect();
        let sampler = Sampler { kind: SamplerKind::Sobol, seed: hash_words([seed, 0x5eed]), spp: 1 };
        self.pass.clear();
        for (i, lights) in all.iter().enumerate() {
            let mut stream = sampler.stream(i as u32, 0, index);
            let (u_choice, u) = (stream.next_1d(), stream.next_2d());
            let (cell, chance) = match self.groups.get(i) {
                Some(g) => {
                    let (cell, chance, _) = g.choice.sample_discrete(u_choice);
                    (cell, chance)
                }
                None => (0, 1.0),
            };
            let light = lights[cell];
            let Some((sample, pdf, place)) = self.place(scene, light, u) else { continue };
            let object = self.groups.get(i).and_then(|g| g.object);
            let salt = hash_words([seed, u64::from(index), i as u64]);
            let map = with_casters(scene, triangles, seen, self.resolution, salt, |c| ShadowMap::of_sample(&place, object, c));
            self.pass.push(PassLight { light, pdf: pdf * chance, sample, map });
        }
    }

    /// A random place of a light, the density of it, and where to draw the map from.
    fn place(&self, scene: &Scene, light: u32, u: Vec2) -> Option<(LightSample, f32, Place)> {
        let ctx = LightContext { p: scene.bounds.center(), n: Vec3::ZERO };
        match &scene.lights[light as usize] {
            Light::Area(l) => {
                let s = match &l.geometry {
                    AreaGeometry::Triangle(v) => triangle::sample_area(v, u)?,
                    AreaGeometry::Shape(s) => s.sample_area(u)?,
                };
                let n = if l.flip_normals { -s.ng } else { s.ng };
                let sample = LightSample { wi: n, dist: 0.0, p: s.p, n, uv: s.uv, radiance: l.radiance, pdf: s.pdf, delta: false };
                Some((sample, s.pdf, Place::Point(s.p)))
            }
            Light::Point(_) | Light::Spot(_) | Light::Picture(_) => {
                let group = &self.groups[*self.group_of_light.get(&light)?];
                let sample = LightSample {
                    wi: Vec3::Z,
                    dist: 0.0,
                    p: ctx.p,
                    n: Vec3::Z,
                    uv: Vec2::ZERO,
                    radiance: Spectrum::ZERO,
                    pdf: 1.0,
                    delta: true,
                };
                Some((sample, 1.0, group.place.clone()))
            }
            infinite => {
                let s = infinite.sample(&ctx, u)?;
                Some((s, s.pdf, Place::Direction(s.wi, 0.0)))
            }
        }
    }

    /// Sentences about what was made.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let maps = self.maps.iter().flatten();
        let (count, bytes) = maps.fold((0, 0), |(n, b), m| (n + m.count(), b + m.bytes()));
        if count > 0 {
            notes.push(format!("raster: {count} shadow maps of {}², {} MiB", self.resolution, bytes >> 20));
        }
        if self.resolution < self.options.resolution {
            notes.push(format!("raster: shadow maps were made smaller than {}² to fit into memory", self.options.resolution));
        }
        let without = self.maps.iter().filter(|m| m.is_none()).count();
        if without > 0 {
            notes.push(format!("raster: {without} of {} lights cast no shadows: too many for the memory", self.groups.len()));
        }
        if !self.captured.is_empty() {
            notes.push(format!("raster: {} environment maps captured from the middles of reflecting objects", self.captured.len()));
        }
        if self.has_portals {
            notes.push("raster: light that comes through portals of the sky is missing: `path` has it".to_owned());
        }
        if self.sky.is_some() && !self.options.sampled {
            notes.push("raster: light from the sky is not shadowed (give --shadow-maps sampled)".to_owned());
        }
        notes
    }

    /// Adds the radiance that a surface sends along `wo`, without what it emits.
    pub fn shade(&self, scene: &Scene, s: &Surface, instance: u32, wo: Vec3, stream: &mut SampleStream, out: &mut Estimate) {
        let scatter = scene.materials[s.material as usize].shade(scene, s, wo);
        // Of surfaces that light may pass only those are drawn that it does not: they stand for the others.
        let passes = if scene.materials[s.material as usize].has_null { scatter.null_transmittance(wo).average() } else { 0.0 };
        if passes >= 1.0 {
            return;
        }
        let scale = 1.0 / (1.0 - passes.max(0.0));
        let environment = self.captured.get(&(instance, s.object)).or(self.sky.as_ref());
        let u = stream.next_2d().to_array();
        if let Some(solved) = &self.solved {
            out.add(scatter.albedo(wo) * solved.irradiance(scene, s) * (INV_PI * scale), 0);
        } else if scatter.is_smooth_anywhere() {
            let answer = |wi: Vec3| scatter.eval_pdf(wo, wi, TransportMode::Radiance).0 * scale;
            if self.options.sampled {
                self.add_pass(scene, s, u, &answer, out);
            } else {
                self.add_direct(scene, s, u, &answer, stream, out);
            }
        }
        for part in &scatter.parts {
            self.add_environment(scene, s, wo, part, environment, stream, scale, out);
        }
    }

    /// Light of all groups, or of some chosen ones where there are many.
    fn add_direct(
        &self,
        scene: &Scene,
        s: &Surface,
        u: [f32; 2],
        answer: &dyn Fn(Vec3) -> Spectrum,
        stream: &mut SampleStream,
        out: &mut Estimate,
    ) {
        let ctx = LightContext { p: s.p, n: s.frame.n };
        let mut add = |light: u32, chance: f32, visible: &mut Option<f32>, u_light: Vec2| {
            let Some(sample) = scene.lights[light as usize].sample(&ctx, u_light) else { return };
            let value = answer(sample.wi) * scene.light_radiance(light, &sample) * (1.0 / (sample.pdf * chance));
            if value.is_black() || !(sample.pdf * chance > 0.0) {
                return;
            }
            let map = self.group_of_light.get(&light).and_then(|g| self.maps[*g].as_ref());
            let visible = *visible.get_or_insert_with(|| match map {
                Some(map) => map.visibility(s.p, facing(s.ng, sample.wi), self.options.filter, self.options.bias, u),
                None => 1.0,
            });
            out.add(value * visible, scene.light_groups[light as usize]);
        };
        if self.groups.len() > MAX_GROUPS {
            for _ in 0..MAX_GROUPS {
                let Some((light, chance)) = scene.light_sampler.sample(&ctx, stream.next_1d()) else { continue };
                if self.group_of_light.contains_key(&light) {
                    add(light, chance * MAX_GROUPS as f32, &mut None, stream.next_2d());
                }
            }
            return;
        }
        for group in &self.groups {
            let count = if matches!(group.place, Place::Area(_) | Place::Direction(..)) { AREA_SAMPLES } else { 1 };
            // The map answers for the whole light.
            let mut visible = None;
            for _ in 0..count {
                let (cell, chance, _) = group.choice.sample_discrete(stream.next_1d());
                add(group.lights[cell], chance * count as f32, &mut visible, stream.next_2d());
            }
        }
    }

    /// Light of the places that the present pass has chosen.
    fn add_pass(&self, scene: &Scene, s: &Surface, u: [f32; 2], answer: &dyn Fn(Vec3) -> Spectrum, out: &mut Estimate) {
        let ctx = LightContext { p: s.p, n: s.frame.n };
        for pass in &self.pass {
            let light = &scene.lights[pass.light as usize];
            let (wi, value) = match light {
                Light::Area(_) => {
                    let to = pass.sample.p - s.p;
                    let dist2 = to.length_squared();
                    let wi = to / dist2.sqrt();
                    let sample = LightSample { wi, dist: dist2.sqrt(), ..pass.sample };
                    let Light::Area(area) = light else { continue };
                    let emits = !area.emitted(sample.n, -wi).is_black();
                    let radiance = if emits { scene.light_radiance(pass.light, &sample) } else { Spectrum::ZERO };
                    (wi, radiance * (sample.n.dot(wi).abs() / (dist2 * pass.pdf)))
                }
                Light::Point(_) | Light::Spot(_) | Light::Picture(_) => match light.sample(&ctx, Vec2::ZERO) {
                    Some(sample) => (sample.wi, sample.radiance * (1.0 / pass.pdf)),
                    None => continue,
                },
                _ => (pass.sample.wi, pass.sample.radiance * (1.0 / pass.pdf)),
            };
            let value = answer(wi) * value;
            if !value.is_black() && value.is_finite() {
                let filter = if self.options.filter == ShadowFilter::Hard { ShadowFilter::Hard } else { ShadowFilter::Pcf };
                let visible = pass.map.visibility(s.p, facing(s.ng, wi), filter, self.options.bias, u);
                out.add(value * visible, scene.light_groups[pass.light as usize]);
            }
        }
    }

    /// What a model makes of its surroundings: mirrors, blurred mirrors, and diffuse surfaces under the sky.
    #[expect(clippy::too_many_arguments, reason = "private; the loop's own")]
    fn add_environment(
        &self,
        scene: &Scene,
        s: &Surface,
        wo: Vec3,
        part: &Part,
        environment: Option<&Environment>,
        stream: &mut SampleStream,
        scale: f32,
        out: &mut Estimate,
    ) {
        if self.options.environment == EnvironmentSource::None {
            return;
        }
        let weight = part.weight * scale;
        let local = part.frame.local_from_world(wo);
        let correction = self.options.correction;
        let lobes = part.bsdf.lobes();
        if lobes.contains(Lobe::DELTA) {
            let mut seen = None;
            for u_lobe in [0.0, ONE_MINUS_EPSILON] {
                let Some(b) = part.bsdf.sample(local, u_lobe, Vec2::splat(0.5), TransportMode::Radiance) else { continue };
                if b.lobe.contains(Lobe::DELTA) && !b.lobe.contains(Lobe::NULL) && seen != Some(b.lobe) {
                    seen = Some(b.lobe);
                    let wi = part.frame.world_from_local(b.wi);
                    let radiance = match environment.filter(|e| !e.is_sky()) {
                        Some(e) => e.mirrored(s.p, wi, correction),
                        // Sharper than the map.
                        None => escaped(scene, s.p, wi),
                    };
                    out.add(b.value * radiance * weight, 0);
                }
            }
        }
        let Some(environment) = environment else { return };
        if lobes.0 & (Lobe::DIFFUSE.0 | Lobe::GLOSSY.0) == 0 {
            return;
        }
        let Some(a) = ambient(&part.bsdf, local, &self.table) else {
            self.add_sampled(s, local, part, environment, stream, weight, out);
            return;
        };
        let side = if local.z < 0.0 { -part.frame.n } else { part.frame.n };
        if let Some(sky) = self.sky.as_ref().filter(|_| !self.options.sampled && self.solved.is_none()) {
            let diffuse = a.diffuse * sky.irradiance(side) + a.through * sky.irradiance(-side);
            out.add(diffuse * (INV_PI * weight), 0);
        }
        // In `sampled` mode the sky is a light like others, and captured maps hold only what it lights.
        if !(a.specular.is_black() || environment.is_sky() && self.options.sampled) {
            let r = 2.0 * wo.dot(side) * side - wo;
            out.add(a.specular * environment.blurred(s.p, r, a.alpha, correction) * weight, 0);
        }
    }

    /// Models without a closed form: a few of their own directions, looked up at the size that each stands for.
    #[expect(clippy::too_many_arguments, reason = "private; the loop's own")]
    fn add_sampled(
        &self,
        s: &Surface,
        local: Vec3,
        part: &Part,
        environment: &Environment,
        stream: &mut SampleStream,
        weight: f32,
        out: &mut Estimate,
    ) {
        const COUNT: u32 = 4;
        if self.options.sampled && environment.is_sky() {
            return;
        }
        for _ in 0..COUNT {
            let (u_lobe, u) = (stream.next_1d(), stream.next_2d());
            let Some(b) = part.bsdf.sample(local, u_lobe, u, TransportMode::Radiance) else { continue };
            // Diffuse light is the sky's alone: that of surfaces, captured from another place, would be counted from all lights.
            let map = if b.lobe.contains(Lobe::DIFFUSE) { self.sky.as_ref().filter(|_| !self.options.sampled) } else { Some(environment) };
            if let Some(map) = map.filter(|_| !b.lobe.contains(Lobe::DELTA) && b.pdf > 0.0) {
                let alpha = 1.0 / (4.0 * PI * b.pdf * COUNT as f32).sqrt();
                let wi = part.frame.world_from_local(b.wi);
                let radiance = map.blurred(s.p, wi, alpha, self.options.correction);
                out.add(b.value * radiance * (weight / (b.pdf * COUNT as f32)), 0);
            }
        }
    }

    /// The captured maps, by placement and object.
    pub fn captured(&self) -> &BTreeMap<(u32, u32), Environment> {
        &self.captured
    }
}

/// A light map of a place on a sky cube.
fn direction(size: usize, face: usize, x: f32, y: f32) -> Vec3 {
    let p = Pose::cube_face(Vec3::ZERO, face);
    let scale = 2.0 / size as f32;
    (p.forward.as_vec3() + p.right.as_vec3() * (x * scale - 1.0) + p.up.as_vec3() * (1.0 - y * scale)).normalize()
}

/// Radiance from beyond the scene that comes to a point.
pub(super) fn escaped(scene: &Scene, o: Vec3, d: Vec3) -> Spectrum {
    scene.infinite_lights.iter().fold(Spectrum::ZERO, |sum, l| sum + scene.lights[*l as usize].escaped(o, d))
}

#[inline]
fn facing(n: Vec3, w: Vec3) -> Vec3 {
    if n.dot(w) < 0.0 { -n } else { n }
}

/// Texel pictures that a light takes.
fn faces(place: &Place) -> u64 {
    match place {
        Place::Spot(_, _, outer) if *outer < 1.22 => 1,
        Place::Direction(..) => 4,
        _ => 6,
    }
}

/// The resolution at which the maps of all lights fit into memory, not below 256 unless asked for.
fn resolution(groups: &[LightGroup], wanted: u32) -> u32 {
    let wanted = wanted.clamp(1, 1 << 14);
    let pictures: u64 = groups.iter().map(|g| faces(&g.place)).sum();
    let mut n = wanted;
    while n > 256 && pictures * u64::from(n).pow(2) * 4 > MAX_BYTES {
        n /= 2;
    }
    n
}

fn with_casters<T>(scene: &Scene, triangles: &Triangles, seen: &[Vec3], resolution: u32, salt: u64, f: impl FnOnce(&Casters) -> T) -> T {
    let keeps = |view: &View, id: u32, x: u32, y: u32| is_there(scene, triangles, view, salt, id, x, y);
    f(&Casters { triangles, sphere: scene.bounds.bounding_sphere(), seen, resolution, keeps: &keeps })
}
