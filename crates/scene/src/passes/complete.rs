//! A camera and a light for scenes that have none.

use std::collections::HashSet;
use std::f32::consts::FRAC_PI_4;

use glam::{Mat4, Vec3};

use crate::desc::{
    AddNode, CameraDesc, FovAxis, GeometryDesc, LightDesc, MediumDesc, Node, Param, ProjectionDesc, SceneDesc, ShapeDesc, ShapeId,
};
use crate::span::{FileId, Span};

/// Adds a camera that frames the whole scene in a three-quarter view, and soft light from everywhere with a directional key light, where
/// the file has none. Either is told by a warning in the report. Meshes must be loaded.
pub fn complete(desc: &mut SceneDesc) {
    // Scenes of the classic model have their own camera; without light they are meant to be dark.
    if desc.classic.is_some() {
        return;
    }
    let span = Span::file(FileId(0));
    let needs_light = desc.lights.is_empty() && !desc.shapes.iter().any(|s| emits(&s.value)) && !glows(desc);
    if !desc.cameras.is_empty() && !needs_light {
        return;
    }
    // Printable parts stand on the xy plane by custom, everything else on xz.
    let up = if desc.format == "stl" { Vec3::Z } else { Vec3::Y };
    let back = if desc.format == "stl" { Vec3::NEG_Y } else { Vec3::Z };
    let right = up.cross(back);
    if desc.cameras.is_empty() {
        let camera = framing_camera(world_bounds(desc), right, up, back);
        desc.add(Node::named("automatic", span, camera));
        desc.report.warning(span, "the file has no camera; one that frames the scene is added");
    }
    if needs_light {
        let key = -(0.4 * right + 0.8 * up + 0.6 * back).normalize();
        desc.add(Node::named("automatic", span, LightDesc::Constant { radiance: [0.6; 3] }));
        desc.add(Node::named("automatic key", span, LightDesc::Directional { direction: key, irradiance: [2.0; 3] }));
        desc.report.warning(span, "the file has no light; soft light from everywhere and a directional key light are added");
    }
}

/// Whether a medium emits that a shape or a camera names: a flame needs no other light.
fn glows(desc: &SceneDesc) -> bool {
    let of_shapes = desc.shapes.iter().flat_map(|s| [s.value.interior, s.value.exterior]);
    of_shapes.chain(desc.cameras.iter().map(|c| c.value.medium)).flatten().filter_map(|id| desc.media.get(id.0 as usize)).any(|m| match &m
        .value
    {
        MediumDesc::Homogeneous { emission, .. } => emission.iter().any(|v| *v > 0.0),
        MediumDesc::Grid(grid) => grid.emission.is_some(),
    })
}

fn emits(shape: &ShapeDesc) -> bool {
    shape.emission.as_ref().is_some_and(|e| match e.radiance {
        Param::Constant(c) => c.iter().any(|v| *v > 0.0),
        Param::Texture(_) => true,
    })
}

fn framing_camera((min, max): (Vec3, Vec3), right: Vec3, up: Vec3, back: Vec3) -> CameraDesc {
    const FOV: f32 = FRAC_PI_4;
    let center = 0.5 * (min + max);
    let radius = (0.5 * (max - min).length()).max(1e-6);
    // The sphere around the bounds touches the edges of the picture: r / sin(fov / 2), with sin(22.5°) = 0.38268.
    let distance = radius / 0.382_683_43;
    let direction = (0.55 * right + 0.4 * up + back).normalize();
    let eye = center + distance * direction;
    let x = up.cross(direction).normalize();
    let y = direction.cross(x);
    CameraDesc {
        world_from_camera: Mat4::from_cols(x.extend(0.0), y.extend(0.0), direction.extend(0.0), eye.extend(1.0)),
        projection: ProjectionDesc::Perspective {
            fov_rad: FOV,
            fov_axis: FovAxis::Smaller,
            aperture_radius: 0.0,
            focus_distance: distance,
            principal_point_offset: [0.0; 2],
        },
        near: 1e-3 * distance,
        far: 100.0 * distance,
        medium: None,
    }
}

