//! Progressive refinement (Cohen, Chen, Wallace and Greenberg 1988, "A Progressive Refinement Approach to Fast Radiosity Image
//! Generation", doi:10.1145/54852.378487).
//!
//! The patch with the most light that it has not sent yet shoots it at all elements; so the brightest light is spread first and a
//! picture is there early. What is still unshot at the end is spread evenly: the paper's ambient term. Patches that shoot are coarser
//! than elements that receive (Cohen, Greenberg, Immel and Brock 1986, "An Efficient Radiosity Approach for Realistic Image Synthesis",
//! doi:10.1109/MCG.1986.276629).

use rayon::prelude::*;

use super::direct::DirectLights;
use super::exchange::{Factors, Solved};
use super::hemicube::{Hemicube, Item};
use super::mesh::Mesh;
use super::{FormFactors, Progress};
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// Settings of the method.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// How factors are found.
    pub form_factors: FormFactors,
    /// The share of all light that may stay unshot.
    pub unshot: f64,
    /// Most shots.
    pub max_shots: usize,
    /// Edge of a hemicube's top in pixels.
    pub hemicube: u32,
    /// Area of the largest patch over that of the mean element.
    pub patch: f32,
    /// Random numbers.
    pub seed: u64,
}

/// Solves on the leaves of a mesh.
pub fn solve(scene: &Scene, mesh: Mesh, lights: &DirectLights, options: &Options, progress: &Progress) -> Solved {
    let count = mesh.nodes.len();
    let leaves = mesh.leaves();
    let mut direct = vec![Spectrum::ZERO; count];
    for (&i, d) in leaves.iter().zip(lights.irradiance(scene, &mesh, &leaves)) {
        direct[i as usize] = d;
    }
    let mean_area = mesh.area / leaves.len().max(1) as f32;
    let patches = Patches::new(&mesh, &leaves, mean_area * options.patch);
    let mut irradiance = direct.clone();
    // Unshot radiosity of the leaves.
    let mut unshot: Vec<Spectrum> = vec![Spectrum::ZERO; count];
    for &i in &leaves {
        let n = &mesh.nodes[i as usize];
        unshot[i as usize] = n.emission + n.reflectance * direct[i as usize];
    }
    let first = total(&mesh, &leaves, &unshot);
    let hemicube = (options.form_factors == FormFactors::Hemicube).then(|| Hemicube::new(options.hemicube));
    let items: Vec<Item> = if hemicube.is_some() { super::hemicube::items(&mesh, &leaves) } else { Vec::new() };
    let mut shots = 0;
    let mut power: Vec<f64> = (0..patches.patches.len()).map(|p| patches.power(&mesh, p, &unshot)).collect();
    while shots < options.max_shots && !progress.is_cancelled() {
        // The first of the brightest: ties must not depend on anything.
        let Some((p, most)) = power.iter().copied().enumerate().fold(None, |best: Option<(usize, f64)>, (i, w)| match best {
            Some((_, b)) if b >= w => best,
            _ => Some((i, w)),
        }) else {
            break;
        };
        let left: f64 = power.iter().sum();
        if !(most > 0.0) || left <= options.unshot * first {
            break;
        }
        if shots % 16 == 0 {
            progress.tell("radiosity", 1.0 - (left / first.max(1e-300)).min(1.0));
        }
        let source = patches.patches[p];
        // Of nodes that are no leaves only the one that shoots needs a value: its mean.
        unshot[source as usize] = patches.mean(&mesh, p, &unshot);
        let factors: Vec<f32> = match &hemicube {
            None => {
                let f = Factors { scene, mesh: &mesh, seed: options.seed };
                leaves.par_iter().map(|&r| f.elements(r, source, &unshot)).collect()
            }
            Some(cube) => {
                // The share of the source's view, turned round by Aᵢ Fᵢⱼ = Aⱼ Fⱼᵢ.
                let (node, mut of_source) = (&mesh.nodes[source as usize], vec![0.0f32; leaves.len()]);
                cube.factors(node.center, mesh.face(node).normal, &items, &mut of_source);
                of_source.iter().zip(&leaves).map(|(f, &r)| (f * node.area / mesh.nodes[r as usize].area).min(1.0)).collect()
            }
        };
        let sent = unshot[source as usize];
        unshot[source as usize] = Spectrum::ZERO;
        patches.leaves[p].iter().for_each(|&i| unshot[i as usize] = Spectrum::ZERO);
        for (&r, f) in leaves.iter().zip(factors) {
            if f > 0.0 {
                let i = r as usize;
                let e = sent * f;
                irradiance[i] += e;
                unshot[i] += mesh.nodes[i].reflectance * e;
            }
        }
        power.par_iter_mut().enumerate().for_each(|(p, w)| *w = patches.power(&mesh, p, &unshot));
        shots += 1;
    }
    let left: f64 = power.iter().sum();
    let ambient = ambient(&mesh, &leaves, &unshot);
    let mut radiosity = vec![Spectrum::ZERO; count];
    for &i in &leaves {
        let i = i as usize;
        irradiance[i] += ambient;
        radiosity[i] = mesh.nodes[i].emission + mesh.nodes[i].reflectance * irradiance[i];
    }
    mesh.pull(&mut radiosity);
    let share = if first > 0.0 { 100.0 * left / first } else { 0.0 };
    let note = format!(
        "progressive: {} faces, {} elements, {} patches, {shots} shots; {share:.3} % of the first light is unshot and spread as ambient light",
        mesh.face_nodes.len(),
        leaves.len(),
        patches.patches.len()
    );
    Solved { mesh, direct, irradiance, radiosity, notes: vec![note], ..Solved::default() }
}

