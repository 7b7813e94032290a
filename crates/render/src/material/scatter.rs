//! [`Scatter`]: how light scatters at one surface point, in world space.

use arrayvec::ArrayVec;

use crate::bsdf::{Bsdf, BsdfSample, Diffuse, Lobe, TransportMode};
use crate::math::{Frame, ONE_MINUS_EPSILON, Vec2, Vec3};
use crate::spectrum::Spectrum;

/// The most models that one point may blend; further ones are dropped, which the compiler reports.
pub const MAX_PARTS: usize = 8;

/// A weighted model in its own frame.
#[derive(Clone, Debug)]
pub struct Part {
    /// Share of the blend, > 0; the shares of a point sum to 1.
    pub weight: f32,
    /// Shading frame; `n` is on the side of `wo` for the back of two-sided models.
    pub frame: Frame,
    /// The geometric normal on the frame's side, where a bump or normal map has tilted the frame: light must not change sides.
    pub face_normal: Option<Vec3>,
    /// The model.
    pub bsdf: Bsdf,
}

impl Part {
    /// Whether a direction is on the same side of the tilted frame and of the surface.
    #[inline]
    fn consistent(&self, w: Vec3) -> bool {
        self.face_normal.is_none_or(|n| n.dot(w) * self.frame.n.dot(w) > 0.0)
    }

    /// What particles are scaled by besides f·|cos θi| where the shading normal is not the geometric one (Veach 1997, eq. 5.19):
    /// they come along `wo` from the light, and f·|cos| is that of the shading normal. 0 where it is not defined.
    #[inline]
    fn adjoint_factor(&self, ng: Vec3, wo: Vec3, wi: Vec3) -> f32 {
        let n = self.frame.n;
        let factor = (wo.dot(n) * wi.dot(ng)).abs() / (wo.dot(ng) * wi.dot(n)).abs();
        if factor.is_finite() { factor } else { 0.0 }
    }
}

/// All that scatters at a point. Directions are in world space, unit, and point away from the surface.
#[derive(Clone, Debug, Default)]
pub struct Scatter {
    /// The models.
    pub parts: ArrayVec<Part, MAX_PARTS>,
}

impl Scatter {
    /// f·|cos θi| and the density of `wi` per solid angle; delta lobes are left out of both.
    #[inline]
    pub fn eval_pdf(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> (Spectrum, f32) {
        if let Some((part, diffuse)) = self.only_diffuse() {
            let (o, i) = (part.frame.local_from_world(wo), part.frame.local_from_world(wi));
            return (diffuse.eval(o, i, mode), diffuse.pdf(o, i));
        }
        let (mut value, mut pdf) = (Spectrum::ZERO, 0.0);
        for part in &self.parts {
            let (o, i) = (part.frame.local_from_world(wo), part.frame.local_from_world(wi));
            if part.consistent(wi) {
                value += part.bsdf.eval(o, i, mode) * part.weight;
            }
            pdf += part.bsdf.pdf(o, i) * part.weight;
        }
        (value, pdf)
    }

    /// As [`Scatter::eval_pdf`] for a particle that has come from the light at `wo` and leaves along `wi`, corrected for shading
    /// normals; `ng` is the geometric normal, either side's.
    #[inline]
    pub fn eval_pdf_particle(&self, ng: Vec3, wo: Vec3, wi: Vec3) -> (Spectrum, f32) {
        let (mut value, mut pdf) = (Spectrum::ZERO, 0.0);
        for part in &self.parts {
            let (o, i) = (part.frame.local_from_world(wo), part.frame.local_from_world(wi));
            if part.consistent(wi) {
                value += part.bsdf.eval(o, i, TransportMode::Importance) * (part.weight * part.adjoint_factor(ng, wo, wi));
            }
            pdf += part.bsdf.pdf(o, i) * part.weight;
        }
        (value, pdf)
    }

    /// Samples the direction in which a particle leaves that has come from the light at `wo`; see [`Scatter::eval_pdf_particle`].
    #[inline]
    pub fn sample_particle(&self, ng: Vec3, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let (mut sample, part) = self.sample_part(wo, u_lobe, u, TransportMode::Importance)?;
        if sample.lobe.contains(Lobe::DELTA) || self.parts.len() == 1 {
            sample.value *= part.adjoint_factor(ng, wo, sample.wi);
        } else {
            (sample.value, sample.pdf) = self.eval_pdf_particle(ng, wo, sample.wi);
        }
        (sample.pdf > 0.0).then_some(sample)
    }

    /// Samples a direction; `wi` of the result is in world space.
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
        if let Some((part, diffuse)) = self.only_diffuse() {
            let sample = diffuse.sample(part.frame.local_from_world(wo), u_lobe, u, mode)?;
            return Some(BsdfSample { wi: part.frame.world_from_local(sample.wi), ..sample });
        }
        let (mut sample, _) = self.sample_part(wo, u_lobe, u, mode)?;
        if self.parts.len() > 1 && !sample.lobe.contains(Lobe::DELTA) {
            (sample.value, sample.pdf) = self.eval_pdf(wo, sample.wi, mode);
        }
        (sample.pdf > 0.0).then_some(sample)
    }

