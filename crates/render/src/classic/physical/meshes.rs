//! A classic scene as triangles with ordinary materials: for methods that need triangles, for baking and for other formats.
//!
//! Solids become meshes ([`World::tessellate`](crate::solid::World::tessellate)), finishes the material model of glTF with the same shares
//! of diffuse, glossy and mirrored light as in [`super::shade`], pigments that vary colors of the vertices, between which triangles are
//! divided until they are small or the colors alike. Lights, sky and camera are those of [`super::lower`].

use std::collections::HashMap;
use std::sync::Arc;

use etendue_procedural::{Pigment, Texture};
use etendue_scene::desc::classic::{Camera, CameraKind, ClassicScene, Object as Solid};
use etendue_scene::desc::{
    AddNode, BsdfDesc, BsdfId, Color, EmissionDesc, EnvironmentMapping, GeometryDesc, ImageDesc, ImageSource, LightDesc, MediumDesc,
    MediumId, MeshAttribute, MeshData, MeshDesc, Node, Param, PbrDesc, PhaseDesc, Scalar, SceneDesc, ShapeDesc, TextureDesc, TextureId,
};
use etendue_scene::{Loss, Span};
use glam::{DMat4, DVec3};
use rayon::prelude::*;

use super::shade::Shares;
use super::{Physical, SKY, SolidPoint, absorption, lower};
use crate::classic::gray;
use crate::light::EnvironmentLight;
use crate::math::{Mat4, Vec2, Vec3};
use crate::solid::tessellate::{Patch, SEGMENTS, halves, longest};
use crate::solid::{Bounds, Facet, SolidHit};

/// Colors of neighboring corners that differ by less are not divided between.
const ALIKE: f64 = 0.04;
/// Most triangles of a leaf that are made for its colors' sake.
const MOST_COLORED: usize = 1 << 19;
/// Mirrors and highlights up to this are those of a dielectric, brighter ones are partly metal.
const DIELECTRIC: f64 = 0.08;

/// How a scene becomes triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshOptions {
    /// Segments of a full circle, and cells along the longest side of what has no parametrization.
    pub segments: u32,
    /// Size of the picture, in pixels.
    pub size: [u32; 2],
    /// POV-Ray's left-handed space is mirrored, as other formats have right-handed ones.
    pub right_handed: bool,
}

impl Default for MeshOptions {
    fn default() -> Self {
        Self { segments: SEGMENTS, size: [320, 240], right_handed: false }
    }
}

/// The description without its classic scene, in triangles; what is lost on the way is in its report.
///
/// # Errors
/// A sentence where there would be too many triangles, or the camera's vectors make no camera.
pub fn meshes(desc: &SceneDesc, options: &MeshOptions) -> Result<SceneDesc, String> {
    let Some(classic) = &desc.classic else { return Ok(desc.clone()) };
    let (physical, warnings) = Physical::new(classic, options.size);
    let mirrored = options.right_handed && is_left_handed(&classic.camera);
    let (mut made, losses) = physical.lowered(mirrored, options.size)?;
    let mut meshing =
        Meshing { world: &physical, mirrored, desc: &mut made, losses, bsdfs: HashMap::new(), media: HashMap::new(), color: None };
    meshing.add_sky();
    meshing.add_meshes(options.segments)?;
    let losses = meshing.losses;
    // Lights are not seen in POV-Ray; where surfaces glow or there is a sky, those are, and so are the lights.
    let has_sky = made.lights.iter().any(|l| matches!(l.value, LightDesc::Constant { .. } | LightDesc::Environment { .. }));
    made.integrator.hide_lights =
        !has_sky && made.shapes.iter().all(|s| s.value.emission.is_none() || s.value.bsdf.is_some_and(|b| made[b].value == BsdfDesc::Null));
    made.format = desc.format.clone();
    made.files = desc.files.clone();
    made.film = desc.film.clone();
    made.report = desc.report.clone();
    made.report.losses.extend(losses);
    let unread = |effect: String| Loss { span: Span::default(), feature: "picture".to_owned(), effect };
    made.report.losses.extend(warnings.into_iter().map(unread));
    Ok(made)
}

fn is_left_handed(camera: &Camera) -> bool {
    camera.right.cross(camera.up).dot(camera.direction) > 0.0
}

/// What a surface does with light at a corner.
#[derive(Clone, Copy, Debug, Default)]
struct Look {
    diffuse: DVec3,
    gloss: DVec3,
    alpha: f64,
    mirror: DVec3,
    passing: DVec3,
    glow: DVec3,
    ior: f64,
}

