//! Reads all of POV-Ray's own example scenes, as its package installs them or in the folder `ETENDUE_POV_CORPUS`; where there are none it
//! says so.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use etendue_render::solid::WorldProbe;
use etendue_scene::formats::{ReadOptions, pov};

const INSTALLED: &str = "/usr/share/doc/povray/examples";

fn scenes(folder: &Path, found: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let mut paths: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            scenes(&path, found);
        } else if path.file_name().is_some_and(|n| n == "__empty.pov") {
            // A form to fill in, with an include that is not there.
        } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("pov")) {
            found.push(path);
        }
    }
}

#[test]
#[allow(clippy::print_stdout)]
fn corpus() {
    let root = std::env::var_os("ETENDUE_POV_CORPUS").unwrap_or_else(|| INSTALLED.into());
    let mut paths = Vec::new();
    scenes(Path::new(&root), &mut paths);
    if paths.is_empty() {
        println!("skipped: no POV-Ray scenes in {}", root.display());
        return;
    }
    let mut failures = 0;
    for path in &paths {
        let start = std::time::Instant::now();
        let mut options = ReadOptions::default();
        options.pov.probe = Some(Arc::new(WorldProbe::new()));
        if let Err(e) = pov::read(path, &options) {
            failures += 1;
            let text: Vec<String> = e.to_string().lines().filter(|l| l.contains("error")).map(str::to_owned).collect();
            println!("{}: {}", path.display(), text.join(" ").chars().take(400).collect::<String>());
        }
        if start.elapsed().as_secs_f64() > 5.0 {
            println!("{}: {:.1} s", path.display(), start.elapsed().as_secs_f64());
        }
    }
    println!("{failures} of {} scenes cannot be read", paths.len());
    assert_eq!(failures, 0);
}
