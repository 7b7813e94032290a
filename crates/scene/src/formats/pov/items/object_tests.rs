//! Objects read from text.

use glam::{DMat4, DVec3};

use crate::desc::classic::{BlobKind, ClassicScene, Mesh, Object, OutlineSegment, Solid};
use crate::formats::pov::Parser;
use etendue_procedural::{Pigment, Texture};

fn scene(text: &str) -> ClassicScene {
    let mut parser = Parser::from_text(text);
    let result = parser.parse_scene();
    assert!(result.is_ok() && !parser.report.has_errors(), "{text}: {:?}", parser.report.faults);
    parser.scene
}

fn one(text: &str) -> Object {
    let scene = scene(text);
    assert_eq!(scene.objects.len(), 1, "{text}");
    Object::clone(&scene.objects[0])
}

fn fault(text: &str) -> String {
    let mut parser = Parser::from_text(text);
    let result = parser.parse_scene();
    assert!(result.is_err() || parser.report.has_errors(), "{text}");
    format!("{:?}", parser.report.faults)
}

#[test]
fn every_shape() {
    for text in [
        "sphere { <1, 2, 3>, 4 }",
        "sphere { 0 1 }",
        "box { -1, 1 }",
        "cylinder { 0, y, 0.5 open }",
        "cone { 0, 1, y, 0 open }",
        "torus { 1, 0.25 sturm }",
        "plane { y, -1 }",
        "disc { 0, y, 1 }",
        "disc { 0, y, 1, 0.5 }",
        "triangle { 0, x, y }",
        "smooth_triangle { 0, z, x, z, y, z }",
        "polygon { 4, <0, 0>, <1, 0>, <1, 1>, <0, 1> }",
        "polygon { 4 <0, 0> <1, 0> <1, 1> <0, 1> }",
        "quadric { <1, 1, 1>, 0, 0, -1 }",
        "quartic { <1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, -1> }",
        "poly { 2, <1, 0, 0, 0, 1, 0, 0, 1, 0, -1> sturm }",
        "polynomial { 2, xyz(2, 0, 0): 1, xyz(0, 2, 0): 1 xyz(0, 0, 2): 1, xyz(0, 0, 0): -1 sturm }",
        "superellipsoid { <0.3, 0.5> }",
        "ovus { 1, 0.5 }",
        "lathe { cubic_spline 4, <1, 0>, <1, 1>, <2, 2>, <1, 3> sturm }",
        "lathe { 2 <1, 0> <1, 1> }",
        "sor { 4, <1, 0>, <1, 1>, <2, 2>, <1, 3> open }",
        "prism { conic_sweep linear_spline 0, 1, 4, <0, 0>, <1, 0>, <1, 1>, <0, 0> open }",
        "prism { 0 1 4 <0, 0> <1, 0> <1, 1> <0, 0> }",
        "sphere_sweep { linear_spline 2, 0, 1, x, 0.5 tolerance 1e-3 }",
        "bicubic_patch { type 1 flatness 0.01 u_steps 3 v_steps 3 0, x, 2*x, 3*x, y, x+y, <2,1,0>, <3,1,0>, 2*y, <1,2,0>, <2,2,0>, <3,2,0>, 3*y, <1,3,0>, <2,3,0>, <3,3,0> }",
        "julia_fractal { <-0.1, 0, -0.8, 0> hypercomplex pwr(2, 0) max_iteration 8 precision 15 slice <0, 0, 0, 1>, 0.1 }",
        "blob { threshold 0.6 sphere { 0, 1, 1 pigment { rgb x } translate x } cylinder { 0, y, 1, strength 2 } component 1, 1, 0 sturm hierarchy off }",
    ] {
        let scene = scene(&format!("{text} {}", text.replace(" }", " translate x }").replacen("} translate x", "}", 0)));
        assert_eq!(scene.objects.len(), 2, "{text}");
    }
}

