//! Pictures mapped over texture coordinates.

use std::sync::Arc;

use etendue_scene::desc::{Channel, TextureFilter, Wrap};
use glam::Mat3;

use crate::image::Texels;
use crate::math::fns::{self, lerp};
use crate::math::{Vec2, Vec3};
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// A picture with its mapping. Its first row is at v = 1.
#[derive(Clone, Debug)]
pub struct Bitmap {
    /// The picture.
    pub texels: Arc<Texels>,
    /// Smaller copies of it, each half as large as the one before; empty where footprints are not looked at.
    pub levels: Arc<[Texels]>,
    /// Beyond the edge in u and v.
    pub wrap: [Wrap; 2],
    /// Between texels; without `levels` trilinear look-ups take the full picture, whose samples average out over a pixel.
    pub filter: TextureFilter,
    /// Applied to (u, v, 1).
    pub picture_from_uv: Mat3,
    /// What a scalar look-up takes.
    pub channel: Channel,
    /// Interned name of the texture coordinates; `None` for the mesh's own.
    pub uv_attribute: Option<u32>,
}

/// Four texels and the place between them.
struct Quad {
    /// Lower left, lower right, upper left, upper right.
    texels: [[f32; 4]; 4],
    /// In [0, 1)².
    fraction: Vec2,
}

impl Bitmap {
    /// The linear color at a surface point.
    pub fn color(&self, scene: &Scene, s: &Surface) -> Spectrum {
        let [r, g, b, _] = self.lookup(scene, s);
        Spectrum::from_rgb([r, g, b])
    }

    /// The number at a surface point.
    pub fn scalar(&self, scene: &Scene, s: &Surface) -> f32 {
        self.pick(self.lookup(scene, s))
    }

    /// ∂(scalar)/∂(u, v) at a surface point.
    pub fn gradient(&self, scene: &Scene, s: &Surface) -> Vec2 {
        let q = quad(&self.texels, self.wrap, self.place(scene, s));
        let [a, b, c, d] = q.texels.map(|t| self.pick(t));
        let (fx, fy) = (q.fraction.x, q.fraction.y);
        // Per texel, then per unit of the picture, then per unit of uv.
        let du = ((b - a) * (1.0 - fy) + (d - c) * fy) * self.texels.width as f32;
        let dv = ((c - a) * (1.0 - fx) + (d - b) * fx) * self.texels.height as f32;
        let m = &self.picture_from_uv;
        Vec2::new(m.x_axis.x * du + m.x_axis.y * dv, m.y_axis.x * du + m.y_axis.y * dv)
    }

    /// The mean color of a grid of at most 64 × 64 texels.
    pub fn average(&self) -> Spectrum {
        let (w, h) = (self.texels.width, self.texels.height);
        let (nx, ny) = (w.min(64), h.min(64));
        let mut sum = Spectrum::ZERO;
        for j in 0..ny {
            for i in 0..nx {
                let at = |i: u32, n: u32, size: u32| ((u64::from(i) * 2 + 1) * u64::from(size) / (2 * u64::from(n))) as u32;
                let [r, g, b, _] = self.texels.get(at(i, nx, w), at(j, ny, h));
                sum += Spectrum::from_rgb([r, g, b]);
            }
        }
        sum / (nx * ny) as f32
    }

    fn pick(&self, [r, g, b, a]: [f32; 4]) -> f32 {
        match self.channel {
            Channel::Luminance if self.texels.channels <= 2 => r,
            Channel::Luminance => Spectrum::from_rgb([r, g, b]).luminance(),
            Channel::R => r,
            Channel::G => g,
            Channel::B => b,
            Channel::A => a,
        }
    }

    fn place(&self, scene: &Scene, s: &Surface) -> Vec2 {
        let uv = match self.uv_attribute {
            Some(name) => s.attribute(scene, name).map_or(Vec2::ZERO, |[u, v, ..]| Vec2::new(u, v)),
            None => s.uv,
        };
        (self.picture_from_uv * Vec3::new(uv.x, uv.y, 1.0)).truncate()
    }

    fn lookup(&self, scene: &Scene, s: &Surface) -> [f32; 4] {
        let at = self.place(scene, s);
        let (w, h) = (self.texels.width, self.texels.height);
        if self.filter == TextureFilter::Nearest {
            let (x, y) = (cell(at.x * w as f32), cell(at.y * h as f32));
            if !shown(self.wrap[0], x, w) || !shown(self.wrap[1], y, h) {
                return [0.0; 4];
            }
            return self.texels.get(wrap(self.wrap[0], x, w), h - 1 - wrap(self.wrap[1], y, h));
        }
        let level = if self.levels.is_empty() { 0.0 } else { self.level(s) };
        if level <= 0.0 {
            return quad(&self.texels, self.wrap, at).blend();
        }
        let lower = level as usize;
        let of = |i: usize| if i == 0 { &*self.texels } else { &self.levels[(i - 1).min(self.levels.len() - 1)] };
        let (a, b) = (quad(of(lower), self.wrap, at).blend(), quad(of(lower + 1), self.wrap, at).blend());
        std::array::from_fn(|i| lerp(level.fract(), a[i], b[i]))
    }

