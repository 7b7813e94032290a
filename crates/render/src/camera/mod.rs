//! Cameras: from a point of the picture and of the lens to a ray.
//!
//! Camera space: +x right, +y up, looking along −z. Picture space: pixels, (0, 0) the upper left corner.

mod importance;
mod objective;
mod stop;

pub use importance::CameraConnection;
pub use stop::StopPicture;

use std::sync::Arc;

use etendue_scene::desc::{CameraDesc, FovAxis, ProjectionDesc};
use objective::Objective;

use crate::accel::Ray;
use crate::math::{Mat3, Mat4, PI, TAU, Vec2, Vec3, fns, warp};
use crate::raster::{Pose, View};

/// A ray of the camera.
#[derive(Clone, Copy, Debug)]
pub struct CameraRay {
    /// The ray; its direction is unit.
    pub ray: Ray,
    /// What the radiance is multiplied by: 1 but for objectives, whose pictures show the irradiance of their film. 0: nothing is seen, as a
    /// ray of the film does not come through.
    pub weight: f32,
    /// The point of the picture, in pixels from the upper left corner.
    pub picture: Vec2,
    /// Where on the lens, in [0, 1)².
    pub u_lens: Vec2,
    /// Angle of the cone that a pixel spans, in radians (Akenine-Möller et al. 2019, Ray Tracing Gems ch. 20).
    pub spread_rad: f32,
}

impl CameraRay {
    /// A point of the picture (in pixels) and of the lens alone, for methods that make their own rays of it.
    #[inline]
    pub fn without_ray(picture: Vec2, u_lens: Vec2) -> Self {
        let ray = Ray { o: Vec3::ZERO, d: Vec3::NEG_Z, t_min: 0.0, t_max: 0.0 };
        Self { ray, weight: 1.0, picture, u_lens, spread_rad: 0.0 }
    }
}

#[derive(Clone, Debug)]
enum Projection {
    /// `corner + x·dx + y·dy` is the point of the picture on the plane z = −1.
    Perspective {
        aperture_radius: f32,
        focus_distance: f32,
    },
    /// The same on the plane z = 0.
    Orthographic,
    Panoramic,
    /// The point of the picture is on the film, of which half has the edges 1.
    Objective(Arc<Objective>),
    /// Sees nothing.
    Blind,
}

/// A camera ready to make rays for a picture of a given size.
#[derive(Clone, Debug)]
pub struct Camera {
    size: [u32; 2],
    world_from_camera: Mat4,
    camera_from_world: Mat4,
    /// |det| of the matrix `camera_from_world` of directions.
    determinant: f32,
    projection: Projection,
    corner: Vec2,
    step: Vec2,
    near: f32,
    far: f32,
    spread_rad: f32,
}

impl Camera {
    /// Prepares a camera for a picture of `width` × `height` pixels. A stop that is a picture lets through what a circle does: see
    /// [`Self::with_stop`].
    pub fn new(desc: &CameraDesc, width: u32, height: u32) -> Self {
        Self::with_stop(desc, None, width, height)
    }

