//! Lights and cameras of the classic model in the words of physical scenes.
//!
//! Light of the classic model mostly does not grow weaker with distance. Here each source falls off as light does, and is as
//! strong as makes it equally bright at one place, the focus of the picture.

use etendue_procedural::fns;
use etendue_scene::desc::classic::{AreaLight, Camera, CameraKind, ClassicScene, Light, LightKind};
use etendue_scene::desc::{
    AddNode, BsdfDesc, BsdfId, CameraDesc, EmissionDesc, FovAxis, GeometryDesc, LightDesc, Node, Param, ProjectionDesc, SceneDesc,
    ShapeDesc, SpotFalloff,
};
use etendue_scene::{Loss, Span};
use glam::{DMat3, DVec3, Mat4};

use std::f64::consts::PI;

use crate::classic::WorkingSpace;
use crate::classic::light::Lamp;

/// Area lights that show the focus less than this cosine of their side become spheres.
const EDGE_ON: f64 = 0.2;

/// The description that holds lights and camera of a classic scene, with what of them is not kept. `focus` is the place where lights are as
/// bright as in the classic model.
///
/// # Errors
/// A sentence where the camera's vectors make no camera.
pub(super) fn lower(scene: &ClassicScene, focus: DVec3, size: [u32; 2]) -> Result<(SceneDesc, Vec<Loss>), String> {
    let mut lowering =
        Lowering { desc: SceneDesc::default(), losses: Vec::new(), space: WorkingSpace::new(&scene.settings), focus, null: BsdfId(0) };
    lowering.desc.cameras.push(Node::new(Span::default(), camera(&scene.camera, size)?));
    lowering.null = lowering.desc.add(Node::new(Span::default(), BsdfDesc::Null));
    // A light that casts no shadows fills in for light between surfaces, which is computed here.
    let has_others = scene.lights.iter().any(|l| !l.shadowless);
    for light in &scene.lights {
        if light.shadowless && has_others {
            lowering.lose("shadowless light", "left out: light between surfaces is computed");
        } else {
            lowering.light(light);
        }
    }
    lowering.lose_what_is_not_physical(scene);
    Ok((lowering.desc, lowering.losses))
}

struct Lowering {
    desc: SceneDesc,
    losses: Vec<Loss>,
    space: WorkingSpace,
    focus: DVec3,
    null: BsdfId,
}

impl Lowering {
    fn lose(&mut self, feature: &str, effect: &str) {
        if !self.losses.iter().any(|l| l.feature == feature) {
            self.losses.push(Loss { span: Span::default(), feature: feature.to_owned(), effect: effect.to_owned() });
        }
    }

    fn lose_what_is_not_physical(&mut self, scene: &ClassicScene) {
        if !scene.fogs.is_empty() {
            self.lose("fog", "left out");
        }
        if !scene.rainbows.is_empty() {
            self.lose("rainbow", "left out");
        }
        if !scene.atmosphere.is_empty() {
            self.lose("media", "left out");
        }
        if scene.lights.iter().any(|l| l.group != 0) {
            self.lose("light group", "its lights shine on everything");
        }
        if scene.lights.iter().any(|l| l.projected_through.is_some()) {
            self.lose("projected_through", "the light passes freely");
        }
    }

    /// The lamp's color in linear light at a distance along its axis or towards the focus, times π: irradiance.
    fn irradiance(&self, light: &Light, distance: f64) -> DVec3 {
        let lamp = Lamp::new(light);
        self.space.linear_rgb(light.color * lamp.fading(distance)) * PI
    }

    fn light(&mut self, light: &Light) {
        let to_focus = self.focus - light.location;
        let distance = to_focus.length().max(1e-6);
        let irradiance = self.irradiance(light, distance);
        let intensity = (irradiance * distance * distance).as_vec3().to_array();
        let axis = (light.point_at - light.location).normalize_or(DVec3::Z);
        let desc = match (light.kind, &light.area) {
            _ if irradiance.max_element() <= 0.0 => {
                if irradiance.min_element() < 0.0 {
                    self.lose("negative light", "left out");
                }
                return;
            }
            (LightKind::Point, _) if light.parallel => {
                LightDesc::Directional { direction: axis.as_vec3(), irradiance: irradiance.as_vec3().to_array() }
            }
            (LightKind::Point, Some(area)) if !light.parallel => {
                self.area(light.location, area, irradiance * distance * distance, to_focus / distance);
                return;
            }
            (LightKind::Point, _) => LightDesc::Point { position: light.location.as_vec3(), intensity },
            (LightKind::Spot, _) => spot(light.location, axis, intensity, light.falloff, light.radius),
            (LightKind::Cylinder, _) => {
                self.lose("cylinder light", "a narrow cone as wide where it meets the scene");
                let degrees = |radius: f64| fns::atan2(radius, distance) * 180.0 / PI;
                spot(light.location, axis, intensity, degrees(light.falloff), degrees(light.radius))
            }
        };
        if light.kind == LightKind::Spot && light.area.is_some() {
            self.lose("area_light of a spotlight", "its shadows are hard");
        }
        self.desc.lights.push(Node::new(Span::default(), desc));
    }

