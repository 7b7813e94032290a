//! Noise removal with Intel Open Image Denoise, loaded at run time where it is installed.
//!
//! A neural network replaces each pixel by an estimate from its neighborhood. That is biased: use it for pictures to look
//! at, never for references or measurements. It cannot restore what no sample found, it smears light patterns that lie
//! below the noise (caustics above all), and light groups no longer sum to the picture, as only R, G and B change.
//!
//! One version of the library on one kind of processor gives the same picture each time, for any number of threads; other
//! versions and other instruction sets (SSE, AVX2, AVX-512, NEON) differ in last bits or more. The promise that pictures
//! have the same bits everywhere ends here.

mod locate;
mod oidn;
#[cfg(test)]
mod tests;

use std::ffi::CStr;
use std::path::{Path, PathBuf};

pub use locate::LIBRARY_VARIABLE;

use crate::image::Image;

/// How to get the library, in the words of the system at hand.
const HOW_TO_GET: &str = if cfg!(target_os = "macos") { "`brew install open-image-denoise`" } else { "`pip install pyoidn`" };

/// The versions whose C interface is the one declared here: from 1.4 (`cleanAux`) on, before 3.
const VERSIONS: std::ops::Range<u32> = 10_400..30_000;

/// Why nothing was denoised.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DenoiseError {
    /// The library is in none of the places where it is looked for.
    #[error(
        "Open Image Denoise is not installed: {HOW_TO_GET} brings it; for a library elsewhere, set {LIBRARY_VARIABLE} to its file's path"
    )]
    NotInstalled,
    /// A library is there but cannot be used: parts are missing, or it is of another version.
    #[error("{} cannot be used as Open Image Denoise: {reason}; {HOW_TO_GET} brings one that can", file.display())]
    Unusable {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The picture has no R, G and B.
    #[error("there is nothing to denoise: the picture has no channels R, G and B")]
    NoColor,
    /// The library's own error.
    #[error("Open Image Denoise failed: {0}")]
    Failed(String),
}

/// How to denoise.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DenoiseOptions {
    /// Denoises albedo and normals first and then trusts them, which the library's documentation recommends for final
    /// pictures; takes about three times as long. Without it their noise is taken for noise.
    pub prefilter: bool,
    /// Threads; 0 leaves the number to the library.
    pub threads: usize,
}

impl Default for DenoiseOptions {
    fn default() -> Self {
        Self { prefilter: true, threads: 0 }
    }
}

/// The loaded library. Several threads may use it at once.
#[derive(Clone)]
pub struct Denoiser {
    api: oidn::Api,
    file: PathBuf,
    version: u32,
}

impl std::fmt::Debug for Denoiser {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Denoiser").field("file", &self.file).field("version", &self.version).finish()
    }
}

impl Denoiser {
    /// Finds and loads the library: the file (or folder) that [`LIBRARY_VARIABLE`] names and no other; or else the one
    /// that the system's loader finds; or else one in a Python package (`pyoidn`, `bpy`, `oidn`) of an active environment
    /// or of a Python on the search path. The library stays loaded until the process ends.
    ///
    /// # Errors
    /// [`DenoiseError::NotInstalled`]; [`DenoiseError::Unusable`] with the first library found, if none found is usable.
    pub fn load() -> Result<Self, DenoiseError> {
        if let Some(named) = std::env::var_os(LIBRARY_VARIABLE).filter(|v| !v.is_empty()) {
            return Self::load_file(Path::new(&named));
        }
        Self::load_first(locate::NAMES.iter().map(PathBuf::from).chain(locate::installed_files()))
    }

    /// Loads the library from a file, or from a folder that holds it.
    ///
    /// # Errors
    /// [`DenoiseError::Unusable`]
    pub fn load_file(file: &Path) -> Result<Self, DenoiseError> {
        let unusable = |reason| DenoiseError::Unusable { file: file.into(), reason };
        if file.is_dir() {
            let inside = locate::libraries_in(file).into_iter().next();
            return Self::load_file(&inside.ok_or_else(|| unusable("the folder has no library of that name".into()))?);
        }
        // A path without a folder would be looked up in the loader's own places.
        let path = if file.exists() { std::path::absolute(file).unwrap_or_else(|_| file.into()) } else { file.into() };
        let api = oidn::Api::load(&path).map_err(unusable)?;
        let version = api.device(0).map_err(unusable)?.version();
        if !VERSIONS.contains(&version) {
            return Err(unusable(format!("it is version {}; 1.4 to 2.x are known", version_text(version))));
        }
        Ok(Self { api, file: path, version })
    }

    /// The first usable one of files and bare names, newest first.
    fn load_first(candidates: impl Iterator<Item = PathBuf>) -> Result<Self, DenoiseError> {
        let mut first_fault = None;
        for file in candidates {
            match Self::load_file(&file) {
                Ok(denoiser) => return Ok(denoiser),
                Err(DenoiseError::Unusable { reason, .. }) if is_absent(&file, &reason) => {}
                Err(fault) => {
                    first_fault.get_or_insert(fault);
                }
            }
        }
        Err(first_fault.unwrap_or(DenoiseError::NotInstalled))
    }

    /// The library's file, or the name under which the system's loader found it.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// The library's version, such as `2.5.1`.
    pub fn version(&self) -> String {
        version_text(self.version)
    }

