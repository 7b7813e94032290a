//! What a scene holds, in figures: for `etendue info`.

use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::Read;

use serde::Serialize;

use super::picture_size::picture_size;
use crate::desc::classic::{self, ClassicScene};
use crate::desc::{AnimationDesc, GeometryDesc, ImageSource, LightDesc, ProjectionDesc, SceneDesc, TextureDesc};
use crate::report::Severity;

/// How much of a picture's file is read to find its size.
const PICTURE_HEAD: u64 = 1 << 18;

/// A picture in figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PictureSummary {
    /// File name, or how it is held.
    pub name: String,
    /// Width in pixels; `None` where it is not known without decoding.
    pub width: Option<u32>,
    /// Height in pixels.
    pub height: Option<u32>,
}

/// A scene in figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Format it was read from.
    pub format: String,
    /// The scene file.
    pub file: String,
    /// Shapes by kind.
    pub shapes: BTreeMap<String, usize>,
    /// Meshes.
    pub meshes: usize,
    /// Triangles of the meshes, each counted once.
    pub triangles: u64,
    /// Vertices of the meshes.
    pub vertices: u64,
    /// Groups of shapes that instances place.
    pub groups: usize,
    /// Instances.
    pub instances: usize,
    /// Triangles of the world with every instance counted.
    pub instanced_triangles: u64,
    /// Scattering models by kind.
    pub bsdfs: BTreeMap<String, usize>,
    /// Textures by kind.
    pub textures: BTreeMap<String, usize>,
    /// Pictures.
    pub pictures: Vec<PictureSummary>,
    /// Participating media.
    pub media: usize,
    /// Lights by kind; `area` counts shapes that emit.
    pub lights: BTreeMap<String, usize>,
    /// Cameras: name and projection.
    pub cameras: Vec<String>,
    /// Animations: name and seconds.
    pub animations: Vec<String>,
    /// Picture size that the file asks for.
    pub film: Option<[u32; 2]>,
    /// Samples per pixel that the file asks for.
    pub spp: Option<u32>,
    /// Integrator that the file asks for; empty for none.
    pub integrator: String,
    /// Longest path that the file asks for, in edges.
    pub max_depth: Option<u32>,
    /// Smallest corner of the world's bounds.
    pub bounds_min: [f32; 3],
    /// Largest corner.
    pub bounds_max: [f32; 3],
    /// Warnings with their places.
    pub warnings: Vec<String>,
    /// What is not honored: place, feature and what happens instead.
    pub losses: Vec<String>,
}

fn count<'a>(names: impl Iterator<Item = &'a str>) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    for name in names {
        *counts.entry(name.to_owned()).or_insert(0) += 1;
    }
    counts
}

