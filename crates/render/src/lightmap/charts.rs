//! Charts: connected pieces of a surface, flattened without overlap.
//!
//! Pieces grow over neighbors whose normals differ little and are projected along their mean normal. No triangle is then compressed
//! below half of its size, so that texels stay of one size within a factor of two, and nothing folds over. Projection of broken meshes
//! is as sound as that of good ones, which is why it is preferred here to conformal maps (docs/decisions/0006-lightmaps.md).

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use etendue_scene::desc::MeshData;

use super::topology::{NONE, Topology};
use crate::math::{Frame, Vec2, Vec3};

/// Smallest cosine between a triangle's normal and the mean normal while a chart grows: 45 degrees.
const GROW_COS: f32 = 0.707;
/// Smallest cosine in the end, when the mean normal has moved: 60 degrees.
const KEEP_COS: f32 = 0.5;
/// Edge of the grid in which overlaps are looked for.
const OVERLAP_GRID: usize = 256;

/// A flattened piece of a surface.
#[derive(Clone, Debug)]
pub struct Chart {
    /// Triangles of the mesh.
    pub triangles: Vec<u32>,
    /// Where their corners lie in the plane, in world units; the smallest coordinates are 0.
    pub corners: Vec<[Vec2; 3]>,
    /// The largest coordinates.
    pub size: Vec2,
}

/// Cuts a mesh into charts, the largest triangles first.
pub fn unwrap(mesh: &MeshData, topology: &Topology) -> Vec<Chart> {
    let n = mesh.triangles.len();
    let at = |t: usize| mesh.triangles[t].map(|i| mesh.positions[i as usize]);
    let areas: Vec<f32> = (0..n)
        .map(|t| {
            let [a, b, c] = at(t);
            (b - a).cross(c - a).length() * 0.5
        })
        .collect();
    let mut seeds: Vec<u32> = (0..n as u32).collect();
    seeds.sort_by(|a, b| areas[*b as usize].total_cmp(&areas[*a as usize]).then(a.cmp(b)));
    // The chart that a triangle belongs to, or waits for.
    let mut taken = vec![false; n];
    let mut charts = Vec::new();
    for seed in seeds {
        while !taken[seed as usize] {
            let members = grow(seed, topology, &areas, &mut taken);
            let axis = axis(&members, seed, topology, &areas);
            // The mean normal has moved since the first triangles were taken.
            let (mut kept, lost): (Vec<u32>, Vec<u32>) =
                members.into_iter().partition(|t| topology.normals[*t as usize].dot(axis) >= KEEP_COS);
            let corners = project(mesh, &kept, axis);
            let fits = first_overlap(&corners);
            let released = kept.split_off(fits);
            lost.into_iter().chain(released).for_each(|t| taken[t as usize] = false);
            charts.push(settle(kept, corners));
        }
    }
    charts
}

/// Takes triangles from a seed on, those that differ least from the mean normal first; in the order of taking.
fn grow(seed: u32, topology: &Topology, areas: &[f32], taken: &mut [bool]) -> Vec<u32> {
    let mut members = Vec::new();
    let mut sum = Vec3::ZERO;
    let mut queue = BinaryHeap::from([Reverse((0u32, seed))]);
    while let Some(Reverse((_, t))) = queue.pop() {
        let i = t as usize;
        let mean = sum.normalize_or(topology.normals[seed as usize]);
        if taken[i] || topology.normals[i].dot(mean) < GROW_COS {
            continue;
        }
        taken[i] = true;
        members.push(t);
        sum += topology.normals[i] * areas[i];
        let mean = sum.normalize_or(topology.normals[seed as usize]);
        for k in 0..3 {
            let neighbor = topology.neighbors[i][k];
            if neighbor == NONE || !topology.smooth[i][k] || taken[(neighbor / 3) as usize] {
                continue;
            }
            let difference = (1.0 - topology.normals[(neighbor / 3) as usize].dot(mean)).max(0.0);
            // Non-negative floats sort like their bits.
            queue.push(Reverse((difference.to_bits(), neighbor / 3)));
        }
    }
    members
}

