//! Every standard scattering model with several parameters: sampling, energy, symmetry, limits and hostile input.

use etendue_render::bsdf::fresnel;
use etendue_render::bsdf::microfacet::{Distribution, Microfacet};
use etendue_render::bsdf::*;
use etendue_render::math::Vec3;
use etendue_render::spectrum::Spectrum;
use etendue_render::testing::bsdf::*;

const BOTH: [Distribution; 2] = [Distribution::Ggx, Distribution::Beckmann];
const WHITE: Spectrum = Spectrum::ONE;
const GOLD: (Spectrum, Spectrum) = (Spectrum::from_rgb([0.14, 0.37, 1.44]), Spectrum::from_rgb([3.98, 2.38, 1.60]));
const COLOR: Spectrum = Spectrum::from_rgb([0.9, 0.5, 0.1]);

fn rough_conductor(distribution: Distribution, ax: f32, ay: f32) -> RoughConductor {
    RoughConductor { microfacet: Microfacet::new(distribution, ax, ay), eta: GOLD.0, k: GOLD.1, specular_reflectance: WHITE }
}

fn rough_dielectric(distribution: Distribution, ax: f32, ay: f32, eta: f32) -> Bsdf {
    let microfacet = Microfacet::new(distribution, ax, ay);
    Bsdf::RoughDielectric(RoughDielectric { microfacet, eta, specular_reflectance: WHITE, specular_transmittance: WHITE })
}

fn rough_plastic(distribution: Distribution, alpha: f32, eta: f32, nonlinear: bool) -> RoughPlastic {
    RoughPlastic {
        microfacet: Microfacet::isotropic(distribution, alpha),
        diffuse_reflectance: COLOR,
        specular_reflectance: WHITE,
        eta,
        transmittance: RoughTransmittance::new(distribution, alpha, eta),
        nonlinear,
    }
}

fn coated(base: CoatedBase, coat: Coat, eta: f32, absorption: f32) -> Bsdf {
    Bsdf::Coated(Coated { base, coat, eta, absorption: Spectrum::splat(absorption), specular_reflectance: WHITE })
}

fn rough_coat(distribution: Distribution, alpha: f32, eta: f32) -> Coat {
    let microfacet = Microfacet::isotropic(distribution, alpha);
    Coat::Rough { microfacet, transmittance: RoughTransmittance::new(distribution, alpha, eta) }
}

/// Models with the roughness of ordinary scenes, where `f32` resolves everything.
fn models() -> Vec<(String, Bsdf)> {
    let mut all = vec![
        ("diffuse".into(), Bsdf::Diffuse(Diffuse { reflectance: COLOR })),
        ("null".into(), Bsdf::Null(Null)),
        ("conductor".into(), Bsdf::Conductor(Conductor { eta: GOLD.0, k: GOLD.1, specular_reflectance: WHITE })),
        ("mirror".into(), Bsdf::Conductor(Conductor::mirror(WHITE))),
    ];
    for sigma in [0.0, 0.1, 0.35, 0.7] {
        all.push((format!("rough diffuse {sigma}"), Bsdf::RoughDiffuse(RoughDiffuse { reflectance: COLOR, sigma })));
    }
    for eta in [1.5, 1.0, 0.7] {
        let (r, t) = (WHITE, WHITE);
        all.push((format!("dielectric {eta}"), Bsdf::Dielectric(Dielectric { eta, specular_reflectance: r, specular_transmittance: t })));
        all.push((
            format!("thin dielectric {eta}"),
            Bsdf::ThinDielectric(ThinDielectric { eta, specular_reflectance: r, specular_transmittance: t }),
        ));
        all.push((format!("plastic {eta}"), Bsdf::Plastic(Plastic::new(COLOR, WHITE, eta, eta > 1.2))));
    }
    for d in BOTH {
        for (ax, ay) in [(0.1, 0.1), (0.15, 0.6), (0.8, 0.8)] {
            all.push((format!("rough conductor {d:?} {ax} {ay}"), Bsdf::RoughConductor(rough_conductor(d, ax, ay))));
        }
        for (ax, ay, eta) in [(0.1, 0.1, 1.5), (0.2, 0.5, 1.33), (0.6, 0.6, 1.5), (0.3, 0.3, 0.7), (0.4, 0.4, 1.05)] {
            all.push((format!("rough dielectric {d:?} {ax} {ay} {eta}"), rough_dielectric(d, ax, ay, eta)));
        }
        for (alpha, eta, nonlinear) in [(0.1, 1.5, false), (0.4, 1.9, true)] {
            all.push((format!("rough plastic {d:?} {alpha} {eta}"), Bsdf::RoughPlastic(rough_plastic(d, alpha, eta, nonlinear))));
        }
        let base = || CoatedBase::RoughConductor(rough_conductor(d, 0.2, 0.4));
        all.push((format!("coated rough conductor {d:?}"), coated(base(), Coat::Smooth, 1.5, 0.2)));
        all.push((format!("rough coated rough conductor {d:?}"), coated(base(), rough_coat(d, 0.2, 1.5), 1.5, 0.0)));
    }
    let plastic = || CoatedBase::Plastic(Plastic::new(COLOR, WHITE, 1.3, false));
    let smooth_metal = || CoatedBase::Conductor(Conductor { eta: GOLD.0, k: GOLD.1, specular_reflectance: WHITE });
    all.push(("coated plastic".into(), coated(plastic(), Coat::Smooth, 1.7, 0.1)));
    all.push(("coated conductor".into(), coated(smooth_metal(), Coat::Smooth, 1.5, 0.5)));
    all.push(("rough coated conductor".into(), coated(smooth_metal(), rough_coat(Distribution::Ggx, 0.3, 1.5), 1.5, 0.5)));
    for coat in [Coat::Smooth, rough_coat(Distribution::Beckmann, 0.5, 1.4)] {
        all.push((format!("{coat:.12?} diffuse"), coated(CoatedBase::Diffuse(Diffuse { reflectance: COLOR }), coat, 1.4, 0.3)));
    }
    all
}

