//! `etendue bake`: a scene with its light in textures or vertices (docs/guide/baking.md).

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use anyhow::Context;
use etendue_render::denoise::Denoiser;
use etendue_render::integrator::Stage;
use etendue_render::lightmap::deliver::Order;
use etendue_render::lightmap::output::Display;
use etendue_render::lightmap::{self, Bake, BakeError, BakeOptions, Content, Sides, Solution, Target, Watcher};
use etendue_render::session::{Observer, Status, Stop};

use super::render::parse_duration;
use super::{note, on_interrupt, report_losses};
use crate::exit::{self, coded};
use crate::progress::{self, Progress};
use crate::scene_args::SceneArgs;
use crate::settings::SettingsArgs;

/// How the light is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum DisplayArg {
    /// As emission: every viewer shows it, however bright.
    #[default]
    Emissive,
    /// As unlit color: every viewer shows it, cut at 1.
    Unlit,
    /// Original materials with irradiance as a lightmap (MOZ_lightmap).
    Lightmap,
}

/// Which sides of two-sided surfaces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum SidesArg {
    /// Both, unless the back is the inside of a closed body.
    #[default]
    Auto,
    /// The side of the normals.
    Front,
    /// Both.
    Both,
}

/// What to bake, how, and where to.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    settings: SettingsArgs,
    /// The baked scene: a .glb file.
    #[arg(short, long, value_name = "FILE.glb", help_heading = "Output")]
    output: PathBuf,
    /// How the light is shown.
    #[arg(long, value_enum, default_value_t, help_heading = "Output")]
    display: DisplayArg,
    /// Light in the colors of the vertices instead of textures.
    #[arg(long, help_heading = "Baking")]
    per_vertex: bool,
    /// Also write irradiance, albedo and normals of each atlas as OUTPUT.N.exr.
    #[arg(long, help_heading = "Output")]
    exr: bool,
    /// With --exr also the direction from which most light comes.
    #[arg(long, requires = "exr", help_heading = "Output")]
    directional: bool,
    /// Also measure light in the air, on a grid of so many points over the scene: spherical harmonics in OUTPUT.probes.json.
    #[arg(long, value_name = "NX,NY,NZ", value_parser = parse_grid, help_heading = "Output")]
    probes: Option<[u32; 3]>,
    /// How light is found: path, radiosity, particles.
    #[arg(long, value_name = "NAME", default_value = "path", help_heading = "Baking")]
    method: String,
    /// Looks up radiosity and particles not at the texel but where rays from it arrive: slower, and without their blur.
    #[arg(long, help_heading = "Baking")]
    final_gather: bool,
    /// Texels for a unit of length [default: as many as fit into one atlas].
    #[arg(long, value_name = "NUMBER", help_heading = "Baking")]
    texels_per_meter: Option<f64>,
    /// Largest edge of an atlas in texels.
    #[arg(long, value_name = "TEXELS", default_value_t = 1024, help_heading = "Baking")]
    resolution: u32,
    /// Gutter around each chart in texels.
    #[arg(long, value_name = "TEXELS", default_value_t = 2, help_heading = "Baking")]
    padding: u32,
    /// New texture coordinates even where the file's second set is usable.
    #[arg(long, help_heading = "Baking")]
    unwrap: bool,
    /// Which sides of two-sided surfaces get light.
    #[arg(long, value_enum, default_value_t, help_heading = "Baking")]
    sides: SidesArg,
    /// Removes noise with Intel Open Image Denoise, where it is installed.
    #[arg(long, help_heading = "Baking")]
    denoise: bool,
    /// Stop after this time, such as 30, 90s, 5m or 2h.
    #[arg(long, value_name = "DURATION", value_parser = parse_duration, help_heading = "Stopping")]
    time: Option<Duration>,
    /// Stop when the mean standard error, relative to the irradiance, is at most this; such as 0.02.
    #[arg(long, value_name = "ERROR", help_heading = "Stopping")]
    noise: Option<f64>,
    /// Threads; 0 takes one for each core.
    #[arg(short = 'j', long, value_name = "N", default_value_t = 0, help_heading = "Running")]
    threads: usize,
    /// Keep a file with all samples so far, for --resume.
    #[arg(long, value_name = "FILE", help_heading = "Running")]
    checkpoint: Option<PathBuf>,
    /// Seconds between checkpoints.
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0, help_heading = "Running")]
    checkpoint_interval: f64,
    /// Go on from the checkpoint (or from this file).
    #[arg(long, value_name = "FILE", num_args = 0..=1, help_heading = "Running")]
    resume: Option<Option<PathBuf>>,
    /// How to show the progress.
    #[arg(long, value_enum, default_value_t, help_heading = "Running")]
    progress: progress::Mode,
    /// Say nothing but errors.
    #[arg(short, long, help_heading = "Running")]
    quiet: bool,
}

