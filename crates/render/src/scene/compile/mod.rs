//! From a description to a [`Scene`]: the only door into the renderer.

mod geometry;
mod lights;

use etendue_scene::desc::{CameraDesc, Encoding, ObjectiveDesc, ProjectionDesc, SceneDesc, ShapeId, StopShape};
use etendue_scene::{Fault, RenderSettings, Severity, Span};
use glam::Mat4;

use super::geometry::{Geometry, Placement};
use super::{Names, Scene, displace};
use crate::accel::{Accel, Blas, BlasInput, Instance};
use crate::camera::{Camera, StopPicture};
use crate::classic::ClassicWorld;
use crate::classic::physical::{MeshOptions, Physical, meshes};
use crate::light::{Light, LightSampler, LightSelection, SceneSphere};
use crate::material;
use crate::medium::{self, MediumStack};
use crate::shape::Shape;
use crate::texture;
pub(crate) use geometry::vertex_normals;
use geometry::{Context, Placed};

/// Compiles a validated description whose meshes are loaded, for a picture of the given size.
///
/// # Errors
/// Every fault that was found: pictures that cannot be read, a camera that is not there.
pub fn compile(desc: &SceneDesc, settings: &RenderSettings, size: [u32; 2]) -> Result<Scene, Vec<Fault>> {
    let Some(classic) = desc.classic.as_ref().filter(|_| !crate::classic::is_asked_for(desc, settings)) else {
        return compile_with(desc, settings, size, None);
    };
    if needs_triangles(desc, settings) {
        return compile_triangles(desc, settings, size);
    }
    let (solids, mut warnings) = Physical::new(classic, size);
    let fault = |message| vec![Fault { severity: Severity::Error, span: Span::default(), message }];
    let name = settings.integrator.as_deref().unwrap_or(&desc.integrator.name);
    if solids.has_own_rays() && matches!(name, "light" | "bdpt" | "vcm" | "mlt") {
        return Err(fault(format!(
            "`{name}` connects light to the camera, which it can only with flat pictures: perspective and orthographic"
        )));
    }
    let (lights, losses) = solids.lower(size).map_err(fault)?;
    warnings.extend(losses.into_iter().map(|l| format!("not honored: {}: {}", l.feature, l.effect)));
    let mut scene = compile_with(&lights, settings, size, Some(Box::new(solids)))?;
    scene.warnings.extend(warnings);
    scene.light_hash = settings.photon_map.is_some().then(|| desc.light_hash());
    Ok(scene)
}

/// Whether the integrator cannot work with exact solids.
fn needs_triangles(desc: &SceneDesc, settings: &RenderSettings) -> bool {
    let name = settings.integrator.as_deref().unwrap_or(&desc.integrator.name);
    matches!(name, "raster" | "radiosity")
}

/// A classic scene in triangles.
fn compile_triangles(desc: &SceneDesc, settings: &RenderSettings, size: [u32; 2]) -> Result<Scene, Vec<Fault>> {
    let segments = settings.tessellation.unwrap_or(crate::solid::tessellate::SEGMENTS);
    let options = MeshOptions { segments, size, right_handed: false };
    let fault = |message| vec![Fault { severity: Severity::Error, span: Span::default(), message }];
    let meshes = meshes(desc, &options).map_err(fault)?;
    let settings = RenderSettings { camera: None, ..settings.clone() };
    let mut scene = compile_with(&meshes, &settings, size, None)?;
    let known = desc.report.losses.len();
    let lost = meshes.report.losses.iter().skip(known);
    scene.warnings.extend(lost.map(|l| format!("not honored: {}: {}", l.feature, l.effect)));
    scene.light_hash = settings.photon_map.is_some().then(|| desc.light_hash());
    Ok(scene)
}

pub(super) fn compile_with(
    desc: &SceneDesc,
    settings: &RenderSettings,
    size: [u32; 2],
    mut solids: Option<Box<Physical>>,
) -> Result<Scene, Vec<Fault>> {
    // The classic model has cameras of its own.
    let unused = CameraDesc::default();
    let camera = if desc.classic.is_some() { &unused } else { camera(desc, settings)? };
    let eye = eye(desc, camera, size)?;
    let materials = material::compile(desc);
    let (mut attributes, mut groups) = (Names::default(), Names::default());
    groups.intern("");
    let textures = texture::compile(desc, &mut attributes, settings.mipmap)?;
    let displaced = displace(desc)?;
    let mut ctx = Context {
        desc,
        displaced: &displaced.meshes,
        materials: &materials,
        attributes: &mut attributes,
        groups: &mut groups,
        light_groups: settings.light_groups,
        tangents: settings.mipmap,
        object_count: 0,
    };
    let (geometries, placements) = place(desc, &mut ctx);
    let blases: Vec<Blas> =
        geometries.iter().map(|g| Blas::build(BlasInput { positions: &g.positions, triangles: &g.triangles, shapes: &g.shapes })).collect();
    let instances = placements
        .iter()
        .map(|p| Instance { world_from_object: p.world_from_object.unwrap_or(Mat4::IDENTITY), blas: p.geometry })
        .collect();
    let accel = Accel::build(blases, instances);
    let has_null = solids.is_some() || geometries.iter().flat_map(|g| &g.objects).any(|o| materials[o.material as usize].has_null);
    let (mut media, mut warnings) = medium::compile(desc);
    warnings.extend(displaced.warnings);
    let mut bounds = accel.bounds();
    let mut endless = geometries.iter().any(|g| g.shapes.iter().any(|s| matches!(s, Shape::Plane(_))));
    let mut geometries = geometries;
    if let Some(solids) = &mut solids {
        bounds = bounds.union(solids.bounds());
        endless |= solids.is_endless();
        solids.add_objects(&mut geometries[0].objects, &mut media, 0);
    }
    let environment = solids.as_ref().and_then(|s| s.environment());
    let has_border = |o: &super::geometry::Object| o.interior != super::geometry::NONE || o.exterior != super::geometry::NONE;
    let media_in_use = geometries.iter().flat_map(|g| &g.objects).any(has_border);
    let mut scene = Scene {
        bounds,
        endless,
        geometries,
        placements,
        accel,
        textures,
        has_media: media_in_use || camera.medium.is_some(),
        camera_medium: MediumStack::new(camera.medium.map_or(super::geometry::NONE, |m| m.0)),
        media,
        camera: eye,
        view: None,
        has_null,
        mipmap: settings.mipmap,
        hide_lights: desc.integrator.hide_lights || crate::integrator::hides_lights(settings, &desc.integrator),
        light_hash: settings.photon_map.is_some().then(|| desc.light_hash()),
        classic: None,
        solids,
        warnings,
        materials,
        lights: Vec::new(),
        light_sources: Vec::new(),
        light_places: Vec::new(),
        light_groups: Vec::new(),
        group_names: groups.into_names(),
        infinite_lights: Vec::new(),
        light_sampler: LightSampler::new(
            &[],
            &SceneSphere { center: glam::Vec3::ZERO, radius: 1.0, endless: false },
            LightSelection::Uniform,
        ),
        environment_visibility: None,
    };
    lights::add(&mut scene, desc, settings, environment)?;
    if scene.has_media {
        let place = |l: &Light| l.bounds().map(|b| b.bounds.bounding_sphere());
        scene.light_places = scene.lights.iter().map(place).collect();
        if scene.light_places.iter().all(Option::is_none) {
            scene.light_places.clear();
        }
    }
    if let Some(classic) = &desc.classic {
        let (world, warnings) = ClassicWorld::new(classic, size);
        scene.classic = Some(Box::new(world));
        scene.warnings.extend(warnings);
    }
    Ok(scene)
}

