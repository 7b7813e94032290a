//! Cameras, film, media, shapes and lights.

use std::fmt::Write as _;
use std::io;

use glam::{Mat4, Vec3};

use super::super::angles::{atan, tan};
use super::Writer;
use crate::desc::{
    BsdfDesc, CameraDesc, EnvironmentMapping, FilterDesc, FovAxis, GeometryDesc, LightDesc, MeshId, Node, ObjectiveDesc, Param,
    PictureMapping, ProjectionDesc, Scalar, ShapeDesc, SpotFalloff, StopShape,
};
use crate::formats::tessellate::tessellate;

impl Writer<'_> {
    /// Everything before `WorldBegin`.
    pub(super) fn settings(&mut self) -> io::Result<()> {
        let film = &self.desc.film;
        let (w, h) = (film.width.unwrap_or(1280), film.height.unwrap_or(720));
        self.media();
        if let Some(camera) = self.desc.cameras.first() {
            if self.desc.cameras.len() > 1 {
                self.lose(self.desc.cameras[1].span, "further cameras", "the first one alone");
            }
            // It counts for the camera and for all that follows; shapes with media of their own say so.
            if let Some(medium) = camera.value.medium {
                self.line(&format!("MediumInterface \"\" \"v{}\"", medium.0));
            }
            self.camera(camera, w as f32, h as f32)?;
            if camera.value.medium.is_some() {
                self.line("MediumInterface \"\" \"\"");
            }
        }
        let _ = write!(self.text, "Film \"rgb\" \"integer xresolution\" {w} \"integer yresolution\" {h} \"bool savefp16\" false");
        if let Some(ProjectionDesc::Objective(objective)) = self.desc.cameras.first().map(|c| &c.value.projection) {
            self.float("diagonal", objective.film_diagonal * 1e3);
        }
        if let Some([x0, y0, x1, y1]) = film.crop {
            let _ = write!(self.text, " \"integer pixelbounds\" [{x0} {x1} {y0} {y1}]");
        }
        self.text.push('\n');
        let filter = match film.filter.unwrap_or_default() {
            FilterDesc::Box => "\"box\"".to_owned(),
            FilterDesc::Tent => "\"triangle\" \"float xradius\" 1 \"float yradius\" 1".to_owned(),
            FilterDesc::Gaussian { stddev } => format!("\"gaussian\" \"float sigma\" {stddev}"),
            FilterDesc::Mitchell { b, c } => format!("\"mitchell\" \"float B\" {b} \"float C\" {c}"),
            FilterDesc::CatmullRom => "\"mitchell\" \"float B\" 0 \"float C\" 0.5".to_owned(),
            FilterDesc::BlackmanHarris => "\"gaussian\"".to_owned(),
            FilterDesc::Lanczos { lobes } => format!("\"sinc\" \"float tau\" {lobes}"),
        };
        self.line(&format!("PixelFilter {filter}"));
        self.line(&format!("Sampler \"zsobol\" \"integer pixelsamples\" {}", film.spp.unwrap_or(16)));
        let depth = self.desc.integrator.max_depth.unwrap_or(100);
        match self.desc.integrator.name.as_str() {
            "ao" => self.line("Integrator \"ambientocclusion\""),
            _ => self.line(&format!("Integrator \"volpath\" \"integer maxdepth\" {depth}")),
        }
        Ok(())
    }

    fn camera(&mut self, node: &Node<CameraDesc>, w: f32, h: f32) -> io::Result<()> {
        let camera = &node.value;
        let panoramic = matches!(camera.projection, ProjectionDesc::Panoramic);
        let turn = if panoramic {
            // The inverse of the reader's turn.
            Mat4::from_cols(Vec3::Z.extend(0.0), Vec3::Y.extend(0.0), Vec3::NEG_X.extend(0.0), glam::Vec4::W)
        } else {
            Mat4::from_scale(Vec3::new(1.0, 1.0, -1.0))
        };
        self.transform("Transform", (camera.world_from_camera * turn).inverse());
        self.text.push_str("Camera ");
        match &camera.projection {
            ProjectionDesc::Perspective { fov_rad, fov_axis, aperture_radius, focus_distance, principal_point_offset } => {
                self.text.push_str("\"perspective\"");
                let t = tan(0.5 * fov_rad);
                let half_width = match fov_axis {
                    FovAxis::X => t,
                    FovAxis::Y => t * w / h,
                    FovAxis::Smaller => t * (w / h).max(1.0),
                    FovAxis::Larger => t * (w / h).min(1.0),
                    FovAxis::Diagonal => t * w / (w * w + h * h).sqrt(),
                };
                let smaller = half_width * (h / w).min(1.0);
                self.float("fov", 2.0 * atan(smaller).to_degrees());
                let [x, y] = *principal_point_offset;
                if x != 0.0 || y != 0.0 {
                    let (a, b) = ((w / h).max(1.0), (h / w).max(1.0));
                    let (dx, dy) = (2.0 * a * x, -2.0 * b * y);
                    let _ = write!(self.text, " \"float screenwindow\" [{} {} {} {}]", dx - a, dx + a, dy - b, dy + b);
                }
                if *aperture_radius > 0.0 {
                    self.float("lensradius", *aperture_radius);
                    self.float("focaldistance", *focus_distance);
                }
            }
            ProjectionDesc::Orthographic { half_width, half_height } => {
                let y = half_height.unwrap_or(half_width * h / w);
                let _ = write!(self.text, "\"orthographic\" \"float screenwindow\" [{} {half_width} {} {y}]", -half_width, -y);
            }
            ProjectionDesc::Panoramic => self.text.push_str("\"spherical\" \"string mapping\" \"equirectangular\""),
            ProjectionDesc::Objective(objective) => self.objective(objective)?,
        }
        self.text.push('\n');
        Ok(())
    }

    /// A realistic camera, with its lenses in a file of millimeters.
    fn objective(&mut self, objective: &ObjectiveDesc) -> io::Result<()> {
        let mut table = String::from("# radius of curvature, thickness, index, diameter of the opening\n");
        for i in &objective.interfaces {
            let [radius, thickness, opening] = [i.curvature_radius, i.thickness, 2.0 * i.aperture_radius].map(|v| v * 1e3);
            // An index of 0 marks the stop, which is open as far as the camera says.
            let ior = if i.curvature_radius == 0.0 { 0.0 } else { i.ior };
            let _ = writeln!(table, "{radius} {thickness} {ior} {opening}");
        }
        let name = self.files.text("objective.dat", &table)?;
        self.text.push_str("\"realistic\"");
        self.string("lensfile", &name);
        self.float("focusdistance", objective.focus_distance);
        let stop = objective.interfaces.iter().find(|i| i.curvature_radius == 0.0);
        self.float("aperturediameter", stop.map_or(1.0, |i| 2e3 * i.aperture_radius));
        match objective.stop {
            StopShape::Circle => {}
            StopShape::Gaussian => self.string("aperture", "gaussian"),
            StopShape::Square => self.string("aperture", "square"),
            StopShape::Pentagon => self.string("aperture", "pentagon"),
            StopShape::Star => self.string("aperture", "star"),
            StopShape::Picture(image) => {
                let name = self.files.image(self.desc, image)?;
                self.string("aperture", &name);
            }
        }
        Ok(())
    }

    /// Groups, the shapes of the world, and instances.
    pub(super) fn shapes(&mut self) -> io::Result<()> {
        let desc = self.desc;
        let mut grouped = vec![false; desc.shapes.len()];
        for (g, group) in desc.groups.iter().enumerate() {
            self.line(&format!("ObjectBegin \"g{g}\""));
            for id in &group.value.shapes {
                if let Some(node) = desc.shapes.get(id.0 as usize) {
                    grouped[id.0 as usize] = true;
                    self.shape(node)?;
                }
            }
            self.line("ObjectEnd");
        }
        for (node, _) in desc.shapes.iter().zip(&grouped).filter(|(_, g)| !**g) {
            self.shape(node)?;
        }
        for node in &desc.instances {
            self.line("AttributeBegin");
            self.transform("Transform", node.value.world_from_object);
            self.line(&format!("ObjectInstance \"g{}\"", node.value.group.0));
            self.line("AttributeEnd");
        }
        Ok(())
    }

    /// The name of the float texture of a displacement: pbrt takes no number in its place.
    fn height(&mut self, height: Scalar) -> String {
        match height {
            Scalar::Texture(id) => format!("f{}", id.0),
            Scalar::Constant(v) => {
                self.heights += 1;
                let name = format!("h{}", self.heights);
                self.line(&format!("Texture \"{name}\" \"float\" \"constant\" \"float value\" {v}"));
                name
            }
        }
    }

    fn shape(&mut self, node: &Node<ShapeDesc>) -> io::Result<()> {
        let (span, shape) = (node.span, &node.value);
        let desc = self.desc;
        let mut m = shape.world_from_object;
        let mut text = String::new();
        match &shape.geometry {
            GeometryDesc::Mesh { mesh, .. } => {
                let Some(data) = desc.meshes.get(mesh.0 as usize).and_then(|m| m.value.data.as_ref()) else {
                    self.lose(span, "mesh that is not loaded", "left out");
                    return Ok(());
                };
                let name = self.files.mesh(*mesh, data)?;
                let _ = write!(text, "\"plymesh\" \"string filename\" \"{name}\"");
                if let Some(displacement) = &shape.displacement {
                    let height = self.height(displacement.height);
                    let _ = write!(
                        text,
                        " \"texture displacement\" \"{height}\" \"float displacement.edgelength\" {}",
                        displacement.edge_length
                    );
                }
            }
            GeometryDesc::Sphere { center, radius } => {
                m *= Mat4::from_translation(*center);
                let _ = write!(text, "\"sphere\" \"float radius\" {radius}");
            }
            GeometryDesc::Cylinder { p0, p1, radius } => {
                let axis = *p1 - *p0;
                m *= Mat4::from_rotation_translation(glam::Quat::from_rotation_arc(Vec3::Z, axis.normalize_or(Vec3::Z)), *p0);
                let _ = write!(text, "\"cylinder\" \"float radius\" {radius} \"float zmin\" 0 \"float zmax\" {}", axis.length());
            }
            GeometryDesc::Disk => text.push_str("\"disk\""),
            GeometryDesc::Rectangle => {
                text.push_str("\"bilinearmesh\" \"point3 P\" [-1 -1 0 1 -1 0 -1 1 0 1 1 0]");
            }
            other => {
                let Some(data) = tessellate(other) else {
                    self.lose(span, "shape that pbrt lacks", "left out");
                    return Ok(());
                };
                if matches!(other, GeometryDesc::Plane) {
                    self.lose(span, "infinite plane", "a large rectangle");
                }
                // Beyond the meshes of the scene, so that the file gets a number of its own.
                self.tessellated += 1;
                let name = self.files.mesh(MeshId(desc.meshes.len() as u32 + self.tessellated), &data)?;
                let _ = write!(text, "\"plymesh\" \"string filename\" \"{name}\"");
            }
        }
        self.line("AttributeBegin");
        self.transform("ConcatTransform", m);
        if shape.flip_normals {
            self.line("ReverseOrientation");
        }
        if let Some(id) = shape.bsdf {
            self.line(&format!("NamedMaterial \"m{}\"", self.material_number(id)));
            if let BsdfDesc::Mask { opacity, .. } = &desc[id].value {
                match opacity {
                    Scalar::Constant(v) => {
                        let _ = write!(text, " \"float alpha\" {v}");
                    }
                    Scalar::Texture(t) => {
                        let _ = write!(text, " \"texture alpha\" \"f{}\"", t.0);
                    }
                }
            }
        }
        if let Some(emission) = &shape.emission {
            self.text.push_str("AreaLightSource \"diffuse\"");
            match emission.radiance {
                Param::Constant(c) => self.rgb("L", c),
                Param::Texture(_) => {
                    self.lose(span, "textured light", "white of radiance 1");
                    self.rgb("L", [1.0; 3]);
                }
            }
            if emission.two_sided {
                self.boolean("twosided", true);
            }
            self.text.push('\n');
        }
        if shape.interior.is_some() || shape.exterior.is_some() {
            let name = |m: Option<crate::desc::MediumId>| m.map_or(String::new(), |m| format!("v{}", m.0));
            self.line(&format!("MediumInterface \"{}\" \"{}\"", name(shape.interior), name(shape.exterior)));
        }
        self.line(&format!("Shape {text}"));
        self.line("AttributeEnd");
        Ok(())
    }

    pub(super) fn lights(&mut self) -> io::Result<()> {
        let desc = self.desc;
        for node in &desc.lights {
            let span = node.span;
            self.line("AttributeBegin");
            match &node.value {
                LightDesc::Point { position: p, intensity } => {
                    let _ = write!(self.text, "LightSource \"point\" \"point3 from\" [{} {} {}]", p.x, p.y, p.z);
                    self.rgb("I", *intensity);
                }
                LightDesc::Spot { world_from_light, intensity, outer_rad, inner_rad, falloff, texture } => {
                    if *falloff != SpotFalloff::Smoothstep {
                        self.lose(span, "falloff of a spot light", "smoothstep of the cosine");
                    }
                    if texture.is_some() {
                        self.lose(span, "picture of a spot light", "left out");
                    }
                    self.transform("Transform", *world_from_light);
                    self.text.push_str("LightSource \"spot\" \"point3 from\" [0 0 0] \"point3 to\" [0 0 -1]");
                    self.rgb("I", *intensity);
                    self.float("coneangle", outer_rad.to_degrees());
                    self.float("conedeltaangle", (outer_rad - inner_rad).to_degrees());
                }
                LightDesc::Picture { world_from_light, intensity, power, image, mapping } => {
                    let swap = Mat4::from_cols(glam::Vec4::X, glam::Vec4::Z, glam::Vec4::Y, glam::Vec4::W);
                    match mapping {
                        PictureMapping::EqualAreaSquare => {
                            self.transform("Transform", *world_from_light * swap);
                            self.text.push_str("LightSource \"goniometric\"");
                            self.rgb("I", *intensity);
                        }
                        PictureMapping::Perspective { fov_rad } => {
                            if intensity[0] != intensity[1] || intensity[1] != intensity[2] {
                                self.lose(span, "color of a projected picture", "its mean");
                            }
                            self.transform("Transform", *world_from_light);
                            self.text.push_str("LightSource \"projection\"");
                            self.float("fov", fov_rad.to_degrees());
                            self.float("scale", intensity.iter().sum::<f32>() / 3.0);
                        }
                    }
                    let name = self.files.image(desc, *image)?;
                    self.string("filename", &name);
                    if let Some(power) = power {
                        self.float("power", *power);
                    }
                }
                LightDesc::Directional { direction: d, irradiance } => {
                    let _ = write!(self.text, "LightSource \"distant\" \"point3 from\" [0 0 0] \"point3 to\" [{} {} {}]", d.x, d.y, d.z);
                    self.rgb("L", *irradiance);
                }
                LightDesc::Constant { radiance } => {
                    self.text.push_str("LightSource \"infinite\"");
                    self.rgb("L", *radiance);
                }
                LightDesc::Environment { image, scale, world_from_light, mapping, portal } => {
                    if *mapping != EnvironmentMapping::EqualAreaSquare {
                        self.lose(
                            span,
                            "environment map in latitude and longitude",
                            "the picture as it is: `imgtool makeequiarea` converts it",
                        );
                    }
                    if scale[0] != scale[1] || scale[1] != scale[2] {
                        self.lose(span, "color of an environment light", "its mean");
                    }
                    self.transform("Transform", *world_from_light);
                    self.text.push_str("LightSource \"infinite\"");
                    let name = self.files.image(desc, *image)?;
                    self.string("filename", &name);
                    self.float("scale", scale.iter().sum::<f32>() / 3.0);
                    if let Some(corners) = portal {
                        // In the world, whatever the transform.
                        self.text.push_str(" \"point3 portal\" [");
                        for p in corners {
                            let _ = write!(self.text, " {} {} {}", p.x, p.y, p.z);
                        }
                        self.text.push_str(" ]");
                    }
                }
                LightDesc::SunSky(_) => self.lose(span, "sun and sky", "left out"),
            }
            self.text.push('\n');
            self.line("AttributeEnd");
        }
        Ok(())
    }
}
