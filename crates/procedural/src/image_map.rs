//! Pictures wrapped around objects (documentation, "Image Map" and "Bitmap Modifiers").

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::pattern::gray;
use crate::{Color, Context, ImageId, Images, fns};

/// A picture with the way it is mapped.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageMap {
    /// The picture.
    pub image: ImageId,
    /// How space maps to the picture.
    pub projection: Projection,
    /// The picture is there only once; elsewhere is nothing.
    pub once: bool,
    /// How values between pixels come about.
    pub interpolation: Interpolation,
    /// What of a pixel is a height or a pattern value.
    pub channel: Channel,
    /// Added transparency.
    pub transparency: Transparency,
}

impl ImageMap {
    /// A picture in the unit square of the x-y plane, without interpolation.
    pub fn new(image: ImageId) -> Self {
        Self {
            image,
            projection: Projection::Planar,
            once: false,
            interpolation: Interpolation::None,
            channel: Channel::Gray,
            transparency: Transparency::default(),
        }
    }
}

/// `map_type`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Projection {
    /// 0: the unit square of the x-y plane.
    #[default]
    Planar,
    /// 1: longitude and latitude.
    Spherical,
    /// 2: longitude, and y from 0 to 1.
    Cylindrical,
    /// 5: a torus of major radius 1 around the y axis.
    Toroidal,
    /// 7: direction of the point as on a light probe, a mirror ball seen from −z.
    Angular,
}

/// `interpolate`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Interpolation {
    /// 0: the nearest pixel.
    #[default]
    None,
    /// 2: bilinear.
    Bilinear,
    /// 3: bicubic.
    Bicubic,
    /// 4: by normalized distance.
    NormalizedDistance,
}

/// What of a pixel is a number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Channel {
    /// Gray value (`use_color`).
    #[default]
    Gray,
    /// Palette index (`use_index`).
    Index,
    /// Transparency, 1 − alpha (`use_alpha`).
    Alpha,
}

/// `filter` and `transmit` of an image map.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Transparency {
    /// `filter all`.
    pub filter_all: Option<f64>,
    /// `transmit all`.
    pub transmit_all: Option<f64>,
    /// `filter` of palette indices, sorted.
    pub filter: Vec<(u32, f64)>,
    /// `transmit` of palette indices, sorted.
    pub transmit: Vec<(u32, f64)>,
}

impl ImageMap {
    /// The color at the context's point; `None` where there is no picture (outside of `once`).
    pub fn color(&self, context: &Context) -> Option<Color> {
        let view = View::new(self, context)?;
        let at = view.place(context.p)?;
        let channels = view.interpolate(at, |x, y| {
            let c = view.color(x, y);
            [c.rgb.x, c.rgb.y, c.rgb.z, c.filter, c.transmit]
        });
        let [r, g, b, filter, transmit] = channels;
        Some(Color { filter, transmit, ..Color::rgb(r, g, b) })
    }

    /// The number (gray value, index of 255, or transparency) at the context's point; `None` where there is no picture.
    pub fn value(&self, context: &Context) -> Option<f64> {
        let view = View::new(self, context)?;
        let at = view.place(context.p)?;
        Some(view.height(at))
    }

    /// Index of a `material_map`: the palette index, else the red value of 255; 0 where there is no picture.
    pub fn material(&self, context: &Context) -> u32 {
        let Some(view) = View::new(self, context) else { return 0 };
        let Some(at) = view.place(context.p) else { return 0 };
        let [index] = view.interpolate(at, |x, y| {
            let index = view.images.index(self.image, x, y).map(f64::from);
            [index.unwrap_or_else(|| view.images.pixel(self.image, x, y).rgb.x * 255.0)]
        });
        // Rounding errors of colors must not make another index.
        (index + 0.5).clamp(0.0, 65_535.0) as u32
    }

    /// Slopes of the picture's heights at the context's point, per pixel, to the right and upwards; `None` where there is no picture.
    /// Measured: the plane through this pixel and its two lower diagonal neighbors.
    pub(crate) fn slopes(&self, context: &Context) -> Option<DVec2> {
        let view = View::new(self, context)?;
        let at = view.place(context.p)?;
        let here = view.height(at);
        let left = view.height(at + DVec2::new(-1.0, -1.0)) - here;
        let right = view.height(at + DVec2::new(1.0, -1.0)) - here;
        Some(DVec2::new((right - left) * 0.5, -(left + right) * 0.5))
    }
}

/// A picture that is there.
struct View<'a> {
    map: &'a ImageMap,
    images: &'a dyn Images,
    size: [u32; 2],
}

