//! What the methods with photons take from the settings, and how they come by a photon map.

use std::path::PathBuf;

use etendue_scene::RenderSettings;

use super::Stage;
use super::volume_emission::VolumeEmission;
use crate::light::{Light, SceneSphere};
use crate::math::{Vec2, Vec3, hash::hash_words};
use crate::photon::tree::Neighbors;
use crate::photon::{Contents, MapInfo, Photon, PhotonMap, PhotonTree, estimate};
use crate::sampler::{Sampler, SamplerKind};
use crate::scene::Scene;

/// Photons of a map where nobody says.
pub const DEFAULT_PHOTONS: u32 = 1_000_000;
/// Photons that an estimate of a map looks at where nobody says.
const DEFAULT_NEIGHBORS: u32 = 64;
/// Photons that a medium's estimate is meant to find along a ray of the length of the scene.
const VOLUME_NEIGHBORS: usize = 12;
/// Reach in scenes without end, over the distance from the middle.
const MOST_OF_DISTANCE: f32 = 0.3;
/// Photons looked at to find the scale of a map.
const PROBES: u64 = 256;

/// The settings.
#[derive(Clone, Debug)]
pub struct PhotonSettings {
    /// Number of photons.
    pub photons: Option<u32>,
    /// Farthest reach of estimates, in scene units; where not given it is found from the scene.
    pub radius: Option<f32>,
    /// Photons that an estimate looks at.
    pub neighbors: Option<u32>,
    /// Most memory for photons, in bytes.
    pub memory: u64,
    /// Light of homogeneous media comes from beams instead of points.
    pub beams: bool,
    /// A map that has been traced before.
    pub map: Option<PathBuf>,
    /// Longest path in scattering events.
    pub max_depth: Option<u32>,
    /// Scattering events after which Russian roulette may end a path from the camera.
    pub rr_depth: u32,
}

/// Farthest reach of estimates at a place.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// Within the scene's sphere.
    pub near: f32,
    about: SceneSphere,
    grows: bool,
}

impl Reach {
    /// At a point. Around the sphere of scenes without end photons are as rare as the cube of the distance ([`SceneSphere::sample_across`]).
    #[inline]
    pub fn at(&self, p: Vec3) -> f32 {
        if !(self.grows && self.about.endless) {
            return self.near;
        }
        let radii = (p.distance(self.about.center) / self.about.radius).max(1.0);
        let farthest = (MOST_OF_DISTANCE * self.about.radius * radii).max(self.near);
        (self.near * radii * radii.sqrt()).min(farthest)
    }
}

impl PhotonSettings {
    /// From the settings of a picture.
    ///
    /// # Errors
    /// A sentence about numbers that are out of range.
    pub fn new(settings: &RenderSettings, max_depth: Option<u32>, rr_depth: u32) -> Result<Self, String> {
        if settings.photons == Some(0) {
            return Err("`photons` must be at least 1".into());
        }
        if settings.photon_radius.is_some_and(|r| !(r > 0.0)) {
            return Err("`photon_radius` must be above 0".into());
        }
        let most = crate::photon::tree::MAX_NEIGHBORS as u32;
        if settings.photon_neighbors.is_some_and(|n| n == 0 || n > most) {
            return Err(format!("`photon_neighbors` must be 1 to {most}"));
        }
        Ok(Self {
            photons: settings.photons,
            radius: settings.photon_radius,
            neighbors: settings.photon_neighbors,
            memory: u64::from(settings.photon_memory) << 20,
            beams: settings.photon_beams,
            map: settings.photon_map.as_ref().map(PathBuf::from),
            max_depth,
            rr_depth,
        })
    }

    /// Farthest reach of estimates.
    pub fn reach(&self, scene: &Scene) -> Reach {
        Reach { near: self.radius.unwrap_or_else(|| estimate::default_radius(scene)), about: scene.sphere(), grows: self.radius.is_none() }
    }

    /// Photons that an estimate looks at.
    pub fn count(&self) -> usize {
        self.neighbors.unwrap_or(DEFAULT_NEIGHBORS) as usize
    }

    /// Longest path in scattering events.
    pub fn depth(&self) -> u32 {
        self.max_depth.unwrap_or(u32::MAX)
    }

