//! Baking: irradiance of texels against known answers, no leaks, the same bits however it is run, files that show the light.

mod support;

use etendue_render::integrator::Stage;
use etendue_render::lightmap::output::{self, Display};
use etendue_render::lightmap::probes::{self, Grid};
use etendue_render::lightmap::{Bake, BakeOptions, Solution, Target};
use etendue_render::session::{Cancel, Stop};
use etendue_scene::desc::*;
use etendue_scene::formats::{ReadOptions, gltf};
use etendue_scene::{RenderSettings, SceneDesc};
use glam::{Mat4, Vec2, Vec3};
use std::f32::consts::PI;
use std::path::Path;
use support::baking::*;
use support::*;

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
fn faces_that_touch_borrow_the_light_beside_them() {
    // Between two cubes under a sky: no ray gets there, but the pixels of a viewer do.
    let mut desc = scene();
    view(&mut desc);
    let gray = diffuse(&mut desc, 0.5);
    let both = bsdf(&mut desc, BsdfDesc::TwoSided { front: gray, back: gray });
    for x in [-1.0, 1.0] {
        shape(&mut desc, GeometryDesc::Cube, Mat4::from_translation(Vec3::new(x, 0.0, 0.0)), Some(both));
    }
    constant_sky(&mut desc, 1.0);
    let options = BakeOptions { resolution: 64, texels_per_meter: Some(6.0), ..BakeOptions::default() };
    let (bake, solution, baked) = bake(&desc, &depth(1), &options, 16);
    let mut touching = 0;
    for (i, (texel, (_, p, n))) in layout(&bake).texels.iter().zip(places(&bake)).enumerate() {
        let map = &baked.irradiance[texel.atlas as usize];
        let e = map.data[map.index(texel.at[0], texel.at[1])][0];
        assert!(e > 0.45 * PI, "{p} {n}: {e}");
        let is_between = p.x.abs() < 1e-3 && n.x.abs() > 0.5;
        assert_eq!(solution.irradiance(i).is_none(), is_between, "{p} {n}");
        touching += u32::from(is_between);
    }
    assert!(touching > 200, "{touching}");
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

/// Irradiance of all texels by a method, summed over the channels.
fn texels_by(bake: &Bake, name: &str, gather: bool, spp: u32) -> Vec<f64> {
    let is_cancelled = || false;
    let stage = Stage::without_camera(0, &is_cancelled, &|_, _| {});
    let method = bake.method(name, gather, &stage, &mut Vec::new()).unwrap();
    let mut solution = Solution::new(bake.point_count());
    bake.solve(&method, Stop { spp: Some(spp), ..Stop::default() }, &mut solution, &Cancel::default(), &Quiet);
    (0..solution.sums.len()).map(|i| solution.irradiance(i).map_or(0.0, |e| f64::from(e[0] + e[1] + e[2]))).collect()
}

#[test]
fn all_methods_find_the_same_light() {
    let desc = corner();
    let settings = RenderSettings { photons: Some(100_000), photon_neighbors: Some(32), ..RenderSettings::default() };
    let bake = Bake::new(&desc, &settings, &small(), "path").unwrap();
    // The floor under a wall is dark, but an element that reaches below it has one light for both parts: such texels nobody sees.
    let path = texels_by(&bake, "path", false, 64);
    let mean = path.iter().sum::<f64>() / path.len() as f64;
    let sum = |texels: &[f64]| texels.iter().zip(&path).filter(|(_, p)| **p > 0.02 * mean).map(|(t, _)| t).sum::<f64>();
    let cases = [("radiosity", false, 4), ("radiosity", true, 32), ("particles", true, 32), ("particles", false, 4)];
    let found = cases.map(|(name, gather, spp)| (name, gather, sum(&texels_by(&bake, name, gather, spp)) / sum(&path)));
    println!("light by method, final gathering, over that of paths: {found:?}");
    assert!(found.iter().all(|(_, _, ratio)| (ratio - 1.0).abs() < 0.02), "method, final gathering, ratio: {found:?}");
}

/// Rays of a final gather cross fog: it dims what lies behind, scatters the light of the lamp and glows.
#[test]
fn media_on_the_way_of_a_final_gather() {
    let sum = |texels: &[f64]| texels.iter().sum::<f64>();
    let with = |fog: Option<(f32, f32)>| {
        let mut desc = corner();
        if let Some((scattering, emission)) = fog {
            let none = bsdf(&mut desc, BsdfDesc::Null);
            let phase = PhaseDesc::HenyeyGreenstein { g: 0.4 };
            let medium = MediumDesc::Homogeneous { sigma_a: [0.8; 3], sigma_s: [scattering; 3], emission: [emission; 3], phase };
            let medium = add(&mut desc, medium);
            let ball = sphere(&mut desc, Vec3::new(0.6, -0.6, 0.9), 0.8, Some(none));
            desc.shapes[ball.0 as usize].value.interior = Some(medium);
        }
        let settings = RenderSettings { photons: Some(100_000), photon_neighbors: Some(32), ..RenderSettings::default() };
        let bake = Bake::new(&desc, &settings, &small(), "path").unwrap();
        ["path", "particles"].map(|name| sum(&texels_by(&bake, name, name != "path", 48)))
    };
    let clear = with(None)[0];
    for (name, fog, at_least) in [("absorbs", (0.0, 0.0), -1.0), ("scatters", (3.0, 0.0), -1.0), ("glows", (0.0, 1.0), 0.0)] {
        let [path, gathered] = with(Some(fog));
        println!("{name}: {:.3} of the light without fog, gathered {:.3} of that of paths", path / clear, gathered / path);
        assert!((gathered / path - 1.0).abs() < 0.02, "{name}: {gathered} instead of {path}");
        assert!(path / clear - 1.0 > at_least && (path / clear - 1.0).abs() > 0.05, "{name}: fog that nobody notices, {path} of {clear}");
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
