//! Environment maps: light from all round as a picture that is indexed by a direction (Blinn and Newell 1976, "Texture and Reflection
//! in Computer Generated Images", doi:10.1145/360349.360353; cubes after Greene 1986, doi:10.1109/MCG.1986.276658).
//!
//! The map holds what is seen from *one* point. A mirror that is not there, or is not small, sees something else: reflections of near
//! things come out in the wrong place. [`Correction::Box`] mends that for rooms: the reflected ray is met with a box of the
//! surroundings, and the map is indexed by the direction from its own point to there.
//!
//! Rough mirrors see a blurred environment. The *split sum* (Karis 2013, "Real Shading in Unreal Engine 4") takes the mean of a product
//! – light times reflectance – as the product of two means: maps that are blurred beforehand as a lobe of some roughness would, seen
//! head-on, and a small table of the reflectance under white light. Blur is by importance sampling, with each sample looked up at the
//! size that it stands for (Křivánek and Colbert 2008, doi:10.1111/j.1467-8659.2008.01252.x). Diffuse surfaces take nine numbers of
//! spherical harmonics (Ramamoorthi and Hanrahan 2001, "An Efficient Representation for Irradiance Environment Maps",
//! doi:10.1145/383259.383317).

use rayon::prelude::*;

use super::Pose;
use super::visible::largest;
use crate::bsdf::fresnel::schlick_weight;
use crate::bsdf::microfacet::{Distribution, Microfacet};
use crate::math::{Aabb, Frame, PI, Vec2, Vec3, fns};
use crate::spectrum::Spectrum;

/// Edges of the faces of prefiltered maps.
pub const BASE: usize = 128;
/// Levels of roughness; the first is sharp.
const LEVELS: usize = 7;
/// Samples of a prefiltered texel.
const SAMPLES: u32 = 256;

/// A picture on the six faces of a cube.
#[derive(Clone, Debug)]
pub struct Cube {
    size: usize,
    /// Face by face, row by row.
    texels: Vec<Spectrum>,
}

/// The pose that looks at a face, of unit and perpendicular axes.
fn face_axes(face: usize) -> [Vec3; 3] {
    let p = Pose::cube_face(Vec3::ZERO, face);
    [p.right, p.up, p.forward].map(|v| v.as_vec3())
}

impl Cube {
    /// A cube of `size`² texels a face; `radiance` is given face, column, row and the unit direction of the texel's center.
    pub fn new(size: usize, radiance: impl Fn(usize, usize, usize, Vec3) -> Spectrum + Sync) -> Self {
        let size = size.max(1);
        let texels = (0..6 * size * size).into_par_iter().map(|i| {
            let (face, y, x) = (i / (size * size), i / size % size, i % size);
            radiance(face, x, y, Self::direction(size, face, x as f32 + 0.5, y as f32 + 0.5))
        });
        Self { size, texels: texels.collect() }
    }

    /// The unit direction of a place of a face.
    fn direction(size: usize, face: usize, x: f32, y: f32) -> Vec3 {
        let [right, up, forward] = face_axes(face);
        let scale = 2.0 / size as f32;
        (forward + right * (x * scale - 1.0) + up * (1.0 - y * scale)).normalize()
    }

    /// Half the edge, each texel the mean of four.
    fn halved(&self) -> Self {
        let (n, half) = (self.size, (self.size / 2).max(1));
        let at = |face: usize, x: usize, y: usize| self.texels[(face * n + y.min(n - 1)) * n + x.min(n - 1)];
        let mean = |i: usize| {
            let (face, y, x) = (i / (half * half), i / half % half * 2, i % half * 2);
            (at(face, x, y) + at(face, x + 1, y) + at(face, x, y + 1) + at(face, x + 1, y + 1)) * 0.25
        };
        Self { size: half, texels: (0..6 * half * half).map(mean).collect() }
    }

