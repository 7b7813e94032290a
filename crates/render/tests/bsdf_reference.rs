//! The standard scattering models against values of Mitsuba 3 (data/bsdf_mitsuba.py).
#![allow(clippy::unwrap_used, clippy::panic)]

use etendue_render::bsdf::microfacet::{Distribution, Microfacet};
use etendue_render::bsdf::*;
use etendue_render::math::{Vec2, Vec3};
use etendue_render::spectrum::Spectrum;
use serde_json::Value;

fn number(v: &Value) -> f32 {
    v.as_f64().unwrap() as f32
}

fn triple(v: &Value) -> [f32; 3] {
    std::array::from_fn(|i| number(&v[i]))
}

fn color(params: &Value, name: &str) -> Spectrum {
    params.get(name).filter(|v| v.is_array()).map_or(Spectrum::ONE, |v| Spectrum::from_rgb(triple(v)))
}

fn model(name: &str, p: &Value) -> Bsdf {
    let distribution = if p["distribution"] == "ggx" { Distribution::Ggx } else { Distribution::Beckmann };
    let facets = || Microfacet::new(distribution, number(&p["alpha_u"]), number(&p["alpha_v"]));
    let (eta, k, specular_reflectance) = (color(p, "eta"), color(p, "k"), color(p, "specular_reflectance"));
    let specular_transmittance = Spectrum::ONE;
    let nonlinear = p["nonlinear"] == true;
    let index = || number(&p["eta"]);
    match name {
        "diffuse" => Bsdf::Diffuse(Diffuse { reflectance: color(p, "reflectance") }),
        "conductor" => Bsdf::Conductor(Conductor { eta, k, specular_reflectance }),
        "roughconductor" => Bsdf::RoughConductor(RoughConductor { microfacet: facets(), eta, k, specular_reflectance }),
        "dielectric" => Bsdf::Dielectric(Dielectric { eta: index(), specular_reflectance, specular_transmittance }),
        "thindielectric" => Bsdf::ThinDielectric(ThinDielectric { eta: index(), specular_reflectance, specular_transmittance }),
        "roughdielectric" => {
            Bsdf::RoughDielectric(RoughDielectric { microfacet: facets(), eta: index(), specular_reflectance, specular_transmittance })
        }
        "plastic" => Bsdf::Plastic(Plastic::new(color(p, "diffuse_reflectance"), specular_reflectance, index(), nonlinear)),
        "roughplastic" => {
            let alpha = number(&p["alpha"]);
            Bsdf::RoughPlastic(RoughPlastic {
                microfacet: Microfacet::isotropic(distribution, alpha),
                diffuse_reflectance: color(p, "diffuse_reflectance"),
                specular_reflectance,
                eta: index(),
                transmittance: RoughTransmittance::new(distribution, alpha, index()),
                nonlinear,
            })
        }
        _ => panic!("{name}"),
    }
}

#[test]
fn values_and_densities_agree_with_mitsuba() {
    let data: Value = serde_json::from_str(include_str!("data/bsdf_mitsuba.json")).unwrap();
    let mut faults = Vec::new();
    for case in data["cases"].as_array().unwrap() {
        let name = case["model"].as_str().unwrap();
        let bsdf = model(name, &case["params"]);
        let tolerance = match name {
            // Both integrate the coat's transmittance numerically.
            "roughplastic" => 3e-3,
            // Mitsuba has a polynomial for the internal diffuse reflectance, we the closed form.
            "plastic" => 2e-3,
            _ => 1e-3,
        };
        let mut compare = |what: &str, row: &Value, ours: f32, theirs: f32| {
            let close = (ours - theirs).abs() <= tolerance * theirs.abs().max(1e-4);
            if !close {
                let relative = ours / theirs - 1.0;
                faults.push(format!(
                    "{name} {}: {what} {ours} not {theirs} ({relative:.1e}), wo {} wi {}",
                    case["params"], row["wo"], row["wi"]
                ));
            }
        };
        for row in case["evaluations"].as_array().unwrap() {
            let (wo, wi) = (Vec3::from(triple(&row["wo"])), Vec3::from(triple(&row["wi"])));
            compare("pdf", row, bsdf.pdf(wo, wi), number(&row["pdf"]));
            for (field, mode) in [("value", TransportMode::Radiance), ("value_importance", TransportMode::Importance)] {
                if let Some(value) = row.get(field) {
                    let ours = bsdf.eval(wo, wi, mode).rgb();
                    for (ours, theirs) in ours.into_iter().zip(triple(value)) {
                        compare(field, row, ours, theirs);
                    }
                }
            }
        }
        for row in case["deltas"].as_array().unwrap() {
            let (wo, wi) = (Vec3::from(triple(&row["wo"])), Vec3::from(triple(&row["wi"])));
            // One end of the lobe choice finds reflection, the other one transmission.
            let found = [0.0, 0.999_999].into_iter().filter_map(|u| bsdf.sample(wo, u, Vec2::splat(0.5), TransportMode::Radiance));
            let Some(s) = found.into_iter().find(|s| (s.wi - wi).length() < 1e-3) else {
                panic!("{name} {}: no lobe from {wo} to {wi}", case["params"]);
            };
            assert!(s.lobe.contains(Lobe::DELTA));
            compare("probability", row, s.pdf, number(&row["probability"]));
            compare("eta", row, s.eta, number(&row["eta"]));
            for (ours, theirs) in (s.value / s.pdf).rgb().into_iter().zip(triple(&row["weight"])) {
                compare("weight", row, ours, theirs);
            }
        }
    }
    assert!(faults.is_empty(), "{} faults\n{}", faults.len(), faults.join("\n"));
}
