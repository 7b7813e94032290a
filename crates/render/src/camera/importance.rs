//! The camera as a sensor: how much a picture takes of the light that arrives at the camera from a point.
//!
//! Methods that trace from the lights end their paths here. The importance is stated as a density of the picture: how many square
//! pixels an area across the line of sight fills. A path from a light that meets an area dA at a distance gives the picture's
//! integral over pixels exactly that share of it, whatever the projection (Veach 1997, section 8.3.2).

use super::{Camera, Projection};
use crate::math::{PI, Vec2, Vec3, fns};

/// How a point is seen through a point of the lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraConnection {
    /// The point of the lens (or of the plane of an orthographic camera), in world space.
    pub o: Vec3,
    /// From the point that is seen to `o`, unit.
    pub w: Vec3,
    /// Distance to `o`.
    pub dist: f32,
    /// As much of it, at the camera's end, is not looked at: the near plane cuts it off.
    pub near: f32,
    /// Where the point appears, in pixels; within the margin outside of the picture as well.
    pub picture: Vec2,
    /// Square pixels per area across the line of sight at the point.
    pub per_area: f32,
    /// At how many places of the picture and its margin the point appears: one was chosen with equal chances.
    pub places: f32,
}

impl Camera {
    /// Columns and rows of the picture.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Number of pixels of the picture.
    pub fn pixels(&self) -> f32 {
        self.size[0] as f32 * self.size[1] as f32
    }

    /// Whether it can be said where a point is seen: objectives would have to be searched for the way.
    ///
    /// # Errors
    /// What to use instead.
    pub fn check_connections(&self) -> Result<(), String> {
        match self.projection {
            Projection::Objective(_) | Projection::Blind => {
                Err("paths from lights cannot be joined to a camera with an objective; path, mnee, pathmap, sppm and photon see through it"
                    .to_owned())
            }
            _ => Ok(()),
        }
    }

    /// How the point `p` is seen through the lens at `u_lens`, if it appears in the picture or up to `margin` pixels outside of it;
    /// `u` in [0, 1) chooses one of several places at the borders of a panorama.
    pub fn connect(&self, p: Vec3, u_lens: Vec2, margin: f32, u: f32) -> Option<CameraConnection> {
        let c = self.camera_from_world.transform_point3(p);
        let q = match self.projection {
            Projection::Perspective { aperture_radius, focus_distance } => {
                let o = self.lens(aperture_radius, u_lens);
                // Through the plane of focus, on which all points of the lens see the same picture.
                let f = if aperture_radius > 0.0 { focus_distance } else { 1.0 };
                let at = o + (c - o) * (f / -c.z);
                if !(c.z < 0.0) {
                    return None;
                }
                Vec2::new(at.x, at.y) / f
            }
            Projection::Orthographic => Vec2::new(c.x, c.y),
            Projection::Objective(_) | Projection::Blind => return None,
            Projection::Panoramic => {
                let d = c.normalize_or_zero();
                let theta = fns::atan2((d.x * d.x + d.z * d.z).sqrt(), d.y);
                Vec2::new(fns::atan2(d.x, -d.z) / PI, 1.0 - theta / (0.5 * PI))
            }
        };
        let picture = (q - self.corner) / self.step;
        let (picture, places) = match self.projection {
            Projection::Panoramic => self.panoramic_place(picture, margin, u)?,
            _ => (picture, 1.0),
        };
        if !self.shows(picture, margin) {
            return None;
        }
        let ray = self.ray(picture, u_lens).ray;
        let to_camera = ray.o - p;
        let dist = to_camera.length();
        let w = to_camera / dist;
        let per_area = self.per_area(-w, dist);
        let usable = dist > ray.t_min && dist < ray.t_max && per_area > 0.0 && per_area.is_finite() && w.is_finite();
        usable.then_some(CameraConnection { o: ray.o, w, dist, near: ray.t_min, picture, per_area, places })
    }

