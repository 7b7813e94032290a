//! Cameras, film and integrator as files describe them.

use glam::Mat4;
use serde::{Deserialize, Serialize};

use super::{MediumId, ObjectiveDesc};

/// Along which edge of the picture a field of view is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum FovAxis {
    /// Width.
    #[default]
    X,
    /// Height.
    Y,
    /// The shorter edge.
    Smaller,
    /// The longer edge.
    Larger,
    /// The diagonal.
    Diagonal,
}

/// How a camera projects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ProjectionDesc {
    /// Central perspective; a thin lens where `aperture_radius` > 0.
    Perspective {
        /// Full field of view along `fov_axis`.
        fov_rad: f32,
        /// What the field of view spans.
        fov_axis: FovAxis,
        /// Radius of the lens; 0 is a pinhole.
        aperture_radius: f32,
        /// Distance of the plane in focus.
        focus_distance: f32,
        /// Shift of the picture's middle in units of its width and height, to the right and down: with (0.1, 0) the middle pixel sees what
        /// lay a tenth of the width to the right of it.
        principal_point_offset: [f32; 2],
    },
    /// Parallel projection.
    Orthographic {
        /// Half of the width of the visible region, in scene units.
        half_width: f32,
        /// Half of the height; `None`: from the picture's aspect ratio.
        half_height: Option<f32>,
    },
    /// All directions in latitude and longitude; the middle of the picture looks along −z.
    Panoramic,
    /// Through the lenses of an objective; the film is in the origin. What a pixel shows is the irradiance of the film.
    Objective(ObjectiveDesc),
}

impl ProjectionDesc {
    /// The thin lens that comes nearest, for formats without objectives; others as they are.
    #[must_use]
    pub fn without_objective(&self) -> Self {
        let Self::Objective(objective) = self else { return self.clone() };
        let thick = objective.thick_lens();
        let (focal_length, beyond) = thick.map_or((1.0, 0.0), |t| (t.focal_length as f32, t.principal[1] as f32));
        let behind = objective.film_distance().map_or(focal_length, |d| d as f32 + beyond);
        let opening = objective.interfaces.iter().map(|i| i.aperture_radius).fold(f32::INFINITY, f32::min);
        Self::Perspective {
            fov_rad: 2.0 * etendue_procedural::fns::atan(f64::from(0.5 * objective.film_diagonal / behind)) as f32,
            fov_axis: FovAxis::Diagonal,
            aperture_radius: if opening.is_finite() { opening } else { 0.0 },
            focus_distance: (objective.focus_distance - behind).max(focal_length),
            principal_point_offset: [0.0; 2],
        }
    }
}

/// A camera. Its own space: +x right, +y up, looking along −z.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraDesc {
    /// Places it in the world.
    pub world_from_camera: Mat4,
    /// How it projects.
    pub projection: ProjectionDesc,
    /// Nothing nearer is seen.
    pub near: f32,
    /// Nothing farther is seen.
    pub far: f32,
    /// What the camera is in, where the file says so.
    pub medium: Option<MediumId>,
}

impl Default for CameraDesc {
    /// A pinhole camera of 90 degrees at the origin.
    fn default() -> Self {
        let projection = ProjectionDesc::Perspective {
            fov_rad: std::f32::consts::FRAC_PI_2,
            fov_axis: FovAxis::X,
            aperture_radius: 0.0,
            focus_distance: 1.0,
            principal_point_offset: [0.0; 2],
        };
        Self { world_from_camera: Mat4::IDENTITY, projection, near: 0.0, far: f32::INFINITY, medium: None }
    }
}

/// A reconstruction filter; names and parameters as in Mitsuba 3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum FilterDesc {
    /// One pixel, constant.
    #[default]
    Box,
    /// A tent of two pixels.
    Tent,
    /// A Gaussian of a standard deviation in pixels.
    Gaussian {
        /// Standard deviation.
        stddev: f32,
    },
    /// Mitchell and Netravali's cubic.
    Mitchell {
        /// B
        b: f32,
        /// C
        c: f32,
    },
    /// Catmull–Rom's cubic.
    CatmullRom,
    /// Blackman and Harris's window.
    BlackmanHarris,
    /// A sinc with so many lobes, windowed.
    Lanczos {
        /// Lobes.
        lobes: u32,
    },
}

/// What a file says of the picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FilmDesc {
    /// Width in pixels; `None`: not said.
    pub width: Option<u32>,
    /// Height in pixels; `None`: not said.
    pub height: Option<u32>,
    /// Crop window in pixels: x0, y0, x1, y1.
    pub crop: Option<[u32; 4]>,
    /// Filter; `None`: not said.
    pub filter: Option<FilterDesc>,
    /// Samples per pixel; `None`: not said.
    pub spp: Option<u32>,
    /// Sampler's name; empty: not said.
    pub sampler: String,
    /// Seed; `None`: not said.
    pub seed: Option<u64>,
    /// Exposure in stops that the file asks for when the picture is shown.
    pub exposure: f32,
}

impl Default for FilmDesc {
    fn default() -> Self {
        Self { width: None, height: None, crop: None, filter: None, spp: None, sampler: String::new(), seed: None, exposure: 0.0 }
    }
}

/// What a file says of the integrator.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IntegratorDesc {
    /// Our name of it (`path`, `direct`, `ao`, `whitted`, …); empty: not said.
    pub name: String,
    /// Longest path in edges from the camera, 1 = direct light; `None`: not said or without limit.
    pub max_depth: Option<u32>,
    /// Path length from which Russian roulette may end a path; `None`: not said.
    pub rr_depth: Option<u32>,
    /// Lights do not show where the camera looks at them.
    pub hide_lights: bool,
}
