//! Texels as points that get light, and what their surface looks like.

use rayon::prelude::*;

use super::layout::{Layout, Texel};
use super::solve::Points;
use super::spots::{Spot, World};
use crate::math::Vec2;
use crate::sampler::{SampleStream, Sampler, SamplerKind};
use crate::scene::Surface;

/// Places of a texel at which its material is looked up.
const MATERIAL_SAMPLES: u32 = 16;

/// All texels.
pub struct TexelPoints<'a> {
    /// The world.
    pub world: World<'a>,
    /// The texels.
    pub layout: &'a Layout,
    /// Where their light is measured.
    pub spots: &'a [Spot],
}

impl TexelPoints<'_> {
    fn at(&self, texel: &Texel, triangle: u32, bary: Vec2, flip: bool) -> Surface {
        let chart = &self.layout.charts[texel.chart as usize];
        let side = self.layout.sides[chart.side as usize];
        self.world.surface(side.shape, chart.chart.triangles[triangle as usize], bary, side.back && flip)
    }

    /// A place within a texel, uniform over it; the texel's own point where the chart ends before.
    fn within(&self, texel: &Texel, u: Vec2, flip: bool) -> Surface {
        let (triangle, bary) = self.layout.locate(texel, u - 0.5).unwrap_or((texel.triangle, texel.bary));
        self.at(texel, triangle, bary, flip)
    }

    /// For each texel the mean share of light that its surface scatters, and its normal.
    pub fn materials(&self) -> Vec<([f32; 3], [f32; 3])> {
        let sampler = Sampler { kind: SamplerKind::Sobol, seed: 0, spp: MATERIAL_SAMPLES };
        let scene = self.world.scene;
        self.layout
            .texels
            .par_iter()
            .map(|texel| {
                let side = self.layout.sides[self.layout.charts[texel.chart as usize].side as usize];
                let mut sum = [0.0f32; 3];
                for index in 0..MATERIAL_SAMPLES {
                    let u = sampler.stream(texel.at[0], texel.at[1], index).next_2d();
                    // The material tells its sides itself.
                    let s = self.within(texel, u, false);
                    let wo = if side.back { -s.frame.n } else { s.frame.n };
                    let albedo = scene.materials[s.material as usize].shade(scene, &s, wo).albedo(wo).rgb();
                    (0..3).for_each(|k| sum[k] += if albedo[k].is_finite() { albedo[k].clamp(0.0, 1.0) } else { 0.0 });
                }
                let normal = self.at(texel, texel.triangle, texel.bary, true).frame.n;
                (sum.map(|v| v / MATERIAL_SAMPLES as f32), normal.to_array())
            })
            .collect()
    }
}

impl Points for TexelPoints<'_> {
    fn len(&self) -> usize {
        self.layout.texels.len()
    }

    fn key(&self, point: usize) -> [u32; 2] {
        let t = &self.layout.texels[point];
        [t.at[0], t.at[1] | t.atlas << 16]
    }

    fn surface(&self, point: usize, stream: &mut SampleStream) -> Option<Surface> {
        let u = stream.next_2d();
        let (texel, spot) = (&self.layout.texels[point], &self.spots[point]);
        if spot.is_buried {
            return None;
        }
        if spot.is_clear {
            return Some(self.within(texel, u, true));
        }
        let mut s = self.at(texel, texel.triangle, texel.bary, true);
        s.p = spot.p;
        Some(s)
    }
}