impl Summary {
    /// Counts what a description holds. Opens picture files to find their sizes.
    pub fn new(desc: &SceneDesc) -> Self {
        let shapes = count(desc.shapes.iter().map(|s| match s.value.geometry {
            GeometryDesc::Mesh { .. } => "mesh",
            GeometryDesc::Sphere { .. } => "sphere",
            GeometryDesc::Disk => "disk",
            GeometryDesc::Rectangle => "rectangle",
            GeometryDesc::Cube => "cube",
            GeometryDesc::Cylinder { .. } => "cylinder",
            GeometryDesc::Plane => "plane",
            GeometryDesc::Polygon { .. } => "polygon",
        }));
        let of_mesh: Vec<u64> = desc.meshes.iter().map(|m| m.value.data.as_ref().map_or(0, |d| d.triangles.len() as u64)).collect();
        let of_shape = |i: usize| match desc.shapes.get(i).map(|s| &s.value.geometry) {
            Some(GeometryDesc::Mesh { mesh, .. }) => of_mesh.get(mesh.0 as usize).copied().unwrap_or(0),
            _ => 0,
        };
        let of_group: Vec<u64> = desc.groups.iter().map(|g| g.value.shapes.iter().map(|s| of_shape(s.0 as usize)).sum()).collect();
        let grouped: u64 = of_group.iter().sum();
        let placed: u64 = desc.instances.iter().map(|i| of_group.get(i.value.group.0 as usize).copied().unwrap_or(0)).sum();
        let all_shapes: u64 = (0..desc.shapes.len()).map(of_shape).sum();
        let lights = desc.lights.iter().map(|l| match l.value {
            LightDesc::Point { .. } => "point",
            LightDesc::Spot { .. } => "spot",
            LightDesc::Picture { .. } => "picture",
            LightDesc::Directional { .. } => "directional",
            LightDesc::Constant { .. } => "constant",
            LightDesc::Environment { .. } => "environment",
            LightDesc::SunSky(_) => "sunsky",
        });
        let area = desc.shapes.iter().filter(|s| s.value.emission.is_some()).map(|_| "area");
        let textures = count(desc.textures.iter().map(|t| match t.value {
            TextureDesc::Constant { .. } => "constant",
            TextureDesc::Bitmap(_) => "bitmap",
            TextureDesc::Checkerboard { .. } => "checkerboard",
            TextureDesc::Attribute { .. } => "attribute",
            TextureDesc::Multiply { .. } => "multiply",
            TextureDesc::Mix { .. } => "mix",
            TextureDesc::Affine { .. } => "affine",
            TextureDesc::Power { .. } => "power",
            TextureDesc::Solid { .. } => "solid",
            TextureDesc::Projected { .. } => "projected",
            TextureDesc::Facing { .. } => "facing",
        }));
        let cameras = desc.cameras.iter().enumerate().map(|(i, c)| {
            let kind = match &c.value.projection {
                ProjectionDesc::Perspective { aperture_radius, .. } if *aperture_radius > 0.0 => "thin lens",
                ProjectionDesc::Perspective { .. } => "perspective",
                ProjectionDesc::Orthographic { .. } => "orthographic",
                ProjectionDesc::Panoramic => "panoramic",
                ProjectionDesc::Objective(_) => "objective",
            };
            if c.name.is_empty() { format!("{i} ({kind})") } else { format!("{} ({kind})", c.name) }
        });
        let (min, max) = crate::passes::world_bounds(desc);
        let warnings = desc.report.faults.iter().filter(|f| f.severity == Severity::Warning);
        let mut summary = Self {
            format: desc.format.clone(),
            file: desc.files.first().map(|f| f.display().to_string()).unwrap_or_default(),
            shapes,
            meshes: desc.meshes.len(),
            triangles: of_mesh.iter().sum(),
            vertices: desc.meshes.iter().map(|m| m.value.data.as_ref().map_or(0, |d| d.positions.len() as u64)).sum(),
            groups: desc.groups.len(),
            instances: desc.instances.len(),
            instanced_triangles: all_shapes.saturating_sub(grouped) + placed,
            bsdfs: count(desc.bsdfs.iter().map(|b| b.value.type_name())),
            textures,
            pictures: desc.images.iter().map(|i| picture(&i.value.source)).collect(),
            media: desc.media.len(),
            lights: count(lights.chain(area)),
            cameras: cameras.collect(),
            animations: desc.animations.iter().enumerate().map(|(i, a)| animation(i, a)).collect(),
            film: desc.film.width.zip(desc.film.height).map(|(w, h)| [w, h]),
            spp: desc.film.spp,
            integrator: desc.integrator.name.clone(),
            max_depth: desc.integrator.max_depth,
            bounds_min: min.to_array(),
            bounds_max: max.to_array(),
            warnings: warnings.map(|f| format!("{}: {}", f.span.display(&desc.files), f.message)).collect(),
            losses: desc.report.losses.iter().map(|l| format!("{}: {}: {}", l.span.display(&desc.files), l.feature, l.effect)).collect(),
        };
        if let Some(scene) = &desc.classic {
            summary.add_classic(scene);
        }
        summary
    }

    /// Counts the objects of a classic scene, its lights and its pictures.
    fn add_classic(&mut self, scene: &ClassicScene) {
        self.shapes.insert("object".to_owned(), scene.objects.len());
        self.lights.insert("light_source".to_owned(), scene.lights.len());
        self.media = scene.atmosphere.len();
        self.cameras.push(format!("0 ({})", format!("{:?}", scene.camera.kind).to_lowercase()));
        self.pictures.extend(scene.images.iter().filter_map(|i| match &i.source {
            classic::ImageSource::File(path) => Some(picture(&ImageSource::File(path.clone()))),
            classic::ImageSource::Made { .. } => None,
        }));
    }

