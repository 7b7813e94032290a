//! From a material and a surface point to the models that scatter there.

use etendue_scene::desc::{BsdfDesc, BsdfId, Color, Roughness};

use super::scatter::{Part, Scatter};
use super::{Material, distribution, frames};
use crate::bsdf::microfacet::Microfacet;
use crate::bsdf::{
    Bsdf, Coat, Coated, CoatedBase, Conductor, Dielectric, Diffuse, DiffuseTransmission, Null, Plastic, Principled, RoughConductor,
    RoughDielectric, RoughDiffuse, RoughPlastic, ThinDielectric,
};
use crate::math::{Frame, Vec3};
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Deeper nesting than this is cut off; validation refuses it before.
const MAX_NESTING: u32 = 32;

/// Where shading stands while it descends through nested models.
#[derive(Clone, Copy)]
struct Cursor {
    weight: f32,
    frame: Frame,
    base_normal: Option<Vec3>,
    /// The normal as a normal map stores it; that of the frame may be bent for the viewer.
    stored_normal: Option<Vec3>,
    depth: u32,
}

impl Material {
    /// The models at a surface point seen from `wo` (world space).
    pub fn shade(&self, scene: &Scene, s: &Surface, wo: Vec3) -> Scatter {
        let mut scatter = Scatter::default();
        self.shade_into(scene, s, wo, &mut scatter);
        scatter
    }

    /// The same in place of what is in `out`: for loops, where moving the list of models takes as long as making it.
    pub fn shade_into(&self, scene: &Scene, s: &Surface, wo: Vec3, out: &mut Scatter) {
        out.parts.clear();
        if let (Some(point), Some(solids)) = (&s.solid, &scene.solids) {
            *out = solids.shade(point, wo);
            return;
        }
        let mut frame = s.frame;
        if s.ng.dot(wo) * frame.n.dot(wo) <= 0.0 {
            // Interpolated normals turn away from the viewer near silhouettes, where the surface does not.
            frame = Frame::from_normal_tangent(frames::keep_side(frame.n, s.ng, wo), frame.s);
        }
        let cursor = Cursor { weight: 1.0, frame, base_normal: None, stored_normal: None, depth: 0 };
        self.descend(scene, s, wo, cursor, out);
    }

    fn descend(&self, scene: &Scene, s: &Surface, wo: Vec3, at: Cursor, out: &mut Scatter) {
        // `!(…)` also drops weights that are not numbers.
        if !(at.weight > 0.0) || at.depth > MAX_NESTING {
            return;
        }
        let nested = |id: BsdfId| &scene.materials[id.0 as usize];
        let deeper = Cursor { depth: at.depth + 1, ..at };
        match &self.desc {
            BsdfDesc::Blend { first, second, weight } => {
                let w = scene.scalar(weight, s).clamp(0.0, 1.0);
                nested(*first).descend(scene, s, wo, Cursor { weight: at.weight * (1.0 - w), ..deeper }, out);
                nested(*second).descend(scene, s, wo, Cursor { weight: at.weight * w, ..deeper }, out);
            }
            BsdfDesc::Mask { nested: inner, opacity } => {
                let w = scene.scalar(opacity, s).clamp(0.0, 1.0);
                nested(*inner).descend(scene, s, wo, Cursor { weight: at.weight * w, ..deeper }, out);
                push(out, s, Cursor { weight: at.weight * (1.0 - w), ..at }, Bsdf::Null(Null));
            }
            BsdfDesc::TwoSided { front, back } => {
                if at.frame.n.dot(wo) >= 0.0 {
                    nested(*front).descend(scene, s, wo, deeper, out);
                } else {
                    let frame = Frame { n: -at.frame.n, ..at.frame };
                    let (base_normal, stored_normal) = (at.base_normal.map(|n| -n), at.stored_normal.map(|n| -n));
                    nested(*back).descend(scene, s, wo, Cursor { frame, base_normal, stored_normal, ..deeper }, out);
                }
            }
            BsdfDesc::BumpMap { nested: inner, texture, scale } => {
                let frame = frames::bump(scene, s, &at.frame, wo, *texture, *scale);
                let base_normal = at.base_normal.or(Some(at.frame.n));
                nested(*inner).descend(scene, s, wo, Cursor { frame, base_normal, ..deeper }, out);
            }
            BsdfDesc::NormalMap { nested: inner, texture, scale } => {
                let (frame, stored) = frames::normal_map(scene, s, &at.frame, wo, *texture, *scale);
                let base_normal = at.base_normal.or(Some(at.frame.n));
                nested(*inner).descend(scene, s, wo, Cursor { frame, base_normal, stored_normal: Some(stored), ..deeper }, out);
            }
            // The usual model goes straight to its place; others are moved there.
            BsdfDesc::Diffuse { reflectance, alpha: None } => {
                push(out, s, at, Bsdf::Diffuse(Diffuse { reflectance: scene.color(reflectance, s) }));
            }
            _ => {
                if let Some(bsdf) = self.bsdf(scene, s, wo, &at) {
                    push(out, s, at, bsdf);
                }
            }
        }
    }

