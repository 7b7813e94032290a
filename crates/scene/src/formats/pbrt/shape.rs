//! Shapes.

use glam::{Mat4, Vec2, Vec3};

use super::Reader;
use super::angles::{acos, sin_cos};
use super::curve;
use super::params::Params;
use super::spectrum::SpectrumKind;
use super::subdivision::{SubdivisionFault, subdivide};
use crate::desc::{
    AddNode, BsdfDesc, Color, DisplacementDesc, EmissionDesc, GeometryDesc, MeshData, MeshDesc, MeshFormat, Node, Scalar, ShapeDesc,
    TextureDesc,
};

/// Most triangles that all subdivided meshes of a scene may have.
const SUBDIVIDED_LIMIT: usize = 20_000_000;
/// Steps of tessellation round a whole circle.
const STEPS: u32 = 96;

/// What a shape is made of, with the transform of its own space within the shape's.
struct Made {
    geometry: GeometryDesc,
    object_from_geometry: Mat4,
    displacement: Option<DisplacementDesc>,
}

impl From<GeometryDesc> for Made {
    fn from(geometry: GeometryDesc) -> Self {
        Self { geometry, object_from_geometry: Mat4::IDENTITY, displacement: None }
    }
}

impl Reader {
    /// `Shape`
    pub(super) fn shape(&mut self, name: &str, p: &Params) {
        self.check_motion(p.span);
        let alpha = self.opt_scalar(p, "alpha").unwrap_or(Scalar::Constant(1.0));
        let Some(made) = self.geometry(name, p) else { return };
        if alpha == Scalar::Constant(0.0) {
            // Not there, and no light either.
            return;
        }
        let world_from_object = self.state.transform().as_mat4() * made.object_from_geometry;
        let mut bsdf = match self.state.material {
            Some(id) => id,
            None => self.default_material(p.span),
        };
        if alpha != Scalar::Constant(1.0) {
            let nested = bsdf;
            bsdf = self.desc.add(Node::new(p.span, BsdfDesc::Mask { nested, opacity: alpha }));
        }
        let emission = self.state.area_light.clone().and_then(|light| self.emission(&light, &made.geometry, world_from_object));
        let shape = ShapeDesc {
            geometry: made.geometry,
            world_from_object,
            flip_normals: self.state.reverse_orientation,
            bsdf: Some(bsdf),
            emission,
            interior: self.state.interior,
            exterior: self.state.exterior,
            displacement: made.displacement,
        };
        let id = self.desc.add(Node::new(p.span, shape));
        if let Some((_, shapes)) = &mut self.object {
            shapes.push(id);
        }
    }

    fn geometry(&mut self, name: &str, p: &Params) -> Option<Made> {
        match name {
            "sphere" => self.sphere(p),
            "cylinder" => self.cylinder(p),
            "disk" => self.disk(p),
            "trianglemesh" => self.triangle_mesh(p),
            "bilinearmesh" => self.bilinear_mesh(p),
            "plymesh" => self.ply_mesh(p),
            "loopsubdiv" => self.loop_subdivision(p),
            "curve" => self.curve(p),
            _ => {
                self.error(
                    p.span,
                    format!("no shape `{name}`; there are sphere, cylinder, disk, trianglemesh, bilinearmesh, plymesh, loopsubdiv, curve"),
                );
                None
            }
        }
    }

    fn positive(&mut self, p: &Params, name: &str, default: f32) -> Option<f32> {
        let v = p.float(name, default, &mut self.desc.report);
        if v > 0.0 && v.is_finite() {
            return Some(v);
        }
        self.error(p.span, format!("`{name}` must be positive, not {v}"));
        None
    }

