//! Pictures that textures and height fields use, decoded into the working space.

use std::sync::{Arc, OnceLock, PoisonError, RwLock};

use etendue_procedural::{Color, ImageId, Images};
use etendue_scene::desc::classic::{ClassicImage, GlobalSettings, ImageContent, ImageGamma, ImageSource};
use glam::DVec3;

use super::gamma::WorkingSpace;
use crate::image::{ColorEncoding, ReadLimits, TexelData, Texels, palette_indices};

/// A picture of a file or of a function.
enum Picture {
    Read(Decoded),
    /// Columns, and colors row by row.
    Made(u32, Arc<Vec<Color>>),
}

/// A decoded file.
struct Decoded {
    texels: Texels,
    /// Color numbers in the working space by 8-bit code; empty for other data.
    table: Vec<f64>,
    decode: Decode,
    palette: Option<Vec<u8>>,
    premultiplied: bool,
}

/// How a file's color numbers become numbers of the working space.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Decode {
    AsIs,
    /// From one space to another.
    Between(WorkingSpace, WorkingSpace),
}

impl Decode {
    /// What the numbers of a picture mean, all of it measured.
    fn new(image: &ClassicImage, settings: &GlobalSettings, space: WorkingSpace, kind: FileKind) -> Self {
        // Scenes without gamma compute as if linear, whatever is made of their numbers in the end.
        let space = if settings.gamma_given || settings.version >= 370 { space } else { WorkingSpace::Linear };
        let target = if image.content == ImageContent::Data { WorkingSpace::Linear } else { space };
        match (image.gamma, image.content, kind) {
            (Some(ImageGamma::Power(1.0)), ..) => Self::Between(WorkingSpace::Linear, target),
            (Some(ImageGamma::Power(g)), ..) if g > 0.0 && g.is_finite() => Self::Between(WorkingSpace::Power(g), target),
            (Some(ImageGamma::Srgb), ..) => Self::Between(WorkingSpace::Srgb, target),
            (_, ImageContent::Data | ImageContent::OldColors, _) | (_, _, FileKind::Bare) => Self::AsIs,
            (_, _, FileKind::Linear) => Self::Between(WorkingSpace::Linear, target),
            (_, _, FileKind::Srgb) => Self::Between(WorkingSpace::Srgb, target),
        }
    }

    fn apply(self, v: f64) -> f64 {
        match self {
            Self::AsIs => v,
            Self::Between(from, to) if from == to => v,
            Self::Between(from, to) => to.from_linear(from.linear(v)),
        }
    }
}

/// What kinds of files mean by their numbers where nobody says it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum FileKind {
    /// PNG, JPEG, GIF, BMP, TGA.
    Srgb,
    /// PPM, PGM, TIFF: numbers of the working space.
    Bare,
    /// OpenEXR, Radiance.
    Linear,
}

impl FileKind {
    fn new(bytes: &[u8], texels: &Texels) -> Self {
        let starts = |marks: &[&[u8]]| marks.iter().any(|m| bytes.starts_with(m));
        if matches!(texels.data, TexelData::F16(_) | TexelData::F32(_)) {
            Self::Linear
        } else if starts(&[b"P1", b"P2", b"P3", b"P4", b"P5", b"P6", b"P7", b"II*\0", b"MM\0*"]) {
            Self::Bare
        } else {
            Self::Srgb
        }
    }
}

/// The pictures of a scene, by number.
pub(super) struct Pictures {
    pictures: Vec<Option<Picture>>,
}

impl Pictures {
    /// Reads all pictures; those that cannot be read are black, with a sentence that says why.
    pub(super) fn load(images: &[ClassicImage], settings: &GlobalSettings, space: WorkingSpace) -> (Self, Vec<String>) {
        let mut faults = Vec::new();
        let pictures = images
            .iter()
            .map(|image| match read(image, settings, space) {
                Ok(picture) => Some(picture),
                Err(e) => {
                    if let ImageSource::File(path) = &image.source {
                        faults.push(format!("{}: {e}", path.display()));
                    }
                    None
                }
            })
            .collect();
        (Self { pictures }, faults)
    }

