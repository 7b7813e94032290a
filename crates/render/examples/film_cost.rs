//! What the exact film costs: time of a sample, of a merge and of a file, beside plain `f64` sums.
//! The figures in docs/decisions/0002-exact-film.md come from this program.

#![allow(clippy::print_stdout)]

use std::hint::black_box;
use std::time::Instant;

use etendue_render::film::{Channel, Film, FilmSpec, Rect};
use etendue_render::math::hash::{mix32, unit_float};

const SIZE: [u32; 2] = [1280, 720];
const TILE: u32 = 32;
const SPP: u32 = 4;

fn tiles() -> impl Iterator<Item = Rect> {
    let corners = (0..SIZE[1]).step_by(TILE as usize).flat_map(|y| (0..SIZE[0]).step_by(TILE as usize).map(move |x| (x, y)));
    corners.map(|(x, y)| Rect::new(x, y, (x + TILE).min(SIZE[0]), (y + TILE).min(SIZE[1])))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let aovs = ["albedo.R", "albedo.G", "albedo.B", "N.X", "N.Y", "N.Z", "Z", "P.X", "P.Y", "P.Z", "uv.U", "uv.V"];
    for extra in [0, aovs.len()] {
        let mut spec = FilmSpec::new(SIZE[0], SIZE[1]);
        spec.channels.extend(aovs[..extra].iter().map(|&n| Channel::mean(n)));
        let channels = spec.channels.len();
        let values: Vec<f32> = (0..4096 + channels as u32).map(|i| unit_float(mix32(i)) * 4.0).collect();
        let at = |x: u32, y: u32, i: u32| &values[((x * 7 + y * 13 + i * 31) % 4096) as usize..][..channels];
        let samples = f64::from(SIZE[0] * SIZE[1] * SPP);

        let mut film = Film::new(spec)?;
        let (mut adding, mut merging) = (0.0, 0.0);
        for rect in tiles() {
            let start = Instant::now();
            let mut tile = film.new_tile(rect)?;
            for (x, y) in (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).map(move |x| (x, y))) {
                for i in 0..SPP {
                    tile.add_sample(x, y, i, 1.0, at(x, y, i));
                }
            }
            tile.mark_held(rect, 0, SPP)?;
            adding += start.elapsed().as_secs_f64();
            let start = Instant::now();
            film.merge(&tile)?;
            merging += start.elapsed().as_secs_f64();
        }

        // The same sums in f64, which would depend on the order.
        let start = Instant::now();
        let mut sums = vec![0.0f64; (SIZE[0] * SIZE[1]) as usize * (channels + 5)];
        for (x, y) in (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y))) {
            let pixel = &mut sums[(y * SIZE[0] + x) as usize * (channels + 5)..][..channels + 5];
            for i in 0..SPP {
                let v = at(x, y, i);
                pixel.iter_mut().zip(v).for_each(|(s, v)| *s += f64::from(*v));
                let rgb = [0, 1, 2].map(|c| f64::from(v[c]));
                let luminance = 0.212_671 * rgb[0] + 0.715_16 * rgb[1] + 0.072_169 * rgb[2];
                for (s, v) in pixel[channels..].iter_mut().zip([rgb[0], rgb[1], rgb[2], luminance]) {
                    *s += v * v;
                }
                pixel[channels + 4] += 1.0;
            }
        }
        black_box(&sums);
        let plain = start.elapsed().as_secs_f64();

        let mut bytes = Vec::new();
        let start = Instant::now();
        film.write_to(&mut bytes)?;
        let writing = start.elapsed().as_secs_f64();
        let start = Instant::now();
        black_box(Film::from_bytes(&bytes, u64::MAX)?);
        let reading = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let error = film.relative_error();
        println!(
            "{channels} channels: {} bytes/pixel; sample {:.0} ns (f64 sums: {:.0} ns); merge {:.0} ns/pixel; \
             file {:.0} bytes/pixel, write {writing:.2} s, read {reading:.2} s; relative error {error:.4} in {:.1} ms",
            film.bytes_per_pixel(),
            adding / samples * 1e9,
            plain / samples * 1e9,
            merging / (samples / f64::from(SPP)) * 1e9,
            bytes.len() as f64 / (samples / f64::from(SPP)),
            start.elapsed().as_secs_f64() * 1e3,
        );
    }
    Ok(())
}
