//! The plugin tree: what a Mitsuba file says before anything is interpreted. XML becomes a tree ([`super::xml`]), and so does a nested
//! dictionary of Python; [`super::from_tree`] makes the description from either.

use glam::{DMat4, DVec3};

use crate::span::Span;

/// What a plugin is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// The scene itself.
    Scene,
    /// How light is computed.
    Integrator,
    /// A camera.
    Sensor,
    /// A picture.
    Film,
    /// A source of samples.
    Sampler,
    /// A reconstruction filter.
    Rfilter,
    /// A shape.
    Shape,
    /// A scattering model.
    Bsdf,
    /// A texture or a spectrum.
    Texture,
    /// A light.
    Emitter,
    /// A participating medium.
    Medium,
    /// A phase function.
    Phase,
    /// A volume of values.
    Volume,
}

impl Kind {
    /// The kind that an XML tag stands for.
    pub fn from_tag(tag: &str) -> Option<Self> {
        Some(match tag {
            "scene" => Self::Scene,
            "integrator" => Self::Integrator,
            "sensor" | "camera" => Self::Sensor,
            "film" => Self::Film,
            "sampler" => Self::Sampler,
            "rfilter" => Self::Rfilter,
            "shape" => Self::Shape,
            "bsdf" => Self::Bsdf,
            "texture" | "spectrum" => Self::Texture,
            "emitter" | "luminaire" => Self::Emitter,
            "medium" => Self::Medium,
            "phase" => Self::Phase,
            "volume" => Self::Volume,
            _ => return None,
        })
    }

    /// The XML tag.
    pub fn tag(self) -> &'static str {
        match self {
            Self::Scene => "scene",
            Self::Integrator => "integrator",
            Self::Sensor => "sensor",
            Self::Film => "film",
            Self::Sampler => "sampler",
            Self::Rfilter => "rfilter",
            Self::Shape => "shape",
            Self::Bsdf => "bsdf",
            Self::Texture => "texture",
            Self::Emitter => "emitter",
            Self::Medium => "medium",
            Self::Phase => "phase",
            Self::Volume => "volume",
        }
    }

    /// The kind of a plugin type, as a dictionary needs it that has no tags; `None` for an unknown type.
    pub fn of_type(type_name: &str) -> Option<Self> {
        PLUGINS.iter().find(|(_, types)| types.contains(&type_name)).map(|(kind, _)| *kind)
    }

    /// The plugin types of this kind that are known, rendered or not.
    pub fn types(self) -> &'static [&'static str] {
        PLUGINS.iter().find(|(kind, _)| *kind == self).map_or(&[], |(_, types)| types)
    }
}

/// Every plugin type of Mitsuba 3 and those of 0.6 that are mapped or lost by name.
const PLUGINS: &[(Kind, &[&str])] = &[
    (Kind::Scene, &["scene"]),
    (
        Kind::Integrator,
        &[
            "path",
            "direct",
            "volpath",
            "volpathmis",
            "ptracer",
            "aov",
            "moment",
            "stokes",
            "depth",
            "prb",
            "prb_basic",
            "prb_projective",
            "prbvolpath",
            "direct_projective",
            "ao",
            "bdpt",
            "mlt",
            "pssmlt",
            "erpt",
            "photonmapper",
            "ppm",
            "sppm",
            "vpl",
            "irrcache",
            "adaptive",
            "volpath_simple",
            "field",
            "multichannel",
        ],
    ),
    (
        Kind::Sensor,
        &[
            "perspective",
            "thinlens",
            "orthographic",
            "telecentric",
            "spherical",
            "batch",
            "distant",
            "irradiancemeter",
            "radiancemeter",
            "fluencemeter",
            "perspective_rdist",
        ],
    ),
    (Kind::Film, &["hdrfilm", "ldrfilm", "specfilm", "mfilm", "tiledhdrfilm"]),
    (Kind::Sampler, &["independent", "stratified", "multijitter", "orthogonal", "ldsampler", "halton", "hammersley", "sobol"]),
    (Kind::Rfilter, &["box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos"]),
    (
        Kind::Bsdf,
        &[
            "diffuse",
            "roughdiffuse",
            "conductor",
            "roughconductor",
            "dielectric",
            "roughdielectric",
            "thindielectric",
            "plastic",
            "roughplastic",
            "principled",
            "principledthin",
            "twosided",
            "mask",
            "blendbsdf",
            "mixturebsdf",
            "bumpmap",
            "bump",
            "normalmap",
            "null",
            "coating",
            "roughcoating",
            "difftrans",
            "phong",
            "ward",
            "hk",
            "irawan",
            "pplastic",
            "measured",
            "measured_polarized",
            "polarizer",
            "retarder",
            "circular",
            "hair",
        ],
    ),
    (
        Kind::Shape,
        &[
            "obj",
            "ply",
            "serialized",
            "stl",
            "sphere",
            "cylinder",
            "disk",
            "rectangle",
            "cube",
            "shapegroup",
            "instance",
            "merge",
            "heightfield",
            "hair",
            "bsplinecurve",
            "linearcurve",
            "sdfgrid",
            "ellipsoids",
            "ellipsoidsmesh",
            "blender",
        ],
    ),
    (
        Kind::Texture,
        &[
            "bitmap",
            "checkerboard",
            "mesh_attribute",
            "vertexcolors",
            "volume",
            "gridtexture",
            "scale",
            "uniform",
            "srgb",
            "rgb",
            "d65",
            "regular",
            "irregular",
            "spectrum",
            "blackbody",
            "rawconstant",
            "wireframe",
            "curvature",
        ],
    ),
    (
        Kind::Emitter,
        &[
            "area",
            "point",
            "spot",
            "directional",
            "directionalarea",
            "projector",
            "constant",
            "envmap",
            "sunsky",
            "timed_sunsky",
            "sky",
            "sun",
            "collimated",
        ],
    ),
    (Kind::Medium, &["homogeneous", "heterogeneous"]),
    (Kind::Phase, &["isotropic", "hg", "rayleigh", "blendphase", "sggx", "tabphase", "kkay", "microflake", "mixturephase"]),
    (Kind::Volume, &["constvolume", "gridvolume", "volcache", "hgridvolume"]),
];

