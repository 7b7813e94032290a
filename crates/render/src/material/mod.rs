//! Materials: from the textures of a description to the [`Bsdf`](crate::bsdf::Bsdf)s at a surface point.
//!
//! [`Material::shade`] evaluates textures once for a hit and fills a [`Scatter`]: a few weighted models, each in
//! its own shading frame. Blends, masks, sides, bump and normal maps are resolved here, so that the models know nothing of them.

mod frames;
mod pbr;
mod scatter;
mod shade;

pub use scatter::{MAX_PARTS, Part, Scatter};

use etendue_scene::desc::{BsdfDesc, MicrofacetKind, Param, Roughness, SceneDesc};

use crate::bsdf::RoughTransmittance;
use crate::bsdf::microfacet::Distribution;

/// A scattering model of the description with what is worth computing once.
#[derive(Clone, Debug)]
pub struct Material {
    /// What the file says; ids in it are indices of materials and textures.
    pub desc: BsdfDesc,
    /// Transmittance of a rough boundary (plastic, coat).
    boundary: Option<RoughTransmittance>,
    /// Light may pass straight through, at least in places.
    pub has_null: bool,
    /// Scattering depends on the surface's tangents.
    pub wants_tangents: bool,
}

fn distribution(kind: MicrofacetKind) -> Distribution {
    match kind {
        MicrofacetKind::Ggx => Distribution::Ggx,
        MicrofacetKind::Beckmann => Distribution::Beckmann,
    }
}

/// The boundary's α where it is the same everywhere; textured boundaries of plastic count as their middle (the reader says so).
fn constant_alpha(r: &Roughness) -> f32 {
    match (r.alpha_u, r.alpha_v) {
        (Param::Constant(u), Param::Constant(v)) => (u * v).max(0.0).sqrt(),
        _ => 0.25,
    }
}

/// Makes the materials of a validated description: one for each of its models and a default, last.
pub fn compile(desc: &SceneDesc) -> Vec<Material> {
    let mut materials: Vec<Material> = desc
        .bsdfs
        .iter()
        .map(|node| &node.value)
        .chain([&BsdfDesc::Diffuse { reflectance: Param::Constant([0.5; 3]), alpha: None }])
        .map(|b| {
            let boundary = match b {
                BsdfDesc::Plastic { roughness: Some(r), int_ior, ext_ior, .. }
                | BsdfDesc::Coated { roughness: Some(r), int_ior, ext_ior, .. } => {
                    Some(RoughTransmittance::new(distribution(r.distribution), constant_alpha(r), int_ior / ext_ior))
                }
                _ => None,
            };
            Material { desc: b.clone(), boundary, has_null: false, wants_tangents: false }
        })
        .collect();
    // A model inherits from what it nests. Validation has excluded cycles, so as many rounds as models suffice; usually one or two.
    loop {
        let flags: Vec<(bool, bool)> = materials.iter().map(|m| m.flags(&materials)).collect();
        let changed = materials.iter().zip(&flags).any(|(m, f)| (m.has_null, m.wants_tangents) != *f);
        for (m, f) in materials.iter_mut().zip(flags) {
            (m.has_null, m.wants_tangents) = f;
        }
        if !changed {
            return materials;
        }
    }
}

impl Material {
    /// (has_null, wants_tangents) given those of the others.
    fn flags(&self, all: &[Self]) -> (bool, bool) {
        let nested = |ids: &[etendue_scene::desc::BsdfId]| {
            ids.iter().map(|i| &all[i.0 as usize]).fold((false, false), |f, m| (f.0 || m.has_null, f.1 || m.wants_tangents))
        };
        let anisotropic = |r: &Option<Roughness>| r.as_ref().is_some_and(|r| r.alpha_u != r.alpha_v);
        let or = |f: (bool, bool), null: bool, tangents: bool| (f.0 || null, f.1 || tangents);
        match &self.desc {
            BsdfDesc::Diffuse { .. } | BsdfDesc::DiffuseTransmission { .. } | BsdfDesc::Plastic { .. } => (false, false),
            BsdfDesc::Conductor { roughness, .. } | BsdfDesc::Dielectric { roughness, .. } => (false, anisotropic(roughness)),
            BsdfDesc::ThinDielectric { .. } | BsdfDesc::Null => (true, false),
            BsdfDesc::Coated { base, roughness, .. } => or(nested(&[*base]), false, anisotropic(roughness)),
            BsdfDesc::Principled(p) => (false, p.anisotropic != Param::Constant(0.0)),
            BsdfDesc::Pbr(p) => (false, p.anisotropy != Param::Constant(0.0) || p.clearcoat_normal.is_some()),
            BsdfDesc::Blend { first, second, .. } => nested(&[*first, *second]),
            BsdfDesc::Mask { nested: n, .. } => or(nested(&[*n]), true, false),
            BsdfDesc::TwoSided { front, back } => nested(&[*front, *back]),
            BsdfDesc::BumpMap { nested: n, .. } | BsdfDesc::NormalMap { nested: n, .. } => or(nested(&[*n]), false, true),
        }
    }
}
