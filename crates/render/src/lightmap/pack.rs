//! Charts on atlases: rectangles of whole texels, packed by a skyline.
//!
//! Jylänki 2010, "A Thousand Ways to Pack the Bin", section 2.4 (skyline, bottom-left).

use crate::math::Vec2;

/// Most atlases.
pub const ATLAS_LIMIT: usize = 64;
/// Share of an atlas that packed charts fill at best.
const FILL: f64 = 0.9;

/// Where a chart lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Number of the atlas.
    pub atlas: u32,
    /// Its first texel, without the gutter.
    pub origin: [u32; 2],
    /// Texels that it covers, without the gutter.
    pub texels: [u32; 2],
    /// Texels for a world unit of the chart, across and down.
    pub scale: Vec2,
}

/// Places of all charts and the sizes of the atlases.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Packing {
    /// One for each chart.
    pub places: Vec<Place>,
    /// Columns and rows of each atlas.
    pub atlases: Vec<[u32; 2]>,
    /// Texels for a world unit, as far as charts had room for them.
    pub density: f64,
    /// Charts that had to be coarser, to fit into an atlas.
    pub reduced: usize,
}

/// The upper edge of what is placed: (x, height) of steps from left to right.
struct Skyline {
    edge: u32,
    steps: Vec<[u32; 2]>,
    used: [u32; 2],
}

impl Skyline {
    fn new(edge: u32) -> Self {
        Self { edge, steps: vec![[0, 0]], used: [0, 0] }
    }

    /// Places a rectangle as low as possible, then as far left.
    fn place(&mut self, [w, h]: [u32; 2]) -> Option<[u32; 2]> {
        let mut best: Option<(u32, usize)> = None;
        for i in 0..self.steps.len() {
            let x = self.steps[i][0];
            if x + w > self.edge {
                break;
            }
            let y = self.steps[i..].iter().take_while(|s| s[0] < x + w).map(|s| s[1]).max().unwrap_or(0);
            if y + h <= self.edge && best.is_none_or(|(lowest, _)| y < lowest) {
                best = Some((y, i));
            }
        }
        let (y, i) = best?;
        let x = self.steps[i][0];
        let end = x + w;
        // What the rectangle covers of the skyline goes; the height behind its end stays.
        let covered = self.steps[i..].iter().take_while(|s| s[0] < end).count();
        let last_height = self.steps[i + covered - 1][1];
        let continues = end < self.edge && self.steps.get(i + covered).is_none_or(|s| s[0] > end);
        let new = [[x, y + h], [end, last_height]];
        self.steps.splice(i..i + covered, new.into_iter().take(1 + usize::from(continues)));
        self.used = [self.used[0].max(end), self.used[1].max(y + h)];
        Some([x, y])
    }
}

/// Packs charts of the given sizes (world units) into square atlases of at most `resolution` texels, each with `padding` texels of gutter
/// around it. Without a density (texels for a world unit) it takes the highest at which one atlas is enough.
///
/// # Errors
/// A sentence where more than [`ATLAS_LIMIT`] atlases would be needed.
pub fn pack(sizes: &[Vec2], density: Option<f64>, resolution: u32, padding: u32) -> Result<Packing, String> {
    let order = order(sizes);
    if let Some(density) = density {
        let limit = resolution - 2 * padding;
        return attempt(sizes, &order, density, limit, resolution, padding, ATLAS_LIMIT).ok_or_else(|| {
            format!("more than {ATLAS_LIMIT} atlases of {resolution} texels: lower --texels-per-meter or raise --resolution")
        });
    }
    // A ground plane of a kilometer must not leave the house on it a single texel.
    let limit = (resolution / 2).saturating_sub(2 * padding).max(1);
    let area: f64 = sizes.iter().map(|s| f64::from(s.x) * f64::from(s.y)).sum();
    let fill = FILL * f64::from(resolution) * f64::from(resolution);
    let largest = sizes.iter().map(|s| f64::from(s.x)).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let smallest = sizes.iter().map(|s| f64::from(s.x)).filter(|s| *s > 0.0).fold(largest, f64::min);
    let one = |density| attempt(sizes, &order, density, limit, resolution, padding, 1);
    // Below the one every chart may be a texel, above the other every chart is as large as it may be.
    let mut low = (fill / area.max(f64::MIN_POSITIVE)).sqrt().min(1.0 / largest) * 1e-3;
    let mut high = f64::from(limit) / smallest;
    let mut best = one(low);
    let steps = if sizes.len() > 20_000 { 12 } else { 24 };
    for _ in 0..steps {
        let middle = (low * high).sqrt();
        match one(middle) {
            Some(found) => {
                best = Some(found);
                low = middle;
            }
            None => high = middle,
        }
        if high / low < 1.005 {
            break;
        }
    }
    best.map_or_else(
        || {
            let density = low;
            attempt(sizes, &order, density, limit, resolution, padding, ATLAS_LIMIT).ok_or_else(|| {
                format!("the surface falls into {} charts, too many for {ATLAS_LIMIT} atlases; raise --resolution", sizes.len())
            })
        },
        Ok,
    )
}

