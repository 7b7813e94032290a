//! The surface where a ray hit: position, normals, tangents, texture coordinates.

use super::Scene;
use super::geometry::{Geometry, NONE, Object};
use crate::accel::{Hit, Ray};
use crate::classic::physical::SolidPoint;
use crate::math::{Frame, Vec2, Vec3};

/// A surface point.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Position in world space, on the surface.
    pub p: Vec3,
    /// Geometric normal, unit, to the outside.
    pub ng: Vec3,
    /// Shading frame: `n` is the interpolated normal on the side of `ng`'s outside; `s` follows ∂p/∂u.
    pub frame: Frame,
    /// Texture coordinates.
    pub uv: Vec2,
    /// ∂p/∂u.
    pub dpdu: Vec3,
    /// ∂p/∂v.
    pub dpdv: Vec3,
    /// Barycentrics of vertices 1 and 2, or the shape's parameters.
    pub bary: Vec2,
    /// Ray parameter.
    pub t: f32,
    /// Index of the placement: which instance was hit.
    pub instance: u32,
    /// Index of the geometry.
    pub geometry: u32,
    /// Object within the geometry.
    pub object: u32,
    /// Primitive within the geometry.
    pub primitive: u32,
    /// Material.
    pub material: u32,
    /// Width of the ray's footprint on the surface; 0 where it is not followed.
    pub footprint: f32,
    /// Where on the exact solids of a classic scene it is.
    pub solid: Option<SolidPoint>,
}

impl Surface {
    /// The light that this point belongs to, if it emits.
    pub fn light(&self, scene: &Scene) -> Option<u32> {
        let object = self.object(scene);
        (object.first_light != NONE).then(|| object.first_light + self.primitive - object.first_primitive)
    }

    /// The object.
    #[inline]
    pub fn object<'a>(&self, scene: &'a Scene) -> &'a Object {
        &scene.geometries[self.geometry as usize].objects[self.object as usize]
    }

    /// An attribute at this point, widened to four numbers; `None` where the object lacks it.
    pub fn attribute(&self, scene: &Scene, name: u32) -> Option<[f32; 4]> {
        let g = &scene.geometries[self.geometry as usize];
        let object = &g.objects[self.object as usize];
        let a = object.attributes.iter().find(|a| a.name == name)?;
        let value = |i: u32| {
            let at = (a.start + i * a.width) as usize;
            let v = &g.attribute_data[at..at + a.width as usize];
            match a.width {
                1 => [v[0], v[0], v[0], 1.0],
                2 => [v[0], v[1], 0.0, 1.0],
                3 => [v[0], v[1], v[2], 1.0],
                _ => [v[0], v[1], v[2], v[3]],
            }
        };
        if a.per_face {
            return Some(value(self.primitive - object.first_primitive));
        }
        let tri = g.triangles.get(self.primitive as usize)?;
        let [a0, a1, a2] = tri.map(|i| value(i - object.first_vertex));
        let w = 1.0 - self.bary.x - self.bary.y;
        Some(std::array::from_fn(|k| w * a0[k] + self.bary.x * a1[k] + self.bary.y * a2[k]))
    }

    /// A point that belongs to no surface of a scene: a sensor, or a place where a texture is looked up.
    pub fn free(p: Vec3, frame: Frame) -> Self {
        Self {
            p,
            ng: frame.n,
            frame,
            uv: Vec2::ZERO,
            dpdu: frame.s,
            dpdv: frame.t,
            bary: Vec2::ZERO,
            t: 0.0,
            instance: 0,
            geometry: 0,
            object: 0,
            primitive: 0,
            material: 0,
            footprint: 0.0,
            solid: None,
        }
    }

    /// The origin for a ray that leaves this point along `d`: far enough on the side of `d` not to meet the surface again
    /// (Wächter and Binder 2019, "A Fast and Robust Method for Avoiding Self-Intersection", Ray Tracing Gems ch. 6).
    #[inline]
    pub fn offset_origin(&self, d: Vec3) -> Vec3 {
        let n = if self.ng.dot(d) < 0.0 { -self.ng } else { self.ng };
        offset(self.p, n)
    }
}

/// Moves a point along a normal by a few units in the last place of the point's coordinates.
#[inline]
pub fn offset(p: Vec3, n: Vec3) -> Vec3 {
    const ORIGIN: f32 = 1.0 / 32.0;
    const FLOAT_SCALE: f32 = 1.0 / 65536.0;
    const INT_SCALE: f32 = 256.0;
    let axis = |p: f32, n: f32| {
        if p.abs() < ORIGIN {
            return p + FLOAT_SCALE * n;
        }
        let step = (INT_SCALE * n) as i32;
        let bits = p.to_bits() as i32;
        f32::from_bits(bits.wrapping_add(if p < 0.0 { -step } else { step }) as u32)
    };
    Vec3::new(axis(p.x, n.x), axis(p.y, n.y), axis(p.z, n.z))
}

