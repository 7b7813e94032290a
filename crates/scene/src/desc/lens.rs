//! Objectives: systems of spherical lenses.

use serde::{Deserialize, Serialize};

use super::ImageId;

/// Most interfaces of an objective.
pub const MOST_INTERFACES: usize = 256;

/// A spherical surface of an objective, or its stop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LensInterface {
    /// Signed radius of curvature in scene units, positive where the center lies towards the film; 0 is flat, as the stop is.
    pub curvature_radius: f32,
    /// Distance along the axis to the next interface, or of the last one to the film when the objective is not focused.
    pub thickness: f32,
    /// Refractive index between this interface and the next; 1 is air.
    pub ior: f32,
    /// Radius of the opening that lets light through.
    pub aperture_radius: f32,
}

/// What the stop of an objective lets through. All shapes let through as much light as the circle of the stop's radius.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum StopShape {
    /// The circle of its radius.
    #[default]
    Circle,
    /// The same circle, brighter in the middle: exp(−r²/R²) − 1/e.
    Gaussian,
    /// A square whose edge is the radius.
    Square,
    /// A regular pentagon, one corner below, of 0.8 of the radius.
    Pentagon,
    /// A star of five points, one to the left, of the radius.
    Star,
    /// As bright as a picture, which fills the square around the circle.
    Picture(ImageId),
}

/// An objective as its maker describes it (Kolb, Mitchell, Hanrahan 1995, "A Realistic Camera Model for Computer Graphics",
/// doi:10.1145/218380.218463).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ObjectiveDesc {
    /// From the front to the film.
    pub interfaces: Vec<LensInterface>,
    /// Diagonal of the film, in scene units.
    pub film_diagonal: f32,
    /// Distance of the film from the plane that is in focus.
    pub focus_distance: f32,
    /// What the flat interfaces let through.
    #[serde(default, skip_serializing_if = "is_circle")]
    pub stop: StopShape,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
fn is_circle(stop: &StopShape) -> bool {
    *stop == StopShape::Circle
}

/// The thick lens that an objective is near its axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThickLens {
    /// Focal length.
    pub focal_length: f64,
    /// Distances of the principal planes from the last interface, towards the front: of the object's side, of the film's.
    pub principal: [f64; 2],
}

/// Where parallel light that enters at height 1 along the axis leaves: its height and slope after the last interface.
fn trace_parallel(surfaces: impl Iterator<Item = (f64, f64, f64, f64)>) -> [f64; 2] {
    let (mut y, mut slope) = (1.0, 0.0);
    for (curvature, before, after, distance) in surfaces {
        slope = (before * slope - y * curvature * (after - before)) / after;
        y += slope * distance;
    }
    [y, slope]
}

impl ObjectiveDesc {
    /// What the objective is for rays near the axis; `None` where it has no focal length, or one that is not positive.
    pub fn thick_lens(&self) -> Option<ThickLens> {
        let n = self.interfaces.len();
        let curvature = |i: usize| {
            let r = f64::from(self.interfaces[i].curvature_radius);
            if r == 0.0 { 0.0 } else { 1.0 / r }
        };
        let ior = |i: usize| f64::from(self.interfaces[i].ior);
        let gap = |i: usize| f64::from(self.interfaces[i].thickness);
        let from_front = trace_parallel((0..n).map(|i| {
            let (before, after) = (if i == 0 { 1.0 } else { ior(i - 1) }, if i + 1 == n { 1.0 } else { ior(i) });
            (curvature(i), before, after, if i + 1 == n { 0.0 } else { gap(i) })
        }));
        let from_film = trace_parallel((0..n).rev().map(|i| {
            let (before, after) = (if i + 1 == n { 1.0 } else { ior(i) }, if i == 0 { 1.0 } else { ior(i - 1) });
            (-curvature(i), before, after, if i == 0 { 0.0 } else { gap(i - 1) })
        }));
        let focal_length = -1.0 / from_front[1];
        let length: f64 = (0..n.saturating_sub(1)).map(gap).sum();
        // Focal points lie at y / −slope beyond the last surface, principal planes a focal length before them.
        let beyond = |[y, slope]: [f64; 2]| -y / slope;
        let principal = [length + beyond(from_film) - focal_length, focal_length - beyond(from_front)];
        let known = focal_length > 0.0 && focal_length.is_finite() && principal.iter().all(|v| v.is_finite());
        known.then_some(ThickLens { focal_length, principal })
    }