    /// The radiance from a direction of any length, interpolated within the face.
    pub fn lookup(&self, d: Vec3) -> Spectrum {
        let k = largest(d);
        let face = 2 * k + usize::from(d[k] < 0.0);
        let [right, up, forward] = face_axes(face);
        let w = d.dot(forward);
        if !(w > 0.0) {
            return Spectrum::ZERO;
        }
        let n = self.size as f32;
        let place = |v: f32| ((v / w + 1.0) * 0.5 * n - 0.5).clamp(0.0, n - 1.0);
        let (x, y) = (place(d.dot(right)), place(-d.dot(up)));
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(self.size - 1), (y0 + 1).min(self.size - 1));
        let row = |y: usize| {
            let at = |x: usize| self.texels[(face * self.size + y) * self.size + x];
            at(x0).lerp(at(x1), x - x0 as f32)
        };
        row(y0).lerp(row(y1), y - y0 as f32)
    }

    /// Calls `f` with direction, solid angle and radiance of each texel.
    fn for_each(&self, mut f: impl FnMut(Vec3, f32, Spectrum)) {
        let n = self.size;
        let cell = 4.0 / (n * n) as f32;
        for (i, &radiance) in self.texels.iter().enumerate() {
            let (face, y, x) = (i / (n * n), i / n % n, i % n);
            let (u, v) = ((x as f32 + 0.5) * 2.0 / n as f32 - 1.0, (y as f32 + 0.5) * 2.0 / n as f32 - 1.0);
            let r2 = 1.0 + u * u + v * v;
            f(Self::direction(n, face, x as f32 + 0.5, y as f32 + 0.5), cell / (r2 * r2.sqrt()), radiance);
        }
    }

    /// All faces side by side as a picture of 6 · size columns: +x, −x, +y, −y, +z, −z.
    pub fn strip(&self) -> (usize, usize, Vec<[f32; 3]>) {
        let n = self.size;
        let texel = |i: usize| self.texels[((i % (6 * n)) / n * n + i / (6 * n)) * n + i % n].rgb();
        (6 * n, n, (0..6 * n * n).map(texel).collect())
    }
}

/// How a map's lack of a second point is mended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Correction {
    /// Not: rays start in the map's point, wherever the mirror is.
    None,
    /// By a box of the surroundings.
    #[default]
    Box,
}

/// An environment map with everything that shading asks of it.
#[derive(Clone, Debug)]
pub struct Environment {
    /// Where the map was made; `None`: infinitely far surroundings.
    center: Option<Vec3>,
    /// The box of the surroundings, for the correction.
    bounds: Aabb,
    /// What mirrors show, lights included.
    mirror: Cube,
    /// For rising roughness: α = (i / (n − 1))².
    levels: Vec<Cube>,
    /// Irradiance by direction of the normal.
    harmonics: [Spectrum; 9],
}

impl Environment {
    /// From what mirrors show and what rough surfaces are to reflect (without lights that are sampled for them).
    pub fn new(center: Option<Vec3>, bounds: Aabb, mirror: Cube, rough: &Cube) -> Self {
        let mut chain = vec![rough.clone()];
        while chain.last().is_some_and(|c| c.size > 1) {
            let next = chain[chain.len() - 1].halved();
            chain.push(next);
        }
        // Prefiltering starts from a moderate size.
        let skip = chain.iter().position(|c| c.size <= BASE).unwrap_or(0);
        let chain = &chain[skip..];
        let level = |i: usize| if i == 0 { rough.clone() } else { prefilter(chain, roughness_alpha(i), (BASE >> (i / 2 + 1)).max(16)) };
        let levels = (0..LEVELS).map(level).collect();
        Self { center, bounds, mirror, levels, harmonics: harmonics(&chain[0]) }
    }

    /// The direction in which the map holds what a ray from `p` along `d` meets.
    fn corrected(&self, p: Vec3, d: Vec3, correction: Correction) -> Vec3 {
        let Some(center) = self.center.filter(|_| correction == Correction::Box) else { return d };
        // Where the ray leaves the box (Lagarde 2012, "Image-based Lighting approaches and parallax-corrected cubemap").
        let t = (0..3).fold(f32::INFINITY, |t, k| {
            let side = if d[k] > 0.0 { self.bounds.max[k] } else { self.bounds.min[k] };
            let to = (side - p[k]) / d[k];
            if d[k] != 0.0 && to >= 0.0 { t.min(to) } else { t }
        });
        if t.is_finite() { p + d * t - center } else { d }
    }

    /// Whether the surroundings are infinitely far.
    pub fn is_sky(&self) -> bool {
        self.center.is_none()
    }

    /// What a perfect mirror at `p` shows in the unit direction `d`.
    pub fn mirrored(&self, p: Vec3, d: Vec3, correction: Correction) -> Spectrum {
        self.mirror.lookup(self.corrected(p, d, correction))
    }

