//! Pixels that take more samples than others: as the path tracer's pilot plans, and by an error that is the goal.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use etendue_render::film::{Film, Rect};
use etendue_render::session::job::{self, JobError, Plan};
use etendue_render::session::{Cancel, Reason, Session, Silent, Stop};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::Vec3;
use support::statistics::{Blocks, assert_same};
use support::*;

const SIZE: [u32; 2] = [104, 72];

/// A sky without noise above a floor, part of which is in the penumbra of a lamp nearby, with all of the noise.
fn evening() -> SceneDesc {
    let mut desc = scene();
    let floor = diffuse(&mut desc, 0.6);
    rectangle(&mut desc, Vec3::ZERO, [40.0; 2], false, Some(floor));
    for i in 0..6 {
        sphere(&mut desc, Vec3::new(0.7 * i as f32 - 2.0, -1.5, 0.5), 0.3, Some(floor));
    }
    let lamp = rectangle(&mut desc, Vec3::new(0.0, 0.0, 2.0), [1.5; 2], true, Some(floor));
    emit(&mut desc, lamp, Color::Constant([3.0; 3]));
    constant_sky(&mut desc, 0.3);
    perspective(&mut desc, Vec3::new(0.0, -9.0, 2.5), Vec3::new(0.0, 0.0, 2.2), 55.0);
    desc
}

fn wanted(adaptive: Option<f32>, spp: u32) -> RenderSettings {
    RenderSettings { adaptive, max_depth: Some(3), guiding: Some("off".into()), ..settings(SIZE[0], SIZE[1], spp) }
}

fn counts(film: &Film) -> Vec<u32> {
    (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y))).map(|(x, y)| film.sample_count(x, y)).collect()
}

fn with_threads(threads: usize, mut session: Session, spp: u32) -> (Reason, Session) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let stop = Stop { spp: Some(spp), ..Stop::default() };
    let reason = pool.install(|| session.render(&stop, &Cancel::default(), &Silent)).unwrap();
    (reason, session)
}

#[test]
fn planned_samples_bring_the_same_light_with_less_noise() {
    let desc = evening();
    let (planned, even) = (wanted(None, 16), wanted(Some(0.0), 16));
    let film = render(&desc, &planned);
    let n = counts(&film);
    let (least, most) = (n.iter().min().unwrap(), n.iter().max().unwrap());
    assert!(*least == 8 && *most > 20, "{least} to {most} samples");
    assert!((film.mean_sample_count() / 16.0 - 1.0).abs() < 0.05 && film.declared_spp() == 16, "{}", film.mean_sample_count());
    let other = render(&desc, &even);
    assert!(counts(&other).iter().all(|n| *n == 16));
    assert!(film.relative_error() < 0.93 * other.relative_error(), "{} {}", film.relative_error(), other.relative_error());
    let blocks = |s: &RenderSettings| Blocks::new(&render_seeds(&desc, s, 3..9), 8);
    assert_same("planned samples", &blocks(&planned), &blocks(&even), 0.0, 0.05);
}

#[test]
fn planned_samples_do_not_depend_on_parts() {
    let desc = evening();
    assert_passes_merge(&desc, &wanted(None, 5));
    let whole = render(&desc, &wanted(None, 6));
    let mut merged = session(&desc, &wanted(None, 6)).into_film();
    let mut worker = session(&desc, &wanted(None, 6));
    for (rect, first, end) in [([0, 0, 50, 72], 0, 6), ([50, 0, 104, 72], 2, 6), ([50, 0, 104, 72], 0, 2)] {
        worker.set_part(Rect::new(rect[0], rect[1], rect[2], rect[3]), first).unwrap();
        (_, worker) = with_threads(2, worker, end - first);
        merged.merge(worker.film()).unwrap();
    }
    assert_eq!(whole.develop(), merged.develop());
    assert_eq!(counts(&whole), counts(&merged));
}

