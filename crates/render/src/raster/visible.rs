//! What a camera sees, as item buffers, and the surfaces behind their pixels.

use glam::DVec3;

use super::draw::{DrawOptions, ItemBuffer, draw};
use super::triangles::Triangles;
use super::view::{Pose, View};
use crate::accel::{Hit, Ray};
use crate::math::hash::{hash_words, unit_float};
use crate::math::{Vec2, Vec3};
use crate::scene::{Scene, Surface};

/// One picture's item buffers: one for flat pictures, six for panoramas.
pub struct Visible {
    faces: Vec<(View, ItemBuffer)>,
    flat: bool,
    offset: Vec2,
}

impl Visible {
    /// Draws what the camera sees at a sample's place in the pixel and on the lens. `salt` selects the random numbers by which
    /// surfaces are there that light may pass.
    pub fn new(scene: &Scene, triangles: &Triangles, size: [u32; 2], offset: Vec2, u_lens: Vec2, salt: u64) -> Self {
        let views = match scene.camera.view(size, u_lens) {
            Some(view) => vec![view.sampled_at(offset.as_dvec2())],
            None => {
                // As many texels round the horizon as the panorama has columns.
                let edge = (size[0] / 4).max(size[1] / 2).max(1);
                let window = [-1.0, 1.0, -1.0, 1.0];
                let pose = |face| Pose::cube_face(scene.camera.position(), face);
                (0..6).map(|face| View::perspective(pose(face), window, [edge; 2], 0.0, f64::INFINITY)).collect()
            }
        };
        let flat = views.len() == 1;
        let faces = views.into_iter().map(|view| (view, draw_scene(scene, triangles, &view, salt, None))).collect();
        Self { faces, flat, offset }
    }

    /// The triangle that a pixel's line of sight meets first: `picture` is the sample's place in pixels, `d` its direction.
    pub fn item(&self, picture: Vec2, d: Vec3) -> Option<u32> {
        if self.flat {
            let pixel = picture - self.offset;
            return self.faces[0].1.at(pixel.x as u32, pixel.y as u32).map(|(id, _)| id);
        }
        let k = largest(d);
        let (view, buffer) = &self.faces[2 * k + usize::from(d[k] < 0.0)];
        let (pixel, _) = view.project((view.pose().eye + d.as_dvec3()).as_vec3())?;
        let n = f64::from(view.size[0] - 1);
        buffer.at(pixel.x.clamp(0.0, n) as u32, pixel.y.clamp(0.0, n) as u32).map(|(id, _)| id)
    }

    /// Some hundred thousand points that the camera sees, nearest first.
    pub fn points(&self, scene: &Scene, eye: Vec3) -> Vec<Vec3> {
        let mut points: Vec<(f32, Vec3)> = Vec::new();
        for (view, buffer) in &self.faces {
            for y in 0..buffer.height {
                for x in 0..buffer.width {
                    let Some((_, depth)) = buffer.at(x, y) else { continue };
                    let (o, d) = view.line_of_sight(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
                    let p = (o + d * f64::from(view.distance(depth))).as_vec3();
                    if p.is_finite() {
                        points.push((p.distance_squared(eye), p));
                    }
                }
            }
        }
        let (center, radius) = scene.bounds.bounding_sphere();
        points.retain(|(_, p)| p.distance(center) <= 4.0 * radius);
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.into_iter().map(|(_, p)| p).collect()
    }
}

/// The axis along which a direction is longest.
#[inline]
pub(super) fn largest(d: Vec3) -> usize {
    let a = d.abs();
    if a.x >= a.y && a.x >= a.z {
        0
    } else if a.y >= a.z {
        1
    } else {
        2
    }
}

/// Draws a scene; surfaces that light may pass are there in a pixel with the probability that it does not (Enderton et al. 2010,
/// "Stochastic Transparency", doi:10.1145/1730804.1730830). `hidden` is an object that is left out: placement and number.
pub(super) fn draw_scene(scene: &Scene, triangles: &Triangles, view: &View, salt: u64, hidden: Option<(u32, u32)>) -> ItemBuffer {
    let keeps = |id: u32, x: u32, y: u32| is_there(scene, triangles, view, salt, id, x, y);
    let hides = |instance: u32, object: u32| hidden == Some((instance, object));
    let options = DrawOptions { hides: hidden.is_some().then_some(&hides), keeps: scene.has_null.then_some(&keeps) };
    draw(triangles, view, &options)
}

/// Whether a surface that light may pass stands in a pixel.
pub(super) fn is_there(scene: &Scene, triangles: &Triangles, view: &View, salt: u64, id: u32, x: u32, y: u32) -> bool {
    let (o, d) = view.line_of_sight(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
    let Some(s) = surface_at(scene, triangles, id, o, d) else { return false };
    let passes = transmittance(scene, &s, -d.as_vec3().normalize());
    let words = hash_words([salt, u64::from(id), u64::from(x) << 32 | u64::from(y)]);
    unit_float(words as u32) >= passes
}

/// The mean share of light that passes straight through a surface.
pub(super) fn transmittance(scene: &Scene, s: &Surface, wo: Vec3) -> f32 {
    let material = &scene.materials[s.material as usize];
    if material.has_null { material.shade(scene, s, wo).null_transmittance(wo).average().clamp(0.0, 1.0) } else { 0.0 }
}

/// The surface of a triangle on a line of sight that meets it, or passes nearby: points beyond its edges are moved onto them.
pub(crate) fn surface_at(scene: &Scene, triangles: &Triangles, id: u32, o: DVec3, d: DVec3) -> Option<Surface> {
    let located = triangles.locate(id)?;
    let [a, b, c] = located.corners;
    let (e1, e2) = (b - a, c - a);
    let n = e1.cross(e2);
    let t = n.dot(a - o) / n.dot(d);
    let q = if t.is_finite() { o + d * t - a } else { (e1 + e2) / 3.0 };
    let norm = n.length_squared();
    let (u, v) = (q.cross(e2).dot(n) / norm, e1.cross(q).dot(n) / norm);
    if !(u.is_finite() && v.is_finite()) {
        return None;
    }
    let (u, v) = (u.max(0.0), v.max(0.0));
    let (u, v) = if u + v > 1.0 { (u / (u + v), v / (u + v)) } else { (u, v) };
    let p = a + e1 * u + e2 * v;
    let distance = (p - o).length();
    let towards = if distance > 0.0 { (p - o) / distance } else { d.normalize() };
    let ray = Ray::new(o.as_vec3(), towards.as_vec3());
    let hit = Hit { t: distance as f32, u: u as f32, v: v as f32, prim: located.primitive, instance: located.instance };
    // The parameters of analytic shapes come from the point.
    Some(scene.surface(&ray, &hit))
}
