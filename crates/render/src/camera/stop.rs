//! What a stop lets through: a circle, or another shape or picture in the square around it. All let through as much as the circle of their radius:
//! what they are smaller, they are brighter, as in pbrt-v4.

use std::sync::Arc;

use etendue_scene::desc::StopShape;
use glam::DVec2;

use crate::image::Texels;
use crate::math::fns;

/// Size of the pentagon, of which corners have this distance from the axis, in radii.
const PENTAGON: f64 = 0.8;

/// The brightness of a picture of a stop, its mean over the square being that of a circle: π/4.
#[derive(Clone, Debug)]
pub struct StopPicture {
    width: usize,
    height: usize,
    /// From the upper row.
    values: Arc<[f32]>,
}

impl StopPicture {
    /// The mean of a picture's linear colors, in which negative and non-finite ones count as 0; `None` where it is black.
    pub fn new(texels: &Texels) -> Option<Self> {
        let pixels = (0..texels.height).flat_map(|y| (0..texels.width).map(move |x| (x, y)));
        let value = |v: f32| if v.is_finite() { f64::from(v.max(0.0)) } else { 0.0 };
        let values: Vec<f64> = pixels.map(|(x, y)| texels.get(x, y)[..3].iter().map(|v| value(*v)).sum::<f64>() / 3.0).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let scale = std::f64::consts::FRAC_PI_4 / mean;
        let usable = mean > 0.0 && mean.is_finite() && scale.is_finite();
        let values = values.into_iter().map(|v| (v * scale) as f32).collect();
        usable.then_some(Self { width: texels.width as usize, height: texels.height as usize, values })
    }

    /// Interpolated at a place in units of the radius, +y up; black beyond the picture.
    fn at(&self, q: DVec2) -> f64 {
        let p = DVec2::new(0.5 + 0.5 * q.x, 0.5 - 0.5 * q.y) * DVec2::new(self.width as f64, self.height as f64) - 0.5;
        let (corner, part) = (p.floor(), p - p.floor());
        let texel = |dx: f64, dy: f64| {
            let (x, y) = (corner.x + dx, corner.y + dy);
            let inside = x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64;
            if inside { f64::from(self.values[y as usize * self.width + x as usize]) } else { 0.0 }
        };
        let row = |dy: f64| texel(0.0, dy) * (1.0 - part.x) + texel(1.0, dy) * part.x;
        row(0.0) * (1.0 - part.y) + row(1.0) * part.y
    }
}

/// A stop. Places are in units of its radius.
#[derive(Clone, Debug)]
pub(super) enum Stop {
    Circle,
    Gaussian,
    /// Corners in turn, and what comes through.
    Polygon(Vec<DVec2>, f64),
    Picture(StopPicture),
}

impl Stop {
    /// The stop of a shape; a picture that is not given is a circle.
    pub fn new(shape: StopShape, picture: Option<StopPicture>) -> Self {
        let around = |i: usize, corners: usize, radius: f64, first: f64| {
            let angle = first + std::f64::consts::TAU * i as f64 / corners as f64;
            DVec2::new(libm::cos(angle), libm::sin(angle)) * radius
        };
        match shape {
            StopShape::Circle => Self::Circle,
            StopShape::Gaussian => Self::Gaussian,
            StopShape::Square => {
                Self::polygon([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(x, y)| DVec2::new(x, y)).to_vec())
            }
            // One corner below, as pbrt turns it.
            StopShape::Pentagon => Self::polygon((0..5).map(|i| around(i, 5, PENTAGON, -std::f64::consts::FRAC_PI_2)).collect()),
            StopShape::Star => {
                let inner = libm::cos(72f64.to_radians()) / libm::cos(36f64.to_radians());
                Self::polygon((0..10).map(|i| around(i, 10, if i % 2 == 1 { 1.0 } else { inner }, 0.0)).collect())
            }
            StopShape::Picture(_) => picture.map_or(Self::Circle, Self::Picture),
        }
    }

    fn polygon(corners: Vec<DVec2>) -> Self {
        let twice_area: f64 = (0..corners.len()).map(|i| corners[i].perp_dot(corners[(i + 1) % corners.len()])).sum();
        Self::Polygon(corners, std::f64::consts::TAU / twice_area)
    }