/// A local surface before placement.
struct Local {
    p: Vec3,
    ng: Vec3,
    ns: Vec3,
    uv: Vec2,
    dpdu: Vec3,
    dpdv: Vec3,
    tangent: Option<(Vec3, f32)>,
}

fn triangle(g: &Geometry, object: &Object, hit: &Hit) -> Local {
    let tri = g.triangles[hit.prim as usize];
    let [p0, p1, p2] = tri.map(|i| g.positions[i as usize]);
    let (b1, b2) = (hit.u, hit.v);
    let b0 = 1.0 - b1 - b2;
    let (e1, e2) = (p1 - p0, p2 - p0);
    let ng = e1.cross(e2).normalize_or(Vec3::Z);
    let vertex = |start: u32, i: u32| (start + i - object.first_vertex) as usize;
    let ns = if object.normals == NONE {
        ng
    } else {
        let [n0, n1, n2] = tri.map(|i| g.normals[vertex(object.normals, i)]);
        (n0 * b0 + n1 * b1 + n2 * b2).normalize_or(ng)
    };
    let mut local =
        Local { p: p0 * b0 + p1 * b1 + p2 * b2, ng, ns, uv: Vec2::new(b1, b2), dpdu: Vec3::ZERO, dpdv: Vec3::ZERO, tangent: None };
    let mut corners = [Vec2::ZERO, Vec2::X, Vec2::Y];
    if object.uvs != NONE {
        corners = tri.map(|i| g.uvs[vertex(object.uvs, i)]);
        local.uv = corners[0] * b0 + corners[1] * b1 + corners[2] * b2;
    }
    if object.wants_tangents {
        let (d1, d2) = (corners[1] - corners[0], corners[2] - corners[0]);
        let det = d1.x * d2.y - d1.y * d2.x;
        if det.abs() > 1e-20 {
            local.dpdu = (e1 * d2.y - e2 * d1.y) / det;
            local.dpdv = (e2 * d1.x - e1 * d2.x) / det;
        }
        if object.tangents != NONE {
            let [t0, t1, t2] = tri.map(|i| g.tangents[vertex(object.tangents, i)]);
            local.tangent = Some((t0.truncate() * b0 + t1.truncate() * b1 + t2.truncate() * b2, t0.w));
        }
    }
    local
}

impl Scene {
    /// The surface at a hit of a ray.
    pub fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        let placement = &self.placements[hit.instance as usize];
        let g = &self.geometries[placement.geometry as usize];
        let object_index = g.object_of_primitive[hit.prim as usize];
        let object = &g.objects[object_index as usize];
        let mut local = if let Some(shape) = (hit.prim as usize).checked_sub(g.triangles.len()) {
            let mut p = ray.at(hit.t);
            if let Some(object_from_world) = placement.object_from_world {
                p = object_from_world.transform_point3(p);
            }
            let g = g.shapes[shape].surface(p);
            Local { p: g.p, ng: g.ng, ns: g.ng, uv: g.uv, dpdu: g.dpdu, dpdv: g.dpdv, tangent: None }
        } else {
            triangle(g, object, hit)
        };
        if let Some(m) = placement.world_from_object {
            local.p = m.transform_point3(local.p);
            let sign = if placement.mirrors { -1.0 } else { 1.0 };
            // Triangles' geometric normals follow the winding, which a mirror turns round; stored normals do not.
            local.ng = (placement.normal_matrix * local.ng).normalize_or(Vec3::Z);
            local.ns = (placement.normal_matrix * local.ns).normalize_or(local.ng);
            local.dpdu = m.transform_vector3(local.dpdu);
            local.dpdv = m.transform_vector3(local.dpdv);
            local.tangent = local.tangent.map(|(t, w)| (m.transform_vector3(t), w * sign));
        }
        // Analytic shapes have turned their normals themselves.
        if object.flip_normals && (hit.prim as usize) < g.triangles.len() {
            local.ng = -local.ng;
            local.ns = -local.ns;
        }
        let mut frame = if object.wants_tangents {
            Frame::from_normal_tangent(local.ns, local.tangent.map_or(local.dpdu, |(t, _)| t))
        } else {
            Frame::from_normal(local.ns)
        };
        // The bitangent of mirrored texture coordinates runs the other way (glTF 2.0, section 3.7.2.1).
        let bitangent_sign = local.tangent.map_or_else(|| frame.t.dot(local.dpdv), |(_, w)| w);
        if object.wants_tangents && bitangent_sign < 0.0 {
            frame.t = -frame.t;
        }
        Surface {
            p: local.p,
            ng: local.ng,
            frame,
            uv: local.uv,
            dpdu: local.dpdu,
            dpdv: local.dpdv,
            bary: Vec2::new(hit.u, hit.v),
            t: hit.t,
            instance: hit.instance,
            geometry: placement.geometry,
            object: object_index,
            primitive: hit.prim,
            material: object.material,
            footprint: 0.0,
            solid: None,
        }
    }
}
