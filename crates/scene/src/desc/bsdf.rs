//! Scattering models as files describe them.

use serde::{Deserialize, Serialize};

use super::{BsdfId, Color, Scalar, TextureId};

/// Distribution of microfacet normals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum MicrofacetKind {
    /// Trowbridge–Reitz.
    #[default]
    Ggx,
    /// Beckmann–Spizzichino.
    Beckmann,
}

/// How rough a surface of microfacets is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Roughness {
    /// Distribution of normals.
    pub distribution: MicrofacetKind,
    /// Root mean square slope (α) along the tangent.
    pub alpha_u: Scalar,
    /// α along the bitangent.
    pub alpha_v: Scalar,
}

/// A scattering model. Refractive indices: `int_ior` on the side that the normal points away from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum BsdfDesc {
    /// Lambert, or Oren–Nayar where `alpha` is given.
    Diffuse {
        /// Share of reflected light, [0, 1].
        reflectance: Color,
        /// Oren–Nayar roughness α; `None` is Lambert.
        alpha: Option<Scalar>,
    },
    /// Lambert on both sides: reflected on the side of the light, transmitted to the other. Their sum is at most 1.
    DiffuseTransmission {
        /// Share of reflected light.
        reflectance: Color,
        /// Share of transmitted light.
        transmittance: Color,
    },
    /// Metal: smooth, or rough where `roughness` is given.
    Conductor {
        /// Real part of the refractive index relative to the outside. `None`: an ideal mirror (Fresnel factor 1).
        eta: Option<Color>,
        /// Imaginary part of the refractive index (absorption).
        k: Color,
        /// Factor on the reflection.
        specular_reflectance: Color,
        /// Microfacets; `None` is smooth.
        roughness: Option<Roughness>,
    },
    /// Glass, water: smooth, or rough where `roughness` is given.
    Dielectric {
        /// Refractive index of the inside.
        int_ior: f32,
        /// Refractive index of the outside.
        ext_ior: f32,
        /// Factor on the reflection.
        specular_reflectance: Color,
        /// Factor on the transmission.
        specular_transmittance: Color,
        /// Microfacets; `None` is smooth.
        roughness: Option<Roughness>,
    },
    /// A thin pane with two interfaces: light goes straight on.
    ThinDielectric {
        /// Refractive index of the pane.
        int_ior: f32,
        /// Refractive index of the surroundings.
        ext_ior: f32,
        /// Factor on the reflection.
        specular_reflectance: Color,
        /// Factor on the transmission.
        specular_transmittance: Color,
    },
    /// A diffuse base under a clear dielectric boundary: smooth, or rough where `roughness` is given.
    Plastic {
        /// Color of the base.
        diffuse_reflectance: Color,
        /// Factor on the boundary's reflection.
        specular_reflectance: Color,
        /// Refractive index of the coat.
        int_ior: f32,
        /// Refractive index of the outside.
        ext_ior: f32,
        /// Whether the base's color shifts with interreflection inside the coat.
        nonlinear: bool,
        /// Microfacets of the boundary; `None` is smooth.
        roughness: Option<Roughness>,
    },
    /// A clear or tinted dielectric layer over another model.
    Coated {
        /// What is under the layer.
        base: BsdfId,
        /// Refractive index of the layer.
        int_ior: f32,
        /// Refractive index of the outside.
        ext_ior: f32,
        /// Thickness of the layer, in the unit of `1 / sigma_a`.
        thickness: f32,
        /// Absorption in the layer per unit of length.
        sigma_a: Color,
        /// Factor on the layer's reflection.
        specular_reflectance: Color,
        /// Microfacets of the layer; `None` is smooth.
        roughness: Option<Roughness>,
    },
    /// Disney's model with the parameters of Mitsuba 3's `principled` and `principledthin`.
    Principled(Box<PrincipledDesc>),
    /// The material of glTF 2.0 with its extensions.
    Pbr(Box<PbrDesc>),
    /// A linear blend: `first` at weight 0, `second` at weight 1.
    Blend {
        /// At weight 0.
        first: BsdfId,
        /// At weight 1.
        second: BsdfId,
        /// In [0, 1].
        weight: Scalar,
    },
    /// A model with holes.
    Mask {
        /// What is where the opacity is 1.
        nested: BsdfId,
        /// 0 lets light straight through.
        opacity: Scalar,
    },
    /// A model for each side.
    TwoSided {
        /// Where the normal points.
        front: BsdfId,
        /// The other side.
        back: BsdfId,
    },
    /// Normals tilted by a height field: height in scene units.
    BumpMap {
        /// What scatters.
        nested: BsdfId,
        /// The height.
        texture: TextureId,
        /// Factor on the height.
        scale: f32,
    },
    /// Normals from a picture of tangent-space normals.
    NormalMap {
        /// What scatters.
        nested: BsdfId,
        /// The normals, encoded as 0.5 · n + 0.5; read as linear values.
        texture: TextureId,
        /// Factor on the tangential part.
        scale: f32,
    },
    /// Nothing: light goes straight on, as at the boundary of a medium.
    Null,
}