    /// Beyond this distance from the axis, in radii, nothing comes through.
    pub fn reach(&self) -> f64 {
        match self {
            Self::Circle | Self::Gaussian => 1.0,
            Self::Polygon(corners, _) => corners.iter().map(|c| c.length()).fold(0.0, f64::max),
            // Half of a texel is interpolated with the black around.
            Self::Picture(p) => std::f64::consts::SQRT_2 * (1.0 + 1.0 / p.width.min(p.height) as f64),
        }
    }

    /// How much comes through at a place, as a factor on radiance.
    pub fn weight(&self, q: DVec2) -> f64 {
        match self {
            Self::Circle => f64::from(u8::from(q.length_squared() <= 1.0)),
            Self::Gaussian => {
                let edge = libm::exp(-1.0);
                (f64::from(fns::exp(-q.length_squared() as f32)) - edge).max(0.0) / (1.0 - 2.0 * edge)
            }
            Self::Polygon(corners, weight) => {
                // The number of times that the edges go round the place.
                let turns: i32 = (0..corners.len())
                    .map(|i| {
                        let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
                        let left = (b - a).perp_dot(q - a) > 0.0;
                        match (a.y <= q.y, b.y <= q.y) {
                            (true, false) if left => 1,
                            (false, true) if !left => -1,
                            _ => 0,
                        }
                    })
                    .sum();
                if turns == 0 { 0.0 } else { *weight }
            }
            Self::Picture(p) => p.at(q),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{ColorEncoding, TexelData};
    use etendue_scene::desc::ImageId;

    fn picture(width: u32, height: u32, data: Vec<f32>) -> Texels {
        Texels { width, height, channels: 1, encoding: ColorEncoding::Linear, data: TexelData::F32(data) }
    }

    fn stops() -> Vec<(Stop, f64)> {
        let quarter = StopPicture::new(&picture(2, 2, vec![1.0, 0.0, 0.0, 0.0])).unwrap();
        let of = |shape| Stop::new(shape, None);
        // With the share of the square that they fill; texels are interpolated over two of their width.
        vec![
            (of(StopShape::Circle), std::f64::consts::FRAC_PI_4),
            (of(StopShape::Gaussian), std::f64::consts::FRAC_PI_4),
            (of(StopShape::Square), 0.25),
            (of(StopShape::Pentagon), 0.64 * 2.5 * libm::sin(72f64.to_radians()) / 4.0),
            (of(StopShape::Star), 0.280_7),
            (Stop::new(StopShape::Picture(ImageId(0)), Some(quarter)), 1.0),
        ]
    }

    #[test]
    fn all_shapes_let_through_what_the_circle_does() {
        for (stop, share) in stops() {
            let (mut sum, mut open) = (0.0, 0.0);
            let n = 1200;
            for i in 0..n * n {
                let q = (DVec2::new((i % n) as f64, (i / n) as f64) + 0.5) / f64::from(n) * 4.0 - 2.0;
                let w = stop.weight(q);
                sum += w * 16.0 / f64::from(n * n);
                open += f64::from(u8::from(w > 0.0)) * 4.0 / f64::from(n * n);
                assert!(w == 0.0 || q.length() <= stop.reach() + 1e-9, "{stop:?} at {q}");
            }
            assert!((sum / std::f64::consts::PI - 1.0).abs() < 5e-3, "{stop:?}: {sum}");
            assert!((open / share - 1.0).abs() < 0.01, "{stop:?}: {open} instead of {share}");
        }
    }

    #[test]
    fn shapes_stand_as_in_pbrt() {
        let at = |shape, x: f64, y: f64| Stop::new(shape, None).weight(DVec2::new(x, y)) > 0.0;
        assert!(at(StopShape::Pentagon, 0.0, -0.79) && !at(StopShape::Pentagon, 0.0, 0.79));
        assert!(at(StopShape::Star, -0.98, 0.0) && !at(StopShape::Star, 0.9, 0.0) && !at(StopShape::Star, 0.0, 0.9));
        // The upper row of a picture is above.
        let stop = Stop::Picture(StopPicture::new(&picture(1, 2, vec![1.0, 0.0])).unwrap());
        assert!(stop.weight(DVec2::new(0.0, 0.5)) > 0.0 && stop.weight(DVec2::new(0.0, -0.9)) == 0.0);
        assert!(StopPicture::new(&picture(2, 1, vec![0.0, f32::NAN])).is_none());
    }
}
