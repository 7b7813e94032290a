use super::*;
use crate::classic::WorkingSpace;
use crate::film::file::FilmFileError;
use crate::math::hash::{hash_words, unit_float};

const SIZE: [u32; 2] = [23, 11];
const SPP: u32 = 12;

fn spec() -> FilmSpec {
    let mut spec = FilmSpec::new(SIZE[0], SIZE[1]);
    spec.channels.extend([Channel::mean("albedo.R"), Channel::first("id.object"), Channel::mean("Z")]);
    spec
}

/// What a change is called and what it does.
type Edit<T> = (&'static str, fn(&mut T));

/// Samples of all magnitudes and both signs, some absurd: a pure function of pixel and index, as in a renderer.
fn sample(x: u32, y: u32, index: u32) -> (f32, [f32; 7]) {
    let word = |dim: u64| hash_words([u64::from(x), u64::from(y), u64::from(index), dim]);
    let values = std::array::from_fn(|i| {
        let w = word(i as u64);
        let magnitude = f32::from_bits(((w >> 32) as u32 % 120 + 60) << 23);
        let v = unit_float(w as u32) * magnitude * if w & (1 << 60) == 0 { 1.0 } else { -1.0 };
        match w % 211 {
            0 => f32::NAN,
            1 => f32::INFINITY,
            2 => -1e38,
            _ => v,
        }
    });
    (if word(99) % 5 == 0 { -1.37 } else { 1.37 }, values)
}

fn render(film: &mut Film, rect: Rect, range: std::ops::Range<u32>) {
    for y in rect.y0..rect.y1 {
        for x in rect.x0..rect.x1 {
            for index in range.clone() {
                let (weight, values) = sample(x, y, index);
                film.add_sample(x, y, index, weight, &values);
            }
        }
    }
    film.mark_held(rect, range.start, range.end).unwrap();
}

fn reference() -> Film {
    let mut film = Film::new(spec()).unwrap();
    let rect = film.rect();
    render(&mut film, rect, 0..SPP);
    film
}

/// A sequence of numbers for the random splits below.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 += 1;
        (hash_words([self.0]) % n as u64) as usize
    }

    fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, self.below(i + 1));
        }
    }

    /// Cuts 0..n into consecutive random ranges.
    fn cuts(&mut self, n: u32) -> Vec<std::ops::Range<u32>> {
        let mut at: Vec<u32> = (0..self.below(4)).map(|_| self.below(n as usize) as u32).chain([0, n]).collect();
        at.sort_unstable();
        at.dedup();
        at.windows(2).map(|w| w[0]..w[1]).collect()
    }
}

#[test]
fn any_order_tiling_split_and_grouping_gives_the_same_bits() {
    let expected = reference();
    assert!(expected.counters().non_finite > 50 && expected.counters().saturated > 50);
    for round in 0..40 {
        let mut random = Random(round * 1000);
        let mut parts = Vec::new();
        for ys in random.cuts(SIZE[1]) {
            for xs in random.cuts(SIZE[0]) {
                let rect = Rect::new(xs.start, ys.start, xs.end, ys.end);
                parts.extend(random.cuts(SPP).into_iter().map(|range| (rect, range)));
            }
        }
        random.shuffle(&mut parts);
        // Tiles go to one of three films ("machines"), which are then merged, some through files.
        let mut films = [0; 3].map(|_| Film::new(spec()).unwrap());
        for (rect, range) in parts {
            let film = &mut films[random.below(3)];
            let mut tile = film.new_tile(rect).unwrap();
            render(&mut tile, rect, range);
            film.merge(&tile).unwrap();
        }
        random.shuffle(&mut films);
        let [mut total, second, third] = films;
        let mut bytes = Vec::new();
        second.write_to(&mut bytes).unwrap();
        total.merge(&Film::from_bytes(&bytes, 1 << 30).unwrap()).unwrap();
        total.merge(&third).unwrap();
        assert!(total.held().holds(&HeldSamples { rect: total.rect(), begin: 0, end: SPP }));
        total.held = expected.held.clone();
        assert!(total == expected, "round {round} differs");
        assert_eq!(total.relative_error().to_bits(), expected.relative_error().to_bits());
    }
}