    /// The same with the picture of the objective's stop, where it has one.
    pub fn with_stop(desc: &CameraDesc, stop: Option<StopPicture>, width: u32, height: u32) -> Self {
        let (w, h) = (width.max(1) as f32, height.max(1) as f32);
        let (projection, half, offset) = match &desc.projection {
            &ProjectionDesc::Perspective { fov_rad, fov_axis, aperture_radius, focus_distance, principal_point_offset } => {
                let t = fns::tan(0.5 * fov_rad);
                let half_width = match fov_axis {
                    FovAxis::X => t,
                    FovAxis::Y => t * w / h,
                    FovAxis::Smaller => t * (w / h).max(1.0),
                    FovAxis::Larger => t * (w / h).min(1.0),
                    FovAxis::Diagonal => t * w / (w * w + h * h).sqrt(),
                };
                let half = Vec2::new(half_width, half_width * h / w);
                (Projection::Perspective { aperture_radius, focus_distance }, half, Vec2::from(principal_point_offset))
            }
            &ProjectionDesc::Orthographic { half_width, half_height } => {
                (Projection::Orthographic, Vec2::new(half_width, half_height.unwrap_or(half_width * h / w)), Vec2::ZERO)
            }
            ProjectionDesc::Panoramic => (Projection::Panoramic, Vec2::ONE, Vec2::ZERO),
            ProjectionDesc::Objective(o) => {
                let objective = Objective::new(o, stop, w / h).map_or(Projection::Blind, |o| Projection::Objective(o.into()));
                (objective, Vec2::ONE, Vec2::ZERO)
            }
        };
        let step = Vec2::new(2.0 * half.x / w, -2.0 * half.y / h);
        // The offset moves the optical axis within the picture, so the picture's plane moves the other way.
        let corner = Vec2::new(-half.x, half.y) - Vec2::new(offset.x * w * step.x, offset.y * h * step.y);
        let spread_rad = match &projection {
            Projection::Perspective { .. } => fns::atan(step.y.abs()),
            Projection::Orthographic => 0.0,
            Projection::Panoramic => PI / h,
            Projection::Objective(o) => fns::atan(2.0 * o.film().y / h / o.distance),
            Projection::Blind => 0.0,
        };
        let camera_from_world = desc.world_from_camera.inverse();
        Self {
            size: [width.max(1), height.max(1)],
            world_from_camera: desc.world_from_camera,
            camera_from_world,
            determinant: Mat3::from_mat4(camera_from_world).determinant().abs(),
            projection,
            corner,
            step,
            near: desc.near,
            far: desc.far,
            spread_rad,
        }
    }

    /// A point of the lens in camera space.
    fn lens(&self, radius: f32, u_lens: Vec2) -> Vec3 {
        if radius > 0.0 { (warp::disk_concentric(u_lens) * radius).extend(0.0) } else { Vec3::ZERO }
    }

    /// The ray through a point of the picture (in pixels) and of the lens (`u_lens` in [0, 1)²).
    pub fn ray(&self, picture: Vec2, u_lens: Vec2) -> CameraRay {
        let q = self.corner + picture * self.step;
        let mut weight = 1.0;
        let (o, d) = match &self.projection {
            &Projection::Perspective { aperture_radius, focus_distance } => {
                let d = Vec3::new(q.x, q.y, -1.0);
                if aperture_radius > 0.0 {
                    let o = self.lens(aperture_radius, u_lens);
                    (o, d * focus_distance - o)
                } else {
                    (Vec3::ZERO, d)
                }
            }
            Projection::Orthographic => (Vec3::new(q.x, q.y, 0.0), -Vec3::Z),
            Projection::Panoramic => {
                // q runs over [−1, 1]² with +y up.
                let (sin_phi, cos_phi) = fns::sin_cos(q.x * 0.5 * TAU);
                let (sin_theta, cos_theta) = fns::sin_cos(0.5 * PI * (1.0 - q.y));
                (Vec3::ZERO, Vec3::new(sin_theta * sin_phi, cos_theta, -sin_theta * cos_phi))
            }
            Projection::Objective(objective) => {
                let passed = objective.ray(q, u_lens);
                weight = passed.map_or(0.0, |p| p.weight);
                passed.map_or((Vec3::ZERO, Vec3::NEG_Z), |p| (p.o, p.d))
            }
            Projection::Blind => {
                weight = 0.0;
                (Vec3::ZERO, Vec3::NEG_Z)
            }
        };
        // Near and far are depths along the axis for flat projections, distances all round.
        let forward = d.normalize();
        let depth = if matches!(self.projection, Projection::Panoramic) { 1.0 } else { -forward.z };
        let scale = |z: f32| if z > 0.0 && depth > 0.0 { z / depth } else { 0.0 };
        let o_world = self.world_from_camera.transform_point3(o);
        let d_world = self.world_from_camera.transform_vector3(forward);
        let stretch = d_world.length();
        let t_max = if self.far.is_finite() { scale(self.far) * stretch } else { f32::INFINITY };
        let ray = Ray { o: o_world, d: d_world / stretch, t_min: scale(self.near) * stretch, t_max };
        CameraRay { ray, weight, picture, u_lens, spread_rad: self.spread_rad }
    }
}

