//! Light sources: sampling towards them, their densities, and how much they give.
//!
//! The contract, for every light:
//!
//! - A light is self-contained (an area light has its own vertices), so that sampling needs no scene. It knows nothing of
//!   visibility: the integrator traces from `ctx.p` towards `wi` up to `dist`.
//! - `sample` returns a direction with the radiance that arrives from it if nothing is in between, and the density of the
//!   direction per solid angle at `ctx.p`. For delta lights (`delta`) `pdf` is 1 and `radiance` is what it has to be
//!   multiplied with f·|cos| by: intensity / d² or irradiance. So `f · radiance / pdf` is the estimate in every case.
//!   `None` where no light arrives from the sampled place.
//! - `ctx.n` is a hint for better samples: the normal (either side) of the receiving surface, or zero where there is none.
//!   `sample` and the pdf functions must be given the same context.
//! - A ray that hits a surface that emits gets [`AreaLight::emitted`], with density [`Light::pdf_hit`]; one that leaves the scene
//!   gets the sum of [`Light::escaped`] over the lights, with density [`Light::pdf_escaped`]. Delta lights are never hit.
//! - Textured emission: the light holds its average, which `sample` returns; where `textured` is set the integrator
//!   evaluates the texture at the sample's `uv` instead.
//! - Units: radiance W·m⁻²·sr⁻¹, intensity W·sr⁻¹, irradiance W·m⁻², in linear Rec. 709 lanes.

pub mod area;
mod bounds;
mod bvh;
pub mod constant;
pub mod directional;
pub mod environment;
pub mod equal_area;
pub mod picture;
pub mod point;
pub mod portal;
pub mod sampler;
pub mod spot;
mod sun_table;
pub mod sunsky;
pub mod visibility;

pub use area::{AreaGeometry, AreaLight};
pub use bounds::LightBounds;
pub(crate) use bounds::strength;
pub use constant::ConstantLight;
pub use directional::{DirectionalLight, SunLight};
pub use environment::{EnvironmentLight, Rows};
pub use picture::PictureLight;
pub use point::PointLight;
pub use portal::PortalLight;
pub use sampler::{LightSampler, LightSelection};
pub use spot::SpotLight;
pub use visibility::EnvironmentVisibility;
pub(crate) use visibility::{SeenPart, Sight};

use crate::math::{ONE_MINUS_EPSILON, PI, TAU, Vec2, Vec3, fns, warp};
use crate::spectrum::Spectrum;

/// Where light is to arrive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightContext {
    /// The point.
    pub p: Vec3,
    /// Unit normal of the surface there, either side; zero where there is no surface.
    pub n: Vec3,
}

/// A sampled direction to a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSample {
    /// Unit direction from the context's point to the light.
    pub wi: Vec3,
    /// Distance to the sampled point; infinite for infinite lights.
    pub dist: f32,
    /// The sampled point; the context's own for infinite lights.
    pub p: Vec3,
    /// Unit normal of the light at the point; −`wi` where it has none.
    pub n: Vec3,
    /// Surface parameters, barycentric coordinates or picture coordinates, for textured lights.
    pub uv: Vec2,
    /// Radiance that arrives, intensity / d² or irradiance for delta lights.
    pub radiance: Spectrum,
    /// Density per solid angle at the context's point; 1 for delta lights.
    pub pdf: f32,
    /// Whether no other sampling can find this direction.
    pub delta: bool,
}

/// A sampled ray that leaves a light, for methods that trace from the lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmissionSample {
    /// Start of the ray; for infinite lights outside of the scene, or in the window that their light comes through.
    pub o: Vec3,
    /// Unit direction.
    pub d: Vec3,
    /// Unit normal of the light at the start; `d` where it has none.
    pub n: Vec3,
    /// Surface or picture coordinates, for textured lights.
    pub uv: Vec2,
    /// Radiance along the ray (intensity where the position is a delta, irradiance where the direction is).
    pub radiance: Spectrum,
    /// Density of the start by area (for infinite lights, across the ray); 1 where it is a delta.
    pub pdf_position: f32,
    /// Density of the direction per solid angle; 1 where it is a delta.
    pub pdf_direction: f32,
    /// |cos| between ray and light: particle power is `radiance · cos / (pdf_position · pdf_direction)`.
    pub cos: f32,
}

/// The sphere that holds the scene, which decides what infinite lights give.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneSphere {
    /// Center.
    pub center: Vec3,
    /// Radius.
    pub radius: f32,
    /// Whether surfaces reach beyond it without end.
    pub endless: bool,
}

/// Shares of the rays of infinite lights in scenes without end: across the sphere itself, and about it in two widths, in radii.
const ENDLESS_SHARES: [f32; 2] = [0.5, 0.25];
const ENDLESS_WIDTHS: [f32; 2] = [1.0, 16.0];

