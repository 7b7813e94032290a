//! The scene graph: nodes become placed shapes, instances, lights and cameras.

use glam::{DMat4, DQuat, DVec3, Mat4, Vec3};

use super::Reader;
use super::accessor::Component::{F32, I8, I16};
use super::animation::Pose;
use super::material::MaterialKey;
use super::mesh::{MeshKey, Primitive};
use crate::desc::{AddNode, GeometryDesc, GroupDesc, GroupId, InstanceDesc, Node, ShapeDesc};
use crate::formats::gltf::json::Value;

/// More shapes and instances than these are refused.
const PLACEMENT_LIMIT: usize = 10_000_000;
/// A mesh that is placed several times is instanced where it has more triangles than this; smaller ones are repeated.
const INSTANCE_MIN_TRIANGLES: usize = 1000;
/// It is instanced, too, where repeating it would make more triangles than this in all.
const REPEAT_MAX_TRIANGLES: usize = 200_000;

/// What an animation says of nodes, by their number.
type Poses = std::collections::HashMap<usize, Pose>;

/// A mesh at a place.
struct Placement<'a> {
    key: MeshKey,
    node: &'a Value<'a>,
    world_from_mesh: Mat4,
}

impl<'a> Reader<'a> {
    pub(super) fn read_scene(&mut self) {
        let nodes = self.list("nodes");
        let Some(roots) = self.scene_roots(nodes) else { return };
        let poses = self.poses();
        let (order, world) = self.world_transforms(nodes, &roots, &poses);
        let mut placements = Vec::new();
        for &i in &order {
            let (node, Some(transform)) = (&nodes[i], &world[i]) else { continue };
            self.light(node, transform);
            self.camera(node, transform);
            let weights = poses.get(&i).and_then(|p| p.weights.as_deref());
            self.place_mesh(i, node, transform, &world, weights, &mut placements);
        }
        self.add_shapes(&placements);
    }