    /// A rectangle, an ellipse or, where the light turns to what it lights, a sphere, that shows no surface of its own.
    fn area(&mut self, center: DVec3, area: &AreaLight, intensity: DVec3, to_focus: DVec3) {
        let normal = area.axis1.cross(area.axis2);
        let size = normal.length();
        let cos = (normal.dot(to_focus) / size).abs();
        let (geometry, world_from_object, seen) = if area.orient || !(size > 0.0) || !(cos > EDGE_ON) {
            // Edge on, or a line: as much light from a ball of the same reach.
            let radius = 0.25 * (area.axis1.length() + area.axis2.length());
            let sphere = GeometryDesc::Sphere { center: center.as_vec3(), radius: radius as f32 };
            (sphere, Mat4::IDENTITY, PI * radius * radius)
        } else {
            let axes = DMat3::from_cols(area.axis1 * 0.5, area.axis2 * 0.5, normal / size);
            let placed = Mat4::from_mat3(axes.as_mat3());
            let placed = Mat4::from_translation(center.as_vec3()) * placed;
            let (shape, share) = if area.circular { (GeometryDesc::Disk, PI / 4.0) } else { (GeometryDesc::Rectangle, 1.0) };
            (shape, placed, size * share * cos)
        };
        let radiance = intensity / seen;
        if !(seen > 1e-12) || !radiance.is_finite() {
            let desc = LightDesc::Point { position: center.as_vec3(), intensity: intensity.as_vec3().to_array() };
            self.desc.lights.push(Node::new(Span::default(), desc));
            return;
        }
        let is_sphere = matches!(geometry, GeometryDesc::Sphere { .. });
        let shape = ShapeDesc {
            bsdf: Some(self.null),
            emission: Some(EmissionDesc {
                radiance: Param::Constant(radiance.as_vec3().to_array()),
                two_sided: !is_sphere,
                group: String::new(),
            }),
            ..ShapeDesc::new(geometry, world_from_object)
        };
        self.desc.shapes.push(Node::new(Span::default(), shape));
    }
}

/// A cone of light; angles in degrees.
fn spot(location: DVec3, axis: DVec3, intensity: [f32; 3], outer: f64, inner: f64) -> LightDesc {
    let z = -axis.as_vec3();
    let x = z.any_orthonormal_vector();
    let world_from_light = Mat4::from_cols(x.extend(0.0), z.cross(x).extend(0.0), z.extend(0.0), location.as_vec3().extend(1.0));
    let radians = |d: f64| (d.clamp(0.0, 179.0) * PI / 180.0) as f32;
    let (outer_rad, inner_rad) = (radians(outer.max(inner)), radians(inner));
    LightDesc::Spot { world_from_light, intensity, outer_rad, inner_rad, falloff: SpotFalloff::Smoothstep, texture: None }
}

/// Whether the camera shows straight lines as straight lines, so that it has a physical form.
pub(super) fn is_flat(camera: &Camera) -> bool {
    matches!(camera.kind, CameraKind::Perspective | CameraKind::Orthographic) && camera.normal.is_none()
}

/// The camera in the form of physical scenes; of those that are not flat its place and directions only. Its space may be mirrored: POV-Ray's is left-handed.
///
/// # Errors
/// A sentence where the camera's vectors make no camera.
pub(crate) fn camera(camera: &Camera, size: [u32; 2]) -> Result<CameraDesc, String> {
    let [right, up, forward] = [camera.right, camera.up, camera.direction];
    let lengths = [right.length(), up.length(), forward.length()];
    if !lengths.iter().all(|l| *l > 0.0 && l.is_finite()) || !camera.location.is_finite() {
        return Err("the camera's vectors make no camera".to_owned());
    }
    let columns = |x: DVec3, y: DVec3, z: DVec3| {
        let v = |c: DVec3| c.as_vec3().extend(0.0);
        Mat4::from_cols(v(x), v(y), v(z), camera.location.as_vec3().extend(1.0))
    };
    let (right_unit, back) = (right / lengths[0], -forward / lengths[2]);
    let (world_from_camera, projection) = match &camera.kind {
        CameraKind::Perspective => {
            // The picture is |right| wide and |up| high at the distance |direction|; the renderer takes square pixels, so y is stretched.
            let half_width = 0.5 * lengths[0] / lengths[2];
            let blur = camera.blur.is_on();
            let focus_distance = (camera.blur.focal_point - camera.location).dot(-back);
            let projection = ProjectionDesc::Perspective {
                fov_rad: (2.0 * fns::atan2(half_width, 1.0)) as f32,
                fov_axis: FovAxis::X,
                aperture_radius: if blur { (0.5 * camera.blur.aperture.abs()) as f32 } else { 0.0 },
                focus_distance: if blur && focus_distance > 0.0 { focus_distance as f32 } else { 1.0 },
                principal_point_offset: [0.0; 2],
            };
            let pixels = f64::from(size[0].max(1)) / f64::from(size[1].max(1));
            (columns(right_unit, up * (pixels / lengths[0]), back), projection)
        }
        CameraKind::Orthographic => {
            let projection =
                ProjectionDesc::Orthographic { half_width: (0.5 * lengths[0]) as f32, half_height: Some((0.5 * lengths[1]) as f32) };
            (columns(right_unit, up / lengths[1], back), projection)
        }
        // Stands in; rays are those of the classic model.
        _ => (
            columns(right_unit, up / lengths[1], back),
            ProjectionDesc::Perspective {
                fov_rad: 1.0,
                fov_axis: FovAxis::X,
                aperture_radius: 0.0,
                focus_distance: 1.0,
                principal_point_offset: [0.0; 2],
            },
        ),
    };
    Ok(CameraDesc { world_from_camera, projection, near: 0.0, far: f32::INFINITY, medium: None })
}