    fn sphere(&mut self, p: &Params) -> Option<Made> {
        let radius = self.positive(p, "radius", 1.0)?;
        let r = &mut self.desc.report;
        let (z0, z1) = (p.float("zmin", -radius, r), p.float("zmax", radius, r));
        let (z0, z1) = (z0.min(z1).clamp(-radius, radius), z0.max(z1).clamp(-radius, radius));
        let phi = p.float("phimax", 360.0, r).clamp(0.0, 360.0).to_radians();
        if z0 <= -radius && z1 >= radius && phi >= std::f32::consts::TAU {
            return Some(GeometryDesc::Sphere { center: Vec3::ZERO, radius }.into());
        }
        let (t0, t1) = (acos(z0 / radius), acos(z1 / radius));
        let mesh = revolved(phi, STEPS / 2, |v| {
            let (sin, cos) = sin_cos(t0 + (t1 - t0) * v);
            (Vec2::new(sin, cos) * radius, Vec2::new(sin, cos))
        });
        Some(self.mesh(mesh, p))
    }

    fn cylinder(&mut self, p: &Params) -> Option<Made> {
        let radius = self.positive(p, "radius", 1.0)?;
        let r = &mut self.desc.report;
        let (z0, z1) = (p.float("zmin", -1.0, r), p.float("zmax", 1.0, r));
        let phi = p.float("phimax", 360.0, r).clamp(0.0, 360.0).to_radians();
        if phi >= std::f32::consts::TAU {
            return Some(GeometryDesc::Cylinder { p0: Vec3::Z * z0, p1: Vec3::Z * z1, radius }.into());
        }
        let mesh = revolved(phi, 1, |v| (Vec2::new(radius, z0 + (z1 - z0) * v), Vec2::X));
        Some(self.mesh(mesh, p))
    }

    fn disk(&mut self, p: &Params) -> Option<Made> {
        let radius = self.positive(p, "radius", 1.0)?;
        let r = &mut self.desc.report;
        let (height, inner) = (p.float("height", 0.0, r), p.float("innerradius", 0.0, r).clamp(0.0, radius));
        let phi = p.float("phimax", 360.0, r).clamp(0.0, 360.0).to_radians();
        if inner == 0.0 && phi >= std::f32::consts::TAU {
            let object_from_geometry = Mat4::from_translation(Vec3::Z * height) * Mat4::from_scale(Vec3::new(radius, radius, 1.0));
            return Some(Made { object_from_geometry, ..GeometryDesc::Disk.into() });
        }
        let mesh = revolved(phi, 1, |v| (Vec2::new(radius + (inner - radius) * v, height), Vec2::Y));
        Some(self.mesh(mesh, p))
    }

    fn mesh(&mut self, data: MeshData, p: &Params) -> Made {
        let smooth = !data.normals.is_empty();
        let mesh = self.desc.add(Node::new(p.span, MeshDesc { file: None, flip_v: false, data: Some(data) }));
        GeometryDesc::Mesh { mesh, face_normals: !smooth, smooth: false }.into()
    }

    fn triangle_mesh(&mut self, p: &Params) -> Option<Made> {
        let r = &mut self.desc.report;
        let positions = p.vectors("P", r);
        let mut indices = p.indices("indices", positions.len(), r)?;
        if indices.is_empty() && positions.len() == 3 {
            indices = vec![0, 1, 2];
        }
        if positions.is_empty() || indices.is_empty() || indices.len() % 3 != 0 {
            r.error(p.span, "a trianglemesh needs points `P`, and `indices` of which each three make a triangle");
            return None;
        }
        p.ignore(&["faceIndices", "S", "emissionfilename"]);
        let uvs = p.vectors2("uv", r);
        let normals = p.vectors("N", r);
        for (name, len) in [("uv", uvs.len()), ("N", normals.len())] {
            if len != 0 && len != positions.len() {
                r.error(p.span, format!("`{name}` has {len} entries for {} points", positions.len()));
                return None;
            }
        }
        let normals = normals.into_iter().map(|n| n.normalize_or(Vec3::Z)).collect();
        let triangles = indices.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
        Some(self.mesh(MeshData { positions, triangles, normals, uvs, ..MeshData::default() }, p))
    }

