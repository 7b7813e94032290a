//! Direct light by the best of several samples: the same light as by one, with less noise, and chosen where that is so.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

mod support;

use etendue_render::session::{Cancel, Session, Silent, Stop};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::Vec3;
use support::statistics::{Blocks, assert_same};
use support::*;

/// Lamps of many sizes over plates of many kinds, of which each plate sees little but one lamp (after Veach).
fn plates() -> SceneDesc {
    let mut desc = scene();
    let white = diffuse(&mut desc, 0.6);
    let metal = bsdf(&mut desc, mirror(Some(0.2)));
    rectangle(&mut desc, Vec3::ZERO, [4.0; 2], false, Some(metal));
    for (i, model) in [mirror(Some(0.1)), plastic(0.5, true, Some(0.15)), mirror(Some(0.3)), glass(1.5, Some(0.3))].into_iter().enumerate()
    {
        let material = bsdf(&mut desc, model);
        rectangle(&mut desc, Vec3::new(0.0, 0.6 * i as f32 - 2.6, 0.5), [2.0, 0.28], false, Some(material));
    }
    for (i, radius) in [0.03f32, 0.08, 0.2, 0.4].into_iter().enumerate() {
        let lamp = sphere(&mut desc, Vec3::new(1.1 * i as f32 - 1.6, 1.5, 2.0), radius, Some(white));
        let level = 0.5 / (radius * radius);
        emit(&mut desc, lamp, Color::Constant([level, level * 0.8, level * (0.4 + 0.2 * i as f32)]));
    }
    // The lamps are above the picture: their edges in it would be most of its noise.
    perspective(&mut desc, Vec3::new(0.0, -6.0, 3.0), Vec3::new(0.0, -1.8, 0.0), 40.0);
    desc
}

fn settings_of(max_splits: u32, spp: u32) -> RenderSettings {
    let of_all = settings(256, 192, spp);
    RenderSettings { max_splits: Some(max_splits), max_depth: Some(4), guiding: Some("off".into()), adaptive: Some(0.0), ..of_all }
}

fn choose(session: &Session) -> bool {
    session.notes().iter().any(|note| note.contains("light samples are compared"))
}

fn started(desc: &SceneDesc, settings: &RenderSettings) -> Session {
    let mut session = session(desc, settings);
    session.render(&Stop { spp: Some(1), ..Stop::default() }, &Cancel::default(), &Silent).unwrap();
    session
}

/// The light is that of single samples, among lamps of all kinds, behind a mask and guided; the noise is less.
#[test]
fn the_best_of_several_light_samples_brings_the_same_light() {
    let mut others = plates();
    add(&mut others, LightDesc::Point { position: Vec3::new(-1.0, -1.0, 2.0), intensity: [1.5, 1.0, 0.5] });
    constant_sky(&mut others, 0.1);
    let white = diffuse(&mut others, 0.7);
    let mask = bsdf(&mut others, BsdfDesc::Mask { nested: white, opacity: Param::Constant(0.5) });
    rectangle(&mut others, Vec3::new(0.0, 0.5, 1.2), [1.0, 0.5], false, Some(mask));
    for (name, desc, guiding) in [("plates", plates(), "off"), ("other lamps, a mask, guides", others, "on")] {
        let with = |max_splits| {
            let s = RenderSettings { guiding: Some(guiding.into()), ..settings_of(max_splits, 4) };
            let session = started(&desc, &s);
            assert_eq!(choose(&session), max_splits > 1, "{name}: {:?}", session.notes());
            Blocks::of_seeds(&desc, &s, 32)
        };
        let (best, single) = (with(16), with(1));
        assert_same(&format!("{name} by the best of several light samples"), &best, &single, 0.0, 0.3);
        let variance = |b: &Blocks| b.variance.iter().flatten().zip(b.mean.iter().flatten()).map(|(v, m)| v / (m * m)).sum::<f64>();
        assert!(variance(&best) < variance(&single), "{name}: {} instead of {}", variance(&best), variance(&single));
    }
}

/// One lamp that is seen from everywhere is sampled once.
#[test]
fn one_light_sample_is_enough_where_there_is_nothing_to_choose() {
    let mut desc = scene();
    let white = diffuse(&mut desc, 0.6);
    rectangle(&mut desc, Vec3::ZERO, [4.0; 2], false, Some(white));
    let lamp = rectangle(&mut desc, Vec3::new(0.0, 0.0, 3.0), [0.5; 2], true, Some(white));
    emit(&mut desc, lamp, Color::gray(5.0));
    perspective(&mut desc, Vec3::new(0.0, -6.0, 3.0), Vec3::ZERO, 40.0);
    assert!(!choose(&started(&desc, &settings_of(16, 1))));
}

/// Whether light samples are compared does not depend on threads, nor does any bit of the picture.
#[test]
fn choices_do_not_depend_on_threads() {
    let desc = plates();
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| bytes(&render(&desc, &settings_of(16, 1))))
    });
    assert!(one == three);
}
