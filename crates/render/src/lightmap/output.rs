//! The baked scene as a description, and what of glTF a description cannot say.
//!
//! Three ways to show light (docs/guide/baking.md): as emission, which every viewer that knows glTF 2.0 shows as it is; as an unlit
//! material, for viewers without the emissive-strength extension; and as a lightmap beside the original materials, for engines.

use std::collections::BTreeMap;

use etendue_scene::SceneDesc;
use etendue_scene::desc::{
    AddNode, BitmapDesc, BsdfDesc, BsdfId, Channel, Color, EmissionDesc, Encoding, GeometryDesc, ImageDesc, ImageSource, MeshAttribute,
    MeshData, MeshDesc, Node, Param, PbrDesc, Scalar, ShapeDesc, TextureDesc, TextureFilter, TextureId, Wrap,
};
use etendue_scene::span::Span;
use glam::Mat3;

use super::fill::Map;
use super::flatten::emits;
use super::job::{Bake, Baked, Content};
use super::layout::{Layout, Side};
use super::vertices::VertexLayout;
use super::{BakeError, charts};
use crate::image::{FileFormat, Image, WriteOptions};
use crate::math::{INV_PI, Vec2, Vec3};

/// How the light is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Display {
    /// The light that surfaces send back is their emission: any viewer shows it, any brightness.
    #[default]
    Emissive,
    /// The same as unlit base color: any viewer shows it; what is brighter than 1 is cut.
    Unlit,
    /// Irradiance as a lightmap (MOZ_lightmap) beside the original materials.
    Lightmap,
}

/// What is changed in a material after the glTF writer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Patch {
    pub unlit: bool,
    pub single_sided: bool,
    /// The emission is a lightmap of this intensity.
    pub lightmap: Option<f32>,
}

/// A baked scene.
#[derive(Debug)]
pub struct BakedScene {
    /// The scene; all lights but emitting surfaces are in its light.
    pub desc: SceneDesc,
    /// Set of texture coordinates of the maps.
    pub uv_set: u32,
    pub(super) patches: BTreeMap<String, Patch>,
}

/// How deep models in models are followed.
const DEPTH_LIMIT: u32 = 32;
/// The backs of surfaces stand off by this share of the shape's size: far enough for rays to tell them apart.
const BACK_OFFSET: f32 = 1e-4;

struct Builder<'a> {
    bake: &'a Bake,
    display: Display,
    desc: SceneDesc,
    patches: BTreeMap<String, Patch>,
    uv_set: u32,
}

/// The baked scene.
///
/// # Errors
/// [`BakeError::Setting`] where the file's own textures leave no set of texture coordinates.
pub fn scene(bake: &Bake, baked: &Baked, display: Display) -> Result<BakedScene, BakeError> {
    let source = &bake.flat.desc;
    let used = source.textures.iter().filter_map(|t| match &t.value {
        TextureDesc::Bitmap(b) => Some(b.uv_set),
        _ => None,
    });
    let uv_set = used.max().unwrap_or(0) + 1;
    if uv_set > 3 {
        return Err(BakeError::Setting(format!("the file uses {uv_set} sets of texture coordinates; viewers have no room for another")));
    }
    let desc = SceneDesc {
        format: source.format.clone(),
        files: source.files.clone(),
        images: source.images.clone(),
        textures: source.textures.clone(),
        bsdfs: source.bsdfs.clone(),
        media: source.media.clone(),
        cameras: source.cameras.clone(),
        film: etendue_scene::desc::FilmDesc { spp: None, ..source.film.clone() },
        ..SceneDesc::default()
    };
    let mut b = Builder { bake, display, desc, patches: BTreeMap::new(), uv_set };
    match &bake.content {
        Content::Texels(layout, _) => b.texels(layout, baked)?,
        Content::Vertices(layout) => b.vertices(layout, baked),
    }
    b.others();
    Ok(BakedScene { desc: b.desc, uv_set, patches: b.patches })
}

/// Light that a diffuse surface of this albedo sends back.
pub fn radiance(irradiance: &Map, albedo: &Map) -> Map {
    let data = irradiance.data.iter().zip(&albedo.data).map(|(e, a)| std::array::from_fn(|k| e[k] * a[k] * INV_PI)).collect();
    Map { size: irradiance.size, data }
}