    /// The environment in the unit direction `d`, blurred as by a lobe of roughness `alpha`.
    pub fn blurred(&self, p: Vec3, d: Vec3, alpha: f32, correction: Correction) -> Spectrum {
        let d = self.corrected(p, d, correction);
        let at = alpha.clamp(0.0, 1.0).sqrt() * (LEVELS - 1) as f32;
        let i = (at as usize).min(LEVELS - 2);
        self.levels[i].lookup(d).lerp(self.levels[i + 1].lookup(d), at - i as f32)
    }

    /// Irradiance of a surface with the unit normal `n`.
    pub fn irradiance(&self, n: Vec3) -> Spectrum {
        let sum = basis(n).into_iter().zip(&self.harmonics).fold(Spectrum::ZERO, |sum, (y, l)| sum + *l * y);
        sum.map(|v| v.max(0.0))
    }

    /// The picture that mirrors show.
    pub fn picture(&self) -> &Cube {
        &self.mirror
    }
}

fn roughness_alpha(level: usize) -> f32 {
    fns::sqr(level as f32 / (LEVELS - 1) as f32)
}

/// The real spherical harmonics up to the second band.
fn basis(d: Vec3) -> [f32; 9] {
    let Vec3 { x, y, z } = d;
    [
        0.282_094_8,
        0.488_602_5 * y,
        0.488_602_5 * z,
        0.488_602_5 * x,
        1.092_548_4 * x * y,
        1.092_548_4 * y * z,
        0.315_391_57 * (3.0 * z * z - 1.0),
        1.092_548_4 * x * z,
        0.546_274_2 * (x * x - y * y),
    ]
}

/// Coefficients of the irradiance: those of the radiance times those of the clamped cosine, π, 2π/3 and π/4.
fn harmonics(cube: &Cube) -> [Spectrum; 9] {
    let mut sums = [[0.0f64; 3]; 9];
    cube.for_each(|d, solid_angle, radiance| {
        for (sum, y) in sums.iter_mut().zip(basis(d)) {
            for (s, l) in sum.iter_mut().zip(radiance.rgb()) {
                *s += f64::from(l) * f64::from(y * solid_angle);
            }
        }
    });
    let cosine = |i: usize| [PI, 2.0 * PI / 3.0, 2.0 * PI / 3.0, 2.0 * PI / 3.0].get(i).copied().unwrap_or(PI / 4.0);
    std::array::from_fn(|i| Spectrum::from_rgb(sums[i].map(|s| s as f32 * cosine(i))))
}

/// The i-th of n points of a plane set.
fn hammersley(i: u32, n: u32) -> Vec2 {
    Vec2::new((i as f32 + 0.5) / n as f32, ((i.reverse_bits() >> 8) as f32 + 0.5) / (1 << 24) as f32)
}

/// A blurred cube: for each direction the mean of the map over reflections at facets of roughness `alpha`, seen along the normal.
fn prefilter(chain: &[Cube], alpha: f32, size: usize) -> Cube {
    let facets = Microfacet::isotropic(Distribution::Ggx, alpha);
    // Directions about +z with their weight and level: the same for all texels.
    let texel = 4.0 * PI / (6 * chain[0].size * chain[0].size) as f32;
    let lobe: Vec<(Vec3, f32, f32)> = (0..SAMPLES)
        .filter_map(|i| {
            let m = facets.sample_visible_normal(Vec3::Z, hammersley(i, SAMPLES));
            let wi = 2.0 * m.z * m - Vec3::Z;
            let pdf = facets.pdf_visible(Vec3::Z, m) / (4.0 * m.z);
            let level = 0.5 * fns::log2((1.0 / (SAMPLES as f32 * pdf) / texel).max(1.0));
            (wi.z > 0.0 && pdf > 0.0).then_some((wi, wi.z, level))
        })
        .collect();
    let sum: f32 = lobe.iter().map(|l| l.1).sum();
    Cube::new(size, |_, _, _, d| {
        let frame = Frame::from_normal(d);
        let last = chain.len() - 1;
        let total = lobe.iter().fold(Spectrum::ZERO, |total, &(wi, weight, level)| {
            let wi = frame.world_from_local(wi);
            let i = (level as usize).min(last);
            let next = (i + 1).min(last);
            total + chain[i].lookup(wi).lerp(chain[next].lookup(wi), (level - i as f32).clamp(0.0, 1.0)) * weight
        });
        total / sum.max(1e-12)
    })
}