impl<'a> View<'a> {
    fn new(map: &'a ImageMap, context: &Context<'a>) -> Option<Self> {
        let images = context.images?;
        let size = images.size(map.image)?;
        if size.contains(&0) {
            return None;
        }
        Some(Self { map, images, size })
    }

    /// Place in the picture in pixels, x to the right and y upwards from the lower left corner, for a point.
    fn place(&self, p: DVec3) -> Option<DVec2> {
        let uv = match self.map.projection {
            Projection::Planar => DVec2::new(p.x, p.y),
            Projection::Spherical => {
                let length = p.length();
                let latitude = if length > 0.0 { fns::asin((p.y / length).clamp(-1.0, 1.0)) / std::f64::consts::PI } else { 0.0 };
                DVec2::new(turn(p.z, p.x), 0.5 + latitude)
            }
            Projection::Cylindrical => DVec2::new(turn(p.z, p.x), p.y),
            Projection::Toroidal => {
                let out = (p.x * p.x + p.z * p.z).sqrt() - 1.0;
                DVec2::new(turn(p.z, p.x), 0.5 + fns::atan2(p.y, out) / std::f64::consts::TAU)
            }
            Projection::Angular => {
                let direction = p.normalize_or_zero();
                let across = (direction.x * direction.x + direction.y * direction.y).sqrt();
                let radius = if across > 0.0 { fns::acos(direction.z.clamp(-1.0, 1.0)) / std::f64::consts::TAU / across } else { 0.0 };
                DVec2::new(0.5 + direction.x * radius, 0.5 + direction.y * radius)
            }
        };
        if !uv.is_finite() {
            return None;
        }
        let outside = |v: f64| !(0.0..1.0).contains(&v);
        if self.map.once {
            let gone = match self.map.projection {
                Projection::Planar => outside(uv.x) || outside(uv.y),
                Projection::Cylindrical => outside(uv.y),
                Projection::Spherical | Projection::Toroidal | Projection::Angular => false,
            };
            if gone {
                return None;
            }
        }
        let inside = uv - uv.floor();
        Some(DVec2::new(inside.x * f64::from(self.size[0]), inside.y * f64::from(self.size[1])))
    }

    fn color(&self, x: u32, y: u32) -> Color {
        let mut c = self.images.pixel(self.map.image, x, y);
        let t = &self.map.transparency;
        let plain = t.filter_all.is_none() && t.transmit_all.is_none() && t.filter.is_empty() && t.transmit.is_empty();
        if plain {
            return c;
        }
        c.filter = t.filter_all.unwrap_or(c.filter);
        c.transmit = t.transmit_all.unwrap_or(c.transmit);
        if let Some(index) = self.images.index(self.map.image, x, y) {
            let of = |list: &[(u32, f64)]| list.binary_search_by_key(&index, |e| e.0).ok().and_then(|i| list.get(i)).map(|e| e.1);
            c.filter = of(&t.filter).unwrap_or(c.filter);
            c.transmit = of(&t.transmit).unwrap_or(c.transmit);
        }
        c
    }

    /// The pixel's number.
    fn pixel_value(&self, x: u32, y: u32) -> f64 {
        let id = self.map.image;
        let c = self.images.pixel(id, x, y);
        // Measured with PNG: gray 128 and alpha 64 give 0.50196, and 0.74902 with `use_alpha`.
        match self.map.channel {
            Channel::Gray => gray(&c),
            Channel::Index => self.images.index(id, x, y).map_or_else(|| gray(&c), |i| f64::from(i) / 255.0),
            Channel::Alpha => c.transmit,
        }
    }

    fn height(&self, at: DVec2) -> f64 {
        let [value] = self.interpolate(at, |x, y| [self.pixel_value(x, y)]);
        value
    }

