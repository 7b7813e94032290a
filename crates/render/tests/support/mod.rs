//! What the renderer's tests share: small scenes made in code, a naive path tracer, and Z-tests of pictures.

#![allow(dead_code, reason = "each test file uses a part")]

pub mod baking;
pub mod naive;
pub mod radiosity;
pub mod statistics;

use std::ops::Range;
use std::sync::Arc;

use etendue_render::film::{Film, FilmMeta, FilmSpec, Filter, Rect};
use etendue_render::integrator::Integrator;
use etendue_render::math::fns;
use etendue_render::sampler::Sampler;
use etendue_render::scene::{self, Scene};
use etendue_render::session::job::{self, Plan};
use etendue_render::session::{Cancel, Session, Silent, Stop};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc, Span};
use glam::{Mat4, Vec3};

/// Adds a node.
pub fn add<T>(desc: &mut SceneDesc, value: T) -> <SceneDesc as AddNode<T>>::Id
where
    SceneDesc: AddNode<T>,
{
    desc.add(Node::new(Span::default(), value))
}

/// An empty scene.
pub fn scene() -> SceneDesc {
    SceneDesc::new("test", "test")
}

/// `world_from_camera` of a camera at `from` that looks at `to`, with +y up where that is possible.
pub fn look_at(from: Vec3, to: Vec3) -> Mat4 {
    let back = (from - to).normalize();
    let up = if back.y.abs() > 0.99 { Vec3::Z } else { Vec3::Y };
    let right = up.cross(back).normalize();
    Mat4::from_cols(right.extend(0.0), back.cross(right).extend(0.0), back.extend(0.0), from.extend(1.0))
}

fn camera(desc: &mut SceneDesc, world_from_camera: Mat4, projection: ProjectionDesc) {
    add(desc, CameraDesc { world_from_camera, projection, near: 0.0, far: f32::INFINITY, medium: None });
}

/// A ball about the origin of so many columns and rows of triangles, with smooth normals.
pub fn ball(desc: &mut SceneDesc, radius: f32, columns: u32, rows: u32) -> GeometryDesc {
    let mut mesh = MeshData::default();
    for y in 0..=rows {
        for x in 0..columns {
            let (phi, theta) = (x as f32 / columns as f32 * std::f32::consts::TAU, y as f32 / rows as f32 * std::f32::consts::PI);
            let ((st, ct), (sp, cp)) = (fns::sin_cos(theta), fns::sin_cos(phi));
            let n = Vec3::new(st * cp, st * sp, ct);
            mesh.positions.push(n * radius);
            mesh.normals.push(n);
        }
    }
    for y in 0..rows {
        for x in 0..columns {
            let at = |x: u32, y: u32| y * columns + x % columns;
            mesh.triangles.push([at(x, y), at(x, y + 1), at(x + 1, y + 1)]);
            mesh.triangles.push([at(x, y), at(x + 1, y + 1), at(x + 1, y)]);
        }
    }
    let mesh = add(desc, MeshDesc { file: None, flip_v: false, data: Some(mesh) });
    GeometryDesc::Mesh { mesh, face_normals: false, smooth: false }
}

/// A pinhole camera.
pub fn perspective(desc: &mut SceneDesc, from: Vec3, to: Vec3, fov_deg: f32) {
    let projection = ProjectionDesc::Perspective {
        fov_rad: fov_deg.to_radians(),
        fov_axis: FovAxis::X,
        aperture_radius: 0.0,
        focus_distance: 1.0,
        principal_point_offset: [0.0; 2],
    };
    camera(desc, look_at(from, to), projection);
}

/// A camera of parallel rays that sees `half_width` to each side.
pub fn orthographic(desc: &mut SceneDesc, from: Vec3, to: Vec3, half_width: f32) {
    camera(desc, look_at(from, to), ProjectionDesc::Orthographic { half_width, half_height: None });
}