    /// Removes noise from R, G and B (linear, any range), guided by `albedo.R/G/B` and `N.X/Y/Z` where they are there.
    /// Other channels, alpha among them, stay as they are. Values below 0 (of filters with negative lobes) become 0; a
    /// pixel that is not finite counts as the mean of its finite neighbors. Holds up to five copies of three
    /// channels, besides what the library itself needs.
    ///
    /// # Errors
    /// [`DenoiseError::NoColor`], or [`DenoiseError::Failed`] with the library's message; the image is unchanged then.
    pub fn denoise(&self, image: &mut Image, options: &DenoiseOptions) -> Result<(), DenoiseError> {
        let size = [image.width as usize, image.height as usize];
        let color = repair(size, interleaved(image, ["R", "G", "B"]).ok_or(DenoiseError::NoColor)?);
        if color.is_empty() {
            return Ok(());
        }
        let device = self.api.device(options.threads).map_err(DenoiseError::Failed)?;
        let run = |inputs: &[(&CStr, &[f32])], switches: &[&CStr]| {
            let mut output = vec![0.0; color.len()];
            device.run(size, inputs, switches, &mut output).map_err(DenoiseError::Failed).map(|()| output)
        };
        let guide = |names, low: f32| {
            interleaved(image, names).map(|mut data| {
                data.iter_mut().for_each(|v| *v = if v.is_nan() { 0.0 } else { v.clamp(low, 1.0) });
                data
            })
        };
        let mut inputs = vec![(c"color", &color[..])];
        let mut switches = vec![c"hdr"];
        let mut albedo = guide(["albedo.R", "albedo.G", "albedo.B"], 0.0);
        // The library takes normals only together with albedo.
        let mut normal = albedo.as_ref().and_then(|_| guide(["N.X", "N.Y", "N.Z"], -1.0));
        if options.prefilter && albedo.is_some() {
            for (name, data) in [(c"albedo", &mut albedo), (c"normal", &mut normal)] {
                if let Some(data) = data {
                    *data = run(&[(name, &data[..])], &[])?;
                }
            }
            switches.push(c"cleanAux");
        }
        inputs.extend(albedo.iter().map(|data| (c"albedo", &data[..])));
        inputs.extend(normal.iter().map(|data| (c"normal", &data[..])));
        let output = run(&inputs, &switches)?;
        for (i, name) in ["R", "G", "B"].into_iter().enumerate() {
            if let Some(channel) = image.channels.iter_mut().find(|c| c.name == name) {
                let pixels = output.iter().zip(&color).skip(i).step_by(3);
                channel.data = pixels.map(|(&new, &old)| if new.is_finite() { new } else { old }).collect();
            }
        }
        Ok(())
    }
}

/// Finds the library ([`Denoiser::load`]) and removes noise ([`Denoiser::denoise`]) with the default options.
///
/// # Errors
/// [`DenoiseError`]
pub fn denoise(image: &mut Image) -> Result<(), DenoiseError> {
    Denoiser::load()?.denoise(image, &DenoiseOptions::default())
}

/// Does this message of the loader say that there is no such library, rather than that a part of it is missing?
fn is_absent(file: &Path, reason: &str) -> bool {
    let is_bare_name = file.components().count() == 1;
    // Where loaders do not say which file they missed, a bare name that does not load counts as absent.
    let names_itself = !cfg!(target_os = "linux") || reason.starts_with(&format!("{}: cannot open", file.display()));
    is_bare_name && names_itself
}

fn version_text(version: u32) -> String {
    format!("{}.{}.{}", version / 10_000, version / 100 % 100, version % 100)
}

/// Three planes as pixels; None where one is missing.
fn interleaved(image: &Image, names: [&str; 3]) -> Option<Vec<f32>> {
    let [x, y, z] = names.map(|n| image.channel(n));
    Some(x?.iter().zip(y?).zip(z?).flat_map(|((&x, &y), &z)| [x, y, z]).collect())
}

/// Replaces values that are not finite by the mean of the finite ones around, and values below 0 by 0.
fn repair([width, height]: [usize; 2], mut pixels: Vec<f32>) -> Vec<f32> {
    let is_good = |v: &f32| v.is_finite();
    let bad: Vec<usize> = pixels.iter().enumerate().filter(|(_, v)| !is_good(v)).map(|(i, _)| i).collect();
    let patches: Vec<f32> = bad
        .iter()
        .map(|&i| {
            let (x, y, channel) = (i / 3 % width, i / 3 / width, i % 3);
            let near = |c: usize, end: usize| c.saturating_sub(1)..(c + 2).min(end);
            let around = near(y, height).flat_map(|ny| near(x, width).map(move |nx| (ny * width + nx) * 3 + channel));
            let (sum, count) = around.map(|n| pixels[n]).filter(is_good).fold((0.0, 0.0), |(sum, n), v| (sum + v.max(0.0), n + 1.0));
            if count > 0.0 { sum / count } else { 0.0 }
        })
        .collect();
    for (i, patch) in bad.into_iter().zip(patches) {
        pixels[i] = patch;
    }
    pixels.iter_mut().for_each(|v| *v = v.max(0.0));
    pixels
}
