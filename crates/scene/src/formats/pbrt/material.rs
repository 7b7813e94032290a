//! Materials.

use super::Reader;
use super::params::Params;
use super::spectrum::SpectrumKind;
use crate::desc::{AddNode, BsdfDesc, BsdfId, Color, MicrofacetKind, Node, Param, Roughness, Scalar, TextureDesc};
use crate::ior;

/// Below this α a surface is smooth (pbrt-v4's "effectively smooth").
const SMOOTH_ALPHA: f32 = 1e-3;

impl Reader {
    /// `MakeNamedMaterial "name" "string type" …`
    pub(super) fn named_material(&mut self, name: &str, p: &Params) {
        let Some(kind) = p.opt_text("type", &mut self.desc.report).map(str::to_owned) else {
            self.error(p.span, "a named material needs a `type`");
            return;
        };
        if let Some(id) = self.material_named(&kind, name, p)
            && self.materials.insert(name.to_owned(), id).is_some()
        {
            self.error(p.span, format!("the material `{name}` is made twice"));
        }
    }

    /// The material of shapes before any is named: gray and diffuse.
    pub(super) fn default_material(&mut self, span: crate::span::Span) -> BsdfId {
        if let Some(id) = self.default_material {
            return id;
        }
        let front = self.desc.add(Node::new(span, BsdfDesc::Diffuse { reflectance: Color::gray(0.5), alpha: None }));
        let id = self.desc.add(Node::new(span, BsdfDesc::TwoSided { front, back: front }));
        self.default_material = Some(id);
        id
    }

    /// `Material`
    pub(super) fn material(&mut self, kind: &str, p: &Params) -> Option<BsdfId> {
        self.material_named(kind, "", p)
    }

    fn material_named(&mut self, kind: &str, name: &str, p: &Params) -> Option<BsdfId> {
        let desc = self.model(kind, p)?;
        // Whatever lets no light through looks the same from both sides.
        let opaque =
            matches!(desc, BsdfDesc::Diffuse { .. } | BsdfDesc::Plastic { .. } | BsdfDesc::Coated { .. } | BsdfDesc::Conductor { .. });
        let mut id = self.desc.add(Node::named(name, p.span, desc));
        if let Some(file) = p.opt_text("normalmap", &mut self.desc.report).map(str::to_owned)
            && let Some(image) = self.image(&file, p.span)
        {
            let bitmap = crate::desc::BitmapDesc {
                image,
                encoding: crate::desc::Encoding::Linear,
                wrap: [crate::desc::Wrap::Repeat; 2],
                filter: crate::desc::TextureFilter::Bilinear,
                picture_from_uv: glam::Mat3::IDENTITY,
                channel: crate::desc::Channel::Luminance,
                uv_set: 0,
            };
            let texture = self.desc.add(Node::new(p.span, TextureDesc::Bitmap(bitmap)));
            id = self.desc.add(Node::named(name, p.span, BsdfDesc::NormalMap { nested: id, texture, scale: 1.0 }));
        }
        if let Some(height) = self.opt_scalar(p, "displacement")
            && let Scalar::Texture(texture) = height
        {
            id = self.desc.add(Node::named(name, p.span, BsdfDesc::BumpMap { nested: id, texture, scale: 1.0 }));
        }
        if opaque {
            id = self.desc.add(Node::named(name, p.span, BsdfDesc::TwoSided { front: id, back: id }));
        }
        Some(id)
    }

