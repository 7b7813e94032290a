//! Baking: irradiance of texels against known answers, no leaks, the same bits however it is run, files that show the light.

mod support;

use etendue_render::integrator::Stage;
use etendue_render::lightmap::output::{self, Display};
use etendue_render::lightmap::probes::{self, Grid};
use etendue_render::lightmap::{Bake, BakeError, BakeOptions, Baked, Content, Layout, Sides, Solution, Target, Watcher};
use etendue_render::session::{Cancel, Observer, Stop};
use etendue_scene::desc::*;
use etendue_scene::formats::{ReadOptions, gltf};
use etendue_scene::{RenderSettings, SceneDesc};
use glam::{Mat4, Vec2, Vec3};
use std::f32::consts::PI;
use std::path::Path;
use support::*;

struct Quiet;
impl Observer for Quiet {}
impl Watcher for Quiet {}

fn small() -> BakeOptions {
    BakeOptions { resolution: 64, ..BakeOptions::default() }
}

fn depth(max_depth: u32) -> RenderSettings {
    RenderSettings { max_depth: Some(max_depth), ..RenderSettings::default() }
}

fn bake(desc: &SceneDesc, settings: &RenderSettings, options: &BakeOptions, spp: u32) -> (Bake, Solution, Baked) {
    let bake = Bake::new(desc, settings, options, "path").unwrap();
    let mut solution = Solution::new(bake.point_count());
    let stop = Stop { spp: Some(spp), ..Stop::default() };
    assert!(bake.solve(&bake.path(), stop, &mut solution, &Cancel::default(), &Quiet));
    let baked = bake.finish(&solution, None).unwrap();
    (bake, solution, baked)
}

fn layout(bake: &Bake) -> &Layout {
    match &bake.content {
        Content::Texels(layout, _) => layout,
        Content::Vertices(_) => panic!("texels were asked for"),
    }
}

/// World position and normal of the middle of each texel, with the name of its shape.
fn places(bake: &Bake) -> Vec<(String, Vec3, Vec3)> {
    let layout = layout(bake);
    layout
        .texels
        .iter()
        .map(|t| {
            let chart = &layout.charts[t.chart as usize];
            let side = layout.sides[chart.side as usize];
            let mesh = bake.flat.mesh(side.shape as usize);
            let triangle = chart.chart.triangles[t.triangle as usize] as usize;
            let [a, b, c] = mesh.triangles[triangle].map(|i| mesh.positions[i as usize]);
            let p = a + (b - a) * t.bary.x + (c - a) * t.bary.y;
            let n = (b - a).cross(c - a).normalize() * if side.back { -1.0 } else { 1.0 };
            (bake.flat.desc.shapes[side.shape as usize].name.clone(), p, n)
        })
        .collect()
}

fn name(desc: &mut SceneDesc, shape: ShapeId, name: &str) {
    desc.shapes[shape.0 as usize].name = name.into();
}

fn view(desc: &mut SceneDesc) {
    perspective(desc, Vec3::new(0.0, 0.0, 9.0), Vec3::ZERO, 40.0);
}

/// A box with its normals to the outside, or to the inside.
fn cuboid(desc: &mut SceneDesc, center: Vec3, half: Vec3, inward: bool, material: Option<BsdfId>) -> ShapeId {
    let id = shape(desc, GeometryDesc::Cube, Mat4::from_translation(center) * Mat4::from_scale(half), material);
    desc.shapes[id.0 as usize].value.flip_normals = inward;
    id
}

#[test]
fn everything_convex_under_a_uniform_sky_gets_pi() {
    let mut desc = scene();
    view(&mut desc);
    let white = diffuse(&mut desc, 0.8);
    cuboid(&mut desc, Vec3::ZERO, Vec3::new(1.0, 0.5, 0.25), false, Some(white));
    constant_sky(&mut desc, 1.0);
    let (_, solution, baked) = bake(&desc, &RenderSettings::default(), &small(), 64);
    for i in 0..solution.sums.len() {
        let e = solution.irradiance(i).unwrap();
        assert!((e[0] / PI - 1.0).abs() < 0.2, "{e:?}");
    }
    let filled = baked.irradiance[0].data.iter().filter(|v| v[0] > 0.0);
    let (sum, count) = filled.fold((0.0, 0), |(s, n), v| (s + v[0], n + 1));
    assert!((sum / count as f32 / PI - 1.0).abs() < 5e-3, "{}", sum / count as f32);
}