    /// Samples one part: value and density of delta lobes are those of the whole, of others they are the part's own.
    #[inline]
    fn sample_part(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<(BsdfSample, &Part)> {
        // Choose a part by its share and stretch the number for use within the part.
        let (mut chosen, mut rest) = (0, u_lobe);
        while chosen + 1 < self.parts.len() && rest >= self.parts[chosen].weight {
            rest -= self.parts[chosen].weight;
            chosen += 1;
        }
        let part = self.parts.get(chosen)?;
        let u_lobe = (rest / part.weight).clamp(0.0, ONE_MINUS_EPSILON);
        let mut sample = part.bsdf.sample(part.frame.local_from_world(wo), u_lobe, u, mode)?;
        sample.wi = part.frame.world_from_local(sample.wi);
        if !part.consistent(sample.wi) {
            return None;
        }
        if sample.lobe.contains(Lobe::DELTA) {
            sample.value *= part.weight;
            sample.pdf *= part.weight;
        }
        Some((sample, part))
    }

    /// The one part, where it is Lambert's and its frame is not tilted: the usual case, which is compiled into the loops that ask.
    #[inline(always)]
    fn only_diffuse(&self) -> Option<(&Part, &Diffuse)> {
        match &self.parts[..] {
            [part @ Part { weight: 1.0, bsdf: Bsdf::Diffuse(diffuse), face_normal: None, .. }] => Some((part, diffuse)),
            _ => None,
        }
    }

    /// Whether the number that chooses a lobe changes what [`Scatter::sample`] returns.
    #[inline]
    pub fn needs_lobe(&self) -> bool {
        self.only_diffuse().is_none()
    }

    /// True where some lobe is not a Dirac delta, so that light sampling can work.
    #[inline]
    pub fn is_smooth_anywhere(&self) -> bool {
        self.only_diffuse().is_some() || self.parts.iter().any(|p| p.bsdf.lobes().0 & (Lobe::DIFFUSE.0 | Lobe::GLOSSY.0) != 0)
    }

    /// True where some model has a diffuse part. Others only guide light: mirrors, refractors and their frosted kinds.
    #[inline]
    pub fn has_diffuse(&self) -> bool {
        self.parts.iter().any(|p| p.bsdf.lobes().contains(Lobe::DIFFUSE))
    }

    /// True where some model lets light straight through.
    pub fn has_null(&self) -> bool {
        self.parts.iter().any(|p| p.bsdf.lobes().contains(Lobe::NULL))
    }

    /// The share of light that passes straight through from `wo`.
    pub fn null_transmittance(&self, wo: Vec3) -> Spectrum {
        let mut t = Spectrum::ZERO;
        for part in &self.parts {
            if !part.bsdf.lobes().contains(Lobe::NULL) {
                continue;
            }
            // Models that reflect as well keep their straight transmission at the upper end of the lobe numbers.
            let sample = part.bsdf.sample(part.frame.local_from_world(wo), ONE_MINUS_EPSILON, Vec2::splat(0.5), TransportMode::Radiance);
            if let Some(sample) = sample.filter(|s| s.lobe.contains(Lobe::NULL)) {
                t += sample.value * part.weight;
            }
        }
        t
    }

    /// An estimate of the share of light that is scattered, for the albedo AOV.
    pub fn albedo(&self, wo: Vec3) -> Spectrum {
        self.parts.iter().fold(Spectrum::ZERO, |sum, p| sum + p.bsdf.albedo(p.frame.local_from_world(wo)) * p.weight)
    }
}
