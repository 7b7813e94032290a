//! Scattering models.

use super::Builder;
use super::props::Props;
use crate::desc::{AddNode, BsdfDesc, BsdfId, Color, MicrofacetKind, Node, Param, PrincipledDesc, Roughness, Scalar};
use crate::formats::mitsuba::tree::{Kind, Plugin, Value, suggestion};
use crate::formats::spectrum::Quantity;
use crate::ior;

impl<'t> Builder<'t> {
    /// A scattering model; a fault and `None` where it cannot be built.
    pub(super) fn bsdf(&mut self, plugin: &'t Plugin) -> Option<BsdfId> {
        let key: *const Plugin = plugin;
        if let Some(built) = self.bsdfs.get(&key) {
            return *built;
        }
        let built = self.guarded(plugin, |b| b.build_bsdf(plugin));
        self.bsdfs.insert(key, built);
        built
    }

    fn add_bsdf(&mut self, plugin: &Plugin, value: BsdfDesc) -> BsdfId {
        self.desc.add(Node::named(&plugin.id, plugin.span, value))
    }

    fn build_bsdf(&mut self, plugin: &'t Plugin) -> Option<BsdfId> {
        if !self.is_known(plugin) {
            return None;
        }
        let mut p = Props::new(plugin);
        let value = self.model(&mut p);
        self.finish(p);
        Some(self.add_bsdf(plugin, value?))
    }

