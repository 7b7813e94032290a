//! From emitting shapes and the description's lights to the scene's lights and their sampler.

use std::collections::HashMap;

use etendue_scene::desc::{Encoding, EnvironmentMapping, LightDesc, Param, PictureMapping, SceneDesc};
use etendue_scene::{Fault, RenderSettings, Severity, Span};

use crate::light::{
    AreaGeometry, AreaLight, ConstantLight, DirectionalLight, EnvironmentLight, EnvironmentVisibility, Light, LightSampler, LightSelection,
    PictureLight, PointLight, PortalLight, Rows, SpotLight, equal_area,
};
use crate::scene::geometry::NONE;
use crate::scene::{LightSource, Scene};
use crate::spectrum::Spectrum;
use crate::texture;

/// Adds all lights of a scene whose geometry stands, and an environment that is not in the description.
///
/// # Errors
/// Faults of environment pictures and of the settings.
pub(super) fn add(
    scene: &mut Scene,
    desc: &SceneDesc,
    settings: &RenderSettings,
    environment: Option<EnvironmentLight>,
) -> Result<(), Vec<Fault>> {
    add_emitting_objects(scene);
    if let Some(light) = environment {
        push(scene, Light::Environment(Box::new(light)), 0);
    }
    let mut faults = Vec::new();
    for node in &desc.lights {
        let found = make(desc, &node.value);
        match found {
            Ok(lights) => {
                let group = group_of(scene, settings, &node.name);
                for light in lights {
                    push(scene, light, group);
                }
            }
            Err(message) => faults.push(Fault { severity: Severity::Error, span: node.span, message }),
        }
    }
    let sphere = scene.sphere();
    let name = settings.light_sampler.as_deref().unwrap_or("bvh");
    let selection = match name {
        "bvh" => LightSelection::Bvh,
        "power" => LightSelection::Power,
        "uniform" => LightSelection::Uniform,
        _ => {
            let message = format!("no light sampler `{name}`; there are bvh, power, uniform");
            faults.push(Fault { severity: Severity::Error, span: Span::default(), message });
            LightSelection::Uniform
        }
    };
    scene.light_sampler = LightSampler::new(&scene.lights, &sphere, selection);
    let environment = scene.lights.iter().position(|l| matches!(l, Light::Environment(_)));
    scene.environment_visibility = environment.and_then(|light| EnvironmentVisibility::new(light as u32, scene.bounds));
    if faults.is_empty() { Ok(()) } else { Err(faults) }
}

/// The light group of a light of that name: its own where the settings ask for it, else the common one.
fn group_of(scene: &mut Scene, settings: &RenderSettings, name: &str) -> u32 {
    if !settings.light_groups || name.is_empty() {
        return 0;
    }
    let known = scene.group_names.iter().position(|n| n == name);
    known.unwrap_or_else(|| {
        scene.group_names.push(name.to_owned());
        scene.group_names.len() - 1
    }) as u32
}

fn push(scene: &mut Scene, light: Light, group: u32) {
    if light.is_infinite() {
        scene.infinite_lights.push(scene.lights.len() as u32);
    }
    scene.lights.push(light);
    scene.light_groups.push(group);
}

/// One area light for each primitive of each object of the world that emits.
fn add_emitting_objects(scene: &mut Scene) {
    let mut averages = HashMap::new();
    for object_index in 0..scene.geometries[0].objects.len() {
        let g = &scene.geometries[0];
        let object = &g.objects[object_index];
        // What glows on a solid is found by chance alone: it has no primitives to sample.
        let Some(emission) = object.emission.filter(|_| object.first_primitive != NONE) else { continue };
        let (radiance, textured) = match emission.radiance {
            Param::Constant(c) => (Spectrum::from_rgb(c), false),
            Param::Texture(id) => (*averages.entry(id).or_insert_with(|| scene.textures[id.0 as usize].average()), true),
        };
        if radiance.is_black() {
            continue;
        }
        let triangle_count = g.triangles.len();
        let first = object.first_primitive as usize;
        let count = g.object_of_primitive[first..].iter().take_while(|o| **o as usize == object_index).count();
        let flip_normals = object.flip_normals;
        let lights: Vec<Light> = (first..first + count)
            .map(|primitive| {
                let geometry = match primitive.checked_sub(triangle_count) {
                    None => AreaGeometry::Triangle(g.triangles[primitive].map(|i| g.positions[i as usize])),
                    Some(shape) => AreaGeometry::Shape(Box::new(g.shapes[shape].clone())),
                };
                let flip_normals = flip_normals && primitive < triangle_count;
                let emission_id = (scene.light_sources.len() + primitive - first) as u32;
                Light::Area(AreaLight { geometry, radiance, emission_id, textured, two_sided: emission.two_sided, flip_normals })
            })
            .collect();
        scene.geometries[0].objects[object_index].first_light = scene.lights.len() as u32;
        for (i, light) in lights.into_iter().enumerate() {
            scene.light_sources.push(LightSource { object: object_index as u32, primitive: (first + i) as u32 });
            push(scene, light, emission.group);
        }
    }
    debug_assert!(scene.geometries[1..].iter().flat_map(|g| &g.objects).all(|o| o.first_light == NONE));
}