impl SceneSphere {
    /// Where rays that come from infinitely far pass the sphere's middle, in a plane across them.
    ///
    /// Scenes that end are covered evenly. What lies without end gets half of the rays, of the density w / (2π (w² + r²)^(3/2)): as a picture of
    /// a plane that is taken from the height w above it has its pixels, so that rays neither pile up at the horizon of
    /// pictures nor get rare there.
    pub fn sample_across(&self, u: Vec2) -> Vec2 {
        let [middle, near] = ENDLESS_SHARES;
        if !self.endless {
            return warp::disk_concentric(u) * self.radius;
        }
        if u.x < middle {
            return warp::disk_concentric(Vec2::new(u.x / middle, u.y)) * self.radius;
        }
        let u_x = u.x - middle;
        let (width, u_x) =
            if u_x < near { (ENDLESS_WIDTHS[0], u_x / near) } else { (ENDLESS_WIDTHS[1], (u_x - near) / (1.0 - middle - near)) };
        let secant = 1.0 / (1.0 - u_x.min(ONE_MINUS_EPSILON));
        let (sin_phi, cos_phi) = fns::sin_cos(TAU * u.y);
        Vec2::new(cos_phi, sin_phi) * (width * self.radius * (secant * secant - 1.0).max(0.0).sqrt())
    }

    /// The density of [`Self::sample_across`] by area, from the squared distance to the middle.
    #[inline]
    pub fn pdf_across(&self, distance_2: f32) -> f32 {
        let even = 1.0 / (PI * self.radius * self.radius);
        if !self.endless {
            return even;
        }
        let [middle, near] = ENDLESS_SHARES;
        let about = |width: f32| {
            let width = width * self.radius;
            let secant_2 = 1.0 + distance_2 / (width * width);
            1.0 / (TAU * width * width * secant_2 * secant_2.sqrt())
        };
        let inside = if distance_2 <= self.radius * self.radius { middle * even } else { 0.0 };
        inside + near * about(ENDLESS_WIDTHS[0]) + (1.0 - middle - near) * about(ENDLESS_WIDTHS[1])
    }
}

