//! A clear or tinted coat of varnish over another material.

use super::microfacet::Microfacet;
use super::rough_conductor::{facet_reflection, sample_facet_reflection};
use super::rough_transmittance::RoughTransmittance;
use super::{BsdfSample, Conductor, Diffuse, Lobe, Plastic, RoughConductor, RoughDiffuse, RoughPlastic, TransportMode, fresnel};
use crate::math::fns::{self, safe_sqrt};
use crate::math::{ONE_MINUS_EPSILON, Vec2, Vec3};
use crate::spectrum::Spectrum;

macro_rules! bases {
    ($($name:ident),* $(,)?) => {
        /// What lies below the coat: one of the models that only reflect.
        #[derive(Clone, Debug)]
        pub enum CoatedBase {
            $(#[doc = concat!("See [`", stringify!($name), "`].")] $name($name)),*
        }

        impl CoatedBase {
            #[inline]
            fn eval(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Spectrum {
                match self { $(Self::$name(b) => b.eval(wo, wi, mode)),* }
            }

            #[inline]
            fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
                match self { $(Self::$name(b) => b.pdf(wo, wi)),* }
            }

            #[inline]
            fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
                match self { $(Self::$name(b) => b.sample(wo, u_lobe, u, mode)),* }
            }

            #[inline]
            fn lobes(&self) -> Lobe {
                match self { $(Self::$name(b) => b.lobes()),* }
            }

            #[inline]
            fn albedo(&self, wo: Vec3) -> Spectrum {
                match self { $(Self::$name(b) => b.albedo(wo)),* }
            }
        }
    };
}

bases!(Diffuse, RoughDiffuse, Conductor, RoughConductor, Plastic, RoughPlastic);

/// The outer side of the coat.
#[derive(Clone, Debug)]
pub enum Coat {
    /// A perfect mirror.
    Smooth,
    /// Microfacets. They blur the reflection; what passes is refracted as by a smooth surface, with the facets'
    /// transmittance.
    Rough {
        /// Distribution of the facets' normals.
        microfacet: Microfacet,
        /// Transmittance for the same distribution and index.
        transmittance: RoughTransmittance,
    },
}

/// A dielectric layer over a reflecting base: light is refracted into the layer, weakened on its way through it, scattered by
/// the base and refracted out (Weidlich and Wilkie 2007, "Arbitrarily Layered Micro-facet Surfaces",
/// doi:10.1145/1321261.1321292, with the change of solid angle added). Light that the layer sends back to
/// the base is lost, so a coated white base is not white.
#[derive(Clone, Debug)]
pub struct Coated {
    /// What lies below the coat.
    pub base: CoatedBase,
    /// The outer side of the coat.
    pub coat: Coat,
    /// Refractive index of the coat over that outside.
    pub eta: f32,
    /// Absorption coefficient times thickness of the coat: optical thickness along the normal.
    pub absorption: Spectrum,
    /// A factor on the light that the coat reflects; 1 for a real material.
    pub specular_reflectance: Spectrum,
}

impl Coated {
    /// The share of light that enters at the given cosine.
    #[inline]
    fn transmittance(&self, cos: f32) -> f32 {
        match &self.coat {
            Coat::Smooth => 1.0 - fresnel::dielectric(cos, self.eta).0,
            Coat::Rough { transmittance, .. } => transmittance.eval(cos),
        }
    }

    /// The direction inside the coat that belongs to one outside; `None` at total reflection.
    #[inline]
    fn refract_in(&self, w: Vec3) -> Option<Vec3> {
        let (x, y) = (w.x / self.eta, w.y / self.eta);
        let z = safe_sqrt(1.0 - x * x - y * y);
        (z > 0.0).then_some(Vec3::new(x, y, z))
    }

    /// The direction outside that belongs to one inside the coat; `None` at total reflection.
    #[inline]
    fn refract_out(&self, w: Vec3) -> Option<Vec3> {
        let (x, y) = (w.x * self.eta, w.y * self.eta);
        let z = safe_sqrt(1.0 - x * x - y * y);
        (z > 0.0).then_some(Vec3::new(x, y, z))
    }

    /// The share of light that the coat lets through on the way in and out, given the cosines outside and inside.
    #[inline]
    fn passage(&self, wo: Vec3, wi: Vec3, wo_in: Vec3, wi_in: Vec3) -> Spectrum {
        let t = self.transmittance(wo.z) * self.transmittance(wi.z);
        if self.absorption.is_black() {
            return Spectrum::splat(t);
        }
        let path = 1.0 / wo_in.z + 1.0 / wi_in.z;
        self.absorption.map(|a| fns::exp(-a * path)) * t
    }