    /// Square pixels per area across the ray at a distance along the unit direction `d` from the camera.
    pub fn per_area(&self, d: Vec3, dist: f32) -> f32 {
        if matches!(self.projection, Projection::Objective(_) | Projection::Blind) {
            return 0.0;
        }
        let cell = (self.step.x * self.step.y).abs();
        if let Projection::Orthographic = self.projection {
            let (x, y) = (self.world_from_camera.x_axis.truncate(), self.world_from_camera.y_axis.truncate());
            return 1.0 / (x.cross(y).dot(d).abs() * cell);
        }
        let local = self.camera_from_world.transform_vector3(d);
        let stretch = local.length();
        let local = local / stretch;
        let per_solid_angle = match self.projection {
            Projection::Panoramic => {
                let sin = (local.x * local.x + local.z * local.z).sqrt();
                // q runs over two units in π of height and in 2π of width.
                2.0 / (PI * PI * sin * cell)
            }
            _ => {
                let cos = -local.z;
                if cos > 0.0 { 1.0 / (cell * cos * cos * cos) } else { 0.0 }
            }
        };
        // Directions of a camera that a matrix has stretched: dω' = |det| / |M d|³ dω.
        per_solid_angle * self.determinant / (stretch * stretch * stretch) / (dist * dist)
    }

    fn shows(&self, picture: Vec2, margin: f32) -> bool {
        let (w, h) = (self.size[0] as f32, self.size[1] as f32);
        picture.x >= -margin && picture.y >= -margin && picture.x <= w + margin && picture.y <= h + margin
    }