fn total(mesh: &Mesh, leaves: &[u32], values: &[Spectrum]) -> f64 {
    leaves.iter().map(|&i| f64::from(values[i as usize].average()) * f64::from(mesh.nodes[i as usize].area)).sum()
}

/// The paper's ambient irradiance: the mean unshot radiosity times 1 / (1 − mean reflectance), its equations 12 and 13. The mean is over
/// the surfaces that reflect.
fn ambient(mesh: &Mesh, leaves: &[u32], unshot: &[Spectrum]) -> Spectrum {
    let (mut area, mut rho, mut light) = (0.0f64, [0.0f64; 4], [0.0f64; 4]);
    for &i in leaves {
        let n = &mesh.nodes[i as usize];
        let a = f64::from(n.area);
        area += a;
        for c in 0..4 {
            rho[c] += f64::from(n.reflectance.0[c]) * a;
            light[c] += f64::from(unshot[i as usize].0[c]) * a;
        }
    }
    if !(area > 0.0) {
        return Spectrum::ZERO;
    }
    Spectrum(std::array::from_fn(|c| (light[c] / area / (1.0 - (rho[c] / area).min(0.99))) as f32))
}

/// The nodes that shoot: the largest ancestors of leaves that are no larger than an area.
struct Patches {
    patches: Vec<u32>,
    /// Leaves of each patch.
    leaves: Vec<Vec<u32>>,
}

impl Patches {
    fn new(mesh: &Mesh, leaves: &[u32], area: f32) -> Self {
        let mut of_node = std::collections::BTreeMap::<u32, Vec<u32>>::new();
        for &leaf in leaves {
            let mut at = leaf;
            loop {
                let n = &mesh.nodes[at as usize];
                if n.level == 0 || mesh.nodes[n.parent as usize].area > area {
                    break;
                }
                at = n.parent;
            }
            of_node.entry(at).or_default().push(leaf);
        }
        let (patches, leaves) = of_node.into_iter().unzip();
        Self { patches, leaves }
    }

    /// Unshot flux in W, mean of the colors.
    fn power(&self, mesh: &Mesh, p: usize, unshot: &[Spectrum]) -> f64 {
        total(mesh, &self.leaves[p], unshot)
    }

    /// Mean unshot radiosity.
    fn mean(&self, mesh: &Mesh, p: usize, unshot: &[Spectrum]) -> Spectrum {
        let (mut sum, mut area) = (Spectrum::ZERO, 0.0);
        for &i in &self.leaves[p] {
            let a = mesh.nodes[i as usize].area;
            sum += unshot[i as usize] * a;
            area += a;
        }
        if area > 0.0 { sum / area } else { Spectrum::ZERO }
    }
}
