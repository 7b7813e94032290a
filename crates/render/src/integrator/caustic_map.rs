//! Light that starts by mirrors and refractors, from photons, for path tracing: caustics, and what they light in turn.
//!
//! As in `sppm` (Knaus and Zwicker 2011, doi:10.1145/1966394.1966404) each sample of all pixels sees photons of its own, through radii that
//! shrink from sample to sample and start at the distance of the nearest photons of a pilot. The blur vanishes with the samples;
//! the means of parts of the samples merge exactly.
//!
//! Which light is the map's own is a rule for both sides. A photon counts whose first scattering was by a delta lobe or on a surface
//! without a diffuse part, and that lands, however it came there, on a surface with a diffuse part from a direction that the BSDF there
//! samples with at most [`MAX_PDF`]. A path that once has left such a surface in such a direction leaves to the map all light that comes
//! to it by such a scattering: lights it runs into then and, on glossy surfaces, lights that are sampled. (With caustics alone in the map,
//! paths that run into bright caustics by chance would be most of the noise.)

use super::caustics::{Caustics, Place, Start};
use super::photon_settings::{PhotonSettings, Reach, median_distance};
use super::photon_walk::MAX_PDF;
use super::sppm::{NEIGHBORS, PHOTONS, PILOT, shrink, trace_pass, trees};
use super::{Estimate, Stage};
use crate::bsdf::{BsdfSample, Lobe};
use crate::light::{Light, LightContext, LightSampler, LightSelection};
use crate::material::Scatter;
use crate::math::Vec3;
use crate::photon::trace::Keep;
use crate::photon::tree::Neighbors;
use crate::photon::{Photon, PhotonTree, Query};
use crate::sampler::SampleStream;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// A caustic map that is made anew for each pass.
pub(super) struct CausticMap {
    settings: PhotonSettings,
    photons: u32,
    /// Caustics and all other light.
    pilot: [PhotonTree; 2],
    pass: [PhotonTree; 2],
    /// Factor of powers.
    scale: f32,
    /// Radius over the first one.
    shrink: f32,
    /// From `prepare` on.
    reach: Option<Reach>,
    least: f32,
    /// Whether photons leave the light of an index.
    has_photons: Vec<bool>,
    notes: Vec<String>,
}

/// What is known of a path.
#[derive(Clone, Copy)]
pub(super) struct Trail {
    /// Whether a surface has asked the map for light from the direction in which the path left it.
    asked: bool,
    /// Whether the last scattering was by a mirror or the like.
    guided: bool,
}

impl CausticMap {
    /// With settings; photons come with the passes.
    pub fn new(settings: PhotonSettings) -> Self {
        let (pilot, pass) = Default::default();
        let (scale, shrink, least) = (0.0, 1.0, 0.0);
        Self { settings, photons: 0, pilot, pass, scale, shrink, reach: None, least, has_photons: Vec::new(), notes: Vec::new() }
    }

    /// Whether the pilot found no such light: then the map has none.
    pub fn is_empty(&self) -> bool {
        self.pilot.iter().all(PhotonTree::is_empty)
    }

