//! Checks that a description can be compiled: ids in range, no cycles, finite transforms, sane sizes.

use etendue_procedural::SolidPattern;
use glam::{Mat3, Mat4};

use crate::desc::{
    BsdfDesc, Color, DisplacementDesc, EmissionSource, GeometryDesc, ImageSource, LightDesc, MediumDesc, MeshData, Param, PatternSpace,
    PhaseDesc, PictureMapping, ProjectionDesc, Scalar, SceneDesc, ShapeDesc, StopShape, TextureDesc, TextureId, VOLUME_LIMIT,
};
use crate::report::{ReadError, Report};
use crate::span::{FileId, Span};

/// Longest edge of a picture in pixels.
pub const PICTURE_EDGE_LIMIT: u32 = 65536;
/// Most pixels of a picture.
pub const PICTURE_PIXEL_LIMIT: u64 = 1 << 31;
/// Deepest nesting of scattering models and of textures.
pub const GRAPH_DEPTH_LIMIT: usize = 100;
/// Most models or textures that one expands to; shared parts count as often as they are evaluated.
pub const GRAPH_SIZE_LIMIT: u64 = 4096;

/// Checks a description; repairable oddities become warnings in its report.
///
/// # Errors
/// [`ReadError::Invalid`] with every fault.
pub fn validate(desc: &mut SceneDesc) -> Result<(), ReadError> {
    // The checks read the description while they write the report.
    let mut report = std::mem::take(&mut desc.report);
    let mut check = Checker { desc, report: &mut report };
    check.textures();
    check.bsdfs();
    check.volumes();
    check.media();
    check.meshes();
    check.shapes();
    check.lights();
    check.cameras();
    check.film();
    let failed = report.has_errors();
    desc.report = report;
    if failed {
        return Err(ReadError::Invalid { files: desc.files.clone(), faults: desc.report.faults.clone() });
    }
    Ok(())
}

struct Checker<'d> {
    desc: &'d SceneDesc,
    report: &'d mut Report,
}