fn directions() -> Vec<Vec3> {
    [(0.0, 0.0), (30.0, 20.0), (65.0, 200.0), (86.0, 100.0), (140.0, 70.0), (175.0, 10.0)].map(|(t, p)| direction(t, p)).to_vec()
}

#[test]
fn samples_have_their_density() {
    let (models, directions) = (models(), directions());
    let level = significance(models.len() * directions.len());
    for (i, (name, bsdf)) in models.iter().enumerate() {
        for (j, &wo) in directions.iter().enumerate() {
            // Beckmann's masking function is an approximation: see `Microfacet::g1_distant`.
            check_density(name, bsdf, wo, level, 4e-3, (i * 100 + j) as u64);
        }
    }
}

#[test]
fn energy_is_conserved_and_estimated_without_bias() {
    for (name, bsdf) in models() {
        for wo in directions() {
            check_energy(&name, &bsdf, wo, 1.004);
        }
    }
}

#[test]
fn samples_agree_with_eval_and_pdf() {
    for (name, bsdf) in models() {
        for wo in directions() {
            check_consistency(&name, &bsdf, wo, 5e-3);
        }
    }
}

#[test]
fn light_and_camera_may_change_places() {
    for (name, bsdf) in models() {
        check_reciprocity(&name, &bsdf);
    }
}

#[test]
fn transmitted_radiance_scales_with_the_squared_index() {
    for d in BOTH {
        for eta in [1.5f32, 0.7] {
            let b = rough_dielectric(d, 0.4, 0.2, eta);
            let (up, down) = (direction(30.0, 10.0), direction(160.0, 200.0));
            let through = b.eval(up, down, TransportMode::Radiance).0[0] / down.z.abs();
            let back = b.eval(down, up, TransportMode::Radiance).0[0] / up.z.abs();
            // Radiance over the squared index is what is conserved: f(up, down) η² = f(down, up) (Veach 1997, section 5.2).
            assert!(through > 0.0 && (through * eta * eta / back - 1.0).abs() < 1e-3, "{d:?} {eta} {through} {back}");
        }
    }
}

#[test]
fn smooth_limits_are_the_smooth_models() {
    for d in BOTH {
        for theta in [0.0, 40.0, 70.0] {
            let wo = direction(theta, 10.0);
            let metal = Bsdf::RoughConductor(rough_conductor(d, 0.02, 0.02));
            let smooth = fresnel::conductor(wo.z, GOLD.0, GOLD.1).0[0];
            let rough = check_energy("rough conductor", &metal, wo, 1.0);
            assert!((rough - f64::from(smooth)).abs() < 5e-3, "{d:?} {theta} {rough} {smooth}");
            // Transmission through nearly smooth glass goes along the refracted direction.
            let glass = rough_dielectric(d, 1e-3, 1e-3, 1.5);
            let (_, cos_t, _, eta_ti) = fresnel::dielectric(wo.z, 1.5);
            let s = glass.sample(wo, 0.999, glam::Vec2::splat(0.5), TransportMode::Radiance).unwrap();
            assert!((s.wi - fresnel::refract(wo, Vec3::Z, cos_t, eta_ti)).length() < 5e-3, "{s:?}");
            assert!((s.value.0[0] / s.pdf - 1.0 / 2.25).abs() < 5e-3);
        }
    }
    let (wo, wi) = (direction(50.0, 10.0), direction(30.0, 100.0));
    let lambert = Diffuse { reflectance: COLOR }.eval(wo, wi, TransportMode::Radiance);
    let near = RoughDiffuse { reflectance: COLOR, sigma: 1e-4 }.eval(wo, wi, TransportMode::Radiance);
    let bare = coated(CoatedBase::Diffuse(Diffuse { reflectance: COLOR }), Coat::Smooth, 1.0001, 0.0).eval(wo, wi, TransportMode::Radiance);
    for l in 0..3 {
        assert!((near.0[l] - lambert.0[l]).abs() < 1e-4 && (bare.0[l] - lambert.0[l]).abs() < 1e-4);
    }
}