    /// The level whose texels are as large as the ray's footprint, 0 for the full picture or less (Akenine-Möller et al. 2019,
    /// "Texture Level of Detail Strategies for Real-Time Ray Tracing", Ray Tracing Gems ch. 20, equation 34).
    fn level(&self, s: &Surface) -> f32 {
        let world_area = s.dpdu.cross(s.dpdv).length();
        if !(s.footprint > 0.0 && world_area > 0.0) {
            return 0.0;
        }
        let m = &self.picture_from_uv;
        let uv_area = (m.x_axis.x * m.y_axis.y - m.x_axis.y * m.y_axis.x).abs();
        let texels = self.texels.width as f32 * self.texels.height as f32;
        let size = s.footprint * (texels * uv_area / world_area).sqrt();
        fns::log2(size.max(1.0)).min(self.levels.len() as f32)
    }
}

impl Quad {
    #[inline]
    fn blend(&self) -> [f32; 4] {
        let ([a, b, c, d], f) = (&self.texels, self.fraction);
        std::array::from_fn(|i| lerp(f.y, lerp(f.x, a[i], b[i]), lerp(f.x, c[i], d[i])))
    }
}

fn quad(texels: &Texels, wraps: [Wrap; 2], at: Vec2) -> Quad {
    let (w, h) = (texels.width, texels.height);
    let p = at * Vec2::new(w as f32, h as f32) - 0.5;
    let (x, y) = (cell(p.x), cell(p.y));
    let fraction = Vec2::new(p.x - p.x.floor(), p.y - p.y.floor());
    let xs = [x, x + 1].map(|x| wrap(wraps[0], x, w));
    // Rows count from the top, v from the bottom.
    let ys = [y, y + 1].map(|y| h - 1 - wrap(wraps[1], y, h));
    let inside = |i: usize, j: usize| shown(wraps[0], x + i as i64, w) && shown(wraps[1], y + j as i64, h);
    let get = |i: usize, j: usize| if inside(i, j) { texels.get(xs[i], ys[j]) } else { [0.0; 4] };
    Quad { texels: [get(0, 0), get(1, 0), get(0, 1), get(1, 1)], fraction }
}

/// The index of the texel at a coordinate; far-off and undefined coordinates stay in range.
fn cell(v: f32) -> i64 {
    v.floor().clamp(-1e15, 1e15) as i64
}

/// Whether there is a picture at an index.
#[inline]
fn shown(mode: Wrap, i: i64, n: u32) -> bool {
    mode != Wrap::Black || (0..i64::from(n)).contains(&i)
}

fn wrap(mode: Wrap, i: i64, n: u32) -> u32 {
    let n = i64::from(n);
    let wrapped = match mode {
        Wrap::Repeat => i.rem_euclid(n),
        Wrap::Mirror => {
            let m = i.rem_euclid(2 * n);
            if m < n { m } else { 2 * n - 1 - m }
        }
        Wrap::Clamp | Wrap::Black => i.clamp(0, n - 1),
    };
    wrapped as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{ColorEncoding, TexelData};

    #[test]
    fn indices_beyond_the_edge_wrap_as_told() {
        let row = |mode| (-3..6).map(|i| wrap(mode, i, 3)).collect::<Vec<_>>();
        assert_eq!(row(Wrap::Repeat), [0, 1, 2, 0, 1, 2, 0, 1, 2]);
        assert_eq!(row(Wrap::Mirror), [2, 1, 0, 0, 1, 2, 2, 1, 0]);
        assert_eq!(row(Wrap::Clamp), [0, 0, 0, 0, 1, 2, 2, 2, 2]);
        assert_eq!(wrap(Wrap::Repeat, cell(f32::NAN), 7), 0);
        assert!(wrap(Wrap::Mirror, cell(f32::INFINITY), 7) < 7);
        assert_eq!((-1..4).map(|i| shown(Wrap::Black, i, 3)).collect::<Vec<_>>(), [false, true, true, true, false]);
    }

    /// A white picture fades to black over half a texel on both sides of its edge, by linear interpolation with what is not there.
    #[test]
    fn black_wraps_end_at_the_edge() {
        let data = TexelData::F32(vec![1.0; 16]);
        let texels = Texels { width: 4, height: 4, channels: 1, encoding: ColorEncoding::Linear, data };
        let at = |x: f32, y: f32| quad(&texels, [Wrap::Black; 2], Vec2::new(x, y)).blend();
        assert_eq!([at(0.5, 0.5)[0], at(0.0, 0.5)[0], at(0.0, 0.0)[0], at(-0.125, 0.5)[0], at(9.0, 0.5)[0]], [1.0, 0.5, 0.25, 0.0, 0.0]);
        assert_eq!(at(0.5, 2.0), [0.0; 4], "transparent as well");
    }
}
