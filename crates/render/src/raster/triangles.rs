//! What is drawn: the triangles of a scene, of instances and of analytic shapes too.

use glam::{DMat4, DVec3};

use crate::math::{Aabb, Mat4, Vec3};
use crate::scene::Scene;

/// Triangles in a chunk: what is culled at once.
pub(super) const CHUNK: usize = 128;

/// Triangles in one space.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Vertices.
    pub positions: Vec<Vec3>,
    /// Indices into `positions`.
    pub triangles: Vec<[u32; 3]>,
    /// Primitive in the scene's geometry of each triangle; empty where it is the triangle's own number.
    primitives: Vec<u32>,
    /// Object of each triangle; empty for meshes without objects.
    objects: Vec<u32>,
    /// Whether light passes straight through in places; empty where it never does.
    masked: Vec<bool>,
    /// Boxes of [`CHUNK`] triangles each.
    pub(super) chunks: Vec<Aabb>,
}

/// A placed mesh.
#[derive(Clone, Debug)]
pub struct Part {
    /// Index into [`Triangles::meshes`].
    pub mesh: u32,
    /// Index of the scene's placement.
    pub instance: u32,
    /// Number of the first triangle.
    pub first: u32,
    /// `None` is the identity.
    pub world_from_object: Option<DMat4>,
}

/// All triangles of a scene, numbered from 0.
#[derive(Clone, Debug, Default)]
pub struct Triangles {
    /// Meshes, each placed any number of times.
    pub meshes: Vec<Mesh>,
    /// Where they are placed; `first` rises.
    pub parts: Vec<Part>,
    count: u32,
}

/// What a triangle's number stands for.
#[derive(Clone, Copy, Debug)]
pub struct Located {
    /// Index of the scene's placement.
    pub instance: u32,
    /// Primitive in the placement's geometry: a triangle, or an analytic shape.
    pub primitive: u32,
    /// Whether the primitive is a triangle of the scene, so that barycentric coordinates are its own.
    pub is_triangle: bool,
    /// Object in the geometry.
    pub object: u32,
    /// Corners in the world.
    pub corners: [DVec3; 3],
}

impl Mesh {
    /// A mesh of its own, without a scene. Indices must be in range.
    pub fn new(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        let mut mesh = Self { positions, triangles, ..Self::default() };
        mesh.find_chunks();
        mesh
    }

    fn find_chunks(&mut self) {
        let corners = |t: &[u32; 3]| t.map(|i| self.positions.get(i as usize).copied().unwrap_or(Vec3::NAN));
        self.chunks = self.triangles.chunks(CHUNK).map(|c| Aabb::from_points(c.iter().flat_map(corners))).collect();
    }

    /// The object of a triangle; 0 for meshes without objects.
    #[inline]
    pub fn object(&self, triangle: usize) -> u32 {
        self.objects.get(triangle).copied().unwrap_or(0)
    }

    /// Whether light passes straight through a triangle in places.
    #[inline]
    pub fn is_masked(&self, triangle: usize) -> bool {
        self.masked.get(triangle).copied().unwrap_or(false)
    }

    #[inline]
    pub(super) fn corners(&self, triangle: usize) -> Option<[Vec3; 3]> {
        let [a, b, c] = self.triangles.get(triangle)?.map(|i| self.positions.get(i as usize).copied());
        Some([a?, b?, c?])
    }
}