impl Checker<'_> {
    fn id(&mut self, span: Span, index: u32, len: usize, what: &str) {
        if index as usize >= len {
            self.report.error(span, format!("refers to {what} {index}, but there are {len}"));
        }
    }

    fn finite(&mut self, span: Span, values: &[f32], what: &str) {
        if values.iter().any(|v| !v.is_finite()) {
            self.report.error(span, format!("{what} is not finite"));
        }
    }

    fn color(&mut self, span: Span, color: Color) {
        match color {
            Param::Constant(c) => self.finite(span, &c, "a color"),
            Param::Texture(id) => self.texture(span, id),
        }
    }

    fn scalar(&mut self, span: Span, scalar: Scalar) {
        match scalar {
            Param::Constant(v) => self.finite(span, &[v], "a parameter"),
            Param::Texture(id) => self.texture(span, id),
        }
    }

    fn texture(&mut self, span: Span, id: TextureId) {
        self.id(span, id.0, self.desc.textures.len(), "texture");
    }

    fn transform(&mut self, span: Span, m: Mat4) {
        // Relative to what the axes could span: a tiny but sound object is no fault.
        let m3 = Mat3::from_mat4(m).as_dmat3();
        let span_of_axes = m3.x_axis.length() * m3.y_axis.length() * m3.z_axis.length();
        let invertible = m3.determinant().abs() > 1e-12 * span_of_axes;
        if !m.is_finite() || !invertible {
            self.report.error(span, "a transform is not finite or cannot be inverted");
        } else if m.row(3) != glam::Vec4::W {
            self.report.error(span, "a transform is not affine");
        }
    }

    fn textures(&mut self) {
        let desc = self.desc;
        for image in &desc.images {
            if let ImageSource::Pixels { width, height, channels, data } = &image.value.source {
                let count = u64::from(*width) * u64::from(*height) * u64::from(*channels);
                if count == 0 || !(1..=4).contains(channels) || count != data.len() as u64 {
                    self.report.error(image.span, "a picture's data do not fit its size");
                }
            }
        }
        let mut children: Vec<Vec<u32>> = Vec::with_capacity(desc.textures.len());
        for node in &desc.textures {
            let span = node.span;
            let mut used = Vec::new();
            let mut color = |check: &mut Self, c: Color| {
                check.color(span, c);
                used.extend(texture_of(c));
            };
            match &node.value {
                TextureDesc::Constant { value } => color(self, Param::Constant(*value)),
                TextureDesc::Bitmap(bitmap) => {
                    self.id(span, bitmap.image.0, desc.images.len(), "image");
                    self.finite(span, &bitmap.picture_from_uv.to_cols_array(), "a transform of texture coordinates");
                }
                TextureDesc::Checkerboard { color0, color1, pattern_from_uv } => {
                    color(self, *color0);
                    color(self, *color1);
                    self.finite(span, &pattern_from_uv.to_cols_array(), "a transform of texture coordinates");
                }
                TextureDesc::Attribute { scale, .. } => self.finite(span, &[*scale], "a factor"),
                TextureDesc::Multiply { a, b } => {
                    color(self, *a);
                    color(self, *b);
                }
                TextureDesc::Mix { a, b, weight } => {
                    color(self, *a);
                    color(self, *b);
                    self.scalar(span, *weight);
                    used.extend(scalar_texture(*weight));
                }
                TextureDesc::Affine { texture, scale, offset, clamp } => {
                    self.texture(span, *texture);
                    used.push(texture.0);
                    self.finite(span, &[*scale, *offset], "a factor");
                    self.finite(span, &clamp.unwrap_or_default(), "a range");
                }
                TextureDesc::Power { texture, exponent } => {
                    self.texture(span, *texture);
                    used.push(texture.0);
                    if !(*exponent > 0.0 && exponent.is_finite()) {
                        self.report.error(span, "an exponent must be positive");
                    }
                }
                TextureDesc::Solid { pattern, space } => {
                    match space {
                        PatternSpace::World(m) => self.finite(span, &m.to_cols_array(), "a transform of a texture"),
                        PatternSpace::Uv(m) => self.finite(span, &m.to_cols_array(), "a transform of texture coordinates"),
                    }
                    match pattern {
                        SolidPattern::Fbm { roughness, .. } | SolidPattern::Turbulence { roughness, .. } => {
                            self.finite(span, &[*roughness], "a pattern's roughness");
                        }
                        SolidPattern::Marble { roughness, scale, variation, .. } => {
                            self.finite(span, &[*roughness, *scale, *variation], "a parameter of marble");
                        }
                        SolidPattern::Windy | SolidPattern::Cubes | SolidPattern::Dots | SolidPattern::Coordinate => {}
                    }
                }
                TextureDesc::Projected { texture, pattern_from_world, .. } => {
                    self.texture(span, *texture);
                    used.push(texture.0);
                    self.finite(span, &pattern_from_world.to_cols_array(), "a transform of a texture");
                }
                TextureDesc::Facing { direction } => {
                    if !direction.is_normalized() {
                        self.report.error(span, "a direction must have the length 1");
                    }
                }
            }
            children.push(used);
        }
        let spans: Vec<Span> = desc.textures.iter().map(|n| n.span).collect();
        self.graph(&children, &spans, "texture");
    }

    fn bsdfs(&mut self) {
        let desc = self.desc;
        let mut children = Vec::with_capacity(desc.bsdfs.len());
        for node in &desc.bsdfs {
            let parts = node.value.parts();
            for c in &parts.colors {
                self.color(node.span, *c);
            }
            for s in &parts.scalars {
                self.scalar(node.span, *s);
            }
            for t in &parts.textures {
                self.texture(node.span, *t);
            }
            for b in &parts.bsdfs {
                self.id(node.span, b.0, desc.bsdfs.len(), "bsdf");
            }
            if let BsdfDesc::Dielectric { int_ior, ext_ior, .. }
            | BsdfDesc::ThinDielectric { int_ior, ext_ior, .. }
            | BsdfDesc::Plastic { int_ior, ext_ior, .. }
            | BsdfDesc::Coated { int_ior, ext_ior, .. } = &node.value
                && !(*int_ior > 0.0 && *ext_ior > 0.0 && int_ior.is_finite() && ext_ior.is_finite())
            {
                self.report.error(node.span, "a refractive index must be positive and finite");
            }
            children.push(parts.bsdfs.iter().map(|b| b.0).collect::<Vec<u32>>());
        }
        let spans: Vec<Span> = desc.bsdfs.iter().map(|n| n.span).collect();
        self.graph(&children, &spans, "bsdf");
    }

    /// Reports cycles and excessive depth, each node once, without recursion.
    fn graph(&mut self, children: &[Vec<u32>], spans: &[Span], what: &str) {
        // 0: not seen; 1: on the path; 2: done.
        let mut state = vec![0u8; children.len()];
        let mut depth = vec![1usize; children.len()];
        let mut size = vec![1u64; children.len()];
        for root in 0..children.len() {
            if state[root] != 0 {
                continue;
            }
            let mut path = vec![(root, 0usize)];
            state[root] = 1;
            while let Some((node, next)) = path.last_mut() {
                let node = *node;
                let Some(child) = children[node].get(*next).map(|c| *c as usize) else {
                    state[node] = 2;
                    path.pop();
                    if let Some((parent, _)) = path.last() {
                        depth[*parent] = depth[*parent].max(depth[node] + 1);
                        size[*parent] = size[*parent].saturating_add(size[node]);
                    }
                    continue;
                };
                *next += 1;
                match state.get(child) {
                    Some(0) => {
                        state[child] = 1;
                        path.push((child, 0));
                    }
                    Some(1) => self.report.error(spans[node], format!("a {what} contains itself")),
                    Some(_) => {
                        depth[node] = depth[node].max(depth[child] + 1);
                        size[node] = size[node].saturating_add(size[child]);
                    }
                    // Out of range: told already.
                    None => {}
                }
            }
            if depth[root] > GRAPH_DEPTH_LIMIT {
                self.report.error(spans[root], format!("a {what} is nested more than {GRAPH_DEPTH_LIMIT} deep"));
            } else if size[root] > GRAPH_SIZE_LIMIT {
                self.report.error(spans[root], format!("a {what} expands to more than {GRAPH_SIZE_LIMIT} parts"));
            }
        }
    }

    fn media(&mut self) {
        for node in &self.desc.media {
            let (values, phase) = match &node.value {
                MediumDesc::Homogeneous { sigma_a, sigma_s, emission, phase } => ([*sigma_a, *sigma_s, *emission].concat(), phase),
                MediumDesc::Grid(grid) => {
                    let fields = grid.fields();
                    for volume in fields.iter().filter_map(|f| f.volume) {
                        self.id(node.span, volume.0, self.desc.volumes.len(), "volume");
                    }
                    if let Some(EmissionSource::BlackBody { offset, scale, .. }) = grid.emission.as_ref().map(|e| &e.source) {
                        self.finite(node.span, &[*offset, *scale], "a temperature");
                    }
                    (fields.iter().flat_map(|f| f.factor).collect(), &grid.phase)
                }
            };
            if values.iter().any(|v| !v.is_finite() || *v < 0.0) {
                self.report.error(node.span, "a medium's coefficients must be finite and not negative");
            }
            if !is_phase(phase, 0) {
                self.report.error(node.span, "a phase function's mean cosine must lie between -1 and 1, and its weights in [0, 1]");
            }
        }
    }

    fn volumes(&mut self) {
        for node in &self.desc.volumes {
            let volume = &node.value;
            let count = volume.size.iter().map(|n| u128::from(*n)).product::<u128>() * u128::from(volume.channels.min(4));
            if ![1, 3].contains(&volume.channels) || count > u128::from(VOLUME_LIMIT) || count != volume.data.len() as u128 || count == 0 {
                self.report.error(node.span, "a volume's data do not fit its size");
            }
            if volume.data.iter().any(|v| !(*v >= 0.0 && v.is_finite())) {
                self.report.error(node.span, "a volume's values must be finite and not negative");
            }
            self.transform(node.span, volume.world_from_volume);
        }
    }

    fn meshes(&mut self) {
        for node in &self.desc.meshes {
            if let Some(data) = &node.value.data
                && let Some(message) = mesh_fault(data)
            {
                self.report.error(node.span, message);
            }
        }
    }

    fn shapes(&mut self) {
        let desc = self.desc;
        for node in &desc.shapes {
            let (span, shape) = (node.span, &node.value);
            self.transform(span, shape.world_from_object);
            if let Some(id) = shape.bsdf {
                self.id(span, id.0, desc.bsdfs.len(), "bsdf");
            }
            if let Some(emission) = &shape.emission {
                self.color(span, emission.radiance);
            }
            for id in shape.interior.iter().chain(&shape.exterior) {
                self.id(span, id.0, desc.media.len(), "medium");
            }
            if let Some(displacement) = &shape.displacement {
                self.displacement(span, shape, displacement);
            }
            match &shape.geometry {
                GeometryDesc::Mesh { mesh, .. } => self.id(span, mesh.0, desc.meshes.len(), "mesh"),
                GeometryDesc::Sphere { center, radius } => self.sized(span, &center.to_array(), *radius),
                GeometryDesc::Cylinder { p0, p1, radius } => {
                    self.sized(span, &[p0.to_array(), p1.to_array()].concat(), *radius);
                    if p0 == p1 {
                        self.report.error(span, "a cylinder without length");
                    }
                }
                _ => {}
            }
        }
        for node in &desc.groups {
            for id in &node.value.shapes {
                self.id(node.span, id.0, desc.shapes.len(), "shape");
            }
        }
        for node in &desc.instances {
            self.id(node.span, node.value.group.0, desc.groups.len(), "group");
            self.transform(node.span, node.value.world_from_object);
        }
    }

    fn displacement(&mut self, span: Span, shape: &ShapeDesc, displacement: &DisplacementDesc) {
        self.scalar(span, displacement.height);
        if !(displacement.edge_length > 0.0 && displacement.edge_length.is_finite()) {
            self.report.error(span, "the length of edges of a displaced mesh must be positive and finite");
        }
        let GeometryDesc::Mesh { mesh, .. } = shape.geometry else {
            self.report.error(span, "only meshes can be displaced");
            return;
        };
        let data = self.desc.meshes.get(mesh.0 as usize).and_then(|m| m.value.data.as_ref());
        if data.is_some_and(|d| d.uvs.is_empty() && !d.triangles.is_empty()) {
            self.report.error(span, "a displaced mesh needs texture coordinates");
        }
    }

    fn sized(&mut self, span: Span, points: &[f32], radius: f32) {
        self.finite(span, points, "a position");
        if !(radius > 0.0 && radius.is_finite()) {
            self.report.error(span, format!("a radius must be positive and finite, not {radius}"));
        }
    }

    fn lights(&mut self) {
        let desc = self.desc;
        for node in &desc.lights {
            let span = node.span;
            match &node.value {
                LightDesc::Point { position, intensity } => self.finite(span, &[position.to_array(), *intensity].concat(), "a light"),
                LightDesc::Spot { world_from_light, intensity, outer_rad, inner_rad, texture, .. } => {
                    self.transform(span, *world_from_light);
                    self.finite(span, intensity, "a light's intensity");
                    if !(*outer_rad > 0.0 && inner_rad <= outer_rad) {
                        self.report.error(span, "a spot light's inner cone must lie within its outer cone");
                    }
                    if let Some(id) = texture {
                        self.texture(span, *id);
                    }
                }
                LightDesc::Picture { world_from_light, intensity, power, image, mapping } => {
                    self.transform(span, *world_from_light);
                    self.finite(span, intensity, "a light's intensity");
                    self.id(span, image.0, desc.images.len(), "image");
                    if power.is_some_and(|w| !(w > 0.0 && w.is_finite())) {
                        self.report.error(span, "a light's power must be positive and finite");
                    }
                    if let PictureMapping::Perspective { fov_rad } = mapping
                        && !(*fov_rad > 0.0 && *fov_rad < std::f32::consts::PI)
                    {
                        self.report.error(span, "a projector's angle must lie between 0 and 180 degrees");
                    }
                }
                LightDesc::Directional { direction, irradiance } => {
                    self.finite(span, irradiance, "a light's irradiance");
                    if !is_unit(*direction) {
                        self.report.error(span, "a light's direction must be a unit vector");
                    }
                }
                LightDesc::Constant { radiance } => self.finite(span, radiance, "a light's radiance"),
                LightDesc::Environment { image, scale, world_from_light, mapping: _, portal } => {
                    if portal.is_some_and(|corners| !is_rectangle(corners)) {
                        self.report.error(span, "a light's portal must be the four corners of a rectangle, in turn");
                    }
                    self.id(span, image.0, desc.images.len(), "image");
                    self.finite(span, scale, "a light's scale");
                    self.transform(span, *world_from_light);
                }
                LightDesc::SunSky(sky) => {
                    self.transform(span, sky.world_from_light);
                    self.finite(span, &[sky.turbidity, sky.sky_scale, sky.sun_scale, sky.sun_half_angle_rad], "a sky's parameter");
                    if !is_unit(sky.sun_direction) {
                        self.report.error(span, "the direction to the sun must be a unit vector");
                    }
                }
            }
        }
    }

    fn cameras(&mut self) {
        for node in &self.desc.cameras {
            let (span, camera) = (node.span, &node.value);
            self.transform(span, camera.world_from_camera);
            if let Some(id) = camera.medium {
                self.id(span, id.0, self.desc.media.len(), "medium");
            }
            if !(camera.near >= 0.0 && camera.far > camera.near) {
                self.report.error(span, "a camera's far plane must lie beyond its near plane");
            }
            match &camera.projection {
                &ProjectionDesc::Perspective { fov_rad, aperture_radius, focus_distance, .. } => {
                    if !(fov_rad > 0.0 && fov_rad < std::f32::consts::PI) {
                        self.report.error(span, "a field of view must lie between 0 and 180 degrees");
                    }
                    if !(aperture_radius >= 0.0 && (aperture_radius == 0.0 || focus_distance > 0.0)) {
                        self.report.error(span, "a lens needs a radius and a focus distance that are positive");
                    }
                }
                &ProjectionDesc::Orthographic { half_width, half_height } => {
                    if !(half_width > 0.0 && half_height.is_none_or(|h| h > 0.0)) {
                        self.report.error(span, "an orthographic camera's region must not be empty");
                    }
                }
                ProjectionDesc::Panoramic => {}
                ProjectionDesc::Objective(objective) => {
                    if let Err(message) = objective.film_distance() {
                        self.report.error(span, message);
                    }
                    if let StopShape::Picture(image) = objective.stop {
                        self.id(span, image.0, self.desc.images.len(), "image");
                    }
                }
            }
        }
    }

    fn film(&mut self) {
        let film = &self.desc.film;
        let span = self.desc.cameras.first().map_or(Span::file(FileId(0)), |c| c.span);
        let (width, height) = (film.width.unwrap_or(1), film.height.unwrap_or(1));
        if let Err(message) = picture_size(width, height) {
            self.report.error(span, message);
        }
        if let Some([x0, y0, x1, y1]) = film.crop
            && (x0 >= x1 || y0 >= y1 || film.width.is_some_and(|w| x1 > w) || film.height.is_some_and(|h| y1 > h))
        {
            self.report.error(span, "the crop window is empty or leaves the picture");
        }
    }
}