    /// Each patch is split along the diagonal: exact where it is flat, and near where it is small.
    fn bilinear_mesh(&mut self, p: &Params) -> Option<Made> {
        let r = &mut self.desc.report;
        let positions = p.vectors("P", r);
        let mut indices = p.indices("indices", positions.len(), r)?;
        if indices.is_empty() && positions.len() == 4 {
            indices = vec![0, 1, 2, 3];
        }
        if positions.is_empty() || indices.is_empty() || indices.len() % 4 != 0 {
            r.error(p.span, "a bilinearmesh needs points `P`, and `indices` of which each four make a patch");
            return None;
        }
        p.ignore(&["faceIndices", "emissionfilename"]);
        let uvs = p.vectors2("uv", r);
        let normals = p.vectors("N", r);
        let fits = |n: usize| n == 0 || n == positions.len();
        if !fits(uvs.len()) || !fits(normals.len()) {
            r.error(p.span, "`uv` and `N` have one entry for each point");
            return None;
        }
        let mut mesh = MeshData::default();
        for patch in indices.chunks_exact(4) {
            let corners: [Vec3; 4] = std::array::from_fn(|k| positions[patch[k] as usize]);
            let [p00, p10, p01, p11] = corners;
            let flat = {
                let n = (p10 - p00).cross(p01 - p00).normalize_or_zero();
                let size = (p11 - p00).length().max((p10 - p01).length());
                (p11 - p00).dot(n).abs() <= 1e-4 * size
            };
            // A parallelogram in two triangles, a bent patch in a grid.
            let steps = if flat { 1 } else { 8 };
            let base = mesh.positions.len() as u32;
            let at = |u: f32, v: f32| p00.lerp(p10, u).lerp(p01.lerp(p11, u), v);
            for j in 0..=steps {
                for i in 0..=steps {
                    let (u, v) = (i as f32 / steps as f32, j as f32 / steps as f32);
                    mesh.positions.push(at(u, v));
                    let blend2 = |c: &[Vec2]| {
                        let g = |k: usize| c[patch[k] as usize];
                        g(0).lerp(g(1), u).lerp(g(2).lerp(g(3), u), v)
                    };
                    mesh.uvs.push(if uvs.is_empty() { Vec2::new(u, v) } else { blend2(&uvs) });
                    if !normals.is_empty() {
                        let g = |k: usize| normals[patch[k] as usize];
                        mesh.normals.push(g(0).lerp(g(1), u).lerp(g(2).lerp(g(3), u), v).normalize_or(Vec3::Z));
                    } else if !flat {
                        let (du, dv) = ((p10 - p00).lerp(p11 - p01, v), (p01 - p00).lerp(p11 - p10, u));
                        mesh.normals.push(du.cross(dv).normalize_or(Vec3::Z));
                    } else {
                        mesh.normals.push((p10 - p00).cross(p01 - p00).normalize_or(Vec3::Z));
                    }
                }
            }
            let row = steps + 1;
            for j in 0..steps {
                for i in 0..steps {
                    let a = base + j * row + i;
                    mesh.triangles.extend([[a, a + 1, a + row + 1], [a, a + row + 1, a + row]]);
                }
            }
        }
        Some(self.mesh(mesh, p))
    }

    fn ply_mesh(&mut self, p: &Params) -> Option<Made> {
        let r = &mut self.desc.report;
        let Some(name) = p.opt_text("filename", r).map(str::to_owned) else {
            r.error(p.span, "a plymesh needs a `filename`");
            return None;
        };
        let displacement = self.displacement(p)?;
        let path = self.resolve(&name, p.span)?;
        let mesh = match self.meshes.get(&path) {
            Some(id) => *id,
            None => {
                let file = Some((path.clone(), MeshFormat::Ply, 0));
                let id = self.desc.add(Node::named(&name, p.span, MeshDesc { file, flip_v: false, data: None }));
                self.meshes.insert(path, id);
                id
            }
        };
        Some(Made { displacement, ..GeometryDesc::Mesh { mesh, face_normals: false, smooth: false }.into() })
    }

