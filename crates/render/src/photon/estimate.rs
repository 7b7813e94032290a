//! From the density of photons to light.
//!
//! The radiance that a surface reflects is ∑ f·Φ·K over the photons near a point, with the kernel K of Epanechnikov over the disk of
//! the search (weights fall to nothing at its rim, so that k-nearest searches are unbiased where the density is even). What
//! [`Scatter::eval_pdf`] returns has the cosine of the shading normal in it; the flux of photons has that of the geometric one.
//!
//! Photons that landed on a surface of another orientation do not count: that keeps light from leaking round edges and through thin
//! walls. Photons on the far side of an opaque surface are dark by its BSDF.

use super::tree::Neighbors;
use super::{Photon, PhotonTree, VisibleDisk};
use crate::accel::Ray;
use crate::bsdf::TransportMode;
use crate::material::Scatter;
use crate::math::{INV_PI, Vec3};
use crate::medium::Phase;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Least cosine between the normal of a photon's surface and the one that is looked at.
pub(super) const LEAST_NORMAL_COS: f32 = 0.7;
/// Cosines below this count as this, so that photons that graze a surface do not weigh without limit.
const LEAST_COS: f32 = 0.02;

/// A surface point that is looked at.
pub struct Query<'a> {
    /// The point.
    pub s: &'a Surface,
    /// What scatters there.
    pub scatter: &'a Scatter,
    /// Unit direction to the viewer.
    pub wo: Vec3,
    /// Photons from directions that the BSDF's own sampling finds with a higher density than this do not count: the viewer's path
    /// goes on there. Infinite: all count.
    pub max_pdf: f32,
}

impl Query<'_> {
    /// Whether a photon landed on a surface of such an orientation.
    #[inline]
    pub fn lands(&self, photon: &Photon) -> bool {
        photon.normal().dot(self.s.ng).abs() >= LEAST_NORMAL_COS
    }

    /// What a photon adds to the reflected radiance, before kernel and scale; `None` where it does not count.
    #[inline]
    fn reflect(&self, photon: &Photon) -> Option<Spectrum> {
        if !self.lands(photon) {
            return None;
        }
        let from = photon.from();
        let (f, pdf) = self.scatter.eval_pdf(self.wo, from, TransportMode::Radiance);
        if f.is_black() || pdf > self.max_pdf {
            return None;
        }
        Some(photon.power() * f / self.s.ng.dot(from).abs().max(LEAST_COS))
    }

    /// Calls `add` with what each photon within the radius adds to the reflected radiance (times `scale`) and its light group; of those that
    /// the point sees, where a disk of this radius or a larger one tells.
    pub fn radiance_within(
        &self,
        tree: &PhotonTree,
        radius: f32,
        disk: Option<&VisibleDisk>,
        scale: f32,
        accept: impl Fn(&Photon) -> bool,
        mut add: impl FnMut(Spectrum, u32),
    ) {
        let norm = disk_norm(radius * radius) * scale / disk.map_or(1.0, |disk| disk.share(radius));
        let inverse = 1.0 / (radius * radius);
        tree.within(self.s.p, radius, |photon, d2| {
            if accept(photon)
                && disk.is_none_or(|disk| disk.sees(photon.position() - self.s.p))
                && let Some(light) = self.reflect(photon)
            {
                add(light * (norm * (1.0 - d2 * inverse)), photon.group());
            }
        });
    }

    /// The same for the nearest photons that `accept` takes and that landed on such a surface, within a radius.
    pub fn radiance_nearest(
        &self,
        tree: &PhotonTree,
        count: usize,
        radius: f32,
        scale: f32,
        accept: impl Fn(&Photon) -> bool,
        mut add: impl FnMut(Spectrum, u32),
    ) {
        let mut found = Neighbors::new();
        let like = |photon: &Photon| self.lands(photon) && accept(photon);
        let r2 = tree.nearest(self.s.p, count, radius, like, &mut found);
        let norm = disk_norm(r2) * scale;
        for &(d2, index) in &found {
            let photon = tree.photon(index);
            if let Some(light) = self.reflect(photon) {
                add(light * (norm * (1.0 - d2 / r2)), photon.group());
            }
        }
    }
}

/// The factor of the kernel over a disk: ∫ (1 − d²/r²) dA = π r² / 2.
#[inline]
pub(super) fn disk_norm(r2: f32) -> f32 {
    let norm = 2.0 * INV_PI / r2;
    if norm.is_finite() { norm } else { 0.0 }
}

/// Radiance that photons in a medium send towards the origin of a ray: calls `add` with each photon closer to the ray than the radius,
/// its distance along the ray, and its light times `scale`, which the medium between has not dimmed yet (the beam radiance estimate;
/// Jarosz, Zwicker, Jensen 2008, doi:10.1111/j.1467-8659.2008.01153.x).
pub fn radiance_along(
    tree: &PhotonTree,
    ray: &Ray,
    t_max: f32,
    radius: f32,
    scale: f32,
    phase: &Phase,
    mut add: impl FnMut(&Photon, f32, Spectrum),
) {
    let norm = disk_norm(radius * radius) * scale;
    let inverse = 1.0 / (radius * radius);
    tree.along(ray, t_max, radius, |photon, t, d2| {
        let f = phase.eval(-ray.d, photon.from());
        add(photon, t, photon.power() * (f * norm * (1.0 - d2 * inverse)));
    });
}

/// Irradiance from the nearest photons on one side of a surface with the unit normal `n`. Cost: one search.
pub fn irradiance(tree: &PhotonTree, p: Vec3, n: Vec3, count: usize, radius: f32, scale: f32) -> Spectrum {
    let mut found = Neighbors::new();
    let r2 = tree.nearest(p, count, radius, |photon| photon.normal().dot(n) >= LEAST_NORMAL_COS, &mut found);
    let norm = disk_norm(r2) * scale;
    found.iter().fold(Spectrum::ZERO, |sum, &(d2, index)| sum + tree.photon(index).power() * (norm * (1.0 - d2 / r2)))
}

/// The reach of searches where the settings say nothing: a twentieth of the scene's radius.
pub fn default_radius(scene: &Scene) -> f32 {
    0.05 * scene.sphere().radius
}
