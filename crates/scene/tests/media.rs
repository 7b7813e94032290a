//! Participating media in files: what readers make of them, and that writers keep them.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod support;

use std::path::Path;

use etendue_scene::desc::*;
use etendue_scene::formats::{ReadOptions, mitsuba, pbrt, read};
use etendue_scene::{ReadError, SceneDesc, Span};
use glam::{Mat4, Vec3};
use support::TempFolder;

/// A `.vol` file.
fn vol(size: [u32; 3], channels: u32, data: &[f32]) -> Vec<u8> {
    let mut bytes = b"VOL\x03".to_vec();
    for n in [1, size[0], size[1], size[2], channels] {
        bytes.extend(n.to_le_bytes());
    }
    for v in [-1.0f32, 0.0, 0.0, 1.0, 2.0, 3.0].iter().chain(data) {
        bytes.extend(v.to_le_bytes());
    }
    bytes
}

fn grid(desc: &SceneDesc, i: usize) -> &GridMediumDesc {
    match &desc.media[i].value {
        MediumDesc::Grid(grid) => grid,
        other => panic!("{other:?}"),
    }
}

fn volume(desc: &SceneDesc, field: &FieldDesc) -> VolumeDesc {
    desc[field.volume.unwrap()].value.clone()
}

const SMOKE: &str = r#"<scene version="3.0.0">
  <medium type="heterogeneous" id="smoke"><float name="scale" value="4"/>
    <volume name="sigma_t" type="gridvolume"><string name="filename" value="smoke.vol"/><string name="filter_type" value="nearest"/>
      <boolean name="use_grid_bbox" value="true"/><transform name="to_world"><translate x="10"/></transform></volume>
    <volume name="albedo" type="constvolume"><rgb name="value" value="0.9, 0.8, 0.7"/></volume>
    <phase type="blendphase"><float name="weight" value="0.25"/><phase type="hg"><float name="g" value="0.6"/></phase><phase type="rayleigh"/></phase></medium>
  <sensor type="perspective"><ref id="smoke"/></sensor>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="smoke"/></shape></scene>"#;

#[test]
fn mitsuba_grid_volumes_are_read_and_come_back() {
    let folder = TempFolder::new("media-a");
    let data: Vec<f32> = (0..24).map(|i| i as f32 * 0.5).collect();
    folder.put("smoke.vol", vol([2, 3, 4], 1, &data));
    let desc = read(&folder.put("scene.xml", SMOKE), &ReadOptions::default()).unwrap();
    let medium = grid(&desc, 0);
    let v = volume(&desc, &medium.extinction);
    assert_eq!((v.size, v.channels, &v.data, v.filter, v.wrap), ([2, 3, 4], 1, &data, VolumeFilter::Nearest, VolumeWrap::Clamp));
    assert_eq!(v.world_from_volume.transform_point3(Vec3::ZERO), Vec3::new(9.0, 0.0, 0.0));
    assert_eq!(v.world_from_volume.transform_point3(Vec3::ONE), Vec3::new(11.0, 2.0, 3.0));
    assert_eq!(medium.extinction.factor, [4.0; 3]);
    assert_eq!(medium.scattering, ScatteringDesc::Albedo(FieldDesc::constant([0.9, 0.8, 0.7])));
    let parts = (Box::new(PhaseDesc::HenyeyGreenstein { g: 0.6 }), Box::new(PhaseDesc::Rayleigh));
    assert_eq!(medium.phase, PhaseDesc::Blend { first: parts.0, second: parts.1, weight: 0.25 });
    assert_eq!(desc.cameras[0].value.medium, Some(MediumId(0)));
    assert!(desc.report.losses.is_empty(), "{:?}", desc.report.losses);

    // Written as Mitsuba's and read again: the factor is in the values then.
    let path = folder.path().join("again.xml");
    let report = mitsuba::write(&desc, &path).unwrap();
    assert!(report.losses.is_empty(), "{:?}", report.losses);
    let again = read(&path, &ReadOptions::default()).unwrap();
    let (a, b) = (grid(&desc, 0), grid(&again, 0));
    let w = volume(&again, &b.extinction);
    let scaled: Vec<f32> = data.iter().flat_map(|v| [v * 4.0; 3]).collect();
    assert_eq!((w.size, w.channels, w.data, w.filter), ([2, 3, 4], 3, scaled, VolumeFilter::Nearest));
    assert!(w.world_from_volume.abs_diff_eq(v.world_from_volume, 1e-5));
    assert_eq!((&a.scattering, &a.phase), (&b.scattering, &b.phase));
    assert_eq!(again.cameras[0].value.medium, Some(MediumId(0)));

    // As pbrt's: the phase function is lost by name.
    let path = folder.path().join("again.pbrt");
    let report = pbrt::write(&desc, &path).unwrap();
    assert!(report.losses.iter().any(|l| l.feature == "blend of phase functions"), "{:?}", report.losses);
    let again = read(&path, &ReadOptions::default()).unwrap();
    let b = grid(&again, 0);
    let w = volume(&again, &b.extinction);
    assert_eq!((w.size, w.channels, &w.data, w.wrap), ([2, 3, 4], 1, &data, VolumeWrap::Zero));
    assert!(w.world_from_volume.abs_diff_eq(v.world_from_volume, 1e-5));
    let ScatteringDesc::Albedo(albedo) = b.scattering else { panic!("{b:?}") };
    assert!((0..3).all(|k| (albedo.factor[k] - [0.9, 0.8, 0.7][k]).abs() < 1e-5 && (b.extinction.factor[k] - 4.0).abs() < 1e-5));
    assert_eq!(again.cameras[0].value.medium, Some(MediumId(0)));
    assert_eq!(again.shapes[0].value.interior, Some(MediumId(0)));
}