/// The direction of projection: the mean normal, or the seed's where the mean would lose the seed.
fn axis(members: &[u32], seed: u32, topology: &Topology, areas: &[f32]) -> Vec3 {
    let own = topology.normals[seed as usize];
    let sum: Vec3 = members.iter().map(|&t| topology.normals[t as usize] * areas[t as usize]).sum();
    let mean = sum.normalize_or(own);
    if own.dot(mean) >= KEEP_COS { mean } else { own }
}

fn project(mesh: &MeshData, triangles: &[u32], axis: Vec3) -> Vec<[Vec2; 3]> {
    let frame = Frame::from_normal(axis);
    let (s, t) = (frame.s.as_dvec3(), frame.t.as_dvec3());
    let at = |i: u32| mesh.positions[i as usize].as_dvec3();
    let Some(o) = triangles.first().map(|t| at(mesh.triangles[*t as usize][0])) else { return Vec::new() };
    let flat = |i: u32| {
        let d = at(i) - o;
        Vec2::new(d.dot(s) as f32, d.dot(t) as f32)
    };
    triangles.iter().map(|t| mesh.triangles[*t as usize].map(flat)).collect()
}

/// How many triangles there are before the first one that lies over an earlier one; on a grid, so narrow overlaps may pass.
pub(super) fn first_overlap(corners: &[[Vec2; 3]]) -> usize {
    if corners.len() < 2 {
        return corners.len();
    }
    let (min, max) = bounds(corners.iter().flatten());
    let scale = OVERLAP_GRID as f32 / (max - min).max_element().max(f32::MIN_POSITIVE);
    let mut grid = vec![false; OVERLAP_GRID * OVERLAP_GRID];
    for (i, c) in corners.iter().enumerate() {
        let c = c.map(|p| (p - min) * scale);
        let mut overlaps = false;
        cells(&c, OVERLAP_GRID, |cell| overlaps |= std::mem::replace(&mut grid[cell], true));
        if overlaps {
            return i;
        }
    }
    corners.len()
}

/// Calls back with the cells whose centers are well inside a triangle.
fn cells(c: &[Vec2; 3], edge: usize, mut found: impl FnMut(usize)) {
    let (min, max) = bounds(c.iter());
    let area = (c[1] - c[0]).perp_dot(c[2] - c[0]);
    let last = edge as f32 - 1.0;
    let (lo, hi) = ((min - 0.5).ceil().clamp(Vec2::ZERO, Vec2::splat(last)), (max - 0.5).floor().clamp(Vec2::ZERO, Vec2::splat(last)));
    for y in lo.y as usize..=hi.y as usize {
        for x in lo.x as usize..=hi.x as usize {
            let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            // Centers on a common edge belong to neither side.
            let inside = (0..3).all(|k| {
                let (a, b) = (c[k], c[(k + 1) % 3]);
                (b - a).perp_dot(p - a) * area.signum() > 1e-3 * (b - a).length()
            });
            if inside {
                found(y * edge + x);
            }
        }
    }
}

fn bounds<'a>(points: impl Iterator<Item = &'a Vec2>) -> (Vec2, Vec2) {
    points.fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)))
}

/// A chart turned to its smallest rectangle, longer than high, with its corner at the origin.
pub(super) fn settle(triangles: Vec<u32>, mut corners: Vec<[Vec2; 3]>) -> Chart {
    corners.truncate(triangles.len());
    let x_axis = narrowest_axis(&corners);
    let y_axis = x_axis.perp();
    corners.iter_mut().flatten().for_each(|p| *p = Vec2::new(p.dot(x_axis), p.dot(y_axis)));
    let (min, max) = bounds(corners.iter().flatten());
    let mut size = max - min;
    // A quarter turn, not a mirror.
    if size.y > size.x {
        corners.iter_mut().flatten().for_each(|p| *p = Vec2::new(p.y - min.y, max.x - p.x));
        size = Vec2::new(size.y, size.x);
    } else {
        corners.iter_mut().flatten().for_each(|p| *p -= min);
    }
    Chart { triangles, corners, size }
}

