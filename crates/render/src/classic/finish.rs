//! Local answers of a finish: diffuse, highlights, reflectance. Pure functions of angles and colors.

use etendue_procedural::noise::{Turbulence, turbulence};
use etendue_procedural::{Color, Finish, Irid, Reflection, fns};
use glam::DVec3;

use std::f64::consts::{FRAC_PI_2, TAU};

/// Share of a layer that scatters light, from its color: 1 − filter − transmit; in scenes before version 3.7, what the color that
/// passes most leaves (both measured).
pub(super) fn opacity(c: &Color, version: u32) -> f64 {
    let rest = if version < 370 { 1.0 - c.filter * c.rgb.max_element() - c.transmit } else { c.opacity() };
    rest.max(0.0)
}

/// A film as thick as its turbulence makes it at a point (world space): d · (1 + T (2 t − 1)) with five octaves of turbulence t (measured).
pub(super) fn stirred(film: Irid, p: DVec3, generator: u8) -> Irid {
    if film.turbulence == 0.0 {
        return film;
    }
    let t = turbulence(p, &Turbulence { octaves: 5, ..Turbulence::default() }, generator);
    Irid { thickness: film.thickness * (1.0 + film.turbulence * (2.0 * t - 1.0)), ..film }
}

/// Factor of the light that a surface with a thin film scatters and shines: 1 + a cos(2π d (cos light + cos view) / λ), measured to four
/// digits; `wavelengths` of red, green and blue in the unit of the thickness.
pub(super) fn iridescence(film: &Irid, light: f64, view: f64, wavelengths: DVec3) -> DVec3 {
    let way = TAU * film.thickness * (light.abs() + view.abs());
    let wave = |length: f64| if length == 0.0 { 1.0 } else { 1.0 + film.amount * fns::cos(way / length) };
    DVec3::new(wave(wavelengths.x), wave(wavelengths.y), wave(wavelengths.z))
}

/// Share of light from a direction with cosine `cos` > 0 to the normal that the diffuse term returns.
///
/// `diffuse · cos^brilliance`; with `albedo` the amount is the total reflectance, of which the peak is (brilliance + 1) / 2 (measured).
pub(super) fn diffuse(finish: &Finish, amount: f64, cos: f64) -> f64 {
    let cosine = if finish.brilliance == 1.0 { cos } else { fns::pow_about(cos, finish.brilliance) };
    let peak = if finish.diffuse_albedo { 0.5 * (finish.brilliance + 1.0) } else { 1.0 };
    amount * peak * cosine
}

/// The highlights' factor of a light's color: Phong's and Blinn's.
///
/// `light` and `view` are unit, away from the surface. With `albedo`, peaks follow from total reflectance by (n + 1) / 2 for Phong and
/// (n + 2) / (4 (2 − 2^(−n/2))) for Blinn (both measured to four digits).
pub(super) fn highlights(finish: &Finish, n: DVec3, light: DVec3, view: DVec3) -> f64 {
    let mut sum = 0.0;
    if finish.phong != 0.0 {
        let cos = (n * (2.0 * n.dot(view)) - view).dot(light);
        if cos > 0.0 {
            let peak = if finish.phong_albedo { 0.5 * (finish.phong_size + 1.0) } else { 1.0 };
            sum += finish.phong * peak * narrow(cos, finish.phong_size);
        }
    }
    if finish.specular != 0.0 {
        let half = light + view;
        let length = half.length();
        let cos = n.dot(half) / length;
        if length > 1e-12 && cos > 0.0 {
            let e = 1.0 / finish.roughness;
            let peak = if finish.specular_albedo { (e + 2.0) / (4.0 * (2.0 - fns::exp2(-0.5 * e))) } else { 1.0 };
            sum += finish.specular * peak * narrow(cos, e);
        }
    }
    sum
}

/// cos^e for 0 < cos ≤ 1, without the power where it is below 1e−7, as on most of a surface.
fn narrow(cos: f64, e: f64) -> f64 {
    // ln cos ≤ cos − 1.
    if e * (1.0 - cos) > 16.0 { 0.0 } else { fns::pow_about(cos, e) }
}

