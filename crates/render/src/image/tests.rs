use super::tonemap::ToneMap;
use super::*;
use crate::math::hash::{mix32, unit_float};

fn picture() -> Image {
    let mut image = Image::new(37, 21);
    image.origin = [3, 5];
    image.full_size = [64, 48];
    for (c, name) in ["R", "G", "B", "A", "albedo.R", "N.X", "Z", "P.Y", "uv.U", "id.object"].into_iter().enumerate() {
        let data = (0..37 * 21).map(|i| unit_float(mix32(i + 7777 * c as u32)) * if c == 6 { 1e6 } else { 1.5 });
        image.push(name, data.collect());
    }
    image
}

fn bytes_of(image: &Image, format: FileFormat, options: &WriteOptions) -> Vec<u8> {
    let mut bytes = Vec::new();
    image.write_to(&mut bytes, format, options).unwrap();
    bytes
}

fn read(bytes: &[u8]) -> Result<Image, ImageError> {
    Image::from_bytes(bytes, None, None, ReadLimits::default())
}

#[test]
fn exr_round_trip_in_single_and_half_precision() {
    let image = picture();
    let mut options = WriteOptions::default();
    options.exr.attributes = vec![
        ("renderer".into(), ExrAttribute::Text("etendue".into())),
        ("spp".into(), ExrAttribute::Int(64)),
        ("renderSeconds".into(), ExrAttribute::Float(1.5)),
    ];
    let bytes = bytes_of(&image, FileFormat::Exr, &options);
    assert_eq!(bytes, bytes_of(&image, FileFormat::Exr, &options));
    let back = read(&bytes).unwrap();
    assert_eq!((back.width, back.height, back.origin, back.full_size), (37, 21, [3, 5], [64, 48]));
    assert_eq!(back.channels.len(), image.channels.len());
    for channel in &image.channels {
        assert_eq!(back.channel(&channel.name).unwrap(), channel.data, "{}", channel.name);
    }
    options.exr.half = true;
    let half = read(&bytes_of(&image, FileFormat::Exr, &options)).unwrap();
    assert_eq!(half.channel("Z"), image.channel("Z"));
    let (a, b) = (half.channel("R").unwrap(), image.channel("R").unwrap());
    assert!(a != b && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= b / 2048.0 + 1e-7));
    let meta = exr::meta::MetaData::read_from_buffered(io::Cursor::new(&bytes), true).unwrap();
    let other = &meta.headers[0].own_attributes.other;
    assert!(other.iter().any(|(k, v)| k.eq("spp") && *v == exr::meta::attribute::AttributeValue::I32(64)));
}

#[test]
fn exr_texture_keeps_half_precision() {
    let mut options = WriteOptions::default();
    options.exr.half = true;
    let bytes = bytes_of(&picture(), FileFormat::Exr, &options);
    let texels = Texels::from_bytes(&bytes, None, None, ReadLimits::default()).unwrap();
    assert!(matches!(texels.data, TexelData::F16(_)));
    let image = read(&bytes).unwrap();
    assert_eq!(texels.get(4, 9), ["R", "G", "B", "A"].map(|n| image.channel(n).unwrap()[9 * 37 + 4]));
}

#[test]
fn png_jpeg_hdr_and_pfm() {
    let mut image = Image::from_rgb(2, 1, &[[1.0, 0.25, 0.0], [0.5, 0.5, 0.5]]);
    image.push("A", vec![1.0, 0.5]);
    let mut options = WriteOptions::default();
    for (sixteen_bit, tolerance) in [(false, 4e-3), (true, 2e-5)] {
        options.sixteen_bit = sixteen_bit;
        let back = read(&bytes_of(&image, FileFormat::Png, &options)).unwrap();
        assert_eq!(back.channels.len(), 3);
        for c in 0..3 {
            assert!(back.channels[c].data.iter().zip(&image.channels[c].data).all(|(a, b)| (a - b).abs() < tolerance));
        }
    }
    options.alpha = true;
    let back = read(&bytes_of(&image, FileFormat::Png, &options)).unwrap();
    assert_eq!((back.channels.len(), back.channels[0].data[1]), (4, 1.0));
    let hdr = read(&bytes_of(&image, FileFormat::Hdr, &options)).unwrap();
    assert_eq!(hdr.rgb(), image.rgb());
    let flat = Image::from_rgb(16, 16, &[[0.2, 0.4, 0.1]; 256]);
    let jpeg = read(&bytes_of(&flat, FileFormat::Jpeg, &options)).unwrap();
    assert!(jpeg.rgb().unwrap().iter().all(|p| (p[0] - 0.2).abs() < 0.02 && (p[1] - 0.4).abs() < 0.02));
    let pfm = bytes_of(&image, FileFormat::Pfm, &options);
    assert_eq!((&pfm[..14], pfm.len()), (&b"PF\n2 1\n-1.0\n\0\0"[..], 12 + 24));
    let tone = ToneMap::default();
    assert!(tone.apply([1.0, 0.0, 2.0]).iter().zip([1.0, 0.0, 1.0]).all(|(a, b)| (a - b).abs() < 1e-6));
}