impl Builder<'_> {
    fn texels(&mut self, layout: &Layout, baked: &Baked) -> Result<(), BakeError> {
        let mut maps: Vec<Map> = match self.display {
            Display::Lightmap => baked.irradiance.clone(),
            _ => baked.irradiance.iter().zip(&baked.albedo).map(|(e, a)| radiance(e, a)).collect(),
        };
        // (side, atlas) → charts.
        let mut pieces: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
        for (i, chart) in layout.charts.iter().enumerate() {
            pieces.entry((chart.side, chart.place.atlas)).or_default().push(i);
        }
        // Each piece has the brightness of its material, so that dark rooms keep their gradations beside bright ones.
        let padding = self.bake.options.padding;
        let mut scales = BTreeMap::new();
        for (key, list) in &pieces {
            let mut max = 0.0f32;
            for (map, i, _) in list.iter().flat_map(|c| cells(layout, &maps, *c, padding)) {
                max = maps[map].data[i].iter().fold(max, |m, v| m.max(*v));
            }
            let scale = match self.display {
                Display::Unlit => 1.0,
                _ if max > 0.0 => max,
                _ => 1.0,
            };
            scales.insert(*key, scale);
        }
        for (key, list) in &pieces {
            let targets: Vec<_> = list.iter().flat_map(|c| cells(layout, &maps, *c, padding)).collect();
            for (map, i, _) in targets {
                maps[map].data[i] = maps[map].data[i].map(|v| v / scales[key]);
            }
        }
        let textures = maps.iter().enumerate().map(|(i, m)| self.atlas(i, m)).collect::<Result<Vec<_>, _>>()?;
        for ((side, atlas), list) in pieces {
            let size = layout.packing.atlases[atlas as usize];
            let mesh = self.piece(layout, side, &list, size);
            self.add_piece(layout.sides[side as usize], mesh, Some(textures[atlas as usize]), scales[&(side, atlas)]);
        }
        Ok(())
    }

    /// An atlas as a texture.
    fn atlas(&mut self, number: usize, map: &Map) -> Result<TextureId, BakeError> {
        let mut png = Vec::new();
        Image::from_rgb(map.size[0], map.size[1], &map.data)
            .write_to(&mut png, FileFormat::Png, &WriteOptions::default())
            .map_err(|e| BakeError::Scene(format!("an atlas could not be written as PNG: {e}")))?;
        let image =
            self.desc.add(Node::named(format!("lightmap {number}"), Span::default(), ImageDesc { source: ImageSource::Embedded(png) }));
        let bitmap = BitmapDesc {
            image,
            encoding: Encoding::Srgb,
            wrap: [Wrap::Clamp; 2],
            filter: TextureFilter::Bilinear,
            picture_from_uv: Mat3::IDENTITY,
            channel: Channel::Luminance,
            uv_set: self.uv_set,
        };
        Ok(self.desc.add(Node::new(Span::default(), TextureDesc::Bitmap(bitmap))))
    }

    /// The triangles of some charts with their place in an atlas.
    fn piece(&self, layout: &Layout, side: u32, list: &[usize], size: [u32; 2]) -> MeshData {
        let shape = layout.sides[side as usize];
        let mesh = self.bake.flat.mesh(shape.shape as usize);
        let (mut from, mut uvs, mut triangles, mut numbers) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for &c in list {
            let chart = &layout.charts[c];
            let (vertices, corners) = charts::vertices(mesh, &chart.chart);
            let base = from.len() as u32;
            let o = Vec2::new(chart.place.origin[0] as f32, chart.place.origin[1] as f32);
            for (vertex, at) in vertices {
                let p = o + at * chart.place.scale;
                from.push(vertex);
                uvs.extend([p.x / size[0] as f32, 1.0 - p.y / size[1] as f32]);
            }
            triangles.extend(corners.into_iter().map(|t| t.map(|i| i + base)));
            numbers.extend_from_slice(&chart.chart.triangles);
        }
        let mut out = pick(mesh, &from, &numbers, triangles);
        out.attributes.retain(|a| a.name != format!("uv{}", self.uv_set));
        // Sets of texture coordinates are counted without gaps.
        for set in 1..self.uv_set {
            let name = format!("uv{set}");
            if !out.attributes.iter().any(|a| a.name == name) {
                out.attributes.push(MeshAttribute { name, per_face: false, width: 2, data: vec![0.0; 2 * from.len()] });
            }
        }
        out.attributes.push(MeshAttribute { name: format!("uv{}", self.uv_set), per_face: false, width: 2, data: uvs });
        if shape.back { turned(out) } else { out }
    }

    fn vertices(&mut self, layout: &VertexLayout, baked: &Baked) {
        for (side, points) in layout.sides.iter().zip(&layout.points) {
            let mesh = self.bake.flat.mesh(side.shape as usize);
            let mut known = std::collections::HashMap::new();
            let (mut from, mut light, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
            for (t, corners) in mesh.triangles.iter().enumerate() {
                triangles.push(std::array::from_fn(|k| {
                    let point = points[3 * t + k];
                    *known.entry((corners[k], point)).or_insert_with(|| {
                        from.push(corners[k]);
                        light.push(baked.vertices[point as usize].map(|e| e * INV_PI));
                        from.len() as u32 - 1
                    })
                }));
            }
            let numbers: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
            let mut out = pick(mesh, &from, &numbers, triangles);
            // The colors that vertices have already are part of the material.
            if let Some(color) = out.attributes.iter().find(|a| a.name == "color" && a.width >= 3 && !a.per_face) {
                let width = color.width as usize;
                for (v, c) in light.iter_mut().zip(color.data.chunks_exact(width)) {
                    (0..3).for_each(|k| v[k] *= c[k]);
                }
            }
            out.attributes.retain(|a| a.name != "color");
            let data = light.into_iter().flatten().collect();
            out.attributes.push(MeshAttribute { name: "color".into(), per_face: false, width: 3, data });
            let out = if side.back { turned(out) } else { out };
            self.add_piece(*side, out, None, 1.0);
        }
    }

    fn add_piece(&mut self, side: Side, mesh: MeshData, texture: Option<TextureId>, scale: f32) {
        let node = self.bake.flat.desc.shapes[side.shape as usize].clone();
        let mesh = self.desc.add(Node::named(node.name.clone(), node.span, MeshDesc { file: None, flip_v: false, data: Some(mesh) }));
        let single_sided = side.back || self.bake.flat.shapes[side.shape as usize].bake[1];
        let (bsdf, emission, patch) = match texture {
            Some(texture) => self.textured(&node.value, texture, scale),
            None => self.colored(&node.value),
        };
        let patch = Patch { single_sided, ..patch };
        // Every piece has a material of its own, by whose name the patch finds it.
        let name = node.value.bsdf.map_or(String::new(), |b| self.bake.flat.desc[b].name.clone());
        let name = format!("{}{}baked {}", name, if name.is_empty() { "" } else { " " }, self.patches.len());
        let bsdf = self.named(&name, bsdf);
        self.patches.insert(name, patch);
        let geometry = GeometryDesc::Mesh { mesh, face_normals: false, smooth: false };
        let emission = emission.map(|radiance| EmissionDesc { radiance, two_sided: true, group: String::new() });
        let shape = ShapeDesc { geometry, bsdf: Some(bsdf), emission, ..node.value };
        self.desc.add(Node::named(node.name, node.span, shape));
    }

    fn named(&mut self, name: &str, bsdf: BsdfDesc) -> BsdfId {
        self.desc.add(Node::named(name, Span::default(), bsdf))
    }

    /// The material of a piece with a map.
    fn textured(&mut self, shape: &ShapeDesc, texture: TextureId, scale: f32) -> (BsdfDesc, Option<Color>, Patch) {
        let map = Color::Texture(texture);
        let scaled = if scale == 1.0 {
            map
        } else {
            let product = TextureDesc::Multiply { a: Color::gray(scale), b: map };
            Color::Texture(self.desc.add(Node::new(Span::default(), product)))
        };
        match self.display {
            Display::Emissive => {
                let black = self.masked(shape, Color::gray(0.0));
                (black, Some(scaled), Patch::default())
            }
            Display::Unlit => (self.masked(shape, map), None, Patch { unlit: true, ..Patch::default() }),
            Display::Lightmap => {
                let original =
                    shape.bsdf.map_or(BsdfDesc::Diffuse { reflectance: Color::gray(0.5), alpha: None }, |b| self.desc[b].value.clone());
                (original, Some(scaled), Patch { lightmap: Some(scale), ..Patch::default() })
            }
        }
    }

    /// The material of a piece with the light in its vertices: unlit, so that viewers multiply base color and vertex color.
    fn colored(&mut self, shape: &ShapeDesc) -> (BsdfDesc, Option<Color>, Patch) {
        let light = Color::Texture(self.desc.add(Node::new(Span::default(), TextureDesc::Attribute { name: "color".into(), scale: 1.0 })));
        let base = shape.bsdf.map_or(Color::gray(0.5), |b| base_color(&self.desc, b, 0));
        let base = without_vertex_color(&mut self.desc, base, 0);
        let product = Color::Texture(self.desc.add(Node::new(Span::default(), TextureDesc::Multiply { a: light, b: base })));
        let bsdf = self.masked(shape, product);
        if self.display == Display::Lightmap {
            let original =
                shape.bsdf.map_or(BsdfDesc::Diffuse { reflectance: Color::gray(0.5), alpha: None }, |b| self.desc[b].value.clone());
            return (original, None, Patch::default());
        }
        (bsdf, None, Patch { unlit: true, ..Patch::default() })
    }

    /// A material that reflects nothing but a base color, with the holes of the original.
    fn masked(&mut self, shape: &ShapeDesc, base_color: Color) -> BsdfDesc {
        let opacity = shape.bsdf.and_then(|b| opacity(&self.desc, b, 0));
        let mut base = base_color;
        // Holes are those of the base color's picture, which a black one needs as well.
        if let (Some((Scalar::Texture(_), id)), Color::Constant(c)) = (&opacity, base)
            && let Color::Texture(t) = self::base_color(&self.desc, *id, 0)
        {
            let product = TextureDesc::Multiply { a: Color::Constant(c), b: Color::Texture(t) };
            base = Color::Texture(self.desc.add(Node::new(Span::default(), product)));
        }
        let pbr = PbrDesc { base_color: base, metallic: Scalar::Constant(0.0), specular: Scalar::Constant(0.0), ..PbrDesc::default() };
        let plain = BsdfDesc::Pbr(Box::new(pbr));
        match opacity {
            None => plain,
            Some((opacity, _)) => {
                let nested = self.desc.add(Node::new(Span::default(), plain));
                BsdfDesc::Mask { nested, opacity }
            }
        }
    }

    /// Lights and glass, as they are; lights give no highlights, which would be seen beside baked light.
    fn others(&mut self) {
        for (i, node) in self.bake.flat.desc.shapes.iter().enumerate() {
            if self.bake.flat.shapes[i].bake != [false; 2] {
                continue;
            }
            let mut shape = node.value.clone();
            let data = self.bake.flat.mesh(i).clone();
            let mesh = self.desc.add(Node::named(node.name.clone(), node.span, MeshDesc { file: None, flip_v: false, data: Some(data) }));
            shape.geometry = GeometryDesc::Mesh { mesh, face_normals: false, smooth: false };
            if emits(&shape) && self.display != Display::Lightmap {
                let black = self.masked(&shape, Color::gray(0.0));
                shape.bsdf = Some(self.desc.add(Node::named("light", Span::default(), black)));
                shape.emission.iter_mut().for_each(|e| e.two_sided = true);
            }
            self.desc.add(Node::named(node.name.clone(), node.span, shape));
        }
    }
}