    fn get(&self, image: ImageId) -> Option<&Picture> {
        self.pictures.get(image as usize)?.as_ref()
    }
}

fn read(image: &ClassicImage, settings: &GlobalSettings, space: WorkingSpace) -> Result<Picture, crate::image::ImageError> {
    let path = match &image.source {
        ImageSource::File(path) => path,
        ImageSource::Made { width, colors } => return Ok(Picture::Made(*width, Arc::clone(colors))),
    };
    let bytes = std::fs::read(path)?;
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    let texels = Texels::from_bytes(&bytes, extension.as_deref(), Some(ColorEncoding::Linear), ReadLimits::default())?;
    let decode = Decode::new(image, settings, space, FileKind::new(&bytes, &texels));
    let table = match texels.data {
        TexelData::U8(_) => (0..=255u8).map(|c| decode.apply(f64::from(c) / 255.0)).collect(),
        _ => Vec::new(),
    };
    let palette = palette_indices(&bytes).filter(|indices| indices.len() == texels.width as usize * texels.height as usize);
    Ok(Picture::Read(Decoded { palette, texels, table, decode, premultiplied: image.premultiplied == Some(true) }))
}

impl Picture {
    fn size(&self) -> [u32; 2] {
        match self {
            Self::Read(p) => [p.texels.width, p.texels.height],
            Self::Made(width, colors) => [*width, (colors.len() / (*width).max(1) as usize) as u32],
        }
    }

    fn pixel(&self, x: u32, y: u32) -> Color {
        match self {
            Self::Read(p) => p.pixel(x, y),
            Self::Made(width, colors) => {
                let at = y as usize * *width as usize + x as usize;
                colors.get(at).filter(|_| x < *width).copied().unwrap_or_default()
            }
        }
    }

    fn index(&self, x: u32, y: u32) -> Option<u32> {
        let Self::Read(p) = self else { return None };
        let palette = p.palette.as_ref()?;
        palette.get(y as usize * p.texels.width as usize + x as usize).map(|&i| u32::from(i))
    }
}

impl Decoded {
    fn pixel(&self, x: u32, y: u32) -> Color {
        if x >= self.texels.width || y >= self.texels.height {
            return Color::default();
        }
        let (rgb, alpha) = match &self.texels.data {
            TexelData::U8(data) if self.table.len() == 256 => {
                let n = self.texels.channels as usize;
                let at = (y as usize * self.texels.width as usize + x as usize) * n;
                let c = |i: usize| self.table[data[at + i] as usize];
                match n {
                    1 => ([c(0); 3], 1.0),
                    2 => ([c(0); 3], f64::from(data[at + 1]) / 255.0),
                    3 => ([c(0), c(1), c(2)], 1.0),
                    _ => ([c(0), c(1), c(2)], f64::from(data[at + 3]) / 255.0),
                }
            }
            _ => {
                let [r, g, b, a] = self.texels.get(x, y).map(f64::from);
                ([r, g, b].map(|v| self.decode.apply(v)), a)
            }
        };
        let rgb = DVec3::from(rgb);
        let rgb = if self.premultiplied && alpha > 0.0 { rgb / alpha } else { rgb };
        Color { rgb, filter: 0.0, transmit: 1.0 - alpha }
    }
}

impl Images for Pictures {
    fn size(&self, image: ImageId) -> Option<[u32; 2]> {
        self.get(image).map(Picture::size)
    }

    fn pixel(&self, image: ImageId, x: u32, y: u32) -> Color {
        self.get(image).map_or_else(Color::default, |p| p.pixel(x, y))
    }

    fn index(&self, image: ImageId, x: u32, y: u32) -> Option<u32> {
        self.get(image)?.index(x, y)
    }
}

/// Pictures of a scene that is still being read: each is decoded when it is first asked for, those that cannot be read are missing.
#[derive(Default)]
pub(crate) struct NotedPictures {
    noted: RwLock<Vec<Arc<Noted>>>,
}