    /// Solid angle inside the coat per solid angle outside (Snell's law, differentiated).
    #[inline]
    fn compression(&self, w: Vec3, w_in: Vec3) -> f32 {
        w.z / (self.eta * self.eta * w_in.z)
    }

    // How likely the coat's reflection is sampled. The base counts as bright as what the coat lets through of it.
    #[inline]
    fn specular_probability(&self, wo: Vec3) -> f32 {
        let t = self.transmittance(wo.z);
        let through = if self.absorption.is_black() { 1.0 } else { fns::exp(-2.0 * self.absorption.average()) };
        let (s, b) = ((1.0 - t) * self.specular_reflectance.average(), t * through);
        if s + b > 0.0 { s / (s + b) } else { 0.0 }
    }

    /// See the contract in [`crate::bsdf`].
    pub fn eval(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Spectrum {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Spectrum::ZERO;
        }
        let mut value = Spectrum::ZERO;
        if let Coat::Rough { microfacet, .. } = &self.coat
            && let Some((m, pdf)) = facet_reflection(microfacet, wo, wi)
        {
            let r = fresnel::dielectric(wo.dot(m), self.eta).0;
            value = self.specular_reflectance * (r * pdf * microfacet.g1(wi, m));
        }
        if let (Some(wo_in), Some(wi_in)) = (self.refract_in(wo), self.refract_in(wi)) {
            // The base's value holds the cosine inside: both it and the solid angle change to those outside.
            value += self.base.eval(wo_in, wi_in, mode) * self.passage(wo, wi, wo_in, wi_in) * self.compression(wi, wi_in);
        }
        value
    }

    /// See the contract in [`crate::bsdf`].
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return 0.0;
        }
        let p = self.specular_probability(wo);
        let mut pdf = 0.0;
        if let Coat::Rough { microfacet, .. } = &self.coat {
            pdf = facet_reflection(microfacet, wo, wi).map_or(0.0, |(_, pdf)| p * pdf);
        }
        if let (Some(wo_in), Some(wi_in)) = (self.refract_in(wo), self.refract_in(wi)) {
            pdf += (1.0 - p) * self.base.pdf(wo_in, wi_in) * self.compression(wi, wi_in);
        }
        pdf
    }

    /// See the contract in [`crate::bsdf`].
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let p = self.specular_probability(wo);
        let (wi, lobe) = if u_lobe < p {
            match &self.coat {
                Coat::Smooth => {
                    let value = self.specular_reflectance * (1.0 - self.transmittance(wo.z));
                    let lobe = Lobe::DELTA.union(Lobe::REFLECTION);
                    return Some(BsdfSample { wi: fresnel::reflect_z(wo), value, pdf: p, lobe, eta: 1.0 });
                }
                Coat::Rough { microfacet, .. } => (sample_facet_reflection(microfacet, wo, u)?.0, Lobe::GLOSSY.union(Lobe::REFLECTION)),
            }
        } else {
            let wo_in = self.refract_in(wo)?;
            let u_lobe = ((u_lobe - p) / (1.0 - p)).clamp(0.0, ONE_MINUS_EPSILON);
            let base = self.base.sample(wo_in, u_lobe, u, mode)?;
            let wi = self.refract_out(base.wi)?;
            if base.lobe.contains(Lobe::DELTA) {
                let value = base.value * self.passage(wo, wi, wo_in, base.wi);
                return Some(BsdfSample { wi, value, pdf: (1.0 - p) * base.pdf, ..base });
            }
            (wi, base.lobe)
        };
        let pdf = self.pdf(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi, value: self.eval(wo, wi, mode), pdf, lobe, eta: 1.0 })
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn lobes(&self) -> Lobe {
        self.base.lobes().union(Lobe::REFLECTION).union(match self.coat {
            Coat::Smooth => Lobe::DELTA,
            Coat::Rough { .. } => Lobe::GLOSSY,
        })
    }

    /// See the contract in [`crate::bsdf`].
    pub fn albedo(&self, wo: Vec3) -> Spectrum {
        let t = self.transmittance(wo.z);
        let base = self.refract_in(wo).map_or(Spectrum::ZERO, |wo_in| {
            self.base.albedo(wo_in) * self.absorption.map(|a| fns::exp(-a * (1.0 + 1.0 / wo_in.z))) * (t * t)
        });
        (self.specular_reflectance * (1.0 - t) + base).clamp(0.0, 1.0)
    }
}
