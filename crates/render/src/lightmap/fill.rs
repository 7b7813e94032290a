//! Gutters: texels around charts and texels without light of their own take that of their neighbors in the chart.

use rayon::prelude::*;

use super::layout::Layout;

/// A picture of three values for each texel of an atlas.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Row by row from the top.
    pub data: Vec<[f32; 3]>,
}

impl Map {
    /// A black map.
    pub fn new(size: [u32; 2]) -> Self {
        Self { size, data: vec![[0.0; 3]; size[0] as usize * size[1] as usize] }
    }

    /// Index of a texel.
    pub fn index(&self, x: u32, y: u32) -> usize {
        y as usize * self.size[0] as usize + x as usize
    }
}

/// Maps of all atlases from values of texels; `None` for texels without light of their own. Every chart and the gutter around it are
/// filled from the chart's own values; a chart that has none stays black.
pub fn maps(layout: &Layout, padding: u32, value: impl Fn(usize) -> Option<[f32; 3]> + Sync) -> Vec<Map> {
    // Texels are in the order of their charts.
    let mut ranges = vec![0..0usize; layout.charts.len()];
    for (i, t) in layout.texels.iter().enumerate() {
        let r = &mut ranges[t.chart as usize];
        *r = if r.end == 0 { i..i + 1 } else { r.start..i + 1 };
    }
    let filled: Vec<Vec<Option<[f32; 3]>>> = layout
        .charts
        .par_iter()
        .zip(ranges)
        .map(|(chart, range)| {
            let p = &chart.place;
            let size = p.texels.map(|t| (t + 2 * padding) as usize);
            let mut cells = vec![None; size[0] * size[1]];
            for i in range {
                let [x, y] = layout.texels[i].at;
                cells[(y + padding - p.origin[1]) as usize * size[0] + (x + padding - p.origin[0]) as usize] = value(i);
            }
            grow(&mut cells, size);
            cells
        })
        .collect();
    let mut maps: Vec<Map> = layout.packing.atlases.iter().map(|size| Map::new(*size)).collect();
    for (chart, cells) in layout.charts.iter().zip(filled) {
        let p = &chart.place;
        let width = p.texels[0] + 2 * padding;
        let map = &mut maps[p.atlas as usize];
        for (i, v) in cells.into_iter().enumerate() {
            let (x, y) = (p.origin[0] - padding + i as u32 % width, p.origin[1] - padding + i as u32 / width);
            let at = map.index(x, y);
            map.data[at] = v.unwrap_or_default();
        }
    }
    maps
}

/// Fills empty cells with the mean of their filled neighbors, ring by ring.
fn grow(cells: &mut [Option<[f32; 3]>], [w, h]: [usize; 2]) {
    let neighbors = |i: usize| {
        let (x, y) = ((i % w) as i64, (i / w) as i64);
        let steps = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];
        steps.into_iter().filter_map(move |(dx, dy)| {
            let (nx, ny) = (x + dx, y + dy);
            ((0..w as i64).contains(&nx) && (0..h as i64).contains(&ny)).then(|| (ny as usize * w + nx as usize, dx == 0 || dy == 0))
        })
    };
    let mut front: Vec<usize> = (0..cells.len()).filter(|&i| cells[i].is_none() && neighbors(i).any(|(n, _)| cells[n].is_some())).collect();
    let mut queued = vec![false; cells.len()];
    while !front.is_empty() {
        let values: Vec<[f32; 3]> = front
            .iter()
            .map(|&i| {
                let (mut sum, mut weight) = ([0.0f32; 3], 0.0);
                for (n, straight) in neighbors(i) {
                    if let Some(v) = cells[n] {
                        // Straight neighbors count twice as much as diagonal ones.
                        let share = if straight { 2.0 } else { 1.0 };
                        weight += share;
                        (0..3).for_each(|k| sum[k] += share * v[k]);
                    }
                }
                sum.map(|s| s / weight)
            })
            .collect();
        let mut next = Vec::new();
        for (&i, v) in front.iter().zip(values) {
            cells[i] = Some(v);
        }
        for &i in &front {
            for (n, _) in neighbors(i) {
                if cells[n].is_none() && !std::mem::replace(&mut queued[n], true) {
                    next.push(n);
                }
            }
        }
        front = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growing_fills_everything_from_what_is_there() {
        let mut cells = vec![None; 35];
        cells[0] = Some([1.0, 2.0, 3.0]);
        cells[34] = Some([3.0, 2.0, 1.0]);
        grow(&mut cells, [7, 5]);
        assert!(cells.iter().flatten().count() == 35);
        assert!(cells.iter().flatten().all(|v| v[1] == 2.0 && (1.0..=3.0).contains(&v[0])));
        let mut empty = vec![None; 4];
        grow(&mut empty, [2, 2]);
        assert!(empty.iter().all(Option::is_none));
    }
}
