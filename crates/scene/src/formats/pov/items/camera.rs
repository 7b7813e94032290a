//! `camera`.
//!
//! Words may stand in any order: they are collected first; then the viewing angle sets the length of `direction`, `look_at` turns the
//! camera, and the transforms move it, in this order wherever they stood. That is what POV-Ray 3.7 does (measured).

use std::sync::Arc;

use glam::{DMat4, DVec3};

use super::super::value::Value;
use super::super::{Parse, Parser};
use crate::desc::classic::{Camera, CameraKind, MeshCamera, Solid};

/// What stands between the braces, before it is worked into vectors.
#[derive(Default)]
struct Words {
    camera: Camera,
    sky: Option<DVec3>,
    look_at: Option<DVec3>,
    /// `angle` was written, perhaps without a number (orthographic).
    angle_word: bool,
    /// `right` or `up` was written, here or in the camera that this one is a copy of.
    size_word: bool,
    smooth: bool,
    transform: Option<DMat4>,
}

const WORDS: &[&str] = &[
    "perspective",
    "orthographic",
    "fisheye",
    "ultra_wide_angle",
    "omnimax",
    "panoramic",
    "cylinder",
    "spherical",
    "mesh_camera",
    "location",
    "direction",
    "right",
    "up",
    "sky",
    "angle",
    "look_at",
    "blur_samples",
    "aperture",
    "focal_point",
    "confidence",
    "variance",
    "bokeh",
    "smooth",
];

impl Parser {
    /// `camera { … }`.
    pub(crate) fn camera(&mut self) -> Parse<Camera> {
        self.expect("camera")?;
        self.expect("{")?;
        let mut words = Words::default();
        if let Some(camera) = self.accept_value(|v| if let Value::Camera(c) = v { Some(c.clone()) } else { None })? {
            words.camera = Arc::unwrap_or_clone(camera);
            words.size_word = true;
        }
        while !self.accept("}")? {
            if let Some(word) = self.accept_any(WORDS)? {
                self.camera_word(word, &mut words)?;
            } else if let Some(m) = self.accept_transform()? {
                words.transform = Some(m * words.transform.unwrap_or(DMat4::IDENTITY));
            } else if matches!(self.peek()?, super::super::Token::Word("normal")) {
                words.camera.normal = Some(Arc::new(self.normal()?));
            } else {
                return Err(self.unexpected("a camera"));
            }
        }
        self.finish_camera(words)
    }

    fn camera_word(&mut self, word: &str, words: &mut Words) -> Parse<()> {
        let camera = &mut words.camera;
        match word {
            "perspective" => camera.kind = CameraKind::Perspective,
            "orthographic" => camera.kind = CameraKind::Orthographic,
            "fisheye" => camera.kind = CameraKind::Fisheye,
            "ultra_wide_angle" => camera.kind = CameraKind::UltraWideAngle,
            "omnimax" => camera.kind = CameraKind::Omnimax,
            "panoramic" => camera.kind = CameraKind::Panoramic,
            "spherical" => camera.kind = CameraKind::Spherical,
            "cylinder" => {
                let span = self.span();
                let kind = self.float()?;
                if !(1.0..=4.0).contains(&kind) {
                    return Err(self.error(span, format!("a cylinder camera is of type 1, 2, 3 or 4, not {kind}")));
                }
                camera.kind = CameraKind::Cylinder(kind as u8);
            }
            "mesh_camera" => camera.kind = CameraKind::Mesh(Box::new(self.mesh_camera()?)),
            "location" => camera.location = self.vector3()?,
            "direction" => camera.direction = self.vector3()?,
            "right" => {
                camera.right = self.vector3()?;
                words.size_word = true;
            }
            "up" => {
                camera.up = self.vector3()?;
                words.size_word = true;
            }
            "sky" => words.sky = Some(self.vector3()?),
            "look_at" => words.look_at = Some(self.vector3()?),
            "angle" => {
                words.angle_word = true;
                if camera.kind != CameraKind::Orthographic || self.at_float()? {
                    let span = self.span();
                    let degrees = self.float()?;
                    if !(degrees > 0.0) {
                        return Err(self.error(span, format!("an angle of {degrees} degrees shows nothing")));
                    }
                    camera.angle = Some(degrees.to_radians());
                }
                if camera.kind == CameraKind::Spherical {
                    self.comma()?;
                    if self.at_float()? {
                        camera.vertical_angle = Some(self.float()?.to_radians());
                    }
                }
            }
            "blur_samples" => {
                let first = self.float()?.clamp(0.0, 1e6) as u32;
                self.comma()?;
                camera.blur.samples = if self.at_float()? {
                    let most = self.float()?.clamp(0.0, 1e6) as u32;
                    [first.min(most), most]
                } else {
                    [4.min(first), first]
                };
            }
            "aperture" => camera.blur.aperture = self.float()?,
            "focal_point" => camera.blur.focal_point = self.vector3()?,
            "confidence" => camera.blur.confidence = self.float()?,
            "variance" => camera.blur.variance = self.float()?,
            "bokeh" => {
                self.expect("{")?;
                camera.blur.bokeh = Some(Arc::new(self.pigment()?));
                self.expect("}")?;
            }
            _ => words.smooth = true,
        }
        Ok(())
    }

