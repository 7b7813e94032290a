//! Looking at a compiled scene from elsewhere: the camera is moved, all else stays as it was compiled.

use etendue_scene::desc::classic::{Camera as ClassicCamera, CameraKind};
use etendue_scene::desc::{CameraDesc, ProjectionDesc, SceneDesc};
use etendue_scene::{Fault, RenderSettings, Severity, Span};
use glam::{DMat4, DVec3};

use super::{Scene, compile};
use crate::camera::Camera;
use crate::classic::physical;

/// Where to look from in place of the file's camera, whose projection is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Places the camera in the world: +x right, +y up, looking along −z.
    pub world_from_camera: DMat4,
    /// How many times larger things appear than with the file's angle of view. Perspective and parallel projections heed it.
    pub zoom: f64,
}

impl View {
    /// A view, if its numbers make sense: finite, not flattened, and a zoom above 0.
    pub fn new(world_from_camera: DMat4, zoom: f64) -> Option<Self> {
        let is_sane = world_from_camera.is_finite() && world_from_camera.determinant().abs() > 1e-30;
        (is_sane && zoom.is_finite() && zoom > 1e-6 && zoom < 1e6).then_some(Self { world_from_camera, zoom })
    }

    /// The view of the file's camera.
    ///
    /// # Errors
    /// A fault where there is no such camera.
    pub fn of(desc: &SceneDesc, settings: &RenderSettings) -> Result<Self, Vec<Fault>> {
        let world_from_camera = match &desc.classic {
            Some(classic) => classic_pose(&classic.camera),
            None => compile::camera(desc, settings)?.world_from_camera.as_dmat4(),
        };
        Ok(Self { world_from_camera, zoom: 1.0 })
    }
}

impl Scene {
    /// Looks at the scene from a view, or from the file's camera, for a picture of the given size. What the compiled scene holds beside
    /// the camera does not change, except for the light that the classic model gathers for one picture.
    ///
    /// # Errors
    /// A fault where the description has no such camera.
    pub fn look(&mut self, desc: &SceneDesc, settings: &RenderSettings, size: [u32; 2], view: Option<View>) -> Result<(), Vec<Fault>> {
        let fault = |message| vec![Fault { severity: Severity::Error, span: Span::default(), message }];
        if let Some(classic) = &desc.classic {
            let mut camera = classic.camera.clone();
            if let Some(view) = view {
                move_classic(&mut camera, &view);
            }
            match &mut self.classic {
                Some(world) => world.set_camera(camera, size),
                None => {
                    self.camera = Camera::new(&physical::camera(&camera, size).map_err(fault)?, size[0], size[1]);
                    if let Some(solids) = &mut self.solids {
                        solids.set_camera(camera, size);
                    }
                }
            }
        } else {
            let mut camera = compile::camera(desc, settings)?.clone();
            if let Some(view) = view {
                move_camera(&mut camera, &view).map_err(fault)?;
            }
            self.camera = compile::eye(desc, &camera, size)?;
        }
        self.view = view;
        Ok(())
    }
}

fn move_camera(camera: &mut CameraDesc, view: &View) -> Result<(), String> {
    let moved = view.world_from_camera.as_mat4();
    if !moved.is_finite() {
        return Err("the camera is too far away".to_owned());
    }
    camera.world_from_camera = moved;
    let zoom = view.zoom as f32;
    match &mut camera.projection {
        ProjectionDesc::Perspective { fov_rad, .. } => {
            *fov_rad = 2.0 * crate::math::fns::atan(crate::math::fns::tan(0.5 * *fov_rad) / zoom);
        }
        ProjectionDesc::Orthographic { half_width, half_height } => {
            *half_width /= zoom;
            *half_height = half_height.map(|h| h / zoom);
        }
        // An objective has the focal length that its lenses give it.
        ProjectionDesc::Panoramic | ProjectionDesc::Objective(_) => {}
    }
    Ok(())
}

/// Unit axes and place of a classic camera. POV-Ray's space is left-handed, and so are these axes then.
fn classic_pose(camera: &ClassicCamera) -> DMat4 {
    let right = camera.right.normalize_or(DVec3::X);
    let up = camera.up.normalize_or(DVec3::Y);
    let back = -camera.direction.normalize_or(DVec3::Z);
    DMat4::from_cols(right.extend(0.0), up.extend(0.0), back.extend(0.0), camera.location.extend(1.0))
}

fn move_classic(camera: &mut ClassicCamera, view: &View) {
    let old = classic_pose(camera);
    // Axes in one plane show nothing from anywhere.
    if old.determinant().abs() < 1e-12 {
        return;
    }
    camera.transform(&(view.world_from_camera * old.inverse()));
    if matches!(camera.kind, CameraKind::Perspective | CameraKind::Orthographic) {
        camera.right /= view.zoom;
        camera.up /= view.zoom;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absurd_views_are_refused() {
        let good = DMat4::from_translation(DVec3::new(1.0, 2.0, 3.0));
        assert!(View::new(good, 1.0).is_some());
        for zoom in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e9] {
            assert_eq!(View::new(good, zoom), None, "{zoom}");
        }
        assert_eq!(View::new(DMat4::ZERO, 1.0), None);
        assert_eq!(View::new(good * f64::NAN, 1.0), None);
    }

    #[test]
    fn the_own_view_moves_nothing_and_zoom_narrows() {
        let camera = ClassicCamera {
            location: DVec3::new(1.0, 2.0, -5.0),
            direction: DVec3::new(0.3, -0.2, 1.5),
            right: DVec3::new(1.6, 0.0, -0.32),
            ..ClassicCamera::default()
        };
        let view = View { world_from_camera: classic_pose(&camera), zoom: 1.0 };
        let mut moved = camera.clone();
        move_classic(&mut moved, &view);
        for (a, b) in [(moved.location, camera.location), (moved.direction, camera.direction), (moved.right, camera.right)] {
            assert!((a - b).length() < 1e-12, "{a} {b}");
        }
        move_classic(&mut moved, &View { zoom: 2.0, ..view });
        assert!((moved.right.length() - 0.5 * camera.right.length()).abs() < 1e-12);
    }
}
