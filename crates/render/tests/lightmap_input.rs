//! Baking of scenes that are not as one would wish: broken meshes, wrong settings, nothing to bake, instances, exact solids.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

mod support;

use etendue_render::integrator::Stage;
use etendue_render::lightmap::output::{self, Display};
use etendue_render::lightmap::{Bake, BakeError, BakeOptions, Baked, Sides, Solution};
use etendue_render::session::{Cancel, Stop};
use etendue_scene::RenderSettings;
use etendue_scene::desc::*;
use etendue_scene::formats::{ReadOptions, gltf};
use glam::{Mat4, Vec3};
use std::path::Path;
use support::baking::*;
use support::*;

/// A bake of a single mesh under a sky.
fn bake_mesh(mesh: MeshData, options: &BakeOptions) -> Result<(Bake, Baked, Vec<String>), BakeError> {
    let mut desc = scene();
    view(&mut desc);
    constant_sky(&mut desc, 1.0);
    let mesh = add(&mut desc, MeshDesc { file: None, flip_v: false, data: Some(mesh) });
    shape(&mut desc, GeometryDesc::Mesh { mesh, face_normals: false, smooth: false }, Mat4::IDENTITY, None);
    let bake = Bake::new(&desc, &depth(2), options, "path")?;
    let mut solution = Solution::new(bake.point_count());
    bake.solve(&bake.path(), Stop { spp: Some(2), ..Stop::default() }, &mut solution, &Cancel::default(), &Quiet);
    let baked = bake.finish(&solution, None)?;
    let (glb, _) = output::scene(&bake, &baked, Display::Emissive)?.glb(serde_json::json!({}))?;
    gltf::read_bytes(&glb, Path::new("baked.glb"), &ReadOptions::default()).expect("what is written can be read");
    let notes = bake.flat.notes.clone();
    Ok((bake, baked, notes))
}

#[test]
fn broken_meshes_are_baked_with_a_report_or_refused_with_a_sentence() {
    let square = || MeshData {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..MeshData::default()
    };
    let good = |mesh, said: &str| {
        let (_, baked, notes) = bake_mesh(mesh, &small()).unwrap();
        assert!(baked.irradiance[0].data.iter().flatten().all(|v| v.is_finite()));
        assert!(baked.irradiance[0].data.iter().any(|v| v[0] > 1.0));
        assert!(said.is_empty() && notes.is_empty() || notes.iter().any(|n| n.contains(said)), "{notes:?} without {said}");
    };
    let refused = |mesh, said: &str| {
        let error = bake_mesh(mesh, &small()).err().expect("refused").to_string();
        assert!(error.contains(said), "{error}");
    };
    good(square(), "");
    // Three triangles at an edge.
    let mut mesh = square();
    mesh.positions.push(Vec3::new(0.5, 0.5, 1.0));
    mesh.triangles.push([0, 2, 4]);
    good(mesh, "");
    // Without area.
    let mut mesh = square();
    mesh.triangles.extend([[0, 0, 1], [0, 1, 1]]);
    mesh.positions.push(Vec3::new(0.5, 0.0, 0.0));
    mesh.triangles.push([0, 4, 1]);
    good(mesh, "3 triangles without area");
    // Twice the same.
    let mut mesh = square();
    mesh.triangles.push([1, 2, 0]);
    good(mesh, "1 triangles that lie twice");
    // Overlapping, in one plane, sharing an edge.
    let mut mesh = square();
    mesh.positions.push(Vec3::new(0.2, 0.9, 0.0));
    mesh.triangles.push([1, 4, 0]);
    good(mesh, "");
    // Normals that are none.
    let mut mesh = square();
    mesh.normals = vec![Vec3::ZERO, Vec3::NAN, Vec3::Z, Vec3::Z];
    good(mesh, "without a usable normal");
    // Not a number, and far beyond.
    for bad in [f32::NAN, f32::INFINITY, 1e30] {
        let mut mesh = square();
        mesh.positions.push(Vec3::splat(bad));
        mesh.triangles.push([0, 1, 4]);
        good(mesh, "coordinates that are not finite");
    }
    // Giant, but sound; and tiny.
    for scale in [1e12, 1e-12] {
        let mut mesh = square();
        mesh.positions.iter_mut().for_each(|p| *p *= scale);
        good(mesh, "");
    }
    // A house on a plane that has no end.
    let mut mesh = square();
    mesh.positions.extend([Vec3::new(-1e7, -1e7, -1.0), Vec3::new(1e7, -1e7, -1.0), Vec3::new(0.0, 1e7, -1.0)]);
    mesh.triangles.push([4, 5, 6]);
    good(mesh, "");
    // A needle.
    let mesh = MeshData {
        positions: vec![Vec3::ZERO, Vec3::new(1e4, 0.0, 0.0), Vec3::new(0.0, 1e-4, 0.0)],
        triangles: vec![[0, 1, 2]],
        ..MeshData::default()
    };
    good(mesh, "");
    refused(MeshData::default(), "nothing to bake");
    refused(MeshData { triangles: vec![[0, 1, 2]], positions: vec![Vec3::ONE; 3], ..MeshData::default() }, "nothing to bake");
}

