//! What is in a scene, as a dictionary.

use etendue_scene::SceneDesc;
use etendue_scene::desc::{GeometryDesc, LightDesc, Node, ProjectionDesc};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Counts, names and the film's settings of a scene.
pub fn of<'py>(py: Python<'py>, desc: &SceneDesc) -> PyResult<Bound<'py, PyDict>> {
    let info = PyDict::new(py);
    info.set_item("format", &desc.format)?;
    info.set_item("files", desc.files.iter().map(|p| p.display().to_string()).collect::<Vec<_>>())?;
    info.set_item("width", desc.film.width)?;
    info.set_item("height", desc.film.height)?;
    info.set_item("spp", desc.film.spp)?;
    info.set_item("integrator", Some(&desc.integrator.name).filter(|n| !n.is_empty()))?;
    info.set_item("max_depth", desc.integrator.max_depth)?;
    info.set_item("animations", desc.animations.iter().map(|a| (a.name.as_str(), a.secs)).collect::<Vec<_>>())?;
    info.set_item("cameras", desc.cameras.iter().map(|c| (name(c), projection(&c.value.projection))).collect::<Vec<_>>())?;
    info.set_item("lights", desc.lights.iter().map(|l| (name(l), light(&l.value))).collect::<Vec<_>>())?;
    info.set_item("emissive_shapes", desc.shapes.iter().filter(|s| s.value.emission.is_some()).count())?;
    info.set_item("shapes", desc.shapes.len())?;
    info.set_item("groups", desc.groups.len())?;
    info.set_item("instances", desc.instances.len())?;
    info.set_item("meshes", desc.meshes.len())?;
    info.set_item("triangles", desc.meshes.iter().filter_map(|m| m.value.data.as_ref()).map(|d| d.triangles.len()).sum::<usize>())?;
    let analytic = desc.shapes.iter().filter(|s| !matches!(s.value.geometry, GeometryDesc::Mesh { .. })).count();
    info.set_item("analytic_shapes", analytic)?;
    info.set_item("bsdfs", desc.bsdfs.len())?;
    info.set_item("textures", desc.textures.len())?;
    info.set_item("images", desc.images.len())?;
    info.set_item("media", desc.media.len())?;
    Ok(info)
}

fn name<T>(node: &Node<T>) -> String {
    node.name.clone()
}

fn projection(projection: &ProjectionDesc) -> &'static str {
    match projection {
        ProjectionDesc::Perspective { aperture_radius, .. } if *aperture_radius > 0.0 => "thinlens",
        ProjectionDesc::Perspective { .. } => "perspective",
        ProjectionDesc::Orthographic { .. } => "orthographic",
        ProjectionDesc::Panoramic => "panoramic",
        ProjectionDesc::Objective(_) => "objective",
    }
}

fn light(light: &LightDesc) -> &'static str {
    match light {
        LightDesc::Point { .. } => "point",
        LightDesc::Spot { .. } => "spot",
        LightDesc::Picture { .. } => "picture",
        LightDesc::Directional { .. } => "directional",
        LightDesc::Constant { .. } => "constant",
        LightDesc::Environment { .. } => "environment",
        LightDesc::SunSky(_) => "sunsky",
    }
}