/// Direction of an edge of the convex hull along which the enclosing rectangle is smallest.
fn narrowest_axis(corners: &[[Vec2; 3]]) -> Vec2 {
    let hull = convex_hull(corners.iter().flatten().copied().collect());
    let mut best = (f32::INFINITY, Vec2::X);
    // Round shapes have many edges that are all as good.
    let step = hull.len().div_ceil(256).max(1);
    for i in (0..hull.len()).step_by(step) {
        let Some(axis) = (hull[(i + 1) % hull.len()] - hull[i]).try_normalize() else { continue };
        let turned = hull.iter().map(|p| Vec2::new(p.dot(axis), p.dot(axis.perp())));
        let (min, max) = turned.fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        let area = (max - min).element_product();
        // Equal but for rounding: the first one, so that squares do not turn about.
        if area < best.0 * (1.0 - 1e-5) {
            best = (area, axis);
        }
    }
    best.1
}

/// Andrew's monotone chain.
fn convex_hull(mut points: Vec<Vec2>) -> Vec<Vec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let half = |points: &mut dyn Iterator<Item = Vec2>| {
        let mut chain: Vec<Vec2> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..]
                && (b - a).perp_dot(p - a) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut points.iter().copied());
    hull.extend(half(&mut points.iter().rev().copied()));
    hull
}

/// The second set of texture coordinates as one chart, where it is one: in [0, 1], without overlap, without triangles that have lost
/// their area. Its scale is such that areas are those of the world on the whole.
pub fn existing(mesh: &MeshData, uvs: &[Vec2]) -> Option<Chart> {
    if uvs.len() < mesh.positions.len() || uvs.iter().any(|uv| !uv.is_finite()) {
        return None;
    }
    let corners: Vec<[Vec2; 3]> = mesh.triangles.iter().map(|t| t.map(|i| uvs[i as usize])).collect();
    let (min, max) = bounds(corners.iter().flatten());
    if min.min_element() < -1e-3 || max.max_element() > 1.0 + 1e-3 {
        return None;
    }
    let flat_areas = corners.iter().map(|c| f64::from((c[1] - c[0]).perp_dot(c[2] - c[0]).abs()) * 0.5);
    let world_areas = mesh.triangles.iter().map(|t| {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize].as_dvec3());
        (b - a).cross(c - a).length() * 0.5
    });
    let (mut flat, mut world, mut lost) = (0.0, 0.0, 0.0);
    for (f, w) in flat_areas.zip(world_areas) {
        flat += f;
        world += w;
        lost += if f > 1e-12 { 0.0 } else { w };
    }
    if !(flat > 0.0) || lost > 1e-4 * world || first_overlap(&corners) < corners.len() {
        return None;
    }
    let scale = (world / flat).sqrt() as f32;
    let corners = corners.iter().map(|c| c.map(|p| (p - min) * scale)).collect();
    Some(Chart { triangles: (0..mesh.triangles.len() as u32).collect(), corners, size: (max - min) * scale })
}

/// Corners that one vertex has in a chart are one: the vertices of a chart, and triangles that refer to them.
pub fn vertices(mesh: &MeshData, chart: &Chart) -> (Vec<(u32, Vec2)>, Vec<[u32; 3]>) {
    let mut known = HashMap::new();
    let mut list = Vec::new();
    let triangles = chart.triangles.iter().zip(&chart.corners).map(|(t, corners)| {
        std::array::from_fn(|k| {
            let vertex = mesh.triangles[*t as usize][k];
            *known.entry((vertex, corners[k].x.to_bits(), corners[k].y.to_bits())).or_insert_with(|| {
                list.push((vertex, corners[k]));
                list.len() as u32 - 1
            })
        })
    });
    let triangles = triangles.collect();
    (list, triangles)
}