macro_rules! lights {
    ($($(#[$doc:meta])* $variant:ident($name:ty)),* $(,)?) => {
        /// The closed set of lights.
        #[derive(Clone, Debug)]
        pub enum Light {
            $($(#[$doc])* $variant($name)),*
        }

        impl Light {
            /// Samples a direction towards the light.
            #[inline]
            pub fn sample(&self, ctx: &LightContext, u: Vec2) -> Option<LightSample> {
                match self { $(Self::$variant(l) => l.sample(ctx, u)),* }
            }

            /// An estimate of the power that it brings into the scene, W.
            pub fn power(&self, scene: &SceneSphere) -> Spectrum {
                match self { $(Self::$variant(l) => l.power(scene)),* }
            }

            /// Samples a ray that leaves the light: `u_position` the start, `u_direction` the direction.
            pub fn emit(&self, scene: &SceneSphere, u_position: Vec2, u_direction: Vec2) -> Option<EmissionSample> {
                match self { $(Self::$variant(l) => l.emit(scene, u_position, u_direction)),* }
            }
        }
    };
}

lights! {
    /// One triangle or analytic shape that emits.
    Area(AreaLight),
    /// A point.
    Point(PointLight),
    /// A point with a cone.
    Spot(SpotLight),
    /// A point with a picture over directions.
    Picture(Box<PictureLight>),
    /// One direction.
    Directional(DirectionalLight),
    /// The sun's disk.
    Sun(SunLight),
    /// The same radiance from everywhere.
    Constant(ConstantLight),
    /// A picture all round.
    Environment(Box<EnvironmentLight>),
    /// A picture all round, behind a window.
    Portal(Box<PortalLight>),
}

impl Light {
    /// The density of `sample` for a point `p` with normal `ng` on an area light (a triangle's `ng` may be either side's);
    /// zero for all other lights.
    #[inline]
    pub fn pdf_hit(&self, ctx: &LightContext, p: Vec3, ng: Vec3) -> f32 {
        match self {
            Self::Area(l) => l.pdf(ctx, p, ng),
            _ => 0.0,
        }
    }

    /// Radiance that arrives at the point `o` from the unit direction `wi` where a ray leaves the scene; zero for lights that are not infinite.
    /// `o` is the point where the ray was last scattered, or the camera.
    #[inline]
    pub fn escaped(&self, o: Vec3, wi: Vec3) -> Spectrum {
        match self {
            Self::Portal(l) => l.radiance(o, wi),
            Self::Sun(l) => l.radiance(wi),
            Self::Constant(l) => l.radiance,
            Self::Environment(l) => l.radiance(wi),
            _ => Spectrum::ZERO,
        }
    }

    /// The density of `sample` for the unit direction `wi` of a ray that leaves the scene.
    #[inline]
    pub fn pdf_escaped(&self, ctx: &LightContext, wi: Vec3) -> f32 {
        match self {
            Self::Sun(l) => l.pdf(wi),
            Self::Constant(l) => l.pdf(ctx, wi),
            Self::Environment(l) => l.pdf(wi),
            Self::Portal(l) => l.pdf(ctx, wi),
            _ => 0.0,
        }
    }

    /// As `sample`, for estimates that also sample directions by the surface and weigh both by their densities (multiple importance
    /// sampling): what the other sampling finds as well may be left to it, so that alone this is not enough.
    #[inline]
    pub fn sample_compensated(&self, ctx: &LightContext, u: Vec2) -> Option<LightSample> {
        match self {
            Self::Environment(l) => l.sample_compensated(ctx, u),
            _ => self.sample(ctx, u),
        }
    }

    /// [`Self::escaped`] and [`Self::pdf_escaped_compensated`] in one, which saves environment maps half of the work.
    #[inline]
    pub fn escaped_and_pdf_compensated(&self, ctx: &LightContext, wi: Vec3) -> (Spectrum, f32) {
        match self {
            Self::Environment(l) => l.radiance_and_pdf_compensated(wi),
            _ => (self.escaped(ctx.p, wi), self.pdf_escaped_compensated(ctx, wi)),
        }
    }

    /// As `pdf_escaped`, for `sample_compensated`.
    #[inline]
    pub fn pdf_escaped_compensated(&self, ctx: &LightContext, wi: Vec3) -> f32 {
        match self {
            Self::Environment(l) => l.pdf_compensated(wi),
            _ => self.pdf_escaped(ctx, wi),
        }
    }

    /// Whether the light is infinitely far away.
    #[inline]
    pub fn is_infinite(&self) -> bool {
        matches!(self, Self::Directional(_) | Self::Sun(_) | Self::Constant(_) | Self::Environment(_) | Self::Portal(_))
    }

    /// Whether no ray can meet the light by chance.
    #[inline]
    pub fn is_delta(&self) -> bool {
        matches!(self, Self::Point(_) | Self::Spot(_) | Self::Picture(_) | Self::Directional(_))
    }

    /// Where a finite light is and where it shines; `None` for infinite lights and those that give nothing.
    pub fn bounds(&self) -> Option<LightBounds> {
        let bounds = match self {
            Self::Area(l) => l.bounds(),
            Self::Point(l) => l.bounds(),
            Self::Spot(l) => l.bounds(),
            Self::Picture(l) => l.bounds(),
            _ => return None,
        };
        (bounds.phi > 0.0 && bounds.bounds.min.is_finite() && bounds.bounds.max.is_finite()).then_some(bounds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{hash_words, unit_float};

    /// Shares of samples in rings against the integral of the density over them.
    #[test]
    fn rays_pass_the_sphere_as_their_density_says() {
        for endless in [false, true] {
            let sphere = SceneSphere { center: Vec3::ZERO, radius: 2.0, endless };
            let edges = [0.0f64, 1.0, 2.0, 2.5, 4.0, 8.0, 16.0, 32.0, 100.0, 1000.0];
            let count = 200_000u64;
            let mut found = [0.0f64; 9];
            for i in 0..count {
                let u = |k: u64| unit_float(hash_words([i, k]) as u32);
                let r = f64::from(sphere.sample_across(Vec2::new(u(0), u(1))).length());
                if let Some(ring) = (0..9).find(|&k| (edges[k]..edges[k + 1]).contains(&r)) {
                    found[ring] += 1.0 / count as f64;
                }
            }
            for k in 0..9 {
                let (a, b) = (edges[k], edges[k + 1]);
                let steps = 2000;
                let expected: f64 = (0..steps)
                    .map(|i| {
                        let r = a + (b - a) * (f64::from(i) + 0.5) / f64::from(steps);
                        // The disk that scenes with an end are lit by ends with them.
                        let inside = endless || r < 2.0;
                        let density = if inside { f64::from(sphere.pdf_across((r * r) as f32)) } else { 0.0 };
                        density * std::f64::consts::TAU * r * (b - a) / f64::from(steps)
                    })
                    .sum();
                let error = (expected / count as f64).sqrt();
                assert!((found[k] - expected).abs() <= 5.0 * error + 1e-4 * expected, "ring {k}: {} instead of {expected}", found[k]);
            }
        }
    }
}