    fn model(&mut self, p: &mut Props<'t>) -> Option<BsdfDesc> {
        let kind = p.plugin.type_name.as_str();
        Some(match kind {
            "diffuse" => BsdfDesc::Diffuse { reflectance: self.color(p, "reflectance", 0.5), alpha: None },
            "roughdiffuse" => {
                p.ignore(&["use_fast_approx"]);
                BsdfDesc::Diffuse { reflectance: self.color(p, "reflectance", 0.5), alpha: Some(self.scalar(p, "alpha", 0.2)) }
            }
            "conductor" | "roughconductor" => self.conductor(p, kind == "roughconductor"),
            "dielectric" | "roughdielectric" => {
                let (int_ior, ext_ior) = (self.ior(p, "int_ior", "bk7"), self.ior(p, "ext_ior", "air"));
                let specular_reflectance = self.color(p, "specular_reflectance", 1.0);
                let specular_transmittance = self.color(p, "specular_transmittance", 1.0);
                let roughness = (kind == "roughdielectric").then(|| self.roughness(p, 0.1));
                BsdfDesc::Dielectric { int_ior, ext_ior, specular_reflectance, specular_transmittance, roughness }
            }
            "thindielectric" => BsdfDesc::ThinDielectric {
                int_ior: self.ior(p, "int_ior", "bk7"),
                ext_ior: self.ior(p, "ext_ior", "air"),
                specular_reflectance: self.color(p, "specular_reflectance", 1.0),
                specular_transmittance: self.color(p, "specular_transmittance", 1.0),
            },
            "plastic" | "roughplastic" | "pplastic" => self.plastic(p, kind),
            "principled" | "principledthin" => self.principled(p, kind == "principledthin"),
            "twosided" => {
                let front = self.nested(p)?;
                let back = self.next_of(p, Kind::Bsdf).and_then(|n| self.bsdf(n)).unwrap_or(front);
                BsdfDesc::TwoSided { front, back }
            }
            "mask" => BsdfDesc::Mask { opacity: self.scalar(p, "opacity", 0.5), nested: self.nested(p)? },
            "blendbsdf" => {
                let weight = self.opt_scalar(p, "weight");
                if weight.is_none() && !p.has("weight") {
                    p.fault(p.plugin.span, "`weight` is missing");
                }
                let weight = weight.unwrap_or(Param::Constant(0.5));
                BsdfDesc::Blend { weight, first: self.nested(p)?, second: self.nested(p)? }
            }
            "mixturebsdf" => self.mixture(p)?,
            "bumpmap" | "normalmap" => {
                // The texture may have any name.
                let texture = self.next_of(p, Kind::Texture).and_then(|t| self.texture_id(t));
                let scale = p.float("scale", 1.0);
                p.ignore(&["flip_invalid_normals", "use_shadowing_function"]);
                let nested = self.nested(p)?;
                let Some(texture) = texture else {
                    p.fault(p.plugin.span, "a nested texture is missing");
                    return None;
                };
                if kind == "bumpmap" {
                    BsdfDesc::BumpMap { nested, texture, scale }
                } else {
                    BsdfDesc::NormalMap { nested, texture, scale }
                }
            }
            "null" => BsdfDesc::Null,
            "coating" | "roughcoating" => {
                let (int_ior, ext_ior) = (self.ior(p, "int_ior", "bk7"), self.ior(p, "ext_ior", "air"));
                let thickness = p.float("thickness", 1.0);
                let sigma_a = self.color(p, "sigma_a", 0.0);
                let specular_reflectance = self.color(p, "specular_reflectance", 1.0);
                let roughness = (kind == "roughcoating").then(|| self.roughness(p, 0.1));
                BsdfDesc::Coated { base: self.nested(p)?, int_ior, ext_ior, thickness, sigma_a, specular_reflectance, roughness }
            }
            "phong" | "ward" => {
                self.lose(p.plugin, "rendered as rough plastic");
                let roughness = if kind == "phong" {
                    // Walter et al. 2007, section 5.2: the Phong exponent that looks alike.
                    let alpha = (2.0 / (p.float("exponent", 30.0) + 2.0)).max(0.0).sqrt();
                    isotropic(MicrofacetKind::Beckmann, alpha)
                } else {
                    p.ignore(&["variant"]);
                    self.roughness(p, 0.1)
                };
                BsdfDesc::Plastic {
                    diffuse_reflectance: self.color(p, "diffuse_reflectance", 0.5),
                    specular_reflectance: self.color(p, "specular_reflectance", 0.2),
                    int_ior: 1.49,
                    ext_ior: 1.0,
                    nonlinear: false,
                    roughness: Some(roughness),
                }
            }
            "polarizer" | "retarder" | "circular" => {
                self.lose(p.plugin, "lets light through unchanged");
                p.ignore_all();
                BsdfDesc::Null
            }
            _ => {
                self.lose(p.plugin, "rendered as diffuse gray");
                p.ignore_all();
                BsdfDesc::Diffuse { reflectance: Color::gray(0.5), alpha: None }
            }
        })
    }

    /// The next nested model; a fault where there is none.
    fn nested(&mut self, p: &mut Props<'t>) -> Option<BsdfId> {
        match self.next_of(p, Kind::Bsdf) {
            Some(plugin) => self.bsdf(plugin),
            None => {
                let has_undefined = p.plugin.params.iter().any(|q| matches!(q.value, Value::Reference(_)));
                if !has_undefined {
                    p.fault(p.plugin.span, "a nested bsdf is missing");
                }
                None
            }
        }
    }

