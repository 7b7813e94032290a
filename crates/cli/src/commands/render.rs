//! `etendue render`: a picture of a scene.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::Context;
use etendue_render::denoise::{DenoiseError, DenoiseOptions, Denoiser};
use etendue_render::film::{DevelopOptions, Film};
use etendue_render::image::tonemap::{ToneMap, ToneOperator};
use etendue_render::image::{FileFormat, Image, WriteOptions};
use etendue_render::session::job::{self, JobError, Plan};
use etendue_render::session::{Aov, Observer, Reason, Session, Status, Stop};
use etendue_scene::SceneDesc;

use super::{note, on_interrupt, report_losses};
use crate::exit::{self, coded};
use crate::progress::{self, Progress};
use crate::scene_args::SceneArgs;
use crate::settings::SettingsArgs;

/// What to render, how, and where to.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub(super) scene: SceneArgs,
    #[command(flatten)]
    settings: SettingsArgs,
    /// Only these pixels: x0,y0,x1,y1 from the upper left, the last excluded.
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = parse_crop, help_heading = "Picture and light")]
    crop: Option<[u32; 4]>,
    /// Auxiliary outputs, for EXR and film files: albedo, normal, depth, position, uv, object, material, variance, samples; or all.
    #[arg(long, value_name = "NAMES", value_delimiter = ',', help_heading = "Output")]
    aov: Vec<String>,
    /// Output file: .exr, .png, .jpg, .hdr, .pfm or .film; may be given several times [default: the scene's name with .png].
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Vec<PathBuf>,
    /// Exposure of PNG and JPEG files in stops.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true, help_heading = "Output")]
    exposure: f32,
    /// Tone mapping of PNG and JPEG files: standard (clip), filmic, aces, agx.
    #[arg(long, value_name = "NAME", default_value = "standard", help_heading = "Output")]
    tonemap: String,
    /// Removes noise with Intel Open Image Denoise, where it is installed.
    #[arg(long, help_heading = "Output")]
    denoise: bool,
    /// Stop after this time, such as 30, 90s, 5m or 2h.
    #[arg(long, value_name = "DURATION", value_parser = parse_duration, help_heading = "Stopping")]
    time: Option<Duration>,
    /// Stop when the relative error, estimated from the variance, is at most this; such as 0.02.
    #[arg(long, value_name = "ERROR", help_heading = "Stopping")]
    noise: Option<f64>,
    /// Threads; 0 takes one for each core.
    #[arg(short = 'j', long, value_name = "N", default_value_t = 0, help_heading = "Running")]
    threads: usize,
    /// Index of the first sample: parts of a picture with other indices and the same seed merge exactly (`etendue merge`).
    #[arg(long, value_name = "INDEX", default_value_t = 0, help_heading = "Running")]
    first_sample: u32,
    /// Keep a film file with all samples so far, for --resume.
    #[arg(long, value_name = "FILE.film", help_heading = "Running")]
    checkpoint: Option<PathBuf>,
    /// Seconds between checkpoints.
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0, help_heading = "Running")]
    checkpoint_interval: f64,
    /// Go on from the checkpoint (or from this film file).
    #[arg(long, value_name = "FILE.film", num_args = 0..=1, help_heading = "Running")]
    resume: Option<Option<PathBuf>>,
    /// How to show the progress.
    #[arg(long, value_enum, default_value_t, help_heading = "Running")]
    progress: progress::Mode,
    /// Say nothing but errors.
    #[arg(short, long, help_heading = "Running")]
    quiet: bool,
}

