//! Radiosity: the balance of light between diffuse surfaces, solved once and seen from everywhere.
//!
//! Surfaces are cut into elements of constant radiosity B = E + ρ H (W·m⁻²), where the irradiance H = F B + D is what comes from other
//! elements, by form factors, and from lights that are no surfaces. Three solvers: [`matrix`] (all factors at once),
//! [`progressive`] (the brightest patch shoots first) and [`hierarchical`] (links between nodes of a hierarchy; the default). What
//! they leave becomes a [`Solution`], which answers for the irradiance at any surface point.
//!
//! When not to use it: mirrors, glass and gloss are taken for diffuse (or, where light passes, for clear), and what is smaller than
//! the smallest elements is blurred. See `docs/theory/radiosity.md`.

mod bodies;
pub mod direct;
pub mod exchange;
pub mod face;
pub mod form_factor;
pub mod hemicube;
pub mod hierarchical;
pub mod local;
pub mod material;
pub mod matrix;
pub mod mesh;
pub mod progressive;
pub mod reconstruct;
mod report;
pub mod shapes;

use etendue_scene::RenderSettings;

use crate::integrator::Stage;
use crate::lightmap::SurfaceLight;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;
use direct::DirectLights;
use exchange::Solved;
use face::Faces;
use mesh::Mesh;
use reconstruct::Smooth;

/// How the balance is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// All form factors and a linear system.
    Matrix,
    /// Shooting by unshot light.
    Progressive,
    /// Links in a hierarchy.
    #[default]
    Hierarchical,
}

/// How form factors of elements are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FormFactors {
    /// The exact factor of points to polygons, times the share of rays that pass.
    #[default]
    Rays,
    /// Items on half a cube.
    Hemicube,
}

/// How the linear system is solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solver {
    /// Gaussian elimination.
    Direct,
    /// Iteration with the newest values.
    #[default]
    GaussSeidel,
    /// Iteration with all values of the last round.
    Jacobi,
}

/// How the solution is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Display {
    /// Linear between vertices.
    #[default]
    Smooth,
    /// Elements as they are.
    Elements,
    /// Elements with their edges.
    Mesh,
}

/// What must not be exceeded.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Most elements.
    pub elements: usize,
    /// Most links.
    pub links: usize,
}

/// All settings.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Method.
    pub method: Method,
    /// Form factors of `matrix` and `progressive`.
    pub form_factors: FormFactors,
    /// Solver of `matrix`.
    pub solver: Solver,
    /// Error of a link of `hierarchical`, and of direct light over an element.
    pub error: f32,
    /// Limits.
    pub limits: Limits,
    /// Rays of each element in the [`local`] pass; 0 for none, `None` for as many as are worth it.
    pub rays: Option<u32>,
    /// Edge of a hemicube's top in pixels.
    pub hemicube: u32,
    /// The share of all light that `progressive` may leave unshot.
    pub unshot: f64,
    /// Selects the random numbers.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: Method::default(),
            form_factors: FormFactors::default(),
            solver: Solver::default(),
            error: DEFAULT_ERROR,
            limits: Limits { elements: DEFAULT_ELEMENTS, links: DEFAULT_LINKS },
            rays: None,
            hemicube: 256,
            unshot: 1e-3,
            seed: 0,
        }
    }
}

/// Elements that the local pass subdivides to where a solver has fewer.
pub const LOCAL_ELEMENTS: usize = 100_000;
/// Elements that it may add at least: a scene of many small triangles has shadows as well.
pub const ADDED_ELEMENTS: usize = 70_000;
/// Elements of the local pass for each element that `matrix` and `progressive` may have.
pub const LOCAL_PARTS: usize = 32;
/// Error of links where the user gives none.
pub const DEFAULT_ERROR: f32 = 2e-3;
/// Most elements of the hierarchical method.
pub const DEFAULT_ELEMENTS: usize = 2_000_000;
/// Most links.
pub const DEFAULT_LINKS: usize = 60_000_000;
/// Elements of the matrix method where the user gives no number; memory grows with the square.
pub const DEFAULT_MATRIX_ELEMENTS: usize = 3000;
/// More than this many elements make a matrix of more than 4 GiB.
pub const MAX_MATRIX_ELEMENTS: usize = 20_000;
/// Elements of progressive refinement where the user gives no number.
pub const DEFAULT_PROGRESSIVE_ELEMENTS: usize = 6000;