#[test]
fn a_white_plate_in_a_furnace_gets_the_furnace() {
    // Walls that emit 1 and reflect half: radiance 2 everywhere, irradiance 2π on both sides of a plate that reflects all.
    let mut desc = scene();
    view(&mut desc);
    let (gray, white) = (diffuse(&mut desc, 0.5), diffuse(&mut desc, 1.0));
    let walls = cuboid(&mut desc, Vec3::ZERO, Vec3::splat(2.0), true, Some(gray));
    emit(&mut desc, walls, Color::gray(1.0));
    let both = bsdf(&mut desc, BsdfDesc::TwoSided { front: white, back: white });
    rectangle(&mut desc, Vec3::ZERO, [0.7, 0.7], false, Some(both));
    let options = BakeOptions { resolution: 16, padding: 1, ..BakeOptions::default() };
    let (bake, solution, _) = bake(&desc, &RenderSettings::default(), &options, 256);
    assert_eq!(layout(&bake).sides.len(), 2, "an open two-sided surface has light on both sides");
    let n = solution.sums.len();
    let mean = (0..n).map(|i| solution.irradiance(i).unwrap()[1]).sum::<f32>() / n as f32;
    assert!((mean / (2.0 * PI) - 1.0).abs() < 0.02, "{mean}");
}

/// Irradiance at a point of a surface under a polygon that emits 1 (Lambert 1760).
fn lambert(p: Vec3, n: Vec3, polygon: &[Vec3]) -> f32 {
    let corners: Vec<Vec3> = polygon.iter().map(|v| (*v - p).normalize()).collect();
    let edge = |i: usize| {
        let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
        etendue_render::math::fns::acos(a.dot(b).clamp(-1.0, 1.0)) * a.cross(b).normalize().dot(n)
    };
    0.5 * (0..corners.len()).map(edge).sum::<f32>().abs()
}

#[test]
fn the_floor_under_a_rectangle_light_is_as_bright_as_the_closed_form_says() {
    let mut desc = scene();
    view(&mut desc);
    let gray = diffuse(&mut desc, 0.5);
    rectangle(&mut desc, Vec3::ZERO, [2.0, 2.0], false, Some(gray));
    let light = rectangle(&mut desc, Vec3::new(0.3, 0.0, 1.0), [0.5, 0.25], true, Some(gray));
    emit(&mut desc, light, Color::gray(3.0));
    let options = BakeOptions { resolution: 64, texels_per_meter: Some(8.0), ..BakeOptions::default() };
    let (bake, solution, _) = bake(&desc, &depth(1), &options, 256);
    let polygon = [(-0.5, -0.25), (0.5, -0.25), (0.5, 0.25), (-0.5, 0.25)].map(|(x, y)| Vec3::new(0.3 + x, y, 1.0));
    let (mut sum, mut expected_sum) = (0.0, 0.0);
    for (i, (_, p, n)) in places(&bake).iter().enumerate() {
        let expected = 3.0 * lambert(*p, *n, &polygon);
        let e = solution.irradiance(i).unwrap()[0];
        // A texel is a mean over its area, which the curvature of the light moves by a little.
        assert!((e - expected).abs() < 0.05 * expected + 0.01, "{p}: {e} instead of {expected}");
        sum += e;
        expected_sum += expected;
    }
    assert!((sum / expected_sum - 1.0).abs() < 0.005, "{}", sum / expected_sum);
}