    /// Sentences about what was done.
    pub fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    /// Traces the pilot, which says where caustics are and how dense.
    ///
    /// # Errors
    /// A sentence about settings that do not fit.
    pub fn prepare(&mut self, scene: &Scene, stage: &Stage) -> Result<(), String> {
        if self.settings.map.is_some() {
            return Err("`pathmap` traces new photons for each pass: it cannot use a photon map".into());
        }
        let pixels = stage.size[0].saturating_mul(stage.size[1]);
        self.photons = self.settings.photons.unwrap_or(pixels.clamp(PHOTONS[0], PHOTONS[1]));
        let reach = self.settings.reach(scene);
        self.reach = Some(reach);
        self.least = 1e-6 * scene.sphere().radius;
        let by_power = LightSampler::new(&scene.lights, &scene.sphere(), LightSelection::Power);
        let ctx = LightContext { p: Vec3::ZERO, n: Vec3::ZERO };
        let is_endless = |l: &Light| matches!(l, Light::Area(a) if !a.area().is_finite());
        self.has_photons = scene.lights.iter().enumerate().map(|(i, l)| !is_endless(l) && by_power.pmf(&ctx, i as u32) > 0.0).collect();
        let (pilot, _, level) = self.trace(scene, PILOT, stage);
        self.pilot = pilot;
        self.pass = Default::default();
        if self.is_empty() {
            self.notes = vec!["pathmap: no caustics here; the same as path".into()];
            return Ok(());
        }
        let first = match (self.settings.radius, &self.pilot[0]) {
            (Some(radius), _) => format!("{radius}"),
            (None, tree) if tree.is_empty() => format!("{}", reach.near),
            (None, tree) => format!("about {:.2e}", median_distance(tree, self.neighbors(), reach.near, stage.seed)),
        };
        self.notes = vec![format!(
            "pathmap: biased is light that comes from the lights by mirrors and glass first; {} photons in each pass blur its caustics \
             over a radius of {first} at first, which shrinks with the samples as n^(-1/6); all other light is unbiased",
            self.photons
        )];
        if level > 0 {
            self.notes.push(format!("to fit into the memory one of {} records was kept", 1u64 << level));
        }
        Ok(())
    }

    /// Traces the photons of a pass.
    pub fn begin_pass(&mut self, scene: &Scene, pass: u32, stage: &Stage) {
        self.pass = Default::default();
        if !self.is_empty() {
            (self.pass, self.scale, _) = self.trace(scene, pass, stage);
            self.shrink = shrink(pass) as f32;
        }
    }

    fn neighbors(&self) -> usize {
        self.settings.neighbors.unwrap_or(NEIGHBORS) as usize
    }

    fn trace(&self, scene: &Scene, pass: u32, stage: &Stage) -> ([PhotonTree; 2], f32, u32) {
        let map = trace_pass(&self.settings, Keep::FOCUSED, self.photons, scene, pass, stage);
        let (scale, level) = (map.scale(), map.level());
        (trees(map.into_photons().0), scale, level)
    }
}

impl Caustics for CausticMap {
    type Trail = Trail;

    #[inline]
    fn start(&self, _: &SampleStream) -> Trail {
        Trail { asked: false, guided: false }
    }

    fn add(&self, _: &Scene, start: &Start, throughput: Spectrum, depths: [u32; 2], trail: &mut Trail, out: &mut Estimate) {
        let Place::Surface(s, scatter) = start.place else { return };
        if trail.asked || !scatter.has_diffuse() {
            return;
        }
        let query = Query { s, scatter, wo: start.wo, max_pdf: MAX_PDF };
        let reach = self.reach.map_or(0.0, |r| r.at(s.p));
        let mut found = Neighbors::new();
        for (pilot, tree) in self.pilot.iter().zip(&self.pass) {
            if tree.is_empty() {
                continue;
            }
            let first = match self.settings.radius {
                Some(radius) => radius,
                None => pilot.nearest(s.p, self.neighbors(), reach, |photon| query.lands(photon), &mut found).sqrt(),
            };
            let radius = (first * self.shrink).max(self.least);
            let accept = |photon: &Photon| self.settings.accepts(photon, depths[0]);
            query.radiance_within(tree, radius, None, self.scale, accept, |light, group| out.add(throughput * light, group));
        }
    }

    #[inline]
    fn scattered(&self, trail: &mut Trail, _: &Surface, scatter: &Scatter, sample: &BsdfSample) {
        trail.guided = sample.lobe.contains(Lobe::DELTA) || !scatter.has_diffuse();
        trail.asked |= !trail.guided && sample.pdf <= MAX_PDF;
    }

    #[inline]
    fn scattered_in_medium(&self, trail: &mut Trail, _: Vec3) {
        trail.guided = false;
    }

    #[inline]
    fn found(&self, _: &Scene, trail: &Trail, light: u32) -> bool {
        trail.asked && trail.guided && self.has_photons[light as usize]
    }

    #[inline]
    fn finds_direct(&self, trail: &Trail, scatter: &Scatter, light: u32) -> bool {
        trail.asked && self.has_photons[light as usize] && !scatter.has_diffuse()
    }
}