#[test]
fn threads_give_the_same_bits() {
    use rayon::prelude::*;
    for threads in [1, 2, 5] {
        let total = std::sync::Mutex::new(Film::new(spec()).unwrap());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let empty = Film::new(spec()).unwrap();
        pool.install(|| {
            (0..SIZE[1] * SPP).into_par_iter().for_each(|job| {
                let (y, index) = (job / SPP, job % SPP);
                let rect = Rect::new(0, y, SIZE[0], y + 1);
                let mut tile = empty.new_tile(rect).unwrap();
                render(&mut tile, rect, index..index + 1);
                total.lock().unwrap().merge(&tile).unwrap();
            });
        });
        assert!(total.into_inner().unwrap() == reference());
    }
}

#[test]
fn sums_mean_variance_and_first_values() {
    let mut film = Film::new(spec()).unwrap();
    let lights = [1.0f32, 4.0, 0.25, 2.75];
    for (i, &v) in lights.iter().enumerate().rev() {
        film.add_sample(3, 4, i as u32 + 7, 1.0, &[v, 2.0 * v, 0.0, 1.0, 0.5, 100.0 + i as f32, 9.0]);
    }
    film.add_sample(100, 4, 0, 1.0, &[1.0; 7]);
    assert_eq!(film.sample_count(3, 4), 4);
    let image = film.develop_with(DevelopOptions { variance: true, sample_count: true });
    let at = |name: &str| image.channel(name).unwrap()[4 * SIZE[0] as usize + 3];
    assert_eq!([at("R"), at("G"), at("B"), at("A"), at("albedo.R"), at("Z")], [2.0, 4.0, 0.0, 1.0, 0.5, 9.0]);
    assert_eq!((at("id.object"), at("sampleCount")), (100.0, 4.0));
    let variance = lights.iter().map(|v| (v - 2.0).powi(2)).sum::<f32>() / 3.0 / 4.0;
    assert!((at("variance.R") - variance).abs() < 1e-6);
    assert!((at("variance.G") - 4.0 * variance).abs() < 1e-5);
    assert!(film.relative_error().is_infinite());
}

/// The estimate must be what a comparison with the true picture finds, over many pixels.
#[test]
fn relative_error_predicts_the_true_one() {
    let mut film = Film::new(FilmSpec::new(64, 64)).unwrap();
    for (x, y) in (0..64 * 64).map(|i| (i % 64, i / 64)) {
        for index in 0..16 {
            let v = 4.0 * unit_float(hash_words([u64::from(x), u64::from(y), index]) as u32);
            film.add_sample(x, y, index as u32, 1.0, &[v, v, v, 1.0]);
        }
    }
    let image = film.develop();
    let error = image.channels[0].data.iter().map(|v| f64::from(v - 2.0).powi(2) / 4.01).sum::<f64>() / 4096.0;
    assert!((film.relative_error() / error.sqrt() - 1.0).abs() < 0.05, "{} {}", film.relative_error(), error.sqrt());
}

/// Nothing but the error estimate goes with the sums of squares.
#[test]
fn films_without_squares_have_the_same_picture() {
    let spec = FilmSpec::new(8, 4);
    let (mut whole, mut bare) = (Film::new(spec.clone()).unwrap(), Film::new(spec).unwrap());
    bare.drop_squares();
    for rect in [Rect::new(0, 0, 4, 4), Rect::new(4, 0, 8, 4)] {
        for film in [&mut whole, &mut bare] {
            let mut tile = film.new_tile(rect).unwrap();
            assert_eq!(tile.has_squares(), film.has_squares());
            for (x, y) in (0..16).map(|i| (rect.x0 + i % 4, i / 4)) {
                for index in 0..3 {
                    let v = unit_float(hash_words([u64::from(x), u64::from(y), u64::from(index)]) as u32) - 0.3;
                    tile.add_sample(x, y, index, 1.0, &[v, 2.0 * v, -v, 1.0]);
                }
            }
            tile.mark_held(rect, 0, 3).unwrap();
            film.merge(&tile).unwrap();
        }
    }
    assert_eq!(whole.develop(), bare.develop());
    assert!(bare.variance().iter().all(|v| v.is_infinite()) && whole.variance().iter().all(|v| v.is_finite()));
    assert!(bare.write_to(&mut Vec::new()).is_err());
    let mut other = Film::new(whole.spec().clone()).unwrap();
    assert!(matches!(other.merge(&bare), Err(FilmError::Mismatch { .. })), "a film that estimates its error takes none without");
}

