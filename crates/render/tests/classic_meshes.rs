//! POV-Ray's solids in triangles: volumes that are known, closed surfaces, normals that agree, hostile numbers.

use std::f64::consts::PI;
use std::path::Path;

use etendue_render::classic::physical::{MeshOptions, meshes};
use etendue_scene::SceneDesc;
use etendue_scene::desc::{GeometryDesc, MeshData};
use etendue_scene::formats::{ReadOptions, pov};

const HEAD: &str = "#version 3.7; global_settings { assumed_gamma 1 }
    camera { location -5*z look_at 0 } light_source { <2, 4, -6> 1 }";

fn tessellated(text: &str, options: &MeshOptions) -> Result<SceneDesc, String> {
    let text = format!("{HEAD}\n{text}");
    let desc = pov::read_bytes(Path::new("test.pov"), text.as_bytes(), &ReadOptions::default()).unwrap();
    meshes(&desc, options)
}

fn triangles(desc: &SceneDesc) -> Vec<&MeshData> {
    let mesh = |g: &GeometryDesc| match g {
        GeometryDesc::Mesh { mesh, .. } => desc[*mesh].value.data.as_ref(),
        _ => None,
    };
    desc.shapes.iter().filter_map(|s| mesh(&s.value.geometry)).collect()
}

/// Volume by the divergence theorem, and the area.
fn measure(desc: &SceneDesc) -> (f64, f64) {
    let (mut volume, mut area) = (0.0, 0.0);
    for mesh in triangles(desc) {
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize].as_dvec3());
            let cross = (b - a).cross(c - a);
            volume += a.dot(b.cross(c)) / 6.0;
            area += 0.5 * cross.length();
            // Triangles wind as their normals say.
            let n: glam::Vec3 = t.iter().map(|&i| mesh.normals[i as usize]).sum();
            assert!(cross.length() < 1e-9 || n.as_dvec3().dot(cross) > 0.0, "{a} {b} {c}: {n}");
        }
    }
    (volume, area)
}

#[track_caller]
fn check(text: &str, volume: f64, relative: f64) {
    let (found, _) = measure(&tessellated(text, &MeshOptions::default()).unwrap());
    assert!((found / volume - 1.0).abs() < relative, "{text}: {found} instead of {volume}");
}

#[test]
fn bodies_have_their_volume() {
    check("sphere { <.3, .2, .1>, 1.5 }", 4.0 / 3.0 * PI * 3.375, 0.006);
    check("box { <-1, -.5, 0>, <1, .5, 3> rotate 30 }", 6.0, 1e-5);
    check("cone { 0, 1, y, .5 scale <2, 1, 1> }", 2.0 * PI / 3.0 * 1.75, 0.004);
    check("torus { 1, .25 }", 2.0 * PI * PI * 0.0625, 0.006);
    check("lathe { linear_spline 5, <0, 0>, <1, 0>, <1, 2>, <.5, 2>, <.5, 0> }", PI * 1.5, 0.004);
    // A hole's points go round the other way, as the walls of both face the side that its points say.
    check("prism { linear_spline 0, 2, 10, <0,0>, <2,0>, <2,2>, <0,2>, <0,0>, <.5,.5>, <.5,1>, <1,1>, <1,.5>, <.5,.5> }", 7.5, 1e-5);
    check("sphere_sweep { linear_spline 2, <-1, 0, 0>, .5, <1, 0, 0>, .5 }", PI * 0.5 + PI / 6.0, 0.05);
}

#[test]
fn contours_have_their_volume() {
    check("quadric { <1, 1, 1>, 0, 0, -1 bounded_by { box { -1.1, 1.1 } } }", 4.0 / 3.0 * PI, 0.004);
    check("isosurface { function { x*x + y*y + z*z - 1 } contained_by { box { -1.2, 1.2 } } max_gradient 4 }", 4.0 / 3.0 * PI, 0.004);
    check("superellipsoid { <1, 1> }", 4.0 / 3.0 * PI, 0.004);
    check("superellipsoid { <.01, .01> }", 8.0, 0.02);
}