    /// The root nodes of the scene that was asked for.
    fn scene_roots(&mut self, nodes: &'a [Value<'a>]) -> Option<Vec<usize>> {
        let scenes = self.list("scenes");
        let scene = if let Some(wanted) = self.options.scene.as_deref() {
            let names: Vec<String> = scenes.iter().map(|s| self.name(s)).collect();
            let by_number = wanted.parse().ok().filter(|&i: &usize| i < names.len());
            let Some(i) = names.iter().position(|n| n == wanted).or(by_number) else {
                let known: Vec<String> = names.iter().enumerate().map(|(i, n)| format!("{i} `{n}`")).collect();
                self.error(self.root, format!("no scene `{wanted}`; there are: {}", known.join(", ")));
                return None;
            };
            Some(&scenes[i])
        } else if self.root.get("scene").is_some() {
            Some(self.reference(self.root, "scene", "scenes")?.1)
        } else {
            scenes.first()
        };
        let Some(scene) = scene else {
            // No scene at all: everything that is no node's child.
            let mut is_child = vec![false; nodes.len()];
            for node in nodes {
                for child in self.array(node, "children") {
                    if let Some((c, _)) = self.reference_of(child, "nodes") {
                        is_child[c] = true;
                    }
                }
            }
            return Some((0..nodes.len()).filter(|&i| !is_child[i]).collect());
        };
        Some(self.array(scene, "nodes").iter().filter_map(|v| self.reference_of(v, "nodes")).map(|(i, _)| i).collect())
    }

    /// The nodes of the scene, parents first and otherwise in the file's order, and where each is in the world.
    fn world_transforms(&mut self, nodes: &'a [Value<'a>], roots: &[usize], poses: &Poses) -> (Vec<usize>, Vec<Option<DMat4>>) {
        let mut world = vec![None; nodes.len()];
        let mut order = Vec::new();
        // A stack of our own: the hierarchy may be as deep as the file likes.
        let mut stack: Vec<(usize, DMat4)> = roots.iter().rev().map(|&i| (i, DMat4::IDENTITY)).collect();
        while let Some((i, parent)) = stack.pop() {
            let node = &nodes[i];
            if world[i].is_some() {
                self.error(node, "the node is its own ancestor or has two parents");
                continue;
            }
            let transform = parent * self.local_transform(node, poses.get(&i));
            if !transform.as_mat4().is_finite() {
                self.error(node, "the node's transform is not finite");
                continue;
            }
            world[i] = Some(transform);
            if let Some(e) = self.extension(node, "KHR_node_visibility")
                && !self.bool(e, "visible", true)
            {
                continue;
            }
            order.push(i);
            for child in self.array(node, "children").iter().rev() {
                if let Some((c, _)) = self.reference_of(child, "nodes") {
                    stack.push((c, transform));
                }
            }
        }
        (order, world)
    }

    fn local_transform(&mut self, node: &'a Value<'a>, pose: Option<&Pose>) -> DMat4 {
        if node.get("matrix").is_some() {
            let Some(m) = self.floats::<16>(node, "matrix") else { return DMat4::IDENTITY };
            if m[3] != 0.0 || m[7] != 0.0 || m[11] != 0.0 || m[15] != 1.0 {
                self.error(node, "the matrix is not affine: its last row must be 0, 0, 0, 1");
                return DMat4::IDENTITY;
            }
            return Mat4::from_cols_array(&m).as_dmat4();
        }
        let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        let t = self.floats(node, "translation").map_or(DVec3::ZERO, vector);
        let s = self.floats(node, "scale").map_or(DVec3::ONE, vector);
        let r = self.floats::<4>(node, "rotation").map(|q| DQuat::from_array(q.map(f64::from)));
        let moved = pose.cloned().unwrap_or_default();
        let (t, s) = (moved.translation.unwrap_or(t), moved.scale.unwrap_or(s));
        let r = match moved.rotation.or(r) {
            None => DQuat::IDENTITY,
            Some(q) => {
                if q.length() < 1e-6 {
                    self.warning(node, "a rotation of length 0; taken as none");
                    DQuat::IDENTITY
                } else {
                    q.normalize()
                }
            }
        };
        DMat4::from_scale_rotation_translation(s, r, t)
    }

    /// Loads the mesh of a node and notes where it goes.
    fn place_mesh(
        &mut self,
        i: usize,
        node: &'a Value<'a>,
        transform: &DMat4,
        world: &[Option<DMat4>],
        weights: Option<&[f32]>,
        out: &mut Vec<Placement<'a>>,
    ) {
        let Some((m, mesh)) = self.reference(node, "mesh", "meshes") else { return };
        let mut deform = self.deformation(node, mesh, world);
        let deformed = node.get("skin").is_some() || node.get("weights").is_some() || weights.is_some();
        if let Some(weights) = weights {
            deform.weights = weights.to_vec();
        }
        let transforms = match self.instance_transforms(node) {
            Some(instances) => instances.iter().map(|t| *transform * *t).collect(),
            // A skin's joints place the mesh; its node does not (glTF 2.0, 3.7.3.3).
            None if !deform.joints.is_empty() => vec![DMat4::IDENTITY],
            None => vec![*transform],
        };
        for t in transforms {
            if out.len() >= PLACEMENT_LIMIT {
                self.error(node, "more than 10 million placed meshes");
                return;
            }
            let mirrored = t.determinant() < 0.0;
            // The mirror image is in the mesh, so the rest of the transform mirrors nothing.
            let t = if mirrored { t * DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0)) } else { t };
            let world_from_mesh = t.as_mat4();
            if !world_from_mesh.is_finite() {
                self.error(node, "the node's transform is not finite");
                return;
            }
            if !world_from_mesh.inverse().is_finite() {
                self.warning(node, "the node's transform makes everything flat; left out");
                continue;
            }
            let key = MeshKey { mesh: m, deformed_by: deformed.then_some(i), mirrored };
            self.load_mesh(&key, mesh, &deform);
            out.push(Placement { key, node, world_from_mesh });
        }
    }

    /// The transforms of EXT_mesh_gpu_instancing.
    fn instance_transforms(&mut self, node: &'a Value<'a>) -> Option<Vec<DMat4>> {
        let extension = self.extension(node, "EXT_mesh_gpu_instancing")?;
        let attributes = self.object(extension, "attributes")?;
        let mut read = |key: &str, width, components: &[_]| {
            let at = attributes.get(key)?;
            self.elements::<f32>(at, &[width], components).map(|e| (at, e))
        };
        let t = read("TRANSLATION", 3, &[F32]);
        let r = read("ROTATION", 4, &[F32, I8, I16]);
        let s = read("SCALE", 3, &[F32]);
        let counts: Vec<_> = [&t, &r, &s].into_iter().flatten().map(|(at, e)| (*at, e.len())).collect();
        let count = counts.first()?.1;
        for (at, n) in counts {
            if !self.same_count(at, n, count) {
                return Some(Vec::new());
            }
        }
        let vector = |e: &Option<(_, super::accessor::Elements<f32>)>, i: usize, default: DVec3| {
            e.as_ref().map_or(default, |(_, e)| Vec3::from_slice(&e.data[3 * i..]).as_dvec3())
        };
        let transform = |i| {
            let q = r.as_ref().map_or(DQuat::IDENTITY, |(_, e)| DQuat::from_array(std::array::from_fn(|k| f64::from(e.data[4 * i + k]))));
            let q = if q.length() > 1e-6 { q.normalize() } else { DQuat::IDENTITY };
            DMat4::from_scale_rotation_translation(vector(&s, i, DVec3::ONE), q, vector(&t, i, DVec3::ZERO))
        };
        Some((0..count).map(transform).collect())
    }

    /// Adds the shapes of all placements: groups with instances for large meshes that occur several times, plain shapes for others.
    fn add_shapes(&mut self, placements: &[Placement<'a>]) {
        let mut uses = std::collections::HashMap::<&MeshKey, usize>::new();
        for p in placements {
            *uses.entry(&p.key).or_default() += 1;
        }
        let mut groups = std::collections::HashMap::<&MeshKey, GroupId>::new();
        for p in placements {
            let primitives = self.meshes.get(&p.key).cloned().unwrap_or_default();
            let triangles: usize = primitives.iter().map(|q| q.triangles).sum();
            let count = uses[&p.key];
            let name = self.name(p.node);
            let repeated = triangles > INSTANCE_MIN_TRIANGLES || triangles.saturating_mul(count) > REPEAT_MAX_TRIANGLES;
            if count >= 2 && repeated {
                let group = match groups.get(&p.key) {
                    Some(group) => *group,
                    None => {
                        let shapes = primitives.iter().map(|q| self.shape(q, &name, Mat4::IDENTITY)).collect();
                        let group = self.desc.add(Node::named(name.clone(), self.span(p.node), GroupDesc { shapes }));
                        groups.insert(&p.key, group);
                        group
                    }
                };
                self.desc.add(Node::named(name, self.span(p.node), InstanceDesc { group, world_from_object: p.world_from_mesh }));
                continue;
            }
            for q in &primitives {
                if self.desc.shapes.len() >= PLACEMENT_LIMIT {
                    self.error(p.node, "more than 10 million shapes");
                    return;
                }
                self.shape(q, &name, p.world_from_mesh);
            }
        }
    }

    fn shape(&mut self, primitive: &Primitive, name: &str, world_from_mesh: Mat4) -> crate::desc::ShapeId {
        let Primitive { mesh, material, has_color, has_alpha, .. } = *primitive;
        let material = self.material(MaterialKey { index: material, has_color, has_alpha });
        let geometry = GeometryDesc::Mesh { mesh, face_normals: false, smooth: false };
        let mut shape = ShapeDesc::new(geometry, world_from_mesh);
        shape.bsdf = Some(material.bsdf);
        shape.emission = material.emission;
        shape.interior = material.interior;
        self.desc.add(Node::named(name, primitive.span, shape))
    }
}