    /// The model of a material that nests no weighted ones; `None` for those that do, and for Lambert's.
    fn bsdf(&self, scene: &Scene, s: &Surface, wo: Vec3, at: &Cursor) -> Option<Bsdf> {
        let color = |c: &Color| scene.color(c, s);
        Some(match &self.desc {
            BsdfDesc::DiffuseTransmission { reflectance, transmittance } => {
                Bsdf::DiffuseTransmission(DiffuseTransmission { reflectance: color(reflectance), transmittance: color(transmittance) })
            }
            BsdfDesc::Diffuse { reflectance, alpha: Some(alpha) } => {
                Bsdf::RoughDiffuse(RoughDiffuse::from_alpha(color(reflectance), scene.scalar(alpha, s)))
            }
            BsdfDesc::Conductor { eta, k, specular_reflectance, roughness } => {
                let specular_reflectance = color(specular_reflectance);
                match (roughness, eta) {
                    (None, None) => Bsdf::Conductor(Conductor::mirror(specular_reflectance)),
                    (None, Some(eta)) => Bsdf::Conductor(Conductor { eta: color(eta), k: color(k), specular_reflectance }),
                    (Some(r), eta) => {
                        // An index of zero reflects everything at any angle.
                        let (eta, k) = eta.as_ref().map_or((Spectrum::ZERO, Spectrum::ONE), |eta| (color(eta), color(k)));
                        Bsdf::RoughConductor(RoughConductor { microfacet: microfacet(scene, s, r), eta, k, specular_reflectance })
                    }
                }
            }
            BsdfDesc::Dielectric { int_ior, ext_ior, specular_reflectance, specular_transmittance, roughness } => {
                let eta = int_ior / ext_ior;
                let (specular_reflectance, specular_transmittance) = (color(specular_reflectance), color(specular_transmittance));
                match roughness {
                    None => Bsdf::Dielectric(Dielectric { eta, specular_reflectance, specular_transmittance }),
                    Some(r) => Bsdf::RoughDielectric(RoughDielectric {
                        microfacet: microfacet(scene, s, r),
                        eta,
                        specular_reflectance,
                        specular_transmittance,
                    }),
                }
            }
            BsdfDesc::ThinDielectric { int_ior, ext_ior, specular_reflectance, specular_transmittance } => {
                Bsdf::ThinDielectric(ThinDielectric {
                    eta: int_ior / ext_ior,
                    specular_reflectance: color(specular_reflectance),
                    specular_transmittance: color(specular_transmittance),
                })
            }
            BsdfDesc::Plastic { diffuse_reflectance, specular_reflectance, int_ior, ext_ior, nonlinear, roughness } => {
                let (diffuse_reflectance, specular_reflectance) = (color(diffuse_reflectance), color(specular_reflectance));
                let eta = int_ior / ext_ior;
                match (roughness, &self.boundary) {
                    (Some(r), Some(transmittance)) => Bsdf::RoughPlastic(RoughPlastic {
                        microfacet: microfacet(scene, s, r),
                        diffuse_reflectance,
                        specular_reflectance,
                        eta,
                        transmittance: *transmittance,
                        nonlinear: *nonlinear,
                    }),
                    _ => Bsdf::Plastic(Plastic::new(diffuse_reflectance, specular_reflectance, eta, *nonlinear)),
                }
            }
            BsdfDesc::Coated { base, int_ior, ext_ior, thickness, sigma_a, specular_reflectance, roughness } => {
                let coat = match (roughness, &self.boundary) {
                    (Some(r), Some(t)) => Coat::Rough { microfacet: microfacet(scene, s, r), transmittance: *t },
                    _ => Coat::Smooth,
                };
                Bsdf::Coated(Coated {
                    base: coated_base(scene, s, wo, *base)?,
                    coat,
                    eta: int_ior / ext_ior,
                    absorption: color(sigma_a) * *thickness,
                    specular_reflectance: color(specular_reflectance),
                })
            }
            BsdfDesc::Principled(p) => {
                let number = |v| scene.scalar(v, s);
                Bsdf::Principled(Principled {
                    base_color: color(&p.base_color),
                    roughness: number(&p.roughness),
                    anisotropic: number(&p.anisotropic),
                    metallic: number(&p.metallic),
                    spec_trans: number(&p.spec_trans),
                    eta: number(&p.eta),
                    spec_tint: number(&p.spec_tint),
                    sheen: number(&p.sheen),
                    sheen_tint: number(&p.sheen_tint),
                    flatness: number(&p.flatness),
                    clearcoat: number(&p.clearcoat),
                    clearcoat_gloss: number(&p.clearcoat_gloss),
                    diff_trans: number(&p.diff_trans),
                    thin: p.thin,
                })
            }
            BsdfDesc::Pbr(p) => super::pbr::shade(scene, s, wo, p, &at.frame, at.base_normal.zip(at.stored_normal)),
            BsdfDesc::Null => Bsdf::Null(Null),
            BsdfDesc::Diffuse { alpha: None, .. }
            | BsdfDesc::Blend { .. }
            | BsdfDesc::Mask { .. }
            | BsdfDesc::TwoSided { .. }
            | BsdfDesc::BumpMap { .. }
            | BsdfDesc::NormalMap { .. } => return None,
        })
    }
}

