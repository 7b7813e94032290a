//! Cameras of the classic model.

use etendue_procedural::{Normal, Pigment};
use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

use super::Object;

/// How a camera projects.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum CameraKind {
    /// Central projection onto a plane.
    #[default]
    Perspective,
    /// Parallel projection.
    Orthographic,
    /// Directions by their angle from the axis, within a circle.
    Fisheye,
    /// Directions by their angles on a rectangle.
    UltraWideAngle,
    /// A fisheye of 180 degrees, lower than wide.
    Omnimax,
    /// Longitude across, the tangent of the latitude up.
    Panoramic,
    /// Onto a cylinder: 1 upright, 2 lying, both from a point; 3 upright, 4 lying, with a viewpoint that moves along the axis.
    Cylinder(u8),
    /// Longitude across, latitude up.
    Spherical,
    /// One ray for each face of meshes.
    Mesh(Box<MeshCamera>),
}

/// `mesh_camera`: rays that leave faces of meshes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeshCamera {
    /// Rays in each pixel.
    pub rays_per_pixel: u32,
    /// How pixels are assigned to faces, 0 to 3.
    pub distribution: u8,
    /// Longest ray; 0 for no limit.
    pub max_distance: f64,
    /// Meshes.
    pub meshes: Vec<Arc<Object>>,
    /// Directions are interpolated from vertex normals (distribution 3).
    pub smooth: bool,
}

/// Focal blur.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FocalBlur {
    /// Diameter of the lens; 0 for a sharp picture.
    pub aperture: f64,
    /// Fewest and most rays in a pixel.
    pub samples: [u32; 2],
    /// A point of the plane in focus, which is parallel to the picture.
    pub focal_point: DVec3,
    /// Probability that a pixel is within the tolerance when sampling stops early, in [0, 1).
    pub confidence: f64,
    /// The tolerance: variance of the color.
    pub variance: f64,
    /// Shape of the lens: brightness over the unit square of x and y; `None` for a disc.
    pub bokeh: Option<Arc<Pigment>>,
}

impl FocalBlur {
    /// Whether anything is blurred.
    pub fn is_on(&self) -> bool {
        self.aperture != 0.0 && self.samples[1] > 0
    }
}

impl Default for FocalBlur {
    fn default() -> Self {
        Self { aperture: 0.0, samples: [0, 0], focal_point: DVec3::ZERO, confidence: 0.9, variance: 1e-4, bokeh: None }
    }
}

/// `camera`, ready for use: viewing angle, `look_at` and transforms are worked into the vectors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// How it projects.
    pub kind: CameraKind,
    /// Where it stands.
    pub location: DVec3,
    /// Towards the middle of the picture; its length counts for flat projections.
    pub direction: DVec3,
    /// To the right, as long as the picture is wide.
    pub right: DVec3,
    /// Up, as long as the picture is high.
    pub up: DVec3,
    /// Angle across the picture in radians, where `angle` was given.
    pub angle: Option<f64>,
    /// Angle up the picture in radians, where a second number was given (spherical cameras).
    pub vertical_angle: Option<f64>,
    /// Focal blur.
    pub blur: FocalBlur,
    /// Perturbs the rays.
    pub normal: Option<Arc<Normal>>,
}

impl Default for Camera {
    fn default() -> Self {
        Self {
            kind: CameraKind::Perspective,
            location: DVec3::ZERO,
            direction: DVec3::Z,
            right: DVec3::new(1.33, 0.0, 0.0),
            up: DVec3::Y,
            angle: None,
            vertical_angle: None,
            blur: FocalBlur::default(),
            normal: None,
        }
    }
}

impl Camera {
    /// How many rays a pixel needs, where the camera itself says it: focal blur and cameras of meshes, whose pixels are no areas.
    pub fn samples(&self) -> Option<u32> {
        match &self.kind {
            CameraKind::Mesh(mesh) if mesh.distribution < 3 => Some(mesh.rays_per_pixel.clamp(1, 4096)),
            _ if self.blur.is_on() => Some(self.blur.samples[1].clamp(1, 4096)),
            _ => None,
        }
    }

    /// Moves the camera.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        self.location = world_from_old.transform_point3(self.location);
        self.direction = world_from_old.transform_vector3(self.direction);
        self.right = world_from_old.transform_vector3(self.right);
        self.up = world_from_old.transform_vector3(self.up);
        self.blur.focal_point = world_from_old.transform_point3(self.blur.focal_point);
        if let Some(normal) = &mut self.normal {
            Arc::make_mut(normal).transform(world_from_old);
        }
        if let CameraKind::Mesh(mesh) = &mut self.kind {
            for object in &mut mesh.meshes {
                Arc::make_mut(object).transform(world_from_old);
            }
        }
    }
}
