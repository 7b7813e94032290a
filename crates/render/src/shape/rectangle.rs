//! Rectangles.

use glam::DVec3;

use super::planar::{Facing, Planar};
use super::{AreaSample, ShapeHit, SurfaceGeometry, area_to_solid_angle, is_far};
use crate::accel::Ray;
use crate::math::{Aabb, Mat4, Vec2, Vec3};

/// The square [−1, 1]² of the xy plane under a transform: also parallelograms. u and v run along x and y.
#[derive(Clone, Debug)]
pub struct Rectangle {
    pub(super) planar: Planar,
    /// Where the sides are perpendicular, which the sampling by solid angle needs.
    right_angled: Option<RightAngled>,
}

/// The rectangle's own axes.
#[derive(Clone, Debug)]
struct RightAngled {
    ex: DVec3,
    ey: DVec3,
    ez: DVec3,
    half_x: f64,
    half_y: f64,
}

impl RightAngled {
    fn new(planar: &Planar) -> Option<Self> {
        let (x, y) = (planar.x_axis.as_dvec3(), planar.y_axis.as_dvec3());
        let (half_x, half_y) = (x.length(), y.length());
        let (ex, ey) = (x / half_x, y / half_y);
        (ex.dot(ey).abs() < 1e-5).then(|| Self { ex, ey, ez: ex.cross(ey), half_x, half_y })
    }
}

/// Below this solid angle samples are taken by area: the density is then nearly constant and angles have few digits.
const MIN_SOLID_ANGLE: f64 = 1e-6;

impl Rectangle {
    /// Places the rectangle; `None` where the transform leaves no surface.
    pub fn from_transform(world_from_object: Mat4, flip_normals: bool) -> Option<Self> {
        let planar = Planar::new(world_from_object, Facing::Cross, flip_normals)?;
        let right_angled = RightAngled::new(&planar);
        Some(Self { planar, right_angled })
    }

    /// See [`super::Shape::bounds`].
    pub fn bounds(&self) -> Aabb {
        let half = self.planar.x_axis.abs() + self.planar.y_axis.abs();
        Aabb { min: self.planar.origin - half, max: self.planar.origin + half }
    }

    /// See [`super::Shape::intersect`].
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<ShapeHit> {
        let (t, q) = self.planar.intersect(ray)?;
        (q.x.abs() <= 1.0 && q.y.abs() <= 1.0).then_some(ShapeHit { t, u: 0.5 + 0.5 * q.x, v: 0.5 + 0.5 * q.y })
    }

    /// See [`super::Shape::surface`].
    #[inline]
    pub fn surface(&self, p: Vec3) -> SurfaceGeometry {
        let s = self.planar.surface(p);
        SurfaceGeometry { uv: (s.uv * 0.5 + 0.5).clamp(Vec2::ZERO, Vec2::ONE), dpdu: s.dpdu * 2.0, dpdv: s.dpdv * 2.0, ..s }
    }

    /// See [`super::Shape::area`].
    pub fn area(&self) -> f32 {
        4.0 * self.planar.stretch
    }

    #[inline]
    fn sample_at(&self, uv: Vec2, pdf: f32) -> AreaSample {
        AreaSample { p: self.planar.point(uv * 2.0 - 1.0), ng: self.planar.ng, uv, pdf }
    }

    /// See [`super::Shape::sample_area`].
    #[inline]
    pub fn sample_area(&self, u: Vec2) -> Option<AreaSample> {
        Some(self.sample_at(u, 1.0 / self.area()))
    }

    /// See [`super::Shape::sample_solid_angle`]: uniform in solid angle; by area for parallelograms and far away.
    #[inline]
    pub fn sample_solid_angle(&self, ref_p: Vec3, u: Vec2) -> Option<AreaSample> {
        match self.spherical(ref_p) {
            Some(s) => Some(self.sample_at(s.sample(u), (1.0 / s.solid_angle) as f32)),
            None => self.sample_area(u)?.per_solid_angle(ref_p),
        }
    }

    /// See [`super::Shape::pdf_solid_angle`].
    #[inline]
    pub fn pdf_solid_angle(&self, ref_p: Vec3, p: Vec3, ng: Vec3) -> f32 {
        match self.spherical(ref_p) {
            Some(s) => (1.0 / s.solid_angle) as f32,
            None => area_to_solid_angle(ref_p, p, ng) / self.area(),
        }
    }

    /// The solid angle seen from a point; exact for right-angled rectangles, else `None`. Zero in the rectangle's plane.
    pub fn solid_angle(&self, ref_p: Vec3) -> Option<f32> {
        self.right_angled.as_ref().map(|r| SphericalRectangle::new(&self.planar, r, ref_p).solid_angle as f32)
    }