/// Parameters of Disney's model (Burley 2012, 2015), named as Mitsuba 3 names them; all in [0, 1] but `eta`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PrincipledDesc {
    /// Thin surface with `diff_trans` in place of a solid.
    pub thin: bool,
    /// Color.
    pub base_color: Color,
    /// Roughness; α is its square.
    pub roughness: Scalar,
    /// Anisotropy.
    pub anisotropic: Scalar,
    /// Metalness.
    pub metallic: Scalar,
    /// Share of specular transmission.
    pub spec_trans: Scalar,
    /// Refractive index of the inside over that of the outside.
    pub eta: Scalar,
    /// Tint of the specular reflection towards the base color.
    pub spec_tint: Scalar,
    /// Sheen.
    pub sheen: Scalar,
    /// Tint of the sheen towards the base color.
    pub sheen_tint: Scalar,
    /// Blend of diffuse towards a subsurface look.
    pub flatness: Scalar,
    /// Clear coat.
    pub clearcoat: Scalar,
    /// Gloss of the clear coat.
    pub clearcoat_gloss: Scalar,
    /// Diffuse transmission of thin surfaces, [0, 2].
    pub diff_trans: Scalar,
}

/// The glTF 2.0 metallic-roughness material and the ratified KHR_materials extensions; names as there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PbrDesc {
    /// Color: reflectance of dielectrics, specular color of metals.
    pub base_color: Color,
    /// Metalness, [0, 1].
    pub metallic: Scalar,
    /// Roughness, [0, 1]; α is its square.
    pub roughness: Scalar,
    /// Refractive index (KHR_materials_ior).
    pub ior: f32,
    /// Strength of the dielectric reflection (KHR_materials_specular).
    pub specular: Scalar,
    /// Tint of the dielectric reflection at normal incidence.
    pub specular_color: Color,
    /// Share of light that is transmitted instead of diffused (KHR_materials_transmission).
    pub transmission: Scalar,
    /// A closed volume refracts; otherwise the surface is thin-walled (KHR_materials_volume, thickness > 0).
    pub volume: bool,
    /// Abbe-number term 20 / V_d (KHR_materials_dispersion); 0 for none.
    pub dispersion: f32,
    /// Clear coat strength (KHR_materials_clearcoat).
    pub clearcoat: Scalar,
    /// Clear coat roughness.
    pub clearcoat_roughness: Scalar,
    /// The coat's own normal map and its scale.
    pub clearcoat_normal: Option<(TextureId, f32)>,
    /// Sheen color (KHR_materials_sheen).
    pub sheen_color: Color,
    /// Sheen roughness.
    pub sheen_roughness: Scalar,
    /// Anisotropy strength (KHR_materials_anisotropy).
    pub anisotropy: Scalar,
    /// Direction of the anisotropy: rotation of the tangent in radians.
    pub anisotropy_rotation: f32,
    /// Texture whose red and green give a direction and whose blue gives a factor on the strength.
    pub anisotropy_direction: Option<TextureId>,
    /// Iridescence strength (KHR_materials_iridescence).
    pub iridescence: Scalar,
    /// Refractive index of the film.
    pub iridescence_ior: f32,
    /// Thickness of the film in nanometres.
    pub iridescence_thickness_nm: Scalar,
}

impl Default for PbrDesc {
    fn default() -> Self {
        Self {
            base_color: Color::gray(1.0),
            metallic: Scalar::Constant(1.0),
            roughness: Scalar::Constant(1.0),
            ior: 1.5,
            specular: Scalar::Constant(1.0),
            specular_color: Color::gray(1.0),
            transmission: Scalar::Constant(0.0),
            volume: false,
            dispersion: 0.0,
            clearcoat: Scalar::Constant(0.0),
            clearcoat_roughness: Scalar::Constant(0.0),
            clearcoat_normal: None,
            sheen_color: Color::gray(0.0),
            sheen_roughness: Scalar::Constant(0.0),
            anisotropy: Scalar::Constant(0.0),
            anisotropy_rotation: 0.0,
            anisotropy_direction: None,
            iridescence: Scalar::Constant(0.0),
            iridescence_ior: 1.3,
            iridescence_thickness_nm: Scalar::Constant(400.0),
        }
    }
}

