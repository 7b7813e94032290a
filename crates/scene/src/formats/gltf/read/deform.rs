//! Morph targets and skins, in the pose that the nodes give.

use glam::{DMat4, Mat4, Vec3};

use super::Reader;
use super::accessor::Component::{F32, I8, I16, U8, U16};
use crate::desc::MeshData;
use crate::formats::gltf::json::Value;

/// How a node changes its mesh.
#[derive(Clone, Debug, Default)]
pub(super) struct Deform {
    /// Weights of the morph targets.
    pub weights: Vec<f32>,
    /// `world_from_mesh` of each joint; empty without a skin.
    pub joints: Vec<Mat4>,
}

impl<'a> Reader<'a> {
    /// The weights and joints of a node with a mesh, given where all nodes are.
    pub(super) fn deformation(&mut self, node: &'a Value<'a>, mesh: &'a Value<'a>, world: &[Option<DMat4>]) -> Deform {
        let source = if node.get("weights").is_some() { node } else { mesh };
        let mut weights = Vec::new();
        for w in self.array(source, "weights") {
            match w.as_f64().map(|w| w as f32).filter(|w| w.is_finite()) {
                Some(w) => weights.push(w),
                None => self.error(w, "expected a number"),
            }
        }
        let mut joints = Vec::new();
        if let Some((_, skin)) = self.reference(node, "skin", "skins") {
            joints = self.joints(skin, world).unwrap_or_default();
        }
        Deform { weights, joints }
    }

    fn joints(&mut self, skin: &'a Value<'a>, world: &[Option<DMat4>]) -> Option<Vec<Mat4>> {
        let list = self.array(skin, "joints");
        let inverse_bind: Vec<Mat4> = match skin.get("inverseBindMatrices") {
            Some(at) => self.elements::<f32>(at, &[16], &[F32])?.arrays().map(|m: [f32; 16]| Mat4::from_cols_array(&m)).collect(),
            None => vec![Mat4::IDENTITY; list.len()],
        };
        if inverse_bind.len() < list.len() || !inverse_bind.iter().all(Mat4::is_finite) {
            self.error(skin, "there must be a finite inverse bind matrix for each joint");
            return None;
        }
        let mut joints = Vec::with_capacity(list.len());
        for (joint, bind) in list.iter().zip(&inverse_bind) {
            let (i, _) = self.reference_of(joint, "nodes")?;
            // A joint outside the scene stays where it is defined to be: at the origin.
            joints.push(world[i].unwrap_or(DMat4::IDENTITY).as_mat4() * *bind);
        }
        Some(joints)
    }

    /// Applies morph targets, then the skin.
    pub(super) fn deform(
        &mut self,
        primitive: &'a Value<'a>,
        attributes: &'a Value<'a>,
        data: &mut MeshData,
        deform: &Deform,
    ) -> Option<()> {
        let targets = self.array(primitive, "targets");
        for (target, &weight) in targets.iter().zip(&deform.weights).filter(|(_, w)| **w != 0.0) {
            let mut add = |key: &str, values: &mut dyn Iterator<Item = &mut Vec3>, count: usize| {
                let Some(at) = target.get(key).filter(|_| count > 0) else { return Some(()) };
                let deltas = self.elements::<f32>(at, &[3], &[F32, I8, U8, I16, U16])?;
                if !self.same_count(at, deltas.len(), count) || deltas.data.iter().any(|d| !d.is_finite()) {
                    self.error(at, "the morph target does not fit");
                    return None;
                }
                for (v, d) in values.zip(deltas.arrays()) {
                    *v += weight * Vec3::from_array(d);
                }
                Some(())
            };
            let (positions, normals) = (data.positions.len(), data.normals.len());
            add("POSITION", &mut data.positions.iter_mut(), positions)?;
            add("NORMAL", &mut data.normals.iter_mut(), normals)?;
            let mut tangents: Vec<Vec3> = data.tangents.iter().map(|t| t.truncate()).collect();
            add("TANGENT", &mut tangents.iter_mut(), data.tangents.len())?;
            for (t, v) in data.tangents.iter_mut().zip(tangents) {
                *t = v.extend(t.w);
            }
        }
        if !deform.joints.is_empty() {
            self.apply_skin(attributes, data, &deform.joints)?;
        }
        if !deform.joints.is_empty() || deform.weights.iter().any(|&w| w != 0.0) {
            for n in &mut data.normals {
                *n = n.normalize_or_zero();
            }
            for t in &mut data.tangents {
                *t = t.truncate().normalize_or(Vec3::X).extend(t.w);
            }
        }
        Some(())
    }

    fn apply_skin(&mut self, attributes: &'a Value<'a>, data: &mut MeshData, joints: &[Mat4]) -> Option<()> {
        let mut blended = vec![Mat4::ZERO; data.positions.len()];
        let mut sums = vec![0.0f32; data.positions.len()];
        for set in 0..4 {
            let Some(joint_at) = attributes.get(&format!("JOINTS_{set}")) else { break };
            let Some(weight_at) = attributes.get(&format!("WEIGHTS_{set}")) else { break };
            let indices = self.elements::<u32>(joint_at, &[4], &[U8, U16])?;
            let weights = self.elements::<f32>(weight_at, &[4], &[F32, U8, U16])?;
            if !self.same_count(joint_at, indices.len(), blended.len()) || !self.same_count(weight_at, weights.len(), blended.len()) {
                return None;
            }
            for (i, (js, ws)) in indices.arrays::<4>().zip(weights.arrays::<4>()).enumerate() {
                for (j, w) in js.into_iter().zip(ws).filter(|(_, w)| *w != 0.0 && w.is_finite()) {
                    let Some(joint) = joints.get(j as usize) else {
                        self.error(joint_at, format!("joint {j} is out of range: the skin has {}", joints.len()));
                        return None;
                    };
                    blended[i] += *joint * w;
                    sums[i] += w;
                }
            }
        }
        for (i, (m, sum)) in blended.iter().zip(&sums).enumerate() {
            // Weights should sum to 1; vertices without any stay with the first joint.
            let m = if *sum > 0.0 { *m * (1.0 / sum) } else { joints[0] };
            data.positions[i] = m.transform_point3(data.positions[i]);
            if let Some(n) = data.normals.get_mut(i) {
                let normal_matrix = glam::Mat3::from_mat4(m).inverse().transpose();
                *n = if normal_matrix.is_finite() { normal_matrix * *n } else { *n };
            }
            if let Some(t) = data.tangents.get_mut(i) {
                *t = m.transform_vector3(t.truncate()).extend(t.w);
            }
        }
        if data.positions.iter().all(|p| p.is_finite()) {
            return Some(());
        }
        self.error(attributes, "the skin makes positions that are not finite");
        None
    }
}