    /// `displacement` of a plymesh; `Some(None)` where it has none, `None` with a fault where it is wrong.
    fn displacement(&mut self, p: &Params) -> Option<Option<DisplacementDesc>> {
        // The format's description and pbrt itself have two names for one parameter.
        let name = if p.has("displacement.edgelength") { "displacement.edgelength" } else { "edgelength" };
        if !p.has("displacement") {
            p.ignore(&["displacement.edgelength", "edgelength"]);
            return Some(None);
        }
        let edge_length = self.positive(p, name, 1.0)?;
        let height = self.opt_scalar(p, "displacement")?;
        Some(Some(DisplacementDesc { height, edge_length }))
    }

    fn loop_subdivision(&mut self, p: &Params) -> Option<Made> {
        let r = &mut self.desc.report;
        let positions = p.vectors("P", r);
        let indices = p.indices("indices", positions.len(), r)?;
        let levels = p.opt_integer("levels", r).unwrap_or(3).clamp(0, 12) as u32;
        p.ignore(&["scheme"]);
        if indices.is_empty() || indices.len() % 3 != 0 {
            r.error(p.span, "a loopsubdiv needs points `P`, and `indices` of which each three make a triangle");
            return None;
        }
        if self.subdivided > SUBDIVIDED_LIMIT {
            self.error(p.span, format!("the subdivided meshes of this scene have more than {SUBDIVIDED_LIMIT} triangles"));
            return None;
        }
        let triangles: Vec<[u32; 3]> = indices.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
        match subdivide(&positions, &triangles, levels) {
            Ok(data) => {
                self.subdivided += data.triangles.len();
                Some(self.mesh(data, p))
            }
            Err(fault) => {
                let message = match fault {
                    SubdivisionFault::NotAManifold => "an edge of the control mesh has more than two triangles",
                    SubdivisionFault::TooMany => "so many levels would make too many triangles",
                };
                self.error(p.span, message);
                None
            }
        }
    }

    fn curve(&mut self, p: &Params) -> Option<Made> {
        let r = &mut self.desc.report;
        let points = p.vectors("P", r);
        let degree = p.opt_integer("degree", r).unwrap_or(3);
        let bspline = match p.opt_text("basis", r).unwrap_or("bezier") {
            "bezier" => false,
            "bspline" => true,
            other => {
                let message = format!("no basis `{other}`; there are bezier, bspline");
                r.error(p.span, message);
                return None;
            }
        };
        let width = p.float("width", 1.0, r);
        let (w0, w1) = (p.float("width0", width, r), p.float("width1", width, r));
        p.ignore(&["type", "N", "splitdepth"]);
        if !(2..=3).contains(&degree) {
            r.error(p.span, format!("a curve's degree is 2 or 3, not {degree}"));
            return None;
        }
        let Some(segments) = curve::segments(&points, degree as usize, bspline, w0, w1) else {
            r.error(p.span, format!("{} points do not make a curve of this basis and degree", points.len()));
            return None;
        };
        r.loss(p.span, "Shape \"curve\"", "a mesh: a tube of its width");
        Some(self.mesh(curve::tube(&segments), p))
    }

