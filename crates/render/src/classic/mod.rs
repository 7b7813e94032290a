//! The classic shading model: Whitted's I = Ic + ks·Is + kt·It with the finishes, interiors, fogs, media and skies of POV-Ray's
//! documentation, over exact [`crate::solid`]s.
//!
//! ```text
//! camera → trace: nearest hit ─→ surface: textures → lit layers, mirrored and refracted rays → trace …
//!                     │                                  ↑ lights ← shadow: what surfaces and interiors on the way let through
//!                     └─→ sky                       then: interior fading, media, fog, rainbow along the ray
//! ```
//!
//! All of it in double precision and in the scene's working space; samples become linear light at the end ([`WorkingSpace`]).
//! Where the documentation gives no formula, it was found by measuring pictures of POV-Ray 3.7, as the comments say.

mod atmosphere;
mod camera;
mod finish;
mod gamma;
mod images;
mod light;
mod losses;
mod media;
mod mesh_camera;
mod photons;
pub mod physical;
mod radiosity;
mod refract;
mod shadow;
mod surface;
mod trace;

pub use gamma::WorkingSpace;
pub(crate) use images::NotedPictures;
pub use losses::losses;

use std::sync::Arc;

use etendue_procedural::{Context, Inside, ObjectId};
use etendue_scene::RenderSettings;
use etendue_scene::desc::SceneDesc;
use etendue_scene::desc::classic::{Camera, ClassicScene, GlobalSettings};
use glam::{DVec2, DVec3};

use crate::math::Vec3;
use crate::sampler::SampleStream;
use crate::solid::{Outlook, World};
use crate::spectrum::Spectrum;
use camera::Rays;
use images::Pictures;
use light::Lamp;
use refract::{Stack, Within};
use trace::Tracer;

use crate::integrator::{Estimate, FirstHit};

/// Whether a classic scene is to be rendered by its own shading model: the default, by the name `whitted`.
pub fn is_asked_for(desc: &SceneDesc, settings: &RenderSettings) -> bool {
    let name = settings.integrator.as_deref().unwrap_or(&desc.integrator.name);
    desc.classic.is_some() && matches!(name, "whitted" | "")
}

/// A scene of the classic model, ready to be rendered.
pub struct ClassicWorld {
    scene: Arc<ClassicScene>,
    world: World,
    rays: Rays,
    lamps: Vec<Lamp>,
    /// Lamps that light a light group, by its number; the first set is for objects without group.
    lamps_of_group: Vec<Vec<u32>>,
    pictures: Pictures,
    pattern_objects: Vec<World>,
    space: WorkingSpace,
    radiosity: Option<radiosity::Cache>,
    photons: Option<photons::PhotonLight>,
    /// The camera's place and what it is inside of: where most camera rays begin.
    around_camera: Option<(DVec3, Stack)>,
    /// What is seen from the camera's place.
    outlook: Option<Outlook>,
}

/// Each outlook takes memory; scenes with more lamps have dim ones.
const LAMPS_THAT_LOOK_AROUND: usize = 64;

impl ClassicWorld {
    /// Prepares a scene for a picture of a size. Pictures that cannot be read are returned as sentences and are black; so is what is said of photons.
    pub fn new(scene: &ClassicScene, size: [u32; 2]) -> (Self, Vec<String>) {
        let space = WorkingSpace::new(&scene.settings);
        let (pictures, mut faults) = Pictures::load(&scene.images, &scene.settings, space);
        let world = World::with_images(&scene.objects, Some(&pictures));
        let mut lamps: Vec<Lamp> = scene.lights.iter().map(Lamp::new).collect();
        lamps.iter_mut().take(LAMPS_THAT_LOOK_AROUND).for_each(|l| l.look_around(&world));
        let pattern_objects = scene.pattern_objects.iter().map(|o| World::with_images(std::slice::from_ref(o), Some(&pictures))).collect();
        let lamps_of_group = light::sets(scene);
        let rays = Rays::new(scene.camera.clone(), size);
        let mut made = Self {
            scene: Arc::new(scene.clone()),
            world,
            rays,
            lamps,
            lamps_of_group,
            pictures,
            pattern_objects,
            space,
            radiosity: None,
            photons: None,
            around_camera: None,
            outlook: None,
        };
        if let Some(settings) = &scene.settings.photons {
            made.photons = photons::PhotonLight::build(&made, settings);
            faults.extend(made.photons.as_ref().and_then(photons::PhotonLight::warning));
        }
        made.adapt_to_camera(size);
        (made, faults)
    }

