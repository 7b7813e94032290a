//! A bake from a description to maps.

use std::ops::Range;

use etendue_scene::{RenderSettings, SceneDesc};

use super::fill::{self, Map};
use super::flatten::{Flat, flatten};
use super::layout::Layout;
use super::method::Method;
use super::part::{self, Part};
use super::solve::{Points, Slice, Solution, Solver, Watcher, solve};
use super::spots::{Spot, World, spots};
use super::texels::TexelPoints;
use super::vertices::{VertexLayout, VertexPoints};
use super::{BakeError, BakeOptions, Target, seams};
use crate::classic::physical::{self, MeshOptions};
use crate::denoise::Denoiser;
use crate::integrator::Stage;
use crate::sampler::{Sampler, SamplerKind};
use crate::scene::{self, Scene};
use crate::session::{Cancel, Stop};
use crate::solid::tessellate::SEGMENTS;

/// A scene that is ready to be baked.
pub struct Bake {
    /// The scene in world space.
    pub flat: Flat,
    /// The same, compiled.
    pub scene: Scene,
    /// What gets light.
    pub content: Content,
    /// How it was cut.
    pub options: BakeOptions,
    settings: RenderSettings,
    sampler: Sampler,
    name: String,
}

/// What gets light.
pub enum Content {
    /// Texels and where their light is measured.
    Texels(Layout, Vec<Spot>),
    /// Vertices.
    Vertices(VertexLayout),
}

/// Finished maps.
#[derive(Clone, Debug, Default)]
pub struct Baked {
    /// Irradiance of each atlas, W·m⁻².
    pub irradiance: Vec<Map>,
    /// Share of light that the surface scatters.
    pub albedo: Vec<Map>,
    /// Unit normals of the baked side.
    pub normal: Vec<Map>,
    /// Unit direction from which most light comes.
    pub direction: Vec<Map>,
    /// Irradiance of each point of the vertices.
    pub vertices: Vec<[f32; 3]>,
    /// Texels inside of other bodies.
    pub buried: usize,
}

impl Bake {
    /// Flattens, unwraps and compiles a scene whose meshes are loaded.
    ///
    /// # Errors
    /// [`BakeError`] where a setting or the scene does not allow it.
    pub fn new(desc: &SceneDesc, settings: &RenderSettings, options: &BakeOptions, method: &str) -> Result<Self, BakeError> {
        options.validate()?;
        let meshes;
        let mut lost = Vec::new();
        let desc = if desc.classic.is_some() {
            let segments = settings.tessellation.unwrap_or(SEGMENTS);
            let options = MeshOptions { segments, right_handed: true, ..MeshOptions::default() };
            meshes = physical::meshes(desc, &options).map_err(BakeError::Scene)?;
            let known = desc.report.losses.len();
            lost.extend(meshes.report.losses.iter().skip(known).map(|l| format!("{}: {}", l.feature, l.effect)));
            &meshes
        } else {
            desc
        };
        let mut flat = flatten(desc, options.sides)?;
        flat.notes.extend(lost);
        let mut hidden = flat.desc.clone();
        // Light that comes straight from lights is gathered apart from what integrators find.
        hidden.integrator.hide_lights = true;
        let scene = scene::compile(&hidden, settings, [64, 64]).map_err(BakeError::Faults)?;
        drop(hidden);
        let content = match options.target {
            Target::Texels => {
                let layout = Layout::new(&flat, options)?;
                let spots = spots(&World { scene: &scene, flat: &flat }, &layout);
                Content::Texels(layout, spots)
            }
            Target::Vertices => Content::Vertices(VertexLayout::new(&flat)),
        };
        let kind = match &settings.sampler {
            None => SamplerKind::Sobol,
            Some(name) => SamplerKind::from_name(name).ok_or_else(|| BakeError::Setting(format!("no sampler `{name}`")))?,
        };
        for (name, value) in [("adaptive", settings.adaptive), ("antialias", settings.antialias)] {
            if value.is_some_and(|v| v > 0.0) {
                let message =
                    format!("`{name}` is for pixels: a lightmap takes as many samples in each point, and `noise` stops it by its error");
                return Err(BakeError::Setting(message));
            }
        }
        let spp = settings.spp.unwrap_or(0);
        let stratified = if kind == SamplerKind::Stratified { spp } else { 0 };
        let others = RenderSettings { spp: None, ..settings.clone() };
        let name = format!("{} {method} {stratified} {options:?} {}", desc.content_hash(), others.given());
        Ok(Self {
            flat,
            scene,
            content,
            options: options.clone(),
            settings: settings.clone(),
            sampler: Sampler { kind, seed: settings.seed, spp },
            name,
        })
    }

    /// Solves the scene by a method, as far as that is done before the first point: [`Method::new`].
    ///
    /// # Errors
    /// [`BakeError::Setting`]
    pub fn method(&self, name: &str, gather: bool, stage: &Stage, notes: &mut Vec<String>) -> Result<Method, BakeError> {
        Method::new(name, gather, &self.scene, &self.settings, stage, notes)
    }

    /// Path tracing by the settings.
    pub fn path(&self) -> Method {
        Method::path(&self.settings)
    }