#[test]
fn wrong_settings_are_refused_with_a_sentence() {
    let mut desc = scene();
    view(&mut desc);
    rectangle(&mut desc, Vec3::ZERO, [1.0, 1.0], false, None);
    let refused = |options: BakeOptions, said: &str| {
        let error = Bake::new(&desc, &RenderSettings::default(), &options, "path").err().expect("refused").to_string();
        assert!(error.contains(said), "{error}");
    };
    refused(BakeOptions { resolution: 1, ..small() }, "16 to 16384");
    refused(BakeOptions { padding: 0, ..small() }, "gutter");
    refused(BakeOptions { padding: 20, ..small() }, "gutter");
    refused(BakeOptions { texels_per_meter: Some(f64::NAN), ..small() }, "positive");
    let of_pixels = RenderSettings { adaptive: Some(0.1), ..RenderSettings::default() };
    assert!(Bake::new(&desc, &of_pixels, &small(), "path").err().unwrap().to_string().contains("`adaptive` is for pixels"));
    let lit = Bake::new(&desc, &RenderSettings::default(), &small(), "path").unwrap();
    let is_cancelled = || false;
    let stage = Stage::without_camera(0, &is_cancelled, &|_, _| {});
    assert!(lit.method("magic", false, &stage, &mut Vec::new()).err().unwrap().to_string().contains("radiosity"));
}

#[test]
fn a_second_set_of_texture_coordinates_is_kept_where_it_is_usable() {
    let mut mesh = MeshData {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..MeshData::default()
    };
    let set = |data: Vec<f32>| MeshAttribute { name: "uv1".into(), per_face: false, width: 2, data };
    mesh.attributes = vec![set(vec![0.1, 0.1, 0.9, 0.1, 0.9, 0.9, 0.1, 0.9])];
    let kept = |mesh: &MeshData, options: &BakeOptions| layout(&bake_mesh(mesh.clone(), options).unwrap().0).kept;
    assert_eq!(kept(&mesh, &small()), 1);
    assert_eq!(kept(&mesh, &BakeOptions { unwrap: true, ..small() }), 0);
    // Out of range; all in one point; folded over.
    for bad in [vec![0.0, 0.0, 3.0, 0.0, 3.0, 3.0, 0.0, 3.0], vec![0.5; 8], vec![0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0]] {
        mesh.attributes = vec![set(bad)];
        assert_eq!(kept(&mesh, &small()), 0);
    }
}

#[test]
fn glass_and_lights_have_no_texels_and_a_scene_of_nothing_else_is_refused() {
    let mut desc = scene();
    view(&mut desc);
    let glass = bsdf(&mut desc, glass(1.5, None));
    sphere(&mut desc, Vec3::ZERO, 1.0, Some(glass));
    let error = Bake::new(&desc, &RenderSettings::default(), &small(), "path").err().unwrap();
    assert!(error.to_string().contains("lights, glass or invisible"), "{error}");
}

#[test]
fn instances_get_texels_of_their_own() {
    let mut desc = scene();
    view(&mut desc);
    constant_sky(&mut desc, 1.0);
    let inner = rectangle(&mut desc, Vec3::ZERO, [1.0, 1.0], false, None);
    let group = add(&mut desc, GroupDesc { shapes: vec![inner] });
    for i in 0..3 {
        add(&mut desc, InstanceDesc { group, world_from_object: Mat4::from_translation(Vec3::new(3.0 * i as f32, 0.0, 0.0)) });
    }
    let (bake, _, _) = bake(&desc, &depth(1), &BakeOptions { sides: Sides::Front, ..small() }, 1);
    assert_eq!(layout(&bake).charts.len(), 3);
    let mut seen = std::collections::HashSet::new();
    assert!(layout(&bake).texels.iter().all(|t| seen.insert((t.atlas, t.at))), "texels are shared");
}

#[test]
fn povray_scenes_bake_through_triangles() {
    let path = std::env::temp_dir().join(format!("etendue-bake-{}.pov", std::process::id()));
    std::fs::write(&path, "sphere { 0, 1 pigment { rgb 1 } } light_source { <3, 5, -4> rgb 1 }").unwrap();
    let desc = etendue_scene::formats::read(&path, &ReadOptions::default()).unwrap();
    std::fs::remove_file(&path).unwrap();
    let bake = Bake::new(&desc, &RenderSettings::default(), &small(), "path").unwrap();
    let stage = Stage::without_camera(0, &|| false, &|_, _| {});
    let method = bake.method("path", true, &stage, &mut Vec::new()).unwrap();
    let mut solution = Solution::new(bake.point_count());
    bake.solve(&method, Stop { spp: Some(4), ..Stop::default() }, &mut solution, &Cancel::default(), &Quiet);
    let lit = (0..solution.sums.len()).filter_map(|i| solution.irradiance(i)).filter(|e| e[0] > 0.0).count();
    let all = solution.sums.len();
    assert!(lit * 4 > all && lit * 4 < 3 * all, "about half of a sphere is lit: {lit} of {all}");
}