    /// Looks at the world with another camera, for a picture of a size.
    pub fn set_camera(&mut self, camera: Camera, size: [u32; 2]) {
        let is_same = self.rays.is_of(&camera, size);
        if is_same {
            return;
        }
        self.rays = Rays::new(camera, size);
        self.adapt_to_camera(size);
    }

    /// Finds out what depends on the camera: what it is inside of, and the light gathered for its picture.
    fn adapt_to_camera(&mut self, size: [u32; 2]) {
        let location = self.rays.location();
        self.around_camera = Some((location, self.around(location)));
        self.outlook = self.world.outlook(location);
        self.radiosity = None;
        if let Some(settings) = &self.scene.settings.radiosity {
            self.radiosity = Some(radiosity::Cache::build(self, settings, size));
        }
    }

    fn settings(&self) -> &GlobalSettings {
        &self.scene.settings
    }

    /// What a point is inside of.
    fn around(&self, p: DVec3) -> Stack {
        let mut inside = Stack::new();
        self.world.containing(p, &mut |object, whole| inside.push(Within::new(object, whole, None)));
        inside
    }

    /// Where textures are evaluated: a bare point, with what evaluation needs.
    fn context(&self, p: DVec3) -> Context<'_> {
        let settings = self.settings();
        Context {
            images: Some(&self.pictures),
            inside: Some(self),
            noise_generator: settings.noise_generator,
            number_of_waves: settings.number_of_waves,
            ..Context::at(p)
        }
    }

    /// Whether a point on the lens matters.
    pub fn needs_lens(&self) -> bool {
        self.rays.needs_lens()
    }

    /// One sample: the light that comes through a point of the picture (in pixels) and of the lens.
    pub fn estimate(&self, picture: DVec2, lens: DVec2, max_level: Option<u32>, stream: &mut SampleStream, out: &mut Estimate) {
        let Some(line) = self.rays.line(self, picture, lens) else { return };
        let mut tracer = Tracer::new(self, stream, max_level);
        (tracer.wants_first, tracer.wants_uv) = (!out.forgoes_first, out.wants_uv);
        let traced = tracer.camera_ray(line, self.rays.max_distance());
        let spectrum = |c: DVec3| Spectrum::from_rgb([c.x as f32, c.y as f32, c.z as f32]);
        let is_own = out.wants_own && out.groups.len() <= 1;
        if is_own {
            out.radiance = spectrum(traced.color);
            out.is_own = true;
        } else {
            out.add(spectrum(self.space.linear_rgb(traced.color)), 0);
        }
        out.alpha = traced.alpha as f32;
        if let Some(first) = tracer.first {
            let albedo = self.space.linear_rgb(first.albedo);
            out.first = Some(FirstHit {
                p: first.p.as_vec3(),
                ns: first.n.as_vec3(),
                uv: first.uv.as_vec2(),
                depth: first.depth as f32,
                albedo: Spectrum::from_rgb(Vec3::new(albedo.x as f32, albedo.y as f32, albedo.z as f32).to_array()),
                object: first.leaf + 1,
                material: first.leaf + 1,
            });
        }
    }
}

impl Inside for ClassicWorld {
    fn inside(&self, object: ObjectId, p: DVec3) -> bool {
        self.pattern_objects.get(object as usize).is_some_and(|world| world.inside(p))
    }
}

/// Largest component.
fn peak(c: DVec3) -> f64 {
    c.x.max(c.y).max(c.z)
}

/// Brightness as POV-Ray weighs it: 0.297 of red was measured in gathered light with `gray_threshold 1`.
fn gray(c: DVec3) -> f64 {
    0.297 * c.x + 0.589 * c.y + 0.114 * c.z
}
