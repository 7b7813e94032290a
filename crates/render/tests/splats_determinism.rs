//! Methods that bring light to other pixels make the same film bit for bit, whoever renders it, in whatever order and pieces.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

mod support;

use std::sync::atomic::{AtomicU32, Ordering};

use etendue_render::film::{Film, Rect};
use etendue_render::session::job::{self, JobError, Plan};
use etendue_render::session::{Cancel, Observer, Reason, Session, Silent, Status, Stop};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::Vec3;
use support::*;

const SPP: u32 = 6;
const METHODS: [&str; 4] = ["light", "bdpt", "vcm", "mlt"];

/// Diffuse, glass and rough surfaces, a lamp with a light group, and a sky.
fn some_of_everything() -> SceneDesc {
    let mut desc = scene();
    let floor = diffuse(&mut desc, 0.6);
    rectangle(&mut desc, Vec3::ZERO, [4.0; 2], false, Some(floor));
    for (i, model) in [glass(1.5, None), mirror(Some(0.2)), plastic(0.5, true, None)].into_iter().enumerate() {
        let material = bsdf(&mut desc, model);
        sphere(&mut desc, Vec3::new(1.3 * i as f32 - 1.3, 0.3, 0.6), 0.6, Some(material));
    }
    let mask = bsdf(&mut desc, BsdfDesc::Mask { nested: floor, opacity: Param::Constant(0.5) });
    rectangle(&mut desc, Vec3::new(1.0, -1.0, 0.5), [0.5; 2], false, Some(mask));
    let lamp = rectangle(&mut desc, Vec3::new(-1.0, 0.0, 3.0), [0.7; 2], true, Some(floor));
    emit(&mut desc, lamp, Color::Constant([4.0, 3.0, 2.0]));
    desc.shapes[lamp.0 as usize].value.emission.as_mut().unwrap().group = "lamp".into();
    constant_sky(&mut desc, 0.3);
    perspective(&mut desc, Vec3::new(0.0, -6.0, 3.0), Vec3::new(0.0, 0.0, 0.5), 45.0);
    desc
}

fn wanted(method: &str) -> RenderSettings {
    RenderSettings {
        integrator: Some(method.into()),
        sampler: Some("sobol".into()),
        filter: Some("gaussian".into()),
        max_depth: Some(5),
        photon_radius: Some(0.05),
        light_groups: true,
        seed: 5,
        // Several tiles, the last ones cut.
        ..settings(44, 36, SPP)
    }
}

fn new_session(method: &str, crop: Option<[u32; 4]>) -> Session {
    let (desc, s) = (some_of_everything(), wanted(method));
    let plan = Plan::new(&desc, &s, crop).unwrap();
    job::prepare(&desc, &s, &plan, &[]).unwrap()
}

fn render_some(session: &mut Session, spp: u32) {
    let stop = Stop { spp: Some(spp), ..Stop::default() };
    assert_eq!(session.render(&stop, &Cancel::default(), &Silent).unwrap(), Reason::Samples);
}

fn reference(method: &str, crop: Option<[u32; 4]>) -> Film {
    let mut session = new_session(method, crop);
    render_some(&mut session, SPP);
    assert_eq!(session.film().counters().non_finite, 0);
    session.into_film()
}

fn with_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
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
fn threads_tiles_parts_and_interruptions_do_not_matter() {
    for method in METHODS {
        let whole = bytes(&reference(method, None));
        for threads in [1, 3] {
            let film = with_threads(threads, || {
                let mut session = new_session(method, None);
                session.set_tile_order(|tiles| {
                    let all =
                        tiles.iter().copied().reduce(|a, b| Rect::new(a.x0.min(b.x0), a.y0.min(b.y0), a.x1.max(b.x1), a.y1.max(b.y1)));
                    let all = all.unwrap();
                    *tiles = (all.y0..all.y1).rev().map(|y| Rect::new(all.x0, y, all.x1, y + 1)).collect();
                });
                render_some(&mut session, SPP);
                session.into_film()
            });
            assert!(bytes(&film) == whole, "{method}: {threads} threads");
        }
        let part = |first: u32, count: u32| {
            let mut session = new_session(method, None);
            session.set_first_sample(first);
            render_some(&mut session, count);
            session.into_film()
        };
        let mut last = part(4, 2);
        last.merge(&part(0, 3)).unwrap();
        last.merge(&part(3, 1)).unwrap();
        assert!(bytes(&last) == whole, "{method}: parts");
        for calls in [2, 9] {
            let mut session = new_session(method, None);
            let cancel = Cancel::default();
            let interrupt = Interrupt { calls_left: AtomicU32::new(calls), cancel: cancel.clone() };
            let stop = Stop { spp: Some(SPP), ..Stop::default() };
            assert_eq!(session.render(&stop, &cancel, &interrupt).unwrap(), Reason::Cancelled);
            let half = Film::from_bytes(&bytes(session.film()), 1 << 30).unwrap();
            let mut session = new_session(method, None);
            session.resume(&half).unwrap();
            render_some(&mut session, SPP);
            assert!(bytes(session.film()) == whole, "{method}: interrupted after {calls} reports");
        }
    }
}

/// A crop has fewer light paths and the same mean.
#[test]
fn crops_have_the_light_of_the_whole() {
    let crop = [8, 10, 32, 30];
    for method in ["light", "bdpt"] {
        let many = |crop| {
            let mut session = new_session(method, crop);
            render_some(&mut session, 128);
            session.into_film()
        };
        let mean = |film: &Film| {
            let image = film.develop();
            let pixels = film.rect().area() as usize;
            let data = image.channel("G").unwrap();
            let inside = |i: &usize| {
                let (x, y) = (film.rect().x0 + *i as u32 % image.width, film.rect().y0 + *i as u32 / image.width);
                (crop[0]..crop[2]).contains(&x) && (crop[1]..crop[3]).contains(&y)
            };
            let values: Vec<f64> = (0..pixels).filter(inside).map(|i| f64::from(data[i])).collect();
            values.iter().sum::<f64>() / values.len() as f64
        };
        let (whole, cut) = (mean(&many(None)), mean(&many(Some(crop))));
        assert!((cut / whole - 1.0).abs() < 0.12, "{method}: {cut} instead of {whole}");
    }
}

#[test]
fn light_groups_add_up_to_the_picture() {
    for method in METHODS {
        let image = reference(method, None).develop();
        let sum = |name: &str| image.channel(name).unwrap().iter().map(|&v| f64::from(v)).sum::<f64>();
        let (all, lamp, rest) = (sum("G"), sum("light.lamp.G"), sum("light.rest.G"));
        assert!(lamp > 0.1 * all && rest > 0.05 * all, "{method}: {lamp} {rest} of {all}");
        assert!(((lamp + rest) / all - 1.0).abs() < 1e-5, "{method}: {lamp} + {rest} is not {all}");
    }
}

#[test]
fn antialiasing_of_edges_alone_is_refused() {
    for method in METHODS {
        let (desc, s) = (some_of_everything(), RenderSettings { antialias: Some(0.3), spp: None, ..wanted(method) });
        let plan = Plan::new(&desc, &s, None).unwrap();
        match job::prepare(&desc, &s, &plan, &[]) {
            Err(JobError::Setting(message)) => assert!(message.contains(method) && message.contains("antialias"), "{message}"),
            _ => panic!("{method} takes antialiasing"),
        }
    }
}