/// A camera that sees all directions.
pub fn panoramic(desc: &mut SceneDesc, at: Vec3) {
    camera(desc, Mat4::from_translation(at), ProjectionDesc::Panoramic);
}

/// A scattering model.
pub fn bsdf(desc: &mut SceneDesc, value: BsdfDesc) -> BsdfId {
    add(desc, value)
}

/// Lambert.
pub fn diffuse(desc: &mut SceneDesc, reflectance: f32) -> BsdfId {
    add(desc, BsdfDesc::Diffuse { reflectance: Color::gray(reflectance), alpha: None })
}

/// A perfect mirror, or a rough one of Fresnel factor 1.
pub fn mirror(alpha: Option<f32>) -> BsdfDesc {
    BsdfDesc::Conductor { eta: None, k: Color::gray(0.0), specular_reflectance: Color::gray(1.0), roughness: alpha.map(ggx) }
}

/// Isotropic GGX.
pub fn ggx(alpha: f32) -> Roughness {
    Roughness { distribution: MicrofacetKind::Ggx, alpha_u: Param::Constant(alpha), alpha_v: Param::Constant(alpha) }
}

/// Glass.
pub fn glass(ior: f32, alpha: Option<f32>) -> BsdfDesc {
    BsdfDesc::Dielectric {
        int_ior: ior,
        ext_ior: 1.0,
        specular_reflectance: Color::gray(1.0),
        specular_transmittance: Color::gray(1.0),
        roughness: alpha.map(ggx),
    }
}

/// A thin pane of glass.
pub fn pane(ior: f32) -> BsdfDesc {
    BsdfDesc::ThinDielectric {
        int_ior: ior,
        ext_ior: 1.0,
        specular_reflectance: Color::gray(1.0),
        specular_transmittance: Color::gray(1.0),
    }
}

/// Plastic of index 1.5.
pub fn plastic(reflectance: f32, nonlinear: bool, alpha: Option<f32>) -> BsdfDesc {
    BsdfDesc::Plastic {
        diffuse_reflectance: Color::gray(reflectance),
        specular_reflectance: Color::gray(1.0),
        int_ior: 1.5,
        ext_ior: 1.0,
        nonlinear,
        roughness: alpha.map(ggx),
    }
}

/// A shape of a material.
pub fn shape(desc: &mut SceneDesc, geometry: GeometryDesc, world_from_object: Mat4, material: Option<BsdfId>) -> ShapeId {
    add(desc, ShapeDesc { bsdf: material, ..ShapeDesc::new(geometry, world_from_object) })
}

/// A sphere.
pub fn sphere(desc: &mut SceneDesc, center: Vec3, radius: f32, material: Option<BsdfId>) -> ShapeId {
    shape(desc, GeometryDesc::Sphere { center, radius }, Mat4::IDENTITY, material)
}

/// A rectangle of half edges `half` in a plane of constant z; its normal is +z, or −z where `down`.
pub fn rectangle(desc: &mut SceneDesc, center: Vec3, half: [f32; 2], down: bool, material: Option<BsdfId>) -> ShapeId {
    shape(desc, GeometryDesc::Rectangle, facing(center, half, down), material)
}

/// Places the xy plane's unit shapes at a height, facing up or (turned about x) down.
pub fn facing(center: Vec3, half: [f32; 2], down: bool) -> Mat4 {
    let turn = if down { Mat4::from_diagonal(glam::Vec4::new(1.0, -1.0, -1.0, 1.0)) } else { Mat4::IDENTITY };
    Mat4::from_translation(center) * turn * Mat4::from_scale(Vec3::new(half[0], half[1], 1.0))
}

/// Makes a shape emit.
pub fn emit(desc: &mut SceneDesc, shape: ShapeId, radiance: Color) {
    desc.shapes[shape.0 as usize].value.emission = Some(EmissionDesc { radiance, two_sided: false, group: String::new() });
}