#[test]
fn combinations_are_cut_where_they_end() {
    let hole = "difference { box { -1, 1 } cylinder { -2*z, 2*z, .5 } }";
    check(hole, 8.0 - PI * 0.5, 0.002);
    check("intersection { sphere { -.5*x, 1 } sphere { .5*x, 1 } }", PI * (4.0 + 1.0) / 12.0, 0.01);
    check("merge { sphere { -.5*x, 1 } sphere { .5*x, 1 } }", 8.0 / 3.0 * PI - PI * 5.0 / 12.0, 0.006);
    check("intersection { sphere { 0, 1 } plane { y, 0 } }", 2.0 / 3.0 * PI, 0.006);
    // A hole that no corner of the box is near to.
    check("difference { box { -1, 1 } box { <.301, -2, .303>, <.352, 2, .351> } }", 8.0 - 2.0 * 0.051 * 0.048, 1e-3);
}

#[test]
fn clipped_spheres_are_open_and_seen_from_both_sides() {
    let desc = tessellated("sphere { 0, 1 clipped_by { plane { y, 0 } } pigment { rgb 1 } }", &MeshOptions::default()).unwrap();
    let (_, area) = measure(&desc);
    assert!((area / (2.0 * PI) - 1.0).abs() < 0.004, "{area}");
    let bsdf = desc.shapes[0].value.bsdf.unwrap();
    assert_eq!(desc[bsdf].value.type_name(), "twosided");
}

#[test]
fn patterns_color_the_vertices() {
    let text = "box { -1, 1 pigment { checker rgb x, rgb y scale .5 } finish { diffuse .8 } }";
    let desc = tessellated(text, &MeshOptions::default()).unwrap();
    let mesh = triangles(&desc)[0];
    let colors = &mesh.attributes.iter().find(|a| a.name == "color").unwrap().data;
    let pure = colors.chunks(3).filter(|c| (c[0] - 0.8).abs() + c[1] < 0.01 || (c[1] - 0.8).abs() + c[0] < 0.01).count();
    assert!(pure * 10 > colors.len() / 3 * 9 && mesh.positions.len() > 1000, "{pure} of {}", colors.len() / 3);
}

#[test]
fn a_right_handed_scene_is_the_mirrored_one() {
    let text = "box { <0, 0, 1>, <1, 1, 3> }";
    let plain = tessellated(text, &MeshOptions::default()).unwrap();
    let mirrored = tessellated(text, &MeshOptions { right_handed: true, ..MeshOptions::default() }).unwrap();
    let volume = |d: &SceneDesc| measure(d).0;
    assert!((volume(&plain) - 2.0).abs() < 1e-5 && (volume(&mirrored) - 2.0).abs() < 1e-5);
    assert!(triangles(&mirrored)[0].positions.iter().all(|p| p.z <= -0.999));
    assert!(mirrored.cameras[0].value.world_from_camera.determinant() > 0.0);
}

#[test]
fn hostile_numbers_end() {
    for text in [
        "sphere { 1e300, 1e300 }",
        "torus { 1e-300, 1e300 }",
        "isosurface { function { 1/(x*0) } }",
        "blob { threshold 1e-9 sphere { 0, 1e30, 1e30 } }",
        "sphere_sweep { b_spline 4, 0, 1e200, x, 0, y, -1, z, 1 }",
        "difference { sphere { 0, 1e-200 } sphere { 0, 1e200 inverse } }",
        "plane { y, 1e200 } disc { 0, y, 1e200 }",
        "polygon { 4, 0, 0, 0, 0 }",
        "height_field { function 4, 4 { 1e300 } water_level -1e300 }",
    ] {
        let options = MeshOptions { segments: 16, ..MeshOptions::default() };
        if let Ok(desc) = tessellated(text, &options) {
            assert!(triangles(&desc).iter().all(|m| m.triangles.iter().flatten().all(|&i| (i as usize) < m.positions.len())), "{text}");
        }
    }
}