/// Bakes; returns [`exit::INTERRUPTED`] after Ctrl-C, with what was done in the checkpoint.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    if !args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb")) {
        return Err(coded(exit::USAGE, format!("{}: a baked scene is written as .glb", args.output.display())));
    }
    if args.noise.is_some_and(|n| !(n > 0.0)) {
        return Err(coded(exit::USAGE, "--noise takes a positive number"));
    }
    let denoiser = if args.denoise { Some(Denoiser::load().map_err(|e| coded(exit::FAILURE, e))?) } else { None };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.threads).build().context("the threads could not be started")?;
    pool.install(|| bake(&args, denoiser.as_ref()))
}

fn bake(args: &Args, denoiser: Option<&Denoiser>) -> anyhow::Result<ExitCode> {
    let settings = &args.settings.0;
    let say = |line: &str| {
        if !args.quiet {
            note(line);
        }
    };
    let start = Instant::now();
    let desc = args.scene.read([None, None])?;
    if !args.quiet {
        report_losses(&desc);
    }
    let options = BakeOptions {
        texels_per_meter: args.texels_per_meter,
        resolution: args.resolution,
        padding: args.padding,
        unwrap: args.unwrap,
        sides: match args.sides {
            SidesArg::Auto => Sides::Auto,
            SidesArg::Front => Sides::Front,
            SidesArg::Both => Sides::Both,
        },
        target: if args.per_vertex { Target::Vertices } else { Target::Texels },
    };
    if !lightmap::METHODS.contains(&args.method.as_str()) {
        return Err(coded(exit::USAGE, format!("no method `{}`; there are {}", args.method, lightmap::METHODS.join(", "))));
    }
    let name = if args.final_gather { format!("{} gathered", args.method) } else { args.method.clone() };
    let bake = Bake::new(&desc, settings, &options, &name).map_err(|e| failed(e, &desc))?;
    bake.flat.notes.iter().for_each(|n| say(&format!("note: {n}")));
    describe(&bake, say);
    let cancel = on_interrupt();
    let mode = if args.quiet && args.progress == progress::Mode::Auto { progress::Mode::None } else { args.progress };
    let watcher = Watch::new(&bake, Progress::new(mode), args);
    let is_cancelled = || cancel.is_cancelled();
    let progress = |what: &str, fraction: f64| watcher.progress.stage(what, fraction);
    let stage = Stage::without_camera(settings.seed, &is_cancelled, &progress);
    let mut notes = Vec::new();
    let method = bake.method(&args.method, args.final_gather, &stage, &mut notes).map_err(|e| failed(e, &desc))?;
    notes.iter().for_each(|n| say(n));
    let mut solution = resume(args, &bake)?.unwrap_or_else(|| Solution::new(bake.point_count()));
    // Without a number of samples, time and noise alone decide.
    let spp = settings.spp.or((args.time.is_none() && args.noise.is_none()).then(|| method.default_spp()));
    let complete = bake.solve(&method, Stop { spp, time: args.time, noise: args.noise }, &mut solution, &cancel, &watcher);
    watcher.progress.finish();
    watcher.result()?;
    if let Some(path) = &args.checkpoint {
        bake.save(path, &solution).with_context(|| path.display().to_string())?;
    }
    if !complete && args.checkpoint.is_some() {
        say("interrupted; go on with --resume");
        return Ok(ExitCode::from(exit::INTERRUPTED));
    }
    if !complete && solution.spp == 0 {
        say("interrupted before the first sample: nothing is written");
        return Ok(ExitCode::from(exit::INTERRUPTED));
    }
    let order = Order {
        display: match args.display {
            DisplayArg::Emissive => Display::Emissive,
            DisplayArg::Unlit => Display::Unlit,
            DisplayArg::Lightmap => Display::Lightmap,
        },
        probes: args.probes,
        maps: args.exr,
        directional: args.directional,
    };
    let samples = spp.unwrap_or(method.default_spp());
    let delivery = bake.deliver(&args.method, &method, &solution, samples, &order, denoiser).map_err(|e| failed(e, &desc))?;
    delivery.notes.iter().for_each(|n| say(&format!("{}: {n}", args.output.display())));
    delivery.write(&args.output).map_err(|e| failed(e, &desc))?;
    say(&format!(
        "{}: {:.1} MB, {} samples a point, error {:.2} %, {}",
        args.output.display(),
        delivery.bytes() as f64 / 1e6,
        solution.spp,
        100.0 * solution.relative_error(),
        progress::human(start.elapsed())
    ));
    Ok(ExitCode::from(if complete { exit::OK } else { exit::INTERRUPTED }))
}

