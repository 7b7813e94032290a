//! Cameras with film and sampler, and the integrator.

use glam::{Mat4, Vec3};

use super::Builder;
use super::emitter::HALF_TURN;
use super::props::Props;
use crate::desc::{AddNode, CameraDesc, FilmDesc, FilterDesc, FovAxis, IntegratorDesc, Node, ProjectionDesc};
use crate::formats::mitsuba::tree::{Kind, Plugin};

impl<'t> Builder<'t> {
    /// Adds a camera; the first one's film is the scene's.
    pub(super) fn sensor(&mut self, plugin: &'t Plugin) {
        if !self.is_known(plugin) {
            return;
        }
        let mut p = Props::new(plugin);
        let mut film = FilmDesc::default();
        if let Some(nested) = self.next_of(&mut p, Kind::Film) {
            self.film(nested, &mut film);
        }
        if let Some(nested) = self.next_of(&mut p, Kind::Sampler) {
            self.sampler(nested, &mut film);
        }
        let projection = self.projection(&mut p);
        let mut world_from_camera = p.transform("to_world") * HALF_TURN;
        let near = p.positive("near_clip", 1e-2);
        let far = p.positive("far_clip", 1e4);
        if far <= near {
            p.fault_at("far_clip", "`far_clip` must be beyond `near_clip`");
        }
        if let (Some(open), Some(close)) = (p.opt_float("shutter_open"), p.opt_float("shutter_close"))
            && open != close
        {
            self.desc.report.loss(plugin.span, "motion blur (`shutter_open`, `shutter_close`)", "a still picture");
        }
        p.lose(&["srf", "sampler_seed", "kc"]);
        let medium = self.next_of(&mut p, Kind::Medium).and_then(|medium| self.medium(medium));
        let projection = projection.map(|projection| match projection {
            // Mitsuba scales an orthographic picture by the camera's transform.
            ProjectionDesc::Orthographic { .. } => {
                let (sx, sy) = (world_from_camera.x_axis.length(), world_from_camera.y_axis.length());
                world_from_camera = unscaled(world_from_camera);
                let aspect = film.height.unwrap_or(1) as f32 / film.width.unwrap_or(1) as f32;
                let half_height = ((sx - sy).abs() > 1e-5 * sx.max(sy)).then_some(sy * aspect);
                ProjectionDesc::Orthographic { half_width: sx, half_height }
            }
            other => {
                let m = world_from_camera;
                if [m.x_axis, m.y_axis, m.z_axis].iter().any(|a| (a.length() - 1.0).abs() > 1e-3) {
                    self.desc.report.warning(plugin.span, "a camera's transform should not scale; the scale is left out");
                    world_from_camera = unscaled(m);
                }
                other
            }
        });
        self.finish(p);
        let Some(projection) = projection else { return };
        if self.desc.cameras.is_empty() {
            self.desc.film = film;
        } else if self.desc.film != film {
            self.desc.report.loss(plugin.span, "film and sampler of a further sensor", "those of the first one in their place");
        }
        self.desc.add(Node::named(&plugin.id, plugin.span, CameraDesc { world_from_camera, projection, near, far, medium }));
    }

    fn projection(&mut self, p: &mut Props<'t>) -> Option<ProjectionDesc> {
        let kind = p.plugin.type_name.as_str();
        match kind {
            "perspective" | "thinlens" | "perspective_rdist" => {
                if kind == "perspective_rdist" {
                    self.lose(p.plugin, "rendered without distortion");
                }
                let (fov_rad, fov_axis) = self.field_of_view(p);
                let offset = [p.float("principal_point_offset_x", 0.0), p.float("principal_point_offset_y", 0.0)];
                let lens = kind == "thinlens";
                let aperture_radius = if lens { p.float("aperture_radius", 0.0) } else { 0.0 };
                if lens && !p.has("aperture_radius") {
                    p.fault(p.plugin.span, "`aperture_radius` is missing");
                }
                let focus_distance = p.opt_float("focus_distance").unwrap_or_else(|| p.float("far_clip", 1e4));
                if aperture_radius < 0.0 || (lens && focus_distance <= 0.0) {
                    p.fault(p.plugin.span, "`aperture_radius` must not be negative, and `focus_distance` must be positive");
                }
                Some(ProjectionDesc::Perspective { fov_rad, fov_axis, aperture_radius, focus_distance, principal_point_offset: offset })
            }
            "orthographic" => {
                p.ignore(&["focus_distance"]);
                Some(ProjectionDesc::Orthographic { half_width: 1.0, half_height: None })
            }
            "spherical" => Some(ProjectionDesc::Panoramic),
            _ => {
                self.lose(p.plugin, "left out");
                p.ignore_all();
                None
            }
        }
    }