/// Files of OpenVDB, whose own place is kept, where Mitsuba and pbrt have volumes.
#[test]
fn openvdb_files_are_read() {
    let folder = TempFolder::new("media-vdb");
    let vdb = include_bytes!("data/openvdb/grid-half-zip.vdb");
    folder.put("smoke.vdb", vdb.as_slice());
    let xml = SMOKE.replace("smoke.vol", "smoke.vdb").replace(r#"<boolean name="use_grid_bbox" value="true"/>"#, "");
    let desc = read(&folder.put("scene.xml", &xml), &ReadOptions::default()).unwrap();
    let v = volume(&desc, &grid(&desc, 0).extinction);
    assert_eq!((v.size, v.channels, v.filter), ([25, 13, 15], 1, VolumeFilter::Nearest));
    // Values are half a unit apart; the first is that of the indices 0, -1, 2, and the file's to_world adds 10 along x.
    assert_eq!(v.world_from_volume.transform_point3(Vec3::ZERO), Vec3::new(9.75, -0.75, 0.75));
    assert_eq!(v.world_from_volume.transform_point3(Vec3::ONE), Vec3::new(22.25, 5.75, 8.25));
    assert_eq!(v.data[(2 * 13 + 4) * 25 + 4], 0.125 * 3.0 + 0.5 + 0.25 + 1.0);
    let error = |xml: &str| read(&folder.put("other.xml", xml), &ReadOptions::default()).unwrap_err().to_string();
    let other = xml.replace(r#"<string name="filter_type""#, r#"<string name="grid_name" value="heat"/><string name="filter_type""#);
    assert!(error(&other).contains("no grid `heat`"), "{}", error(&other));
    folder.put("smoke.vdb", &vdb[..vdb.len() - 9]);
    assert!(error(&xml).contains("smoke.vdb: the file ends too early"), "{}", error(&xml));

    folder.put("smoke.vdb", vdb.as_slice());
    let text = r#"Translate 10 0 0 MakeNamedMedium "smoke" "string type" "nanovdb" "string filename" "smoke.vdb" Camera "perspective" WorldBegin
        AttributeBegin MediumInterface "smoke" "" Material "interface" Shape "sphere" AttributeEnd"#;
    let desc = read(&folder.put("scene.pbrt", text), &ReadOptions::default()).unwrap();
    let w = volume(&desc, &grid(&desc, 0).extinction);
    assert_eq!((w.size, &w.data), (v.size, &v.data));
    assert!(w.world_from_volume.abs_diff_eq(v.world_from_volume, 1e-5), "{}", w.world_from_volume);
}

#[test]
fn broken_volumes_are_faults_with_a_reason() {
    let folder = TempFolder::new("media-b");
    let path = folder.put("scene.xml", SMOKE);
    let cases: [(&str, Vec<u8>, &str); 4] = [
        ("short", b"VOL".to_vec(), "too short"),
        ("six channels", vol([1, 1, 1], 6, &[0.0; 6]), "6 numbers per value"),
        ("cut", vol([2, 2, 2], 1, &[1.0; 7]), "ends within"),
        ("not a number", vol([1, 1, 1], 1, &[f32::NAN]), "finite"),
    ];
    for (name, bytes, reason) in cases {
        folder.put("smoke.vol", bytes);
        match read(&path, &ReadOptions::default()) {
            Err(ReadError::Invalid { faults, .. }) => {
                assert!(faults.iter().any(|f| f.message.contains(reason)), "{name}: {faults:?}");
            }
            other => panic!("{name}: {:?}", other.map(|d| d.media)),
        }
    }
}

fn pbrt_scene(text: &str) -> SceneDesc {
    pbrt::read_bytes(Path::new("test.pbrt"), text.as_bytes(), &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn pbrt_media_have_their_coefficients_grids_and_places() {
    let desc = pbrt_scene(
        r#"MakeNamedMedium "fog" "string type" "homogeneous" "rgb sigma_a" [1 2 3] "rgb sigma_s" [4 5 6] "float scale" 0.5
             "rgb Le" [10 10 10] "float Lescale" 2 "float g" 0.3
           MakeNamedMedium "milk" "string type" "homogeneous" "string preset" "Wholemilk" "float scale" 2
           MediumInterface "" "fog"
           Camera "perspective"
           WorldBegin
           AttributeBegin
             Translate 1 2 3
             MakeNamedMedium "smoke" "string type" "uniformgrid" "integer nx" 2 "integer ny" 1 "integer nz" 1 "float density" [1 2]
               "point3 p0" [-1 -1 -1] "point3 p1" [1 1 1] "rgb sigma_a" [1 1 1] "rgb sigma_s" [3 3 3] "float scale" 10 "float temperature" [500 1500]
               "float temperatureoffset" 100 "float temperaturescale" 2 "float Lescale" 7
           AttributeEnd
           MakeNamedMedium "colors" "string type" "rgbgrid" "integer nx" 1 "integer ny" 1 "integer nz" 2 "rgb sigma_a" [1 2 3 4 5 6] "rgb sigma_s" [1 1 1 0 0 0]
             "rgb Le" [1 0 0 0 1 0] "float scale" 3
           AttributeBegin
             MediumInterface "smoke" "fog" Material "interface" Shape "sphere"
           AttributeEnd
        "#,
    );
    assert!(desc.report.losses.is_empty() && desc.report.faults.is_empty(), "{:?}", desc.report);
    let MediumDesc::Homogeneous { sigma_a, sigma_s, emission, phase } = &desc.media[0].value else { panic!("fog") };
    assert_eq!((sigma_a, sigma_s), (&[0.5, 1.0, 1.5], &[2.0, 2.5, 3.0]));
    assert_eq!((emission, phase), (&[10.0, 20.0, 30.0], &PhaseDesc::HenyeyGreenstein { g: 0.3 }), "radiance times absorption");
    let MediumDesc::Homogeneous { sigma_a, sigma_s, .. } = &desc.media[1].value else { panic!("milk") };
    assert_eq!((sigma_a[2], sigma_s[0]), (0.028, 5.1));
    let smoke = grid(&desc, 2);
    let v = volume(&desc, &smoke.extinction);
    assert_eq!((v.size, &v.data[..], v.wrap), ([2, 1, 1], &[1.0, 2.0][..], VolumeWrap::Zero));
    assert_eq!(v.world_from_volume, Mat4::from_translation(Vec3::new(0.0, 1.0, 2.0)) * Mat4::from_scale(Vec3::splat(2.0)));
    assert_eq!((smoke.extinction.factor, smoke.scattering), ([40.0; 3], ScatteringDesc::Albedo(FieldDesc::constant([0.75; 3]))));
    let MediumEmissionDesc { source: EmissionSource::BlackBody { kelvin, offset, scale }, by_absorption: true } =
        smoke.emission.clone().unwrap()
    else {
        panic!("{smoke:?}")
    };
    assert_eq!((kelvin.factor[0], offset, scale), (2.0, -200.0, 7.0));
    let colors = grid(&desc, 3);
    assert_eq!(volume(&desc, &colors.extinction).data, [2.0, 3.0, 4.0, 4.0, 5.0, 6.0]);
    assert_eq!(colors.extinction.factor, [3.0; 3]);
    assert_eq!(desc.cameras[0].value.medium, Some(MediumId(0)));
    let shape = &desc.shapes[0].value;
    assert_eq!((shape.interior, shape.exterior), (Some(MediumId(2)), Some(MediumId(0))));

    // Written and read again.
    let folder = TempFolder::new("media-c");
    let path = folder.path().join("again.pbrt");
    let report = pbrt::write(&desc, &path).unwrap();
    assert!(report.losses.is_empty(), "{:?}", report.losses);
    let again = read(&path, &ReadOptions::default()).unwrap();
    assert_eq!(again.media.len(), 4);
    for i in [2, 3] {
        let (a, b) = (grid(&desc, i), grid(&again, i));
        let total = |d: &SceneDesc, m: &GridMediumDesc| {
            let v = volume(d, &m.extinction);
            let factors = m.extinction.factor;
            (0..v.data.len()).map(|j| v.data[j] * factors[if v.channels == 3 { j % 3 } else { 0 }]).collect::<Vec<f32>>()
        };
        assert_eq!(total(&desc, a), total(&again, b));
        assert_eq!(a.emission.is_some(), b.emission.is_some());
    }
    assert_eq!((again.cameras[0].value.medium, again.shapes[0].value.exterior), (Some(MediumId(0)), Some(MediumId(0))));
}

#[test]
fn pbrt_grids_that_do_not_fit_are_faults() {
    let message = |text: &str| match pbrt::read_bytes(Path::new("test.pbrt"), text.as_bytes(), &ReadOptions::default()) {
        Err(ReadError::Invalid { faults, .. }) => faults.iter().map(|f| f.message.clone()).collect::<Vec<_>>().join("; "),
        other => panic!("{:?}", other.map(|d| d.media)),
    };
    let grid = |rest: &str| message(&format!("WorldBegin MakeNamedMedium \"m\" \"string type\" \"uniformgrid\" {rest}"));
    assert!(grid("").contains("needs `density`"));
    assert!(grid("\"integer nx\" 3 \"float density\" [1 2]").contains("do not fill"));
    assert!(
        grid("\"integer nx\" 2000000000 \"integer ny\" 2000000000 \"integer nz\" 2000000000 \"float density\" [1 2]")
            .contains("do not fill")
    );
    assert!(grid("\"integer nx\" -1 \"integer ny\" -2 \"float density\" [1 2]").contains("do not fill"));
    assert!(grid("\"float density\" 1 \"point3 p0\" [1 1 1]").contains("is empty"));
    assert!(grid("\"float density\" 1 \"rgb sigma_s\" [-1 0 0]").contains("negative"));
}

#[test]
fn validation_knows_volumes() {
    let mut desc = SceneDesc::new("test", "test");
    desc.add(Node::new(
        Span::default(),
        VolumeDesc {
            size: [u32::MAX; 3],
            channels: 3,
            data: Vec::new(),
            world_from_volume: Mat4::ZERO,
            filter: VolumeFilter::Linear,
            wrap: VolumeWrap::Clamp,
        },
    ));
    let medium = GridMediumDesc {
        extinction: FieldDesc { factor: [f32::NAN; 3], volume: Some(VolumeId(7)) },
        scattering: ScatteringDesc::Albedo(FieldDesc::constant([1.0; 3])),
        emission: None,
        phase: PhaseDesc::HenyeyGreenstein { g: 1.0 },
    };
    desc.add(Node::new(Span::default(), MediumDesc::Grid(Box::new(medium))));
    let Err(ReadError::Invalid { faults, .. }) = etendue_scene::validate::validate(&mut desc) else { panic!("valid") };
    let text = faults.iter().map(|f| f.message.clone()).collect::<Vec<_>>().join("; ");
    for part in ["do not fit", "inverted", "volume 7", "coefficients", "mean cosine"] {
        assert!(text.contains(part), "{part} in {text}");
    }
}