impl Triangles {
    /// The triangles of a scene. Analytic shapes are tessellated; planes reach far beyond the scene. Costs a copy of the positions
    /// and indices, once for each geometry, not for each instance.
    ///
    /// # Errors
    /// A sentence where instances make more triangles than numbers.
    pub fn from_scene(scene: &Scene) -> Result<Self, String> {
        let reach = plane_reach(scene);
        let meshes: Vec<Mesh> = scene
            .geometries
            .iter()
            .map(|g| {
                let mut mesh = Mesh { positions: g.positions.clone(), triangles: g.triangles.clone(), ..Mesh::default() };
                if !g.shapes.is_empty() {
                    mesh.primitives = (0..g.triangles.len() as u32).collect();
                }
                for (i, shape) in g.shapes.iter().enumerate() {
                    let (positions, triangles) = shape.tessellate(reach);
                    let base = mesh.positions.len() as u32;
                    mesh.positions.extend(positions);
                    mesh.primitives.resize(mesh.primitives.len() + triangles.len(), (g.triangles.len() + i) as u32);
                    mesh.triangles.extend(triangles.into_iter().map(|t| t.map(|v| v + base)));
                }
                let primitive = |t: usize| mesh.primitives.get(t).map_or(t, |p| *p as usize);
                let objects: Vec<u32> = (0..mesh.triangles.len()).map(|t| g.object_of_primitive[primitive(t)]).collect();
                let is_masked = |o: &u32| scene.materials[g.objects[*o as usize].material as usize].has_null;
                if objects.iter().any(is_masked) {
                    mesh.masked = objects.iter().map(is_masked).collect();
                }
                mesh.objects = objects;
                mesh.find_chunks();
                mesh
            })
            .collect();
        let placed: Vec<(u32, Option<Mat4>)> = scene.placements.iter().map(|p| (p.geometry, p.world_from_object)).collect();
        Self::new(meshes, &placed)
    }

    /// One mesh as it is.
    pub fn from_mesh(mesh: Mesh) -> Self {
        // A single mesh has at most as many triangles as its index type has numbers.
        Self::new(vec![mesh], &[(0, None)]).unwrap_or_default()
    }

    /// Meshes in their places.
    ///
    /// # Errors
    /// A sentence where there are more triangles than numbers.
    pub fn new(meshes: Vec<Mesh>, placed: &[(u32, Option<Mat4>)]) -> Result<Self, String> {
        let mut all = Self { meshes, ..Self::default() };
        for (instance, &(mesh, transform)) in placed.iter().enumerate() {
            let Some(count) = all.meshes.get(mesh as usize).map(|m| m.triangles.len()) else { continue };
            if count > 0 {
                let world_from_object = transform.map(|m| m.as_dmat4());
                all.parts.push(Part { mesh, instance: instance as u32, first: all.count, world_from_object });
            }
            // The last number means "nothing".
            let sum = u64::from(all.count) + count as u64;
            all.count =
                u32::try_from(sum).ok().filter(|n| *n < u32::MAX).ok_or("instances make more than 2³² triangles, too many to draw")?;
        }
        Ok(all)
    }

    /// How many there are.
    pub fn len(&self) -> u32 {
        self.count
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// What a number stands for; `None` beyond the last.
    pub fn locate(&self, id: u32) -> Option<Located> {
        if id >= self.count {
            return None;
        }
        let part = &self.parts[self.parts.partition_point(|p| p.first <= id).checked_sub(1)?];
        let mesh = &self.meshes[part.mesh as usize];
        let triangle = (id - part.first) as usize;
        let corners = mesh.corners(triangle)?.map(|p| match part.world_from_object {
            None => p.as_dvec3(),
            Some(m) => m.transform_point3(p.as_dvec3()),
        });
        let primitive = mesh.primitives.get(triangle).copied().unwrap_or(triangle as u32);
        Some(Located {
            instance: part.instance,
            primitive,
            // Tessellated shapes come after the triangles, and their primitives are fewer.
            is_triangle: primitive as usize == triangle,
            object: mesh.object(triangle),
            corners,
        })
    }
}

/// How far planes are drawn: far enough to look endless, near enough for their coordinates to keep their digits.
fn plane_reach(scene: &Scene) -> f32 {
    let (center, radius) = scene.bounds.bounding_sphere();
    let reach = 1e4 * (radius + center.length()).max(1.0);
    if reach.is_finite() { reach } else { 1e6 }
}