/// A film that keeps single samples as they came has the picture and the counters of one that sums all, whatever the values are, in
/// whichever order parts are merged, and where a sample with another weight ends that.
#[test]
fn plain_films_are_films() {
    let value = |x: u32, index: u32, k: u32| match (x % 5, k) {
        (1, 0) => 1e-30,
        (2, 1) => f32::NAN,
        (3, 2) => f32::MAX,
        _ => unit_float(hash_words([u64::from(x), u64::from(index), u64::from(k)]) as u32) - 0.4,
    };
    for odd_weight in [1.0, 0.5] {
        let make = |is_plain: bool, parts: &[(u32, u32)]| {
            let mut film = Film::new(FilmSpec::new(10, 1)).unwrap();
            if is_plain {
                film.drop_squares();
                assert!(film.is_plain());
            }
            for &(begin, end) in parts {
                let mut tile = film.new_tile(film.rect()).unwrap();
                // Columns from 5 on have their first sample only.
                for (x, index) in (0..10).flat_map(|x| (begin..end).map(move |i| (x, i))).filter(|&(x, i)| i == 0 || x < 5) {
                    let weight = if index == 2 { odd_weight } else { 1.0 };
                    tile.add_sample(x, 0, index, weight, &[0, 1, 2, 3].map(|k| value(x, index, k)));
                }
                tile.mark_held(film.rect(), begin, end).unwrap();
                film.merge(&tile).unwrap();
            }
            film
        };
        let whole = make(false, &[(0, 1), (1, 4)]);
        let plain = make(true, &[(0, 1), (1, 4)]);
        assert_eq!(plain.is_plain(), odd_weight == 1.0);
        assert!(plain == make(true, &[(1, 4), (0, 1)]) && plain == make(true, &[(0, 4)]));
        assert_eq!(whole.develop_with(DevelopOptions { sample_count: true, ..Default::default() }), {
            plain.develop_with(DevelopOptions { sample_count: true, ..Default::default() })
        });
        assert_eq!(whole.counters().non_finite, plain.counters().non_finite);
    }
}

#[test]
fn numbers_of_sums_are_those_of_the_conversion() {
    for i in 0..100_000u64 {
        let w = hash_words([i]);
        let sum = (i128::from(w as i64) << 40 | i128::from(hash_words([w]) >> 24)) >> (w % 90);
        let (found, expected) = (real(sum), sum as f64 / SUM_ONE);
        assert!((found - expected).abs() <= 3e-16 * expected.abs(), "{sum}: {found} {expected}");
    }
}

#[test]
fn fixed_point_is_the_truncated_product() {
    for i in 0..100_000u64 {
        let w = hash_words([i]);
        // Every exponent up to the limit, subnormal numbers included.
        let exponent = if i % 50 == 0 { 0 } else { w % 1063 };
        let v = f64::from_bits((w << 52 & 1 << 63) | (exponent << 52) | (w >> 12));
        assert_eq!(fixed(v, SUM_BITS), (v * SUM_ONE) as i128, "{v}");
        assert_eq!(fixed(v, SQUARE_BITS), (v * SQUARE_ONE) as i128, "{v}");
    }
    for v in [0.0, -0.0, 1.0, -1.0, LIMIT, -LIMIT] {
        assert_eq!(fixed(v, SUM_BITS), (v * SUM_ONE) as i128, "{v}");
    }
    assert_eq!(fixed(SQUARE_LIMIT * SQUARE_LIMIT, SQUARE_BITS), 1 << 104);
}

#[test]
fn tiny_huge_and_non_finite_values() {
    let mut film = Film::new(FilmSpec::new(1, 1)).unwrap();
    film.add_sample(0, 0, 0, 1.0, &[2f32.powi(-64), 2f32.powi(-65), f32::MAX, f32::NAN]);
    film.add_sample(0, 0, 1, 1.0, &[-1.0, -1.0, f32::NEG_INFINITY, 1.0]);
    assert_eq!(film.sums, [1 - (1i128 << 64), -(1i128 << 64), 1i128 << 104, 1i128 << 64]);
    // Blue itself, its square, and the square of the luminance it makes.
    assert_eq!(film.counters(), FilmCounters { non_finite: 2, saturated: 3 });
}

