//! Reads all POV-Ray scenes below a folder and lists those that cannot be read:
//!
//! `ETENDUE_POV_CORPUS=/usr/share/doc/povray/examples cargo test -p etendue-scene --test pov_corpus -- --ignored --nocapture`

use std::path::{Path, PathBuf};

use etendue_scene::formats::{ReadOptions, pov};

fn scenes(folder: &Path, found: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let mut paths: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            scenes(&path, found);
        } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("pov")) {
            found.push(path);
        }
    }
}

#[test]
#[ignore = "needs scenes that are not part of this repository"]
#[allow(clippy::print_stdout)]
fn corpus() {
    let Some(root) = std::env::var_os("ETENDUE_POV_CORPUS") else { return };
    let mut paths = Vec::new();
    scenes(Path::new(&root), &mut paths);
    let mut failures = 0;
    for path in &paths {
        let start = std::time::Instant::now();
        if let Err(e) = pov::read(path, &ReadOptions::default()) {
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