/// The camera that the settings name by name or number, or the first.
pub(super) fn camera<'a>(desc: &'a SceneDesc, settings: &RenderSettings) -> Result<&'a CameraDesc, Vec<Fault>> {
    let found = match &settings.camera {
        None => desc.cameras.first(),
        Some(name) => desc.cameras.iter().find(|c| c.name == *name).or_else(|| desc.cameras.get(name.parse::<usize>().ok()?)),
    };
    match found {
        Some(node) => {
            debug_assert!(!matches!(node.value.projection, ProjectionDesc::Perspective { fov_rad, .. } if fov_rad <= 0.0));
            Ok(&node.value)
        }
        None => {
            let names: Vec<_> = desc.cameras.iter().map(|c| format!("`{}`", c.name)).collect();
            let message = match &settings.camera {
                Some(name) => format!("no camera `{name}`; there are {} ({})", names.len(), names.join(", ")),
                None => "the scene has no camera".to_owned(),
            };
            Err(vec![Fault { severity: Severity::Error, span: Span::default(), message }])
        }
    }
}

/// A camera of the description for a picture of the given size.
///
/// # Errors
/// A fault where the picture of its stop cannot be read, or is black.
pub(super) fn eye(desc: &SceneDesc, camera: &CameraDesc, size: [u32; 2]) -> Result<Camera, Vec<Fault>> {
    let ProjectionDesc::Objective(ObjectiveDesc { stop: StopShape::Picture(id), .. }) = &camera.projection else {
        return Ok(Camera::new(camera, size[0], size[1]));
    };
    let stop = texture::decode(desc, *id, Encoding::Auto)
        .and_then(|texels| StopPicture::new(&texels).ok_or_else(|| "the picture of a camera's aperture is black".to_owned()))
        .map_err(|message| vec![Fault { severity: Severity::Error, span: desc[*id].span, message }])?;
    Ok(Camera::with_stop(camera, Some(stop), size[0], size[1]))
}

/// The world's geometry first, then one for each group, and where they stand.
fn place(desc: &SceneDesc, ctx: &mut Context) -> (Vec<Geometry>, Vec<Placement>) {
    let mut in_group = vec![false; desc.shapes.len()];
    for group in &desc.groups {
        for shape in &group.value.shapes {
            in_group[shape.0 as usize] = true;
        }
    }
    let emits = |s: ShapeId| desc[s].value.emission.is_some();
    let mut world: Vec<Placed> = (0..desc.shapes.len() as u32)
        .filter(|i| !in_group[*i as usize])
        .map(|i| Placed { shape: ShapeId(i), geometry_from_object: desc[ShapeId(i)].value.world_from_object })
        .collect();
    // Every light is one light to the samplers: emitting shapes of groups are placed in the world one by one.
    for instance in &desc.instances {
        for &shape in desc[instance.value.group].value.shapes.iter().filter(|s| emits(**s)) {
            world.push(Placed { shape, geometry_from_object: instance.value.world_from_object * desc[shape].value.world_from_object });
        }
    }
    let mut geometries = vec![geometry::build(&world, ctx)];
    let mut placements = vec![Placement::new(0, Mat4::IDENTITY)];
    let mut geometry_of_group = vec![None; desc.groups.len()];
    for instance in &desc.instances {
        let group = instance.value.group;
        let index = *geometry_of_group[group.0 as usize].get_or_insert_with(|| {
            let shapes: Vec<Placed> = desc[group]
                .value
                .shapes
                .iter()
                .filter(|s| !emits(**s))
                .map(|&shape| Placed { shape, geometry_from_object: desc[shape].value.world_from_object })
                .collect();
            geometries.push(geometry::build(&shapes, ctx));
            geometries.len() as u32 - 1
        });
        placements.push(Placement::new(index, instance.value.world_from_object));
    }
    (geometries, placements)
}
