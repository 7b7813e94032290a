//! Pictures that textures and height fields use, decoded into the working space.

use etendue_procedural::{Color, ImageId, Images};
use etendue_scene::desc::classic::{ClassicImage, GlobalSettings};

use super::gamma::{WorkingSpace, linear_from_srgb};
use crate::image::{ColorEncoding, ReadLimits, TexelData, Texels};

/// A decoded picture.
struct Picture {
    texels: Texels,
    /// Color numbers in the working space by 8-bit code; empty for other data.
    table: Vec<f64>,
    decode: Decode,
    palette: Option<Vec<u8>>,
}

/// How a file's color numbers become numbers of the working space.
#[derive(Clone, Copy)]
enum Decode {
    AsIs,
    Power(f64, WorkingSpace),
    Srgb(WorkingSpace),
    Linear(WorkingSpace),
}

impl Decode {
    fn apply(self, v: f64) -> f64 {
        match self {
            Self::AsIs => v,
            Self::Power(g, space) => space.from_linear(WorkingSpace::Power(g).linear(v)),
            Self::Srgb(space) => space.from_linear(linear_from_srgb(v)),
            Self::Linear(space) => space.from_linear(v),
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
                    faults.push(format!("{}: {e}", image.path.display()));
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
    let bytes = std::fs::read(&image.path)?;
    let extension = image.path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    let texels = Texels::from_bytes(&bytes, extension.as_deref(), Some(ColorEncoding::Linear), ReadLimits::default())?;
    let float = matches!(texels.data, TexelData::F16(_) | TexelData::F32(_));
    // Without gamma handling (old scenes that do not ask for it) numbers are taken as they are.
    let off = !settings.gamma_given && settings.version < 370;
    let decode = match image.gamma {
        Some(_) if off => Decode::AsIs,
        Some(g) if g == 1.0 => Decode::Linear(space),
        Some(g) if g > 0.0 => Decode::Power(g, space),
        _ if off => Decode::AsIs,
        _ if float => Decode::Linear(space),
        _ => Decode::Srgb(space),
    };
    let table = match texels.data {
        TexelData::U8(_) => (0..=255u8).map(|c| decode.apply(f64::from(c) / 255.0)).collect(),
        _ => Vec::new(),
    };
    let palette = palette_indices(&bytes, [texels.width, texels.height]);
    Ok(Picture { palette, texels, table, decode })
}

/// Palette indices, row by row, of GIF and PNG files that have a palette; `None` for others.
fn palette_indices(bytes: &[u8], size: [u32; 2]) -> Option<Vec<u8>> {
    let pixels = size[0] as usize * size[1] as usize;
    if bytes.starts_with(b"GIF8") {
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::Indexed);
        let mut decoder = options.read_info(bytes).ok()?;
        let (width, height) = (u32::from(decoder.width()), u32::from(decoder.height()));
        let frame = decoder.read_next_frame().ok()??;
        // A first frame that does not cover the picture is rare; without indices colors still work.
        return ([width, height] == size && frame.buffer.len() == pixels).then(|| frame.buffer.to_vec());
    }
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::IDENTITY);
    let mut reader = decoder.read_info().ok()?;
    let info = reader.info();
    if info.color_type != png::ColorType::Indexed || [info.width, info.height] != size {
        return None;
    }
    let bits = info.bit_depth as usize;
    let mut buffer = vec![0; reader.output_buffer_size()?];
    let frame = reader.next_frame(&mut buffer).ok()?;
    let (row, width) = (frame.line_size, size[0] as usize);
    let at = |x: usize, y: usize| {
        let byte = buffer.get(y * row + x * bits / 8).copied().unwrap_or(0);
        let shift = 8 - bits - (x * bits) % 8;
        (byte >> shift) & (0xff >> (8 - bits))
    };
    Some((0..size[1] as usize).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect())
}

impl Images for Pictures {
    fn size(&self, image: ImageId) -> Option<[u32; 2]> {
        self.get(image).map(|p| [p.texels.width, p.texels.height])
    }

    fn pixel(&self, image: ImageId, x: u32, y: u32) -> Color {
        let Some(p) = self.get(image) else { return Color::default() };
        if x >= p.texels.width || y >= p.texels.height {
            return Color::default();
        }
        let (rgb, alpha) = match &p.texels.data {
            TexelData::U8(data) if p.table.len() == 256 => {
                let n = p.texels.channels as usize;
                let at = (y as usize * p.texels.width as usize + x as usize) * n;
                let c = |i: usize| p.table[data[at + i] as usize];
                match n {
                    1 => ([c(0); 3], 1.0),
                    2 => ([c(0); 3], f64::from(data[at + 1]) / 255.0),
                    3 => ([c(0), c(1), c(2)], 1.0),
                    _ => ([c(0), c(1), c(2)], f64::from(data[at + 3]) / 255.0),
                }
            }
            _ => {
                let [r, g, b, a] = p.texels.get(x, y).map(f64::from);
                ([r, g, b].map(|v| p.decode.apply(v)), a)
            }
        };
        Color { rgb: rgb.into(), filter: 0.0, transmit: 1.0 - alpha }
    }

    fn index(&self, image: ImageId, x: u32, y: u32) -> Option<u32> {
        let p = self.get(image)?;
        let palette = p.palette.as_ref()?;
        palette.get(y as usize * p.texels.width as usize + x as usize).map(|&i| u32::from(i))
    }
}
