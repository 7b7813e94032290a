//! `etendue photons`: photon maps on disk, made once and used for many views (docs/guide/particles.md).

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::Context;
use clap::Subcommand;
use etendue_render::integrator::{DEFAULT_PHOTONS, describe_photons, photon_limits};
use etendue_render::photon::{Contents, MapInfo, PhotonMap};
use etendue_render::session::job::{self, JobError};
use etendue_scene::RenderSettings;

use super::{note, on_interrupt, report_losses};
use crate::exit::{self, coded};
use crate::progress::{self, Progress};
use crate::scene_args::SceneArgs;

/// What to do with photon maps.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// Trace the photons of a scene into a map for `render --photon-map`.
    Trace(Box<Trace>),
    /// Add up maps of different photons of one scene, exactly.
    Merge(Merge),
    /// Print what a map holds.
    Info(Info),
}

/// Which photons to trace.
#[derive(clap::Args)]
struct Trace {
    #[command(flatten)]
    scene: SceneArgs,
    /// The map; appears whole or not at all.
    #[arg(short, long, value_name = "FILE.photons")]
    output: PathBuf,
    /// Number of photons.
    #[arg(long, value_name = "N", default_value_t = u64::from(DEFAULT_PHOTONS))]
    photons: u64,
    /// Index of the first photon: maps of other photons of the same seed merge exactly (`etendue photons merge`).
    #[arg(long, value_name = "INDEX", default_value_t = 0)]
    first_photon: u64,
    /// Selects the random numbers.
    #[arg(long, value_name = "INTEGER", default_value_t = 0)]
    seed: u64,
    /// Longest path in edges, that of the view included.
    #[arg(long, value_name = "EDGES")]
    max_depth: Option<u32>,
    /// Most memory for photons; where they are more, they are thinned, with a message.
    #[arg(long, value_name = "MIB", default_value_t = RenderSettings::default().photon_memory)]
    photon_memory: u32,
    /// Go on with the map where it is there already.
    #[arg(long)]
    resume: bool,
    /// Seconds between safety copies of the map.
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0)]
    checkpoint_interval: f64,
    /// Threads; 0 takes one for each core.
    #[arg(short = 'j', long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// How to show the progress.
    #[arg(long, value_enum, default_value_t)]
    progress: progress::Mode,
    /// Say nothing but errors.
    #[arg(short, long)]
    quiet: bool,
}

#[derive(clap::Args)]
struct Merge {
    /// Maps of the same scene and seed, with different photons.
    #[arg(required = true, value_name = "FILE.photons")]
    maps: Vec<PathBuf>,
    /// The result.
    #[arg(short, long, value_name = "FILE.photons")]
    output: PathBuf,
    /// Most memory for merging, half of it for the result; where records are more, they are thinned, with a message.
    #[arg(long, value_name = "MIB", default_value_t = 2 * RenderSettings::default().photon_memory)]
    photon_memory: u32,
}

#[derive(clap::Args)]
struct Info {
    /// The map.
    #[arg(value_name = "FILE.photons")]
    map: PathBuf,
}

/// Runs an action; tracing returns [`exit::INTERRUPTED`] after Ctrl-C, with what is done in the file.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    match args.action {
        Action::Trace(args) => trace(&args),
        Action::Merge(args) => merge(&args),
        Action::Info(args) => info(&args),
    }
}

fn load(path: &Path, budget: u64) -> anyhow::Result<PhotonMap> {
    PhotonMap::load(path, budget).with_context(|| path.display().to_string())
}

fn save(map: &PhotonMap, path: &Path) -> anyhow::Result<()> {
    map.save(path).with_context(|| path.display().to_string())
}