/// Checks the size of a picture.
///
/// # Errors
/// A sentence that tells the limit.
pub fn picture_size(width: u32, height: u32) -> Result<(), String> {
    let edge = width.max(height);
    if width == 0 || height == 0 {
        return Err(format!("a picture of {width} × {height} pixels is empty"));
    }
    if edge > PICTURE_EDGE_LIMIT || u64::from(width) * u64::from(height) > PICTURE_PIXEL_LIMIT {
        return Err(format!(
            "a picture of {width} × {height} pixels is too large: at most {PICTURE_EDGE_LIMIT} to an edge and 2^31 in all"
        ));
    }
    Ok(())
}

/// Whether corners in turn are those of a rectangle: a thousandth off at most.
fn is_rectangle(corners: [glam::Vec3; 4]) -> bool {
    let [a, b, c, d] = corners.map(|p| p.as_dvec3());
    let (x, y) = (b - a, d - a);
    let size = x.length().min(y.length());
    let near = |off: f64, scale: f64| off.abs() <= 1e-3 * scale;
    size > 0.0 && size.is_finite() && near(x.dot(y), x.length() * y.length()) && near((c - b - y).length(), size)
}

fn is_unit(v: glam::Vec3) -> bool {
    (v.length() - 1.0).abs() < 1e-3
}