    /// The figures as JSON.
    pub fn to_json(&self) -> serde_json::Value {
        // A struct of strings, numbers and maps with text keys always has a JSON form.
        serde_json::to_value(self).unwrap_or_default()
    }
}

fn animation(number: usize, animation: &AnimationDesc) -> String {
    let name = if animation.name.is_empty() { number.to_string() } else { animation.name.clone() };
    format!("{name} ({} s)", animation.secs)
}

fn picture(source: &ImageSource) -> PictureSummary {
    let (name, size) = match source {
        ImageSource::File(path) => {
            let mut head = Vec::new();
            let read = File::open(path).and_then(|f| f.take(PICTURE_HEAD).read_to_end(&mut head));
            let name = path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned());
            (name, read.ok().and_then(|_| picture_size(&head)))
        }
        ImageSource::Embedded(bytes) => ("embedded".to_owned(), picture_size(bytes)),
        ImageSource::Pixels { width, height, .. } => ("decoded".to_owned(), Some((*width, *height))),
    };
    PictureSummary { name, width: size.map(|s| s.0), height: size.map(|s| s.1) }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |counts: &BTreeMap<String, usize>| {
            let total: usize = counts.values().sum();
            let parts: Vec<String> = counts.iter().map(|(name, n)| format!("{n} {name}")).collect();
            if parts.is_empty() { "0".to_owned() } else { format!("{total} ({})", parts.join(", ")) }
        };
        writeln!(f, "{} ({})", self.file, self.format)?;
        writeln!(f, "shapes      {}", list(&self.shapes))?;
        writeln!(f, "meshes      {} ({} triangles, {} vertices)", self.meshes, self.triangles, self.vertices)?;
        if self.instances > 0 {
            writeln!(f, "instances   {} of {} groups ({} triangles in all)", self.instances, self.groups, self.instanced_triangles)?;
        }
        writeln!(f, "bsdfs       {}", list(&self.bsdfs))?;
        writeln!(f, "textures    {}", list(&self.textures))?;
        for p in &self.pictures {
            match p.width.zip(p.height) {
                Some((w, h)) => writeln!(f, "  {} {w} × {h}", p.name)?,
                None => writeln!(f, "  {}", p.name)?,
            }
        }
        if self.media > 0 {
            writeln!(f, "media       {}", self.media)?;
        }
        writeln!(f, "lights      {}", list(&self.lights))?;
        writeln!(f, "cameras     {}", if self.cameras.is_empty() { "0".to_owned() } else { self.cameras.join(", ") })?;
        if !self.animations.is_empty() {
            writeln!(f, "animations  {}", self.animations.join(", "))?;
        }
        let film = self.film.map_or_else(|| "not said".to_owned(), |[w, h]| format!("{w} × {h}"));
        let spp = self.spp.map_or(String::new(), |n| format!(", {n} samples per pixel"));
        writeln!(f, "film        {film}{spp}")?;
        let depth = self.max_depth.map_or(String::new(), |d| format!(", max depth {d}"));
        writeln!(f, "integrator  {}{depth}", if self.integrator.is_empty() { "not said" } else { &self.integrator })?;
        let [a, b] = [self.bounds_min, self.bounds_max];
        writeln!(f, "bounds      ({}, {}, {}) to ({}, {}, {})", a[0], a[1], a[2], b[0], b[1], b[2])?;
        for (title, lines) in [("warnings", &self.warnings), ("losses", &self.losses)] {
            if !lines.is_empty() {
                writeln!(f, "{title:<11} {}", lines.len())?;
                for line in lines {
                    writeln!(f, "  {line}")?;
                }
            }
        }
        Ok(())
    }
}

/// What a scene holds, as text.
pub fn summary(desc: &SceneDesc) -> String {
    Summary::new(desc).to_string()
}