    #[allow(clippy::too_many_lines)] // One arm for each material of the format.
    fn model(&mut self, kind: &str, p: &Params) -> Option<BsdfDesc> {
        let white = Color::gray(1.0);
        let albedo = |r: &mut Self, name: &str, default: f32| r.color_param(p, name, SpectrumKind::Albedo, [default; 3]);
        Some(match kind {
            "diffuse" => BsdfDesc::Diffuse { reflectance: albedo(self, "reflectance", 0.5), alpha: None },
            "diffusetransmission" => {
                let factor = p.float("scale", 1.0, &mut self.desc.report);
                let mut scaled = |name: &str| {
                    let c = albedo(self, name, 0.25);
                    self.scaled(c, factor, p)
                };
                BsdfDesc::DiffuseTransmission { reflectance: scaled("reflectance"), transmittance: scaled("transmittance") }
            }
            "coateddiffuse" => {
                self.coat_losses(p);
                let int_ior = self.eta(p, "eta", 1.5);
                BsdfDesc::Plastic {
                    diffuse_reflectance: albedo(self, "reflectance", 0.5),
                    specular_reflectance: white,
                    int_ior,
                    ext_ior: 1.0,
                    nonlinear: true,
                    roughness: self.roughness(p, "", 0.0),
                }
            }
            "coatedconductor" => {
                self.coat_losses(p);
                let int_ior = self.eta(p, "interface.eta", 1.5);
                let (eta, k) = self.complex(p, "conductor.");
                let over = |c: Color, r: &mut Self| r.scaled(c, 1.0 / int_ior, p);
                let (eta, k) = (over(eta, self), over(k, self));
                let roughness = self.roughness(p, "conductor.", 0.0);
                let base = BsdfDesc::Conductor { eta: Some(eta), k, specular_reflectance: white, roughness };
                let base = self.desc.add(Node::new(p.span, base));
                BsdfDesc::Coated {
                    base,
                    int_ior,
                    ext_ior: 1.0,
                    thickness: 0.0,
                    sigma_a: Color::gray(0.0),
                    specular_reflectance: white,
                    roughness: self.roughness(p, "interface.", 0.0),
                }
            }
            "conductor" => {
                let roughness = self.roughness(p, "", 0.0);
                match p.get("reflectance") {
                    Some(q) if q.kind == "texture" => {
                        // η = 1 and k = 2√r/√(1 − r) give r at normal incidence; without its Fresnel term here.
                        let specular_reflectance = albedo(self, "reflectance", 1.0);
                        BsdfDesc::Conductor { eta: None, k: Color::gray(0.0), specular_reflectance, roughness }
                    }
                    _ => {
                        let (eta, k) = self.complex(p, "");
                        BsdfDesc::Conductor { eta: Some(eta), k, specular_reflectance: white, roughness }
                    }
                }
            }
            "dielectric" => BsdfDesc::Dielectric {
                int_ior: self.eta(p, "eta", 1.5),
                ext_ior: 1.0,
                specular_reflectance: white,
                specular_transmittance: white,
                roughness: self.roughness(p, "", 0.0),
            },
            "thindielectric" => BsdfDesc::ThinDielectric {
                int_ior: self.eta(p, "eta", 1.5),
                ext_ior: 1.0,
                specular_reflectance: white,
                specular_transmittance: white,
            },
            "mix" => {
                let names: Vec<String> = match p.get("materials").map(|q| &q.values) {
                    Some(super::params::Values::Texts(v)) => v.clone(),
                    _ => Vec::new(),
                };
                let weight = self.scalar(p, "amount", 0.5);
                let mut find = |i: usize| {
                    let name = names.get(i)?;
                    let found = self.materials.get(name).copied();
                    if found.is_none() {
                        self.error(p.span, format!("no material `{name}` has been made"));
                    }
                    found
                };
                let (first, second) = (find(0), find(1));
                if names.len() != 2 {
                    self.error(p.span, "a mix needs the names of two `materials`");
                }
                BsdfDesc::Blend { first: first?, second: second?, weight }
            }
            "interface" | "none" | "" => BsdfDesc::Null,
            "subsurface" => {
                p.ignore(&["name", "sigma_a", "sigma_s", "mfp", "reflectance", "g", "scale"]);
                self.loss(p.span, "Material \"subsurface\"", "a diffuse surface under a dielectric boundary");
                BsdfDesc::Plastic {
                    diffuse_reflectance: albedo(self, "reflectance", 0.6),
                    specular_reflectance: white,
                    int_ior: self.eta(p, "eta", 1.33),
                    ext_ior: 1.0,
                    nonlinear: false,
                    roughness: self.roughness(p, "", 0.0),
                }
            }
            "hair" => {
                p.ignore(&["sigma_a", "eumelanin", "pheomelanin", "eta", "beta_m", "beta_n", "alpha"]);
                self.loss(p.span, "Material \"hair\"", "a diffuse surface");
                let reflectance = match p.has("reflectance") {
                    true => albedo(self, "reflectance", 0.3),
                    false => self.color_param(p, "color", SpectrumKind::Albedo, [0.25, 0.16, 0.1]),
                };
                BsdfDesc::Diffuse { reflectance, alpha: None }
            }
            "measured" => {
                p.ignore(&["filename"]);
                self.loss(p.span, "Material \"measured\"", "a gray diffuse surface");
                BsdfDesc::Diffuse { reflectance: Color::gray(0.5), alpha: None }
            }
            _ => {
                self.error(p.span, format!("no material `{kind}`"));
                return None;
            }
        })
    }