/// What a scattering model refers to; see [`BsdfDesc::parts`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BsdfParts {
    /// Its colors.
    pub colors: Vec<Color>,
    /// Its numbers that may vary.
    pub scalars: Vec<Scalar>,
    /// Textures that are no colors or numbers: heights and normals.
    pub textures: Vec<TextureId>,
    /// Models within it.
    pub bsdfs: Vec<BsdfId>,
}

impl BsdfDesc {
    /// The model's name as users write it.
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::Diffuse { alpha: None, .. } => "diffuse",
            Self::Diffuse { .. } => "roughdiffuse",
            Self::DiffuseTransmission { .. } => "diffusetransmission",
            Self::Conductor { roughness: None, .. } => "conductor",
            Self::Conductor { .. } => "roughconductor",
            Self::Dielectric { roughness: None, .. } => "dielectric",
            Self::Dielectric { .. } => "roughdielectric",
            Self::ThinDielectric { .. } => "thindielectric",
            Self::Plastic { roughness: None, .. } => "plastic",
            Self::Plastic { .. } => "roughplastic",
            Self::Coated { .. } => "coated",
            Self::Principled(p) if p.thin => "principledthin",
            Self::Principled(_) => "principled",
            Self::Pbr(_) => "pbr",
            Self::Blend { .. } => "blendbsdf",
            Self::Mask { .. } => "mask",
            Self::TwoSided { .. } => "twosided",
            Self::BumpMap { .. } => "bumpmap",
            Self::NormalMap { .. } => "normalmap",
            Self::Null => "null",
        }
    }

    /// Everything that it refers to, for passes over the graph.
    pub fn parts(&self) -> BsdfParts {
        let mut parts = BsdfParts::default();
        let mut roughness = |r: &Option<Roughness>| r.iter().flat_map(|r| [r.alpha_u, r.alpha_v]).for_each(|s| parts.scalars.push(s));
        match self {
            Self::Diffuse { reflectance, alpha } => {
                parts.colors.push(*reflectance);
                parts.scalars.extend(*alpha);
            }
            Self::DiffuseTransmission { reflectance, transmittance } => parts.colors.extend([*reflectance, *transmittance]),
            Self::Conductor { eta, k, specular_reflectance, roughness: r } => {
                roughness(r);
                parts.colors.extend(eta.iter().copied().chain([*k, *specular_reflectance]));
            }
            Self::Dielectric { specular_reflectance, specular_transmittance, roughness: r, .. } => {
                roughness(r);
                parts.colors.extend([*specular_reflectance, *specular_transmittance]);
            }
            Self::ThinDielectric { specular_reflectance, specular_transmittance, .. } => {
                parts.colors.extend([*specular_reflectance, *specular_transmittance]);
            }
            Self::Plastic { diffuse_reflectance, specular_reflectance, roughness: r, .. } => {
                roughness(r);
                parts.colors.extend([*diffuse_reflectance, *specular_reflectance]);
            }
            Self::Coated { base, sigma_a, specular_reflectance, roughness: r, .. } => {
                roughness(r);
                parts.colors.extend([*sigma_a, *specular_reflectance]);
                parts.bsdfs.push(*base);
            }
            Self::Principled(p) => {
                parts.colors.push(p.base_color);
                parts.scalars.extend([
                    p.roughness,
                    p.anisotropic,
                    p.metallic,
                    p.spec_trans,
                    p.eta,
                    p.spec_tint,
                    p.sheen,
                    p.sheen_tint,
                    p.flatness,
                    p.clearcoat,
                    p.clearcoat_gloss,
                    p.diff_trans,
                ]);
            }
            Self::Pbr(p) => {
                parts.colors.extend([p.base_color, p.specular_color, p.sheen_color]);
                parts.scalars.extend([
                    p.metallic,
                    p.roughness,
                    p.specular,
                    p.transmission,
                    p.clearcoat,
                    p.clearcoat_roughness,
                    p.sheen_roughness,
                    p.anisotropy,
                    p.iridescence,
                    p.iridescence_thickness_nm,
                ]);
                parts.textures.extend(p.clearcoat_normal.iter().map(|(t, _)| *t).chain(p.anisotropy_direction));
            }
            Self::Blend { first, second, weight } => {
                parts.scalars.push(*weight);
                parts.bsdfs.extend([*first, *second]);
            }
            Self::Mask { nested, opacity } => {
                parts.scalars.push(*opacity);
                parts.bsdfs.push(*nested);
            }
            Self::TwoSided { front, back } => parts.bsdfs.extend([*front, *back]),
            Self::BumpMap { nested, texture, .. } | Self::NormalMap { nested, texture, .. } => {
                parts.textures.push(*texture);
                parts.bsdfs.push(*nested);
            }
            Self::Null => {}
        }
        parts
    }
}