    /// Whether a photon may be seen after `depth` scattering events from the camera.
    #[inline]
    pub fn accepts(&self, photon: &Photon, depth: u32) -> bool {
        self.max_depth.is_none_or(|most| photon.depth() + depth < most)
    }

    /// The map of the settings' file, or one traced now. `notes` gets sentences about it.
    ///
    /// # Errors
    /// A sentence where the file cannot be read or is of another scene, or the scene has media that emit without end.
    pub fn map(&self, scene: &Scene, stage: &Stage, notes: &mut Vec<String>) -> Result<PhotonMap, String> {
        check(scene)?;
        let mut map = match &self.map {
            Some(path) => {
                let map = PhotonMap::load(path, self.memory).map_err(|e| format!("{}: {e}", path.display()))?;
                if scene.light_hash.as_ref() != Some(&map.info.scene_hash) {
                    return Err(format!("{}: the photon map is of another scene", path.display()));
                }
                if map.info.max_depth != self.max_depth {
                    let say = |d: Option<u32>| d.map_or("any length".to_owned(), |d| format!("at most {d} edges"));
                    notes.push(format!(
                        "the photon map has paths of {}, the picture asks for {}",
                        say(map.info.max_depth),
                        say(self.max_depth)
                    ));
                }
                if map.traced() == 0 {
                    return Err(format!("{}: the photon map holds no photons", path.display()));
                }
                map
            }
            None => {
                let info = MapInfo { scene_hash: String::new(), seed: stage.seed, max_depth: self.max_depth };
                let mut map = PhotonMap::new(info);
                let count = u64::from(self.photons.unwrap_or(DEFAULT_PHOTONS));
                map.trace(scene, 0..count, self.memory, stage.is_cancelled, &mut |_, f| (stage.progress)("tracing photons", f));
                map
            }
        };
        map.limit(self.memory);
        notes.push(describe(&map.contents()));
        notes.extend(limits(scene));
        Ok(map)
    }
}

/// A sentence about a map.
pub fn describe(map: &Contents) -> String {
    let (surface, volume) = (map.surface, map.volume);
    let mut text = format!("{} photons left {surface} records on surfaces", map.traced());
    if volume > 0 {
        text += &format!(" and {volume} in media");
    }
    text += &format!(" ({:.1} MiB)", map.bytes() as f64 / f64::from(1 << 20));
    if map.level > 0 {
        text += &format!("; to fit into the memory one of {} was kept", 1u64 << map.level);
    }
    text
}

/// Whether photons can carry all light of media.
///
/// # Errors
/// A sentence about media that emit and have no end.
pub fn check(scene: &Scene) -> Result<(), String> {
    VolumeEmission::new(scene).map(|_| ())
}

/// Sentences about light of this scene that photons do not carry.
pub fn limits(scene: &Scene) -> Vec<String> {
    let mut notes = Vec::new();
    let endless = |l: &Light| matches!(l, Light::Area(a) if !a.area().is_finite());
    if scene.lights.iter().any(endless) {
        notes.push("photons do not leave infinite planes that emit: their light on diffuse surfaces is missing".into());
    }
    notes
}

/// A radius for the estimates along rays in media: about as far as so many neighbors of typical photons are.
pub fn volume_radius(scene: &Scene, tree: &PhotonTree, seed: u64) -> f32 {
    let reach = 0.1 * scene.sphere().radius;
    if tree.is_empty() {
        return reach;
    }
    median_distance(tree, VOLUME_NEIGHBORS, reach, seed).max(1e-6 * scene.sphere().radius)
}

/// The distance, up to `reach`, within which a typical photon of a tree has so many others. The tree must not be empty.
pub fn median_distance(tree: &PhotonTree, neighbors: usize, reach: f32, seed: u64) -> f32 {
    let sampler = Sampler { kind: SamplerKind::Independent, seed: hash_words([seed, u64::from_le_bytes(*b"probes\0\0")]), spp: 0 };
    let mut found = Neighbors::new();
    let mut distances: Vec<f32> = (0..PROBES as u32)
        .map(|i| {
            let u: Vec2 = sampler.stream(0, 0, i).next_2d();
            let photon = tree.photon((u.x * tree.len() as f32) as u32 % tree.len() as u32);
            tree.nearest(photon.position(), neighbors, reach, |_| true, &mut found).sqrt()
        })
        .collect();
    distances.sort_by(f32::total_cmp);
    distances[distances.len() / 2]
}
