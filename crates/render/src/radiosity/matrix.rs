//! The full system B = E + R F B with all form factors in memory (Goral, Torrance, Greenberg and Battaile 1984, "Modeling the Interaction
//! of Light Between Diffuse Surfaces", doi:10.1145/964965.808601): for teaching and checking, and for small scenes.
//!
//! 1 − R F is strictly diagonally dominant by rows (a row of F sums to at most 1, reflectances are below 1), so Gaussian elimination
//! needs no pivots and Jacobi's and Gauss–Seidel's iterations converge. The elimination is our own: linear-algebra libraries pick
//! their kernels, and so the last bits, by the machine.

use rayon::prelude::*;

use super::direct::DirectLights;
use super::exchange::{Factors, Solved};
use super::hemicube::Hemicube;
use super::mesh::Mesh;
use super::{FormFactors, Progress, Solver};
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// Relative change at which iterations end.
const CONVERGED: f64 = 1e-7;
/// Iterations at most.
const MAX_ITERATIONS: u32 = 20_000;
/// Rows that are eliminated together.
const BLOCK: usize = 32;

/// Settings of the method.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// How factors are found.
    pub form_factors: FormFactors,
    /// How the system is solved.
    pub solver: Solver,
    /// Edge of a hemicube's top in pixels.
    pub hemicube: u32,
    /// Random numbers.
    pub seed: u64,
}

/// The form factors of all pairs of some elements.
#[derive(Clone, Debug)]
pub struct FactorMatrix {
    /// Number of elements.
    pub n: usize,
    /// Row by row: the factor from the row's element (which receives) to the column's.
    pub factors: Vec<f32>,
}

impl FactorMatrix {
    /// The factors of the leaves of a mesh, in their order. n² numbers.
    pub fn new(scene: &Scene, mesh: &Mesh, leaves: &[u32], options: &Options, progress: &Progress) -> Self {
        let n = leaves.len();
        let mut factors = vec![0.0f32; n * n];
        let done = std::sync::atomic::AtomicUsize::new(0);
        let step = || {
            let k = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            if k.is_multiple_of(64) {
                progress.tell("form factors", k as f64 / n as f64);
            }
        };
        match options.form_factors {
            FormFactors::Rays => {
                let f = Factors { scene, mesh, seed: options.seed };
                factors.par_chunks_mut(n.max(1)).zip(leaves).for_each(|(row, &r)| {
                    if progress.is_cancelled() {
                        return;
                    }
                    for (value, &s) in row.iter_mut().zip(leaves) {
                        if r != s {
                            *value = f.elements(r, s, &[]);
                        }
                    }
                    step();
                });
            }
            FormFactors::Hemicube => {
                let cube = Hemicube::new(options.hemicube);
                let items = super::hemicube::items(mesh, leaves);
                factors.par_chunks_mut(n.max(1)).zip(leaves).for_each(|(row, &r)| {
                    if progress.is_cancelled() {
                        return;
                    }
                    let node = &mesh.nodes[r as usize];
                    cube.factors(node.center, mesh.face(node).normal, &items, row);
                    step();
                });
            }
        }
        Self { n, factors }
    }

    /// A row.
    #[inline]
    pub fn row(&self, i: usize) -> &[f32] {
        &self.factors[i * self.n..(i + 1) * self.n]
    }

    /// The sum of each row: 1 in a closed room.
    pub fn row_sums(&self) -> Vec<f32> {
        (0..self.n).map(|i| self.row(i).iter().map(|&f| f64::from(f)).sum::<f64>() as f32).collect()
    }

    /// Mean of |Aᵢ Fᵢⱼ − Aⱼ Fⱼᵢ| over the mean of Aᵢ Fᵢⱼ.
    pub fn reciprocity(&self, areas: &[f32]) -> Option<f32> {
        let (mut difference, mut sum) = (0.0f64, 0.0f64);
        for i in 0..self.n {
            for j in 0..i {
                let a = f64::from(areas[i]) * f64::from(self.factors[i * self.n + j]);
                let b = f64::from(areas[j]) * f64::from(self.factors[j * self.n + i]);
                difference += (a - b).abs();
                sum += 0.5 * (a + b);
            }
        }
        (sum > 0.0).then(|| (difference / sum) as f32)
    }