impl Settings {
    /// From the user's settings.
    ///
    /// # Errors
    /// A sentence where a name is unknown or a number is not possible.
    pub fn new(s: &RenderSettings) -> Result<Self, String> {
        let unknown = |what: &str, name: &str, names: &str| Err(format!("no {what} `{name}`; there are {names}"));
        let method = match s.radiosity_method.as_deref() {
            None | Some("hierarchical") => Method::Hierarchical,
            Some("progressive") => Method::Progressive,
            Some("matrix") => Method::Matrix,
            Some(name) => return unknown("radiosity method", name, "hierarchical, progressive, matrix"),
        };
        let form_factors = match s.radiosity_form_factors.as_deref() {
            None | Some("rays") => FormFactors::Rays,
            Some("hemicube") if method == Method::Hierarchical => {
                return Err(
                    "hierarchical radiosity finds form factors by rays; hemicubes are for the methods progressive and matrix".into()
                );
            }
            Some("hemicube") => FormFactors::Hemicube,
            Some(name) => return unknown("way to form factors", name, "rays, hemicube"),
        };
        let solver = match s.radiosity_solver.as_deref() {
            None | Some("gauss-seidel") => Solver::GaussSeidel,
            Some("jacobi") => Solver::Jacobi,
            Some("direct") => Solver::Direct,
            Some(name) => return unknown("radiosity solver", name, "gauss-seidel, jacobi, direct"),
        };
        let default = Self::default();
        let error = s.radiosity_error.unwrap_or(default.error);
        if !(error > 0.0) {
            return Err(format!("radiosity: an error of {error} cannot be reached; it has to be above 0"));
        }
        let elements = s.radiosity_elements.map_or(
            match method {
                Method::Hierarchical => DEFAULT_ELEMENTS,
                Method::Progressive => DEFAULT_PROGRESSIVE_ELEMENTS,
                Method::Matrix => DEFAULT_MATRIX_ELEMENTS,
            },
            |n| n as usize,
        );
        if method == Method::Matrix && elements > MAX_MATRIX_ELEMENTS {
            return Err(format!(
                "radiosity: a matrix of {elements}² form factors is too large; at most {MAX_MATRIX_ELEMENTS} elements (hierarchical takes more)"
            ));
        }
        let links = s.radiosity_links.map_or(DEFAULT_LINKS, |n| n as usize);
        let limits = Limits { elements, links };
        Ok(Self { method, form_factors, solver, error, limits, rays: s.radiosity_rays, seed: s.seed, ..default })
    }
}

/// Whom the solvers tell how far they are.
pub struct Progress<'a>(Option<&'a Stage<'a>>);

impl<'a> Progress<'a> {
    /// Tells a stage.
    pub fn new(stage: &'a Stage<'a>) -> Self {
        Self(Some(stage))
    }

    /// Tells nobody.
    pub fn silent() -> Self {
        Self(None)
    }

    fn is_cancelled(&self) -> bool {
        self.0.is_some_and(|s| (s.is_cancelled)())
    }

    fn tell(&self, what: &str, fraction: f64) {
        if let Some(s) = self.0 {
            (s.progress)(what, fraction);
        }
    }
}

/// The faces of a scene as a hierarchy, cut into elements for the methods that need them beforehand.
///
/// # Errors
/// A sentence where the scene has more triangles than elements are allowed, or no surface.
pub fn build_mesh(scene: &Scene, settings: &Settings, lights: &DirectLights, progress: &Progress) -> Result<(Mesh, Vec<String>), String> {
    if scene.classic.is_some() {
        return Err("radiosity cannot render scenes of POV-Ray's model yet".into());
    }
    let faces = Faces::new(scene, settings.limits.elements)?;
    let mut notes = report::of_faces(&faces);
    let mut mesh = Mesh::new(scene, faces);
    if mesh.nodes.is_empty() {
        notes.push("the scene has no surfaces: there is nothing to light".into());
        return Ok((mesh, notes));
    }
    let limit = settings.limits.elements;
    if settings.method == Method::Hierarchical {
        if lights.subdivide(scene, &mut mesh, 8.0 * settings.error, limit / 2) {
            notes.push(format!("shadow edges are not followed to the end: --radiosity-elements allows {limit}"));
        }
        return Ok((mesh, notes));
    }
    // Evenly first, as far as faces see something; the rest of the limit goes to where a coarse hierarchical solution finds that light
    // changes: to shadow edges.
    let counts = mesh.faces_that_see(scene);
    let area: f64 =
        mesh.faces.faces.iter().zip(&counts).filter(|(_, c)| **c).map(|(f, _)| f64::from(form_factor::area_of(&f.corners))).sum();
    let mut area = (area / (0.4 * limit as f64).max(1.0)) as f32;
    while mesh.subdivide_to(scene, area, limit / 2, &counts) {
        area *= 2.0;
    }
    let mut mesh = adapt(scene, mesh, settings, lights, progress)?;
    lights.subdivide(scene, &mut mesh, 8.0 * settings.error, limit);
    Ok((mesh, notes))
}

