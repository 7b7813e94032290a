//! The film is the same bit for bit, whoever renders it, in whatever order and pieces, on whatever machine.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use std::sync::atomic::{AtomicU32, Ordering};

use etendue_render::accel::IsaKind;
use etendue_render::film::{DevelopOptions, Film, Rect};
use etendue_render::integrator::Path;
use etendue_render::session::job::{self, Plan};
use etendue_render::session::{Aov, Cancel, Observer, Reason, Session, Silent, Status, Stop};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::{Mat4, Vec3};
use support::*;

const SPP: u32 = 16;

/// A bit of everything that computes: diffuse, glass, rough metal, plastic, a mask, a mesh, an instance, an area light, a
/// picture all round and a spot light.
fn everything() -> SceneDesc {
    let mut desc = scene();
    let floor = diffuse(&mut desc, 0.6);
    rectangle(&mut desc, Vec3::ZERO, [6.0; 2], false, Some(floor));
    let models = [glass(1.5, None), mirror(Some(0.2)), plastic(0.5, true, None), glass(1.4, Some(0.2))];
    for (i, model) in models.into_iter().enumerate() {
        let material = bsdf(&mut desc, model);
        sphere(&mut desc, Vec3::new(1.3 * i as f32 - 2.0, 0.3, 0.6), 0.6, Some(material));
    }
    let mask = bsdf(&mut desc, BsdfDesc::Mask { nested: floor, opacity: Param::Constant(0.5) });
    rectangle(&mut desc, Vec3::new(1.0, -1.5, 0.3), [0.5; 2], false, Some(mask));
    let cube = shape(&mut desc, GeometryDesc::Cube, Mat4::from_scale(Vec3::splat(0.3)), Some(floor));
    let group = add(&mut desc, GroupDesc { shapes: vec![cube] });
    for x in [-1.5, 0.0] {
        let world_from_object = Mat4::from_translation(Vec3::new(x, -1.5, 0.4)) * Mat4::from_rotation_z(x + 0.3);
        add(&mut desc, InstanceDesc { group, world_from_object });
    }
    let light = rectangle(&mut desc, Vec3::new(-1.0, 0.0, 3.0), [0.7; 2], true, Some(floor));
    emit(&mut desc, light, Color::Constant([4.0, 3.0, 2.0]));
    let sky = (0..8 * 4 * 3).map(|i| 0.1 + (i * 7 % 11) as f32 * 0.05).collect();
    let image = picture(&mut desc, 8, 4, 3, sky);
    add(
        &mut desc,
        LightDesc::Environment {
            image,
            scale: [1.0; 3],
            world_from_light: Mat4::from_rotation_x(1.57),
            mapping: EnvironmentMapping::Equirectangular,
            portal: None,
        },
    );
    let spot = LightDesc::Spot {
        world_from_light: look_at(Vec3::new(3.0, -3.0, 3.0), Vec3::ZERO),
        intensity: [20.0; 3],
        outer_rad: 0.5,
        inner_rad: 0.3,
        falloff: SpotFalloff::Linear,
        texture: None,
    };
    add(&mut desc, spot);
    perspective(&mut desc, Vec3::new(0.0, -6.0, 3.0), Vec3::new(0.0, 0.0, 0.5), 45.0);
    desc
}

fn wanted(sampler: &str) -> RenderSettings {
    RenderSettings {
        sampler: Some(sampler.into()),
        filter: Some("gaussian".into()),
        max_depth: Some(6),
        seed: 5,
        // Several tiles, the last ones cut.
        ..settings(72, 40, SPP)
    }
}

fn new_session(sampler: &str) -> Session {
    let (desc, s) = (everything(), wanted(sampler));
    let plan = Plan::new(&desc, &s, None).unwrap();
    job::prepare(&desc, &s, &plan, &Aov::ALL).unwrap()
}

fn render_some(session: &mut Session, spp: u32) -> Reason {
    session.render(&Stop { spp: Some(spp), ..Stop::default() }, &Cancel::default(), &Silent).unwrap()
}

fn reference(sampler: &str) -> Vec<u8> {
    let mut session = new_session(sampler);
    assert_eq!(render_some(&mut session, SPP), Reason::Samples);
    assert_eq!(session.film().counters().non_finite, 0);
    bytes(session.film())
}

fn with_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

type TileOrder = fn(&mut Vec<Rect>);