/// Every block has its error in the end, those with little noise after few samples, and the mean stays what it is.
#[test]
fn pixels_stop_at_an_error() {
    let desc = evening();
    let goal = 0.04;
    let (reason, session) = with_threads(2, session(&desc, &wanted(Some(goal), 4096)), 4096);
    let film = session.into_film();
    let n = counts(&film);
    assert_eq!((reason, *n.iter().min().unwrap()), (Reason::Noise, 16));
    assert!(n.iter().all(|n| n % 16 == 0) && *n.iter().max().unwrap() > 64);
    let variance = film.variance();
    let image = film.develop();
    let light = image.channel("G").unwrap();
    for (bx, by) in (0..SIZE[1] / 8).flat_map(|by| (0..SIZE[0] / 8).map(move |bx| (bx, by))) {
        let pixels = (0..64).map(|i| ((by * 8 + i / 8) * SIZE[0] + bx * 8 + i % 8) as usize);
        let error = pixels.map(|i| variance[i] / (f64::from(light[i]).powi(2) + 0.01)).sum::<f64>() / 64.0;
        assert!(error.sqrt() < f64::from(goal) * 1.001, "block {bx} {by}: {}", error.sqrt());
    }
    let means = |s: &RenderSettings| Blocks::new(&render_seeds(&desc, s, 3..9), 8);
    // What stops by what it has found has a bias, which is small.
    assert_same("an error as the goal", &means(&wanted(Some(goal), 4096)), &means(&wanted(Some(0.0), 64)), 0.01, 0.05);
}

#[test]
fn an_error_as_the_goal_depends_on_nothing_else() {
    let desc = evening();
    let s = wanted(Some(0.05), 96);
    let whole = with_threads(1, session(&desc, &s), 96).1.into_film();
    assert!(counts(&whole).contains(&96) && counts(&whole).contains(&16));
    // By other threads and in steps that end between decisions.
    let mut film = with_threads(2, session(&desc, &s), 5).1.into_film();
    for spp in [16, 40, 48, 96] {
        let mut next = session(&desc, &s);
        next.resume(&film).unwrap();
        film = with_threads(2, next, spp).1.into_film();
    }
    assert!(bytes(&whole) == bytes(&film), "a resumed film differs");
    // In parts on the grid of blocks.
    let mut merged = session(&desc, &s).into_film();
    let mut worker = session(&desc, &s);
    for rect in [Rect::new(0, 0, 64, 72), Rect::new(64, 0, 104, 40), Rect::new(64, 40, 104, 72)] {
        worker.set_part(rect, 0).unwrap();
        (_, worker) = with_threads(2, worker, 96);
        merged.merge(worker.film()).unwrap();
    }
    assert_eq!(whole.develop(), merged.develop());
    assert_eq!(counts(&whole), counts(&merged));
    assert!(worker.set_part(Rect::new(3, 0, 40, 72), 0).is_err(), "parts that cut blocks");
    let mut later = session(&desc, &s);
    later.set_first_sample(16);
    let error = later.render(&Stop { spp: Some(16), ..Stop::default() }, &Cancel::default(), &Silent).unwrap_err();
    assert!(error.to_string().contains("16"), "{error}");
}

#[test]
fn goals_that_cannot_be_are_refused() {
    let desc = evening();
    let refuse = |s: RenderSettings, words: &str| {
        let made = Plan::new(&desc, &s, None).and_then(|plan| job::prepare(&desc, &s, &plan, &[]));
        match made {
            Err(JobError::Setting(message)) => assert!(message.contains(words), "{message}"),
            _ => panic!("{words}: accepted"),
        }
    };
    for bad in [-0.1, f32::NAN, f32::INFINITY, 10.0] {
        refuse(wanted(Some(bad), 4), "relative error");
    }
    refuse(RenderSettings { antialias: Some(0.3), spp: None, ..wanted(Some(0.1), 4) }, "antialias");
    for method in ["bdpt", "vcm", "mlt", "light", "raster"] {
        refuse(RenderSettings { integrator: Some(method.into()), ..wanted(Some(0.1), 4) }, "adaptive");
    }
    // The most samples, where nobody says; what the file says is meant for pixels that all take as many.
    let mut desc = desc;
    desc.film.spp = Some(16);
    let plan = |spp| Plan::new(&desc, &RenderSettings { spp, ..wanted(Some(0.1), 1) }, None).unwrap();
    assert_eq!((plan(None).spp, plan(Some(7)).spp), (job::ADAPTIVE_SPP, 7));
}