impl Camera {
    /// What a picture of `size` pixels shows through one point of the lens (`u_lens` in [0, 1)²), for the z-buffer; `None` for
    /// cameras whose picture is not flat.
    pub fn view(&self, size: [u32; 2], u_lens: Vec2) -> Option<View> {
        let m = self.world_from_camera.as_dmat4();
        let [right, up, back, eye] = [m.x_axis, m.y_axis, m.z_axis, m.w_axis].map(glam::DVec4::truncate);
        let far_corner = self.corner + Vec2::new(size[0] as f32, size[1] as f32) * self.step;
        // What is at distance 1 moves against the lens's point by what it takes to meet in the plane of focus.
        let (lens, shift) = match self.projection {
            Projection::Perspective { aperture_radius, focus_distance } if aperture_radius > 0.0 => {
                let lens = warp::disk_concentric(u_lens) * aperture_radius;
                (lens, lens / focus_distance)
            }
            _ => (Vec2::ZERO, Vec2::ZERO),
        };
        let (a, b) = ((self.corner - shift).as_dvec2(), (far_corner - shift).as_dvec2());
        let window = [a.x, b.x, b.y, a.y];
        let lens = lens.as_dvec2();
        let pose = Pose { eye: eye + right * lens.x + up * lens.y, right, up, forward: -back };
        let (near, far) = (f64::from(self.near), f64::from(self.far));
        match self.projection {
            Projection::Perspective { .. } => Some(View::perspective(pose, window, size, near, far)),
            Projection::Orthographic => Some(View::orthographic(pose, window, size, near.max(0.0), far)),
            Projection::Panoramic | Projection::Objective(_) | Projection::Blind => None,
        }
    }

    /// Where the camera is.
    pub fn position(&self) -> Vec3 {
        self.world_from_camera.w_axis.truncate()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn desc(projection: ProjectionDesc) -> CameraDesc {
        CameraDesc { world_from_camera: Mat4::IDENTITY, projection, near: 0.0, far: f32::INFINITY, medium: None }
    }

    fn perspective(fov_axis: FovAxis, aperture_radius: f32) -> CameraDesc {
        desc(ProjectionDesc::Perspective {
            fov_rad: PI / 2.0,
            fov_axis,
            aperture_radius,
            focus_distance: 3.0,
            principal_point_offset: [0.0; 2],
        })
    }

    #[test]
    fn perspective_looks_along_minus_z_with_right_at_plus_x() {
        let camera = Camera::new(&perspective(FovAxis::X, 0.0), 200, 100);
        let at = |x: f32, y: f32| camera.ray(Vec2::new(x, y), Vec2::ZERO).ray.d;
        assert!((at(100.0, 50.0) - -Vec3::Z).length() < 1e-6);
        let right = at(200.0, 50.0);
        assert!((right.x / -right.z - 1.0).abs() < 1e-5, "the edge of a 90 degree view is at 45 degrees");
        let top = at(100.0, 0.0);
        assert!((top.y / -top.z - 0.5).abs() < 1e-5);
        let camera = Camera::new(&perspective(FovAxis::Y, 0.0), 200, 100);
        let top = camera.ray(Vec2::new(100.0, 0.0), Vec2::ZERO).ray.d;
        assert!((top.y / -top.z - 1.0).abs() < 1e-5);
    }

    #[test]
    fn thin_lens_rays_meet_in_the_plane_of_focus() {
        let sharp = Camera::new(&perspective(FovAxis::X, 0.0), 64, 64).ray(Vec2::new(10.0, 20.0), Vec2::ZERO).ray;
        let focus = sharp.at(3.0 / -sharp.d.z);
        let camera = Camera::new(&perspective(FovAxis::X, 0.4), 64, 64);
        for u in [Vec2::new(0.1, 0.9), Vec2::new(0.7, 0.3)] {
            let ray = camera.ray(Vec2::new(10.0, 20.0), u).ray;
            let t = (-3.0 - ray.o.z) / ray.d.z;
            assert!((ray.at(t) - focus).length() < 1e-5);
            assert!(ray.o.length() <= 0.4 && ray.o.length() > 0.0);
        }
    }

    #[test]
    fn panorama_covers_the_sphere() {
        let camera = Camera::new(&desc(ProjectionDesc::Panoramic), 64, 32);
        let at = |x: f32, y: f32| camera.ray(Vec2::new(x, y), Vec2::ZERO).ray.d;
        assert!((at(32.0, 16.0) - -Vec3::Z).length() < 1e-5);
        assert!((at(48.0, 16.0) - Vec3::X).length() < 1e-5);
        assert!((at(10.0, 0.0) - Vec3::Y).length() < 1e-5);
    }
}