#[test]
fn threads_and_tiles_do_not_matter() {
    let whole = reference("sobol");
    let orders: [(&str, TileOrder); 4] = [
        ("as they come", |_| {}),
        ("backwards", |tiles| tiles.reverse()),
        ("interleaved", |tiles| tiles.sort_by_key(|t| (t.x0 / 32 + t.y0 / 32) % 2)),
        ("rows", |tiles| {
            let all = tiles.iter().copied().reduce(|a, b| Rect::new(a.x0.min(b.x0), a.y0.min(b.y0), a.x1.max(b.x1), a.y1.max(b.y1)));
            let all = all.unwrap();
            *tiles = (all.y0..all.y1).map(|y| Rect::new(all.x0, y, all.x1, y + 1)).collect();
        }),
    ];
    for (threads, (name, order)) in [1, 2, 5].into_iter().flat_map(|t| orders.map(|o| (t, o))) {
        if threads == 5 && name != "rows" {
            continue;
        }
        let film = with_threads(threads, || {
            let mut session = new_session("sobol");
            session.set_tile_order(order);
            render_some(&mut session, SPP);
            bytes(session.film())
        });
        assert!(film == whole, "{threads} threads, tiles {name}");
    }
}

/// Cancels when so many tiles or passes have been reported.
struct Interrupt {
    calls_left: AtomicU32,
    cancel: Cancel,
}

impl Observer for Interrupt {
    fn status(&self, _status: &Status) {
        if self.calls_left.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.cancel.cancel();
        }
    }
}

#[test]
fn an_interrupted_rendering_goes_on_to_the_same_end() {
    let whole = reference("sobol");
    let path = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("determinism-{}.film", std::process::id()));
    // Within the first pass, between passes, and within a late pass; with one thread and two.
    for (threads, calls) in [(1, 2), (2, 7), (1, 16), (2, 30)] {
        let film = with_threads(threads, || {
            let mut session = new_session("sobol");
            let cancel = Cancel::default();
            let interrupt = Interrupt { calls_left: AtomicU32::new(calls), cancel: cancel.clone() };
            let stop = Stop { spp: Some(SPP), ..Stop::default() };
            assert_eq!(session.render(&stop, &cancel, &interrupt).unwrap(), Reason::Cancelled);
            session.into_film()
        });
        assert!(bytes(&film) != whole);
        film.save(&path).unwrap();
        let mut session = new_session("sobol");
        session.resume(&Film::load(&path).unwrap()).unwrap();
        assert_eq!(render_some(&mut session, SPP), Reason::Samples);
        assert!(bytes(session.film()) == whole, "interrupted after {calls} reports with {threads} threads");
    }
    std::fs::remove_file(path).unwrap();
}

#[test]
fn parts_of_the_samples_add_up_to_the_whole() {
    for sampler in ["sobol", "independent", "stratified", "halton"] {
        let part = |first: u32, count: u32| {
            let mut session = new_session(sampler);
            session.set_first_sample(first);
            render_some(&mut session, count);
            session.into_film()
        };
        let whole = reference(sampler);
        let (a, b) = (part(0, 8), part(8, 8));
        for (mut first, second) in [(a.clone(), &b), (b.clone(), &a)] {
            first.merge(second).unwrap();
            assert!(bytes(&first) == whole, "{sampler}");
        }
        if sampler == "sobol" {
            let mut thirds = part(11, 5);
            thirds.merge(&part(0, 5)).unwrap();
            thirds.merge(&part(5, 6)).unwrap();
            assert!(bytes(&thirds) == whole);
            assert!(thirds.merge(&a).is_err(), "samples count once");
        }
    }
}

fn with_isa(isa: Option<IsaKind>) -> Film {
    let s = wanted("sobol");
    let mut scene = compile(&everything(), &s);
    if let Some(isa) = isa {
        scene.accel = scene.accel.with_isa(isa);
    }
    finish(session_of(scene, Box::new(Path::new(6, 4)), &s), &s)
}

#[test]
fn instruction_sets_do_not_matter() {
    let detected = bytes(&with_isa(None));
    for isa in IsaKind::available() {
        assert!(bytes(&with_isa(Some(isa))) == detected, "{isa:?}");
    }
    println!("instruction sets: {:?}", IsaKind::available());
}

/// FNV-1a over the bits of every channel and of the variances.
fn hash(film: &Film) -> u64 {
    let image = film.develop_with(DevelopOptions { variance: true, sample_count: true });
    let bits = image.channels.iter().flat_map(|c| &c.data).flat_map(|v| v.to_bits().to_le_bytes());
    bits.fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

/// Pictures must not differ between machines, compilers and operating systems. This number changes with every change of the
/// numerics, of sampling or of the scene above: where that is meant, put the number that the failure prints here and say so in the
/// change. Where it is not meant, or only some machines disagree, something has become inexact.
const HASH: u64 = 0x0a04_1365_a365_096f;

#[test]
fn the_numbers_are_those_of_all_machines() {
    let hash = hash(&with_isa(None));
    assert_eq!(hash, HASH, "the hash is now {hash:#018x}");
}
