//! Rays that leave the faces of meshes (documentation, "Mesh projection").

use etendue_scene::desc::classic::{Camera, MeshCamera, Object, Solid};
use glam::{DVec2, DVec3};

use crate::solid::Line;

/// A triangle in world space with normals at its corners and its texture coordinates.
pub(super) struct Face {
    pub p: [DVec3; 3],
    pub n: [DVec3; 3],
    pub uv: [DVec2; 3],
}

/// The rays of a mesh camera.
pub(super) struct MeshRays {
    meshes: Vec<Vec<Face>>,
    distribution: u8,
    rays_per_pixel: u32,
    max_distance: f64,
    offset: f64,
    reversed: bool,
    smooth: bool,
    size: [u32; 2],
}

impl MeshRays {
    pub(super) fn new(mesh: &MeshCamera, camera: &Camera, size: [u32; 2]) -> Self {
        Self {
            meshes: mesh.meshes.iter().map(|m| faces(m)).collect(),
            distribution: mesh.distribution,
            rays_per_pixel: mesh.rays_per_pixel.max(1),
            max_distance: if mesh.max_distance > 1e-10 { mesh.max_distance } else { f64::INFINITY },
            offset: camera.location.z,
            reversed: camera.direction.z < 0.0,
            smooth: mesh.smooth,
            size,
        }
    }

    pub(super) fn max_distance(&self) -> f64 {
        self.max_distance
    }

    /// The ray of a pixel; the place within the pixel chooses among several rays.
    pub(super) fn line(&self, picture: DVec2) -> Option<Line> {
        let [width, height] = self.size.map(|s| s as usize);
        let (x, y) = ((picture.x.max(0.0) as usize).min(width - 1), (picture.y.max(0.0) as usize).min(height - 1));
        let pixel = y * width + x;
        let within = picture.x - picture.x.floor();
        let ray = ((within * f64::from(self.rays_per_pixel)) as usize).min(self.rays_per_pixel as usize - 1);
        let face = match self.distribution {
            0 => self.meshes.get(ray)?.get(pixel)?,
            1 => {
                let mut index = width * height * ray + pixel;
                self.meshes.iter().find_map(|m| {
                    let found = m.get(index);
                    index = index.wrapping_sub(m.len());
                    found
                })?
            }
            2 => {
                let each = (width / self.meshes.len().max(1)).max(1);
                self.meshes.get(x / each)?.get(y * each + x % each)?
            }
            _ => return self.by_coordinates(DVec2::new(picture.x / width as f64, 1.0 - picture.y / height as f64)),
        };
        Some(self.leave(face, DVec3::splat(1.0 / 3.0)))
    }

    /// The first face whose texture coordinates hold a point.
    fn by_coordinates(&self, at: DVec2) -> Option<Line> {
        self.meshes.iter().flatten().find_map(|face| {
            let [a, b, c] = face.uv;
            let area = (b - a).perp_dot(c - a);
            let weights = DVec3::new((c - b).perp_dot(at - b), (a - c).perp_dot(at - c), (b - a).perp_dot(at - a)) / area;
            (weights.min_element() >= 0.0).then(|| self.leave(face, weights))
        })
    }

    fn leave(&self, face: &Face, w: DVec3) -> Line {
        let p = face.p[0] * w.x + face.p[1] * w.y + face.p[2] * w.z;
        // Left-handed: to the side from which the corners run clockwise.
        let flat = (face.p[2] - face.p[0]).cross(face.p[1] - face.p[0]).normalize_or(DVec3::Y);
        let mut n = flat;
        if self.smooth && self.distribution == 3 {
            n = (face.n[0] * w.x + face.n[1] * w.y + face.n[2] * w.z).normalize_or(flat);
        }
        let d = if self.reversed { -n } else { n };
        Line { o: p + n * self.offset, d }
    }
}

/// The triangles of a mesh object in world space.
fn faces(object: &Object) -> Vec<Face> {
    let Solid::Mesh(mesh) = &object.solid else { return Vec::new() };
    let m = object.world_from_solid;
    let world_from_normal = glam::DMat3::from_mat4(m).inverse().transpose();
    let corner = |list: &[[u32; 3]], i: usize, k: usize| list.get(i).map_or(usize::MAX, |f| f[k] as usize);
    (0..mesh.faces.len())
        .map(|i| {
            let p = [0, 1, 2].map(|k| m.transform_point3(mesh.vertices.get(corner(&mesh.faces, i, k)).copied().unwrap_or_default()));
            let flat = (p[2] - p[0]).cross(p[1] - p[0]);
            let n = [0, 1, 2].map(|k| {
                let n = mesh.normals.get(corner(&mesh.normal_faces, i, k));
                n.map_or(flat, |n| (world_from_normal * *n).normalize_or(flat))
            });
            let uv = [0, 1, 2].map(|k| mesh.uvs.get(corner(&mesh.uv_faces, i, k)).copied().unwrap_or_default());
            Face { p, n, uv }
        })
        .collect()
}