/// What was cut into what.
fn describe(bake: &Bake, say: impl Fn(&str)) {
    match &bake.content {
        Content::Texels(layout, _) => {
            let sizes: Vec<String> = layout.packing.atlases.iter().map(|[w, h]| format!("{w}×{h}")).collect();
            say(&format!(
                "{} charts, {} texels, {:.4} texels per unit, {} {}: {}",
                layout.charts.len(),
                layout.texels.len(),
                layout.packing.density,
                sizes.len(),
                if sizes.len() == 1 { "atlas" } else { "atlases" },
                sizes.join(", ")
            ));
            if layout.kept > 0 {
                say(&format!("{} meshes keep their second set of texture coordinates", layout.kept));
            }
            if layout.packing.reduced > 0 {
                say(&format!("{} charts are coarser than the others, to fit", layout.packing.reduced));
            }
        }
        Content::Vertices(layout) => say(&format!("{} vertices", layout.len())),
    }
}

fn resume(args: &Args, bake: &Bake) -> anyhow::Result<Option<Solution>> {
    let Some(path) = &args.resume else { return Ok(None) };
    let path = path.as_ref().or(args.checkpoint.as_ref()).ok_or_else(|| coded(exit::USAGE, "--resume needs a file, or --checkpoint"))?;
    if !path.exists() && args.checkpoint.as_ref() == Some(path) {
        return Ok(None);
    }
    bake.load(path).map(Some).map_err(|e| coded(if matches!(e, BakeError::Io { .. }) { exit::IO } else { exit::INVALID }, e))
}

fn failed(e: BakeError, desc: &etendue_scene::SceneDesc) -> anyhow::Error {
    match e {
        BakeError::Setting(m) => coded(exit::USAGE, m),
        BakeError::Faults(faults) => {
            let lines: Vec<String> = faults.iter().map(|f| format!("{}: error: {}", f.span.display(&desc.files), f.message)).collect();
            coded(exit::INVALID, lines.join("\n"))
        }
        BakeError::Scene(m) => coded(exit::INVALID, m),
        BakeError::Io { .. } => coded(exit::IO, e),
        e => coded(exit::FAILURE, e),
    }
}

fn parse_grid(text: &str) -> Result<[u32; 3], String> {
    let numbers: Result<Vec<u32>, _> = text.split([',', 'x']).map(|t| t.trim().parse()).collect();
    numbers.ok().and_then(|v| v.try_into().ok()).ok_or_else(|| "expected three whole numbers nx,ny,nz".to_owned())
}

/// Shows progress and keeps checkpoints.
struct Watch<'a> {
    bake: &'a Bake,
    progress: Progress,
    checkpoint: Option<&'a Path>,
    interval: Duration,
    state: Mutex<(Instant, Option<anyhow::Error>)>,
}

impl<'a> Watch<'a> {
    fn new(bake: &'a Bake, progress: Progress, args: &'a Args) -> Self {
        let interval = Duration::try_from_secs_f64(args.checkpoint_interval.max(0.0)).unwrap_or(Duration::MAX);
        Self { bake, progress, checkpoint: args.checkpoint.as_deref(), interval, state: Mutex::new((Instant::now(), None)) }
    }

    fn result(&self) -> anyhow::Result<()> {
        self.state.lock().ok().and_then(|mut s| s.1.take()).map_or(Ok(()), Err)
    }
}

impl Observer for Watch<'_> {
    fn stage(&self, what: &str, fraction: f64) {
        self.progress.stage(what, fraction);
    }

    fn status(&self, status: &Status) {
        self.progress.update(status);
    }
}

impl Watcher for Watch<'_> {
    fn solution(&self, solution: &Solution) {
        let (Some(path), Ok(mut state)) = (self.checkpoint, self.state.lock()) else { return };
        if state.0.elapsed() >= self.interval {
            if let Err(e) = self.bake.save(path, solution) {
                state.1.get_or_insert(anyhow::Error::new(e).context(path.display().to_string()));
            }
            state.0 = Instant::now();
        }
    }
}