struct Noted {
    image: ClassicImage,
    settings: GlobalSettings,
    picture: OnceLock<Option<Picture>>,
}

impl NotedPictures {
    /// Takes note of a picture by its number; those of later numbers are forgotten.
    pub(crate) fn add(&self, id: ImageId, image: &ClassicImage, settings: &GlobalSettings) {
        let mut noted = self.noted.write().unwrap_or_else(PoisonError::into_inner);
        noted.truncate(id as usize);
        noted.push(Arc::new(Noted { image: image.clone(), settings: settings.clone(), picture: OnceLock::new() }));
    }

    fn with<T>(&self, image: ImageId, ask: impl FnOnce(&Picture) -> T) -> Option<T> {
        let noted = self.noted.read().unwrap_or_else(PoisonError::into_inner).get(image as usize)?.clone();
        let settings = &noted.settings;
        noted.picture.get_or_init(|| read(&noted.image, settings, WorkingSpace::new(settings)).ok()).as_ref().map(ask)
    }
}

impl Images for NotedPictures {
    fn size(&self, image: ImageId) -> Option<[u32; 2]> {
        self.with(image, Picture::size)
    }

    fn pixel(&self, image: ImageId, x: u32, y: u32) -> Color {
        self.with(image, |p| p.pixel(x, y)).unwrap_or_default()
    }

    fn index(&self, image: ImageId, x: u32, y: u32) -> Option<u32> {
        self.with(image, |p| p.index(x, y))?
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of `image_map` and of `image_pattern` where the file says 128, by POV-Ray 3.7.0.10.
    #[test]
    fn numbers_as_measured() {
        use FileKind::{Bare, Srgb};
        use ImageContent::{Colors, Data, OldColors};
        let power = |g| Some(ImageGamma::Power(g));
        for (version, assumed, content, gamma, kind, expected) in [
            (370, Some(1.0), Colors, None, Srgb, 0.215_86),
            (370, Some(1.0), Colors, None, Bare, 0.501_96),
            (370, Some(2.2), Colors, None, Srgb, 0.498_14),
            (370, Some(2.2), Colors, None, Bare, 0.501_96),
            (360, Some(1.0), OldColors, None, Srgb, 0.501_96),
            (360, Some(2.2), OldColors, None, Srgb, 0.501_96),
            (360, None, OldColors, None, Srgb, 0.501_96),
            (370, None, Colors, None, Srgb, 0.215_86),
            (370, Some(1.0), Colors, power(1.0), Srgb, 0.501_96),
            (370, Some(2.2), Colors, power(1.0), Srgb, 0.731_04),
            (370, Some(2.2), Colors, power(2.2), Srgb, 0.501_96),
            (360, Some(2.2), OldColors, power(1.0), Srgb, 0.731_04),
            (360, Some(2.2), OldColors, Some(ImageGamma::Srgb), Srgb, 0.498_14),
            (360, None, OldColors, power(2.2), Bare, 0.219_52),
            (370, Some(1.0), Data, None, Srgb, 0.501_96),
            (370, Some(2.2), Data, None, Srgb, 0.501_96),
            (370, Some(2.2), Data, power(2.2), Srgb, 0.219_52),
            (360, None, Data, Some(ImageGamma::Srgb), Srgb, 0.215_86),
        ] {
            let assumed_gamma = assumed.unwrap_or(1.0);
            let settings = GlobalSettings { version, gamma_given: assumed.is_some(), assumed_gamma, ..GlobalSettings::default() };
            let span = etendue_scene::Span::default();
            let image = ClassicImage { source: ImageSource::File("a.png".into()), span, gamma, content, premultiplied: None };
            let found = Decode::new(&image, &settings, WorkingSpace::new(&settings), kind).apply(128.0 / 255.0);
            assert!((found - expected).abs() < 2e-5, "{version} {assumed:?} {content:?} {gamma:?} {kind:?}: {found} is not {expected}");
        }
    }
}