    #[inline]
    fn spherical(&self, ref_p: Vec3) -> Option<SphericalRectangle> {
        if is_far(self.planar.origin, self.planar.x_axis.length_squared() + self.planar.y_axis.length_squared(), ref_p) {
            return None;
        }
        let s = SphericalRectangle::new(&self.planar, self.right_angled.as_ref()?, ref_p);
        (s.solid_angle > MIN_SOLID_ANGLE).then_some(s)
    }
}

/// A rectangle projected onto the sphere about a point: Ureña, Fajardo, King 2013, "An Area-Preserving Parametrization for
/// Spherical Rectangles", Computer Graphics Forum 32(4), doi:10.1111/cgf.12151. The names are the paper's.
struct SphericalRectangle {
    x0: f64,
    x1: f64,
    y0: f64,
    y1: f64,
    z0: f64,
    b0: f64,
    b1: f64,
    /// Cosine and sine of the paper's k.
    k: Turn,
    solid_angle: f64,
}

/// A rotation as (cosine, sine): a sum of angles is a product of these, and costs no arc cosine for each.
#[derive(Clone, Copy)]
struct Turn(f64, f64);

impl Turn {
    /// By an angle in [0, π], from its cosine.
    #[inline]
    fn from_cos(cos: f64) -> Self {
        Self(cos, (1.0 - cos * cos).max(0.0).sqrt())
    }

    /// One after the other.
    #[inline]
    fn then(self, o: Self) -> Self {
        Self(self.0 * o.0 - self.1 * o.1, self.0 * o.1 + self.1 * o.0)
    }
}

impl SphericalRectangle {
    #[inline]
    fn new(planar: &Planar, axes: &RightAngled, ref_p: Vec3) -> Self {
        let d: DVec3 = planar.origin.as_dvec3() - ref_p.as_dvec3();
        let (cx, cy) = (d.dot(axes.ex), d.dot(axes.ey));
        let (x0, x1, y0, y1) = (cx - axes.half_x, cx + axes.half_x, cy - axes.half_y, cy + axes.half_y);
        let z0 = -d.dot(axes.ez).abs();
        // z components of the normals of the four side planes; neighbors have no other component in common, so that
        // the products of these are the cosines between them.
        let nz = |c: f64| {
            let len = (z0 * z0 + c * c).sqrt();
            if len > 0.0 { c / len } else { 0.0 }
        };
        let (n0, n1, n2, n3) = (-nz(y0), nz(x1), nz(y1), -nz(x0));
        let (g0, g1) = (Turn::from_cos(-n0 * n1), Turn::from_cos(-n1 * n2));
        let g23 = Turn::from_cos(-n2 * n3).then(Turn::from_cos(-n3 * n0));
        // Ω = g0 + g1 + g2 + g3 − 2π, in [0, 2π).
        let all = g0.then(g1).then(g23);
        let angle = libm::atan2(all.1, all.0);
        // Next to nothing may round to less than nothing.
        let solid_angle =
            if z0 == 0.0 || angle.abs() < 1e-12 { 0.0 } else { angle + if angle < 0.0 { std::f64::consts::TAU } else { 0.0 } };
        // k = 2π − g2 − g3
        Self { x0, x1, y0, y1, z0, b0: n0, b1: n2, k: Turn(g23.0, -g23.1), solid_angle }
    }

    /// The rectangle's parameters in [0, 1]² of a uniform direction.
    fn sample(&self, u: Vec2) -> Vec2 {
        let (sin, cos) = libm::sincos(f64::from(u.x) * self.solid_angle);
        let Turn(cos, sin) = Turn(cos, sin).then(self.k);
        let fu = (cos * self.b0 - self.b1) / sin;
        let cu = (1.0 / (fu * fu + self.b0 * self.b0).sqrt()).copysign(fu).clamp(-1.0, 1.0);
        let xu = (-(cu * self.z0) / (1.0 - cu * cu).max(1e-30).sqrt()).clamp(self.x0, self.x1);
        let d2 = xu * xu + self.z0 * self.z0;
        let h0 = self.y0 / (d2 + self.y0 * self.y0).sqrt();
        let h1 = self.y1 / (d2 + self.y1 * self.y1).sqrt();
        let hv = h0 + f64::from(u.y) * (h1 - h0);
        let yv = (hv * (d2 / (1.0 - hv * hv).max(1e-30)).sqrt()).clamp(self.y0, self.y1);
        let uv = Vec2::new(((xu - self.x0) / (self.x1 - self.x0)) as f32, ((yv - self.y0) / (self.y1 - self.y0)) as f32);
        if uv.is_finite() { uv.clamp(Vec2::ZERO, Vec2::ONE) } else { Vec2::splat(0.5) }
    }
}