/// Renders; returns [`exit::INTERRUPTED`] after Ctrl-C.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    let outputs = outputs(&args)?;
    let tone_map = tone_map(&args)?;
    let (aovs, develop) = aovs(&args.aov, args.denoise)?;
    // A library that is missing is better known before the work.
    let denoiser = if args.denoise { Some(Denoiser::load().map_err(|e| coded(exit::FAILURE, e))?) } else { None };
    let denoise = denoiser.as_ref().map(|d| (d, DenoiseOptions { threads: args.threads, ..DenoiseOptions::default() }));
    let settings = &args.settings.0;
    // Classic scenes follow up to 256 rays into each other.
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.threads)
        .stack_size(32 << 20)
        .build()
        .context("the threads could not be started")?;
    let start = Instant::now();
    let desc = pool.install(|| args.scene.read([settings.width, settings.height]))?;
    if !args.quiet {
        report_losses(&desc);
    }
    let mut plan = Plan::new(&desc, settings, args.crop).map_err(|e| job_error(e, &desc))?;
    let mut stop = Stop { spp: Some(plan.spp), time: args.time, noise: args.noise };
    if settings.spp.is_none() && (args.time.is_some() || args.noise.is_some()) {
        // Without a number of samples, time and noise alone decide.
        stop.spp = None;
        plan.spp = job::DEFAULT_SPP;
        plan.be_even();
    }
    let mut session = pool.install(|| job::prepare(&desc, settings, &plan, &aovs)).map_err(|e| job_error(e, &desc))?;
    let loaded = start.elapsed();
    session.set_first_sample(args.first_sample);
    let keeps_film = args.checkpoint.is_some() || args.resume.is_some() || outputs.iter().any(|(_, f)| f.is_none());
    if keeps_film {
        session.set_scene_hash(desc.content_hash());
    }
    if !(keeps_film || develop.variance || args.noise.is_some()) && plan.antialias.is_some() {
        session.forgo_error_estimate();
    }
    if !args.quiet {
        session.warnings().iter().for_each(|w| note(&format!("warning: {w}")));
    }
    resume(&args, &mut session)?;
    let cancel = on_interrupt();
    let mode = if args.quiet && args.progress == progress::Mode::Auto { progress::Mode::None } else { args.progress };
    let watcher = Watcher::new(Progress::new(mode), args.checkpoint.as_deref(), args.checkpoint_interval);
    let rendering = Instant::now();
    let reason = pool.install(|| session.render(&stop, &cancel, &watcher));
    watcher.progress.finish();
    let reason = reason?;
    watcher.result()?;
    if !args.quiet {
        session.notes().iter().for_each(|n| note(n));
    }
    let elapsed = rendering.elapsed();
    let film = session.film();
    if let Some(path) = &args.checkpoint {
        film.save(path).with_context(|| format!("{}", path.display()))?;
    }
    let has_pictures = outputs.iter().any(|(_, format)| format.is_some());
    let picture = has_pictures.then(|| self::develop(film, develop, denoise.as_ref()));
    let options = WriteOptions { tone: tone_map, ..WriteOptions::default() };
    for (path, format) in &outputs {
        let context = || format!("{}", path.display());
        match &picture {
            Some((image, _)) if format.is_some() => image.save(path, &options).with_context(context)?,
            _ => film.save(path).with_context(context)?,
        }
        if !args.quiet {
            let (declared, mean) = (film.declared_spp(), film.mean_sample_count());
            let differs = (mean - f64::from(declared)).abs() > 0.02 * f64::from(declared);
            let spp = if differs { format!("{declared} spp ({mean:.1} in the mean)") } else { format!("{declared} spp") };
            let (size, time) = (film.rect(), progress::human(elapsed));
            note(&format!(
                "{}: {}×{}, {spp}, {} in {time} (loading took {})",
                path.display(),
                size.width(),
                size.height(),
                plan.integrator,
                progress::human(loaded)
            ));
        }
    }
    if let Some((_, Some(failure))) = picture {
        return Err(coded(exit::FAILURE, format!("{failure}; the picture has been written with its noise")));
    }
    let counters = film.counters();
    if counters.non_finite > 0 && !args.quiet {
        note(&format!("warning: {} samples were not finite and count as black", counters.non_finite));
    }
    Ok(ExitCode::from(if reason == Reason::Cancelled { exit::INTERRUPTED } else { exit::OK }))
}

/// Places of faults in front of their messages.
pub(super) fn job_error(e: JobError, desc: &SceneDesc) -> anyhow::Error {
    match e {
        JobError::Setting(m) => coded(exit::USAGE, m),
        JobError::Scene(faults) => {
            let lines: Vec<String> = faults.iter().map(|f| format!("{}: error: {}", f.span.display(&desc.files), f.message)).collect();
            coded(exit::INVALID, lines.join("\n"))
        }
        JobError::Film(e) => coded(exit::USAGE, e),
    }
}

/// The output files with their formats (`None`: film), checked before any work is done.
fn outputs(args: &Args) -> anyhow::Result<Vec<(PathBuf, Option<FileFormat>)>> {
    let default = || Path::new(args.scene.scene.file_stem().unwrap_or("picture".as_ref())).with_extension("png");
    let paths = if args.output.is_empty() { vec![default()] } else { args.output.clone() };
    paths
        .into_iter()
        .map(|path| {
            let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
            if !folder.is_dir() {
                return Err(coded(exit::IO, format!("{}: there is no folder {}", path.display(), folder.display())));
            }
            let is_film = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("film"));
            let format = if is_film {
                None
            } else {
                Some(FileFormat::from_path(&path).map_err(|e| coded(exit::USAGE, format!("{}: {e}", path.display())))?)
            };
            Ok((path, format))
        })
        .collect()
}