    fn mixture(&mut self, p: &mut Props<'t>) -> Option<BsdfDesc> {
        let weights: Option<Vec<f32>> = p.opt_text("weights").map(|text| {
            text.split(|c: char| c == ',' || c.is_whitespace()).filter(|t| !t.is_empty()).map(|t| t.parse().unwrap_or(f32::NAN)).collect()
        });
        let mut models = Vec::new();
        while let Some(plugin) = self.next_of(p, Kind::Bsdf) {
            models.push(self.bsdf(plugin)?);
        }
        let weights = weights.unwrap_or_default();
        if models.is_empty() || weights.len() != models.len() || weights.iter().any(|w| !(*w >= 0.0 && w.is_finite())) {
            p.fault(p.plugin.span, "`weights` must be a list of numbers, one to each nested bsdf");
            return None;
        }
        let total: f32 = weights.iter().sum();
        if (total - 1.0).abs() > 1e-3 {
            self.lose(p.plugin, "weights are scaled to a sum of 1");
        }
        // Blend the models one after the other: each weight is relative to the sum so far.
        let mut sum = weights[0];
        let mut blended = models[0];
        let mut last = BsdfDesc::Blend { first: blended, second: blended, weight: Param::Constant(0.0) };
        for i in 1..models.len() {
            sum += weights[i];
            let weight = if sum > 0.0 { weights[i] / sum } else { 0.0 };
            last = BsdfDesc::Blend { first: blended, second: models[i], weight: Param::Constant(weight) };
            if i + 1 < models.len() {
                blended = self.add_bsdf(p.plugin, last.clone());
            }
        }
        Some(last)
    }

    /// A refractive index, given as a number or by name.
    fn ior(&mut self, p: &mut Props<'t>, name: &'static str, default: &str) -> f32 {
        let fallback = ior::dielectric(default).unwrap_or(1.5);
        match p.get(name).map(|q| &q.value) {
            None => fallback,
            Some(Value::Text(text)) => match ior::dielectric(text) {
                Some(v) => v,
                None => {
                    let hint = suggestion(text, ior::DIELECTRICS.iter().map(|(n, _)| *n));
                    p.fault_at(name, format!("no dielectric is called `{text}`{hint}"));
                    fallback
                }
            },
            Some(_) => p.positive(name, fallback),
        }
    }

    fn roughness(&mut self, p: &mut Props<'t>, default: f32) -> Roughness {
        let distribution = p.choice(
            "distribution",
            &[
                ("beckmann", MicrofacetKind::Beckmann),
                ("ggx", MicrofacetKind::Ggx),
                ("phong", MicrofacetKind::Beckmann),
                ("as", MicrofacetKind::Beckmann),
            ],
            MicrofacetKind::Beckmann,
        );
        p.ignore(&["sample_visible"]);
        if p.has("alpha_u") || p.has("alpha_v") {
            if p.has("alpha") {
                p.fault_at("alpha", "`alpha` cannot stand beside `alpha_u` and `alpha_v`");
            }
            p.ignore(&["alpha"]);
            return Roughness { distribution, alpha_u: self.scalar(p, "alpha_u", default), alpha_v: self.scalar(p, "alpha_v", default) };
        }
        let alpha = self.scalar(p, "alpha", default);
        p.ignore(&["alpha_u", "alpha_v"]);
        Roughness { distribution, alpha_u: alpha, alpha_v: alpha }
    }

    fn conductor(&mut self, p: &mut Props<'t>, rough: bool) -> BsdfDesc {
        let roughness = rough.then(|| self.roughness(p, 0.1));
        let specular_reflectance = self.color(p, "specular_reflectance", 1.0);
        let material = p.opt_text("material");
        let outside = p.get("ext_eta").is_some().then(|| self.ior(p, "ext_eta", "air"));
        let eta = self.opt_color(p, "eta", Quantity::Reflectance);
        let k = self.opt_color(p, "k", Quantity::Reflectance);
        let (mut eta, mut k) = match material {
            _ if eta.is_some() || k.is_some() => {
                if material.is_some() {
                    p.fault_at("material", "`material` cannot stand beside `eta` and `k`");
                }
                (Some(eta.unwrap_or(Color::gray(0.0))), k.unwrap_or(Color::gray(1.0)))
            }
            None | Some("none") => (None, Color::gray(0.0)),
            Some(name) => match ior::conductor(name) {
                Some((eta, k)) => (Some(Param::Constant(eta)), Param::Constant(k)),
                None => {
                    let hint = suggestion(name, ior::CONDUCTORS.iter().map(|(n, _, _)| *n));
                    p.fault_at("material", format!("no conductor is called `{name}`{hint}"));
                    (None, Color::gray(0.0))
                }
            },
        };
        if let (Some(outside), Some(Param::Constant(eta)), Param::Constant(k)) = (outside, &mut eta, &mut k) {
            for v in eta.iter_mut().chain(k) {
                *v /= outside;
            }
        }
        BsdfDesc::Conductor { eta, k, specular_reflectance, roughness }
    }