    /// Distance of the last interface from the film at which the plane of focus is sharp near the axis.
    ///
    /// # Errors
    /// A sentence where the objective cannot do that.
    pub fn film_distance(&self) -> Result<f64, String> {
        let valid = |i: &LensInterface| {
            let finite = [i.curvature_radius, i.thickness, i.ior, i.aperture_radius].iter().all(|v| v.is_finite());
            finite && i.thickness >= 0.0 && i.ior > 0.0 && i.aperture_radius > 0.0
        };
        if self.interfaces.is_empty() || self.interfaces.len() > MOST_INTERFACES {
            return Err(format!("an objective has 1 to {MOST_INTERFACES} interfaces, not {}", self.interfaces.len()));
        }
        if let Some(i) = self.interfaces.iter().position(|i| !valid(i)) {
            return Err(format!("interface {} of the objective: distances, indices and openings must be positive numbers", i + 1));
        }
        if !(self.film_diagonal > 0.0 && self.film_diagonal.is_finite() && self.focus_distance > 0.0 && self.focus_distance.is_finite()) {
            return Err("the film's diagonal and the distance in focus must be positive numbers".to_owned());
        }
        let Some(ThickLens { focal_length, principal }) = self.thick_lens() else {
            return Err("the objective does not gather light: it has no positive focal length".to_owned());
        };
        // With s and s' from the principal planes, 1/s + 1/s' = 1/f, and s + s' is what the planes leave of the distance to the film.
        let sum = f64::from(self.focus_distance) - (principal[0] - principal[1]);
        let square = sum * sum - 4.0 * focal_length * sum;
        if !(square >= 0.0 && sum > 0.0) {
            return Err(format!(
                "an objective of a focal length of {focal_length:.4} cannot focus at {}; at {:.4} or more it can",
                self.focus_distance,
                4.0 * focal_length + principal[0] - principal[1]
            ));
        }
        let distance = 0.5 * (sum - square.sqrt()) - principal[1];
        if distance > 0.0 { Ok(distance) } else { Err("the objective would touch the film to focus there".to_owned()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface(curvature_radius: f32, thickness: f32, ior: f32) -> LensInterface {
        LensInterface { curvature_radius, thickness, ior, aperture_radius: 0.01 }
    }

    fn objective(interfaces: Vec<LensInterface>, focus_distance: f32) -> ObjectiveDesc {
        ObjectiveDesc { interfaces, film_diagonal: 0.035, focus_distance, stop: StopShape::Circle }
    }

    /// The lensmaker's equation, and the principal planes of a thick lens that follow from it (Hecht, Optics, section 6.1).
    #[test]
    fn a_thick_lens_is_what_textbooks_say() {
        let (r1, r2, d, n) = (0.06, -0.04, 0.01, 1.5);
        let lens = objective(vec![surface(r1, d, n), surface(r2, 0.05, 1.0)], 2.0).thick_lens().unwrap();
        let [r1, r2, d, n] = [r1, r2, d, n].map(f64::from);
        let f = 1.0 / ((n - 1.0) * (1.0 / r1 - 1.0 / r2 + (n - 1.0) * d / (n * r1 * r2)));
        assert!((lens.focal_length / f - 1.0).abs() < 1e-6, "{} instead of {f}", lens.focal_length);
        let h1 = -f * (n - 1.0) * d / (r2 * n);
        let h2 = -f * (n - 1.0) * d / (r1 * n);
        assert!((lens.principal[0] - (d - h1)).abs() < 1e-6 && (lens.principal[1] + h2).abs() < 1e-6, "{lens:?}");
    }

    #[test]
    fn focus_is_where_the_lens_equation_says() {
        let mut o = objective(vec![surface(0.1, 0.0, 1.5), surface(-0.1, 0.1, 1.0)], 2.0);
        let f = o.thick_lens().unwrap().focal_length;
        assert!((f - 0.1).abs() < 1e-6);
        let s = o.film_distance().unwrap();
        assert!((1.0 / s + 1.0 / (2.0 - s) - 1.0 / f).abs() < 1e-6);
        o.focus_distance = 0.39;
        assert!(o.film_distance().unwrap_err().contains("cannot focus"));
        o.focus_distance = f32::NAN;
        assert!(o.film_distance().is_err());
        assert!(objective(Vec::new(), 2.0).film_distance().is_err());
        assert!(objective(vec![surface(-0.1, 0.0, 1.5), surface(0.1, 0.1, 1.0)], 2.0).film_distance().is_err());
    }
}
