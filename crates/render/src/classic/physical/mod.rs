//! Scenes of the classic model as physics: what every integrator but `whitted` sees of a POV-Ray scene.
//!
//! The exact solids stay as they are; a [`Surface`] remembers where on them it is. Finishes become scattering models ([`shade`]), light
//! sources become lights of the same brightness where the camera looks ([`lower`]), the sky becomes an environment, interiors
//! that fade become absorbing media. What only makes sense in the classic model is left out: the ambient term, reflection without
//! light, lights without shadows beside others (docs/guide/formats-pov.md has the list).

mod lower;
mod meshes;
mod shade;

pub(crate) use lower::camera;
pub use meshes::{MeshOptions, meshes};

use std::collections::HashMap;
use std::sync::Arc;

use etendue_procedural::{Context, Finish, Texture, TextureFill};
use etendue_scene::Loss;
use etendue_scene::desc::classic::{Camera, ClassicScene, Interior, Object as Solid};
use etendue_scene::desc::{Color, Param, SceneDesc};
use glam::{DVec2, DVec3};

use super::ClassicWorld;
use super::trace::NEAR;
use crate::accel::Ray;
use crate::camera::CameraRay;
use crate::light::{EnvironmentLight, Rows};
use crate::math::{Aabb, Frame, Mat4, Vec2, Vec3};
use crate::medium::{Homogeneous, Medium, Phase};
use crate::scene::geometry::{Emission, NONE, Object};
use crate::scene::{Scene, Surface};
use crate::solid::{Crossing, Line, RayKind, SolidHit};

/// Columns and rows of the picture that stands for a sky.
const SKY: [usize; 2] = [1024, 512];

/// Surfaces beyond this are not there: densities of lights seen from there, squared, would leave the
/// range of `f32`.
const FARTHEST: f64 = 1e8;

/// Where on the solids a surface point is.
#[derive(Clone, Copy, Debug)]
pub struct SolidPoint {
    leaf: u32,
    crossing: Crossing,
    p: DVec3,
    /// Unit direction of the ray that found it.
    d: DVec3,
}

/// The solids of a scene for physical light transport.
pub struct Physical {
    classic: ClassicWorld,
    /// Object, in the world's geometry, of the first leaf; the other leaves' follow.
    first_object: u32,
    /// The camera has no physical counterpart: its rays are those of the classic model.
    has_own_rays: bool,
}

impl Physical {
    /// Prepares the solids. Sentences about pictures that cannot be read come with them.
    pub(crate) fn new(scene: &ClassicScene, size: [u32; 2]) -> (Self, Vec<String>) {
        // Light between surfaces is what the integrators are for.
        let mut scene = scene.clone();
        scene.settings.radiosity = None;
        scene.settings.photons = None;
        let (classic, warnings) = ClassicWorld::new(&scene, size);
        let has_own_rays = !lower::is_flat(&scene.camera);
        (Self { classic, first_object: 0, has_own_rays }, warnings)
    }

    /// Lights and camera as a description, with what is not kept of them.
    ///
    /// # Errors
    /// A sentence for cameras that only the classic model has.
    pub(crate) fn lower(&self, size: [u32; 2]) -> Result<(SceneDesc, Vec<Loss>), String> {
        lower::lower(&self.classic.scene, self.focus(size), size)
    }

    /// Whether rays of the camera can be made, but places in the picture of points in space cannot be told.
    pub(crate) fn has_own_rays(&self) -> bool {
        self.has_own_rays
    }

    /// Looks from another camera, for a picture of a size.
    pub(crate) fn set_camera(&mut self, camera: Camera, size: [u32; 2]) {
        self.has_own_rays = !lower::is_flat(&camera);
        self.classic.set_camera(camera, size);
    }

    /// A ray of the camera, in place of the one of the flat camera that stands for it.
    pub(crate) fn camera_ray(&self, flat: CameraRay) -> CameraRay {
        if !self.has_own_rays {
            return flat;
        }
        let [picture, lens] = [flat.picture, flat.u_lens].map(|v| v.as_dvec2());
        match self.classic.rays.line(&self.classic, picture, lens) {
            Some(line) => {
                let t_max = self.classic.rays.max_distance() as f32;
                let ray = Ray { o: line.o.as_vec3(), d: line.d.as_vec3().normalize_or(Vec3::Z), t_min: 0.0, t_max };
                CameraRay { ray, ..flat }
            }
            None => CameraRay { ray: Ray { t_max: 0.0, ..flat.ray }, weight: 0.0, ..flat },
        }
    }

