//! The compiled scene: flat arrays that no one changes after [`compile`].

mod compile;
mod curvature;
mod displacement;
pub mod geometry;
mod losses;
mod names;
pub mod surface;
mod view;

pub use compile::compile;
pub(crate) use compile::vertex_normals;
pub use displacement::{DISPLACED_LIMIT, Displaced, bake_displacement, displace};
pub use losses::losses;
pub use names::Names;
pub use surface::Surface;
pub use view::View;

use etendue_scene::desc::{Color, Param, Scalar, TextureId};

use crate::accel::{Accel, Hit, Ray};
use crate::camera::{Camera, CameraRay};
use crate::classic::ClassicWorld;
use crate::classic::physical::Physical;
use crate::light::{EnvironmentVisibility, Light, LightSample, LightSampler, SceneSphere};
use crate::material::Material;
use crate::math::{Aabb, Vec2, Vec3};
use crate::medium::{Medium, MediumStack};
use crate::spectrum::Spectrum;
use crate::texture::Texture;
use geometry::{Geometry, Placement};

/// The primitive that an area light is made of; all of them are in the world's geometry.
#[derive(Clone, Copy, Debug)]
pub struct LightSource {
    /// Object in the world's geometry.
    pub object: u32,
    /// Primitive in the world's geometry.
    pub primitive: u32,
}

/// Everything that an integrator looks at. `Send + Sync`, immutable.
pub struct Scene {
    /// What hierarchies were built from: the first is the world, the others are instanced groups.
    pub geometries: Vec<Geometry>,
    /// Placed geometries; a hit's `instance` is an index here.
    pub placements: Vec<Placement>,
    /// The hierarchy.
    pub accel: Accel,
    /// Materials; the index is the description's `BsdfId`, and the last one is the default.
    pub materials: Vec<Material>,
    /// Textures; the index is the description's `TextureId`.
    pub textures: Vec<Texture>,
    /// All lights.
    pub lights: Vec<Light>,
    /// What each area light is part of: its light's `emission_id` is an index here.
    pub light_sources: Vec<LightSource>,
    /// Middle and radius of each light that has a place; empty where none has, or no path can be in a medium.
    pub light_places: Vec<Option<(Vec3, f32)>>,
    /// Light group of each light.
    pub light_groups: Vec<u32>,
    /// Names of the light groups; the first is the unnamed one.
    pub group_names: Vec<String>,
    /// Lights that surround the scene: indices into `lights`.
    pub infinite_lights: Vec<u32>,
    /// Chooses lights for next-event estimation.
    pub light_sampler: LightSampler,
    /// What is seen of the environment map, where there is one, from where.
    pub environment_visibility: Option<EnvironmentVisibility>,
    /// Media: the index is the description's `MediumId`.
    pub media: Vec<Medium>,
    /// Whether any path can be in a medium: where not, no one need look.
    pub has_media: bool,
    /// What the camera is in.
    pub camera_medium: MediumStack,
    /// The camera.
    pub camera: Camera,
    /// The view that replaces the file's camera ([`Scene::look`]); `None`: the file's own.
    pub view: Option<View>,
    /// Box of all bounded geometry.
    pub bounds: Aabb,
    /// Whether surfaces without end reach beyond `bounds`.
    pub endless: bool,
    /// Whether any material lets light straight through, so that shadow rays must look.
    pub has_null: bool,
    /// Texture look-ups fit the footprints of rays.
    pub mipmap: bool,
    /// Lights do not show where the camera looks at them.
    pub hide_lights: bool,
    /// The scene of the classic model, where `whitted` is to render one; all else is then empty.
    pub classic: Option<Box<ClassicWorld>>,
    /// The solids of a classic scene for all other integrators.
    pub solids: Option<Box<Physical>>,
    /// Names what light depends on (`SceneDesc::light_hash`), where the settings name a photon map that must be of the same.
    pub light_hash: Option<String>,
    /// Sentences about what could not be loaded and is left out.
    pub warnings: Vec<String>,
}

impl Scene {
    /// The sphere around everything bounded: what infinite lights shine on.
    pub fn sphere(&self) -> SceneSphere {
        let (center, radius) = self.bounds.bounding_sphere();
        let endless = self.endless;
        if radius.is_finite() && radius > 0.0 {
            SceneSphere { center, radius, endless }
        } else {
            SceneSphere { center: Vec3::ZERO, radius: 1.0, endless }
        }
    }

    /// The medium that a path is in; `None` in empty space.
    #[inline]
    pub fn medium(&self, stack: &MediumStack) -> Option<&Medium> {
        self.media.get(stack.top() as usize)
    }

    /// A texture by its id.
    #[inline]
    pub fn texture(&self, id: TextureId) -> &Texture {
        &self.textures[id.0 as usize]
    }

    /// The color of a parameter at a surface point.
    #[inline]
    pub fn color(&self, param: &Color, s: &Surface) -> Spectrum {
        match param {
            Param::Constant(c) => Spectrum::from_rgb(*c),
            Param::Texture(id) => self.texture(*id).color(self, s),
        }
    }