/// The texels of a chart with its gutter: (map, index, is its own).
fn cells<'a>(layout: &'a Layout, maps: &[Map], chart: usize, padding: u32) -> impl Iterator<Item = (usize, usize, bool)> + use<'a> {
    let p = &layout.charts[chart].place;
    let width = maps[p.atlas as usize].size[0];
    let rows = p.origin[1] - padding..p.origin[1] + p.texels[1] + padding;
    rows.flat_map(move |y| {
        let columns = p.origin[0] - padding..p.origin[0] + p.texels[0] + padding;
        columns.map(move |x| (p.atlas as usize, y as usize * width as usize + x as usize, true))
    })
}

/// A mesh of chosen vertices and triangles.
fn pick(mesh: &MeshData, from: &[u32], numbers: &[u32], triangles: Vec<[u32; 3]>) -> MeshData {
    fn chosen<T: Copy>(values: &[T], from: &[u32]) -> Vec<T> {
        if values.is_empty() { Vec::new() } else { from.iter().filter_map(|&i| values.get(i as usize)).copied().collect() }
    }
    let attributes = mesh.attributes.iter().map(|a| {
        let width = a.width as usize;
        let list = if a.per_face { numbers } else { from };
        let data = list.iter().flat_map(|&i| a.data.get(i as usize * width..(i as usize + 1) * width).unwrap_or(&[])).copied().collect();
        MeshAttribute { name: a.name.clone(), per_face: a.per_face, width: a.width, data }
    });
    MeshData {
        positions: chosen(&mesh.positions, from),
        normals: chosen(&mesh.normals, from),
        uvs: chosen(&mesh.uvs, from),
        tangents: chosen(&mesh.tangents, from),
        attributes: attributes.collect(),
        triangles,
    }
}