    /// What the picture is about: the surface of middle distance among those that a grid of camera rays meets, else the middle of what has
    /// bounds.
    fn focus(&self, size: [u32; 2]) -> DVec3 {
        const GRID: u32 = 7;
        let at = |i: u32, n: u32| (f64::from(i) + 0.5) / f64::from(GRID) * f64::from(n);
        let points = (0..GRID * GRID).map(|i| DVec2::new(at(i % GRID, size[0]), at(i / GRID, size[1])));
        let mut hits: Vec<(f64, DVec3)> = points
            .filter_map(|q| self.classic.rays.line(&self.classic, q, DVec2::splat(0.5)))
            .filter_map(|line| self.classic.world.nearest(&line, NEAR, FARTHEST, RayKind::Camera).map(|hit| (hit.t, hit.p)))
            .collect();
        hits.sort_by(|a, b| a.0.total_cmp(&b.0));
        let camera = &self.classic.scene.camera;
        let bounds = self.classic.world.finite_bounds();
        match hits.get(hits.len() / 2) {
            Some((_, p)) => *p,
            None if bounds.is_empty() => camera.location + camera.direction.normalize_or(DVec3::Z),
            None => (bounds.min + bounds.max) * 0.5,
        }
    }

    /// A box around everything that has a finite one.
    pub(crate) fn bounds(&self) -> Aabb {
        let b = self.classic.world.finite_bounds();
        if b.is_empty() { Aabb::EMPTY } else { Aabb { min: b.min.as_vec3(), max: b.max.as_vec3() } }
    }

    /// Whether some surfaces have no finite box.
    pub(crate) fn is_endless(&self) -> bool {
        self.classic.world.is_endless()
    }

    /// Adds an object for each leaf, so that surfaces have emission, interiors and numbers like all others. `material` is what surfaces
    /// without solid would have.
    pub(crate) fn add_objects(&mut self, objects: &mut Vec<Object>, media: &mut Vec<Medium>, material: u32) {
        self.first_object = objects.len() as u32;
        let mut known: HashMap<*const Interior, u32> = HashMap::new();
        for (i, solid) in (0u32..).zip(self.classic.world.leaf_objects()) {
            let interior = solid.interior.as_ref().map_or(NONE, |interior| {
                *known.entry(Arc::as_ptr(interior)).or_insert_with(|| match absorption(interior) {
                    Some(sigma_a) => {
                        let zero = [0.0; 3];
                        media.push(Medium::Homogeneous(Homogeneous::new(sigma_a, zero, zero, Phase::Isotropic)));
                        media.len() as u32 - 1
                    }
                    None => NONE,
                })
            });
            let white: Color = Param::Constant([1.0; 3]);
            let emission =
                (self.classic.world.has_own_textures(i) || glows(solid)).then_some(Emission { radiance: white, two_sided: true, group: 0 });
            objects.push(Object {
                name: String::new(),
                first_primitive: NONE,
                first_vertex: 0,
                normals: NONE,
                uvs: NONE,
                tangents: NONE,
                attributes: Vec::new(),
                material,
                first_light: NONE,
                emission,
                interior,
                exterior: NONE,
                id: self.first_object + i + 1,
                flip_normals: false,
                wants_tangents: false,
            });
        }
    }

    /// The environment that shines where a ray meets nothing; `None` where that is black.
    pub(crate) fn environment(&self) -> Option<EnvironmentLight> {
        let scene = &self.classic.scene;
        if scene.sky.is_none() && scene.background.is_none_or(|b| b.rgb == DVec3::ZERO) {
            return None;
        }
        let [width, height] = if scene.sky.is_some() { SKY } else { [1, 1] };
        let texel = |i: usize| {
            let (u, v) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let (d, _) = EnvironmentLight::direction_from_uv(Vec2::new((u / width as f64) as f32, (v / height as f64) as f32));
            let (color, _) = self.classic.sky(d.as_dvec3());
            self.classic.space.linear_rgb(color).as_vec3().to_array()
        };
        let texels: Vec<[f32; 3]> = (0..width * height).map(texel).collect();
        let is_black = texels.iter().flatten().all(|&v| !(v > 0.0));
        if is_black { None } else { EnvironmentLight::new((width, height), texels, [1.0; 3], Mat4::IDENTITY, Rows::Centered) }
    }