    /// `AreaLightSource "diffuse"` for a shape.
    fn emission(&mut self, light: &Params, geometry: &GeometryDesc, world_from_object: Mat4) -> Option<EmissionDesc> {
        let area = light.has("power").then(|| area(geometry, world_from_object, &self.desc)).flatten();
        let r = &mut self.desc.report;
        let mut scale = light.float("scale", 1.0, r);
        let two_sided = light.boolean("twosided", false, r);
        if let Some(power) = light.opt_float("power", r).filter(|v| *v > 0.0) {
            match area.filter(|a| *a > 0.0) {
                Some(area) => scale *= power / (std::f32::consts::PI * area * if two_sided { 2.0 } else { 1.0 }),
                None => r.loss(light.span, "power of an area light", "its radiance and scale"),
            }
        }
        let radiance = match light.opt_text("filename", &mut self.desc.report).map(str::to_owned) {
            Some(name) => {
                let image = self.image(&name, light.span)?;
                let bitmap = crate::desc::BitmapDesc {
                    image,
                    encoding: crate::desc::Encoding::Auto,
                    wrap: [crate::desc::Wrap::Clamp; 2],
                    filter: crate::desc::TextureFilter::Bilinear,
                    picture_from_uv: glam::Mat3::IDENTITY,
                    channel: crate::desc::Channel::Luminance,
                    uv_set: 0,
                };
                let texture = self.desc.add(Node::new(light.span, TextureDesc::Bitmap(bitmap)));
                let scaled = TextureDesc::Affine { texture, scale, offset: 0.0, clamp: None };
                Color::Texture(self.desc.add(Node::new(light.span, scaled)))
            }
            None => {
                let l = light.get("L").and_then(|q| self.color(q, SpectrumKind::Illuminant)).unwrap_or([1.0; 3]);
                Color::Constant(l.map(|v| v * scale))
            }
        };
        // The list is read again by the next shape; what it holds beside these is unknown.
        Some(EmissionDesc { radiance, two_sided, group: String::new() })
    }
}

/// Area in the world; `None` where it is not known before files are loaded.
fn area(geometry: &GeometryDesc, m: Mat4, desc: &crate::desc::SceneDesc) -> Option<f32> {
    let scale = etendue_procedural::fns::pow(f64::from(m.determinant().abs()), 1.0 / 3.0) as f32;
    match geometry {
        GeometryDesc::Sphere { radius, .. } => Some(4.0 * std::f32::consts::PI * (radius * scale).powi(2)),
        GeometryDesc::Cylinder { p0, p1, radius } => Some(std::f32::consts::TAU * radius * scale * m.transform_vector3(*p1 - *p0).length()),
        GeometryDesc::Disk => Some(std::f32::consts::PI * m.x_axis.truncate().cross(m.y_axis.truncate()).length()),
        GeometryDesc::Mesh { mesh, .. } => {
            let data = desc[*mesh].value.data.as_ref()?;
            let p = |i: u32| m.transform_point3(data.positions[i as usize]);
            Some(data.triangles.iter().map(|t| 0.5 * (p(t[1]) - p(t[0])).cross(p(t[2]) - p(t[0])).length()).sum())
        }
        _ => None,
    }
}

/// A surface of revolution about +z over the angle `phi`: `profile(v)` gives (radius, z) and the normal in that plane.
fn revolved(phi: f32, rows: u32, profile: impl Fn(f32) -> (Vec2, Vec2)) -> MeshData {
    let mut mesh = MeshData::default();
    let columns = ((phi / std::f32::consts::TAU * STEPS as f32).ceil() as u32).max(1);
    for j in 0..=rows {
        let v = j as f32 / rows as f32;
        let (p, n) = profile(v);
        for i in 0..=columns {
            let u = i as f32 / columns as f32;
            let (sin, cos) = sin_cos(phi * u);
            mesh.positions.push(Vec3::new(p.x * cos, p.x * sin, p.y));
            mesh.normals.push(Vec3::new(n.x * cos, n.x * sin, n.y).normalize_or(Vec3::Z));
            mesh.uvs.push(Vec2::new(u, v));
        }
    }
    let row = columns + 1;
    for j in 0..rows {
        for i in 0..columns {
            let a = j * row + i;
            for t in [[a, a + 1, a + row + 1], [a, a + row + 1, a + row]] {
                // Towards the stored normals.
                let [x, y, z] = t.map(|k| mesh.positions[k as usize]);
                let face = (y - x).cross(z - x);
                if face != Vec3::ZERO {
                    let outside = face.dot(mesh.normals[a as usize] + mesh.normals[t[1] as usize] + mesh.normals[t[2] as usize]) > 0.0;
                    mesh.triangles.push(if outside { t } else { [t[0], t[2], t[1]] });
                }
            }
        }
    }
    mesh
}