    /// One of the places at which a panorama and its margin show a direction: it goes round, and beyond the poles on the other side.
    fn panoramic_place(&self, picture: Vec2, margin: f32, u: f32) -> Option<(Vec2, f32)> {
        let (w, h) = (self.size[0] as f32, self.size[1] as f32);
        let mut places = arrayvec::ArrayVec::<Vec2, 16>::new();
        for turned in [picture, Vec2::new(picture.x + 0.5 * w, -picture.y), Vec2::new(picture.x + 0.5 * w, 2.0 * h - picture.y)] {
            for round in [-2.0, -1.0, 0.0, 1.0] {
                let place = Vec2::new(turned.x + round * w, turned.y);
                if self.shows(place, margin) {
                    places.push(place);
                }
            }
        }
        let count = places.len() as f32;
        places.get((u * count) as usize).map(|&place| (place, count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{mix32, unit_float};
    use crate::math::{Mat4, PI, warp};
    use etendue_scene::desc::{CameraDesc, FovAxis, ProjectionDesc};

    fn cameras() -> Vec<(&'static str, Camera)> {
        let placed = Mat4::from_translation(Vec3::new(1.0, -2.0, 0.5)) * Mat4::from_rotation_y(0.7) * Mat4::from_rotation_x(-0.4);
        let skewed = placed * Mat4::from_cols_array(&[-2.0, 0.0, 0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.1, 0.0, 1.5, 0.0, 0.0, 0.0, 0.0, 1.0]);
        let perspective = |aperture_radius| ProjectionDesc::Perspective {
            fov_rad: 1.2,
            fov_axis: FovAxis::X,
            aperture_radius,
            focus_distance: 3.0,
            principal_point_offset: [0.1, -0.05],
        };
        let make = |projection, world_from_camera| {
            let desc = CameraDesc { world_from_camera, projection, ..CameraDesc::default() };
            Camera::new(&desc, 60, 40)
        };
        vec![
            ("pinhole", make(perspective(0.0), placed)),
            ("skewed pinhole", make(perspective(0.0), skewed)),
            ("lens", make(perspective(0.3), placed)),
            ("skewed lens", make(perspective(0.3), skewed)),
            ("orthographic", make(ProjectionDesc::Orthographic { half_width: 2.0, half_height: None }, placed)),
            ("skewed orthographic", make(ProjectionDesc::Orthographic { half_width: 2.0, half_height: Some(1.0) }, skewed)),
            ("panoramic", make(ProjectionDesc::Panoramic, placed)),
            ("skewed panoramic", make(ProjectionDesc::Panoramic, skewed)),
        ]
    }

    fn rnd(i: u32) -> f32 {
        unit_float(mix32(i))
    }

    #[test]
    fn points_on_rays_are_seen_where_the_rays_start() {
        for (name, camera) in cameras() {
            for i in 0..500 {
                // Not so near to the edge that rounding moves it out.
                let picture = Vec2::new(1.0 + rnd(i) * 58.0, 1.0 + rnd(i + 1000) * 38.0);
                let u_lens = Vec2::new(rnd(i + 2000), rnd(i + 3000));
                let ray = camera.ray(picture, u_lens).ray;
                let dist = 0.5 + 5.0 * rnd(i + 4000);
                let seen = camera.connect(ray.at(dist), u_lens, 0.0, 0.0).unwrap();
                assert!((seen.picture - picture).length() < 2e-2, "{name}: {picture} is seen at {}", seen.picture);
                assert!((seen.o - ray.o).length() < 1e-3 && (seen.w + ray.d).length() < 1e-3 && (seen.dist - dist).abs() < 1e-3, "{name}");
                assert!((seen.per_area / camera.per_area(ray.d, dist) - 1.0).abs() < 1e-2);
            }
        }
    }

    /// The density is that of the rays: neighboring points of the picture span the area that it says.
    #[test]
    fn per_area_is_what_neighboring_rays_span() {
        for (name, camera) in cameras() {
            for i in 0..200 {
                let (picture, u_lens) = (Vec2::new(rnd(i) * 60.0, 1.0 + rnd(i + 1000) * 38.0), Vec2::new(rnd(i + 2000), rnd(i + 3000)));
                let ray = camera.ray(picture, u_lens).ray;
                let dist = 4.0;
                let h = 0.5;
                // Where a ray next to it meets the plane across the ray at the distance.
                let at = |dx: f32, dy: f32| {
                    let r = camera.ray(picture + Vec2::new(dx, dy), u_lens).ray;
                    r.at((ray.at(dist) - r.o).dot(ray.d) / r.d.dot(ray.d))
                };
                let area = (at(h, 0.0) - at(-h, 0.0)).cross(at(0.0, h) - at(0.0, -h)).length() / (4.0 * h * h);
                let per_area = camera.per_area(ray.d, dist);
                assert!((per_area * area - 1.0).abs() < 0.02, "{name} at {picture}: {} instead of {}", per_area, 1.0 / area);
            }
        }
    }

    /// The integral over a sphere around the camera is the number of pixels.
    #[test]
    fn the_integral_of_the_importance_is_the_number_of_pixels() {
        for (name, camera) in cameras().into_iter().filter(|(n, _)| !n.contains("orthographic")) {
            let (n, radius) = (400_000, 20.0);
            let mut sum = 0.0;
            for i in 0..n {
                let u = Vec2::new((i as f32 + 0.5) / n as f32, rnd(i));
                let u_lens = Vec2::new(rnd(i + 2_000_000), rnd(i + 4_000_000));
                let o = camera.ray(Vec2::ZERO, u_lens).ray.o;
                if let Some(seen) = camera.connect(o + warp::uniform_sphere(u) * radius, u_lens, 0.0, rnd(i + 6_000_000)) {
                    sum += f64::from(seen.per_area * seen.places * 4.0 * PI * radius * radius) / f64::from(n);
                }
            }
            assert!((sum / 2400.0 - 1.0).abs() < 0.02, "{name}: {sum} pixels");
        }
    }

    #[test]
    fn nothing_is_seen_behind_the_camera_or_outside_of_the_picture() {
        for (name, camera) in cameras().into_iter().filter(|(n, _)| *n == "pinhole" || *n == "lens") {
            let u_lens = Vec2::splat(0.5);
            let ray = camera.ray(Vec2::new(30.0, 20.0), u_lens).ray;
            assert!(camera.connect(ray.at(-2.0), u_lens, 100.0, 0.0).is_none(), "{name}");
            let outside = camera.ray(Vec2::new(-2.0, 20.0), u_lens).ray;
            assert!(camera.connect(outside.at(2.0), u_lens, 1.0, 0.0).is_none());
            assert!(camera.connect(outside.at(2.0), u_lens, 3.0, 0.0).is_some());
            assert!(camera.connect(Vec3::NAN, u_lens, 3.0, 0.0).is_none() && camera.connect(ray.o, u_lens, 3.0, 0.0).is_none());
        }
    }
}
