//! The commands, one file each: `Args` (clap) and `run`.

pub mod bake;
pub mod bench;
pub mod compare;
pub mod convert;
pub mod denoise;
pub mod form_factors;
pub mod info;
pub mod light;
pub mod merge;
pub mod photons;
pub mod pov;
pub mod python;
pub mod render;
pub mod study;

use std::io::Write;
use std::sync::OnceLock;

use etendue_render::classic::physical::{MeshOptions, meshes};
use etendue_render::session::Cancel;
use etendue_scene::{SceneDesc, Severity};

use crate::exit::{self, coded};

/// Prints a line for people to standard error.
pub fn note(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// The scene in triangles, if it is one of POV-Ray's exact solids; in a right-handed space.
pub fn triangles(desc: SceneDesc, segments: Option<u32>) -> anyhow::Result<SceneDesc> {
    if desc.classic.is_none() {
        return Ok(desc);
    }
    let plain = MeshOptions::default();
    let options = MeshOptions { segments: segments.unwrap_or(plain.segments), right_handed: true, ..plain };
    meshes(&desc, &options).map_err(|e| coded(exit::INVALID, e))
}

/// Prints warnings and losses of a scene to standard error; at most a screenful, `etendue info` has them all.
pub fn report_losses(desc: &SceneDesc) {
    const MOST: usize = 20;
    let report = &desc.report;
    for f in report.faults.iter().take(MOST) {
        let word = if f.severity == Severity::Error { "error" } else { "warning" };
        note(&format!("{}: {word}: {}", f.span.display(&desc.files), f.message));
    }
    for l in report.losses.iter().take(MOST) {
        note(&format!("{}: not honored: {}: {}", l.span.display(&desc.files), l.feature, l.effect));
    }
    let more = report.faults.len().saturating_sub(MOST) + report.losses.len().saturating_sub(MOST);
    if more > 0 {
        note(&format!("… and {more} more; see `etendue info {}`", desc.files.first().map_or(String::new(), |p| p.display().to_string())));
    }
}

/// What Ctrl-C cancels: the same for all that a process does, such as the pictures of an animation. A second Ctrl-C ends the process at once.
pub fn on_interrupt() -> Cancel {
    static CANCEL: OnceLock<Cancel> = OnceLock::new();
    CANCEL
        .get_or_init(|| {
            let cancel = Cancel::default();
            let handler = cancel.clone();
            // Setting a handler fails only where one exists, as in tests.
            let _ = ctrlc::set_handler(move || {
                if handler.is_cancelled() {
                    std::process::exit(i32::from(exit::INTERRUPTED));
                }
                handler.cancel();
            });
            cancel
        })
        .clone()
}