/// What lies under a coat: sides and tilts of the nested model are the coat's, its blends are cut to their first part.
fn coated_base(scene: &Scene, s: &Surface, wo: Vec3, base: BsdfId) -> Option<CoatedBase> {
    let mut inner = Scatter::default();
    let at = Cursor { weight: 1.0, frame: s.frame, base_normal: None, stored_normal: None, depth: 0 };
    scene.materials[base.0 as usize].descend(scene, s, wo, at, &mut inner);
    Some(match inner.parts.into_iter().next()?.bsdf {
        Bsdf::Diffuse(b) => CoatedBase::Diffuse(b),
        Bsdf::RoughDiffuse(b) => CoatedBase::RoughDiffuse(b),
        Bsdf::Conductor(b) => CoatedBase::Conductor(b),
        Bsdf::RoughConductor(b) => CoatedBase::RoughConductor(b),
        Bsdf::Plastic(b) => CoatedBase::Plastic(b),
        Bsdf::RoughPlastic(b) => CoatedBase::RoughPlastic(b),
        _ => return None,
    })
}

fn microfacet(scene: &Scene, s: &Surface, r: &Roughness) -> Microfacet {
    Microfacet::new(distribution(r.distribution), scene.scalar(&r.alpha_u, s), scene.scalar(&r.alpha_v, s))
}

#[inline(always)]
fn push(out: &mut Scatter, s: &Surface, at: Cursor, bsdf: Bsdf) {
    if at.weight > 0.0 {
        // A full list drops the rest: `max_parts` of the compiler has said so.
        let face_normal = at.base_normal.map(|n| if n.dot(s.ng) < 0.0 { -s.ng } else { s.ng });
        let _ = out.parts.try_push(Part { weight: at.weight, frame: at.frame, face_normal, bsdf });
    }
}