fn texture_of(color: Color) -> Option<u32> {
    if let Param::Texture(id) = color { Some(id.0) } else { None }
}

fn scalar_texture(scalar: Scalar) -> Option<u32> {
    if let Param::Texture(id) = scalar { Some(id.0) } else { None }
}

/// Whether a phase function's numbers make sense.
fn is_phase(phase: &PhaseDesc, depth: usize) -> bool {
    match phase {
        PhaseDesc::Isotropic | PhaseDesc::Rayleigh => true,
        PhaseDesc::HenyeyGreenstein { g } => g.abs() < 1.0,
        PhaseDesc::Blend { first, second, weight } => {
            (0.0..=1.0).contains(weight) && depth < GRAPH_DEPTH_LIMIT && is_phase(first, depth + 1) && is_phase(second, depth + 1)
        }
    }
}

/// What is wrong with a mesh's arrays.
fn mesh_fault(data: &MeshData) -> Option<String> {
    let n = data.positions.len();
    if n > u32::MAX as usize || data.triangles.len() > u32::MAX as usize {
        return Some("a mesh has more than 2^32 vertices or triangles".to_owned());
    }
    for (len, what) in [(data.normals.len(), "normals"), (data.uvs.len(), "texture coordinates"), (data.tangents.len(), "tangents")] {
        if len != 0 && len != n {
            return Some(format!("a mesh has {n} vertices but {len} {what}"));
        }
    }
    if let Some(t) = data.triangles.iter().find(|t| t.iter().any(|i| *i as usize >= n)) {
        return Some(format!("a mesh has {n} vertices, but a triangle of {t:?}"));
    }
    for attribute in &data.attributes {
        let count = if attribute.per_face { data.triangles.len() } else { n };
        if !(1..=4).contains(&attribute.width) || attribute.data.len() != count * attribute.width as usize {
            return Some(format!("the attribute `{}` does not fit its mesh", attribute.name));
        }
    }
    None
}
