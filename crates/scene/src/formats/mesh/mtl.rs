//! OBJ files as scenes: a shape for each material of the MTL libraries.

use std::collections::HashMap;
use std::path::Path;

use glam::{Mat3, Mat4, Vec2};

use super::obj;
use crate::desc::{
    AddNode, BitmapDesc, BsdfDesc, BsdfId, Channel, Color, EmissionDesc, Encoding, GeometryDesc, ImageDesc, ImageId, ImageSource, MeshDesc,
    MicrofacetKind, Node, Param, PbrDesc, Roughness, Scalar, SceneDesc, ShapeDesc, TextureDesc, TextureFilter, TextureId, Wrap,
};
use crate::formats::{ReadOptions, Resolver};
use crate::report::ReadError;
use crate::span::{FileId, Span};

/// A material of a library.
#[derive(Clone, Debug)]
struct Material {
    span: Span,
    kd: [f32; 3],
    ks: [f32; 3],
    ke: [f32; 3],
    ns: f32,
    ni: f32,
    opacity: f32,
    illum: u32,
    roughness: Option<f32>,
    metallic: Option<f32>,
    clearcoat: f32,
    clearcoat_roughness: f32,
    sheen: f32,
    anisotropy: f32,
    maps: HashMap<&'static str, (Map, Span)>,
}

#[derive(Clone, Debug)]
struct Map {
    file: String,
    scale: Vec2,
    offset: Vec2,
    clamp: bool,
    strength: f32,
}