/// Corners of the world's bounds; the unit cube around the origin where nothing bounded is there.
pub fn world_bounds(desc: &SceneDesc) -> (Vec3, Vec3) {
    let grouped: HashSet<ShapeId> = desc.groups.iter().flat_map(|g| &g.value.shapes).copied().collect();
    let mut bounds = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let mut grow = |points: &[Vec3], m: Mat4| {
        for p in points {
            let p = m.transform_point3(*p);
            if p.is_finite() {
                bounds = (bounds.0.min(p), bounds.1.max(p));
            }
        }
    };
    // Each mesh is walked once, however often it is placed.
    let meshes: Vec<Vec<Vec3>> =
        desc.meshes.iter().map(|m| m.value.data.as_ref().map_or(Vec::new(), |d| corners_of(&d.positions))).collect();
    let local = |shape: &ShapeDesc| match &shape.geometry {
        GeometryDesc::Mesh { mesh, .. } => meshes.get(mesh.0 as usize).cloned().unwrap_or_default(),
        geometry => analytic_corners(geometry),
    };
    for (i, shape) in desc.shapes.iter().enumerate() {
        if !grouped.contains(&ShapeId(i as u32)) {
            grow(&local(&shape.value), shape.value.world_from_object);
        }
    }
    for instance in &desc.instances {
        let Some(group) = desc.groups.get(instance.value.group.0 as usize) else { continue };
        for shape in group.value.shapes.iter().filter_map(|id| desc.shapes.get(id.0 as usize)) {
            grow(&local(&shape.value), instance.value.world_from_object * shape.value.world_from_object);
        }
    }
    if bounds.0.cmple(bounds.1).all() { bounds } else { (Vec3::splat(-1.0), Vec3::ONE) }
}

/// The eight corners of the bounds of points; none for none.
fn corners_of(points: &[Vec3]) -> Vec<Vec3> {
    let finite = || points.iter().filter(|p| p.is_finite());
    let min = finite().fold(Vec3::INFINITY, |a, p| a.min(*p));
    let max = finite().fold(Vec3::NEG_INFINITY, |a, p| a.max(*p));
    if !min.cmple(max).all() {
        return Vec::new();
    }
    (0..8).map(|i| Vec3::new([min, max][i & 1].x, [min, max][i >> 1 & 1].y, [min, max][i >> 2].z)).collect()
}

fn analytic_corners(geometry: &GeometryDesc) -> Vec<Vec3> {
    let around = |c: Vec3, r: f32| [c - Vec3::splat(r), c + Vec3::splat(r)];
    match geometry {
        GeometryDesc::Sphere { center, radius } => corners_of(&around(*center, *radius)),
        GeometryDesc::Cylinder { p0, p1, radius } => {
            let [a, b] = around(*p0, *radius);
            let [c, d] = around(*p1, *radius);
            corners_of(&[a, b, c, d])
        }
        GeometryDesc::Disk | GeometryDesc::Rectangle => corners_of(&[Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0)]),
        GeometryDesc::Cube => corners_of(&[Vec3::splat(-1.0), Vec3::ONE]),
        GeometryDesc::Polygon { contours } => corners_of(&contours.iter().flatten().map(|p| p.extend(0.0)).collect::<Vec<_>>()),
        // Unbounded shapes do not ask to be framed.
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::desc::{MediumId, PhaseDesc};

    #[test]
    fn flames_need_no_other_light() {
        for (emission, used, lights) in [(1.0, true, 0), (0.0, true, 2), (1.0, false, 2)] {
            let mut desc = SceneDesc::new("test", "test");
            let medium =
                MediumDesc::Homogeneous { sigma_a: [1.0; 3], sigma_s: [0.0; 3], emission: [emission; 3], phase: PhaseDesc::Isotropic };
            let medium: MediumId = desc.add(Node::new(Span::default(), medium));
            let ball = GeometryDesc::Sphere { center: Vec3::ZERO, radius: 1.0 };
            let shape = ShapeDesc { interior: used.then_some(medium), ..ShapeDesc::new(ball, Mat4::IDENTITY) };
            desc.add(Node::new(Span::default(), shape));
            complete(&mut desc);
            assert_eq!(desc.lights.len(), lights, "{emission} {used}");
        }
    }
}