/// Color of metallic highlights and reflections: the pigment along the normal, white at grazing angles, by Strauss's approximation of
/// Fresnel's equations (1990, IEEE CG&A 10(6), eq. 12 with kf = 1.12), which measurements confirm to four digits.
pub(super) fn metallic(pigment: DVec3, amount: f64, cos: f64) -> DVec3 {
    if amount == 0.0 {
        return DVec3::ONE;
    }
    let x = fns::acos(cos.clamp(0.0, 1.0)) / FRAC_PI_2;
    let term = |d: f64| 1.0 / (d * d);
    let f = (term(x - 1.12) - term(1.12)) / (term(1.0 - 1.12) - term(1.12));
    DVec3::ONE + (pigment - DVec3::ONE) * (amount * (1.0 - f))
}

/// Unpolarized reflectance of a dielectric from Fresnel's equations; `ior` is the ratio of the index beyond to the index here.
pub(super) fn fresnel(cos: f64, ior: f64) -> f64 {
    let cos = cos.clamp(0.0, 1.0);
    let sin2 = (1.0 - cos * cos) / (ior * ior);
    if !(sin2 < 1.0) {
        return 1.0;
    }
    let t = (1.0 - sin2).sqrt();
    let s = (cos - ior * t) / (cos + ior * t);
    let p = (t - ior * cos) / (t + ior * cos);
    0.5 * (s * s + p * p)
}

/// Reflectance of a mirror: min + (max − min) · (1 − cos)^falloff, or with Fresnel's reflectance in place of the power.
pub(super) fn reflectance(r: &Reflection, cos: f64, ior: f64, pigment: DVec3) -> DVec3 {
    if r.max == DVec3::ZERO && r.min == DVec3::ZERO {
        return DVec3::ZERO;
    }
    let share = if r.fresnel {
        fresnel(cos, ior)
    } else if r.min == r.max {
        1.0
    } else {
        fns::pow_about((1.0 - cos).clamp(0.0, 1.0), r.falloff)
    };
    (r.min + (r.max - r.min) * share) * metallic(pigment, r.metallic, cos)
}

