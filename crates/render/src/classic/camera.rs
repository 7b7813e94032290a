//! Cameras: from a point of the picture and of the lens to a ray, in double precision.
//!
//! With x to the right and y up, each in [−½, ½] across the picture, r, u, f the camera's right, up and direction and hats for unit
//! vectors, the projections are these (documentation, "Types of Projection"; lengths and defaults found by measuring POV-Ray's rays):
//!
//! | camera | ray |
//! |---|---|
//! | perspective | f + x·r + y·u |
//! | orthographic | f̂ from location + x·r + y·u |
//! | fisheye | at angle ρ·α/2 from f̂, ρ = √((2x\|r\|)² + (2y\|u\|)²) ≤ 1 |
//! | ultra_wide_angle | (sin xα, sin yβ, cos xα · cos yβ), β = α·\|u\|/\|r\| |
//! | omnimax | a fisheye whose angle is a polynomial of ρ, moved up |
//! | panoramic | (\|r\| sin πx cos πy, \|u\| sin πy, \|f\| cos πx cos πy) |
//! | cylinder | one coordinate an angle, the other a height |
//! | spherical | longitude xα, latitude yβ |

use etendue_procedural::{Context, fns};
use etendue_scene::desc::classic::{Camera, CameraKind};
use glam::{DVec2, DVec3};

use super::ClassicWorld;
use super::mesh_camera::MeshRays;
use crate::solid::Line;

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// A camera ready to make rays.
pub(super) struct Rays {
    camera: Camera,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    size: DVec2,
    /// 1 / size.
    inverse: DVec2,
    mesh: Option<MeshRays>,
}

/// Angle from the axis in omnimax pictures: coefficients of ρ, ρ³ and ρ⁵, fitted to measured rays with a residual of 1e−5.
const OMNIMAX: [f64; 3] = [1.411_28, -0.094_41, 0.256_75];
/// Vertical scale of omnimax pictures lower than this share of their width, measured.
const OMNIMAX_SCALE: f64 = 0.779_14;

impl Rays {
    pub(super) fn new(camera: Camera, size: [u32; 2]) -> Self {
        let mesh = match &camera.kind {
            CameraKind::Mesh(mesh) => Some(MeshRays::new(mesh, &camera, size)),
            _ => None,
        };
        let size = DVec2::new(f64::from(size[0].max(1)), f64::from(size[1].max(1)));
        Self {
            right: camera.right.normalize_or(DVec3::X),
            up: camera.up.normalize_or(DVec3::Y),
            forward: camera.direction.normalize_or(DVec3::Z),
            size,
            inverse: size.recip(),
            mesh,
            camera,
        }
    }

    /// Whether these are the rays of a camera for a picture of a size.
    pub(super) fn is_of(&self, camera: &Camera, size: [u32; 2]) -> bool {
        self.camera == *camera && self.size == DVec2::new(f64::from(size[0].max(1)), f64::from(size[1].max(1)))
    }

    /// Where the camera stands.
    pub(super) fn location(&self) -> DVec3 {
        self.camera.location
    }

    /// Whether rays differ by where they pass the lens.
    pub(super) fn needs_lens(&self) -> bool {
        self.camera.blur.is_on()
    }

    /// The longest ray.
    pub(super) fn max_distance(&self) -> f64 {
        self.mesh.as_ref().map_or(f64::INFINITY, MeshRays::max_distance)
    }

