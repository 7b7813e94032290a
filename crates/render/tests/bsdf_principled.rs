//! The principled model: values of Mitsuba 3, sampling statistics, extremes.

#![allow(clippy::unwrap_used)]

use etendue_render::bsdf::{Bsdf, Lobe, Principled, TransportMode};
use etendue_render::math::Vec3;
use etendue_render::spectrum::Spectrum;
use etendue_render::testing::bsdf::*;
use serde_json::Value;

fn vec3(v: &Value) -> Vec3 {
    let f = |i: usize| v[i].as_f64().unwrap();
    // The file holds seven digits.
    let (x, y, z) = (f(0), f(1), f(2));
    let len = (x * x + y * y + z * z).sqrt();
    Vec3::new((x / len) as f32, (y / len) as f32, (z / len) as f32)
}

#[test]
fn values_are_those_of_mitsuba() {
    let file: Value = serde_json::from_str(include_str!("data/principled_mitsuba.json")).unwrap();
    let base_color = Spectrum::from_rgb(vec3_raw(&file["base_color"]));
    for case in file["cases"].as_array().unwrap() {
        let mut b = Principled { base_color, thin: case["thin"].as_bool().unwrap(), ..Default::default() };
        b.eta = Principled::eta_from_specular(0.5);
        if b.thin {
            b.eta = 1.5;
        }
        for (name, value) in case["params"].as_object().unwrap() {
            let v = value.as_f64().unwrap() as f32;
            match name.as_str() {
                "roughness" => b.roughness = v,
                "anisotropic" => b.anisotropic = v,
                "metallic" => b.metallic = v,
                "spec_trans" => b.spec_trans = v,
                "eta" => b.eta = v,
                "specular" => b.eta = Principled::eta_from_specular(v),
                "spec_tint" => b.spec_tint = v,
                "sheen" => b.sheen = v,
                "sheen_tint" => b.sheen_tint = v,
                "flatness" => b.flatness = v,
                "clearcoat" => b.clearcoat = v,
                "clearcoat_gloss" => b.clearcoat_gloss = v,
                "diff_trans" => b.diff_trans = v,
                other => panic!("{other}"),
            }
        }
        let mut expected = case["values"].as_array().unwrap().iter();
        for wo in file["wo"].as_array().unwrap() {
            for wi in file["wi"].as_array().unwrap() {
                let want = vec3_raw(expected.next().unwrap());
                let got = b.eval(vec3(wo), vec3(wi), TransportMode::Radiance).rgb();
                for (g, w) in got.into_iter().zip(want) {
                    let error = (g - w).abs() / w.abs().max(1e-4);
                    assert!(error < 1e-3, "{} wo {wo} wi {wi}: {got:?}, Mitsuba {want:?}", case["params"]);
                }
            }
        }
    }
}

fn vec3_raw(v: &Value) -> [f32; 3] {
    [0, 1, 2].map(|i| v[i].as_f64().unwrap() as f32)
}

fn models() -> Vec<(&'static str, Principled)> {
    let base = Principled { base_color: Spectrum::from_rgb([0.8, 0.35, 0.1]), roughness: 0.4, ..Default::default() };
    let thin = Principled { thin: true, ..base.clone() };
    vec![
        ("plain", base.clone()),
        ("metal", Principled { metallic: 1.0, anisotropic: 0.7, ..base.clone() }),
        ("sheen", Principled { sheen: 1.0, sheen_tint: 0.5, flatness: 0.8, spec_tint: 0.5, ..base.clone() }),
        ("clearcoat", Principled { clearcoat: 1.0, clearcoat_gloss: 0.2, roughness: 0.7, ..base.clone() }),
        ("glass", Principled { spec_trans: 1.0, eta: 1.5, ..base.clone() }),
        ("half glass", Principled { spec_trans: 0.5, metallic: 0.3, eta: 1.33, clearcoat: 0.5, anisotropic: 0.4, ..base.clone() }),
        ("dense outside", Principled { spec_trans: 1.0, eta: 0.7, ..base.clone() }),
        ("thin", thin.clone()),
        ("thin translucent", Principled { diff_trans: 1.3, sheen: 0.5, ..thin.clone() }),
        ("thin glass", Principled { spec_trans: 0.7, diff_trans: 0.6, anisotropic: 0.5, spec_tint: 0.5, ..thin }),
    ]
}

fn views(b: &Principled) -> Vec<Vec3> {
    let mut wo = vec![direction(5.0, 30.0), direction(55.0, 200.0), direction(80.0, 70.0)];
    if b.thin || b.spec_trans > 0.0 {
        wo.extend([direction(150.0, 40.0), direction(110.0, 300.0)]);
    }
    wo
}

#[test]
fn samples_have_their_density_and_value() {
    let all = models();
    let tests: usize = all.iter().map(|(_, b)| views(b).len()).sum();
    for (seed, (name, b)) in all.into_iter().enumerate() {
        for wo in views(&b) {
            let bsdf = Bsdf::Principled(b.clone());
            check_density(name, &bsdf, wo, significance(tests), 5e-3, seed as u64);
            check_consistency(name, &bsdf, wo, 5e-3);
        }
    }
}

#[test]
fn light_and_camera_may_change_places() {
    for (name, b) in models() {
        // Mitsuba's tinted and thin lobes depend on one side only.
        if !b.thin && b.eta > 1.0 {
            check_reciprocity(name, &Bsdf::Principled(b));
        }
    }
}

#[test]
fn extremes_stay_finite() {
    for (name, b) in models() {
        for roughness in [0.0, 1.0] {
            for eta in [1.0, 1.0005, 1e-3, 30.0] {
                let b = Principled { roughness, eta, anisotropic: 1.0, base_color: Spectrum::from_rgb([0.0, 0.5, 1.0]), ..b.clone() };
                check_extremes(name, &Bsdf::Principled(b));
            }
        }
        check_extremes(name, &Bsdf::Principled(Principled { base_color: Spectrum::ZERO, ..b }));
    }
}

#[test]
fn opaque_models_are_black_from_behind() {
    let b = Bsdf::Principled(models().remove(2).1);
    assert!(!b.lobes().contains(Lobe::TRANSMISSION));
    assert!(b.eval(direction(120.0, 0.0), direction(130.0, 20.0), TransportMode::Radiance).is_black());
    assert!(b.sample(direction(120.0, 0.0), 0.3, etendue_render::math::Vec2::splat(0.4), TransportMode::Radiance).is_none());
}
