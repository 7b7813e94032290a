//! What a description says and this renderer does not do.

use etendue_scene::desc::{BsdfDesc, BsdfId, LightDesc, Param, SceneDesc};
use etendue_scene::{Loss, Span};

/// Everything in a description that [`super::compile`] does not honor, in words for the loss report.
pub fn losses(desc: &SceneDesc) -> Vec<Loss> {
    let mut losses = Vec::new();
    let mut add = |span: Span, feature: &str, effect: &str| {
        if losses.len() < etendue_scene::report::REPORT_LIMIT {
            losses.push(Loss { span, feature: feature.to_owned(), effect: effect.to_owned() });
        }
    };
    for node in &desc.lights {
        if let LightDesc::Spot { texture: Some(_), .. } = &node.value {
            add(node.span, "picture projected by a spot light", "the light is rendered without it");
        }
    }
    for node in &desc.bsdfs {
        match &node.value {
            BsdfDesc::Plastic { roughness: Some(r), .. } | BsdfDesc::Coated { roughness: Some(r), .. }
                if matches!(r.alpha_u, Param::Texture(_)) || matches!(r.alpha_v, Param::Texture(_)) =>
            {
                add(node.span, "textured roughness of a coat", "the energy that the coat lets through is that of α = 0.25");
            }
            BsdfDesc::Coated { base, .. } if !can_be_coated(desc, *base, 0) => {
                add(node.span, "coat over this model", "rendered black: coats go over diffuse, conductor and plastic models");
            }
            _ => {}
        }
        if parts(desc, &node.value, 0) > crate::material::MAX_PARTS {
            add(node.span, "blend of more than eight models", "the models beyond the eighth are left out");
        }
    }
    if let Some(classic) = &desc.classic {
        losses.extend(crate::classic::losses(classic));
    }
    losses
}

/// How many models may scatter at one point. Descriptions are validated: no cycles, limited depth.
fn parts(desc: &SceneDesc, bsdf: &BsdfDesc, depth: u32) -> usize {
    let nested = |id: &BsdfId| parts(desc, &desc[*id].value, depth + 1);
    match bsdf {
        _ if depth > 32 => 0,
        BsdfDesc::Blend { first, second, .. } => nested(first).saturating_add(nested(second)),
        BsdfDesc::Mask { nested: n, .. } => nested(n).saturating_add(1),
        BsdfDesc::TwoSided { front, back } => nested(front).max(nested(back)),
        BsdfDesc::BumpMap { nested: n, .. } | BsdfDesc::NormalMap { nested: n, .. } => nested(n),
        _ => 1,
    }
}

fn can_be_coated(desc: &SceneDesc, id: BsdfId, depth: u32) -> bool {
    match &desc[id].value {
        _ if depth > 32 => false,
        BsdfDesc::Diffuse { .. } | BsdfDesc::Conductor { .. } | BsdfDesc::Plastic { .. } => true,
        BsdfDesc::TwoSided { front, back } => can_be_coated(desc, *front, depth + 1) && can_be_coated(desc, *back, depth + 1),
        BsdfDesc::BumpMap { nested, .. } | BsdfDesc::NormalMap { nested, .. } => can_be_coated(desc, *nested, depth + 1),
        _ => false,
    }
}