    fn mesh_camera(&mut self) -> Parse<MeshCamera> {
        self.expect("{")?;
        let rays_per_pixel = self.float()?.clamp(1.0, 65536.0) as u32;
        self.comma()?;
        let distribution = self.float()?.clamp(0.0, 3.0) as u8;
        self.comma()?;
        let max_distance = if self.at_float()? { self.float()? } else { 0.0 };
        let mut meshes = Vec::new();
        let mut smooth = false;
        while !self.accept("}")? {
            self.comma()?;
            if self.accept("smooth")? {
                smooth = true;
                continue;
            }
            let object = self.object()?;
            meshes.push(Arc::new(object));
        }
        Ok(MeshCamera { rays_per_pixel, distribution, max_distance, meshes, smooth })
    }

    /// Angle, then `look_at`, then transforms.
    fn finish_camera(&mut self, words: Words) -> Parse<Camera> {
        let Words { mut camera, sky, look_at, angle_word, size_word, smooth, transform } = words;
        let span = self.span();
        match &mut camera.kind {
            CameraKind::Perspective | CameraKind::Orthographic => {
                if let Some(angle) = camera.angle {
                    if angle >= std::f64::consts::PI {
                        return Err(self.error(span, "the angle of a flat camera is less than 180 degrees"));
                    }
                    let length = 0.5 * camera.right.length() / etendue_procedural::fns::tan(0.5 * angle);
                    camera.direction = camera.direction.normalize_or(DVec3::Z) * length;
                }
            }
            CameraKind::Mesh(mesh) => mesh.smooth |= smooth,
            _ => {}
        }
        if let Some(target) = look_at {
            aim(&mut camera, target, sky.unwrap_or(DVec3::Y));
        }
        if camera.kind == CameraKind::Orthographic && (angle_word || !size_word) {
            // The same view as the perspective camera's at the distance of the point looked at.
            let distance = look_at.map_or(1.0, |p| (p - camera.location).length());
            let length = camera.direction.length();
            if length > 0.0 && distance > 0.0 {
                camera.right *= distance / length;
                camera.up *= distance / length;
            }
        }
        if let Some(m) = transform {
            camera.transform(&m);
        }
        let vectors = [camera.location, camera.direction, camera.right, camera.up, camera.blur.focal_point];
        if vectors.iter().any(|v| !v.is_finite()) {
            return Err(self.error(span, "a vector of the camera is not finite"));
        }
        if let CameraKind::Mesh(mesh) = &camera.kind
            && mesh.meshes.iter().any(|m| matches!(m.solid, Solid::Light(_)))
        {
            return Err(self.error(span, "a mesh camera takes meshes"));
        }
        Ok(camera)
    }
}

/// Turns the camera to a point, keeping the lengths of its vectors and its handedness.
fn aim(camera: &mut Camera, target: DVec3, sky: DVec3) {
    let forward = (target - camera.location).normalize_or_zero();
    if forward == DVec3::ZERO {
        return;
    }
    let [direction, right, up] = [camera.direction.length(), camera.right.length(), camera.up.length()];
    // Vectors in one plane count as mirrored (measured).
    let mirrored = !(camera.up.cross(camera.direction).dot(camera.right) > 0.0);
    let aside = sky.cross(forward);
    // Looking along the sky vector there is no horizon to keep level: the old right stays.
    let aside = if aside.length() > 1e-10 * sky.length() { aside.normalize() } else { camera.right.normalize_or(DVec3::X) };
    camera.direction = forward * direction;
    camera.up = forward.cross(aside) * up;
    camera.right = aside * if mirrored { -right } else { right };
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(text: &str) -> Camera {
        let mut parser = Parser::from_text(text);
        assert!(parser.parse_scene().is_ok(), "{text}");
        parser.scene.camera
    }

    #[test]
    fn vectors_in_one_plane_are_mirrored() {
        let from_above = camera("camera { location y*3 up z right x sky z look_at 0 }");
        assert!((from_above.right - DVec3::NEG_X).length() < 1e-12 && (from_above.up - DVec3::Z).length() < 1e-12);
        let turned = camera("camera { location -z*3 up y right x look_at 0 }");
        assert!((turned.right - DVec3::X).length() < 1e-12);
    }

    #[test]
    fn copies_of_orthographic_cameras_keep_their_size() {
        let text = "#declare C = camera { orthographic angle 15 location <20, 20, -20> right x*4/3 look_at 0 }";
        let first = camera(&format!("{text} camera {{ C }}"));
        let again = camera(&format!("{text} #declare D = camera {{ C }} camera {{ D translate x }}"));
        assert_eq!(first.right.length(), again.right.length());
        // 2 · √1200 · tan 7.5°
        assert!((first.right.length() - 9.1212).abs() < 1e-3, "{}", first.right.length());
    }
}