#[test]
fn values_are_where_they_belong() {
    assert_eq!(one("box { <1, 2, 3>, <4, 5, 6> }").solid, Solid::Box { corners: [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)] });
    let Solid::Blob(blob) = one("blob { threshold 0.5 cylinder { x, y, 2, strength 3 scale 2 } }").solid else { panic!() };
    assert_eq!(blob.threshold, 0.5);
    assert_eq!(blob.components[0].kind, BlobKind::Cylinder(DVec3::X, DVec3::Y));
    assert_eq!((blob.components[0].radius, blob.components[0].strength), (2.0, 3.0));
    assert_eq!(blob.components[0].blob_from_component, DMat4::from_scale(DVec3::splat(2.0)));
}

#[test]
fn meshes() {
    let Solid::Mesh(mesh) = one(
        "#declare T = texture { pigment { rgb x } } mesh { triangle { 0, x, y texture { T } } smooth_triangle { 0, z, x, z, y, z uv_vectors <0, 0>, <1, 0>, <0, 1> } \
         triangle { 0, x, z texture { T } } inside_vector z }",
    )
    .solid
    else {
        panic!()
    };
    assert_eq!(mesh.faces.len(), 3);
    assert_eq!(mesh.normal_faces, [Mesh::NONE, [0, 1, 2]]);
    assert_eq!(mesh.uv_faces, [Mesh::NONE, [0, 1, 2]]);
    assert_eq!(mesh.texture_faces, [[0; 3], Mesh::NONE, [0; 3]]);
    assert_eq!(mesh.textures.len(), 1);
    assert_eq!(mesh.inside_vector, Some(DVec3::Z));
    let Solid::Mesh(mesh) = one(
        "mesh2 { vertex_vectors { 4, 0, x, y, z } normal_vectors { 4, z, z, z, z } texture_list { 2, texture { pigment { rgb x } } texture { pigment { rgb y } } } \
         face_indices { 2, <0, 1, 2>, 1, <0, 2, 3>, 0, 1, 1 } inside_vector y pigment { rgb z } }",
    )
    .solid
    else {
        panic!()
    };
    assert_eq!(mesh.normal_faces, mesh.faces);
    assert_eq!(mesh.texture_faces, [[1; 3], [0, 1, 1]]);
    assert!(fault("mesh2 { vertex_vectors { 3, 0, x, y } face_indices { 1, <0, 1, 3> } }").contains("beyond the 3 vertices"));
}

fn color(texture: &Texture, layer: usize) -> DVec3 {
    let Texture::Layers(layers) = texture else { panic!() };
    let p = Pigment::color(&layers[layer].pigment, &etendue_procedural::Context::at(DVec3::ZERO));
    p.rgb
}

/// As POV-Ray 3.7.0.10 renders it: pigments change, textures lie over, defaults count where the object enters the scene.
#[test]
fn textures_of_objects() {
    let declare = "#declare R = sphere { 0, 1 texture { pigment { rgb x } } } #declare N = sphere { 0, 1 } ";
    let texture = |text: &str| one(&format!("{declare}{text}")).texture.unwrap();
    assert_eq!(color(&texture("object { R pigment { rgb y } }"), 0), DVec3::Y);
    let layered = texture("object { R texture { pigment { rgb z } } }");
    assert_eq!((color(&layered, 0), color(&layered, 1)), (DVec3::X, DVec3::Z));
    let layered = texture("object { R material { texture { pigment { rgb z } } } }");
    assert_eq!(color(&layered, 1), DVec3::Z);
    let default = one(&format!("{declare}#default {{ pigment {{ rgb <1, 1, 0> }} }} object {{ N }}"));
    assert_eq!(color(&default.texture.clone().unwrap(), 0), DVec3::new(1.0, 1.0, 0.0));
    assert!(default.texture_is_default);
}