    /// The nearest surface along a ray.
    pub(crate) fn intersect(&self, scene: &Scene, ray: &Ray) -> Option<Surface> {
        self.find(scene, ray, RayKind::Photon)
    }

    /// The nearest surface that stands in the way of light.
    pub(crate) fn intersect_shadow(&self, scene: &Scene, ray: &Ray) -> Option<Surface> {
        self.find(scene, ray, RayKind::Shadow)
    }

    fn find(&self, scene: &Scene, ray: &Ray, kind: RayKind) -> Option<Surface> {
        let scale = f64::from(ray.d.length());
        let line = Line { o: ray.o.as_dvec3(), d: ray.d.as_dvec3() / scale };
        let t_min = NEAR.max(f64::from(ray.t_min) * scale);
        let t_max = (f64::from(ray.t_max) * scale).min(FARTHEST);
        let hit = self.classic.world.nearest(&line, t_min, t_max, kind)?;
        Some(self.surface(scene, &line, &hit, (hit.t / scale) as f32))
    }

    fn surface(&self, scene: &Scene, line: &Line, hit: &SolidHit<'_>, t: f32) -> Surface {
        let (p, n) = (hit.p.as_vec3(), hit.n.as_vec3().normalize_or(Vec3::Z));
        let frame = Frame::from_normal(n);
        let object = self.first_object + hit.leaf;
        Surface {
            p,
            ng: self.classic.world.geometric_normal(hit).as_vec3().normalize_or(n),
            frame,
            uv: Vec2::new(hit.uv.x as f32, hit.uv.y as f32),
            dpdu: frame.s,
            dpdv: frame.t,
            bary: Vec2::ZERO,
            t,
            instance: 0,
            geometry: 0,
            object,
            primitive: 0,
            material: scene.geometries[0].objects[object as usize].material,
            footprint: 0.0,
            solid: Some(SolidPoint { leaf: hit.leaf, crossing: hit.crossing, p: hit.p, d: line.d }),
        }
    }

    /// What a point on the solids was hit as.
    fn hit(&self, at: &SolidPoint) -> SolidHit<'_> {
        self.classic.world.revisit(at.leaf, &Line { o: at.p, d: at.d }, at.crossing)
    }

    /// Where textures are evaluated.
    fn context<'a>(&'a self, hit: &SolidHit<'_>, n: DVec3, d: DVec3) -> Context<'a> {
        Context { normal: n, ray: d, uv: hit.uv, ..self.classic.context(hit.p) }
    }
}

/// Whether a surface of the object may give light by itself.
fn glows(object: &Solid) -> bool {
    let mut left = 10_000;
    [&object.texture, &object.interior_texture].into_iter().flatten().any(|t| texture_glows(t, &mut left))
}

/// Light that a finish gives by itself. The ambient term stands for light from all around, which is computed here; only where there
/// is no other light of the surface does it mean a glow.
fn glow(finish: &Finish) -> DVec3 {
    let is_lamp = finish.diffuse == 0.0 && finish.diffuse_back == 0.0;
    if is_lamp { finish.emission + finish.ambient } else { finish.emission }
}

fn texture_glows(texture: &Texture, left: &mut u32) -> bool {
    *left = left.saturating_sub(1);
    if *left == 0 {
        // Better asked too often than not.
        return true;
    }
    match texture {
        Texture::Layers(layers) => layers.iter().any(|l| glow(&l.finish) != DVec3::ZERO),
        Texture::Patterned(patterned) => match &patterned.fill {
            TextureFill::Textures(map) => map.entries.iter().any(|(_, t)| texture_glows(t, left)),
            TextureFill::List(list) | TextureFill::Image(_, list) => list.iter().any(|t| texture_glows(t, left)),
        },
    }
}

/// Absorption per unit of length that leaves at the fade distance what the interior leaves there.
fn absorption(interior: &Interior) -> Option<[f32; 3]> {
    if interior.fade_distance == 0.0 || interior.fade_power == 0.0 {
        return None;
    }
    let d = interior.fade_distance.abs();
    let left = super::refract::attenuation(interior, d).clamp(DVec3::splat(1e-6), DVec3::ONE);
    Some(left.to_array().map(|v| (-libm::log(v) / d) as f32))
}