/// Refines a mesh by the hierarchical method with an error that leads to most of the elements that are allowed.
fn adapt(scene: &Scene, mesh: Mesh, settings: &Settings, lights: &DirectLights, progress: &Progress) -> Result<Mesh, String> {
    let limit = settings.limits.elements;
    let mut best = mesh;
    // A mesh is a refinement of the one before, so the error may come down in steps.
    for error in [16.0, 4.0, 1.0, 0.3] {
        let limits = Limits { elements: limit, links: (limit * 200).max(100_000) };
        let options = hierarchical::Options { error: error * DEFAULT_ERROR, limits, seed: settings.seed };
        let solved = hierarchical::solve(scene, best, lights, &options, progress)?;
        best = solved.mesh;
        if best.leaf_count() as f64 > 0.85 * limit as f64 || progress.is_cancelled() {
            break;
        }
    }
    Ok(best)
}

/// Light on the surfaces of a scene.
pub struct Solution {
    /// The mesh with its light.
    pub solved: Solved,
    smooth: Smooth,
    lights: DirectLights,
    display: Display,
    /// Sentences for the user.
    pub notes: Vec<String>,
}

/// Solves a scene.
///
/// # Errors
/// A sentence where the scene is not possible with these settings.
pub fn solve(scene: &Scene, settings: &Settings, display: Display, progress: &Progress) -> Result<Solution, String> {
    let lights = DirectLights::new(scene, settings.seed);
    progress.tell("elements", 0.0);
    let (mesh, mut notes) = build_mesh(scene, settings, &lights, progress)?;
    let (seed, form_factors, hemicube) = (settings.seed, settings.form_factors, settings.hemicube);
    let mut solved = match settings.method {
        Method::Matrix => {
            matrix::solve(scene, mesh, &lights, &matrix::Options { form_factors, solver: settings.solver, hemicube, seed }, progress)
        }
        Method::Progressive => {
            let max_shots = 4 * settings.limits.elements;
            let options = progressive::Options { form_factors, unshot: settings.unshot, max_shots, hemicube, patch: 16.0, seed };
            progressive::solve(scene, mesh, &lights, &options, progress)
        }
        Method::Hierarchical => {
            let options = hierarchical::Options { error: settings.error, limits: settings.limits, seed };
            hierarchical::solve(scene, mesh, &lights, &options, progress)?
        }
    };
    notes.append(&mut solved.notes);
    // The coarse patches of the methods that know all pairs get light more finely than they send it.
    let finer = if settings.method == Method::Hierarchical { 1 } else { LOCAL_PARTS };
    let elements = (finer * settings.limits.elements).min(LOCAL_ELEMENTS.max(solved.mesh.leaf_count() + ADDED_ELEMENTS));
    let options = local::Options { rays: settings.rays, elements, seed };
    notes.extend(local::refine(scene, &lights, &mut solved, &options, progress));
    notes.extend(report::of_solution(&solved));
    let smooth = interpolated(scene, &lights, &mut solved);
    Ok(Solution { solved, smooth, lights, display, notes })
}

/// What is linear between vertices: all light but that of lights without a size, which is found anew at each point.
fn interpolated(scene: &Scene, lights: &DirectLights, solved: &mut Solved) -> Smooth {
    let leaves = solved.mesh.leaves();
    solved.exact = vec![Spectrum::ZERO; solved.mesh.nodes.len()];
    for (&i, e) in leaves.iter().zip(lights.irradiance_of_exact(scene, &solved.mesh, &leaves)) {
        // As the local pass counts it.
        let outside = solved.outside.get(i as usize).copied().unwrap_or(1.0);
        solved.exact[i as usize] = if outside > 0.0 { e / outside } else { Spectrum::ZERO };
    }
    let exchange = |solved: &mut Solved, sign: f32| {
        solved.irradiance.iter_mut().zip(&solved.exact).for_each(|(h, e)| *h = (*h + *e * sign).map(|v| v.max(0.0)));
    };
    exchange(solved, -1.0);
    let smooth = Smooth::new(scene, solved, reconstruct::CORRECTIONS);
    exchange(solved, 1.0);
    smooth
}

impl Solution {
    /// The element at a surface point, on the side of the shading normal, with the barycentric weights there.
    #[inline]
    pub fn element(&self, scene: &Scene, surface: &Surface) -> Option<(u32, glam::Vec3)> {
        let (face, b) = self.solved.mesh.faces.locate(scene, surface)?;
        Some(self.solved.mesh.descend(face, b))
    }

    /// Whether a surface point is on the edge of an element, for the picture of the mesh: nearer than 1/40 of the element's size.
    fn is_edge(&self, b: glam::Vec3) -> bool {
        self.display == Display::Mesh && b.min_element() < 0.04
    }
}

impl SurfaceLight for Solution {
    fn irradiance(&self, scene: &Scene, surface: &Surface) -> Spectrum {
        let Some((leaf, b)) = self.element(scene, surface) else { return Spectrum::ZERO };
        match self.display {
            Display::Smooth => self.smooth.at(leaf, b) + self.lights.exact(scene, surface),
            _ if self.is_edge(b) => Spectrum::ZERO,
            _ => self.solved.irradiance[leaf as usize],
        }
    }
}
