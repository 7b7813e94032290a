//! From a solution to files: the baked scene, and beside it maps and probes.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::fill::Map;
use super::method::Method;
use super::output::{self, Display};
use super::probes::{self, Grid};
use super::solve::Solution;
use super::{Bake, BakeError, Baked};
use crate::denoise::Denoiser;
use crate::image::atomic::write_atomically;
use crate::image::{Image, WriteOptions};

/// What to make of a solution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Order {
    /// How the baked scene shows the light.
    pub display: Display,
    /// Also measure light in the air, on a grid of so many points.
    pub probes: Option<[u32; 3]>,
    /// Also irradiance, albedo and normals of each atlas as pictures.
    pub maps: bool,
    /// In those also the direction from which most light comes.
    pub directional: bool,
}

/// Finished files.
pub struct Delivery {
    /// The baked scene, GLB.
    glb: Vec<u8>,
    /// Pictures of the atlases, where they were ordered.
    maps: Vec<Image>,
    /// Probes as JSON, where they were ordered.
    probes: Option<String>,
    /// Maps of the solution.
    pub baked: Baked,
    /// Sentences for the user.
    pub notes: Vec<String>,
}

impl Bake {
    /// Makes the files of a solution. `name` and `method` are the method's; `spp` the samples of a point, of which a probe has 64 at least.
    ///
    /// # Errors
    /// [`BakeError`]
    pub fn deliver(
        &self,
        name: &str,
        method: &Method,
        solution: &Solution,
        spp: u32,
        order: &Order,
        denoiser: Option<&Denoiser>,
    ) -> Result<Delivery, BakeError> {
        let mut notes = Vec::new();
        let baked = self.finish(solution, denoiser)?;
        if baked.buried > 0 {
            notes.push(format!("{} texels lie inside of other bodies and take the light of their neighbors", baked.buried));
        }
        let scene = output::scene(self, &baked, order.display)?;
        let display = format!("{:?}", order.display).to_lowercase();
        let mut extras = json!({
            "lightmap": { "display": display, "texCoord": scene.uv_set, "method": name, "samples": solution.spp },
        });
        let mut field = None;
        if let Some(counts) = order.probes {
            let grid = Grid::new(&self.scene, counts)?;
            let found = probes::measure(self, method, &grid, spp.max(64), self.seed());
            notes.push(format!("{} probes, {} inside of bodies", found.probes.len(), found.inside()));
            let json = found.to_json();
            field = Some(json.to_string());
            extras["probes"] = json;
        }
        let maps =
            if order.maps { (0..baked.irradiance.len()).map(|i| picture(&baked, i, order.directional)).collect() } else { Vec::new() };
        let (glb, losses) = scene.glb(extras)?;
        notes.extend(losses.iter().map(|l| format!("not written: {l}")));
        Ok(Delivery { glb, maps, probes: field, baked, notes })
    }
}

impl Delivery {
    /// Size of the baked scene's file.
    pub fn bytes(&self) -> usize {
        self.glb.len()
    }

    /// Writes `room.glb`, and what was ordered beside it: `room.0.exr` …, `room.probes.json`. Each file appears whole or not at all.
    /// Returns their paths, the scene's first.
    ///
    /// # Errors
    /// [`BakeError::Io`]
    pub fn write(&self, path: &Path) -> Result<Vec<PathBuf>, BakeError> {
        let mut paths = vec![path.to_owned()];
        let io = |path: &Path| {
            let path = path.to_owned();
            move |source| BakeError::Io { path, source }
        };
        if let Some(probes) = &self.probes {
            let path = path.with_extension("probes.json");
            write_atomically(&path, |out| out.write_all(probes.as_bytes())).map_err(io(&path))?;
            paths.push(path);
        }
        for (i, map) in self.maps.iter().enumerate() {
            let path = path.with_extension(format!("{i}.exr"));
            map.save(&path, &WriteOptions::default()).map_err(|e| io(&path)(std::io::Error::other(e)))?;
            paths.push(path);
        }
        write_atomically(path, |out| out.write_all(&self.glb)).map_err(io(path))?;
        Ok(paths)
    }
}

fn picture(baked: &Baked, atlas: usize, directional: bool) -> Image {
    let irradiance = &baked.irradiance[atlas];
    let [w, h] = irradiance.size;
    let mut image = Image::from_rgb(w, h, &irradiance.data);
    let mut push = |names: [&str; 3], map: Option<&Map>| {
        for (k, name) in names.into_iter().enumerate() {
            image.push(name, map.map_or(Vec::new(), |m| m.data.iter().map(|v| v[k]).collect()));
        }
    };
    push(["albedo.R", "albedo.G", "albedo.B"], baked.albedo.get(atlas));
    push(["N.X", "N.Y", "N.Z"], baked.normal.get(atlas));
    if directional {
        push(["direction.X", "direction.Y", "direction.Z"], baked.direction.get(atlas));
    }
    image
}
