//! glTF files that others made; skipped where they are not there.

use std::path::{Path, PathBuf};

use etendue_scene::desc::{BsdfDesc, GeometryDesc, ImageSource, ProjectionDesc, Scalar};
use etendue_scene::formats::{self, ReadOptions, gltf};

pub fn sample(name: &str) -> Option<PathBuf> {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes");
    let alternative = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../../shared/scenes");
    let found = [scenes, alternative].into_iter().map(|d| d.join(name)).find(|p| p.is_file());
    if found.is_none() {
        eprintln!("skipped: no {name} in ../shared/scenes");
    }
    found
}

#[test]
fn helmet() {
    let Some(path) = sample("helmet.glb") else { return };
    let desc = gltf::read(&path, &ReadOptions::default()).unwrap();
    assert!(desc.report.faults.is_empty() && desc.report.losses.is_empty(), "{:?}", desc.report);
    // The checks of the description agree.
    assert_eq!(formats::read(&path, &ReadOptions::default()).unwrap().shapes.len(), 9);
    assert_eq!(desc.shapes.len(), 9);
    assert_eq!(desc.images.len(), 15);
    let lights: Vec<_> = desc.shapes.iter().filter(|s| s.value.emission.is_some()).collect();
    assert_eq!(lights.len(), 2);
    assert!(lights.iter().all(|l| l.value.emission.as_ref().unwrap().two_sided));
    let ProjectionDesc::Perspective { fov_rad, .. } = desc.cameras[0].value.projection else { panic!() };
    assert!((fov_rad - 0.471_09).abs() < 1e-5);
    assert_eq!((desc.film.width, desc.film.height), (Some(960), Some(720)));
    let lenses = desc.shapes.iter().find(|s| s.name == "Lenses_low").unwrap();
    assert!(matches!(desc[lenses.value.bsdf.unwrap()].value, BsdfDesc::Mask { .. }));
    for shape in &desc.shapes {
        let GeometryDesc::Mesh { mesh, .. } = shape.value.geometry else { panic!() };
        let data = desc[mesh].value.data.as_ref().unwrap();
        assert!(data.normals.len() == data.positions.len() && data.uvs.len() == data.positions.len());
    }
}

#[test]
fn golf() {
    let Some(path) = sample("golf.glb") else { return };
    let desc = gltf::read(&path, &ReadOptions::default()).unwrap();
    assert!(desc.report.faults.is_empty() && desc.report.losses.is_empty(), "{:?}", desc.report);
    let pbr: Vec<_> = desc.bsdfs.iter().filter_map(|b| if let BsdfDesc::Pbr(p) = &b.value { Some(p) } else { None }).collect();
    let ball = pbr.iter().find(|p| p.clearcoat == Scalar::Constant(1.0)).unwrap();
    assert!(ball.clearcoat_normal.is_some());
    assert!(desc.images.iter().all(|i| matches!(&i.value.source, ImageSource::Embedded(b) if b.starts_with(b"\x89PNG"))));
    assert!(desc.bsdfs.iter().any(|b| matches!(b.value, BsdfDesc::NormalMap { .. })));
}
