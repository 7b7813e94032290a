//! Camera, film, filter, sampler and integrator.

use glam::{DMat4, DVec3};

use super::Reader;
use super::angles::{atan, tan};
use super::params::Params;
use crate::desc::{
    AddNode, CameraDesc, FilterDesc, FovAxis, IntegratorDesc, LensInterface, MOST_INTERFACES, Node, ObjectiveDesc, ProjectionDesc,
    StopShape,
};
use crate::span::Span;

impl Reader {
    /// `Camera`
    pub(super) fn camera(&mut self, name: &str, p: &Params) {
        let r = &mut self.desc.report;
        p.ignore(&["shutteropen", "shutterclose"]);
        let frame_aspect = p.opt_float("frameaspectratio", r);
        let screen = p.floats("screenwindow", r).to_vec();
        if !screen.is_empty() && (screen.len() != 4 || screen[1] <= screen[0] || screen[3] <= screen[2]) {
            r.error(p.span, "`screenwindow` must be four numbers: x from, to, y from, to");
            return;
        }
        let screen: Option<[f32; 4]> = (screen.len() == 4).then(|| std::array::from_fn(|i| screen[i] as f32));
        let lens_radius = p.float("lensradius", 0.0, r).max(0.0);
        let focal_distance = p.float("focaldistance", 1e6, r).max(1e-6);
        let projection = match name {
            "perspective" => {
                let fov = p.float("fov", 90.0, r);
                if !(fov > 0.0 && fov < 180.0) {
                    r.error(p.span, format!("`fov` must lie between 0 and 180 degrees, not {fov}"));
                    return;
                }
                if frame_aspect.is_some() && screen.is_none() {
                    r.loss(p.span, "frameaspectratio", "the picture's own aspect ratio");
                }
                let (mut fov_rad, mut fov_axis, mut offset) = (fov.to_radians(), FovAxis::Smaller, [0.0; 2]);
                if let Some([x0, x1, y0, y1]) = screen {
                    // The window is in units of the shorter half edge's tangent.
                    let t = tan(0.5 * fov_rad);
                    fov_rad = 2.0 * atan(t * 0.5 * (x1 - x0));
                    fov_axis = FovAxis::X;
                    offset = [0.5 * (x0 + x1) / (x1 - x0), -0.5 * (y0 + y1) / (y1 - y0)];
                }
                ProjectionDesc::Perspective {
                    fov_rad,
                    fov_axis,
                    aperture_radius: lens_radius,
                    focus_distance: focal_distance,
                    principal_point_offset: offset,
                }
            }
            "orthographic" => {
                if lens_radius > 0.0 {
                    r.loss(p.span, "lens of an orthographic camera", "everything in focus");
                }
                match screen {
                    Some([x0, x1, y0, y1]) => {
                        if x0 != -x1 || y0 != -y1 {
                            r.loss(p.span, "an orthographic screen window off the axis", "centered");
                        }
                        ProjectionDesc::Orthographic { half_width: 0.5 * (x1 - x0), half_height: Some(0.5 * (y1 - y0)) }
                    }
                    // The shorter edge runs over [−1, 1].
                    None => {
                        let (w, h) = (self.desc.film.width.unwrap_or(1280) as f32, self.desc.film.height.unwrap_or(720) as f32);
                        ProjectionDesc::Orthographic { half_width: (w / h).max(1.0), half_height: Some((h / w).max(1.0)) }
                    }
                }
            }
            "spherical" => {
                if p.opt_text("mapping", r) != Some("equirectangular") {
                    r.loss(p.span, "mapping \"equalarea\" of a spherical camera", "latitude and longitude");
                }
                ProjectionDesc::Panoramic
            }
            "realistic" => {
                let Some(objective) = self.objective(p) else { return };
                ProjectionDesc::Objective(objective)
            }
            _ => {
                r.error(p.span, format!("no camera `{name}`; there are perspective, orthographic, spherical, realistic"));
                return;
            }
        };
        self.check_motion(p.span);
        let world_from_pbrt = self.state.transform().inverse();
        self.coordinate_systems.insert("camera".to_owned(), world_from_pbrt);
        // pbrt's picture begins at +x and runs towards +z, with +y up; ours has −z in the middle and +x to the right of it.
        let turn = match projection {
            ProjectionDesc::Panoramic => {
                DMat4::from_cols(DVec3::NEG_Z.extend(0.0), DVec3::Y.extend(0.0), DVec3::X.extend(0.0), glam::DVec4::W)
            }
            _ => DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0)),
        };
        let world_from_camera = (world_from_pbrt * turn).as_mat4();
        let medium = self.state.exterior;
        self.desc.add(Node::named(name, p.span, CameraDesc { world_from_camera, projection, near: 0.0, far: f32::INFINITY, medium }));
    }

    /// The lenses of a realistic camera: lines of the radius of curvature, the distance to the next surface, the index behind and the
    /// diameter of the opening, in millimeters. The stop is flat, and is open as far as the camera says.
    fn objective(&mut self, p: &Params) -> Option<ObjectiveDesc> {
        let r = &mut self.desc.report;
        let focus_distance = p.float("focusdistance", 10.0, r);
        let diameter = p.float("aperturediameter", 1.0, r);
        let lens_file = p.opt_text("lensfile", r).map(str::to_owned);
        let stop = match p.opt_text("aperture", r).map(str::to_owned).as_deref() {
            None | Some("") => StopShape::Circle,
            Some("gaussian") => StopShape::Gaussian,
            Some("square") => StopShape::Square,
            Some("pentagon") => StopShape::Pentagon,
            Some("star") => StopShape::Star,
            Some(picture) => StopShape::Picture(self.image(picture, p.get("aperture").map_or(p.span, |q| q.span))?),
        };
        let Some(name) = lens_file else {
            self.error(p.span, "a realistic camera needs a `lensfile`");
            return None;
        };
        let numbers = self.numbers_of_file(&name, p.span)?;
        if numbers.len() % 4 != 0 || numbers.len() > 4 * MOST_INTERFACES {
            let message = format!("{name}: {} numbers, not four for each of at most {MOST_INTERFACES} surfaces of a lens", numbers.len());
            self.error(p.span, message);
            return None;
        }
        let mut interfaces = Vec::with_capacity(numbers.len() / 4);
        for row in numbers.chunks_exact(4) {
            let [curvature, thickness, ior, mut opening] = std::array::from_fn(|i| row[i] as f32);
            if curvature == 0.0 {
                if diameter > opening {
                    let message = format!("`aperturediameter` {diameter} is more than the stop's {opening} mm, which is used");
                    self.desc.report.warning(p.span, message);
                } else {
                    opening = diameter;
                }
            }
            interfaces.push(LensInterface {
                curvature_radius: curvature * 1e-3,
                thickness: thickness * 1e-3,
                ior: if ior == 0.0 { 1.0 } else { ior },
                aperture_radius: 0.5e-3 * opening,
            });
        }
        Some(ObjectiveDesc { interfaces, film_diagonal: self.film_diagonal, focus_distance, stop })
    }

    /// The camera of a file without one: perspective, 90 degrees, at the origin.
    pub(super) fn default_camera(&mut self) {
        let transforms = std::mem::replace(&mut self.state.transforms, [DMat4::IDENTITY; 2]);
        self.camera("perspective", &Params::new(Span::default(), Vec::new(), &[]));
        self.state.transforms = transforms;
    }

    /// `Film`
    pub(super) fn film(&mut self, name: &str, p: &Params) {
        if !["rgb", "gbuffer", "spectral"].contains(&name) {
            self.error(p.span, format!("no film `{name}`; there are rgb, gbuffer, spectral"));
        }
        let r = &mut self.desc.report;
        let mut edge = |name: &str, default: i64| {
            let v = p.opt_integer(name, r).unwrap_or(default);
            if v < 1 || v > i64::from(u32::MAX) {
                r.error(p.span, format!("`{name}` must be a positive number of pixels"));
            }
            v.clamp(1, i64::from(u32::MAX)) as u32
        };
        let (w, h) = (edge("xresolution", 1280), edge("yresolution", 720));
        let window = p.floats("cropwindow", r).to_vec();
        let bounds = p.floats("pixelbounds", r).to_vec();
        p.ignore(&["filename", "savefp16", "maxcomponentvalue", "coordinatesystem", "nbuckets", "lambdamin", "lambdamax"]);
        let diagonal = p.float("diagonal", 35.0, r);
        if diagonal > 0.0 && diagonal.is_finite() {
            self.film_diagonal = diagonal * 1e-3;
        } else {
            r.error(p.span, "`diagonal` must be a positive number of millimeters");
        }
        for camera in &mut self.desc.cameras {
            if let ProjectionDesc::Objective(objective) = &mut camera.value.projection {
                objective.film_diagonal = self.film_diagonal;
            }
        }
        let r = &mut self.desc.report;
        let iso = p.float("iso", 100.0, r);
        if let Some(sensor) = p.opt_text("sensor", r)
            && sensor != "cie1931"
        {
            r.loss(p.span, format!("sensor \"{sensor}\""), "linear RGB without the sensor's response");
        }
        if p.has("whitebalance") {
            p.ignore(&["whitebalance"]);
            r.loss(p.span, "whitebalance", "ignored");
        }
        let mut crop = None;
        if bounds.len() == 4 {
            crop = Some([bounds[0], bounds[2], bounds[1], bounds[3]]);
        } else if window.len() == 4 {
            let (w, h) = (f64::from(w), f64::from(h));
            crop = Some([(w * window[0]).ceil(), (h * window[2]).ceil(), (w * window[1]).ceil(), (h * window[3]).ceil()]);
        }
        let film = &mut self.desc.film;
        (film.width, film.height) = (Some(w), Some(h));
        film.exposure = if iso > 0.0 { etendue_procedural::fns::log2(f64::from(iso) / 100.0) as f32 } else { 0.0 };
        if let Some(c) = crop {
            let c = [c[0].max(0.0) as u32, c[1].max(0.0) as u32, c[2].min(f64::from(w)) as u32, c[3].min(f64::from(h)) as u32];
            if c[0] >= c[2] || c[1] >= c[3] {
                r.error(p.span, "the crop window is empty");
            } else if c != [0, 0, w, h] {
                film.crop = Some(c);
            }
        }
    }

    /// `PixelFilter`
    pub(super) fn filter(&mut self, name: &str, p: &Params) {
        let r = &mut self.desc.report;
        let mut radius = |default: f32| {
            let (x, y) = (p.float("xradius", default, r), p.float("yradius", default, r));
            if x != y {
                r.loss(p.span, "a filter with unequal radii", "the horizontal one");
            }
            x
        };
        let (filter, usual) = match name {
            "box" => (FilterDesc::Box, radius(0.5) == 0.5),
            "triangle" => (FilterDesc::Tent, radius(2.0) == 1.0),
            "gaussian" => {
                radius(1.5);
                (FilterDesc::Gaussian { stddev: p.float("sigma", 0.5, r).clamp(0.01, 100.0) }, true)
            }
            "mitchell" => {
                let usual = radius(2.0) == 2.0;
                (FilterDesc::Mitchell { b: p.float("B", 1.0 / 3.0, r), c: p.float("C", 1.0 / 3.0, r) }, usual)
            }
            "sinc" => {
                radius(4.0);
                (FilterDesc::Lanczos { lobes: p.float("tau", 3.0, r).clamp(1.0, 16.0) as u32 }, true)
            }
            _ => {
                r.error(p.span, format!("no filter `{name}`; there are box, triangle, gaussian, mitchell, sinc"));
                return;
            }
        };
        if !usual {
            self.loss(p.span, format!("radius of the {name} filter"), "the filter's usual radius");
        }
        self.desc.film.filter = Some(filter);
    }

    /// `Sampler`
    pub(super) fn sampler(&mut self, name: &str, p: &Params) {
        let r = &mut self.desc.report;
        let mut spp = p.opt_integer("pixelsamples", r).unwrap_or(16);
        if name == "stratified" {
            spp = p.opt_integer("xsamples", r).unwrap_or(4).saturating_mul(p.opt_integer("ysamples", r).unwrap_or(4));
        }
        p.ignore(&["randomization", "jitter"]);
        self.desc.film.seed = p.opt_integer("seed", r).map(|s| s as u64);
        self.desc.film.spp = Some(spp.clamp(1, i64::from(u32::MAX)) as u32);
        self.desc.film.sampler = name.to_owned();
    }

    /// `Integrator`
    pub(super) fn integrator(&mut self, name: &str, p: &Params) {
        let ours = match name {
            "path" | "simplepath" | "volpath" | "simplevolpath" => "path",
            "ambientocclusion" => "ao",
            "bdpt" | "mlt" | "sppm" | "lightpath" | "randomwalk" | "function" => {
                self.loss(p.span, format!("Integrator \"{name}\""), "rendered by path tracing");
                "path"
            }
            _ => {
                self.error(p.span, format!("no integrator `{name}`"));
                return;
            }
        };
        let r = &mut self.desc.report;
        let max_depth = p.opt_integer("maxdepth", r).unwrap_or(5);
        if p.boolean("regularize", false, r) {
            r.loss(p.span, "regularize", "ignored");
        }
        p.ignore(&[
            "lightsampler",
            "samplelights",
            "samplebsdf",
            "visualizestrategies",
            "visualizeweights",
            "bootstrapsamples",
            "chains",
            "mutationsperpixel",
            "largestepprobability",
            "sigma",
            "photonsperiteration",
            "radius",
            "seed",
            "cossample",
            "maxdistance",
            "iterations",
        ]);
        let max_depth = (ours == "path").then_some(max_depth.clamp(0, i64::from(u32::MAX)) as u32);
        self.desc.integrator = IntegratorDesc { name: ours.to_owned(), max_depth, rr_depth: None, hide_lights: false };
    }
}
