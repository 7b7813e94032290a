//! Vertices as points that get light.
//!
//! The light of a vertex is the mean over the triangles around it, weighted with the vertex's share of the interpolation (its hat
//! function): what stands in a corner of a room is not as dark as the corner itself, and nothing leaks through it. Triangles join at
//! a vertex where their normals do.

use std::collections::HashMap;

use super::flatten::Flat;
use super::layout::Side;
use super::solve::Points;
use super::spots::World;
use super::topology::NONE;
use crate::math::Vec2;
use crate::sampler::SampleStream;
use crate::scene::Surface;

/// Places that are tried where one lies inside of another body.
const TRIES: u32 = 4;

/// A group of corners that share their light.
#[derive(Clone, Debug)]
struct Fan {
    side: u32,
    /// Triangle · 3 + corner, with the sum of the areas up to it.
    corners: Vec<(u32, f64)>,
}

/// All vertices of all sides.
#[derive(Clone, Debug)]
pub struct VertexLayout {
    /// Sides of shapes.
    pub sides: Vec<Side>,
    /// For each side and each corner of its triangles, the number of the point.
    pub points: Vec<Vec<u32>>,
    fans: Vec<Fan>,
}

impl VertexLayout {
    /// Finds the vertices of everything that is to be baked.
    pub fn new(flat: &Flat) -> Self {
        let mut layout = Self { sides: Vec::new(), points: Vec::new(), fans: Vec::new() };
        for (shape, info) in flat.shapes.iter().enumerate() {
            if info.bake == [false; 2] {
                continue;
            }
            let roots = join(flat, shape);
            for back in [false, true].into_iter().filter(|b| info.bake[usize::from(*b)]) {
                layout.add_side(flat, Side { shape: shape as u32, back }, &roots);
            }
        }
        layout
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.fans.len()
    }

    fn add_side(&mut self, flat: &Flat, side: Side, roots: &[u32]) {
        let mesh = flat.mesh(side.shape as usize);
        let mut fans: HashMap<u32, usize> = HashMap::new();
        let mut points = Vec::with_capacity(roots.len());
        for (corner, root) in roots.iter().enumerate() {
            let fan = *fans.entry(*root).or_insert_with(|| {
                self.fans.push(Fan { side: self.sides.len() as u32, corners: Vec::new() });
                self.fans.len() - 1
            });
            let [a, b, c] = mesh.triangles[corner / 3].map(|i| mesh.positions[i as usize].as_dvec3());
            let corners = &mut self.fans[fan].corners;
            let area = corners.last().map_or(0.0, |c| c.1) + (b - a).cross(c - a).length();
            corners.push((corner as u32, area));
            points.push(fan as u32);
        }
        self.sides.push(side);
        self.points.push(points);
    }
}

/// For each corner the first one of those that share its light: around a vertex, over smooth edges.
fn join(flat: &Flat, shape: usize) -> Vec<u32> {
    let topology = &flat.shapes[shape].topology;
    let mut parent: Vec<u32> = (0..3 * topology.neighbors.len() as u32).collect();
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    for (t, neighbors) in topology.neighbors.iter().enumerate() {
        for (k, &neighbor) in neighbors.iter().enumerate() {
            if neighbor == NONE || !topology.smooth[t][k] {
                continue;
            }
            let (other, edge) = (neighbor / 3, neighbor % 3);
            // The edge runs the other way in the neighbor.
            for (mine, its) in [(k as u32, (edge + 1) % 3), ((k as u32 + 1) % 3, edge)] {
                let (a, b) = (root(&mut parent, 3 * t as u32 + mine), root(&mut parent, 3 * other + its));
                parent[a.max(b) as usize] = a.min(b);
            }
        }
    }
    (0..parent.len() as u32).map(|i| root(&mut parent, i)).collect()
}

/// All vertices in the world.
pub struct VertexPoints<'a> {
    /// The world.
    pub world: World<'a>,
    /// The vertices.
    pub layout: &'a VertexLayout,
    /// Whether there are closed bodies that vertices may lie in.
    pub has_solids: bool,
}

impl Points for VertexPoints<'_> {
    fn len(&self) -> usize {
        self.layout.len()
    }

    fn key(&self, point: usize) -> [u32; 2] {
        [point as u32, u32::MAX]
    }

    fn surface(&self, point: usize, stream: &mut SampleStream) -> Option<Surface> {
        let fan = &self.layout.fans[point];
        let side = self.layout.sides[fan.side as usize];
        let total = fan.corners.last()?.1;
        for _ in 0..TRIES {
            let (u, v, w) = (stream.next_1d(), stream.next_2d(), stream.next_2d());
            let at = f64::from(u) * total;
            let corner = fan.corners[fan.corners.partition_point(|c| c.1 <= at).min(fan.corners.len() - 1)].0;
            // The hat function b over a triangle gives b the density 6 b (1 − b), which is that of the median of three uniform numbers; what
            // it leaves is shared evenly.
            let b = median(v.x, v.y, w.x);
            let rest = (1.0 - b) * w.y;
            let mut weights = [0.0; 3];
            let k = corner as usize % 3;
            weights[k] = b;
            weights[(k + 1) % 3] = rest;
            weights[(k + 2) % 3] = (1.0 - b - rest).max(0.0);
            let s = self.world.surface(side.shape, corner / 3, Vec2::new(weights[1], weights[2]), side.back);
            if !self.has_solids || !self.world.is_inside(s.offset_origin(s.ng), s.ng) {
                return Some(s);
            }
        }
        None
    }
}

fn median(a: f32, b: f32, c: f32) -> f32 {
    a.max(b).min(a.min(b).max(c))
}
