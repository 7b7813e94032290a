//! Where Open Image Denoise may be: named by the user, known to the system's loader, or in a Python package.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

/// The environment variable that names the library's file.
pub const LIBRARY_VARIABLE: &str = "ETENDUE_OIDN";

/// Names that the system's loader looks for in its own places, newest ABI first.
pub(super) const NAMES: &[&str] = if cfg!(windows) {
    &["OpenImageDenoise.dll"]
} else if cfg!(target_os = "macos") {
    &["libOpenImageDenoise.2.dylib", "libOpenImageDenoise.dylib", "libOpenImageDenoise.1.dylib"]
} else {
    &["libOpenImageDenoise.so.2", "libOpenImageDenoise.so", "libOpenImageDenoise.so.1"]
};

/// Folders below a `site-packages` in which PyPI packages keep the library: `pyoidn` (2.x), `bpy` (2.x, Blender
/// as a module) and `oidn` (1.4).
const IN_SITE_PACKAGES: &[&str] =
    &["pyoidn/oidn/lib", "pyoidn/oidn/bin", "bpy/lib", "oidn/lib.linux.x64", "oidn/lib.win.x64", "oidn/lib.macos.aarch64"];

/// Folders that loaders do not always search by themselves: Homebrew's, and where administrators install.
const OTHER_FOLDERS: &[&str] = &["/opt/homebrew/lib", "/usr/local/lib"];

/// Library files that exist outside of the loader's own places, best first, each once.
pub(super) fn installed_files() -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = Vec::new();
    let folders = site_packages(&prefixes());
    let packages = IN_SITE_PACKAGES.iter().flat_map(|sub| folders.iter().map(move |site| site.join(sub)));
    for folder in packages.chain(OTHER_FOLDERS.iter().map(PathBuf::from)) {
        // The links of one folder lead to one file; the newest name is enough.
        files.extend(libraries_in(&folder).into_iter().next().filter(|f| !files.contains(f)));
    }
    files
}

/// The library's files in a folder, the highest ABI number first.
pub(super) fn libraries_in(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut found: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(|p| p.file_name().is_some_and(is_library)).collect();
    found.sort_by(|a, b| b.cmp(a));
    found
}

/// Is it the library itself, rather than its `_core` or one of its `_device_*` parts?
fn is_library(name: &OsStr) -> bool {
    let Some(name) = name.to_str() else { return false };
    let Some(rest) = name.strip_prefix("lib").unwrap_or(name).strip_prefix("OpenImageDenoise") else { return false };
    rest == ".dll" || rest == ".so" || rest.starts_with(".so.") || (rest.starts_with('.') && rest.ends_with(".dylib"))
}

/// Roots of Python installations: active environments, this program's own, and those of Pythons on the search path.
fn prefixes() -> Vec<PathBuf> {
    let mut prefixes: Vec<PathBuf> = ["VIRTUAL_ENV", "CONDA_PREFIX"].iter().filter_map(std::env::var_os).map(PathBuf::from).collect();
    let program = std::env::current_exe().ok();
    let bin_folders = program.iter().filter_map(|p| p.parent().map(Path::to_path_buf)).chain(python_folders(std::env::var_os("PATH")));
    for folder in bin_folders {
        // Windows keeps python.exe at the root itself.
        prefixes.extend(folder.parent().map(Path::to_path_buf));
        prefixes.push(folder);
    }
    if let Some(home) = std::env::var_os("HOME") {
        prefixes.push(Path::new(&home).join(".local"));
    }
    if let Some(data) = std::env::var_os("APPDATA") {
        prefixes.extend(subfolders(&Path::new(&data).join("Python"), "Python3"));
    }
    prefixes.extend(["/usr/local", "/usr"].map(PathBuf::from));
    prefixes
}

/// Folders of a search path that hold a Python. Relative ones are left out: a library is code, and must not come from
/// wherever the user happens to be.
fn python_folders(search_path: Option<OsString>) -> Vec<PathBuf> {
    let has_python = |folder: &PathBuf| ["python3", "python", "python.exe"].iter().any(|n| folder.join(n).is_file());
    let folders = search_path.as_deref().map(|p| std::env::split_paths(p).filter(|f| f.is_absolute() && has_python(f)).collect());
    folders.unwrap_or_default()
}

/// The package folders of Python installations, each once.
fn site_packages(prefixes: &[PathBuf]) -> Vec<PathBuf> {
    let mut folders = Vec::new();
    for prefix in prefixes {
        let mut candidates = vec![prefix.join("Lib/site-packages"), prefix.join("site-packages")];
        for lib in ["lib", "lib64", "local/lib"] {
            for version in subfolders(&prefix.join(lib), "python3") {
                candidates.extend([version.join("site-packages"), version.join("dist-packages")]);
            }
        }
        for folder in candidates {
            if folder.is_dir() && !folders.contains(&folder) {
                folders.push(folder);
            }
        }
    }
    folders
}

/// Entries of a folder whose names start so, the highest first.
fn subfolders(folder: &Path, start: &str) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let begins = |e: &std::fs::DirEntry| e.file_name().to_str().is_some_and(|n| n.starts_with(start));
    let mut found: Vec<PathBuf> = entries.flatten().filter(begins).map(|e| e.path()).collect();
    found.sort_by(|a, b| b.cmp(a));
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_the_library_are_not_taken_for_it() {
        let yes = ["libOpenImageDenoise.so", "libOpenImageDenoise.so.2.5.1", "OpenImageDenoise.dll", "libOpenImageDenoise.2.3.0.dylib"];
        let no = ["libOpenImageDenoise_core.so.2.5.1", "OpenImageDenoise_device_cpu.dll", "OpenImageDenoise.lib", "libtbb.so.12", ""];
        assert!(yes.iter().all(|n| is_library(n.as_ref())));
        assert!(!no.iter().any(|n| is_library(n.as_ref())));
    }

    #[test]
    fn packages_of_a_python_are_found_and_the_newest_library_goes_first() {
        let root = std::env::temp_dir().join(format!("etendue-locate-{}", std::process::id()));
        let site = root.join("lib/python3.12/site-packages");
        let lib = site.join("pyoidn/oidn/lib");
        std::fs::create_dir_all(&lib).unwrap();
        std::fs::create_dir_all(root.join("bin")).unwrap();
        for name in ["libOpenImageDenoise.so", "libOpenImageDenoise.so.1", "libOpenImageDenoise.so.2", "libOpenImageDenoise_core.so.2"] {
            std::fs::write(lib.join(name), "").unwrap();
        }
        std::fs::write(root.join("bin/python3"), "").unwrap();
        let search = std::env::join_paths([root.join("nowhere"), root.join("bin"), PathBuf::from("bin")]).unwrap();
        assert_eq!(python_folders(Some(search)), [root.join("bin")]);
        assert_eq!(site_packages(&[root.clone(), root.clone()]), [site]);
        let names: Vec<_> = libraries_in(&lib).into_iter().map(|p| p.file_name().unwrap().to_owned()).collect();
        std::fs::remove_dir_all(&root).unwrap();
        assert_eq!(names, ["libOpenImageDenoise.so.2", "libOpenImageDenoise.so.1", "libOpenImageDenoise.so"]);
    }
}