fn tone_map(args: &Args) -> anyhow::Result<ToneMap> {
    let operator = args.tonemap.as_str();
    let found = ToneOperator::from_name(operator);
    let operator =
        found.ok_or_else(|| coded(exit::USAGE, format!("no tone mapping `{operator}`; there are standard, filmic, aces, agx")))?;
    Ok(ToneMap { operator, exposure: args.exposure })
}

fn aovs(names: &[String], denoise: bool) -> anyhow::Result<(Vec<Aov>, DevelopOptions)> {
    let (mut aovs, develop) = Aov::parse_list(names).map_err(|e| coded(exit::USAGE, e))?;
    if denoise {
        aovs.extend([Aov::Albedo, Aov::Normal]);
        aovs.sort_by_key(|a| *a as u8);
        aovs.dedup();
    }
    Ok((aovs, develop))
}

fn resume(args: &Args, session: &mut Session) -> anyhow::Result<()> {
    let Some(path) = &args.resume else { return Ok(()) };
    let path =
        path.as_ref().or(args.checkpoint.as_ref()).ok_or_else(|| coded(exit::USAGE, "--resume needs a film file, or --checkpoint"))?;
    // The first run of a command that is restarted until it is done has nothing to go on from.
    if !path.exists() && args.checkpoint.as_ref() == Some(path) {
        return Ok(());
    }
    let film = Film::load(path).with_context(|| format!("{}", path.display()))?;
    session.resume(&film).map_err(|e| coded(exit::INVALID, format!("{}: {e}", path.display())))
}

/// The film's picture, without noise where asked for. A failure of the denoiser must not cost the rendering: the noisy
/// picture comes back with it.
fn develop(film: &Film, develop: DevelopOptions, denoise: Option<&(&Denoiser, DenoiseOptions)>) -> (Image, Option<DenoiseError>) {
    let mut image = film.develop_with(develop);
    let failure = denoise.and_then(|(denoiser, options)| denoiser.denoise(&mut image, options).err());
    (image, failure)
}

/// Shows progress and keeps checkpoints.
struct Watcher<'a> {
    progress: Progress,
    checkpoint: Option<&'a Path>,
    interval: Duration,
    state: std::sync::Mutex<(Instant, Option<anyhow::Error>)>,
}

impl<'a> Watcher<'a> {
    fn new(progress: Progress, checkpoint: Option<&'a Path>, interval_secs: f64) -> Self {
        let interval = Duration::try_from_secs_f64(interval_secs.max(0.0)).unwrap_or(Duration::MAX);
        Self { progress, checkpoint, interval, state: std::sync::Mutex::new((Instant::now(), None)) }
    }

    /// The first error that a checkpoint met.
    fn result(&self) -> anyhow::Result<()> {
        match self.state.lock().ok().and_then(|mut s| s.1.take()) {
            Some(e) => Err(e),
            None => Ok(()),
        }
    }
}

impl Observer for Watcher<'_> {
    fn stage(&self, what: &str, fraction: f64) {
        self.progress.stage(what, fraction);
    }

    fn status(&self, status: &Status) {
        self.progress.update(status);
    }

    fn pass(&self, film: &Film, _status: &Status) {
        let (Some(path), Ok(mut state)) = (self.checkpoint, self.state.lock()) else { return };
        if state.0.elapsed() >= self.interval {
            if let Err(e) = film.save(path) {
                state.1.get_or_insert(anyhow::Error::new(e).context(format!("{}", path.display())));
            }
            state.0 = Instant::now();
        }
    }
}

fn parse_crop(text: &str) -> Result<[u32; 4], String> {
    let numbers: Result<Vec<u32>, _> = text.split(',').map(|t| t.trim().parse()).collect();
    numbers.ok().and_then(|v| v.try_into().ok()).ok_or_else(|| "expected four whole numbers x0,y0,x1,y1".to_owned())
}

pub(super) fn parse_duration(text: &str) -> Result<Duration, String> {
    let (number, factor) = match text.trim().char_indices().last() {
        Some((i, 's')) => (&text[..i], 1.0),
        Some((i, 'm')) => (&text[..i], 60.0),
        Some((i, 'h')) => (&text[..i], 3600.0),
        _ => (text, 1.0),
    };
    let secs: f64 = number.trim().parse().map_err(|_| "expected a time such as 30, 90s, 5m or 2h".to_owned())?;
    Duration::try_from_secs_f64(secs * factor).map_err(|e| e.to_string())
}
