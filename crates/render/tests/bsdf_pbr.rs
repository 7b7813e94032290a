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
        let (u_lobe, u) = random(1, i);
        // A rank-one lattice in the plane, shifted: less noise than independent points.
        let u = Vec2::new((u.x / n as f32 + i as f32 / n as f32).min(0.999_999_9), u.y);
        let u_lobe = (u_lobe + i as f32 * 0.618_034).fract();
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