/// What a rough mirror reflects of white light: scale and offset for its reflectance at normal incidence, by cosine and √α.
#[derive(Clone, Debug)]
pub struct ReflectanceTable {
    cells: Vec<[f32; 2]>,
}

/// Rows and columns of the table.
const TABLE: usize = 32;

impl Default for ReflectanceTable {
    fn default() -> Self {
        let cells = (0..TABLE * TABLE).into_par_iter().map(|i| {
            // The table's ends are cells of their own; light from the very horizon is none.
            let at = |k: usize| k as f32 / (TABLE - 1) as f32;
            integrate_reflectance(at(i % TABLE).max(1e-3), fns::sqr(at(i / TABLE)))
        });
        Self { cells: cells.collect() }
    }
}

impl ReflectanceTable {
    /// Scale and offset: the reflectance is f0 · scale + f90 · offset.
    pub fn lookup(&self, cos: f32, alpha: f32) -> [f32; 2] {
        let place = |v: f32| v.clamp(0.0, 1.0) * (TABLE - 1) as f32;
        let (x, y) = (place(cos), place(alpha.max(0.0).sqrt()));
        let (x0, y0) = ((x as usize).min(TABLE - 2), (y as usize).min(TABLE - 2));
        let (fx, fy) = (x - x0 as f32, y - y0 as f32);
        std::array::from_fn(|k| {
            let at = |dx: usize, dy: usize| self.cells[(y0 + dy) * TABLE + x0 + dx][k];
            fns::lerp(fy, fns::lerp(fx, at(0, 0), at(1, 0)), fns::lerp(fx, at(0, 1), at(1, 1)))
        })
    }
}

