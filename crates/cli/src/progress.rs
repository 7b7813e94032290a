//! How a rendering shows how far it is.

use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use etendue_render::session::Status;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// What `--progress` takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Mode {
    /// A bar on a terminal, nothing elsewhere.
    #[default]
    Auto,
    /// A bar.
    Bar,
    /// A line of JSON on standard error at most every tenth of a second.
    Json,
    /// Nothing.
    None,
}

/// A progress display on standard error.
pub enum Progress {
    /// A bar with the time left.
    Bar(ProgressBar),
    /// Lines of JSON; holds when the last one was written.
    Json(Mutex<Option<Instant>>),
    /// Nothing.
    None,
}

/// The bar counts in thousandths of the work.
const STEPS: u64 = 1000;

impl Progress {
    /// The display that a mode asks for.
    pub fn new(mode: Mode) -> Self {
        match mode {
            Mode::Auto if !std::io::stderr().is_terminal() => Self::None,
            Mode::Auto | Mode::Bar => {
                let bar = ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::stderr_with_hz(10));
                let style = ProgressStyle::with_template("{bar:40} {percent:>3} % {msg}");
                bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("━╸─"));
                Self::Bar(bar)
            }
            Mode::Json => Self::Json(Mutex::new(None)),
            Mode::None => Self::None,
        }
    }

    /// Shows a status.
    pub fn update(&self, status: &Status) {
        match self {
            Self::Bar(bar) => {
                bar.set_position((status.fraction * STEPS as f64) as u64);
                let left = match time_left(status) {
                    Some(left) => format!("{} left", human(left)),
                    None => human(status.elapsed),
                };
                let error = status.relative_error.map_or(String::new(), |e| format!(", error {:.2} %", e * 100.0));
                let target = status.spp_target.map_or(String::new(), |n| format!("/{n}"));
                bar.set_message(format!("{}{target} spp{error}, {left}", status.spp_done));
            }
            Self::Json(last) => {
                let Ok(mut last) = last.lock() else { return };
                let now = Instant::now();
                if status.fraction < 1.0 && last.is_some_and(|t| now - t < Duration::from_millis(100)) {
                    return;
                }
                *last = Some(now);
                let line = serde_json::json!({
                    "event": "progress",
                    "fraction": status.fraction,
                    "spp": status.spp_done,
                    "spp_target": status.spp_target,
                    "elapsed_s": status.elapsed.as_secs_f64(),
                    "left_s": time_left(status).map(|d| d.as_secs_f64()),
                    "relative_error": status.relative_error.filter(|e| e.is_finite()),
                });
                let _ = writeln!(std::io::stderr(), "{line}");
            }
            Self::None => {}
        }
    }

    /// Shows what is done before the first sample.
    pub fn stage(&self, what: &str, fraction: f64) {
        match self {
            Self::Bar(bar) => {
                bar.set_position((fraction * STEPS as f64) as u64);
                bar.set_message(what.to_owned());
            }
            Self::Json(last) => {
                let Ok(mut last) = last.lock() else { return };
                let now = Instant::now();
                if fraction < 1.0 && last.is_some_and(|t| now - t < Duration::from_millis(100)) {
                    return;
                }
                *last = Some(now);
                let line = serde_json::json!({ "event": "stage", "what": what, "fraction": fraction });
                let _ = writeln!(std::io::stderr(), "{line}");
            }
            Self::None => {}
        }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}

fn time_left(status: &Status) -> Option<Duration> {
    let f = status.fraction;
    (f > 0.005).then(|| Duration::from_secs_f64(status.elapsed.as_secs_f64() * (1.0 - f) / f))
}

/// A duration as people say it: `0.41 s`, `12.3 s`, `4 min 05 s`, `2 h 10 min`.
pub fn human(d: Duration) -> String {
    let s = d.as_secs_f64();
    let whole = d.as_secs();
    match s {
        _ if s < 1.0 => format!("{s:.2} s"),
        _ if s < 60.0 => format!("{s:.1} s"),
        _ if s < 3600.0 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole / 60 % 60),
    }
}
