//! Irradiance of surfaces from a photon map, without dark rims.
//!
//! Density is photons over the area that they could have landed on. Near the edge of a surface, at a wall or under a box, the disk of
//! the search sticks out of the surface, and dividing by the whole disk makes rims dark (boundary bias; Jensen 2001, "Realistic Image
//! Synthesis Using Photon Mapping", section 7.4). Here the kernel's integral over what the point sees of its own surface takes the
//! disk's place, found by [`PROBES`] points. Photons that the point does not see across its surface do not count either, so that no
//! light leaks under thin walls.

use super::tree::Neighbors;
use super::{Photon, PhotonMap, PhotonTree, Route, estimate};
use crate::accel::Ray;
use crate::lightmap::SurfaceLight;
use crate::math::hash::{hash_words, unit_float};
use crate::math::{Frame, Vec2, Vec3, fns};
use crate::scene::surface::offset;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Points that find how much of the disk of a search is surface.
const PROBES: u32 = 24;
/// Surfaces that a probe passes before it gives up.
const MOST_SURFACES: u32 = 4;
/// Lines of sight along a surface run this far above it, in radii of the search: over its curvature, and not over what stands on it.
const LIFT: f32 = 0.05;
/// Smallest share of a disk that counts as surface: what is smaller is noise.
const LEAST_SHARE: f32 = 0.02;
/// One of so many photons gets an irradiance of its own in [`PhotonLight::coarse`].
const COARSE: usize = 4;

/// The light of a photon map on surfaces, for lightmaps and reports.
pub struct PhotonLight {
    tree: PhotonTree,
    scale: f32,
    count: usize,
    radius: f32,
}

impl PhotonLight {
    /// Estimates by the `count` nearest photons within a radius in scene units.
    pub fn new(map: PhotonMap, count: usize, radius: f32) -> Self {
        let scale = map.scale();
        Self { tree: PhotonTree::new(map.into_photons().0), scale, count, radius }
    }

    /// The same estimates, made beforehand at a quarter of the photons: a look-up takes the nearest one's (Christensen 1999, "Faster
    /// Photon Map Global Illumination", doi:10.1080/10867651.1999.10487505). Much faster, and good enough where rays of a final gather end.
    pub fn coarse(&self, scene: &Scene) -> CoarseLight {
        use rayon::prelude::*;
        let chosen: Vec<&Photon> = self.tree.photons().iter().step_by(COARSE).collect();
        let photons = chosen
            .into_par_iter()
            .map(|p| Photon::new(p.position(), p.from(), p.normal(), self.at(scene, p.position(), p.normal()), 0, 0, Route::Direct))
            .filter(Photon::is_finite)
            .collect();
        CoarseLight { tree: PhotonTree::new(photons), radius: self.radius }
    }

    /// Irradiance at a point of a surface on the side of its unit normal.
    fn at(&self, scene: &Scene, p: Vec3, n: Vec3) -> Spectrum {
        let mut found = Neighbors::new();
        let like = |photon: &Photon| photon.normal().dot(n) >= estimate::LEAST_NORMAL_COS;
        let r2 = self.tree.nearest(p, self.count, self.radius, like, &mut found);
        if found.is_empty() || !(r2 > 0.0) {
            return Spectrum::ZERO;
        }
        let eye = Eye { scene, p, n, lift: LIFT * r2.sqrt() };
        let mut sum = Spectrum::ZERO;
        for &(d2, index) in &found {
            let photon = self.tree.photon(index);
            if d2 < r2 && eye.sees(photon.position(), photon.normal()) {
                sum += photon.power() * (1.0 - d2 / r2);
            }
        }
        if sum.is_black() {
            return sum;
        }
        let norm = estimate::disk_norm(r2) / eye.share(r2);
        if norm.is_finite() { sum * (norm * self.scale) } else { Spectrum::ZERO }
    }
}

/// A point that looks along its surface.
struct Eye<'a> {
    scene: &'a Scene,
    p: Vec3,
    n: Vec3,
    lift: f32,
}

impl Eye<'_> {
    /// Whether nothing stands between the point and another of the same surface.
    fn sees(&self, q: Vec3, n: Vec3) -> bool {
        let o = offset(self.p, self.n) + self.n * self.lift;
        let d = offset(q, n) + n * self.lift - o;
        !self.scene.occluded(&Ray { o, d, t_min: 0.0, t_max: 1.0 })
    }

    /// The kernel's integral over the surface that the point sees, over that of a disk.
    fn share(&self, r2: f32) -> f32 {
        let radius = r2.sqrt();
        let frame = Frame::from_normal(self.n);
        let bits = hash_words(self.p.to_array().map(|v| u64::from(v.to_bits())));
        let shift = Vec2::new(unit_float(bits as u32), unit_float((bits >> 32) as u32));
        let mut sum = 0.0;
        for i in 0..PROBES {
            // Equal areas by rings, turned by the golden section.
            let u = ((i as f32 + shift.x) / PROBES as f32).min(1.0);
            let (sin, cos) = fns::sin_cos(std::f32::consts::TAU * (i as f32 * 0.618_034 + shift.y).fract());
            let (r, height) = (radius * u.sqrt(), radius * (1.0 - u).sqrt());
            let at = self.p + frame.world_from_local(Vec3::new(r * cos, r * sin, 0.0));
            let mut ray = Ray { o: at + self.n * height, d: -self.n, t_min: 0.0, t_max: 2.0 * height };
            for _ in 0..MOST_SURFACES {
                let Some(s) = self.scene.intersect(&ray) else { break };
                let m = if s.ng.dot(self.n) < 0.0 { -s.ng } else { s.ng };
                let cos = m.dot(self.n);
                if cos >= estimate::LEAST_NORMAL_COS && self.sees(s.p, m) {
                    // Uniform points of the disk; the area of the surface above is 1 / cos as large.
                    sum += (1.0 - s.p.distance_squared(self.p) / r2).max(0.0) / cos;
                }
                ray = Ray { o: s.offset_origin(ray.d), t_max: ray.t_max - s.t, ..ray };
            }
        }
        // The mean of the kernel over the disk is a half.
        (2.0 * sum / PROBES as f32).max(LEAST_SHARE)
    }
}

/// On the side to which the shading normal points.
fn normal(surface: &Surface) -> Vec3 {
    if surface.ng.dot(surface.frame.n) < 0.0 { -surface.ng } else { surface.ng }
}

impl SurfaceLight for PhotonLight {
    fn irradiance(&self, scene: &Scene, surface: &Surface) -> Spectrum {
        self.at(scene, surface.p, normal(surface))
    }
}

/// Irradiance at some photons; see [`PhotonLight::coarse`].
pub struct CoarseLight {
    tree: PhotonTree,
    radius: f32,
}

impl SurfaceLight for CoarseLight {
    fn irradiance(&self, _scene: &Scene, surface: &Surface) -> Spectrum {
        let n = normal(surface);
        let mut found = Neighbors::new();
        self.tree.nearest(surface.p, 1, self.radius, |photon| photon.normal().dot(n) > 0.9, &mut found);
        found.first().map_or(Spectrum::ZERO, |&(_, index)| self.tree.photon(index).power())
    }
}
