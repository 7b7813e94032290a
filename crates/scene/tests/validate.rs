//! Descriptions that no reader should make: found before anything is compiled.

#![allow(clippy::unwrap_used, clippy::panic)]

mod support;

use etendue_scene::desc::*;
use etendue_scene::formats::{ReadOptions, read};
use etendue_scene::validate::{picture_size, validate};
use etendue_scene::{ReadError, SceneDesc, Span};
use glam::{Mat4, Vec3};
use support::TempFolder;

fn faults(mut desc: SceneDesc) -> Vec<String> {
    match validate(&mut desc) {
        Ok(()) => Vec::new(),
        Err(ReadError::Invalid { faults, .. }) => faults.into_iter().map(|f| f.message).collect(),
        Err(e) => panic!("{e}"),
    }
}

fn with(build: impl FnOnce(&mut SceneDesc)) -> Vec<String> {
    let mut desc = SceneDesc::new("test", "test");
    build(&mut desc);
    faults(desc)
}

fn node<T>(value: T) -> Node<T> {
    Node::new(Span::default(), value)
}

#[test]
fn ids_out_of_range_are_found() {
    let found = with(|d| {
        let mut shape = ShapeDesc::new(GeometryDesc::Mesh { mesh: MeshId(3), face_normals: false, smooth: false }, Mat4::IDENTITY);
        shape.bsdf = Some(BsdfId(7));
        shape.interior = Some(MediumId(1));
        d.add(node(shape));
        d.add(node(InstanceDesc { group: GroupId(2), world_from_object: Mat4::IDENTITY }));
        d.add(node(BsdfDesc::Diffuse { reflectance: Param::Texture(TextureId(9)), alpha: None }));
    });
    let expected = [
        "texture 9, but there are 0",
        "bsdf 7, but there are 1",
        "medium 1, but there are 0",
        "mesh 3, but there are 0",
        "group 2, but there are 0",
    ];
    assert_eq!(found, expected.map(|e| format!("refers to {e}")));
}

#[test]
fn cycles_and_expansions_are_found() {
    let found = with(|d| {
        d.add(node(BsdfDesc::TwoSided { front: BsdfId(1), back: BsdfId(1) }));
        d.add(node(BsdfDesc::Mask { nested: BsdfId(0), opacity: Param::Constant(0.5) }));
    });
    assert!(found.contains(&"a bsdf contains itself".to_owned()), "{found:?}");
    let found = with(|d| {
        d.add(node(TextureDesc::Affine { texture: TextureId(0), scale: 1.0, offset: 0.0, clamp: None }));
    });
    assert_eq!(found, ["a texture contains itself"]);
    // A chain in which each model names the one before it twice: two to the power of forty to evaluate.
    let found = with(|d| {
        d.add(node(BsdfDesc::Null));
        for i in 0..40 {
            d.add(node(BsdfDesc::Blend { first: BsdfId(i), second: BsdfId(i), weight: Param::Constant(0.5) }));
        }
    });
    assert!(found.iter().any(|f| f.contains("expands to more than")), "{found:?}");
    let found = with(|d| {
        d.add(node(BsdfDesc::Null));
        for i in 0..200_000 {
            d.add(node(BsdfDesc::Mask { nested: BsdfId(i), opacity: Param::Constant(0.5) }));
        }
    });
    assert!(found.iter().any(|f| f.contains("nested more than 100 deep")), "{found:?}");
}

#[test]
fn numbers_that_cannot_be_rendered_are_found() {
    let sphere = |center: Vec3, radius: f32, m: Mat4| {
        with(|d| {
            d.add(node(ShapeDesc::new(GeometryDesc::Sphere { center, radius }, m)));
        })
    };
    assert_eq!(sphere(Vec3::ZERO, 1.0, Mat4::from_scale(Vec3::splat(1e-8))), [""; 0]);
    assert_eq!(sphere(Vec3::ZERO, 0.0, Mat4::IDENTITY), ["a radius must be positive and finite, not 0"]);
    assert_eq!(sphere(Vec3::NAN, 1.0, Mat4::IDENTITY), ["a position is not finite"]);
    assert_eq!(sphere(Vec3::ZERO, 1.0, Mat4::from_scale(Vec3::new(1.0, 0.0, 1.0))), ["a transform is not finite or cannot be inverted"]);
    assert_eq!(
        sphere(Vec3::ZERO, 1.0, Mat4::from_cols(Vec3::X.extend(0.5), Vec3::Y.extend(0.0), Vec3::Z.extend(0.0), Vec3::ZERO.extend(1.0))),
        ["a transform is not affine"]
    );
    let mesh = |data: MeshData| {
        with(|d| {
            d.add(node(MeshDesc { file: None, flip_v: false, data: Some(data) }));
        })
    };
    let triangle = MeshData { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]], ..MeshData::default() };
    assert!(mesh(triangle.clone()).is_empty());
    assert_eq!(mesh(MeshData { triangles: vec![[0, 1, 3]], ..triangle.clone() }), ["a mesh has 3 vertices, but a triangle of [0, 1, 3]"]);
    assert_eq!(mesh(MeshData { normals: vec![Vec3::Z], ..triangle }), ["a mesh has 3 vertices but 1 normals"]);
}

#[test]
fn pictures_have_a_largest_size() {
    assert!(picture_size(65536, 32768).is_ok());
    assert!(picture_size(65536, 32769).is_err() && picture_size(65537, 1).is_err() && picture_size(0, 5).is_err());
    let found = with(|d| (d.film.width, d.film.height) = (Some(100_000), Some(10)));
    assert_eq!(found, ["a picture of 100000 × 10 pixels is too large: at most 65536 to an edge and 2^31 in all"]);
}

#[test]
fn a_mesh_opened_as_a_scene_is_framed_and_lit() {
    let folder = TempFolder::new("bare-mesh");
    let path = folder
        .put("m.stl", "solid\nfacet normal 0 0 1\nouter loop\nvertex 10 0 0\nvertex 11 0 0\nvertex 10 1 3\nendloop\nendfacet\nendsolid\n");
    let desc = read(&path, &ReadOptions::default()).unwrap();
    assert_eq!((desc.shapes.len(), desc.cameras.len(), desc.lights.len()), (1, 1, 2));
    let camera = desc.cameras[0].value.world_from_camera.inverse();
    let corners = [Vec3::new(10.0, 0.0, 0.0), Vec3::new(11.0, 0.0, 0.0), Vec3::new(10.0, 1.0, 3.0)].map(|p| camera.transform_point3(p));
    // In front of the camera and within its 45 degrees; +z is up in STL files, and so it is in the picture.
    // The tangent of 22.5 degrees.
    let tangent = std::f32::consts::SQRT_2 - 1.0;
    assert!(corners.iter().all(|p| p.z < 0.0 && p.x.abs() < tangent * -p.z && p.y.abs() < tangent * -p.z), "{corners:?}");
    assert!(corners[2].y > corners[0].y);
}