#[test]
fn merge_refuses_what_does_not_belong_together() {
    let base = reference();
    let refused = |other: &Film, what: &str| {
        let mut film = base.clone();
        let message = film.merge(other).unwrap_err().to_string();
        assert!(message.contains(what), "{message}");
        assert!(film == base);
    };
    refused(&base, "both films hold samples 0..12");
    let mut next = Film::new(spec()).unwrap();
    next.mark_held(Rect::new(20, 9, 23, 11), 11, 14).unwrap();
    refused(&next, "samples 11..12 of pixels [20, 23) x [9, 11)");
    let changed: [Edit<FilmMeta>; 5] = [
        ("seed", |m| m.seed = 1),
        ("scene", |m| m.scene_hash = "x".into()),
        ("settings", |m| m.settings_hash = "x".into()),
        ("integrator", |m| m.integrator = "x".into()),
        ("renderer", |m| m.renderer = "x".into()),
    ];
    for (what, change) in changed {
        let mut other = Film::new(spec()).unwrap();
        change(&mut other.meta);
        refused(&other, what);
    }
    let changed: [Edit<FilmSpec>; 4] = [
        ("filter", |s| s.filter = Filter::BOX),
        ("size", |s| s.width += 1),
        ("crop", |s| s.crop.x0 = 1),
        ("channels", |s| s.channels.truncate(4)),
    ];
    for (what, change) in changed {
        let mut other = spec();
        change(&mut other);
        refused(&Film::new(other).unwrap(), what);
    }
    let tile = base.new_tile(Rect::new(0, 0, 4, 4)).unwrap();
    assert!(matches!(tile.clone().merge(&base), Err(FilmError::Outside { .. })));
    assert!(base.new_tile(Rect::new(20, 0, 24, 4)).is_err());
    let mut bad = spec();
    bad.channels[5].name = "R".into();
    assert!(Film::new(bad).is_err());
    assert!(Film::new(FilmSpec::new(0, 4)).is_err());
    assert!(Film::new(FilmSpec::new(u32::MAX, 4)).is_err());
}

fn bytes_of(film: &Film) -> Vec<u8> {
    let mut bytes = Vec::new();
    film.write_to(&mut bytes).unwrap();
    bytes
}

