//! The film's channels: the picture, its light groups and the AOVs.

use crate::film::{Channel, DevelopOptions};
use crate::integrator::Estimate;

/// An auxiliary output variable: what the camera sees first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aov {
    /// Share of light that the surface scatters: `albedo.R/G/B`.
    Albedo,
    /// Shading normal in world space: `N.X/Y/Z`.
    Normal,
    /// Distance from the camera: `Z`.
    Depth,
    /// Position in world space: `P.X/Y/Z`.
    Position,
    /// Texture coordinates: `uv.U/V`.
    Uv,
    /// Number of the object, from 1 (0: nothing): `id.object`.
    Object,
    /// Number of the material, from 1: `id.material`.
    Material,
}

impl Aov {
    /// All of them.
    pub const ALL: [Self; 7] = [Self::Albedo, Self::Normal, Self::Depth, Self::Position, Self::Uv, Self::Object, Self::Material];

    /// The name that the user types.
    pub fn name(self) -> &'static str {
        match self {
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Depth => "depth",
            Self::Position => "position",
            Self::Uv => "uv",
            Self::Object => "object",
            Self::Material => "material",
        }
    }

    /// By the name that the user types.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|a| a.name() == name)
    }

    /// The outputs of a list of names, each once: those of [`Aov::name`], `variance` and `samples` (which the film knows), or `all`.
    ///
    /// # Errors
    /// A sentence that names the one that does not exist.
    pub fn parse_list(names: &[String]) -> Result<(Vec<Self>, DevelopOptions), String> {
        let mut develop = DevelopOptions::default();
        let mut aovs = Vec::new();
        for name in names {
            match name.as_str() {
                "all" => {
                    aovs.extend(Self::ALL);
                    develop = DevelopOptions { variance: true, sample_count: true };
                }
                "variance" => develop.variance = true,
                "samples" => develop.sample_count = true,
                _ => aovs.push(Self::from_name(name).ok_or_else(|| {
                    let known: Vec<_> = Self::ALL.iter().map(|a| a.name()).collect();
                    format!("no auxiliary output `{name}`; there are {}, variance, samples, all", known.join(", "))
                })?),
            }
        }
        aovs.sort_by_key(|a| *a as u8);
        aovs.dedup();
        Ok((aovs, develop))
    }

    /// Names of its channels, as other programs expect them in EXR files.
    pub fn channel_names(self) -> &'static [&'static str] {
        match self {
            Self::Albedo => &["albedo.R", "albedo.G", "albedo.B"],
            Self::Normal => &["N.X", "N.Y", "N.Z"],
            Self::Depth => &["Z"],
            Self::Position => &["P.X", "P.Y", "P.Z"],
            Self::Uv => &["uv.U", "uv.V"],
            Self::Object => &["id.object"],
            Self::Material => &["id.material"],
        }
    }
}

/// The channels of a film: R, G, B, A, then each named light group's R, G, B, then the AOVs'.
pub fn film_channels(aovs: &[Aov], groups: &[String]) -> Vec<Channel> {
    let mut channels: Vec<Channel> = ["R", "G", "B", "A"].into_iter().map(Channel::mean).collect();
    if groups.len() > 1 {
        for group in groups {
            let name = if group.is_empty() { "rest" } else { group };
            channels.extend(["R", "G", "B"].map(|c| Channel::mean(format!("light.{name}.{c}"))));
        }
    }
    for aov in aovs {
        let first = matches!(aov, Aov::Object | Aov::Material);
        channels.extend(aov.channel_names().iter().map(|&n| if first { Channel::first(n) } else { Channel::mean(n) }));
    }
    channels
}

/// The values of one sample in the order of [`film_channels`].
pub(super) fn values(estimate: &Estimate, aovs: &[Aov], out: &mut Vec<f32>) {
    out.clear();
    out.extend(estimate.radiance.rgb());
    out.push(estimate.alpha);
    if estimate.groups.len() > 1 {
        out.extend(estimate.groups.iter().flat_map(|g| g.rgb()));
    }
    for aov in aovs {
        let Some(first) = &estimate.first else {
            out.extend(aov.channel_names().iter().map(|_| 0.0));
            continue;
        };
        match aov {
            Aov::Albedo => out.extend(first.albedo.rgb()),
            Aov::Normal => out.extend(first.ns.to_array()),
            Aov::Depth => out.push(first.depth),
            Aov::Position => out.extend(first.p.to_array()),
            Aov::Uv => out.extend(first.uv.to_array()),
            Aov::Object => out.push(first.object as f32),
            Aov::Material => out.push(first.material as f32),
        }
    }
}