#[cfg(test)]
mod tests {
    use etendue_scene::desc::GeometryDesc;
    use etendue_scene::formats::tessellate::tessellate;

    use super::*;

    fn charts_of(geometry: &GeometryDesc) -> (MeshData, Vec<Chart>) {
        let mesh = tessellate(geometry).unwrap();
        let charts = unwrap(&mesh, &Topology::new(&mesh));
        let mut seen: Vec<u32> = charts.iter().flat_map(|c| c.triangles.clone()).collect();
        seen.sort_unstable();
        assert_eq!(seen, (0..mesh.triangles.len() as u32).collect::<Vec<_>>(), "each triangle is in one chart");
        (mesh, charts)
    }

    #[test]
    fn a_cube_has_six_square_charts() {
        let (_, charts) = charts_of(&GeometryDesc::Cube);
        assert_eq!(charts.len(), 6);
        for c in &charts {
            assert!((c.size - 2.0).length() < 1e-5, "{:?}", c.size);
        }
    }

    #[test]
    fn spheres_and_cylinders_are_cut_into_few_charts_without_overlap_or_collapse() {
        for geometry in [
            GeometryDesc::Sphere { center: Vec3::ZERO, radius: 1.0 },
            GeometryDesc::Cylinder { p0: Vec3::ZERO, p1: Vec3::Z, radius: 1.0 },
            GeometryDesc::Disk,
        ] {
            let (mesh, charts) = charts_of(&geometry);
            assert!(charts.len() <= 32, "{geometry:?}: {}", charts.len());
            for c in &charts {
                assert_eq!(first_overlap(&c.corners), c.corners.len());
                for (t, corners) in c.triangles.iter().zip(&c.corners) {
                    let [a, b, d] = mesh.triangles[*t as usize].map(|i| mesh.positions[i as usize]);
                    let area = (b - a).cross(d - a).length();
                    if area < 1e-6 {
                        // At the poles, triangles are points.
                        continue;
                    }
                    let ratio = (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]) / area;
                    assert!(ratio > 0.45 && ratio < 1.01, "{ratio}");
                }
            }
        }
    }

    #[test]
    fn a_spiral_ramp_is_cut_where_it_would_lie_over_itself() {
        // Two turns, gently rising: all normals are nearly +z.
        let mut mesh = MeshData::default();
        for i in 0..=64 {
            let (sin, cos) = crate::math::fns::sin_cos(i as f32 * std::f32::consts::TAU / 32.0);
            let z = i as f32 * 0.01;
            mesh.positions.extend([Vec3::new(cos, sin, z), Vec3::new(2.0 * cos, 2.0 * sin, z)]);
        }
        for i in 0..64 {
            let a = 2 * i;
            mesh.triangles.extend([[a, a + 1, a + 3], [a, a + 3, a + 2]]);
        }
        let charts = unwrap(&mesh, &Topology::new(&mesh));
        assert!((2..8).contains(&charts.len()), "{}", charts.len());
    }

    #[test]
    fn usable_texture_coordinates_are_told_from_others() {
        let mesh = tessellate(&GeometryDesc::Rectangle).unwrap();
        assert!(existing(&mesh, &mesh.uvs).is_some_and(|c| (c.size - 2.0).length() < 1e-5));
        let beyond: Vec<Vec2> = mesh.uvs.iter().map(|uv| *uv * 2.0).collect();
        assert!(existing(&mesh, &beyond).is_none());
        let cube = tessellate(&GeometryDesc::Cube).unwrap();
        assert!(existing(&cube, &cube.uvs).is_none(), "all six sides lie over each other");
        assert!(existing(&mesh, &[Vec2::ZERO; 4]).is_none());
    }
}