impl Look {
    fn add(&mut self, o: &Self, w: f64) {
        self.diffuse += o.diffuse * w;
        self.gloss += o.gloss * w;
        self.alpha += o.alpha * w;
        self.mirror += o.mirror * w;
        self.passing += o.passing * w;
        self.glow += o.glow * w;
        self.ior += o.ior * w;
    }

    fn add_shares(&mut self, s: &Shares, w: f64) {
        let one = Self { diffuse: s.diffuse, gloss: s.gloss, alpha: s.alpha, mirror: s.mirror, passing: s.passing, ..Self::default() };
        self.add(&one, w);
    }
}

/// A triangle with what its corners look like.
type Painted = (Facet, [(Vec3, Look); 3]);

impl Physical {
    /// Lights and camera as a description, mirrored in z if asked for.
    fn lowered(&self, mirrored: bool, size: [u32; 2]) -> Result<(SceneDesc, Vec<Loss>), String> {
        let mut scene: ClassicScene = (*self.classic.scene).clone();
        let mut focus = self.focus(size);
        let mut losses = Vec::new();
        if !matches!(scene.camera.kind, CameraKind::Perspective | CameraKind::Orthographic) {
            scene.camera.kind = CameraKind::Perspective;
            let effect = "a perspective camera stands in its place".to_owned();
            losses.push(Loss { span: Span::default(), feature: "camera that is no perspective".to_owned(), effect });
        }
        if mirrored {
            let mirror = DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0));
            scene.camera.transform(&mirror);
            scene.lights.iter_mut().for_each(|l| l.transform(&mirror));
            focus.z = -focus.z;
        }
        let (desc, more) = lower::lower(&scene, focus, size)?;
        losses.extend(more);
        Ok((desc, losses))
    }

    fn look(&self, hit: &SolidHit<'_>) -> Look {
        let mut look = Look::default();
        let n = hit.n;
        self.classic.world.textures(hit, false, &mut |weight, texture| {
            let Some(texture) = texture else { return };
            texture.resolve(&self.context(hit, n, -n), &mut |share, layers, context| {
                let shares = self.shares(layers, context, n, n, hit);
                look.add_shares(&shares, weight * share);
                look.ior += super::shade::index(hit, layers) * weight * share;
            });
        });
        let at = SolidPoint { leaf: hit.leaf, crossing: hit.crossing, p: hit.p, d: -n };
        let glow = self.emitted(&at, n.as_vec3());
        look.glow = DVec3::from(glow.rgb().map(f64::from));
        look
    }

    /// A triangle whose corners are looked at, in the order in which it faces outside.
    fn painted(&self, leaf: u32, facet: Facet, known: Option<&Look>) -> Painted {
        let hits = [0, 1, 2].map(|i| self.classic.world.corner(leaf, &facet, i));
        let sum: DVec3 = hits.iter().map(|h| h.n).sum();
        let corners = hits.map(|h| (h.n.as_vec3().normalize_or(Vec3::Z), known.copied().unwrap_or_else(|| self.look(&h))));
        if sum.dot(facet.cross()) >= 0.0 {
            return (facet, corners);
        }
        let [a, b, c] = [DVec3::X, DVec3::Y, DVec3::Z];
        (facet.part([a, c, b]), [corners[0], corners[2], corners[1]])
    }

    /// The triangles of a patch, divided where its colors change.
    fn paint(&self, patch: &Patch, solid: &Solid, segments: u32) -> (Vec<Painted>, bool) {
        let even = !self.classic.world.has_own_textures(patch.leaf) && solid.texture.as_ref().is_some_and(|t| is_even(t));
        if even || solid.texture.is_none() && !self.classic.world.has_own_textures(patch.leaf) {
            let known = patch.facets.first().map(|f| self.look(&self.classic.world.corner(patch.leaf, f, 0)));
            return (patch.facets.iter().map(|f| self.painted(patch.leaf, *f, known.as_ref())).collect(), false);
        }
        let extent = patch.facets.iter().fold(Bounds::EMPTY, |b, f| b.union(Bounds::of_points(f.p)));
        let size = (extent.max - extent.min).length() / f64::from(segments);
        // Large surfaces are divided as finely as the camera sees them.
        let eye = self.classic.rays.location();
        let edges = |f: &Facet| {
            let seen = ((f.p[0] + f.p[1] + f.p[2]) / 3.0 - eye).length() / f64::from(segments);
            [(2.0 * size).min(4.0 * seen), (0.35 * size).min(0.4 * seen)]
        };
        let mut out: Vec<Painted> = Vec::new();
        let mut pending: Vec<Facet> = Vec::new();
        for facet in &patch.facets {
            pending.push(*facet);
            while let Some(facet) = pending.pop() {
                let (side, length) = longest(&facet);
                let [coarse, fine] = edges(&facet);
                let room = out.len() + pending.len() < MOST_COLORED;
                if room && length > coarse {
                    pending.extend(halves(&facet, side));
                    continue;
                }
                let painted = self.painted(patch.leaf, facet, None);
                let colors = [0, 1, 2].map(|i| painted.1[i].1.diffuse + painted.1[i].1.passing);
                let differ = |a: usize, b: usize| (colors[a] - colors[b]).abs().max_element() > ALIKE;
                if room && length > fine && (differ(0, 1) || differ(1, 2) || differ(2, 0)) {
                    pending.extend(halves(&facet, side));
                } else {
                    out.push(painted);
                }
            }
        }
        (out, true)
    }
}