/// What a mirror makes of the light it reflects: `exponent` is the exponent's inverse (measured).
pub(super) fn reflected(r: &Reflection, color: DVec3) -> DVec3 {
    if r.exponent == 1.0 || !(r.exponent > 0.0) {
        return color;
    }
    let e = 1.0 / r.exponent;
    let power = |v: f64| fns::pow(v.max(0.0), e);
    DVec3::new(power(color.x), power(color.y), power(color.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pictures of POV-Ray 3.7.0.10 of one pixel with 16 bits, see the module's head: what is compared here was read from them.
    fn near(a: f64, b: f64) {
        assert!((a - b).abs() < 3e-4 * b.abs().max(0.05), "{a} is not {b}");
    }

    fn lit(degrees: f64) -> (DVec3, f64) {
        let (sin, cos) = fns::sin_cos(degrees.to_radians());
        (DVec3::new(sin, 0.0, cos), cos)
    }

    #[test]
    fn diffuse_and_brilliance() {
        let (_, cos) = lit(60.0);
        near(diffuse(&Finish { diffuse: 0.6, ..Finish::default() }, 0.6, cos) * 0.9, 0.27);
        let finish = Finish { brilliance: 3.0, ..Finish::default() };
        near(diffuse(&finish, 1.0, cos), 0.125);
        let finish = Finish { diffuse_albedo: true, brilliance: 0.5, ..Finish::default() };
        near(diffuse(&finish, 1.0, cos), 0.53033);
    }

    #[test]
    fn phong_and_blinn_peaks() {
        let at = |finish: &Finish, degrees| highlights(finish, DVec3::Z, lit(degrees).0, DVec3::Z);
        let phong = Finish { phong: 0.8, phong_size: 40.0, ..Finish::default() };
        near(at(&phong, 10.0), 0.43366);
        near(at(&phong, 20.0), 0.06645);
        let blinn = Finish { specular: 0.8, roughness: 0.05, ..Finish::default() };
        near(at(&blinn, 10.0), 0.74127);
        near(at(&blinn, 40.0), 0.23056);
        let total = Finish { phong: 0.02, phong_albedo: true, phong_size: 20.0, ..Finish::default() };
        near(at(&total, 10.0) / (0.02 * fns::pow(lit(10.0).1, 20.0)), 10.50039);
        for (n, factor) in [(5.0, 0.9596), (10.0, 1.52417), (80.0, 10.25004)] {
            let total = Finish { specular: 0.02, specular_albedo: true, roughness: 1.0 / n, ..Finish::default() };
            near(at(&total, 10.0) / (0.02 * fns::pow(lit(5.0).1, n)), factor);
        }
    }

    #[test]
    fn old_scenes_hide_by_what_passes() {
        let c = |r: f64, filter: f64, transmit: f64| Color { filter, transmit, ..Color::rgb(r, 0.4, 0.3) };
        for (color, new, old) in [
            (c(0.5, 0.5, 0.0), 0.5, 0.75),
            (c(0.5, 0.8, 0.0), 0.2, 0.6),
            (c(0.9, 0.5, 0.0), 0.5, 0.55),
            (c(0.5, 0.0, 0.5), 0.5, 0.5),
            (c(0.5, 0.5, 0.2), 0.3, 0.55),
            (c(2.0, 0.4, 0.0), 0.6, 0.2),
            (c(2.0, 0.5, 0.0), 0.5, 0.0),
            (c(0.5, 1.5, 0.0), 0.0, 0.25),
        ] {
            near(opacity(&color, 370), new);
            near(opacity(&color, 360), old);
        }
    }

    #[test]
    fn films_as_measured() {
        let wavelengths = DVec3::new(0.70, 0.52, 0.48);
        let film = |thickness| Irid { amount: 0.25, thickness, turbulence: 0.0 };
        let cos = |degrees: f64| lit(degrees).1;
        // 0.8, 0.6 and 0.4 times the diffuse 0.5 and the cosine are what a surface without film shows.
        for (thickness, light, view, red, green) in
            [(0.3, 30.0, 0.0, 0.373_022, 0.317_388), (0.3, 30.0, 60.0, 0.271_992, 0.275_212), (0.5, 0.0, 0.0, 0.309_911, 0.366_415)]
        {
            let factor = iridescence(&film(thickness), cos(light), cos(view), wavelengths);
            near(0.4 * cos(light) * factor.x, red);
            near(0.3 * cos(light) * factor.y, green);
        }
        // Thickness with turbulence 1 over that without at (x, 0.5, 0), generator 2.
        for (x, ratio) in [(-3.5, 2.0851), (-1.5, 1.7587), (-0.5, 1.1593), (2.5, 1.9610), (3.5, 2.3034)] {
            let film = Irid { amount: 1.0, thickness: 0.5, turbulence: 1.0 };
            near(stirred(film, DVec3::new(x, 0.5, 0.0), 2).thickness / 0.5, ratio);
        }
    }

    #[test]
    fn metals_and_mirrors() {
        let pigment = DVec3::new(0.9, 0.5, 0.2);
        for (degrees, amount, green) in [(0.0, 1.0, 0.5), (20.0, 1.0, 0.50323), (60.0, 1.0, 0.52964), (60.0, 0.5, 0.76481)] {
            near(metallic(pigment, amount, lit(degrees).1).y, green);
        }
        let mirror =
            |falloff, fresnel| Reflection { min: DVec3::splat(0.1), max: DVec3::splat(0.7), falloff, fresnel, ..Reflection::default() };
        for (degrees, linear, cubic, dielectric) in [(0.0, 0.1, 0.1, 0.124), (60.0, 0.4, 0.175, 0.15351), (80.0, 0.5958, 0.43857, 0.33262)]
        {
            let (_, cos) = lit(degrees);
            near(reflectance(&mirror(1.0, false), cos, 1.5, pigment).x, linear);
            near(reflectance(&mirror(3.0, false), cos, 1.5, pigment).x, cubic);
            near(reflectance(&mirror(1.0, true), cos, 1.5, pigment).x, dielectric);
        }
        assert_eq!(fresnel(0.1, 1.0 / 1.5), 1.0, "total reflection");
        let bent = Reflection { exponent: 0.5, ..Reflection::default() };
        near(0.6 * reflected(&bent, DVec3::splat(0.5)).x, 0.15);
    }
}