    fn plastic(&mut self, p: &mut Props<'t>, kind: &str) -> BsdfDesc {
        let rough = kind == "roughplastic" || (kind == "pplastic" && (p.has("alpha") || p.has("alpha_u") || p.has("distribution")));
        if kind == "pplastic" {
            self.lose(p.plugin, "rendered as plastic");
            p.ignore(&["specular_transmittance"]);
        }
        BsdfDesc::Plastic {
            diffuse_reflectance: self.color(p, "diffuse_reflectance", 0.5),
            specular_reflectance: self.color(p, "specular_reflectance", 1.0),
            int_ior: self.ior(p, "int_ior", "polypropylene"),
            ext_ior: self.ior(p, "ext_ior", "air"),
            nonlinear: p.bool("nonlinear", false),
            roughness: rough.then(|| self.roughness(p, 0.1)),
        }
    }

    fn principled(&mut self, p: &mut Props<'t>, thin: bool) -> BsdfDesc {
        p.ignore(&[
            "main_specular_sampling_rate",
            "clearcoat_sampling_rate",
            "diffuse_reflectance_sampling_rate",
            "spec_reflect_sampling_rate",
            "spec_trans_sampling_rate",
            "diff_trans_sampling_rate",
            "specular_reflectance_sampling_rate",
            "specular_transmittance_sampling_rate",
            "diffuse_transmittance_sampling_rate",
        ]);
        let mut desc = PrincipledDesc {
            thin,
            base_color: self.color(p, "base_color", 0.5),
            roughness: self.scalar(p, "roughness", 0.5),
            anisotropic: self.scalar(p, "anisotropic", 0.0),
            spec_trans: self.scalar(p, "spec_trans", 0.0),
            spec_tint: self.scalar(p, "spec_tint", 0.0),
            sheen: self.scalar(p, "sheen", 0.0),
            sheen_tint: self.scalar(p, "sheen_tint", 0.0),
            flatness: self.scalar(p, "flatness", 0.0),
            metallic: Param::Constant(0.0),
            eta: Param::Constant(1.5),
            clearcoat: Param::Constant(0.0),
            clearcoat_gloss: Param::Constant(0.0),
            diff_trans: Param::Constant(0.0),
        };
        if thin {
            desc.eta = self.scalar(p, "eta", 1.5);
            desc.diff_trans = self.scalar(p, "diff_trans", 0.0);
        } else {
            desc.metallic = self.scalar(p, "metallic", 0.0);
            desc.clearcoat = self.scalar(p, "clearcoat", 0.0);
            desc.clearcoat_gloss = self.scalar(p, "clearcoat_gloss", 0.0);
            match p.opt_float("specular") {
                // Burley 2015: normal reflectance 0.08 · specular, solved for the index.
                Some(specular) => {
                    if p.has("eta") {
                        p.fault_at("specular", "`specular` cannot stand beside `eta`");
                    }
                    p.ignore(&["eta"]);
                    desc.eta = Param::Constant(2.0 / (1.0 - (0.08 * specular.clamp(0.0, 10.0)).sqrt()) - 1.0);
                }
                None => desc.eta = self.scalar(p, "eta", 1.5),
            }
        }
        BsdfDesc::Principled(Box::new(desc))
    }
}

fn isotropic(distribution: MicrofacetKind, alpha: f32) -> Roughness {
    let alpha: Scalar = Param::Constant(alpha);
    Roughness { distribution, alpha_u: alpha, alpha_v: alpha }
}