#[test]
fn combinations_and_modifiers() {
    let o = one(
        "difference { sphere { 0, 1 } box { 0, 1 inverse } hollow no_shadow no_image off cutaway_textures rotate 90*z interior { ior 1.5 } \
                 photons { target 2 reflection on refraction off collect off } clipped_by { plane { y, 0 } } bounded_by { clipped_by } }",
    );
    let Solid::Difference(parts) = &o.solid else { panic!() };
    assert!(parts[1].inverse && o.hollow && o.hollow_stated && o.no_shadow && !o.no_image && o.cutaway_textures);
    assert_eq!(o.photons.target, Some(2.0));
    assert_eq!((o.photons.reflection, o.photons.refraction, o.photons.no_collect), (Some(true), Some(false), true));
    assert_eq!(o.clipped_by, o.bounded_by);
    // The clip and the bound count as well.
    assert_eq!((o.leaves, o.depth), (4, 1));
    // Grown step by step, unions stay flat.
    let grown = one(
        "#declare A = union { sphere { 0, 1 } } #for (I, 1, 1000) #declare A = union { object { A } sphere { I, 1 } } #end object { A }",
    );
    assert_eq!((grown.leaves, grown.depth), (1001, 1));
    let scene = scene("union { sphere { 0, 1 } union { light_source { <1, 2, 3>, rgb 1 } translate x } scale 2 }");
    assert_eq!((scene.objects.len(), scene.lights.len()), (1, 1));
}

#[test]
fn hostile_objects() {
    // Doubling: 2^60 parts.
    let text = "#declare A = sphere { 0, 1 }; #for (I, 1, 60) #declare A = union { object { A scale 2 } object { A } } #end";
    assert!(fault(text).contains("primitives"));
    let text = "#declare A = sphere { 0, 1 }; #for (I, 1, 600) #declare A = merge { object { A } } #end";
    assert!(fault(text).contains("deep"));
    let text = "#declare A = sphere { 0, 1 }; #for (I, 1, 600) #declare A = box { 0, 1 clipped_by { object { A } } } #end";
    assert!(fault(text).contains("deep"));
    assert!(fault("mesh2 { vertex_vectors { 1e12, 0 } }").contains("between 0 and"));
    assert!(fault("polygon { -1, 0 }").contains("between 0 and"));
    assert!(fault("sphere { 0, 1 frobnicate }").contains("frobnicate"));
    assert!(fault("union { sphere { 0, 1 }").contains("end of the file"));
    assert!(fault("superellipsoid { <0, 1> }").contains("greater than 0"));
}

#[test]
fn letters() {
    let mut parser = Parser::from_text("text { internal 1 \"IT\" 0.5, 0.1*x }");
    if parser.parse_scene().is_err() {
        // No fonts on this machine.
        return;
    }
    let Solid::Text(text) = &parser.scene.objects[0].solid else { panic!() };
    assert_eq!((text.glyphs.len(), text.thickness), (2, 0.5));
    // Closed contours.
    for contour in text.outlines.iter().flat_map(|o| &o.contours) {
        let ends = |s: &OutlineSegment| match s {
            OutlineSegment::Line([a, b]) | OutlineSegment::Quadratic([a, _, b]) => (*a, *b),
        };
        for i in 0..contour.len() {
            assert_eq!(ends(&contour[i]).1, ends(&contour[(i + 1) % contour.len()]).0);
        }
    }
}

#[test]
fn uv_mapping_of_an_object_is_that_of_its_texture() {
    let pigment = "pigment { checker rgb 0 rgb 1 scale 0.5 }";
    for text in [
        format!("box {{ -1, 1 uv_mapping texture {{ {pigment} }} rotate y*90 }}"),
        format!("box {{ -1, 1 {pigment} uv_mapping }}"),
        format!("box {{ -1, 1 texture {{ uv_mapping {pigment} }} }}"),
    ] {
        let object = one(&text);
        let layers = object.texture.as_ref().and_then(|t| t.layers()).unwrap();
        assert!(matches!(&layers[0].pigment, Pigment::Patterned(p) if p.uv_mapping), "{text}");
    }
}