/// ∫ f cos / F dω with Schlick's term taken apart: visible normals leave the ratio of shadowing terms.
fn integrate_reflectance(cos: f32, alpha: f32) -> [f32; 2] {
    const N: u32 = 256;
    let facets = Microfacet::isotropic(Distribution::Ggx, alpha);
    let wo = Vec3::new(fns::safe_sqrt(1.0 - cos * cos), 0.0, cos);
    let mut sums = [0.0f32; 2];
    for i in 0..N {
        let m = facets.sample_visible_normal(wo, hammersley(i, N));
        let wi = 2.0 * wo.dot(m) * m - wo;
        if wi.z > 0.0 {
            let (share, f) = (facets.g1(wi, m), schlick_weight(wo.dot(m)));
            sums[0] += share * (1.0 - f);
            sums[1] += share * f;
        }
    }
    sums.map(|s| s / N as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sky that is not simple: a bright spot, a gradient, and a dark ground.
    fn sky(d: Vec3) -> Spectrum {
        let spot = fns::exp(-20.0 * (1.0 - d.dot(Vec3::new(0.6, 0.64, 0.48))));
        Spectrum::from_rgb([0.2 + spot * 3.0, 0.4 + 0.3 * d.y, if d.y > 0.0 { 1.0 } else { 0.1 }])
    }

    fn environment() -> Environment {
        let cube = Cube::new(BASE, |_, _, _, d| sky(d));
        Environment::new(None, Aabb::EMPTY, cube.clone(), &cube)
    }

    #[test]
    fn lookups_are_those_of_the_directions() {
        let e = environment();
        for i in 0..500 {
            let u = hammersley(i, 500);
            let d = crate::math::warp::uniform_sphere(u);
            if d.y.abs() < 0.02 {
                continue;
            }
            let (found, truth) = (e.mirrored(Vec3::ONE, d, Correction::Box), sky(d));
            for k in 0..3 {
                assert!((found[k] - truth[k]).abs() < 0.02, "{d}: {found:?} {truth:?}");
            }
        }
        assert_eq!(e.mirrored(Vec3::ZERO, Vec3::ZERO, Correction::None), Spectrum::ZERO);
    }

    #[test]
    fn irradiance_is_the_integral_of_radiance_and_cosine() {
        let e = environment();
        for n in [Vec3::Y, -Vec3::Y, Vec3::X, Vec3::new(0.6, 0.0, -0.8), Vec3::new(0.36, 0.48, 0.8)] {
            let (mut truth, count) = (Spectrum::ZERO, 40_000);
            for i in 0..count {
                let d = crate::math::warp::uniform_sphere(hammersley(i, count));
                truth += sky(d) * (d.dot(n).max(0.0) * 4.0 * PI / count as f32);
            }
            let found = e.irradiance(n);
            for k in 0..3 {
                // Nine numbers leave up to some per cent (Ramamoorthi and Hanrahan 2001: 9% at worst, 3% typically).
                assert!((found[k] - truth[k]).abs() < 0.06 * truth[k].max(1.0), "{n} lane {k}: {} instead of {}", found[k], truth[k]);
            }
        }
    }

    #[test]
    fn blurred_maps_are_means_over_the_lobe() {
        let e = environment();
        for (level, tolerance) in [(1, 0.05), (3, 0.05), (6, 0.08)] {
            let alpha = roughness_alpha(level);
            let facets = Microfacet::isotropic(Distribution::Ggx, alpha);
            for d in [Vec3::Y, Vec3::new(0.6, 0.64, 0.48), Vec3::new(-0.8, 0.0, 0.6)] {
                let frame = Frame::from_normal(d);
                let (mut sum, mut weights) = (Spectrum::ZERO, 0.0);
                for i in 0..8192 {
                    let m = facets.sample_visible_normal(Vec3::Z, hammersley(i, 8192));
                    let wi = 2.0 * m.z * m - Vec3::Z;
                    if wi.z > 0.0 {
                        sum += sky(frame.world_from_local(wi)) * wi.z;
                        weights += wi.z;
                    }
                }
                let (found, truth) = (e.blurred(Vec3::ZERO, d, alpha, Correction::None), sum / weights);
                for k in 0..3 {
                    let error = (found[k] - truth[k]).abs();
                    assert!(error < tolerance * truth[k].max(0.5), "level {level} {d} lane {k}: {} {}", found[k], truth[k]);
                }
            }
        }
    }

    #[test]
    fn white_light_is_reflected_as_the_table_says() {
        let table = ReflectanceTable::default();
        // A smooth mirror reflects by Schlick's formula, a rough one somewhat less than everything.
        let [scale, offset] = table.lookup(0.5, 0.0);
        assert!((scale + offset - 1.0).abs() < 0.02 && (offset - schlick_weight(0.5)).abs() < 0.01, "{scale} {offset}");
        // Rough ones as the model itself, integrated over all directions.
        for (cos, alpha) in [(0.7, 1.0), (0.3, 0.5), (0.9, 0.2)] {
            let bsdf = crate::bsdf::RoughConductor {
                microfacet: Microfacet::isotropic(Distribution::Ggx, alpha),
                eta: Spectrum::ZERO,
                k: Spectrum::ONE,
                specular_reflectance: Spectrum::ONE,
            };
            let wo = Vec3::new(fns::safe_sqrt(1.0 - cos * cos), 0.0, cos);
            let n = 60_000;
            let of = |i: u32| {
                let wi = crate::math::warp::uniform_hemisphere(hammersley(i, n));
                bsdf.eval(wo, wi, crate::bsdf::TransportMode::Radiance)[0]
            };
            let truth = 2.0 * PI * (0..n).map(of).sum::<f32>() / n as f32;
            let [scale, offset] = table.lookup(cos, alpha);
            assert!((scale + offset - truth).abs() < 0.01, "{cos} {alpha}: {} instead of {truth}", scale + offset);
        }
    }

    #[test]
    fn the_box_puts_reflections_where_they_belong() {
        // A room with a light in a corner, seen from the middle; a mirror elsewhere.
        let room = Aabb { min: Vec3::splat(-2.0), max: Vec3::new(4.0, 3.0, 2.0) };
        let lamp = Vec3::new(4.0, 1.0, 0.5);
        let cube = Cube::new(BASE, |_, _, _, d| {
            let t = (0..3).map(|k| if d[k] > 0.0 { room.max[k] / d[k] } else { room.min[k] / d[k] }).fold(f32::INFINITY, f32::min);
            if (d * t).distance(lamp) < 0.3 { Spectrum::ONE } else { Spectrum::ZERO }
        });
        let e = Environment::new(Some(Vec3::ZERO), room, cube.clone(), &cube);
        let p = Vec3::new(-1.0, 2.0, -1.0);
        let d = (lamp - p).normalize();
        assert!(e.mirrored(p, d, Correction::Box)[0] > 0.9, "corrected, the mirror shows the lamp");
        assert!(e.mirrored(p, d, Correction::None)[0] < 0.1, "from one point, it does not");
    }
}