#[test]
fn jpeg_and_png_textures_stay_eight_bit() {
    let flat = Image::from_rgb(16, 16, &[[0.2, 0.4, 0.1]; 256]);
    for format in [FileFormat::Jpeg, FileFormat::Png] {
        let bytes = bytes_of(&flat, format, &WriteOptions::default());
        let texels = Texels::from_bytes(&bytes, None, None, ReadLimits::default()).unwrap();
        assert_eq!((texels.data.byte_size(), texels.encoding), (768, ColorEncoding::Srgb));
        assert!((texels.get(3, 3)[1] - 0.4).abs() < 0.01);
        let raw = Texels::from_bytes(&bytes, None, Some(ColorEncoding::Linear), ReadLimits::default()).unwrap();
        assert!((raw.get(3, 3)[1] - srgb_from_linear(0.4)).abs() < 0.01);
    }
}

#[test]
fn truncated_files_are_errors_or_whole() {
    let image = picture();
    for format in [FileFormat::Exr, FileFormat::Png, FileFormat::Hdr, FileFormat::Jpeg] {
        let bytes = bytes_of(&image, format, &WriteOptions::default());
        for length in (0..bytes.len() * 9 / 10).step_by(97) {
            let result = read(&bytes[..length]);
            // JPEG decoders fill in what is missing.
            assert!(result.is_err() || format == FileFormat::Jpeg, "{format:?} cut to {length} of {}", bytes.len());
        }
    }
    assert!(read(b"").is_err() && read(b"hello").is_err());
}

#[test]
fn absurd_sizes_are_errors_before_memory() {
    let mut bytes = bytes_of(&picture(), FileFormat::Exr, &WriteOptions::default());
    let at = bytes.windows(10).position(|w| w == b"dataWindow").unwrap() + 10 + 1 + 6 + 4;
    for (x1, y1) in [(i32::MAX - 9, i32::MAX - 9), (100_000, 100_000), (36, i32::MAX), (-5, 3)] {
        bytes[at + 8..at + 12].copy_from_slice(&x1.to_le_bytes());
        bytes[at + 12..at + 16].copy_from_slice(&y1.to_le_bytes());
        assert!(read(&bytes).is_err(), "{x1} {y1}");
    }
    let small = ReadLimits { max_bytes: 1000, ..ReadLimits::default() };
    let bytes = bytes_of(&picture(), FileFormat::Exr, &WriteOptions::default());
    assert!(matches!(Image::from_bytes(&bytes, None, None, small), Err(ImageError::TooLarge { .. })));
    let bytes = bytes_of(&picture(), FileFormat::Png, &WriteOptions::default());
    assert!(Image::from_bytes(&bytes, None, None, small).is_err());
    let narrow = ReadLimits { max_side: 36, ..ReadLimits::default() };
    assert!(Image::from_bytes(&bytes, None, None, narrow).is_err());
    // A Targa header of 65535 x 65535 pixels, uncompressed, without any.
    let mut tga = vec![0u8; 18];
    (tga[2], tga[16]) = (2, 24);
    tga[12..16].fill(0xff);
    assert!(Image::from_bytes(&tga, Some("tga"), None, ReadLimits { max_bytes: 1 << 28, ..small }).is_err());
}

/// A film's channels in an EXR file under the names of the field, with the crop as data window.
#[test]
fn developed_film_to_exr() {
    use crate::film::{Channel, DevelopOptions, Film, FilmSpec, Rect};
    let mut spec = FilmSpec::new(40, 30);
    spec.crop = Rect::new(10, 5, 30, 25);
    spec.channels.extend([Channel::mean("N.X"), Channel::first("id.object")]);
    let mut film = Film::new(spec).unwrap();
    for index in 0..4 {
        film.add_sample(11, 6, index, 1.0, &[0.5, 1.0, 2.0, 1.0, -1.0, 7.0]);
    }
    let image = film.develop_with(DevelopOptions { variance: true, sample_count: true });
    let back = read(&bytes_of(&image, FileFormat::Exr, &WriteOptions::default())).unwrap();
    assert_eq!((back.origin, back.full_size), ([10, 5], [40, 30]));
    let at = |name: &str| back.channel(name).unwrap()[21];
    assert_eq!([at("R"), at("G"), at("B"), at("N.X"), at("id.object")], [0.5, 1.0, 2.0, -1.0, 7.0]);
    assert_eq!([at("variance.R"), at("sampleCount")], [0.0, 4.0]);
}
