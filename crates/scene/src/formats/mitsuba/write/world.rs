//! Cameras, shapes and lights.

use std::io;

use glam::{Mat4, Vec3};

use super::Writer;
use crate::desc::{
    CameraDesc, EnvironmentMapping, FilterDesc, FovAxis, GeometryDesc, LightDesc, Node, ProjectionDesc, ShapeDesc, ShapeId, SpotFalloff,
};
use crate::span::{FileId, Span};

/// Half a turn about +y: Mitsuba's cameras and lights look along +z, ours along −z.
const HALF_TURN: Mat4 = Mat4::from_cols_array(&[-1., 0., 0., 0., 0., 1., 0., 0., 0., 0., -1., 0., 0., 0., 0., 1.]);

/// Half the edge of the rectangle that stands for a plane.
const PLANE_EXTENT: f32 = 1e5;

/// Clipping distances of cameras that have none.
const LEAST_NEAR: f32 = 1e-4;
const MOST_FAR: f32 = 1e8;

impl Writer<'_> {
    /// Integrator and cameras.
    pub(super) fn settings(&mut self) {
        let integrator = &self.desc.integrator;
        if !integrator.name.is_empty() {
            let kind = match integrator.name.as_str() {
                "path" if self.desc.media.is_empty() => "path",
                "path" => "volpath",
                "direct" => "direct",
                other => {
                    self.lose(Span::file(FileId(0)), format!("integrator \"{other}\""), "path");
                    "path"
                }
            };
            self.xml.open("integrator", kind, "");
            if kind != "direct" {
                let depth = integrator.max_depth.map_or(-1, |d| i64::from(d) + 1);
                self.xml.value("integer", "max_depth", depth);
                if let Some(depth) = integrator.rr_depth {
                    self.xml.value("integer", "rr_depth", u64::from(depth) + 1);
                }
            }
            if integrator.hide_lights {
                self.xml.value("boolean", "hide_emitters", true);
            }
            self.xml.close();
        }
        let desc = self.desc;
        for (i, camera) in desc.cameras.iter().enumerate() {
            let id = self.ids.cameras[i].clone();
            self.camera(camera, &id);
        }
    }

    fn camera(&mut self, node: &Node<CameraDesc>, id: &str) {
        let (span, camera) = (node.span, &node.value);
        let mut to_world = camera.world_from_camera * HALF_TURN;
        if matches!(camera.projection, ProjectionDesc::Objective(_)) {
            self.lose(span, "objective", "a thin lens");
        }
        match &camera.projection.without_objective() {
            ProjectionDesc::Perspective { fov_rad, fov_axis, aperture_radius, focus_distance, principal_point_offset: [x, y] } => {
                let lens = *aperture_radius > 0.0;
                self.xml.open("sensor", if lens { "thinlens" } else { "perspective" }, id);
                self.xml.float("fov", degrees(*fov_rad));
                let axis = match fov_axis {
                    FovAxis::X => "x",
                    FovAxis::Y => "y",
                    FovAxis::Smaller => "smaller",
                    FovAxis::Larger => "larger",
                    FovAxis::Diagonal => "diagonal",
                };
                self.xml.value("string", "fov_axis", axis);
                if lens {
                    self.xml.float("aperture_radius", *aperture_radius);
                }
                self.xml.float("focus_distance", *focus_distance);
                if (*x != 0.0 || *y != 0.0) && lens {
                    self.lose(span, "shifted picture of a thin lens", "not shifted");
                } else if *x != 0.0 || *y != 0.0 {
                    self.xml.float("principal_point_offset_x", *x);
                    self.xml.float("principal_point_offset_y", *y);
                }
            }
            ProjectionDesc::Orthographic { half_width, half_height } => {
                self.xml.open("sensor", "orthographic", id);
                let film = &self.desc.film;
                let aspect = film.width.unwrap_or(768) as f32 / film.height.unwrap_or(576) as f32;
                let scale_y = half_height.map_or(*half_width, |h| h * aspect);
                to_world *= Mat4::from_scale(Vec3::new(*half_width, scale_y, 1.0));
            }
            ProjectionDesc::Panoramic | ProjectionDesc::Objective(_) => {
                self.lose(span, "panoramic camera", "sensor \"spherical\" of Mitsuba 0.6");
                self.xml.open("sensor", "spherical", id);
            }
        }
        self.xml.transform("to_world", to_world);
        // Neither may be missing, 0 or infinite there.
        self.xml.float("near_clip", camera.near.max(LEAST_NEAR));
        self.xml.float("far_clip", camera.far.min(MOST_FAR));
        if let Some(id) = camera.medium.and_then(|m| self.ids.media.get(m.0 as usize).cloned()) {
            self.xml.reference("", &id);
        }
        self.film(span);
        self.xml.close();
    }

    fn film(&mut self, span: Span) {
        let film = self.desc.film.clone();
        if film.spp.is_some() || !film.sampler.is_empty() {
            let kind = match film.sampler.as_str() {
                "independent" | "" => "independent",
                "stratified" => "stratified",
                other => {
                    self.lose(span, format!("sampler \"{other}\""), "independent");
                    "independent"
                }
            };
            self.xml.open("sampler", kind, "");
            self.xml.value("integer", "sample_count", film.spp.unwrap_or(16));
            if let Some(seed) = film.seed {
                self.xml.value("integer", "seed", seed as i64);
            }
            self.xml.close();
        }
        self.xml.open("film", "hdrfilm", "");
        if let (Some(width), Some(height)) = (film.width, film.height) {
            self.xml.value("integer", "width", width);
            self.xml.value("integer", "height", height);
        }
        if let Some([x0, y0, x1, y1]) = film.crop {
            for (name, v) in [
                ("crop_offset_x", x0),
                ("crop_offset_y", y0),
                ("crop_width", x1.saturating_sub(x0)),
                ("crop_height", y1.saturating_sub(y0)),
            ] {
                self.xml.value("integer", name, v);
            }
        }
        if let Some(filter) = film.filter {
            let (kind, numbers): (&str, Vec<(&str, f32)>) = match filter {
                FilterDesc::Box => ("box", vec![]),
                FilterDesc::Tent => ("tent", vec![]),
                FilterDesc::Gaussian { stddev } => ("gaussian", vec![("stddev", stddev)]),
                FilterDesc::Mitchell { b, c } => ("mitchell", vec![("A", b), ("B", c)]),
                FilterDesc::CatmullRom => ("catmullrom", vec![]),
                FilterDesc::BlackmanHarris => {
                    self.lose(span, "Blackman-Harris filter", "gaussian");
                    ("gaussian", vec![("stddev", 0.5)])
                }
                FilterDesc::Lanczos { lobes } => {
                    self.xml.open("rfilter", "lanczos", "");
                    self.xml.value("integer", "lobes", lobes);
                    self.xml.close();
                    ("", vec![])
                }
            };
            if !kind.is_empty() {
                self.xml.open("rfilter", kind, "");
                for (name, v) in numbers {
                    self.xml.float(name, v);
                }
                self.xml.close();
            }
        }
        self.xml.close();
    }

    /// Shapes, groups where their first shape stands, and instances.
    pub(super) fn shapes(&mut self) -> io::Result<()> {
        let desc = self.desc;
        let mut group_of = vec![None; desc.shapes.len()];
        for (g, group) in desc.groups.iter().enumerate() {
            for id in &group.value.shapes {
                if let Some(slot) = group_of.get_mut(id.0 as usize) {
                    *slot = Some(g);
                }
            }
        }
        let mut written = vec![false; desc.groups.len()];
        for (i, node) in desc.shapes.iter().enumerate() {
            match group_of[i] {
                None => self.shape(node)?,
                Some(g) if !written[g] => {
                    written[g] = true;
                    self.group(g)?;
                }
                Some(_) => {}
            }
        }
        for g in (0..desc.groups.len()).filter(|g| !written[*g]) {
            self.group(g)?;
        }
        for node in &desc.instances {
            let Some(group) = self.ids.groups.get(node.value.group.0 as usize).cloned() else { continue };
            self.xml.open("shape", "instance", "");
            self.xml.transform("to_world", node.value.world_from_object);
            self.xml.reference("", &group);
            self.xml.close();
        }
        Ok(())
    }

    fn group(&mut self, g: usize) -> io::Result<()> {
        let desc = self.desc;
        let id = self.ids.groups[g].clone();
        self.xml.open("shape", "shapegroup", &id);
        for ShapeId(i) in &desc.groups[g].value.shapes {
            if let Some(node) = desc.shapes.get(*i as usize) {
                self.shape(node)?;
            }
        }
        self.xml.close();
        Ok(())
    }

    fn shape(&mut self, node: &Node<ShapeDesc>) -> io::Result<()> {
        let (span, shape) = (node.span, &node.value);
        let mut world_from_object = shape.world_from_object;
        if shape.displacement.is_some() {
            self.lose(span, "displacement of a mesh", "the mesh without it");
        }
        match &shape.geometry {
            GeometryDesc::Mesh { mesh, face_normals, smooth } => {
                let i = mesh.0 as usize;
                let Some(data) = self.desc.meshes.get(i).and_then(|m| m.value.data.as_ref()) else {
                    self.lose(span, "mesh that is not loaded", "left out");
                    return Ok(());
                };
                // Without vertex normals, Mitsuba computes them unless told otherwise.
                let flat = *face_normals || (data.normals.is_empty() && !smooth);
                if !data.tangents.is_empty() {
                    self.lose(self.desc.meshes[i].span, "tangents of a mesh", "computed anew");
                }
                let name = self.files.mesh(*mesh, data)?;
                self.xml.open("shape", "ply", "");
                self.xml.value("string", "filename", name);
                if flat {
                    self.xml.value("boolean", "face_normals", true);
                }
            }
            GeometryDesc::Sphere { center, radius } => {
                self.xml.open("shape", "sphere", "");
                self.xml.triple("point", "center", center.to_array());
                self.xml.float("radius", *radius);
            }
            GeometryDesc::Cylinder { p0, p1, radius } => {
                self.xml.open("shape", "cylinder", "");
                self.xml.triple("point", "p0", p0.to_array());
                self.xml.triple("point", "p1", p1.to_array());
                self.xml.float("radius", *radius);
            }
            GeometryDesc::Disk => self.xml.open("shape", "disk", ""),
            GeometryDesc::Rectangle => self.xml.open("shape", "rectangle", ""),
            GeometryDesc::Cube => self.xml.open("shape", "cube", ""),
            GeometryDesc::Plane => {
                self.lose(span, "infinite plane", "a large rectangle");
                world_from_object *= Mat4::from_scale(Vec3::new(PLANE_EXTENT, PLANE_EXTENT, 1.0));
                self.xml.open("shape", "rectangle", "");
            }
            _ => {
                self.lose(span, "shape that Mitsuba lacks", "left out");
                return Ok(());
            }
        }
        self.xml.transform("to_world", world_from_object);
        if shape.flip_normals {
            self.xml.value("boolean", "flip_normals", true);
        }
        if let Some(id) = shape.bsdf {
            let id = self.bsdf_id(id);
            self.xml.reference("", &id);
        }
        if let Some(emission) = &shape.emission {
            if emission.two_sided {
                self.lose(span, "light from both sides of a surface", "from its front");
            }
            if !emission.group.is_empty() {
                self.lose(span, "light group", "none");
            }
            self.xml.open("emitter", "area", "");
            self.color("radiance", emission.radiance);
            self.xml.close();
        }
        for (name, medium) in [("interior", shape.interior), ("exterior", shape.exterior)] {
            if let Some(id) = medium.and_then(|m| self.ids.media.get(m.0 as usize).cloned()) {
                self.xml.reference(name, &id);
            }
        }
        self.xml.close();
        Ok(())
    }

    pub(super) fn lights(&mut self) -> io::Result<()> {
        let desc = self.desc;
        for node in &desc.lights {
            self.light(node)?;
        }
        Ok(())
    }

    fn light(&mut self, node: &Node<LightDesc>) -> io::Result<()> {
        let span = node.span;
        match &node.value {
            light @ LightDesc::Picture { .. } => {
                self.lose(span, "picture of a point light", "the light without it");
                return self.light(&Node::named(&node.name, span, light.without_picture()));
            }
            LightDesc::Point { position, intensity } => {
                self.xml.open("emitter", "point", "");
                self.xml.triple("point", "position", position.to_array());
                self.xml.triple("rgb", "intensity", *intensity);
            }
            LightDesc::Spot { world_from_light, intensity, outer_rad, inner_rad, falloff, texture } => {
                if *falloff != SpotFalloff::Linear {
                    self.lose(span, "falloff of a spot light", "linear in the angle");
                }
                self.xml.open("emitter", "spot", "");
                self.xml.transform("to_world", *world_from_light * HALF_TURN);
                self.xml.triple("rgb", "intensity", *intensity);
                self.xml.float("cutoff_angle", degrees(*outer_rad));
                self.xml.float("beam_width", degrees(*inner_rad));
                if let Some(texture) = texture {
                    self.texture_ref("texture", texture.0);
                }
            }
            LightDesc::Directional { direction, irradiance } => {
                self.xml.open("emitter", "directional", "");
                self.xml.triple("vector", "direction", direction.to_array());
                self.xml.triple("rgb", "irradiance", *irradiance);
            }
            LightDesc::Constant { radiance } => {
                self.xml.open("emitter", "constant", "");
                self.xml.triple("rgb", "radiance", *radiance);
            }
            LightDesc::Environment { image, scale, world_from_light, mapping, portal } => {
                if portal.is_some() {
                    self.lose(span, "portal of an environment light", "light from everywhere");
                }
                match mapping {
                    EnvironmentMapping::EquirectangularOnPoles => {}
                    EnvironmentMapping::Equirectangular => {
                        self.lose(span, "environment map without rows on the poles", "the picture as it is, up to half a row off");
                    }
                    EnvironmentMapping::EqualAreaSquare => {
                        self.lose(span, "environment map of another mapping than latitude and longitude", "the picture as it is");
                    }
                }
                let name = self.image(*image)?;
                if scale[0] != scale[1] || scale[1] != scale[2] {
                    self.lose(span, "color of an environment light", "its mean");
                }
                self.xml.open("emitter", "envmap", "");
                self.xml.value("string", "filename", name);
                let mean = if scale[0] == scale[1] && scale[1] == scale[2] { scale[0] } else { scale.iter().sum::<f32>() / 3.0 };
                self.xml.float("scale", mean);
                self.xml.transform("to_world", *world_from_light * HALF_TURN);
            }
            LightDesc::SunSky(sky) => {
                self.xml.open("emitter", "sunsky", "");
                self.xml.triple("vector", "sun_direction", sky.sun_direction.to_array());
                self.xml.float("turbidity", sky.turbidity);
                self.xml.triple("rgb", "albedo", sky.albedo);
                self.xml.float("sky_scale", if sky.sky { sky.sky_scale } else { 0.0 });
                self.xml.float("sun_scale", if sky.sun { sky.sun_scale } else { 0.0 });
                self.xml.float("sun_aperture", degrees(2.0 * sky.sun_half_angle_rad));
                self.xml.transform("to_world", sky.world_from_light);
            }
        }
        self.xml.close();
        Ok(())
    }
}

/// Degrees that a reader turns into exactly these radians, if there are any.
fn degrees(radians: f32) -> f32 {
    let nearest = radians.to_degrees();
    let bits = nearest.to_bits();
    let around = (bits.saturating_sub(4)..=bits.saturating_add(4)).map(f32::from_bits);
    around.into_iter().find(|d| d.to_radians() == radians).unwrap_or(nearest)
}