/// The back of a mesh: wound and turned the other way, a little off the front.
fn turned(mut mesh: MeshData) -> MeshData {
    let (min, max) = mesh.positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
    let offset = ((max - min).length() * BACK_OFFSET).max(min.abs().max(max.abs()).max_element() * 4e-6);
    let mut outward = vec![Vec3::ZERO; mesh.positions.len()];
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
        let n = (b - a).cross(c - a).normalize_or_zero();
        t.iter().for_each(|&i| outward[i as usize] += n);
    }
    for (p, n) in mesh.positions.iter_mut().zip(&outward) {
        *p -= n.normalize_or_zero() * offset;
    }
    mesh.normals.iter_mut().for_each(|n| *n = -*n);
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh
}

/// The opacity of a model with holes, and the model.
fn opacity(desc: &SceneDesc, id: BsdfId, depth: u32) -> Option<(Scalar, BsdfId)> {
    match &desc[id].value {
        _ if depth > DEPTH_LIMIT => None,
        BsdfDesc::Mask { opacity, nested } => Some((*opacity, *nested)),
        BsdfDesc::TwoSided { front: nested, .. } | BsdfDesc::NormalMap { nested, .. } | BsdfDesc::BumpMap { nested, .. } => {
            opacity(desc, *nested, depth + 1)
        }
        _ => None,
    }
}

