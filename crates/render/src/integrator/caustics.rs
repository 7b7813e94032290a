//! What finds caustics for the path tracer: light that mirrors and refractors bring to a rough surface or a medium.
//!
//! Such light must not count twice. So each way to find it says which paths are its own by what it knows of a path alone, its
//! *trail* since the last rough surface, and the path tracer leaves out the light that it meets there.

use super::Estimate;
use crate::bsdf::{BsdfSample, TransportMode};
use crate::material::Scatter;
use crate::math::Vec3;
use crate::medium::{MediumStack, Phase};
use crate::sampler::SampleStream;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Where light is scattered.
#[derive(Clone, Copy)]
pub(super) enum Place<'a> {
    /// On a surface.
    Surface(&'a Surface, &'a Scatter),
    /// At a point of a medium.
    Medium(Vec3, &'a Phase),
}

/// Where caustics are looked for.
#[derive(Clone, Copy)]
pub(super) struct Start<'a> {
    /// The point.
    pub place: Place<'a>,
    /// Unit direction to the viewer.
    pub wo: Vec3,
    /// The media on the side of `wo`.
    pub media: &'a MediumStack,
}

impl Start<'_> {
    /// The media along `w`.
    pub fn media(&self, scene: &Scene, w: Vec3) -> MediumStack {
        let mut media = *self.media;
        if let Place::Surface(s, _) = self.place
            && scene.has_media
            && w.dot(s.ng) * self.wo.dot(s.ng) < 0.0
        {
            media.cross(scene, s, w);
        }
        media
    }

    /// f·|cos| for light that comes along `w`, or the phase function.
    pub fn eval(&self, w: Vec3) -> Spectrum {
        match self.place {
            Place::Surface(_, scatter) => scatter.eval_pdf(self.wo, w, TransportMode::Radiance).0,
            Place::Medium(_, phase) => Spectrum::splat(phase.eval(self.wo, w)),
        }
    }
}

/// A way to find caustics.
pub(super) trait Caustics: Sync {
    /// What it has to know of a path.
    type Trail: Clone;
    /// Whether it finds any: `false` lets the compiler leave all of this out.
    const ON: bool = true;

    /// The trail of a new path of a sample.
    fn start(&self, stream: &SampleStream) -> Self::Trail;

    /// Adds the light that it finds at a place, which sends `throughput` to the camera. `depths`: scatterings before this one, and the
    /// most that a path may have.
    fn add(&self, scene: &Scene, start: &Start, throughput: Spectrum, depths: [u32; 2], trail: &mut Self::Trail, out: &mut Estimate);

    /// The path has been scattered at a surface, not straight on.
    fn scattered(&self, trail: &mut Self::Trail, s: &Surface, scatter: &Scatter, sample: &BsdfSample);

    /// The path has been scattered at a point of a medium.
    fn scattered_in_medium(&self, trail: &mut Self::Trail, p: Vec3);

    /// Whether light of a light that the path has just met is what [`Self::add`] has found.
    fn found(&self, scene: &Scene, trail: &Self::Trail, light: u32) -> bool;

    /// Whether light that comes straight from a light to where the path is, and is scattered there, is what [`Self::add`] has found.
    fn finds_direct(&self, trail: &Self::Trail, scatter: &Scatter, light: u32) -> bool;
}

/// Nothing but paths.
impl Caustics for () {
    type Trail = ();
    const ON: bool = false;

    #[inline(always)]
    fn start(&self, _: &SampleStream) {}

    #[inline(always)]
    fn add(&self, _: &Scene, _: &Start, _: Spectrum, _: [u32; 2], (): &mut (), _: &mut Estimate) {}

    #[inline(always)]
    fn scattered(&self, (): &mut (), _: &Surface, _: &Scatter, _: &BsdfSample) {}

    #[inline(always)]
    fn scattered_in_medium(&self, (): &mut (), _: Vec3) {}

    #[inline(always)]
    fn found(&self, _: &Scene, (): &(), _: u32) -> bool {
        false
    }

    #[inline(always)]
    fn finds_direct(&self, (): &(), _: &Scatter, _: u32) -> bool {
        false
    }
}