/// A node of the tree.
#[derive(Clone, Debug, PartialEq)]
pub struct Plugin {
    /// What it is for.
    pub kind: Kind,
    /// Its type, such as `roughconductor`; empty for a scene.
    pub type_name: String,
    /// Its id; empty for none.
    pub id: String,
    /// Where it is.
    pub span: Span,
    /// Parameters and nested plugins in the order of the file.
    pub params: Vec<Property>,
}

/// A parameter of a plugin.
#[derive(Clone, Debug, PartialEq)]
pub struct Property {
    /// Its name; empty for a nested plugin or reference without one.
    pub name: String,
    /// Its value.
    pub value: Value,
    /// Where it is.
    pub span: Span,
}

/// A value of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// `true` or `false`.
    Bool(bool),
    /// A whole number.
    Int(i64),
    /// A number.
    Float(f64),
    /// A text.
    Text(String),
    /// A point or vector.
    Vector(DVec3),
    /// A linear Rec. 709 color.
    Rgb(DVec3),
    /// A spectrum that is the same at every wavelength.
    Uniform(f64),
    /// A spectrum: wavelengths in nanometres, ascending, and values.
    Spectrum(Vec<(f64, f64)>),
    /// A transform.
    Transform(DMat4),
    /// Decoded values of a picture: width, height, channels, rows from the top; linear.
    Pixels {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Values to a pixel.
        channels: u32,
        /// `width * height * channels` values.
        data: Vec<f32>,
    },
    /// A nested plugin.
    Plugin(Box<Plugin>),
    /// The id of a plugin elsewhere.
    Reference(String),
}

impl Value {
    /// What it is, in words.
    pub fn kind_name(&self) -> &'static str {
        match self {
            Self::Bool(_) => "a boolean",
            Self::Int(_) => "an integer",
            Self::Float(_) => "a float",
            Self::Text(_) => "a string",
            Self::Vector(_) => "a vector",
            Self::Rgb(_) => "a color",
            Self::Uniform(_) | Self::Spectrum(_) => "a spectrum",
            Self::Transform(_) => "a transform",
            Self::Pixels { .. } => "a picture",
            Self::Plugin(_) | Self::Reference(_) => "an object",
        }
    }
}

/// A whole scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    /// The scene.
    pub root: Plugin,
    /// Further names of plugins: the new name, the id that it stands for, and the place.
    pub aliases: Vec<(String, String, Span)>,
}

/// The candidate that `name` is probably a misspelling of.
pub fn nearest<'c>(name: &str, candidates: impl IntoIterator<Item = &'c str>) -> Option<&'c str> {
    // The table below is quadratic in the length; no name is that long by mistake.
    if name.len() > 64 {
        return None;
    }
    let fold = |s: &str| s.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect::<Vec<_>>();
    let wanted = fold(name);
    let (distance, best) = candidates.into_iter().map(|c| (edit_distance(&wanted, &fold(c)), c)).min_by_key(|(d, _)| *d)?;
    (distance <= (wanted.len() / 3).max(1)).then_some(best)
}

/// Insertions, deletions, substitutions and swaps of neighbors from one to the other (optimal string alignment).
fn edit_distance(a: &[char], b: &[char]) -> usize {
    let mut rows = vec![(0..=b.len()).collect::<Vec<usize>>()];
    for i in 1..=a.len() {
        let mut row = vec![i];
        for j in 1..=b.len() {
            let substitute = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            let mut best = substitute.min(rows[i - 1][j] + 1).min(row[j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                best = best.min(rows[i - 2][j - 2] + 1);
            }
            row.push(best);
        }
        rows.push(row);
    }
    rows[a.len()][b.len()]
}

/// ` (did you mean …?)` or nothing.
pub fn suggestion<'c>(name: &str, candidates: impl IntoIterator<Item = &'c str>) -> String {
    nearest(name, candidates).map(|n| format!(" (did you mean `{n}`?)")).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspellings_are_recognized() {
        assert_eq!(nearest("reflectence", ["radiance", "reflectance"]), Some("reflectance"));
        assert_eq!(nearest("toWorld", ["to_world", "to_uv"]), Some("to_world"));
        assert_eq!(nearest("banana", ["to_world", "to_uv"]), None);
    }

    #[test]
    fn every_type_has_one_kind() {
        let mut all: Vec<&str> = PLUGINS.iter().flat_map(|(_, t)| t.iter().copied()).collect();
        let n = all.len();
        all.sort_unstable();
        all.dedup();
        // `hair` is a shape of 0.6 and a BSDF of 3; a dictionary, which has no tags, means the latter.
        assert_eq!(Kind::of_type("hair"), Some(Kind::Bsdf));
        assert_eq!(n - all.len(), 1);
    }
}