    /// The ray through a point of the picture in pixels, from the upper left corner; `None` where the camera sees nothing.
    pub(super) fn line(&self, world: &ClassicWorld, picture: DVec2, lens: DVec2) -> Option<Line> {
        let x = picture.x * self.inverse.x - 0.5;
        let y = 0.5 - picture.y * self.inverse.y;
        let camera = &self.camera;
        let mut o = camera.location;
        let angle = camera.angle;
        let turn = |a: f64, b: f64, c: f64| self.right * a + self.up * b + self.forward * c;
        let d = match &camera.kind {
            CameraKind::Perspective => camera.direction + camera.right * x + camera.up * y,
            CameraKind::Orthographic => {
                o += camera.right * x + camera.up * y;
                self.forward
            }
            CameraKind::Fisheye => {
                let q = DVec2::new(2.0 * x * camera.right.length(), 2.0 * y * camera.up.length());
                let rho = q.length();
                if rho > 1.0 {
                    return None;
                }
                let (sin, cos) = fns::sin_cos(rho * 0.5 * angle.unwrap_or(FRAC_PI_2));
                let q = q / rho.max(1e-12);
                turn(sin * q.x, sin * q.y, cos)
            }
            CameraKind::UltraWideAngle => {
                let alpha = angle.unwrap_or(FRAC_PI_2);
                let (sin_x, cos_x) = fns::sin_cos(x * alpha);
                let (sin_y, cos_y) = fns::sin_cos(y * alpha * camera.up.length() / camera.right.length());
                turn(sin_x, sin_y, cos_x * cos_y)
            }
            CameraKind::Omnimax => {
                let scale = (camera.up.length() / camera.right.length()).max(OMNIMAX_SCALE);
                let q = DVec2::new(2.0 * x, 2.0 * y * scale + (1.0 - scale).max(0.0));
                let rho = q.length();
                let theta = rho * (OMNIMAX[0] + rho * rho * (OMNIMAX[1] + rho * rho * OMNIMAX[2]));
                let (sin, cos) = fns::sin_cos(theta);
                let q = q / rho.max(1e-12);
                if rho > 1.0 || fns::atan2(sin * q.y, cos) < -FRAC_PI_4 {
                    return None;
                }
                turn(sin * q.x, sin * q.y, cos)
            }
            CameraKind::Panoramic => {
                let (sin_x, cos_x) = fns::sin_cos(x * PI);
                let (sin_y, cos_y) = fns::sin_cos(y * PI);
                camera.right * (sin_x * cos_y) + camera.up * sin_y + camera.direction * (cos_x * cos_y)
            }
            CameraKind::Cylinder(kind) => {
                let alpha = angle.unwrap_or(FRAC_PI_2);
                let (sin, cos) = fns::sin_cos(alpha * if kind % 2 == 1 { x } else { y });
                match kind {
                    1 => self.right * sin + camera.up * y + self.forward * cos,
                    2 => camera.right * x + self.up * sin + self.forward * cos,
                    3 => {
                        o += camera.up * y;
                        turn(sin, 0.0, cos)
                    }
                    _ => {
                        o += camera.right * x;
                        turn(0.0, sin, cos)
                    }
                }
            }
            CameraKind::Spherical => {
                let alpha = angle.unwrap_or(2.0 * PI);
                let (sin_x, cos_x) = fns::sin_cos(x * alpha);
                let (sin_y, cos_y) = fns::sin_cos(y * camera.vertical_angle.unwrap_or(0.5 * alpha));
                turn(cos_y * sin_x, sin_y, cos_y * cos_x)
            }
            CameraKind::Mesh(_) => return self.mesh.as_ref()?.line(picture),
        };
        let mut line = Line { o, d: d.normalize_or(self.forward) };
        if camera.blur.is_on() {
            self.blur(world, &mut line, d, lens);
        }
        if let Some(normal) = &camera.normal {
            let context = Context { normal: line.d, ray: line.d, ..world.context(DVec3::new(x, y, 0.0)) };
            line.d = normal.perturb(line.d, &context).normalize_or(line.d);
        }
        Some(line)
    }

    /// Moves the origin on the lens, so that rays of one point of the picture meet in the plane in focus.
    fn blur(&self, world: &ClassicWorld, line: &mut Line, through: DVec3, lens: DVec2) {
        let camera = &self.camera;
        let focal = (camera.blur.focal_point - camera.location).dot(self.forward);
        let along = through.dot(self.forward);
        if !(along.abs() > 1e-12) || !focal.is_finite() {
            return;
        }
        let focus = line.o + through * (focal / along);
        let q = match &camera.blur.bokeh {
            None => disc(lens),
            // Brightness is probability: the first of a few tries that is bright enough.
            Some(pigment) => {
                let mut u = lens;
                for i in 1..16u32 {
                    let c = pigment.color(&world.context(DVec3::new(u.x, u.y, 0.0))).rgb;
                    let threshold = fraction(lens.x * 7.31 + lens.y * 3.77 + 0.618 * f64::from(i));
                    if c.dot(DVec3::splat(1.0 / 3.0)) > threshold {
                        break;
                    }
                    u = DVec2::new(fraction(lens.x + 0.754_877_666 * f64::from(i)), fraction(lens.y + 0.569_840_291 * f64::from(i)));
                }
                u * 2.0 - 1.0
            }
        };
        line.o += (self.right * q.x + self.up * q.y) * (0.5 * camera.blur.aperture);
        line.d = (focus - line.o).normalize_or(line.d) * focal.signum();
    }
}

fn fraction(v: f64) -> f64 {
    v - v.floor()
}

/// Concentric map of the unit square to the unit disc (Shirley and Chiu 1997).
fn disc(u: DVec2) -> DVec2 {
    let q = u * 2.0 - 1.0;
    if q == DVec2::ZERO {
        return q;
    }
    let (r, phi) = if q.x.abs() > q.y.abs() { (q.x, FRAC_PI_4 * q.y / q.x) } else { (q.y, FRAC_PI_2 - FRAC_PI_4 * q.x / q.y) };
    let (sin, cos) = fns::sin_cos(phi);
    DVec2::new(cos, sin) * r
}
