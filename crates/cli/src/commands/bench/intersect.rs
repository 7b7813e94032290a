//! `etendue bench intersect`: ray casting as a contender of the ray benchmark.
//!
//! Files are little-endian without padding. A mesh is a count and nine `f32` for each triangle; rays are a count and
//! eight `f32` each (origin, start, direction, end); hits are a count and for each ray a primitive (0xffffffff: miss)
//! with its t, or a byte that says whether it is occluded.

use std::ffi::OsString;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Barrier;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use anyhow::{Context, bail, ensure};
use etendue_render::accel::{Accel, Blas, BlasInput, Hit, Instance, IsaKind, Ray, StreamMemory};
use etendue_render::math::{Mat4, Vec3};

use crate::clock;

/// Rays that a thread takes at once.
const CHUNK: usize = 4096;
/// Record of a closest hit: primitive and t.
type HitRecord = [u8; 8];
/// Record of a ray.
type RayRecord = [u8; 32];
const MISS: HitRecord = [0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0];

/// closest|any MESH RAYS [--threads N] [--repeat R] [--out HITS] [--then closest|any RAYS [--out HITS]]...
#[derive(clap::Args)]
#[command(
    override_usage = "etendue bench intersect closest|any MESH RAYS [--threads N] [--repeat R] [--isa NAME] [--single] [--out HITS] \
    [--then closest|any RAYS [--out HITS]]..."
)]
pub struct Args {
    /// Mode, mesh file, ray file and options: `--threads N` threads that build and trace (default 1), `--repeat R` timed
    /// passes (default 3), `--isa portable|avx2|avx512` instead of the best, `--single` for rays one by one instead of in streams, `--out FILE` for the hits, and `--then` for
    /// further rays with the same structure.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, required = true, value_name = "ARGS")]
    args: Vec<OsString>,
}

#[derive(Clone, Copy, PartialEq)]
enum Mode {
    Closest,
    Any,
}

struct Job {
    mode: Mode,
    rays: PathBuf,
    out: Option<PathBuf>,
}

struct Plan {
    mesh: PathBuf,
    jobs: Vec<Job>,
    threads: usize,
    repeat: usize,
    isa: IsaKind,
    single: bool,
}