#[test]
fn mirror_keeps_all_light() {
    let mirror = Bsdf::Conductor(Conductor::mirror(Spectrum::splat(0.75)));
    for wo in directions().into_iter().filter(|w| w.z > 0.0) {
        let s = mirror.sample(wo, 0.5, glam::Vec2::ZERO, TransportMode::Radiance).unwrap();
        assert!((s.value.0[0] - 0.75).abs() < 1e-6 && (s.wi + wo).truncate().length() < 1e-6);
    }
}

#[test]
fn oren_nayar_has_its_known_values() {
    // By hand from the published equations, ρ = 0.8, σ = 0.5. Normal incidence: β = 0, all but C1 and the interreflection vanish.
    let b = RoughDiffuse { reflectance: Spectrum::splat(0.8), sigma: 0.5 };
    let s2 = 0.25f32;
    let straight = (0.8 * (1.0 - 0.5 * s2 / (s2 + 0.33)) + 0.64 * 0.17 * s2 / (s2 + 0.13)) / std::f32::consts::PI;
    assert!((b.eval(Vec3::Z, Vec3::Z, TransportMode::Radiance).0[0] - straight).abs() < 1e-5);
    // Brighter back towards the light than away from it.
    let (wo, away) = (direction(60.0, 0.0), direction(60.0, 180.0));
    let (back, forth) = (b.eval(wo, wo, TransportMode::Radiance).0[0], b.eval(wo, away, TransportMode::Radiance).0[0]);
    assert!(back > 1.3 * forth, "{back} {forth}");
}

#[test]
fn coat_absorbs_along_the_refracted_path() {
    let base = || CoatedBase::Diffuse(Diffuse { reflectance: COLOR });
    let (wo, wi) = (direction(50.0, 0.0), direction(30.0, 90.0));
    let clear = coated(base(), Coat::Smooth, 1.5, 0.0).eval(wo, wi, TransportMode::Radiance).0[0];
    let tinted = coated(base(), Coat::Smooth, 1.5, 0.7).eval(wo, wi, TransportMode::Radiance).0[0];
    let cos_in = |w: Vec3| (1.0 - (1.0 - w.z * w.z) / 2.25).sqrt();
    let expected = f64::from(clear) * (-0.7 * f64::from(1.0 / cos_in(wo) + 1.0 / cos_in(wi))).exp();
    assert!((f64::from(tinted) / expected - 1.0).abs() < 1e-4, "{tinted} {expected}");
    // The closed form: ρ/π cosθi T(wo) T(wi) / η².
    let t = |w: Vec3| 1.0 - fresnel::dielectric(w.z, 1.5).0;
    let closed = 0.9 / std::f32::consts::PI * wi.z * t(wo) * t(wi) / 2.25;
    assert!((clear / closed - 1.0).abs() < 1e-4);
}

#[test]
fn extreme_input_gives_finite_numbers() {
    for (name, bsdf) in models() {
        check_extremes(&name, &bsdf);
    }
    for d in BOTH {
        for alpha in [0.0, 1e-4, 5.0] {
            let metal = rough_conductor(d, alpha, alpha);
            check_extremes("rough conductor", &Bsdf::RoughConductor(metal.clone()));
            check_extremes("coated", &coated(CoatedBase::RoughConductor(metal), rough_coat(d, alpha, 1.5), 1.5, 1e6));
            for eta in [1.0, 1.0 + 1e-6, 0.9989, 1.0011, 0.3, 10.0] {
                check_extremes("rough dielectric", &rough_dielectric(d, alpha, alpha, eta));
            }
        }
        check_extremes("rough plastic", &Bsdf::RoughPlastic(rough_plastic(d, 1e-4, 1.0, false)));
        check_extremes("rough plastic", &Bsdf::RoughPlastic(rough_plastic(d, 0.3, 0.6, true)));
    }
    let black = Spectrum::ZERO;
    check_extremes("black glass", &Bsdf::Dielectric(Dielectric { eta: 1.5, specular_reflectance: black, specular_transmittance: black }));
    check_extremes("black plastic", &Bsdf::Plastic(Plastic::new(black, black, 1.0, false)));
    check_extremes("coat of 0.6", &coated(CoatedBase::Conductor(Conductor::mirror(WHITE)), Coat::Smooth, 0.6, 0.0));
    check_extremes("empty metal", &Bsdf::Conductor(Conductor { eta: black, k: black, specular_reflectance: WHITE }));
}