fn trace(args: &Trace) -> anyhow::Result<ExitCode> {
    let end = args.first_photon.checked_add(args.photons).filter(|_| args.photons > 0);
    let end = end.ok_or_else(|| coded(exit::USAGE, "the number of photons must be at least 1 and their indices below 2^64"))?;
    let folder = args.output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(coded(exit::IO, format!("{}: there is no folder {}", args.output.display(), folder.display())));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.threads).build().context("the threads could not be started")?;
    let desc = pool.install(|| args.scene.read([None, None]))?;
    if !args.quiet {
        report_losses(&desc);
    }
    let scene = pool.install(|| job::compile_for_photons(&desc)).map_err(|e| match e {
        JobError::Scene(faults) => {
            let lines: Vec<String> = faults.iter().map(|f| format!("{}: error: {}", f.span.display(&desc.files), f.message)).collect();
            coded(exit::INVALID, lines.join("\n"))
        }
        e => coded(exit::INVALID, e.to_string()),
    })?;
    let info = MapInfo { scene_hash: desc.light_hash(), seed: args.seed, max_depth: args.max_depth };
    let mut map = PhotonMap::new(info);
    if args.resume && args.output.exists() {
        let found = load(&args.output, u64::from(args.photon_memory) << 20)?;
        map.merge(found).map_err(|e| coded(exit::INVALID, format!("{}: {e}", args.output.display())))?;
    }
    let cancel = on_interrupt();
    let progress = Progress::new(if args.quiet { progress::Mode::None } else { args.progress });
    let interval = Duration::try_from_secs_f64(args.checkpoint_interval.max(0.0)).unwrap_or(Duration::MAX);
    let start = Instant::now();
    let (mut saved, mut failure) = (start, None);
    pool.install(|| {
        let budget = u64::from(args.photon_memory) << 20;
        map.trace(&scene, args.first_photon..end, budget, &|| cancel.is_cancelled(), &mut |map, fraction| {
            progress.stage("tracing photons", fraction);
            if saved.elapsed() >= interval && fraction < 1.0 {
                saved = Instant::now();
                failure = failure.take().or(save(map, &args.output).err());
            }
        });
    });
    progress.finish();
    if let Some(failure) = failure {
        return Err(failure);
    }
    save(&map, &args.output)?;
    if !args.quiet {
        note(&format!("{}: {}, in {}", args.output.display(), describe_photons(&map.contents()), progress::human(start.elapsed())));
        photon_limits(&scene).iter().for_each(|n| note(n));
        if map.surface().is_empty() && map.volume().is_empty() {
            note("warning: no photon has landed anywhere: the scene has no light, or nothing that it meets");
        }
    }
    Ok(ExitCode::from(if cancel.is_cancelled() { exit::INTERRUPTED } else { exit::OK }))
}

fn merge(args: &Merge) -> anyhow::Result<ExitCode> {
    // One map is read beside what there is.
    let budget = u64::from(args.photon_memory) << 19;
    let mut total = load(&args.maps[0], budget)?;
    for path in &args.maps[1..] {
        let context = || format!("{} does not merge with {}", path.display(), args.maps[0].display());
        total.merge_within(load(path, budget)?, budget).map_err(|e| coded(exit::INVALID, format!("{}: {e}", context())))?;
    }
    save(&total, &args.output)?;
    note(&format!("merged {} maps: {}", args.maps.len(), describe_photons(&total.contents())));
    Ok(ExitCode::SUCCESS)
}

fn info(args: &Info) -> anyhow::Result<ExitCode> {
    let map = Contents::load(&args.map).with_context(|| args.map.display().to_string())?;
    let mut out = std::io::stdout();
    let ranges: Vec<String> = map.segments.iter().take(8).map(|s| format!("{}..{}", s.begin, s.end)).collect();
    let depth = map.info.max_depth.map_or("any".to_owned(), |d| d.to_string());
    writeln!(out, "{}", describe_photons(&map))?;
    writeln!(out, "photons {}{}", ranges.join(", "), if map.segments.len() > 8 { ", …" } else { "" })?;
    writeln!(out, "seed {}, longest path {depth}", map.info.seed)?;
    writeln!(out, "light hash of the scene {}", map.info.scene_hash)?;
    Ok(ExitCode::SUCCESS)
}