    /// Blends pixels (`interpolate`; which pixels and weights is measured: centers at halves, Catmull–Rom for bicubic, inverse squares
    /// of distances to four neighbors for normalized distance). Pictures repeat at their edges.
    fn interpolate<const N: usize>(&self, at: DVec2, pixel: impl Fn(u32, u32) -> [f64; N]) -> [f64; N] {
        let wrap = |v: f64, n: u32| (v.rem_euclid(f64::from(n)) as u32).min(n - 1);
        let fetch = |x: f64, y: f64| pixel(wrap(x, self.size[0]), self.size[1] - 1 - wrap(y, self.size[1]));
        if self.map.interpolation == Interpolation::None {
            return fetch(at.x.floor(), at.y.floor());
        }
        let corner = (at - DVec2::splat(0.5)).floor();
        let f = at - DVec2::splat(0.5) - corner;
        let mut sum = [0.0; N];
        let mut add = |weight: f64, color: [f64; N]| sum.iter_mut().zip(color).for_each(|(s, c)| *s += weight * c);
        match self.map.interpolation {
            Interpolation::Bicubic => {
                let (wx, wy) = (catmull_rom(f.x), catmull_rom(f.y));
                for (j, wy) in wy.iter().enumerate() {
                    for (i, wx) in wx.iter().enumerate() {
                        add(wx * wy, fetch(corner.x + i as f64 - 1.0, corner.y + j as f64 - 1.0));
                    }
                }
            }
            Interpolation::NormalizedDistance => {
                let steps = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
                let weights = steps.map(|(x, y)| 1.0 / (f - DVec2::new(x, y)).length_squared().max(1e-12));
                let total: f64 = weights.iter().sum();
                for ((x, y), weight) in steps.into_iter().zip(weights) {
                    add(weight / total, fetch(corner.x + x, corner.y + y));
                }
            }
            Interpolation::None | Interpolation::Bilinear => {
                add((1.0 - f.x) * (1.0 - f.y), fetch(corner.x, corner.y));
                add(f.x * (1.0 - f.y), fetch(corner.x + 1.0, corner.y));
                add((1.0 - f.x) * f.y, fetch(corner.x, corner.y + 1.0));
                add(f.x * f.y, fetch(corner.x + 1.0, corner.y + 1.0));
            }
        }
        sum
    }
}

/// Angle in turns, [0, 1).
fn turn(y: f64, x: f64) -> f64 {
    let turn = fns::atan2(y, x) / std::f64::consts::TAU;
    if turn < 0.0 { turn + 1.0 } else { turn }
}

/// Weights of the cubic convolution with a = −1/2 (Keys 1981, "Cubic convolution interpolation for digital image processing", eq. 15).
pub(crate) fn catmull_rom(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (-t3 + 2.0 * t2 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (-3.0 * t3 + 4.0 * t2 + t), 0.5 * (t3 - t2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The picture of the measurements: 4 × 3 pixels.
    struct Picture;

    impl Images for Picture {
        fn size(&self, _: ImageId) -> Option<[u32; 2]> {
            Some([4, 3])
        }
        fn pixel(&self, _: ImageId, x: u32, y: u32) -> Color {
            let i = y * 4 + x;
            let byte = |a: u32, b: u32| f64::from((i * a + b) % 256) / 255.0;
            Color::rgb(byte(53, 17), byte(91, 40), byte(29, 5))
        }
        fn index(&self, _: ImageId, _: u32, _: u32) -> Option<u32> {
            None
        }
    }

    fn at(map: &ImageMap, x: f64, y: f64, z: f64) -> Option<Color> {
        map.color(&Context { images: Some(&Picture), ..Context::at(DVec3::new(x, y, z)) })
    }

    /// Red values of `image_map { ppm … }` along a line, by POV-Ray.
    #[test]
    fn interpolation_is_as_measured() {
        let cases = [
            (Interpolation::None, [0.898_04, 0.101_96, 0.309_80, 0.517_65]),
            (Interpolation::Bilinear, [0.694_27, 0.549_14, 0.295_34, 0.403_61]),
            (Interpolation::Bicubic, [0.806_91, 0.583_16, 0.228_57, 0.357_74]),
            (Interpolation::NormalizedDistance, [0.701_15, 0.524_78, 0.310_49, 0.413_60]),
        ];
        for (interpolation, expected) in cases {
            let map = ImageMap { interpolation, ..ImageMap::new(0) };
            for (x, e) in [0.0251, 0.2751, 0.5251, 0.8001].into_iter().zip(expected) {
                let got = at(&map, x, 0.4, 0.0).unwrap().rgb.x;
                assert!((got - e).abs() < 1e-5, "{interpolation:?} at {x}: {got}, measured {e}");
            }
        }
    }

    #[test]
    fn once_has_nothing_around() {
        let map = ImageMap { once: true, ..ImageMap::new(0) };
        assert!(at(&map, -0.1, 0.3, 0.0).is_none() && at(&map, 0.2, 1.2, 0.0).is_none() && at(&map, 0.2, 0.3, 5.0).is_some());
    }

    #[test]
    fn hostile_points_and_pictures() {
        for projection in [Projection::Planar, Projection::Spherical, Projection::Cylindrical, Projection::Toroidal, Projection::Angular] {
            for v in [0.0, f64::NAN, f64::INFINITY, 1e300, -1e-300] {
                let map = ImageMap { projection, interpolation: Interpolation::Bicubic, ..ImageMap::new(0) };
                let _ = at(&map, v, v, -v);
                let _ = map.slopes(&Context { images: Some(&Picture), ..Context::at(DVec3::splat(v)) });
            }
        }
    }
}
