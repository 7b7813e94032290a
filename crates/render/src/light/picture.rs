//! Points whose intensity is a picture over directions.

use etendue_scene::desc::PictureMapping;

use super::equal_area::{direction_from_square, square_from_direction};
use super::point::sample_point;
use super::{EmissionSample, LightBounds, LightContext, LightSample, SceneSphere};
use crate::math::distribution::PiecewiseConstant2D;
use crate::math::{Aabb, Mat3, Mat4, PI, Vec2, Vec3, fns};
use crate::spectrum::Spectrum;

/// Points along an edge of a pixel at which its solid angle is measured.
const SUB: usize = 4;

/// A point that shines by a picture: around itself (pbrt's `goniometric`), or through a window in front of it (`projection`). Each pixel
/// has
/// one intensity. Like a point light it casts hard shadows and is never seen itself.
#[derive(Clone, Debug)]
pub struct PictureLight {
    p: Vec3,
    /// Its space in the world: unit columns at right angles, which may mirror.
    axes: Mat3,
    /// Half of the window's edges at distance 1; `None` for pictures all round.
    window: Option<Vec2>,
    width: usize,
    height: usize,
    /// Row by row from the top.
    intensity: Vec<Spectrum>,
    /// Directions by what leaves into them.
    directions: PiecewiseConstant2D,
    power: Spectrum,
    bounds: LightBounds,
}

impl PictureLight {
    /// From a picture of relative intensities, row by row, and a factor on it. `power` is the luminance of all that leaves, W, and
    /// replaces the factor's brightness. `None` where the numbers make no light: not finite, no pixels, a flat transform, or a picture all
    /// round that is no square. Pixels that are negative or not finite are black; a black picture gives nothing.
    pub fn new(
        (width, height): (usize, usize),
        texels: &[[f32; 3]],
        factor: [f32; 3],
        power: Option<f32>,
        world_from_light: Mat4,
        mapping: PictureMapping,
    ) -> Option<Self> {
        let p = world_from_light.w_axis.truncate();
        let axes = right_angled(Mat3::from_mat4(world_from_light))?;
        let factor = Spectrum::from_rgb(factor);
        let window = match mapping {
            PictureMapping::EqualAreaSquare => None,
            PictureMapping::Perspective { fov_rad } => {
                // The angle is that of the shorter edge.
                let (shorter, [w, h]) = (width.min(height) as f32, [width as f32, height as f32]);
                Some(fns::tan(0.5 * fov_rad) * Vec2::new(w, h) / shorter)
            }
        };
        let count = width.checked_mul(height).filter(|n| *n > 0 && *n == texels.len())?;
        let sound = p.is_finite() && factor.is_finite() && window.map_or(width == height, |w| w.is_finite() && w.min_element() > 0.0);
        if !sound {
            return None;
        }
        let clean = |v: f32| if v.is_finite() { v.max(0.0) } else { 0.0 };
        let mut light = Self {
            p,
            axes,
            window,
            width,
            height,
            intensity: texels.iter().map(|c| Spectrum::from_rgb(c.map(clean)) * factor).collect(),
            directions: PiecewiseConstant2D::new(1, 1, &[1.0]),
            power: Spectrum::ZERO,
            bounds: LightBounds::EMPTY,
        };
        let angles: Vec<f32> = (0..count).map(|i| light.pixel_angle(i)).collect();
        let total = |light: &Self| light.intensity.iter().zip(&angles).fold(Spectrum::ZERO, |sum, (c, w)| sum + *c * *w);
        if let Some(wanted) = power {
            let scale = wanted / total(&light).luminance();
            if scale.is_finite() {
                light.intensity.iter_mut().for_each(|c| *c *= scale);
            }
        }
        light.power = total(&light);
        if !light.power.is_finite() {
            return None;
        }
        let strengths: Vec<f32> = light.intensity.iter().map(|c| super::strength(*c)).collect();
        let weights: Vec<f32> = strengths.iter().zip(&angles).map(|(s, w)| s * w).collect();
        light.directions = PiecewiseConstant2D::new(width, height, &weights);
        light.bounds = light.bounds_of(&strengths, &weights);
        Some(light)
    }

    /// The solid angle of a pixel.
    fn pixel_angle(&self, i: usize) -> f32 {
        let (x, y) = (i % self.width, i / self.width);
        let size = Vec2::new(self.width as f32, self.height as f32);
        let middle = |k: usize| (k as f32 + 0.5) / SUB as f32;
        let at = |k: usize| self.direction(Vec2::new(x as f32 + middle(k % SUB), y as f32 + middle(k / SUB)) / size).1;
        (0..SUB * SUB).map(at).sum::<f32>() / (SUB * SUB) as f32 / (size.x * size.y)
    }