    /// The matrix as text: a header, then for each element its number, object, area (m² where the scene's unit is the metre), middle,
    /// reflectance (mean of the colors), sum of its row, and the row.
    pub fn to_csv(&self, scene: &Scene, mesh: &Mesh, leaves: &[u32]) -> String {
        use std::fmt::Write;
        let mut out = String::from("element,object,area,x,y,z,reflectance,row_sum");
        (0..self.n).for_each(|j| {
            let _ = write!(out, ",F{j}");
        });
        out.push('\n');
        let sums = self.row_sums();
        for (i, &leaf) in leaves.iter().enumerate() {
            let node = &mesh.nodes[leaf as usize];
            let face = mesh.face(node);
            let g = &scene.geometries[scene.placements[face.instance as usize].geometry as usize];
            let name = g.objects[face.object as usize].name.replace([',', '"', '\n', '\r'], "_");
            let c = node.center;
            let _ = write!(out, "{i},{name},{},{},{},{},{},{}", node.area, c.x, c.y, c.z, node.reflectance.average(), sums[i]);
            for f in self.row(i) {
                let _ = write!(out, ",{f}");
            }
            out.push('\n');
        }
        out
    }
}

/// Solves for the leaves of a mesh.
pub fn solve(scene: &Scene, mesh: Mesh, lights: &DirectLights, options: &Options, progress: &Progress) -> Solved {
    let count = mesh.nodes.len();
    let leaves = mesh.leaves();
    let n = leaves.len();
    let direct_of_leaves = lights.irradiance(scene, &mesh, &leaves);
    let factors = FactorMatrix::new(scene, &mesh, &leaves, options, progress);
    let (mut direct, mut irradiance, mut radiosity) =
        (vec![Spectrum::ZERO; count], vec![Spectrum::ZERO; count], vec![Spectrum::ZERO; count]);
    let rho: Vec<Spectrum> = leaves.iter().map(|&i| mesh.nodes[i as usize].reflectance).collect();
    let source: Vec<Spectrum> = leaves
        .iter()
        .zip(&direct_of_leaves)
        .map(|(&i, &d)| mesh.nodes[i as usize].emission + mesh.nodes[i as usize].reflectance * d)
        .collect();
    let mut iterations = 0;
    let mut found = vec![Spectrum::ZERO; n];
    for c in 0..3 {
        let rho: Vec<f64> = rho.iter().map(|s| f64::from(s.0[c])).collect();
        let e: Vec<f64> = source.iter().map(|s| f64::from(s.0[c])).collect();
        let (b, k) = match options.solver {
            Solver::Direct => (eliminate(&factors, &rho, &e), 1),
            Solver::GaussSeidel => gauss_seidel(&factors, &rho, &e),
            Solver::Jacobi => jacobi(&factors, &rho, &e),
        };
        iterations = iterations.max(k);
        found.iter_mut().zip(b).for_each(|(f, b)| f.0[c] = b as f32);
    }
    let gathered: Vec<Spectrum> = (0..n)
        .into_par_iter()
        .map(|i| factors.row(i).iter().zip(&found).fold(Spectrum::ZERO, |sum, (&f, &b)| if f > 0.0 { sum + b * f } else { sum }))
        .collect();
    let mut row_sums = vec![0.0; count];
    for (k, (&i, sum)) in leaves.iter().zip(factors.row_sums()).enumerate() {
        let i = i as usize;
        direct[i] = direct_of_leaves[k];
        irradiance[i] = gathered[k] + direct_of_leaves[k];
        radiosity[i] = found[k];
        row_sums[i] = sum;
    }
    mesh.pull(&mut radiosity);
    let areas: Vec<f32> = leaves.iter().map(|&i| mesh.nodes[i as usize].area).collect();
    let how = match options.solver {
        Solver::Direct => "elimination".to_owned(),
        Solver::GaussSeidel => format!("{iterations} Gauss–Seidel iterations"),
        Solver::Jacobi => format!("{iterations} Jacobi iterations"),
    };
    let note = format!("matrix: {} faces, {n} elements, {} form factors, {how}", mesh.face_nodes.len(), n * n);
    let reciprocity = factors.reciprocity(&areas);
    Solved { mesh, direct, irradiance, radiosity, row_sums, reciprocity, notes: vec![note], ..Solved::default() }
}