    /// The number of a parameter at a surface point.
    #[inline]
    pub fn scalar(&self, param: &Scalar, s: &Surface) -> f32 {
        match param {
            Param::Constant(v) => *v,
            Param::Texture(id) => self.texture(*id).scalar(self, s),
        }
    }

    /// The surface that a ray hits first.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<Surface> {
        let hit = self.accel.intersect(ray);
        if let Some(solids) = &self.solids {
            let t_max = hit.as_ref().map_or(ray.t_max, |h| h.t);
            if let Some(surface) = solids.intersect(self, &Ray { t_max, ..*ray }) {
                return Some(surface);
            }
        }
        // Made in place: a surface is large to copy.
        hit.map(|hit| self.surface(ray, &hit))
    }

    /// The first surface in the way of light along a ray.
    #[inline]
    pub fn intersect_shadow(&self, ray: &Ray) -> Option<Surface> {
        let hit = self.accel.intersect(ray);
        if let Some(solids) = &self.solids {
            let t_max = hit.as_ref().map_or(ray.t_max, |h| h.t);
            if let Some(surface) = solids.intersect_shadow(self, &Ray { t_max, ..*ray }) {
                return Some(surface);
            }
        }
        hit.map(|hit| self.surface(ray, &hit))
    }

    /// Whether anything at all is in a ray's way.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.stops_light(ray, false)
    }

    /// Whether anything is in the way of light along a ray; if `to_lamp`, that of a light without extent, for which solids may cast no
    /// shadow. Other lights are met by rays as well, for which all solids are there.
    #[inline]
    pub fn stops_light(&self, ray: &Ray, to_lamp: bool) -> bool {
        let solids = || self.solids.as_ref().and_then(|s| if to_lamp { s.intersect_shadow(self, ray) } else { s.intersect(self, ray) });
        self.accel.occluded(ray) || solids().is_some()
    }

    /// Whether the surface that a ray of light from a lamp meets first is of a solid that casts no shadow.
    pub fn casts_no_shadow(&self, ray: &Ray, s: &Surface) -> bool {
        s.solid.is_some() && self.intersect_shadow(ray).is_none_or(|behind| behind.t > s.t)
    }

    /// Radiance of a light sample: textured emission is looked up where the sample is.
    #[inline]
    pub fn light_radiance(&self, light: u32, sample: &LightSample) -> Spectrum {
        match &self.lights[light as usize] {
            Light::Area(area) if area.textured => {
                let source = self.light_sources[area.emission_id as usize];
                let hit = Hit { t: 0.0, u: sample.uv.x, v: sample.uv.y, prim: source.primitive, instance: 0 };
                let ray = Ray::new(sample.p, sample.wi);
                self.emitted(&self.surface(&ray, &hit), -sample.wi)
            }
            _ => sample.radiance,
        }
    }

    /// The material of what a ray hit.
    #[inline]
    pub fn hit_material(&self, hit: &Hit) -> &Material {
        let g = &self.geometries[self.placements[hit.instance as usize].geometry as usize];
        &self.materials[g.objects[g.object_of_primitive[hit.prim as usize] as usize].material as usize]
    }

    /// The ray through a point of the picture (in pixels) and of the lens (`u_lens` in [0, 1)²). Its weight is 0 where the camera sees nothing.
    pub fn camera_ray(&self, picture: Vec2, u_lens: Vec2) -> CameraRay {
        let ray = self.camera.ray(picture, u_lens);
        match &self.solids {
            Some(solids) => solids.camera_ray(ray),
            None => ray,
        }
    }

    /// Where the camera's middle ray starts.
    pub fn camera_origin(&self) -> Vec3 {
        self.camera.ray(Vec2::ZERO, Vec2::splat(0.5)).ray.o
    }

    /// Whether a method that needs triangles can be used.
    ///
    /// # Errors
    /// A sentence for scenes of exact solids.
    pub fn needs_triangles(&self, method: &str) -> Result<(), String> {
        match self.solids {
            None => Ok(()),
            Some(_) => Err(format!(
                "`{method}` needs triangles, and the solids of POV-Ray scenes are exact: path tracing and its kin can render them"
            )),
        }
    }

    /// Whether the camera does not see the light of a surface. Light sources of classic scenes have no surface of their own, only
    /// what glows has.
    #[inline]
    pub fn hides(&self, s: &Surface) -> bool {
        self.hide_lights || self.solids.is_some() && s.solid.is_none()
    }

    /// Radiance that a surface emits along `wo` (world space), without the light that falls on it.
    pub fn emitted(&self, s: &Surface, wo: Vec3) -> Spectrum {
        match &s.object(self).emission {
            Some(_) if let (Some(point), Some(solids)) = (&s.solid, &self.solids) => solids.emitted(point, wo),
            Some(e) if e.two_sided || s.ng.dot(wo) > 0.0 => self.color(&e.radiance, s),
            _ => Spectrum::ZERO,
        }
    }
}
