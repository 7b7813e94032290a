//! The z-buffer renderer as an integrator: each sample index is a picture of its own.
//!
//! Before the samples of an index the scene is drawn once, moved by that index's place in the pixel and seen through its point of
//! the lens (Haeberli and Akeley 1990, "The Accumulation Buffer", doi:10.1145/97880.97913); then each pixel shades what it found
//! there, with shadow maps and environment maps. Light comes from lights and environments only, never from other surfaces, but for
//! what mirrors show. See [`crate::raster`] and docs/theory/shadow-maps.md.

use std::sync::Arc;

use etendue_scene::RenderSettings;

use super::path::first_hit;
use super::{Estimate, Integrator, Stage};
use crate::camera::CameraRay;
use crate::lightmap::SurfaceLight;
use crate::math::Vec3;
use crate::math::hash::hash_words;
use crate::raster::{
    Correction, ENVIRONMENT_SOURCES, EnvironmentSource, Lighting, LightingOptions, SHADOW_FILTERS, ShadowFilter, Triangles, Visible,
    surface_at,
};
use crate::sampler::SampleStream;
use crate::scene::Scene;

/// The z-buffer renderer.
#[derive(Default)]
pub struct Raster {
    options: LightingOptions,
    solved: Option<Arc<dyn SurfaceLight>>,
    triangles: Triangles,
    lighting: Option<Lighting>,
    visible: Option<Visible>,
    /// What the camera sees, for cascades.
    seen: Vec<Vec3>,
}

/// The settings' choice of maps.
///
/// # Errors
/// A sentence for names that are not known.
pub(super) fn options(settings: &RenderSettings) -> Result<LightingOptions, String> {
    fn choice<T>(name: Option<&str>, what: &str, names: &[&str], default: T, find: impl Fn(&str) -> Option<T>) -> Result<T, String> {
        match name {
            None => Ok(default),
            Some(name) => find(name).ok_or_else(|| format!("no {what} `{name}`; there are {}", names.join(", "))),
        }
    }
    let d = LightingOptions::default();
    let resolution = settings.shadow_resolution.unwrap_or(d.resolution);
    if resolution == 0 || resolution > 1 << 14 {
        return Err(format!("a shadow map has 1 to {} texels a side, not {resolution}", 1 << 14));
    }
    let bias = settings.shadow_bias.unwrap_or(d.bias);
    if !(bias >= 0.0 && bias.is_finite()) {
        return Err(format!("the shadow bias is a factor of 0 or more, not {bias}"));
    }
    let maps = ["center", "sampled"];
    let corrections = ["none", "box"];
    Ok(LightingOptions {
        filter: choice(settings.shadow_filter.as_deref(), "shadow filter", &SHADOW_FILTERS, d.filter, ShadowFilter::from_name)?,
        resolution,
        bias,
        sampled: choice(settings.shadow_maps.as_deref(), "kind of shadow maps", &maps, d.sampled, |n| {
            maps.iter().position(|m| *m == n).map(|i| i == 1)
        })?,
        environment: choice(
            settings.envmap.as_deref(),
            "environment map",
            &ENVIRONMENT_SOURCES,
            d.environment,
            EnvironmentSource::from_name,
        )?,
        correction: choice(settings.envmap_correction.as_deref(), "correction", &corrections, d.correction, |n| match n {
            "none" => Some(Correction::None),
            "box" => Some(Correction::Box),
            _ => None,
        })?,
    })
}

/// Points that cascades are fitted to.
const SEEN: usize = 1 << 16;

impl Raster {
    /// A renderer with its settings.
    pub fn new(options: LightingOptions) -> Self {
        Self { options, ..Self::default() }
    }

    /// Shows light that has been solved beforehand (radiosity, a baked map) instead of computing it: lights and their shadows are not
    /// asked; mirrors still show their environment maps.
    #[must_use]
    pub fn with_surface_light(mut self, solved: Arc<dyn SurfaceLight>) -> Self {
        self.solved = Some(solved);
        self
    }
}

impl Integrator for Raster {
    fn prepare(&mut self, scene: &Scene, stage: &Stage) -> Result<(), String> {
        scene.needs_triangles("raster")?;
        self.triangles = Triangles::from_scene(scene)?;
        let first = (stage.camera_sample)(0);
        let all =
            Visible::new(scene, &self.triangles, stage.size, first.offset, first.u_lens, stage.seed).points(scene, scene.camera.position());
        let step = all.len().div_ceil(SEEN).max(1);
        self.seen = all.into_iter().step_by(step).collect();
        let options = self.options.clone();
        let progress = |what: &str, fraction: f64| (stage.progress)(what, fraction);
        self.lighting = Some(Lighting::new(scene, &self.triangles, options, self.solved.clone(), &self.seen, &progress));
        Ok(())
    }

    fn pass_limit(&self) -> u32 {
        1
    }

    fn begin_pass(&mut self, scene: &Scene, first: u32, _end: u32, stage: &Stage) -> Result<(), String> {
        let sample = (stage.camera_sample)(first);
        let salt = hash_words([stage.seed, u64::from(first)]);
        self.visible = Some(Visible::new(scene, &self.triangles, stage.size, sample.offset, sample.u_lens, salt));
        if let Some(lighting) = &mut self.lighting {
            lighting.begin_pass(scene, &self.triangles, &self.seen, stage.seed, first);
        }
        Ok(())
    }

    fn shares_camera_samples(&self) -> bool {
        true
    }

    fn notes(&self) -> Vec<String> {
        self.lighting.as_ref().map_or_else(Vec::new, Lighting::notes)
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let (Some(visible), Some(lighting)) = (&self.visible, &self.lighting) else { return };
        let ray = &camera_ray.ray;
        let found = visible.item(camera_ray.picture, ray.d).and_then(|id| {
            let s = surface_at(scene, &self.triangles, id, ray.o.as_dvec3(), ray.d.as_dvec3())?;
            Some((s, self.triangles.locate(id)?.instance))
        });
        let Some((mut s, instance)) = found else {
            if !scene.hide_lights {
                for &light in &scene.infinite_lights {
                    let radiance = scene.lights[light as usize].escaped(ray.o, ray.d);
                    out.add(radiance * camera_ray.weight, scene.light_groups[light as usize]);
                }
            }
            return;
        };
        let wo = -ray.d;
        if scene.mipmap {
            s.footprint = camera_ray.spread_rad * s.t / s.ng.dot(wo).abs().max(0.05).sqrt();
        }
        if let Some(emission) = &s.object(scene).emission
            && !scene.hide_lights
        {
            out.add(scene.emitted(&s, wo), emission.group);
        }
        let scatter = scene.materials[s.material as usize].shade(scene, &s, wo);
        first_hit(scene, &s, wo, &scatter, s.t, out);
        lighting.shade(scene, &s, instance, wo, stream, out);
    }
}