/// Whether a texture is the same everywhere.
fn is_even(texture: &Texture) -> bool {
    texture.layers().is_some_and(|layers| layers.iter().all(|l| matches!(l.pigment, Pigment::Solid(_))))
}

/// Shapes of one top-level object with one texture are one mesh.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Key {
    root: u32,
    texture: usize,
    interior: usize,
    closed: bool,
    leaf: u32,
}

struct Meshing<'a> {
    world: &'a Physical,
    mirrored: bool,
    desc: &'a mut SceneDesc,
    losses: Vec<Loss>,
    bsdfs: HashMap<String, BsdfId>,
    media: HashMap<usize, Option<MediumId>>,
    /// The texture of the vertices' colors.
    color: Option<TextureId>,
}

impl Meshing<'_> {
    fn lose(&mut self, span: Span, feature: &str, effect: &str) {
        if !self.losses.iter().any(|l| l.feature == feature) {
            self.losses.push(Loss { span, feature: feature.to_owned(), effect: effect.to_owned() });
        }
    }

    fn add_sky(&mut self) {
        let classic = &self.world.classic;
        let Some(background) = classic.scene.sky.is_none().then(|| classic.sky(DVec3::Y).0) else {
            return self.add_sky_picture();
        };
        let radiance = classic.space.linear_rgb(background).as_vec3().max(Vec3::ZERO).to_array();
        if radiance.iter().any(|v| *v > 0.0) {
            self.desc.lights.push(Node::new(Span::default(), LightDesc::Constant { radiance }));
        }
    }

    fn add_sky_picture(&mut self) {
        let classic = &self.world.classic;
        let [width, height] = SKY;
        let mirrored = self.mirrored;
        let texel = |i: usize| {
            let (u, v) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let uv = Vec2::new((u / width as f64) as f32, (v / height as f64) as f32);
            let d = EnvironmentLight::direction_from_uv(uv).0.as_dvec3();
            let d = if mirrored { DVec3::new(d.x, d.y, -d.z) } else { d };
            classic.space.linear_rgb(classic.sky(d).0).as_vec3().max(Vec3::ZERO).to_array()
        };
        let data: Vec<f32> = (0..width * height).into_par_iter().flat_map_iter(texel).collect();
        if data.iter().all(|v| !(*v > 0.0)) {
            return;
        }
        let source = ImageSource::Pixels { width: width as u32, height: height as u32, channels: 3, data };
        let image = self.desc.add(Node::new(Span::default(), ImageDesc { source }));
        let (scale, world_from_light) = ([1.0; 3], Mat4::IDENTITY);
        let light = LightDesc::Environment { image, scale, world_from_light, mapping: EnvironmentMapping::Equirectangular, portal: None };
        self.desc.lights.push(Node::new(Span::default(), light));
    }

    fn add_meshes(&mut self, segments: u32) -> Result<(), String> {
        let world = self.world;
        let classic = &world.classic;
        // Unbounded surfaces go on so far beyond the others.
        let finite = classic.world.finite_bounds().with(classic.rays.location()).with(world.focus([8, 8]));
        let room = 2.0 * (finite.max - finite.min).max_element().clamp(1e-3, 1e6);
        let within = Bounds { min: finite.min - room, max: finite.max + room };
        if !classic.world.bounds().is_finite() {
            self.lose(Span::default(), "unbounded surface", "it ends at three times the size of the scene");
        }
        let patches = classic.world.tessellate(segments, &within)?;
        let objects: Vec<&Solid> = classic.world.leaf_objects().collect();
        let painted: Vec<(Vec<Painted>, bool)> = patches.par_iter().map(|p| world.paint(p, objects[p.leaf as usize], segments)).collect();
        let mut groups: Vec<(Key, Vec<usize>)> = Vec::new();
        let mut known: HashMap<Key, usize> = HashMap::new();
        for (i, patch) in patches.iter().enumerate() {
            let object = objects[patch.leaf as usize];
            self.lose_of(object);
            let own = classic.world.has_own_textures(patch.leaf);
            let key = Key {
                root: patch.root,
                texture: object.texture.as_ref().map_or(0, |t| Arc::as_ptr(t) as usize),
                interior: object.interior.as_ref().map_or(0, |t| Arc::as_ptr(t) as usize),
                closed: patch.closed,
                leaf: if own { patch.leaf } else { 0 },
            };
            let group = *known.entry(key).or_insert_with(|| {
                groups.push((key, Vec::new()));
                groups.len() - 1
            });
            groups[group].1.push(i);
        }
        for (key, members) in groups {
            let varies = members.iter().any(|&i| painted[i].1);
            let triangles = members.iter().flat_map(|&i| &painted[i].0);
            let solid = objects[patches[members[0]].leaf as usize];
            self.add_mesh(solid, key.closed, varies, triangles);
        }
        Ok(())
    }

    fn lose_of(&mut self, solid: &Solid) {
        if solid.interior_texture.is_some() {
            self.lose(solid.span, "interior_texture", "the outer texture is on both sides");
        }
        let layers = |t: &Texture| t.layers().is_some_and(|l| l.iter().any(|l| l.normal.is_some()));
        if solid.texture.as_ref().is_some_and(|t| layers(t)) {
            self.lose(solid.span, "normal", "the surface is smooth");
        }
        if solid.texture.as_ref().is_some_and(|t| !is_even(t)) {
            self.lose(solid.span, "pattern", "colors of the vertices stand for it");
        }
    }

    fn add_mesh<'p>(&mut self, solid: &Solid, closed: bool, varies: bool, triangles: impl Iterator<Item = &'p Painted>) {
        let mut mesh = MeshData::default();
        let mut colors: Vec<f32> = Vec::new();
        let mut known: HashMap<[u32; 9], u32> = HashMap::new();
        let (mut mean, mut area) = (Look::default(), 0.0);
        let place = |p: DVec3| if self.mirrored { DVec3::new(p.x, p.y, -p.z) } else { p };
        for (facet, corners) in triangles {
            let size = facet.cross().length();
            corners.iter().for_each(|c| mean.add(&c.1, size / 3.0));
            area += size;
            let mut triangle = [0, 1, 2].map(|i| {
                let (n, look) = &corners[i];
                let p = place(facet.p[i]).as_vec3();
                let n = place(n.as_dvec3()).as_vec3();
                let color = if varies { paint_of(look).as_vec3() } else { Vec3::ZERO };
                let bits = |v: Vec3, steps: f32| v.to_array().map(|x| ((x * steps).round() as i32).cast_unsigned());
                let ([px, py, pz], [nx, ny, nz], [r, g, b]) =
                    (p.to_array().map(|x| (x + 0.0).to_bits()), bits(n, 256.0), bits(color, 1024.0));
                *known.entry([px, py, pz, nx, ny, nz, r, g, b]).or_insert_with(|| {
                    mesh.positions.push(p);
                    mesh.normals.push(n);
                    if varies {
                        colors.extend(color.to_array());
                    }
                    mesh.positions.len() as u32 - 1
                })
            });
            if self.mirrored {
                triangle.swap(1, 2);
            }
            if triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0] {
                mesh.triangles.push(triangle);
            }
        }
        if mesh.triangles.is_empty() || !(area > 0.0) {
            return;
        }
        if varies {
            mesh.attributes.push(MeshAttribute { name: "color".into(), per_face: false, width: 3, data: colors });
        }
        let mut look = Look::default();
        look.add(&mean, 1.0 / area);
        let bsdf = self.bsdf(&look, varies, closed, solid.span);
        let interior = self.medium(solid);
        let glow = look.glow.as_vec3();
        let emission = (glow.max_element() > 1e-6).then(|| EmissionDesc {
            radiance: Param::Constant(glow.max(Vec3::ZERO).to_array()),
            two_sided: !closed,
            group: String::new(),
        });
        let mesh = self.desc.add(Node::new(solid.span, MeshDesc { file: None, flip_v: false, data: Some(mesh) }));
        let geometry = GeometryDesc::Mesh { mesh, face_normals: false, smooth: false };
        let shape = ShapeDesc { bsdf: Some(bsdf), emission, interior, ..ShapeDesc::new(geometry, Mat4::IDENTITY) };
        self.desc.add(Node::new(solid.span, shape));
    }

    /// What an interior takes away on the way.
    fn medium(&mut self, solid: &Solid) -> Option<MediumId> {
        let interior = solid.interior.as_ref()?;
        let key = Arc::as_ptr(interior) as usize;
        if let Some(known) = self.media.get(&key) {
            return *known;
        }
        let made = absorption(interior).map(|sigma_a| {
            let medium = MediumDesc::Homogeneous { sigma_a, sigma_s: [0.0; 3], emission: [0.0; 3], phase: PhaseDesc::Isotropic };
            self.desc.add(Node::new(solid.span, medium))
        });
        self.media.insert(key, made);
        made
    }

    fn color(&mut self, look: &Look, varies: bool) -> Color {
        if !varies {
            return Param::Constant(paint_of(look).as_vec3().to_array());
        }
        let desc = &mut *self.desc;
        let texture = *self
            .color
            .get_or_insert_with(|| desc.add(Node::new(Span::default(), TextureDesc::Attribute { name: "color".into(), scale: 1.0 })));
        Param::Texture(texture)
    }

    fn bsdf(&mut self, look: &Look, varies: bool, closed: bool, span: Span) -> BsdfId {
        let through = gray(look.passing);
        let refracts = (look.ior - 1.0).abs() > 1e-3;
        let specular = gray(look.gloss + look.mirror);
        let one_sided = if refracts && through > 0.5 {
            let color = |v: DVec3| Param::Constant(v.as_vec3().to_array());
            BsdfDesc::Dielectric {
                int_ior: look.ior as f32,
                ext_ior: 1.0,
                specular_reflectance: Color::gray(1.0),
                specular_transmittance: color(look.passing.min(DVec3::ONE)),
                roughness: None,
            }
        } else if specular < 1e-3 {
            BsdfDesc::Diffuse { reflectance: self.color(look, varies), alpha: None }
        } else {
            // A blend of dielectric and metal of one color: the metal's share is what makes it as bright a mirror as the finish.
            let paint = paint_of(look);
            let metal = if specular <= DIELECTRIC { 0.0 } else { (specular / (specular + gray(paint)).max(1e-6)).clamp(0.0, 1.0) };
            let mirror = look.mirror + look.gloss;
            let (base_color, specular_color) = if metal > 0.85 {
                (Param::Constant(mirror.min(DVec3::ONE).as_vec3().to_array()), Color::gray(1.0))
            } else if metal > 0.0 {
                (self.color(look, varies), Color::gray(1.0))
            } else {
                (self.color(look, varies), Param::Constant((mirror / 0.04).as_vec3().to_array()))
            };
            let gloss = gray(look.gloss);
            // Mirror and highlight share one roughness.
            let alpha = look.alpha * gloss / specular.max(1e-6);
            BsdfDesc::Pbr(Box::new(PbrDesc {
                base_color,
                metallic: Scalar::Constant(if metal > 0.85 { 1.0 } else { metal as f32 }),
                roughness: Scalar::Constant(alpha.clamp(0.0, 1.0).sqrt() as f32),
                specular_color,
                ..PbrDesc::default()
            }))
        };
        let glass = matches!(one_sided, BsdfDesc::Dielectric { .. });
        let mut id = self.shared(one_sided, span);
        if !closed && !glass {
            id = self.shared(BsdfDesc::TwoSided { front: id, back: id }, span);
        }
        if !glass && through > 0.02 {
            if (look.passing - through).abs().max_element() > 0.05 {
                self.lose(span, "filter", "what passes is not colored");
            }
            id = self.shared(BsdfDesc::Mask { nested: id, opacity: Scalar::Constant((1.0 - through).clamp(0.0, 1.0) as f32) }, span);
        }
        id
    }

    /// The model, the same for equal ones.
    fn shared(&mut self, bsdf: BsdfDesc, span: Span) -> BsdfId {
        let key = format!("{bsdf:?}");
        if let Some(&id) = self.bsdfs.get(&key) {
            return id;
        }
        let id = self.desc.add(Node::new(span, bsdf));
        self.bsdfs.insert(key, id);
        id
    }
}

/// The diffuse color of the part of the surface that is there.
fn paint_of(look: &Look) -> DVec3 {
    let opacity = 1.0 - gray(look.passing).clamp(0.0, 1.0);
    if opacity > 0.02 { (look.diffuse / opacity).clamp(DVec3::ZERO, DVec3::ONE) } else { look.diffuse }
}