/// Builds, traces and prints one JSON line for each set of rays.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    let plan = parse(args.args)?;
    let positions = read_mesh(&plan.mesh)?;
    let triangles: Vec<[u32; 3]> = (0..positions.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(plan.threads).build().context("cannot start the threads")?;
    let (start, start_cpu) = (Instant::now(), clock::process_cpu_secs());
    let accel = pool.install(|| {
        let blas = Blas::build(BlasInput { positions: &positions, triangles: &triangles, shapes: &[] });
        Accel::build(vec![blas], vec![Instance { world_from_object: Mat4::IDENTITY, blas: 0 }])
    });
    let (build_secs, build_cpu_secs) = (start.elapsed().as_secs_f64(), clock::process_cpu_secs() - start_cpu);
    drop((positions, triangles));
    let accel = accel.with_isa(plan.isa);
    for job in &plan.jobs {
        let rays: Vec<RayRecord> = read_records(&job.rays)?;
        let mut closest = vec![MISS; if job.mode == Mode::Closest { rays.len() } else { 0 }];
        let mut any = vec![[0u8; 1]; if job.mode == Mode::Any { rays.len() } else { 0 }];
        let (mut by_cpu, mut by_wall) = (Vec::new(), Vec::new());
        for pass in 0..=plan.repeat {
            let (cpu, wall) = match (job.mode, plan.single) {
                (Mode::Closest, true) => pass_over(&rays, &mut closest, plan.threads, || {
                    |rays: &[RayRecord], out: &mut [HitRecord]| {
                        rays.iter().zip(out).for_each(|(r, out)| *out = hit_record(accel.intersect(&ray(r))));
                    }
                }),
                (Mode::Any, true) => pass_over(&rays, &mut any, plan.threads, || {
                    |rays: &[RayRecord], out: &mut [[u8; 1]]| {
                        rays.iter().zip(out).for_each(|(r, out)| *out = [u8::from(accel.occluded(&ray(r)))]);
                    }
                }),
                (Mode::Closest, false) => pass_over(&rays, &mut closest, plan.threads, || {
                    let (mut memory, mut block, mut hits) = (StreamMemory::new(), Vec::new(), [None; CHUNK]);
                    let accel = &accel;
                    move |rays: &[RayRecord], out: &mut [HitRecord]| {
                        block.clear();
                        block.extend(rays.iter().map(ray));
                        accel.intersect_stream(&block, &mut hits, &mut memory);
                        hits.iter().zip(out).for_each(|(h, out)| *out = hit_record(*h));
                    }
                }),
                (Mode::Any, false) => pass_over(&rays, &mut any, plan.threads, || {
                    let (mut memory, mut block, mut found) = (StreamMemory::new(), Vec::new(), [false; CHUNK]);
                    let accel = &accel;
                    move |rays: &[RayRecord], out: &mut [[u8; 1]]| {
                        block.clear();
                        block.extend(rays.iter().map(ray));
                        accel.occluded_stream(&block, &mut found, &mut memory);
                        found.iter().zip(out).for_each(|(&o, out)| *out = [u8::from(o)]);
                    }
                }),
            };
            // The first pass warms up.
            if pass > 0 {
                by_cpu.push(cpu * 1e-6);
                by_wall.push(wall * 1e-6);
            }
        }
        let distances = closest.iter().filter(|h| h[..4] != MISS[..4]).map(|h| f64::from(f32::from_le_bytes([h[4], h[5], h[6], h[7]])));
        let hits = distances.clone().count() + any.iter().filter(|b| b[0] != 0).count();
        let sum: f64 = distances.sum();
        let line = serde_json::json!({
            "build_s": build_secs,
            "build_cpu_s": build_cpu_secs,
            "mrays_per_s": median(&mut by_cpu),
            "mrays_per_s_wall": median(&mut by_wall),
            "hits": hits,
            "mean_t": if sum > 0.0 { sum / hits as f64 } else { 0.0 },
            "bvh_bytes": accel.bytes(),
            "isa": format!("{:?}", accel.isa()).to_lowercase(),
        });
        writeln!(std::io::stdout(), "{line}")?;
        if let Some(out) = &job.out {
            let count = (rays.len() as u32).to_le_bytes();
            let data = if job.mode == Mode::Closest { closest.as_flattened() } else { any.as_flattened() };
            std::fs::write(out, [&count[..], data].concat()).with_context(|| format!("cannot write {}", out.display()))?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Traces all rays once, in each thread with a function that `tracer` makes and that takes the rays and results of a
/// chunk; returns rays per second by CPU time, summed over the threads, and by wall time.
fn pass_over<T: Send, F: FnMut(&[RayRecord], &mut [T])>(
    rays: &[RayRecord],
    results: &mut [T],
    threads: usize,
    tracer: impl Fn() -> F + Sync,
) -> (f64, f64) {
    // Each chunk of results has a lock that only its own thread ever takes.
    let chunks: Vec<_> = results.chunks_mut(CHUNK).map(std::sync::Mutex::new).collect();
    let (next, barrier) = (AtomicUsize::new(0), Barrier::new(threads));
    let work = || {
        barrier.wait();
        let (start, start_cpu) = (Instant::now(), clock::thread_cpu_secs());
        let mut trace = tracer();
        let mut done = 0;
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            let Some(Ok(mut out)) = chunks.get(i).map(|c| c.lock()) else { break };
            let rays = &rays[i * CHUNK..][..out.len()];
            trace(rays, &mut out);
            done += out.len();
        }
        let cpu = clock::thread_cpu_secs() - start_cpu;
        (if cpu > 0.0 { done as f64 / cpu } else { 0.0 }, start.elapsed().as_secs_f64())
    };
    let shares: Vec<(f64, f64)> = std::thread::scope(|s| {
        let handles: Vec<_> = (0..threads).map(|_| s.spawn(work)).collect();
        handles.into_iter().filter_map(|h| h.join().ok()).collect()
    });
    let wall = shares.iter().map(|s| s.1).fold(0.0, f64::max);
    (shares.iter().map(|s| s.0).sum(), rays.len() as f64 / wall.max(1e-12))
}

#[inline(always)]
fn ray(record: &RayRecord) -> Ray {
    let f = |i: usize| f32::from_le_bytes([record[4 * i], record[4 * i + 1], record[4 * i + 2], record[4 * i + 3]]);
    Ray { o: Vec3::new(f(0), f(1), f(2)), d: Vec3::new(f(4), f(5), f(6)), t_min: f(3), t_max: f(7) }
}

fn hit_record(hit: Option<Hit>) -> HitRecord {
    hit.map_or(MISS, |h| {
        let [p, t] = [h.prim.to_le_bytes(), h.t.to_le_bytes()];
        [p[0], p[1], p[2], p[3], t[0], t[1], t[2], t[3]]
    })
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    if n == 0 { 0.0 } else { 0.5 * (values[(n - 1) / 2] + values[n / 2]) }
}

fn parse(args: Vec<OsString>) -> anyhow::Result<Plan> {
    let mut args = args.into_iter();
    let mode = |a: OsString| match a.to_str() {
        Some("closest") => Ok(Mode::Closest),
        Some("any") => Ok(Mode::Any),
        _ => bail!("{}: the mode is closest or any", a.display()),
    };
    let mut first_three = || args.next().context("expected closest|any MESH RAYS");
    let first_mode = mode(first_three()?)?;
    let mesh = PathBuf::from(first_three()?);
    let rays = PathBuf::from(first_three()?);
    let mut plan =
        Plan { mesh, jobs: vec![Job { mode: first_mode, rays, out: None }], threads: 1, repeat: 3, isa: IsaKind::detect(), single: false };
    while let Some(option) = args.next() {
        let name = option.to_string_lossy().into_owned();
        if name == "--single" {
            plan.single = true;
            continue;
        }
        let mut value = || args.next().with_context(|| format!("{name} lacks its value"));
        let number = |a: OsString, most: usize| match a.to_str().and_then(|s| s.parse().ok()) {
            Some(n) if (1..=most).contains(&n) => Ok(n),
            _ => bail!("{name} {}: expected a number from 1 to {most}", a.display()),
        };
        match name.as_str() {
            "--threads" => plan.threads = number(value()?, 1024)?,
            "--repeat" => plan.repeat = number(value()?, 1000)?,
            "--isa" => {
                let wanted = value()?.to_string_lossy().to_lowercase();
                let found = IsaKind::available().into_iter().find(|i| format!("{i:?}").to_lowercase() == wanted);
                plan.isa = found.with_context(|| format!("--isa {wanted}: not on this machine"))?;
            }
            "--out" => {
                let out = PathBuf::from(value()?);
                if let Some(job) = plan.jobs.last_mut() {
                    job.out = Some(out);
                }
            }
            "--then" => {
                let job = Job { mode: mode(value()?)?, rays: PathBuf::from(value()?), out: None };
                plan.jobs.push(job);
            }
            _ => bail!("unknown option {name}"),
        }
    }
    Ok(plan)
}

fn read_mesh(path: &Path) -> anyhow::Result<Vec<Vec3>> {
    let records: Vec<[u8; 36]> = read_records(path)?;
    ensure!(records.len() < u32::MAX as usize / 3, "{}: too many triangles", path.display());
    let corner = |c: &[u8]| {
        let f = |i: usize| f32::from_le_bytes([c[i], c[i + 1], c[i + 2], c[i + 3]]);
        Vec3::new(f(0), f(4), f(8))
    };
    Ok(records.iter().flat_map(|r| [corner(&r[..12]), corner(&r[12..24]), corner(&r[24..])]).collect())
}

/// Reads a count and so many records of N bytes.
fn read_records<const N: usize>(path: &Path) -> anyhow::Result<Vec<[u8; N]>> {
    let at = || format!("cannot read {}", path.display());
    let mut file = std::fs::File::open(path).with_context(at)?;
    let size = file.metadata().with_context(at)?.len();
    let mut count = [0; 4];
    file.read_exact(&mut count).with_context(at)?;
    let count = u32::from_le_bytes(count);
    let needed = 4 + u64::from(count) * N as u64;
    ensure!(size >= needed, "{}: {size} bytes, but {count} records of {N} bytes need {needed}", path.display());
    let mut records = vec![[0; N]; count as usize];
    file.read_exact(records.as_flattened_mut()).with_context(at)?;
    Ok(records)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(line: &str) -> anyhow::Result<Plan> {
        parse(line.split_whitespace().map(OsString::from).collect())
    }

    #[test]
    fn the_protocol_s_command_line_is_understood() {
        let p =
            plan("closest m.tri a.rays --single --threads 2 --repeat 5 --out a.hits --then any b.rays --then closest c.rays --out c.hits")
                .unwrap();
        assert_eq!((p.threads, p.repeat, p.jobs.len(), p.single), (2, 5, 3, true));
        let outs: Vec<_> = p.jobs.iter().map(|j| (j.mode == Mode::Any, j.out.clone())).collect();
        assert_eq!(outs, [(false, Some("a.hits".into())), (true, None), (false, Some("c.hits".into()))]);
    }

    #[test]
    fn wrong_command_lines_are_refused() {
        for line in
            ["", "closest", "closest m", "first m r", "any m r --threads 0", "any m r --threads", "any m r --then any", "any m r --fast"]
        {
            assert!(plan(line).is_err(), "{line}");
        }
    }

    #[test]
    fn truncated_files_are_refused() {
        let path = std::env::temp_dir().join(format!("etendue-bench-{}.rays", std::process::id()));
        for (bytes, good) in
            [(vec![], false), (vec![1, 0, 0, 0, 9], false), (vec![255; 40], false), ([&[1, 0, 0, 0][..], &[0; 32]].concat(), true)]
        {
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(read_records::<32>(&path).is_ok(), good);
        }
        std::fs::remove_file(&path).unwrap();
    }
}
