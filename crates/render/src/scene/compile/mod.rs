//! From a description to a [`Scene`]: the only door into the renderer.

mod geometry;
mod lights;

use etendue_scene::desc::{CameraDesc, ProjectionDesc, SceneDesc, ShapeId};
use etendue_scene::{Fault, RenderSettings, Severity, Span};
use glam::Mat4;

use super::geometry::{Geometry, Placement};
use super::{Names, Scene};
use crate::accel::{Accel, Blas, BlasInput, Instance};
use crate::camera::Camera;
use crate::classic::ClassicWorld;
use crate::light::{LightSampler, LightSelection, SceneSphere};
use crate::material;
use crate::medium::Medium;
use crate::texture;
use geometry::{Context, Placed};

/// Compiles a validated description whose meshes are loaded, for a picture of the given size.
///
/// # Errors
/// Every fault that was found: pictures that cannot be read, a camera that is not there.
pub fn compile(desc: &SceneDesc, settings: &RenderSettings, size: [u32; 2]) -> Result<Scene, Vec<Fault>> {
    // The classic model has cameras of its own.
    let unused = CameraDesc::default();
    let camera = if desc.classic.is_some() { &unused } else { camera(desc, settings)? };
    let materials = material::compile(desc);
    let (mut attributes, mut groups) = (Names::default(), Names::default());
    groups.intern("");
    let textures = texture::compile(desc, &mut attributes, settings.mipmap)?;
    let mut ctx = Context {
        desc,
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
    let has_null = geometries.iter().flat_map(|g| &g.objects).any(|o| materials[o.material as usize].has_null);
    let mut scene = Scene {
        bounds: accel.bounds(),
        geometries,
        placements,
        accel,
        textures,
        media: desc.media.iter().map(|m| Medium::new(&m.value)).collect(),
        camera: Camera::new(camera, size[0], size[1]),
        view: None,
        has_null,
        mipmap: settings.mipmap,
        hide_lights: desc.integrator.hide_lights,
        classic: None,
        warnings: Vec::new(),
        materials,
        lights: Vec::new(),
        light_sources: Vec::new(),
        light_groups: Vec::new(),
        group_names: groups.into_names(),
        infinite_lights: Vec::new(),
        light_sampler: LightSampler::new(&[], &SceneSphere { center: glam::Vec3::ZERO, radius: 1.0 }, LightSelection::Uniform),
    };
    lights::add(&mut scene, desc, settings)?;
    if let Some(classic) = &desc.classic {
        let (world, warnings) = ClassicWorld::new(classic, size);
        scene.classic = Some(Box::new(world));
        scene.warnings = warnings;
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