/// One row of F times B.
fn dot(row: &[f32], b: &[f64]) -> f64 {
    // Four sums side by side: faster, and always the same.
    let mut sums = [0.0f64; 4];
    let chunks = row.chunks_exact(4);
    let rest = chunks.remainder();
    let tail: f64 = rest.iter().zip(&b[row.len() - rest.len()..]).map(|(&f, b)| f64::from(f) * b).sum();
    for (f, b) in chunks.zip(b.chunks_exact(4)) {
        for k in 0..4 {
            sums[k] += f64::from(f[k]) * b[k];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + tail
}

/// B ← E + R F B for all at once, until it stands still; with the number of iterations.
pub fn jacobi(f: &FactorMatrix, rho: &[f64], e: &[f64]) -> (Vec<f64>, u32) {
    let mut b = e.to_vec();
    for k in 1..=MAX_ITERATIONS {
        let next: Vec<f64> = (0..f.n).into_par_iter().map(|i| e[i] + rho[i] * dot(f.row(i), &b)).collect();
        let change: f64 = next.iter().zip(&b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        let size = next.iter().copied().fold(0.0, f64::max);
        b = next;
        if change <= CONVERGED * size {
            return (b, k);
        }
    }
    (b, MAX_ITERATIONS)
}

/// The same for one after the other, each with the newest values.
pub fn gauss_seidel(f: &FactorMatrix, rho: &[f64], e: &[f64]) -> (Vec<f64>, u32) {
    let mut b = e.to_vec();
    for k in 1..=MAX_ITERATIONS {
        let (mut change, mut size) = (0.0f64, 0.0f64);
        for i in 0..f.n {
            let next = e[i] + rho[i] * dot(f.row(i), &b);
            change = change.max((next - b[i]).abs());
            size = size.max(next);
            b[i] = next;
        }
        if change <= CONVERGED * size {
            return (b, k);
        }
    }
    (b, MAX_ITERATIONS)
}

/// Gaussian elimination of (1 − R F) B = E in blocks of rows. 2 n³ / 3 operations, n² numbers of `f64`.
pub fn eliminate(f: &FactorMatrix, rho: &[f64], e: &[f64]) -> Vec<f64> {
    let n = f.n;
    if n == 0 {
        return Vec::new();
    }
    // The right-hand side is the last column.
    let width = n + 1;
    let mut m = vec![0.0f64; n * width];
    m.par_chunks_mut(width).enumerate().for_each(|(i, row)| {
        for (x, &f) in row.iter_mut().zip(f.row(i)) {
            *x = -rho[i] * f64::from(f);
        }
        row[i] += 1.0;
        row[n] = e[i];
    });
    for begin in (0..n).step_by(BLOCK) {
        let end = (begin + BLOCK).min(n);
        let (above, below) = m.split_at_mut(end * width);
        let block = &mut above[begin * width..];
        // Inside of the block.
        for i in 0..end - begin {
            let (done, rest) = block.split_at_mut((i + 1) * width);
            let pivot = &done[i * width..];
            for row in rest.chunks_mut(width) {
                subtract(row, pivot, begin + i);
            }
        }
        let block = &*block;
        below.par_chunks_mut(width).for_each(|row| {
            for i in 0..end - begin {
                subtract(row, &block[i * width..(i + 1) * width], begin + i);
            }
        });
    }
    let mut b = vec![0.0; n];
    for i in (0..n).rev() {
        let row = &m[i * width..(i + 1) * width];
        let sum: f64 = (i + 1..n).map(|j| row[j] * b[j]).sum();
        b[i] = (row[n] - sum) / row[i];
    }
    b
}

/// Takes a multiple of the pivot's row away that makes the column zero.
fn subtract(row: &mut [f64], pivot: &[f64], column: usize) {
    let factor = row[column] / pivot[column];
    if factor != 0.0 {
        for (x, p) in row[column..].iter_mut().zip(&pivot[column..]) {
            *x -= factor * p;
        }
    }
}