    fn coat_losses(&mut self, p: &Params) {
        p.ignore(&["maxdepth", "nsamples", "interface.thickness"]);
        // pbrt's layers are thin: their thickness matters through absorption in between only.
        p.ignore(&["thickness", "g"]);
        if let Some(q) = p.get("albedo")
            && self.color(q, SpectrumKind::Albedo).is_some_and(|c| c != [0.0; 3])
        {
            self.loss(q.span, "scattering medium in a coat (`albedo`)", "a clear coat");
        }
    }

    fn eta(&mut self, p: &Params, name: &str, default: f32) -> f32 {
        let eta = p.get(name).and_then(|q| self.refractive_index(q)).unwrap_or(default);
        if eta > 0.0 {
            eta
        } else {
            self.error(p.span, format!("`{name}` must be positive, not {eta}"));
            default
        }
    }

    /// η and k of a conductor, by spectra or from its reflectance; copper where nothing is said.
    fn complex(&mut self, p: &Params, prefix: &str) -> (Color, Color) {
        if let Some(q) = p.get("reflectance") {
            let r = self.color(q, SpectrumKind::Albedo).unwrap_or([0.9; 3]);
            // pbrt-v4: η = 1 and k so that r is the reflectance at normal incidence.
            let k = r.map(|r| {
                let r = r.clamp(0.0, 0.9999);
                2.0 * (r / (1.0 - r)).sqrt()
            });
            return (Color::gray(1.0), Color::Constant(k));
        }
        let copper = ior::conductor("Cu").unwrap_or(([0.2, 0.92, 1.1], [3.9, 2.45, 2.14]));
        let eta = self.color_param(p, &format!("{prefix}eta"), SpectrumKind::Unbounded, copper.0);
        let k = self.color_param(p, &format!("{prefix}k"), SpectrumKind::Unbounded, copper.1);
        (eta, k)
    }

    /// A color times a number.
    fn scaled(&mut self, c: Color, factor: f32, p: &Params) -> Color {
        match c {
            _ if factor == 1.0 => c,
            Param::Constant(v) => Color::Constant(v.map(|v| v * factor)),
            Param::Texture(texture) => {
                Color::Texture(self.desc.add(Node::new(p.span, TextureDesc::Affine { texture, scale: factor, offset: 0.0, clamp: None })))
            }
        }
    }

    /// Roughness by `roughness`, or `uroughness` and `vroughness`; `None` is smooth.
    fn roughness(&mut self, p: &Params, prefix: &str, default: f32) -> Option<Roughness> {
        let both = self.scalar(p, &format!("{prefix}roughness"), default);
        let u = self.opt_scalar(p, &format!("{prefix}uroughness")).unwrap_or(both);
        let v = self.opt_scalar(p, &format!("{prefix}vroughness")).unwrap_or(both);
        let remap = p.boolean("remaproughness", true, &mut self.desc.report);
        let mut alpha = |s: Scalar| match s {
            Scalar::Constant(v) => Scalar::Constant(if remap { v.max(0.0).sqrt() } else { v }),
            Scalar::Texture(texture) if remap => {
                Scalar::Texture(self.desc.add(Node::new(p.span, TextureDesc::Power { texture, exponent: 0.5 })))
            }
            s => s,
        };
        let (alpha_u, alpha_v) = if u == v {
            let a = alpha(u);
            (a, a)
        } else {
            (alpha(u), alpha(v))
        };
        let smooth = |s: &Scalar| matches!(s, Scalar::Constant(v) if *v < SMOOTH_ALPHA);
        (!(smooth(&alpha_u) && smooth(&alpha_v))).then_some(Roughness { distribution: MicrofacetKind::Ggx, alpha_u, alpha_v })
    }
}