/// The color of a model by which light is multiplied, for models that have one.
fn base_color(desc: &SceneDesc, id: BsdfId, depth: u32) -> Color {
    match &desc[id].value {
        _ if depth > DEPTH_LIMIT => Color::gray(0.5),
        BsdfDesc::Diffuse { reflectance, .. } | BsdfDesc::DiffuseTransmission { reflectance, .. } => *reflectance,
        BsdfDesc::Pbr(p) => p.base_color,
        BsdfDesc::Principled(p) => p.base_color,
        BsdfDesc::Plastic { diffuse_reflectance, .. } => *diffuse_reflectance,
        BsdfDesc::Conductor { specular_reflectance, .. } => *specular_reflectance,
        BsdfDesc::Coated { base: nested, .. }
        | BsdfDesc::Mask { nested, .. }
        | BsdfDesc::TwoSided { front: nested, .. }
        | BsdfDesc::NormalMap { nested, .. }
        | BsdfDesc::BumpMap { nested, .. }
        | BsdfDesc::Blend { first: nested, .. } => base_color(desc, *nested, depth + 1),
        _ => Color::gray(1.0),
    }
}

/// A color without the factor of the vertices' own color.
fn without_vertex_color(desc: &mut SceneDesc, color: Color, depth: u32) -> Color {
    let Param::Texture(id) = color else { return color };
    if depth > DEPTH_LIMIT {
        return color;
    }
    match desc[id].value.clone() {
        TextureDesc::Attribute { name, scale } if name == "color" => Color::gray(scale),
        TextureDesc::Multiply { a, b } => {
            let (x, y) = (without_vertex_color(desc, a, depth + 1), without_vertex_color(desc, b, depth + 1));
            if (x, y) == (a, b) {
                color
            } else {
                Color::Texture(desc.add(Node::new(Span::default(), TextureDesc::Multiply { a: x, b: y })))
            }
        }
        _ => color,
    }
}