/// Two rooms over one floor, the left one bright: walls of the given thickness (0 for single planes).
fn two_rooms(thickness: f32) -> SceneDesc {
    let mut desc = scene();
    view(&mut desc);
    let gray = diffuse(&mut desc, 0.7);
    let both = bsdf(&mut desc, BsdfDesc::TwoSided { front: gray, back: gray });
    let floor = rectangle(&mut desc, Vec3::ZERO, [4.0, 2.0], false, Some(gray));
    name(&mut desc, floor, "floor");
    let mut wall = |center: Vec3, half: Vec3| {
        if thickness > 0.0 {
            cuboid(&mut desc, center, half.max(Vec3::splat(0.5 * thickness)), false, Some(gray));
        } else {
            let turn = if half.x == 0.0 {
                Mat4::from_cols_array(&[0.0, 0.0, -half.z, 0.0, 0.0, half.y, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
            } else if half.y == 0.0 {
                Mat4::from_cols_array(&[half.x, 0.0, 0.0, 0.0, 0.0, 0.0, half.z, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
            } else {
                Mat4::from_scale(Vec3::new(half.x, half.y, 1.0))
            };
            shape(&mut desc, GeometryDesc::Rectangle, Mat4::from_translation(center) * turn, Some(both));
        }
    };
    for x in [-4.0, 0.013, 4.0] {
        wall(Vec3::new(x, 0.0, 1.0), Vec3::new(0.0, 2.2, 1.2));
    }
    for y in [-2.0, 2.0] {
        wall(Vec3::new(0.0, y, 1.0), Vec3::new(4.2, 0.0, 1.2));
    }
    wall(Vec3::new(0.0, 0.0, 2.0), Vec3::new(4.2, 2.2, 0.0));
    add(&mut desc, LightDesc::Point { position: Vec3::new(-2.0, 0.0, 1.0), intensity: [50.0; 3] });
    desc
}

#[test]
fn a_dark_room_beside_a_bright_one_stays_dark() {
    for thickness in [0.0, 0.3] {
        let desc = two_rooms(thickness);
        let options = BakeOptions { resolution: 128, ..BakeOptions::default() };
        let (bake, _, baked) = bake(&desc, &depth(3), &options, 8);
        let texel = 1.0 / layout(&bake).packing.density as f32;
        let (mut bright, mut dark, mut counts) = (0.0, 0.0f32, [0, 0]);
        for (t, (shape, p, _)) in layout(&bake).texels.iter().zip(places(&bake)) {
            let map = &baked.irradiance[t.atlas as usize];
            let e = map.data[map.index(t.at[0], t.at[1])][0];
            // What is under the wall belongs to either room.
            if shape == "floor" && p.x > 0.013 + 0.5 * thickness + 0.5 * texel {
                dark = dark.max(e);
                counts[1] += 1;
            } else if shape == "floor" && p.x < -0.5 {
                bright += e;
                counts[0] += 1;
            }
        }
        assert!(counts[0] > 200 && counts[1] > 200, "{counts:?}");
        let bright = bright / counts[0] as f32;
        assert!(bright > 1.0 && dark < 1e-4 * bright, "walls of {thickness}: {dark} beside {bright}");
    }
}

#[test]
fn the_same_bits_for_any_threads_and_interruptions() {
    let desc = two_rooms(0.3);
    let (settings, options) = (depth(3), small());
    let run = |threads: usize, steps: &[u32]| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let bake = Bake::new(&desc, &settings, &options, "path").unwrap();
            let file = std::env::temp_dir().join(format!("etendue-lightmap-{}-{threads}", std::process::id()));
            let mut solution = Solution::new(bake.point_count());
            for spp in steps {
                let stop = Stop { spp: Some(*spp), ..Stop::default() };
                bake.solve(&bake.path(), stop, &mut solution, &Cancel::default(), &Quiet);
                bake.save(&file, &solution).unwrap();
                solution = bake.load(&file).unwrap();
            }
            std::fs::remove_file(&file).unwrap();
            let baked = bake.finish(&solution, None).unwrap();
            output::scene(&bake, &baked, Display::Emissive).unwrap().glb(serde_json::json!({})).unwrap().0
        })
    };
    let first = run(1, &[6]);
    assert!(first == run(3, &[6]));
    assert!(first == run(2, &[1, 5, 6]));
}

/// Mean of a rendered picture's R, G and B.
fn mean_of(desc: &SceneDesc, max_depth: u32, spp: u32) -> [f64; 3] {
    let settings = RenderSettings { max_depth: Some(max_depth), ..settings(32, 24, spp) };
    let image = render(desc, &settings).develop();
    let rgb = image.rgb().unwrap();
    let mut sum = [0.0; 3];
    rgb.iter().for_each(|p| (0..3).for_each(|k| sum[k] += f64::from(p[k]) / rgb.len() as f64));
    sum
}

/// A corner of a room with a colored sphere and a light, all diffuse.
fn corner() -> SceneDesc {
    let mut desc = scene();
    perspective(&mut desc, Vec3::new(2.2, -2.6, 2.0), Vec3::new(-0.2, 0.2, 0.5), 50.0);
    let color = |desc: &mut SceneDesc, c: [f32; 3]| bsdf(desc, BsdfDesc::Diffuse { reflectance: Color::Constant(c), alpha: None });
    let (gray, red, blue) = (color(&mut desc, [0.7; 3]), color(&mut desc, [0.8, 0.2, 0.1]), color(&mut desc, [0.2, 0.3, 0.8]));
    cuboid(&mut desc, Vec3::new(0.0, 0.0, -0.1), Vec3::new(3.0, 3.0, 0.1), false, Some(gray));
    cuboid(&mut desc, Vec3::new(-1.6, 0.0, 1.0), Vec3::new(0.1, 3.0, 1.0), false, Some(red));
    cuboid(&mut desc, Vec3::new(0.0, 1.6, 1.0), Vec3::new(3.0, 0.1, 1.0), false, Some(gray));
    sphere(&mut desc, Vec3::new(0.0, 0.3, 0.5), 0.5, Some(blue));
    let light = rectangle(&mut desc, Vec3::new(0.5, -0.5, 2.5), [0.5, 0.5], true, Some(gray));
    emit(&mut desc, light, Color::gray(8.0));
    desc
}

#[test]
fn files_that_are_read_again_show_the_light() {
    let desc = corner();
    let direct = mean_of(&desc, u32::MAX, 64);
    for display in [Display::Emissive, Display::Unlit] {
        let (bake, _, baked) = bake(&desc, &RenderSettings::default(), &BakeOptions { resolution: 128, ..BakeOptions::default() }, 48);
        let scene = output::scene(&bake, &baked, display).unwrap();
        let (glb, _) = scene.glb(serde_json::json!({"a": 1})).unwrap();
        let read = gltf::read_bytes(&glb, Path::new("baked.glb"), &ReadOptions::default()).unwrap();
        let shown = mean_of(&read, 0, 16);
        for k in 0..3 {
            assert!((shown[k] / direct[k] - 1.0).abs() < 0.03, "{display:?}: {shown:?} instead of {direct:?}");
        }
    }
}

#[test]
fn all_methods_find_the_same_light() {
    let desc = corner();
    let settings = RenderSettings { photons: Some(100_000), photon_neighbors: Some(32), ..RenderSettings::default() };
    let is_cancelled = || false;
    let stage = Stage::without_camera(0, &is_cancelled, &|_, _| {});
    let bake = Bake::new(&desc, &settings, &small(), "path").unwrap();
    let mean = |name: &str, gather: bool, spp: u32| {
        let method = bake.method(name, gather, &stage, &mut Vec::new()).unwrap();
        let mut solution = Solution::new(bake.point_count());
        bake.solve(&method, Stop { spp: Some(spp), ..Stop::default() }, &mut solution, &Cancel::default(), &Quiet);
        (0..solution.sums.len()).filter_map(|i| solution.irradiance(i)).map(|e| f64::from(e[0] + e[1] + e[2])).sum::<f64>()
    };
    let expected = mean("path", false, 64);
    for (name, gather, spp, tolerance) in
        [("radiosity", false, 4, 0.03), ("radiosity", true, 32, 0.03), ("particles", true, 32, 0.03), ("particles", false, 4, 0.12)]
    {
        let ratio = mean(name, gather, spp) / expected;
        assert!((ratio - 1.0).abs() < tolerance, "{name}, final gathering {gather}: {ratio}");
    }
}

#[test]
fn vertices_show_the_light_as_well_and_viewers_multiply_it_with_the_base_color() {
    let mut desc = corner();
    let direct = mean_of(&desc, u32::MAX, 64);
    // Vertices need triangles of their own to hold light: the same boxes, finely cut.
    for s in &mut desc.shapes {
        if let GeometryDesc::Cube = s.value.geometry {
            s.value.geometry = GeometryDesc::Mesh { mesh: MeshId(0), face_normals: false, smooth: false };
        }
    }
    add(&mut desc, MeshDesc { file: None, flip_v: false, data: Some(fine_cube(24)) });
    let options = BakeOptions { target: Target::Vertices, ..BakeOptions::default() };
    let (bake, _, baked) = bake(&desc, &RenderSettings::default(), &options, 24);
    let (glb, _) = output::scene(&bake, &baked, Display::Emissive).unwrap().glb(serde_json::json!({})).unwrap();
    let text = String::from_utf8_lossy(&glb);
    assert!(text.contains("COLOR_0") && text.contains("KHR_materials_unlit") && !text.contains("TEXCOORD_1"));
    let read = gltf::read_bytes(&glb, Path::new("baked.glb"), &ReadOptions::default()).unwrap();
    let shown = mean_of(&read, 0, 16);
    for k in 0..3 {
        assert!((shown[k] / direct[k] - 1.0).abs() < 0.05, "{shown:?} instead of {direct:?}");
    }
}

/// The cube [−1, 1]³ in squares.
fn fine_cube(n: u32) -> MeshData {
    let mut mesh = MeshData::default();
    for axis in 0..3 {
        for sign in [-1.0f32, 1.0] {
            let mut normal = Vec3::ZERO;
            normal[axis] = sign;
            let s = Vec3::from_array(std::array::from_fn(|i| if i == (axis + 1) % 3 { 1.0 } else { 0.0 }));
            let t = normal.cross(s);
            let base = mesh.positions.len() as u32;
            for j in 0..=n {
                for i in 0..=n {
                    let at = |k: u32| 2.0 * k as f32 / n as f32 - 1.0;
                    mesh.positions.push(normal + s * at(i) + t * at(j));
                    mesh.normals.push(normal);
                }
            }
            for j in 0..n {
                for i in 0..n {
                    let a = base + j * (n + 1) + i;
                    let b = a + n + 1;
                    mesh.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
                }
            }
        }
    }
    mesh
}

#[test]
fn lightmaps_keep_the_original_materials() {
    let desc = corner();
    let (bake, _, baked) = bake(&desc, &depth(2), &small(), 2);
    let (glb, _) = output::scene(&bake, &baked, Display::Lightmap).unwrap().glb(serde_json::json!({})).unwrap();
    let size = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let root: serde_json::Value = serde_json::from_slice(&glb[20..20 + size]).unwrap();
    assert_eq!(root["extensionsUsed"].as_array().unwrap().iter().filter(|e| *e == "MOZ_lightmap").count(), 1);
    let materials = root["materials"].as_array().unwrap();
    let with_map: Vec<_> = materials.iter().filter(|m| m["extensions"]["MOZ_lightmap"].is_object()).collect();
    assert_eq!(with_map.len(), 4);
    for m in with_map {
        let info = &m["extensions"]["MOZ_lightmap"];
        assert_eq!(info["texCoord"], 1);
        assert!(info["intensity"].as_f64().unwrap() > 0.0 && info["index"].is_u64());
        assert!(m.get("emissiveTexture").is_none() && m.get("emissiveFactor").is_none());
    }
}

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
fn probes_measure_light_from_everywhere_and_from_a_side() {
    let mut desc = scene();
    view(&mut desc);
    cuboid(&mut desc, Vec3::new(0.0, 0.0, -20.0), Vec3::ONE, false, None);
    constant_sky(&mut desc, 2.0);
    let bake = Bake::new(&desc, &depth(1), &small(), "path").unwrap();
    let grid = Grid { origin: Vec3::new(0.0, 0.0, 20.0), step: Vec3::ONE, counts: [1, 1, 1] };
    let field = probes::measure(&bake, &bake.path(), &grid, 256, 0);
    for n in [Vec3::X, -Vec3::Y, Vec3::new(0.6, 0.0, 0.8)] {
        let e = field.probes[0].irradiance(n)[0];
        assert!((e / (2.0 * PI) - 1.0).abs() < 0.04, "{n}: {e}");
    }
    desc.lights.clear();
    add(&mut desc, LightDesc::Directional { direction: -Vec3::X, irradiance: [1.0; 3] });
    let sunny = Bake::new(&desc, &depth(1), &small(), "path").unwrap();
    let probe = &probes::measure(&sunny, &sunny.path(), &grid, 16, 0).probes[0];
    // Bands 0 to 2 of a clamped cosine: 17/16 towards the light, 1/16 away from it (Ramamoorthi and Hanrahan 2001).
    assert!((probe.irradiance(Vec3::X)[0] - 1.0625).abs() < 1e-3 && (probe.irradiance(-Vec3::X)[0] - 0.0625).abs() < 1e-3);
    // The probe in the cube knows it.
    let inside = Grid { origin: Vec3::new(0.0, 0.0, -20.0), ..grid };
    assert_eq!(probes::measure(&sunny, &sunny.path(), &inside, 1, 0).inside(), 1);
    assert!(Grid::new(&sunny.scene, [0, 1, 1]).is_err() && Grid::new(&sunny.scene, [u32::MAX; 3]).is_err());
}

#[test]
fn both_sides_of_a_cut_through_a_sphere_agree() {
    let mut desc = scene();
    view(&mut desc);
    let gray = diffuse(&mut desc, 0.5);
    sphere(&mut desc, Vec3::ZERO, 1.0, Some(gray));
    add(&mut desc, LightDesc::Point { position: Vec3::new(3.0, 2.0, 1.0), intensity: [30.0; 3] });
    let (bake, _, baked) = bake(&desc, &depth(1), &small(), 16);
    let layout = layout(&bake);
    let map = &baked.irradiance[0];
    let look = |p: Vec2| {
        let q = p - 0.5;
        let (x, y) = (q.x.floor(), q.y.floor());
        let at = |dx: f32, dy: f32| map.data[map.index((x + dx).max(0.0) as u32, (y + dy).max(0.0) as u32)][0];
        let (fx, fy) = (q.x - x, q.y - y);
        (at(0.0, 0.0) * (1.0 - fx) + at(1.0, 0.0) * fx) * (1.0 - fy) + (at(0.0, 1.0) * (1.0 - fx) + at(1.0, 1.0) * fx) * fy
    };
    // The place of each triangle in its chart.
    let mut place = std::collections::HashMap::new();
    for (c, chart) in layout.charts.iter().enumerate() {
        for (i, t) in chart.chart.triangles.iter().enumerate() {
            place.insert(*t, (c, i as u32));
        }
    }
    let topology = &bake.flat.shapes[0].topology;
    let (mut difference, mut count) = (0.0, 0);
    for (t, neighbors) in topology.neighbors.iter().enumerate() {
        for (k, other) in neighbors.iter().enumerate() {
            let ((c, i), Some((d, j))) = (place[&(t as u32)], place.get(&(other / 3)).copied()) else { continue };
            if c == d || !topology.smooth[t][k] {
                continue;
            }
            let (a, b, l) = (layout.charts[c].corners(i), layout.charts[d].corners(j), *other as usize % 3);
            let (x, y) = (look((a[k] + a[(k + 1) % 3]) * 0.5), look((b[l] + b[(l + 1) % 3]) * 0.5));
            if x.max(y) > 0.3 {
                difference += (x - y).abs() / x.max(y);
                count += 1;
            }
        }
    }
    assert!(count > 20, "{count}");
    assert!(difference / (count as f32) < 0.02, "{}", difference / count as f32);
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