    fn field_of_view(&mut self, p: &mut Props<'t>) -> (f32, FovAxis) {
        let axis = p.choice(
            "fov_axis",
            &[
                ("x", FovAxis::X),
                ("y", FovAxis::Y),
                ("smaller", FovAxis::Smaller),
                ("larger", FovAxis::Larger),
                ("diagonal", FovAxis::Diagonal),
            ],
            FovAxis::X,
        );
        if p.has("fov") {
            let fov = p.float("fov", 45.0);
            if p.has("focal_length") {
                p.fault_at("focal_length", "`focal_length` cannot stand beside `fov`");
            }
            p.ignore(&["focal_length"]);
            if !(fov > 0.0 && fov < 180.0) {
                p.fault_at("fov", format!("`fov` must lie between 0 and 180 degrees, not {fov}"));
                return (1.0, axis);
            }
            return (fov.to_radians(), axis);
        }
        let text = p.opt_text("focal_length").unwrap_or("50mm");
        let millimetres: Option<f64> = text.trim().trim_end_matches("mm").trim().parse().ok().filter(|f: &f64| *f > 0.0 && f.is_finite());
        let Some(millimetres) = millimetres else {
            p.fault_at("focal_length", format!("`{text}` is not a focal length such as 50mm"));
            return (1.0, axis);
        };
        p.ignore(&["fov"]);
        // Across the diagonal of a 35 mm picture, 36 mm × 24 mm.
        let diagonal = f64::from(36 * 36 + 24 * 24).sqrt();
        ((2.0 * (0.5 * diagonal / millimetres).atan()) as f32, FovAxis::Diagonal)
    }

    fn film(&mut self, plugin: &'t Plugin, film: &mut FilmDesc) {
        if !self.is_known(plugin) {
            return;
        }
        if plugin.type_name != "hdrfilm" {
            self.lose(plugin, "linear RGB pictures");
        }
        let mut p = Props::new(plugin);
        let (width, height) = (p.opt_count("width", 1).unwrap_or(768), p.opt_count("height", 1).unwrap_or(576));
        film.width = Some(width);
        film.height = Some(height);
        let crop = ["crop_offset_x", "crop_offset_y", "crop_width", "crop_height"];
        if crop.iter().any(|name| p.has(name)) {
            let x0 = p.opt_count(crop[0], 0).unwrap_or(0);
            let y0 = p.opt_count(crop[1], 0).unwrap_or(0);
            let x1 = x0.saturating_add(p.opt_count(crop[2], 1).unwrap_or(width.saturating_sub(x0)));
            let y1 = y0.saturating_add(p.opt_count(crop[3], 1).unwrap_or(height.saturating_sub(y0)));
            if x1 > width || y1 > height || x0 >= x1 || y0 >= y1 {
                p.fault(plugin.span, "the crop window leaves the picture");
            } else {
                film.crop = Some([x0, y0, x1, y1]);
            }
        }
        film.exposure = if plugin.type_name == "ldrfilm" { p.float("exposure", 0.0) } else { 0.0 };
        p.ignore(&[
            "crop_offset_x",
            "crop_offset_y",
            "crop_width",
            "crop_height",
            "exposure",
            "file_format",
            "pixel_format",
            "component_format",
            "sample_border",
            "compensate",
            "banner",
            "attach_log",
            "high_quality_edges",
            "gamma",
            "tonemap_method",
            "key",
            "burn",
            "label",
            "fits_format",
            "digits",
            "variable",
        ]);
        film.filter = match self.next_of(&mut p, Kind::Rfilter) {
            Some(filter) => self.filter(filter),
            None => Some(FilterDesc::Gaussian { stddev: 0.5 }),
        };
        if plugin.type_name == "specfilm" {
            while self.next_of(&mut p, Kind::Texture).is_some() {}
        }
        self.finish(p);
    }