/// The same radiance from everywhere.
pub fn constant_sky(desc: &mut SceneDesc, radiance: f32) {
    add(desc, LightDesc::Constant { radiance: [radiance; 3] });
}

/// Linear pixels as a picture.
pub fn picture(desc: &mut SceneDesc, width: u32, height: u32, channels: u32, data: Vec<f32>) -> ImageId {
    add(desc, ImageDesc { source: ImageSource::Pixels { width, height, channels, data } })
}

/// Settings of a small picture: box filter, independent samples (whose variance the film knows without bias).
pub fn settings(width: u32, height: u32, spp: u32) -> RenderSettings {
    RenderSettings {
        width: Some(width),
        height: Some(height),
        spp: Some(spp),
        filter: Some("box".into()),
        sampler: Some("independent".into()),
        // Not `auto`, whose choice may be a method with a bias.
        integrator: Some("path".into()),
        ..RenderSettings::default()
    }
}

/// A session as `etendue render` would make it.
pub fn session(desc: &SceneDesc, settings: &RenderSettings) -> Session {
    let plan = Plan::new(desc, settings, None).unwrap();
    job::prepare(desc, settings, &plan, &[]).unwrap()
}

/// Compiles a scene for a picture of the settings.
pub fn compile(desc: &SceneDesc, settings: &RenderSettings) -> Scene {
    scene::compile(desc, settings, [settings.width.unwrap(), settings.height.unwrap()]).unwrap()
}

/// A session of an integrator that has no name, or of a scene that was changed after its compilation.
pub fn session_of(scene: Scene, integrator: Box<dyn Integrator>, settings: &RenderSettings) -> Session {
    let plan = Plan::new(&SceneDesc::default(), settings, None).unwrap();
    let sampler = Sampler { kind: plan.sampler, seed: settings.seed, spp: plan.spp };
    let crop = Rect::new(0, 0, plan.width, plan.height);
    let spec = FilmSpec { crop, filter: Filter::BOX, ..FilmSpec::new(plan.width, plan.height) };
    Session::new(Arc::new(scene), integrator, sampler, spec, Vec::new(), FilmMeta::default()).unwrap()
}

/// Renders all samples.
pub fn finish(mut session: Session, settings: &RenderSettings) -> Film {
    let stop = Stop { spp: settings.spp, ..Stop::default() };
    session.render(&stop, &Cancel::default(), &Silent).unwrap();
    let film = session.into_film();
    assert_eq!(film.counters().non_finite, 0, "samples that are no numbers");
    film
}

/// Renders a scene.
pub fn render(desc: &SceneDesc, settings: &RenderSettings) -> Film {
    finish(session(desc, settings), settings)
}

/// Renders a scene once with each seed.
pub fn render_seeds(desc: &SceneDesc, settings: &RenderSettings, seeds: Range<u64>) -> Vec<Film> {
    seeds.map(|seed| render(desc, &RenderSettings { seed, ..settings.clone() })).collect()
}

/// All that a film holds but the time that it took.
pub fn bytes(film: &Film) -> Vec<u8> {
    let mut film = film.clone();
    film.meta.render_ms = 0;
    let mut out = Vec::new();
    film.write_to(&mut out).unwrap();
    out
}

/// Panics unless five passes at once and the same passes in two parts, by other numbers of threads, give the same film, bit for bit.
pub fn assert_passes_merge(desc: &SceneDesc, settings: &RenderSettings) {
    let part = |first: u32, spp: u32, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut session = session(desc, &RenderSettings { spp: Some(spp), ..settings.clone() });
            session.set_first_sample(first);
            session.render(&Stop { spp: Some(spp), ..Stop::default() }, &Cancel::default(), &Silent).unwrap();
            session.into_film()
        })
    };
    let whole = part(0, 5, 2);
    let mut merged = part(3, 2, 1);
    merged.merge(&part(0, 3, 3)).unwrap();
    assert!(bytes(&whole) == bytes(&merged), "the film of merged passes differs");
}