/// The lights of one node of the description.
fn make(desc: &SceneDesc, light: &LightDesc) -> Result<Vec<Light>, String> {
    let nothing = || "the light's numbers make no light".to_owned();
    Ok(match light {
        LightDesc::Point { position, intensity } => {
            vec![Light::Point(PointLight { p: *position, intensity: Spectrum::from_rgb(*intensity) })]
        }
        LightDesc::Spot { world_from_light, intensity, outer_rad, inner_rad, falloff, .. } => {
            vec![Light::Spot(SpotLight::new(*world_from_light, *intensity, *inner_rad, *outer_rad, *falloff).ok_or_else(nothing)?)]
        }
        LightDesc::Picture { world_from_light, intensity, power, image, mapping } => {
            let texels = texture::decode(desc, *image, Encoding::Auto)?;
            let size = (texels.width as usize, texels.height as usize);
            let all_round = *mapping == PictureMapping::EqualAreaSquare;
            if all_round && size.0 != size.1 {
                return Err(format!("a light's map of equal areas must be square, not {}×{}", size.0, size.1));
            }
            let pixels = (0..texels.height).flat_map(|y| (0..texels.width).map(move |x| (x, y)));
            let rgb = pixels.map(|(x, y)| texels.get(x, y));
            let rgb: Vec<[f32; 3]> = rgb.map(|[r, g, b, _]| if all_round { [(r + g + b) / 3.0; 3] } else { [r, g, b] }).collect();
            let light = PictureLight::new(size, &rgb, *intensity, *power, *world_from_light, *mapping).ok_or_else(nothing)?;
            vec![Light::Picture(Box::new(light))]
        }
        LightDesc::Directional { direction, irradiance } => {
            vec![Light::Directional(DirectionalLight::new(*direction, *irradiance).ok_or_else(nothing)?)]
        }
        LightDesc::Constant { radiance } => vec![Light::Constant(ConstantLight { radiance: Spectrum::from_rgb(*radiance) })],
        LightDesc::Environment { image, scale, world_from_light, mapping, portal } => {
            let texels = texture::decode(desc, *image, Encoding::Auto)?;
            let pixels = (0..texels.height).flat_map(|y| (0..texels.width).map(move |x| (x, y)));
            let mut rgb: Vec<[f32; 3]> = pixels.map(|(x, y)| texels.get(x, y)).map(|[r, g, b, _]| [r, g, b]).collect();
            let mut size = (texels.width as usize, texels.height as usize);
            if *mapping == EnvironmentMapping::EqualAreaSquare {
                if size.0 != size.1 {
                    return Err(format!("an environment map of equal areas must be square, not {}×{}", size.0, size.1));
                }
                (size, rgb) = equal_area::to_equirectangular(size.0, &rgb);
            }
            let rows = if *mapping == EnvironmentMapping::EquirectangularOnPoles { Rows::OnPoles } else { Rows::Centered };
            let light = EnvironmentLight::new(size, rgb, *scale, *world_from_light, rows).ok_or_else(nothing)?;
            match portal {
                Some(corners) => vec![Light::Portal(Box::new(PortalLight::new(light, *corners).ok_or_else(nothing)?))],
                None => vec![Light::Environment(Box::new(light))],
            }
        }
        LightDesc::SunSky(sky) => crate::light::sunsky::lights(sky).ok_or_else(nothing)?,
    })
}

impl texture::Texture {
    /// The mean color over the texture coordinates' unit square: what a light that it colors gives on the whole.
    fn average(&self) -> Spectrum {
        match self {
            Self::Constant(c) => *c,
            Self::Bitmap(b) => b.average(),
            // Not black, so that the light is sampled; where it is bright is found at the samples.
            _ => Spectrum::from_rgb([0.5; 3]),
        }
    }
}
