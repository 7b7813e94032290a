//! Triangle meshes with their own hierarchy.

use std::sync::Arc;

use etendue_procedural::Texture;
use etendue_scene::desc::classic;
use glam::{DVec2, DVec3};

use super::bvh::Bvh;
use super::triangle::{flat_normal, intersect, smooth};
use super::{Bounds, Crossing, Line, Primitive};

/// Many triangles; the part of a crossing is the triangle's number, its parameters the barycentric coordinates of the second and third
/// corner.
pub(super) struct Mesh {
    data: Arc<classic::Mesh>,
    /// First corner and the edges to the others, by triangle of the hierarchy.
    triangles: Vec<(DVec3, [DVec3; 2])>,
    bvh: Bvh,
    /// Direction that tells the inside.
    inside_vector: Option<DVec3>,
}

impl Mesh {
    /// `None` without any triangle.
    pub(super) fn new(data: &Arc<classic::Mesh>) -> Option<Self> {
        let corner = |i: u32| data.vertices.get(i as usize).copied().unwrap_or(DVec3::NAN);
        let triangles: Vec<(DVec3, [DVec3; 2])> =
            data.faces.iter().map(|f| (corner(f[0]), [corner(f[1]) - corner(f[0]), corner(f[2]) - corner(f[0])])).collect();
        let bvh = Bvh::new(triangles.iter().map(|(a, [e, f])| {
            // Triangles without area or with unknown corners are left out.
            if e.cross(*f).try_normalize().is_some() { Bounds::of_points([*a, *a + *e, *a + *f]).padded() } else { Bounds::EMPTY }
        }));
        if bvh.bounds().is_empty() {
            return None;
        }
        let inside_vector = data.inside_vector.and_then(DVec3::try_normalize);
        Some(Self { data: data.clone(), triangles, bvh, inside_vector })
    }

    fn flat(&self, part: u32) -> DVec3 {
        self.triangles.get(part as usize).map_or(DVec3::Y, |(_, edges)| flat_normal(edges))
    }

    /// Values at the corners of a triangle, where it has them.
    fn corners<T: Copy>(values: &[T], faces: &[[u32; 3]], part: u32) -> Option<[T; 3]> {
        let [a, b, c] = *faces.get(part as usize)?;
        Some([*values.get(a as usize)?, *values.get(b as usize)?, *values.get(c as usize)?])
    }
}

impl Primitive for Mesh {
    fn bounds(&self) -> Bounds {
        self.bvh.bounds()
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        self.bvh.visit(line, t_min, t_max, |i, _| {
            let (corner, edges) = &self.triangles[i as usize];
            if let Some((t, uv)) = intersect(*corner, edges, line)
                && t > t_min
                && t < t_max
            {
                out.push(Crossing { t, part: i, uv });
            }
            true
        });
    }

    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, _scratch: &mut Vec<Crossing>) -> Option<Crossing> {
        let mut best: Option<Crossing> = None;
        self.bvh.visit(line, t_min, t_max, |i, limit| {
            let (corner, edges) = &self.triangles[i as usize];
            if let Some((t, uv)) = intersect(*corner, edges, line)
                && t > t_min
                && t < *limit
            {
                *limit = t;
                best = Some(Crossing { t, part: i, uv });
            }
            true
        });
        best
    }

    fn inside(&self, p: DVec3) -> bool {
        let Some(d) = self.inside_vector else { return false };
        if !self.bvh.bounds().contains(p) {
            return false;
        }
        let line = Line { o: p, d };
        let mut odd = false;
        self.bvh.visit(&line, 0.0, f64::INFINITY, |i, _| {
            let (corner, edges) = &self.triangles[i as usize];
            odd ^= intersect(*corner, edges, &line).is_some_and(|(t, _)| t > 0.0);
            true
        });
        odd
    }

    fn inside_bounds(&self) -> Bounds {
        if self.inside_vector.is_some() { self.bounds() } else { Bounds::EMPTY }
    }

    fn normal(&self, _p: DVec3, crossing: &Crossing) -> DVec3 {
        let flat = self.flat(crossing.part);
        match Self::corners(&self.data.normals, &self.data.normal_faces, crossing.part) {
            Some(normals) => smooth(&normals, crossing.uv, flat),
            None => flat,
        }
    }

    fn geometric_normal(&self, p: DVec3, crossing: &Crossing) -> DVec3 {
        let flat = self.flat(crossing.part);
        if flat.dot(self.normal(p, crossing)) < 0.0 { -flat } else { flat }
    }

    fn uv(&self, _p: DVec3, crossing: &Crossing) -> DVec2 {
        let w = crossing.uv;
        match Self::corners(&self.data.uvs, &self.data.uv_faces, crossing.part) {
            Some([a, b, c]) => a * (1.0 - w.x - w.y) + b * w.x + c * w.y,
            None => w,
        }
    }

    fn own_textures(&self) -> Vec<Arc<Texture>> {
        self.data.textures.clone()
    }

    fn part_textures(&self, _p: DVec3, crossing: &Crossing, visit: &mut dyn FnMut(f64, Option<usize>)) {
        let own = |i: u32| ((i as usize) < self.data.textures.len()).then_some(i as usize);
        match self.data.texture_faces.get(crossing.part as usize) {
            Some([a, b, c]) if a == b && b == c => visit(1.0, own(*a)),
            Some(faces) => {
                let weights = [1.0 - crossing.uv.x - crossing.uv.y, crossing.uv.x, crossing.uv.y];
                faces.iter().zip(weights).for_each(|(&i, w)| visit(w, own(i)));
            }
            None => visit(1.0, None),
        }
    }
}
