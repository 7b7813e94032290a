//! The principled model: values of Mitsuba 3, sampling statistics, extremes.

use etendue_render::bsdf::{Principled, TransportMode};
use etendue_render::math::Vec3;
use etendue_render::spectrum::Spectrum;
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
    let mut worst = 0.0f32;
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
                    worst = worst.max(error);
                    assert!(error < 1e-3, "{} wo {wo} wi {wi}: {got:?}, Mitsuba {want:?}", case["params"]);
                }
            }
        }
    }
    eprintln!("largest relative difference {worst:e}");
}

fn vec3_raw(v: &Value) -> [f32; 3] {
    [0, 1, 2].map(|i| v[i].as_f64().unwrap() as f32)
}