#[test]
fn file_round_trip_is_exact() {
    let mut film = reference();
    film.meta = FilmMeta { scene_hash: "ab".into(), seed: u64::MAX, render_ms: 17, ..FilmMeta::default() };
    film.meta.notes.insert("scene".into(), "ä.xml".into());
    let path = std::env::temp_dir().join(format!("etendue-film-{}.film", std::process::id()));
    film.save(&path).unwrap();
    let read = Film::load(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    assert!(read == film);
    assert_eq!(bytes_of(&read), bytes_of(&film));
    // More pixels than a block, and no first channels.
    let mut large = Film::new(FilmSpec::new(97, 91)).unwrap();
    for i in 0..97 * 91 {
        large.add_sample(i % 97, i / 97, 0, 1.0, &[i as f32; 4]);
    }
    assert!(Film::from_bytes(&bytes_of(&large), 1 << 30).unwrap() == large);
}

#[test]
fn truncated_and_damaged_files_are_errors() {
    let bytes = bytes_of(&reference());
    for length in (0..bytes.len()).step_by(64).chain([bytes.len() - 1]) {
        let error = Film::from_bytes(&bytes[..length], 1 << 30).unwrap_err();
        assert!(matches!(error, FilmFileError::Truncated(_)), "{length}: {error}");
    }
    for at in (0..bytes.len()).step_by(61) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        assert!(Film::from_bytes(&damaged, 1 << 30).is_err(), "byte {at}");
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert!(Film::from_bytes(&longer, 1 << 30).is_err());
}

/// A file with this header and consistent checksums, followed by `body`.
fn forge(header: &str, body: &[u8]) -> Vec<u8> {
    let mut bytes = b"ETNDFILM\x01\0\0\0".to_vec();
    bytes.extend((header.len() as u32).to_le_bytes());
    bytes.extend(crc32fast::hash(header.as_bytes()).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(body);
    bytes
}

#[test]
fn hostile_headers_are_errors_before_memory() {
    let bytes = bytes_of(&reference());
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let header = std::str::from_utf8(&bytes[20..20 + length]).unwrap();
    let body = &bytes[20 + length..];
    assert!(Film::from_bytes(&forge(header, body), 1 << 30).is_ok());
    assert!(matches!(Film::from_bytes(&bytes, 1000), Err(FilmFileError::TooLarge { .. })));
    let edits = [
        ("\"width\":23", "\"width\":4294967295"),
        ("\"width\":23", "\"width\":-1"),
        ("\"width\":23", "\"width\":0"),
        ("\"x1\":23,\"y1\":11}", "\"x1\":1048576,\"y1\":1048576}"),
        ("\"x1\":23", "\"x1\":24"),
        ("\"stddev\":0.5", "\"stddev\":1e30"),
        ("\"stddev\":0.5", "\"stddev\":null"),
        ("\"name\":\"R\"", "\"name\":\"Q\""),
        ("\"name\":\"Z\"", "\"name\":\"A\""),
        ("\"begin\":0", "\"begin\":12"),
        ("\"end\":12", "\"end\":-12"),
        ("\"spec\"", "\"unknown\":1,\"spec\""),
        ("{", "["),
    ];
    for (from, to) in edits {
        assert!(header.contains(from), "{from} not in {header}");
        assert!(Film::from_bytes(&forge(&header.replace(from, to), body), 1 << 40).is_err(), "{from} -> {to}");
    }
    // A million times a million pixels in a file of a few hundred bytes.
    let huge = header.replace("\"width\":23,\"height\":11", "\"width\":1048576,\"height\":1048576");
    let huge = huge.replace("\"x1\":23,\"y1\":11", "\"x1\":1048576,\"y1\":1048576");
    assert!(matches!(Film::from_bytes(&forge(&huge, body), u64::MAX), Err(FilmFileError::Truncated(_) | FilmFileError::Damaged(_))));
    let mut later = bytes.clone();
    later[8] = 3;
    assert!(matches!(Film::from_bytes(&later, 1 << 30), Err(FilmFileError::Version(3))));
    later[8] = 2;
    assert!(matches!(Film::from_bytes(&later, 1 << 30), Err(FilmFileError::Damaged(_))), "no splats in version 2");
    let deep = "[".repeat(100_000);
    assert!(Film::from_bytes(&forge(&deep, &[]), 1 << 30).is_err());
}

/// POV-Ray 3.7.0.10 shows 180 for a pixel of which seven of ten samples are white, three black, with `assumed_gamma 2.2`, and 218
/// with `assumed_gamma 1`.
#[test]
fn means_are_of_numbers_of_the_space() {
    for (space, shown) in [(WorkingSpace::Linear, 218.0), (WorkingSpace::Power(2.2), 180.0), (WorkingSpace::Srgb, 179.0)] {
        let mut film = Film::new(FilmSpec { space, ..FilmSpec::new(1, 1) }).unwrap();
        for i in 0..10 {
            let v = if i < 7 { 1.0 } else { 0.0 };
            film.add_sample(0, 0, i, 1.0, &[v, v, v, 1.0]);
        }
        let linear = f64::from(film.develop().channel("G").unwrap()[0]);
        let byte = 255.0 * WorkingSpace::Srgb.from_linear(linear);
        assert!((byte - shown).abs() < 0.75, "{space:?}: {byte} is not {shown}");
    }
}

/// The same as [`render`] for a film of a crop with splats and light groups: each sample brings some to pixels all over the picture.
fn splatting_spec() -> FilmSpec {
    let mut spec = FilmSpec::new(SIZE[0] + 5, SIZE[1] + 3);
    spec.crop = Rect::new(2, 1, SIZE[0], SIZE[1] + 2);
    spec.channels.extend(["light.a.R", "light.a.G", "light.a.B", "light.b.R", "light.b.G", "light.b.B", "Z"].map(Channel::mean));
    spec.splats = true;
    spec
}

fn render_splats(film: &mut Film, rect: Rect, range: std::ops::Range<u32>) {
    for (x, y, index) in
        (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).map(move |x| (x, y))).flat_map(|(x, y)| range.clone().map(move |i| (x, y, i)))
    {
        let (weight, v) = sample(x, y, index);
        film.add_sample(x, y, index, weight, &[v[0], v[1], v[2], 1.0, v[0], v[1], v[2], 0.0, 0.0, 0.0, v[3]]);
        for i in 0..index % 3 {
            let word = hash_words([u64::from(x), u64::from(y), u64::from(index), u64::from(i), 7]) as u32;
            film.add_splat(word % (SIZE[0] + 5), (word >> 8) % (SIZE[1] + 3), weight, [v[4], v[5], v[6]], i);
        }
    }
    film.mark_held(rect, range.start, range.end).unwrap();
}

#[test]
fn splats_are_exact_in_any_order_and_through_files() {
    let mut expected = Film::new(splatting_spec()).unwrap();
    let rect = expected.rect();
    render_splats(&mut expected, rect, 0..SPP);
    assert!(matches!(&expected.splats, Splats::Sums(s) if s.sums.iter().any(|&v| v != 0)));
    for round in 0..10 {
        let mut random = Random(round * 1000);
        let mut films = [0; 2].map(|_| Film::new(splatting_spec()).unwrap());
        for range in random.cuts(SPP) {
            let mut rows: Vec<u32> = (rect.y0..rect.y1).collect();
            random.shuffle(&mut rows);
            let target = random.below(2);
            let mut tile = films[target].new_tile(Rect { y1: rect.y0 + 1, ..rect }).unwrap();
            for y in rows {
                assert!(tile.empty_for(Rect { y0: y, y1: y + 1, ..rect }));
                let tile_rect = tile.rect();
                render_splats(&mut tile, tile_rect, range.clone());
                // A tile goes through a file as well.
                let tile = if y % 4 == 0 { Film::from_bytes(&bytes_of(&tile), 1 << 30).unwrap() } else { tile.clone() };
                films[target].merge(&tile).unwrap();
            }
        }
        let [mut total, second] = films;
        let second = Film::from_bytes(&bytes_of(&second), 1 << 30).unwrap();
        total.merge(&second).unwrap();
        total.held = expected.held.clone();
        assert!(total == expected, "round {round} differs");
        assert_eq!(total.relative_error().to_bits(), expected.relative_error().to_bits());
    }
    let mut other = splatting_spec();
    other.splats = false;
    assert!(expected.merge(&Film::new(other).unwrap()).unwrap_err().to_string().contains("splats"));
    let bytes = bytes_of(&expected);
    assert_eq!(bytes[8], 2);
    for length in (0..bytes.len()).step_by(256).chain([bytes.len() - 1]) {
        assert!(matches!(Film::from_bytes(&bytes[..length], 1 << 30), Err(FilmFileError::Truncated(_))), "{length}");
    }
    assert!(matches!(Film::from_bytes(&bytes, 5000), Err(FilmFileError::TooLarge { .. })));
}

#[test]
fn splats_are_divided_by_the_samples_per_pixel() {
    // A crop of half of the picture: as many light paths fewer.
    let mut spec = FilmSpec { crop: Rect::new(0, 0, 2, 2), splats: true, ..FilmSpec::new(4, 2) };
    spec.channels.extend(["light.a.R", "light.a.G", "light.a.B", "light.b.R", "light.b.G", "light.b.B"].map(Channel::mean));
    let mut film = Film::new(spec).unwrap();
    for index in 0..8 {
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            film.add_sample(x, y, index, 1.0, &[0.25; 10]);
            film.add_splat(1, 1, 1.0, [if index % 2 == 0 { 0.5 } else { 0.0 }, 1.0, f32::NAN], 1);
            film.add_splat(3, 1, 1.0, [100.0; 3], 0);
        }
    }
    assert_eq!(film.counters().non_finite, 32);
    let image = film.develop_with(DevelopOptions { variance: true, sample_count: false });
    let at = |name: &str| image.channel(name).unwrap()[3];
    // 32 splats of 1 in 8 pixels' worth of samples, 4 for each.
    assert_eq!([at("R"), at("G"), at("B"), at("A"), at("light.a.G"), at("light.b.G")], [2.25, 8.25, 0.25, 0.25, 0.25, 8.25]);
    assert_eq!(at("variance.G"), 0.0);
    // 32 draws of 0 or 1/2, their sum times 1/4.
    let variance = 32.0 / 31.0 * (16.0 * 0.25 - 64.0 / 32.0) / 16.0;
    assert!((at("variance.R") - variance).abs() < 1e-6, "{} {variance}", at("variance.R"));
    assert!(film.relative_error().is_finite());
}

/// Parts that were cut one way for the first samples and another way for later ones.
#[test]
fn declared_samples_are_those_of_the_pixel_with_most() {
    let mut film = Film::new(spec()).unwrap();
    let Rect { x0, y0, x1, y1 } = film.rect();
    let (x, y) = (x0.midpoint(x1), y0.midpoint(y1));
    assert_eq!(film.declared_spp(), 0);
    for (rect, begin, end, most) in [
        (Rect::new(x0, y0, x, y1), 0, 16, 16),
        (Rect::new(x, y0, x1, y1), 0, 16, 16),
        (Rect::new(x0, y, x1, y1), 16, 23, 23),
        (Rect::new(x0, y0, x1, y), 16, 32, 32),
        (Rect::new(x0, y, x1, y1), 23, 32, 32),
    ] {
        film.mark_held(rect, begin, end).unwrap();
        assert_eq!(film.declared_spp(), most, "{rect}");
    }
}