    fn with_points<T>(&self, f: impl FnOnce(&dyn Points) -> T) -> T {
        let world = World { scene: &self.scene, flat: &self.flat };
        match &self.content {
            Content::Texels(layout, spots) => f(&TexelPoints { world, layout, spots }),
            Content::Vertices(layout) => f(&VertexPoints { world, layout, has_solids: self.flat.shapes.iter().any(|s| s.solid) }),
        }
    }

    /// How many points get light.
    pub fn point_count(&self) -> usize {
        self.with_points(|p| p.len())
    }

    /// Writes a checkpoint.
    ///
    /// # Errors
    /// The system's.
    pub fn save(&self, path: &std::path::Path, solution: &Solution) -> std::io::Result<()> {
        part::save(path, &self.name, solution)
    }

    /// Reads a checkpoint.
    ///
    /// # Errors
    /// [`BakeError::Checkpoint`] where it belongs to another scene or other settings; [`BakeError::Io`].
    pub fn load(&self, path: &std::path::Path) -> Result<Solution, BakeError> {
        part::load(path, &self.name, self.point_count())
    }

    /// Samples all points, from what a checkpoint holds on; returns whether no one has cancelled.
    pub fn solve(&self, method: &Method, stop: Stop, solution: &mut Solution, cancel: &Cancel, watcher: &dyn Watcher) -> bool {
        let solver = Solver { scene: &self.scene, method, sampler: self.sampler, stop };
        self.with_points(|points| solve(&solver, points, solution, cancel, watcher))
    }

    /// Samples some points so many times each, as [`Bake::solve`] does them among all; `None` where someone has cancelled.
    pub fn solve_part(&self, method: &Method, points: Range<usize>, spp: u32, cancel: &Cancel, watcher: &dyn Watcher) -> Option<Part> {
        let stop = Stop { spp: Some(spp), ..Stop::default() };
        let solver = Solver { scene: &self.scene, method, sampler: self.sampler, stop };
        self.with_points(|all| {
            let (begin, end) = (points.start.min(all.len()), points.end.min(all.len()));
            let some = Slice { points: all, begin, len: end.saturating_sub(begin) };
            let mut solution = Solution::new(some.len);
            let done = solve(&solver, &some, &mut solution, cancel, watcher);
            done.then(|| Part { name: self.name.clone(), begin: begin as u64, total: all.len() as u64, solution })
        })
    }

    /// The solution that a part of all points is.
    ///
    /// # Errors
    /// [`BakeError::Checkpoint`] where it lacks points, or belongs to another scene or other settings.
    pub fn whole(&self, part: Part) -> Result<Solution, BakeError> {
        let refused = || BakeError::Checkpoint("the part lacks points, or belongs to another scene or other settings".into());
        part.whole(&self.name, self.point_count()).ok_or_else(refused)
    }

    /// What selects the random numbers.
    pub fn seed(&self) -> u64 {
        self.settings.seed
    }

    /// Makes maps of a solution: fills gutters, removes noise where a denoiser is given, and lets the values on both sides of seams agree.
    ///
    /// # Errors
    /// [`BakeError::Denoise`]
    pub fn finish(&self, solution: &Solution, denoiser: Option<&Denoiser>) -> Result<Baked, BakeError> {
        let (layout, spots) = match &self.content {
            Content::Vertices(layout) => {
                let vertices = (0..layout.len()).map(|i| solution.irradiance(i).unwrap_or_default()).collect();
                return Ok(Baked { vertices, ..Baked::default() });
            }
            Content::Texels(layout, spots) => (layout, spots),
        };
        let padding = self.options.padding;
        let points = TexelPoints { world: World { scene: &self.scene, flat: &self.flat }, layout, spots };
        let materials = points.materials();
        let albedo = fill::maps(layout, padding, |i| Some(materials[i].0));
        let normal = fill::maps(layout, padding, |i| Some(materials[i].1));
        let lit = |i: usize| spots[i].lender.map_or(i, |lender| lender as usize);
        let direction = fill::maps(layout, padding, |i| solution.irradiance(lit(i)).map(|_| solution.direction(lit(i)).to_array()));
        let mut irradiance = fill::maps(layout, padding, |i| solution.irradiance(lit(i)));
        // What is filled must not count as measured when it is filled again.
        let refill = |maps: &[Map]| {
            fill::maps(layout, padding, |i| {
                let t = &layout.texels[lit(i)];
                let map = &maps[t.atlas as usize];
                (!spots[lit(i)].is_buried).then(|| map.data[map.index(t.at[0], t.at[1])])
            })
        };
        if let Some(denoiser) = denoiser {
            for (map, normal) in irradiance.iter_mut().zip(&normal) {
                super::clean::denoise(denoiser, map, normal)?;
            }
            irradiance = refill(&irradiance);
        }
        // Gutters are part of what both sides agree on, and stay as they are from here on.
        seams::stitch(&self.flat, layout, &mut irradiance);
        let buried = spots.iter().filter(|s| s.is_buried).count();
        Ok(Baked { irradiance, albedo, normal, direction, vertices: Vec::new(), buried })
    }
}