/// Reads an OBJ file with its material libraries.
///
/// # Errors
/// [`ReadError`] with every fault that was found.
pub fn read_scene(path: &Path, options: &ReadOptions) -> Result<SceneDesc, ReadError> {
    let bytes = Resolver::read(path).map_err(|e| ReadError::Io { path: path.to_owned(), source: std::io::Error::other(e.to_string()) })?;
    let mut desc = SceneDesc::new("obj", path);
    let file = FileId(0);
    let obj = match obj::parse(&bytes) {
        Ok(obj) => obj,
        Err(fault) => {
            desc.report.error(Span::new(file, fault.line, 1), fault.message);
            return Err(ReadError::Invalid { files: desc.files, faults: desc.report.faults });
        }
    };
    for warning in &obj.warnings {
        desc.report.warning(Span::file(file), warning.clone());
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let resolver = Resolver::new(folder, &options.search_paths);
    let mut materials: HashMap<String, Material> = HashMap::new();
    for (name, line) in &obj.libraries {
        let library = resolver.resolve(folder, name).and_then(|p| Resolver::read(&p).map(|b| (p, b)));
        match library {
            Ok((path, bytes)) => {
                let id = desc.add_file(path);
                library_materials(&bytes, id, &mut desc, &mut materials);
            }
            // Viewers show such a file in gray; so do we.
            Err(e) => desc.report.warning(Span::new(file, *line, 1), e.to_string()),
        }
    }
    let mut builder = Builder { resolver: &resolver, images: HashMap::new() };
    for part in &obj.parts {
        let data = obj.mesh(&[part]);
        let has_uvs = !data.uvs.is_empty();
        let span = Span::new(file, part.line.max(1), 1);
        let mesh = desc.add(Node::named(&part.material, span, MeshDesc { file: None, flip_v: false, data: Some(data) }));
        let geometry = GeometryDesc::Mesh { mesh, face_normals: false, smooth: false };
        let mut shape = ShapeDesc::new(geometry, Mat4::IDENTITY);
        match materials.get(&part.material) {
            Some(material) => {
                shape.bsdf = Some(builder.bsdf(&mut desc, &part.material, material, has_uvs));
                shape.emission = builder.emission(&mut desc, material, has_uvs);
            }
            None if !part.material.is_empty() => {
                desc.report.warning(span, format!("no library has the material `{}`", part.material));
            }
            None => {}
        }
        desc.add(Node::named(&part.material, span, shape));
    }
    if desc.report.has_errors() { Err(ReadError::Invalid { files: desc.files, faults: desc.report.faults }) } else { Ok(desc) }
}

fn library_materials(bytes: &[u8], file: FileId, desc: &mut SceneDesc, materials: &mut HashMap<String, Material>) {
    let mut current: Option<(String, Material)> = None;
    for (i, line) in bytes.split(|b| *b == b'\n').enumerate() {
        let span = Span::new(file, i as u32 + 1, 1);
        let line = String::from_utf8_lossy(line);
        let line = line.trim();
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        if word.is_empty() || word.starts_with('#') {
            continue;
        }
        if word == "newmtl" {
            if let Some((name, material)) = current.take() {
                materials.insert(name, material);
            }
            current = Some((rest.to_owned(), Material::new(span)));
            continue;
        }
        let Some((_, material)) = &mut current else {
            desc.report.warning(span, format!("`{}` before any newmtl", shorten(word)));
            continue;
        };
        if let Err(message) = material.set(word, rest, span) {
            desc.report.warning(span, message);
        }
    }
    materials.extend(current);
}

fn shorten(text: &str) -> String {
    text.chars().take(40).collect()
}

impl Material {
    fn new(span: Span) -> Self {
        Self {
            span,
            kd: [0.6; 3],
            ks: [0.0; 3],
            ke: [0.0; 3],
            ns: 0.0,
            ni: 1.5,
            opacity: 1.0,
            illum: 2,
            roughness: None,
            metallic: None,
            clearcoat: 0.0,
            clearcoat_roughness: 0.0,
            sheen: 0.0,
            anisotropy: 0.0,
            maps: HashMap::new(),
        }
    }

    fn set(&mut self, word: &str, rest: &str, span: Span) -> Result<(), String> {
        let number = || rest.split_whitespace().next().and_then(|w| w.parse::<f32>().ok()).filter(|v| v.is_finite());
        let one = || number().ok_or_else(|| format!("`{}` takes a number", shorten(word)));
        let color = || {
            let v: Vec<f32> = rest.split_whitespace().map_while(|w| w.parse().ok()).filter(|v: &f32| v.is_finite()).collect();
            match v[..] {
                [v] => Ok([v; 3]),
                [r, g, b] => Ok([r, g, b]),
                _ => Err(format!("`{}` takes one or three numbers", shorten(word))),
            }
        };
        match word {
            "Kd" => self.kd = color()?,
            "Ks" => self.ks = color()?,
            "Ke" => self.ke = color()?,
            "Ns" => self.ns = one()?.max(0.0),
            "Ni" => self.ni = one()?.max(1.0),
            "d" => self.opacity = rest.trim_start_matches("-halo").trim().parse().map_err(|_| "`d` takes a number".to_owned())?,
            "Tr" => self.opacity = 1.0 - one()?,
            "illum" => self.illum = one()? as u32,
            "Pr" => self.roughness = Some(one()?),
            "Pm" => self.metallic = Some(one()?),
            "Ps" => self.sheen = one()?,
            "Pc" => self.clearcoat = one()?,
            "Pcr" => self.clearcoat_roughness = one()?,
            "aniso" => self.anisotropy = one()?,
            "Ka" | "Tf" | "anisor" | "sharpness" | "map_Ka" | "map_Ns" | "refl" | "disp" | "decal" | "map_aat" => {}
            _ => {
                const MAPS: &[(&str, &str)] = &[
                    ("map_Kd", "Kd"),
                    ("map_Ks", "Ks"),
                    ("map_Ke", "Ke"),
                    ("map_d", "d"),
                    ("map_Pr", "Pr"),
                    ("map_Pm", "Pm"),
                    ("bump", "bump"),
                    ("map_bump", "bump"),
                    ("map_Bump", "bump"),
                    ("norm", "norm"),
                    ("map_Kn", "norm"),
                ];
                match MAPS.iter().find(|(name, _)| *name == word) {
                    Some((_, key)) => {
                        self.maps.insert(key, (map(rest), span));
                    }
                    None => return Err(format!("`{}` is ignored", shorten(word))),
                }
            }
        }
        Ok(())
    }
}

/// Options and file name of a map.
fn map(text: &str) -> Map {
    let mut map = Map { file: String::new(), scale: Vec2::ONE, offset: Vec2::ZERO, clamp: false, strength: 1.0 };
    let mut rest = text;
    while let Some(option) = rest.strip_prefix('-') {
        let (name, after) = option.split_once(char::is_whitespace).unwrap_or((option, ""));
        rest = after.trim_start();
        // Up to so many words follow; vectors may be shorter.
        let most = match name {
            "s" | "o" | "t" => 3,
            "mm" => 2,
            _ => 1,
        };
        let mut numbers = Vec::new();
        for i in 0..most {
            let (word, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
            match word.parse::<f32>() {
                Ok(v) => numbers.push(v),
                Err(_) if i > 0 => break,
                Err(_) => {}
            }
            if name == "clamp" {
                map.clamp = word == "on";
            }
            rest = after.trim_start();
        }
        let vector = |default: f32| Vec2::new(numbers.first().copied().unwrap_or(default), numbers.get(1).copied().unwrap_or(default));
        match name {
            "s" => map.scale = vector(1.0),
            "o" => map.offset = vector(0.0),
            "bm" => map.strength = numbers.first().copied().unwrap_or(1.0),
            _ => {}
        }
    }
    map.file = rest.trim().to_owned();
    map
}

struct Builder<'r> {
    resolver: &'r Resolver,
    images: HashMap<std::path::PathBuf, ImageId>,
}

impl Builder<'_> {
    fn texture(
        &mut self,
        desc: &mut SceneDesc,
        material: &Material,
        key: &str,
        channel: Channel,
        encoding: Encoding,
    ) -> Option<(TextureId, f32)> {
        let (map, span) = material.maps.get(key)?;
        let base = desc.files.get(span.file.0 as usize).and_then(|f| f.parent()).unwrap_or(Path::new("")).to_owned();
        let path = match self.resolver.resolve(&base, &map.file) {
            Ok(path) => path,
            Err(e) => {
                desc.report.warning(*span, e.to_string());
                return None;
            }
        };
        let image =
            *self.images.entry(path.clone()).or_insert_with(|| desc.add(Node::new(*span, ImageDesc { source: ImageSource::File(path) })));
        let wrap = [if map.clamp { Wrap::Clamp } else { Wrap::Repeat }; 2];
        let bitmap = BitmapDesc {
            image,
            encoding,
            wrap,
            filter: TextureFilter::Bilinear,
            picture_from_uv: Mat3::from_scale_angle_translation(map.scale, 0.0, map.offset),
            channel,
            uv_set: 0,
        };
        Some((desc.add(Node::new(*span, TextureDesc::Bitmap(bitmap))), map.strength))
    }

    fn color(&mut self, desc: &mut SceneDesc, material: &Material, key: &str, constant: [f32; 3], has_uvs: bool) -> Color {
        if !has_uvs {
            return Param::Constant(constant);
        }
        // Exporters write a factor of 0 or 1 beside a map; the map alone is meant.
        self.texture(desc, material, key, Channel::Luminance, Encoding::Auto).map_or(Param::Constant(constant), |(t, _)| Param::Texture(t))
    }

    fn scalar(&mut self, desc: &mut SceneDesc, material: &Material, key: &str, constant: f32, has_uvs: bool) -> Scalar {
        if !has_uvs {
            return Param::Constant(constant);
        }
        let texture = self.texture(desc, material, key, Channel::Luminance, Encoding::Linear);
        texture.map_or(Param::Constant(constant), |(t, _)| Param::Texture(t))
    }

    fn emission(&mut self, desc: &mut SceneDesc, m: &Material, has_uvs: bool) -> Option<EmissionDesc> {
        let radiance = self.color(desc, m, "Ke", m.ke, has_uvs);
        let dark = matches!(radiance, Param::Constant(c) if c.iter().all(|v| *v <= 0.0));
        (!dark).then(|| EmissionDesc { radiance, two_sided: false, group: String::new() })
    }

    fn bsdf(&mut self, desc: &mut SceneDesc, name: &str, m: &Material, has_uvs: bool) -> BsdfId {
        let span = m.span;
        let base = self.color(desc, m, "Kd", m.kd, has_uvs);
        // Walter et al. 2007, section 5.2: the microfacet roughness that looks like a Phong exponent.
        let alpha = (2.0 / (m.ns + 2.0)).sqrt();
        let glossy = m.ks.iter().any(|v| *v > 0.0) && m.illum >= 2;
        let glass = matches!(m.illum, 4 | 6 | 7 | 9) && m.opacity < 1.0 && !m.maps.contains_key("d");
        let mut two_sided = true;
        let value = if glass {
            two_sided = false;
            BsdfDesc::Dielectric {
                int_ior: m.ni.max(1.0),
                ext_ior: 1.0,
                specular_reflectance: Color::gray(1.0),
                specular_transmittance: Color::gray(1.0),
                roughness: None,
            }
        } else if m.roughness.is_some() || m.metallic.is_some() {
            BsdfDesc::Pbr(Box::new(PbrDesc {
                base_color: base,
                metallic: self.scalar(desc, m, "Pm", m.metallic.unwrap_or(0.0), has_uvs),
                roughness: self.scalar(desc, m, "Pr", m.roughness.unwrap_or(0.5), has_uvs),
                ior: if m.ni > 1.0 { m.ni } else { 1.5 },
                clearcoat: Param::Constant(m.clearcoat),
                clearcoat_roughness: Param::Constant(m.clearcoat_roughness),
                sheen_color: Color::gray(m.sheen),
                sheen_roughness: Param::Constant(0.5),
                anisotropy: Param::Constant(m.anisotropy),
                ..PbrDesc::default()
            }))
        } else if matches!(m.illum, 3 | 5) && m.kd.iter().all(|v| *v <= 0.0) {
            BsdfDesc::Conductor { eta: None, k: Color::gray(0.0), specular_reflectance: Param::Constant(m.ks), roughness: None }
        } else if glossy {
            let roughness =
                Roughness { distribution: MicrofacetKind::Ggx, alpha_u: Param::Constant(alpha), alpha_v: Param::Constant(alpha) };
            BsdfDesc::Plastic {
                diffuse_reflectance: base,
                specular_reflectance: Color::gray(1.0),
                int_ior: if m.ni > 1.0 { m.ni } else { 1.5 },
                ext_ior: 1.0,
                nonlinear: false,
                roughness: Some(roughness),
            }
        } else {
            BsdfDesc::Diffuse { reflectance: base, alpha: None }
        };
        let mut id = desc.add(Node::named(name, span, value));
        if has_uvs && let Some((texture, strength)) = self.texture(desc, m, "norm", Channel::Luminance, Encoding::Linear) {
            id = desc.add(Node::named(name, span, BsdfDesc::NormalMap { nested: id, texture, scale: strength }));
        } else if has_uvs && let Some((texture, strength)) = self.texture(desc, m, "bump", Channel::Luminance, Encoding::Linear) {
            id = desc.add(Node::named(name, span, BsdfDesc::BumpMap { nested: id, texture, scale: strength }));
        }
        if two_sided {
            id = desc.add(Node::named(name, span, BsdfDesc::TwoSided { front: id, back: id }));
        }
        let opacity = self.scalar(desc, m, "d", m.opacity.clamp(0.0, 1.0), has_uvs);
        if !glass && opacity != Param::Constant(1.0) {
            id = desc.add(Node::named(name, span, BsdfDesc::Mask { nested: id, opacity }));
        }
        id
    }
}
