//! Textures that fit the footprints of rays: less noise, the same mean.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use etendue_scene::desc::*;
use glam::{Mat3, Mat4, Vec2, Vec3};
use support::*;

/// A floor of fine stripes, far away and seen at a low angle, lit evenly; (mean, mean variance of a pixel) of the picture.
fn stripes(mipmap: bool, filter: TextureFilter) -> (f64, f64) {
    let mut desc = scene();
    let texels: Vec<f32> = (0..64 * 64).map(|i| if (i % 64) / 8 % 2 == 0 { 0.9 } else { 0.1 }).collect();
    let image = picture(&mut desc, 64, 64, 1, texels);
    let texture = add(
        &mut desc,
        TextureDesc::Bitmap(BitmapDesc {
            image,
            encoding: Encoding::Linear,
            wrap: [Wrap::Repeat; 2],
            filter,
            picture_from_uv: Mat3::from_scale(Vec2::splat(20.0)),
            channel: Channel::Luminance,
            uv_set: 0,
        }),
    );
    let floor = bsdf(&mut desc, BsdfDesc::Diffuse { reflectance: Param::Texture(texture), alpha: None });
    shape(&mut desc, GeometryDesc::Rectangle, Mat4::from_scale(Vec3::new(100.0, 100.0, 1.0)), Some(floor));
    constant_sky(&mut desc, 1.0);
    perspective(&mut desc, Vec3::new(0.0, -60.0, 8.0), Vec3::new(0.0, 20.0, 0.0), 20.0);
    let mut settings = settings(24, 16, 64);
    settings.mipmap = mipmap;
    settings.max_depth = Some(1);
    let film = render(&desc, &settings);
    let mean = film.develop().channel("G").unwrap().iter().map(|v| f64::from(*v)).sum::<f64>() / (24.0 * 16.0);
    (mean, film.variance().iter().sum::<f64>() / (24.0 * 16.0))
}

#[test]
fn pyramids_remove_aliasing_and_keep_the_mean() {
    let (plain_mean, plain_variance) = stripes(false, TextureFilter::Trilinear);
    let (mean, variance) = stripes(true, TextureFilter::Trilinear);
    assert!((mean / plain_mean - 1.0).abs() < 0.02, "{mean} {plain_mean}");
    assert!(variance < 0.3 * plain_variance, "{variance} {plain_variance}");
}

#[test]
fn bilinear_textures_take_no_notice() {
    assert_eq!(stripes(true, TextureFilter::Bilinear), stripes(false, TextureFilter::Bilinear));
}