    fn bounds_of(&self, strengths: &[f32], weights: &[f32]) -> LightBounds {
        let size = Vec2::new(self.width as f32, self.height as f32);
        let (mut sum, mut lean) = (0.0, Vec3::ZERO);
        for (i, weight) in weights.iter().enumerate() {
            let uv = Vec2::new((i % self.width) as f32 + 0.5, (i / self.width) as f32 + 0.5) / size;
            sum += weight;
            lean += self.axes * self.direction(uv).0 * *weight;
        }
        let cos_corner = self.window.map_or(-1.0, |w| 1.0 / (1.0 + w.length_squared()).sqrt());
        LightBounds {
            bounds: Aabb { min: self.p, max: self.p },
            axis: self.axes.z_axis,
            phi: strengths.iter().fold(0.0, |a, b| a.max(*b)),
            cos_o: cos_corner,
            cos_e: if self.window.is_some() { 1.0 } else { 0.0 },
            two_sided: false,
            mean: sum / (4.0 * PI),
            lean: lean * (3.0 / (4.0 * PI)),
        }
    }

    /// The unit direction, in the light's space, of picture coordinates, whose v runs down; and the solid angle that a unit of their
    /// area has.
    fn direction(&self, uv: Vec2) -> (Vec3, f32) {
        let Some(half) = self.window else { return (direction_from_square(uv), 4.0 * PI) };
        let d = Vec3::new((2.0 * uv.x - 1.0) * half.x, (1.0 - 2.0 * uv.y) * half.y, 1.0);
        let cos = 1.0 / d.length();
        (d * cos, 4.0 * half.x * half.y * cos * cos * cos)
    }

    /// Picture coordinates of a unit direction in the world; `None` beside the window.
    #[inline]
    fn uv(&self, d: Vec3) -> Option<Vec2> {
        let d = self.axes.transpose() * d;
        let Some(half) = self.window else { return Some(square_from_direction(d)) };
        let q = Vec2::new(d.x, -d.y) / (d.z * half);
        (d.z > 0.0 && q.abs().max_element() <= 1.0).then(|| 0.5 * q + 0.5)
    }

    /// The intensity into a unit direction.
    pub fn intensity(&self, d: Vec3) -> Spectrum {
        let Some(uv) = self.uv(d) else { return Spectrum::ZERO };
        let cell = |v: f32, n: usize| ((v * n as f32) as usize).min(n - 1);
        self.intensity[cell(uv.y, self.height) * self.width + cell(uv.x, self.width)]
    }

    /// See the contract in [`crate::light`].
    #[inline]
    pub fn sample(&self, ctx: &LightContext, _u: Vec2) -> Option<LightSample> {
        sample_point(self.p, ctx, |d| self.intensity(d))
    }

    /// See [`super::Light::power`].
    pub fn power(&self, _scene: &SceneSphere) -> Spectrum {
        self.power
    }

    /// See [`super::Light::bounds`].
    pub fn bounds(&self) -> LightBounds {
        self.bounds
    }

    /// The density of `emit` for a unit direction.
    pub fn pdf_emit(&self, d: Vec3) -> f32 {
        self.uv(d).map_or(0.0, |uv| self.directions.pdf(uv) / self.direction(uv).1)
    }

    /// See [`super::Light::emit`]: pixels by their share of the power.
    pub fn emit(&self, _scene: &SceneSphere, _u_position: Vec2, u_direction: Vec2) -> Option<EmissionSample> {
        let (uv, pdf, [x, y]) = self.directions.sample(u_direction);
        let (d, angle) = self.direction(uv);
        let (d, radiance, pdf_direction) = ((self.axes * d).normalize(), self.intensity[y * self.width + x], pdf / angle);
        let usable = pdf_direction > 0.0 && pdf_direction.is_finite() && !radiance.is_black();
        usable.then_some(EmissionSample { o: self.p, d, n: d, uv, radiance, pdf_position: 1.0, pdf_direction, cos: 1.0 })
    }
}

/// Unit columns at right angles along those of a matrix, of the same handedness; `None` where it is flat.
fn right_angled(m: Mat3) -> Option<Mat3> {
    let z = m.z_axis.try_normalize()?;
    let x = m.x_axis.reject_from_normalized(z).try_normalize()?;
    let y = z.cross(x);
    let side = y.dot(m.y_axis);
    (side != 0.0 && side.is_finite()).then(|| Mat3::from_cols(x, y * side.signum(), z))
}