/// Higher charts first, then longer ones.
fn order(sizes: &[Vec2]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by(|&a, &b| sizes[b].y.total_cmp(&sizes[a].y).then(sizes[b].x.total_cmp(&sizes[a].x)).then(a.cmp(&b)));
    order
}

fn attempt(sizes: &[Vec2], order: &[usize], density: f64, limit: u32, resolution: u32, padding: u32, most: usize) -> Option<Packing> {
    let mut skylines = vec![Skyline::new(resolution)];
    let unplaced = Place { atlas: 0, origin: [0; 2], texels: [1; 2], scale: Vec2::ONE };
    let mut packing = Packing { places: vec![unplaced; sizes.len()], density, ..Packing::default() };
    for &i in order {
        let size = sizes[i];
        let own = density.min(f64::from(limit) / f64::from(size.max_element()).max(f64::MIN_POSITIVE));
        packing.reduced += usize::from(own < density);
        // Whole texels: edges of rectangles lie between texels, none is half on a wall and half on a floor.
        let texels = [size.x, size.y].map(|s| ((f64::from(s) * own - 1e-3).ceil().max(1.0) as u32).min(limit));
        let outer = texels.map(|t| t + 2 * padding);
        let mut found = None;
        for atlas in 0..most {
            if atlas == skylines.len() {
                skylines.push(Skyline::new(resolution));
            }
            if let Some(at) = skylines[atlas].place(outer) {
                found = Some((atlas, at));
                break;
            }
        }
        let (atlas, at) = found?;
        let scale = |t: u32, s: f32| if s > 0.0 { t as f32 / s } else { 1.0 };
        packing.places[i] = Place {
            atlas: atlas as u32,
            origin: at.map(|v| v + padding),
            texels,
            scale: Vec2::new(scale(texels[0], size.x), scale(texels[1], size.y)),
        };
    }
    // Multiples of four suit every way of storing textures.
    packing.atlases = skylines.iter().map(|s| s.used.map(|v| v.next_multiple_of(4).min(resolution))).collect();
    Some(packing)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(packing: &Packing, padding: u32) -> f64 {
        let mut taken: Vec<Vec<bool>> = packing.atlases.iter().map(|a| vec![false; (a[0] * a[1]) as usize]).collect();
        let mut area = 0;
        for p in &packing.places {
            let [w, h] = packing.atlases[p.atlas as usize];
            for y in p.origin[1] - padding..p.origin[1] + p.texels[1] + padding {
                for x in p.origin[0] - padding..p.origin[0] + p.texels[0] + padding {
                    assert!(x < w && y < h);
                    assert!(!std::mem::replace(&mut taken[p.atlas as usize][(y * w + x) as usize], true), "overlap");
                    area += 1;
                }
            }
        }
        f64::from(area) / packing.atlases.iter().map(|a| f64::from(a[0] * a[1])).sum::<f64>()
    }

    fn sizes() -> Vec<Vec2> {
        (0..300u32)
            .map(|i| {
                let f = |k: u32| (crate::math::hash::mix32(i * 2 + k) >> 8) as f32 / 16_777_216.0;
                let (a, b) = (0.05 + f(0) * f(0) * 3.0, 0.05 + f(1));
                Vec2::new(a.max(b), a.min(b))
            })
            .collect()
    }

    #[test]
    fn one_atlas_is_filled_well_and_nothing_overlaps() {
        let packing = pack(&sizes(), None, 512, 2).unwrap();
        assert_eq!(packing.atlases.len(), 1);
        let fill = check(&packing, 2);
        assert!(fill > 0.75, "{fill}");
    }

    #[test]
    fn a_density_takes_as_many_atlases_as_it_needs() {
        let packing = pack(&sizes(), Some(60.0), 256, 2).unwrap();
        assert!(packing.atlases.len() > 2, "{}", packing.atlases.len());
        check(&packing, 2);
        assert!(packing.places.iter().zip(sizes()).all(|(p, s)| p.texels[0] as f32 >= (60.0 * s.x).min(252.0) - 0.01));
        assert!(pack(&sizes(), Some(1e9), 64, 2).is_err());
    }

    #[test]
    fn a_huge_plane_leaves_room_for_small_things() {
        let packing = pack(&[Vec2::splat(2000.0), Vec2::splat(2.0), Vec2::ONE], None, 256, 2).unwrap();
        assert_eq!(packing.reduced, packing.places.iter().filter(|p| p.scale.x < packing.density as f32 * 0.99).count());
        assert!(packing.places[1].texels[0] > 60, "{:?}", packing.places);
    }

    #[test]
    fn charts_without_size_take_a_texel() {
        let packing = pack(&[Vec2::ZERO, Vec2::new(1e-30, 0.0), Vec2::splat(1e14)], None, 64, 2).unwrap();
        check(&packing, 2);
    }
}