    fn filter(&mut self, plugin: &'t Plugin) -> Option<FilterDesc> {
        if !self.is_known(plugin) {
            return None;
        }
        let mut p = Props::new(plugin);
        let filter = match plugin.type_name.as_str() {
            "box" => {
                p.lose(&["radius"]);
                FilterDesc::Box
            }
            "tent" => {
                p.lose(&["radius"]);
                FilterDesc::Tent
            }
            "gaussian" => FilterDesc::Gaussian { stddev: p.positive("stddev", 0.5) },
            "mitchell" => {
                // Mitsuba 3 calls them A and B, 0.x b and c.
                let b = p.opt_float("A").or_else(|| p.opt_float("b"));
                let c = p.opt_float("B").or_else(|| p.opt_float("c"));
                FilterDesc::Mitchell { b: b.unwrap_or(1.0 / 3.0), c: c.unwrap_or(1.0 / 3.0) }
            }
            "catmullrom" => FilterDesc::CatmullRom,
            _ => FilterDesc::Lanczos { lobes: p.opt_count("lobes", 1).unwrap_or(3) },
        };
        self.finish(p);
        Some(filter)
    }

    fn sampler(&mut self, plugin: &'t Plugin, film: &mut FilmDesc) {
        if !self.is_known(plugin) {
            return;
        }
        let mut p = Props::new(plugin);
        film.spp = Some(p.opt_count("sample_count", 1).unwrap_or(4));
        film.seed = p.opt_int("seed").map(|v| v as u64);
        p.ignore(&["jitter", "strength", "dimension", "scramble"]);
        let (name, exact) = match plugin.type_name.as_str() {
            "independent" => ("independent", true),
            "stratified" => ("stratified", true),
            "multijitter" | "orthogonal" => ("stratified", false),
            "halton" => ("halton", true),
            "hammersley" => ("halton", false),
            "sobol" => ("sobol", true),
            _ => ("sobol", false),
        };
        if !exact {
            self.lose(plugin, &format!("the {name} sampler in its place"));
        }
        film.sampler = name.to_owned();
        self.finish(p);
    }

    /// Sets the scene's integrator.
    pub(super) fn integrator(&mut self, plugin: &'t Plugin) {
        self.guarded(plugin, |b| {
            b.build_integrator(plugin);
            Some(())
        });
    }

    fn build_integrator(&mut self, plugin: &'t Plugin) {
        if !self.is_known(plugin) {
            return;
        }
        let mut p = Props::new(plugin);
        if matches!(plugin.type_name.as_str(), "aov" | "moment" | "stokes" | "adaptive" | "irrcache" | "multichannel") {
            self.lose(plugin, "the integrator within it");
            while let Some(nested) = self.next_of(&mut p, Kind::Integrator) {
                self.integrator(nested);
            }
            p.ignore_all();
            return;
        }
        let (name, exact) = match plugin.type_name.as_str() {
            "path" | "volpath" | "volpathmis" | "volpath_simple" => ("path", true),
            "direct" => ("direct", true),
            "ao" => ("ao", true),
            _ => ("path", false),
        };
        if !exact {
            self.lose(plugin, &format!("the {name} integrator in its place"));
        }
        let mut desc = IntegratorDesc { name: name.to_owned(), ..IntegratorDesc::default() };
        // Mitsuba counts the edge to the camera and the light's: 1 shows lights, 2 direct light, -1 has no limit.
        match p.opt_int("max_depth") {
            Some(v) if v < -1 => p.fault_at("max_depth", format!("`max_depth` must be -1 or more, not {v}")),
            Some(-1) | None => {}
            Some(v) => desc.max_depth = Some(u32::try_from(v).unwrap_or(u32::MAX).saturating_sub(1)),
        }
        desc.rr_depth = p.opt_count("rr_depth", 1).map(|v| v - 1);
        desc.hide_lights = p.bool("hide_emitters", false);
        p.ignore(&[
            "shading_samples",
            "emitter_samples",
            "bsdf_samples",
            "light_samples",
            "strict_normals",
            "samples_per_pass",
            "block_size",
            "timeout",
            "ray_length",
        ]);
        if exact {
            self.finish(p)
        } else {
            p.ignore_all()
        }
        self.desc.integrator = desc;
    }
}

/// The transform with its axes made unit.
fn unscaled(m: Mat4) -> Mat4 {
    let axis = |v: glam::Vec4| v.truncate().normalize_or(Vec3::ZERO).extend(0.0);
    Mat4::from_cols(axis(m.x_axis), axis(m.y_axis), axis(m.z_axis), m.w_axis)
}
