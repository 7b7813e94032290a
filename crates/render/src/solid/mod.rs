//! Exact solids in double precision: every shape of the classic model, and constructive combinations of them.
//!
//! A solid answers four questions: where a line crosses its surface (all crossings, so that combinations and shadows through
//! transparent things can be told), whether a point is inside, its normal, and its surface coordinates. [`World`] holds all objects of a scene in a
//! hierarchy of boxes.
//!
//! ```text
//! objects ─tree→ leaves (what is inherited filled in, placed in world space) under nodes (union, intersection, merge) ─bvh→ World
//! ```

mod advanced;
pub mod bicubic_patch;
pub mod blob;
mod bounds;
mod bvh;
mod compile;
mod cone;
mod container;
mod contour;
mod cuboid;
pub mod curve;
mod disc;
pub mod facets;
pub mod height_field;
mod hypercomplex;
pub mod isosurface;
pub mod julia;
pub mod lathe;
#[cfg(test)]
mod measured;
mod mesh;
mod outlook;
pub mod ovus;
pub mod parametric;
mod plane;
pub mod poly;
mod polygon;
pub mod prism;
mod probe;
mod quadric;
pub mod roots;
pub mod sor;
mod sphere;
pub mod sphere_sweep;
pub mod superellipsoid;
pub mod tessellate;
mod text;
mod torus;
mod trace;
mod tree;
mod triangle;
mod world;

#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;

pub use bounds::Bounds;
pub use facets::Facet;
pub use outlook::Outlook;
pub use probe::WorldProbe;
pub use world::{PhotonTarget, World};

use std::sync::Arc;

use etendue_procedural::Texture;
use etendue_scene::desc::classic::Object;
use glam::{DVec2, DVec3};

/// A line with a direction, in double precision; `t` is in units of the direction's length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Origin.
    pub o: DVec3,
    /// Direction, not necessarily unit in a solid's own space.
    pub d: DVec3,
}

impl Line {
    /// The point at `t`.
    #[inline]
    pub fn at(&self, t: f64) -> DVec3 {
        self.o + self.d * t
    }
}

/// Where a line crosses the surface of a primitive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Line parameter.
    pub t: f64,
    /// Which part of the surface (face, segment, triangle …): the primitive's own number.
    pub part: u32,
    /// Surface parameters that the primitive wants to keep for its normal (barycentrics, curve parameter …).
    pub uv: DVec2,
}

impl Crossing {
    /// A crossing with a part that needs no parameters.
    #[inline]
    pub fn new(t: f64, part: u32) -> Self {
        Self { t, part, uv: DVec2::ZERO }
    }
}

/// What shapes without surface coordinates give; hits then have x and y of the point in world space, as measured from POV-Ray.
pub const NO_UV: DVec2 = DVec2::NAN;

/// A shape in its own space.
pub trait Primitive: Send + Sync {
    /// A box that holds its surface (and its inside, where that is bounded); infinite for unbounded shapes.
    fn bounds(&self) -> Bounds;
    /// Pushes all crossings with `t_min` < t < `t_max`, in any order. Solids must report both ends of every interval inside.
    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>);
    /// Whether a point is inside; always false for shapes without inside (triangle, mesh without `inside_vector`, …).
    fn inside(&self, p: DVec3) -> bool;
    /// The unit normal at a crossing, to the outside (for surfaces without inside: as POV-Ray's).
    fn normal(&self, p: DVec3, crossing: &Crossing) -> DVec3;
    /// Surface coordinates at a crossing, for `uv_mapping`; [`NO_UV`] where the shape has none.
    fn uv(&self, p: DVec3, crossing: &Crossing) -> DVec2;

    /// The nearest crossing with `t_min` < t < `t_max`. `scratch` may be used and is left as it was found.
    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, scratch: &mut Vec<Crossing>) -> Option<Crossing> {
        let start = scratch.len();
        self.crossings(line, t_min, t_max, scratch);
        let nearest = scratch[start..].iter().copied().min_by(|a, b| a.t.total_cmp(&b.t));
        scratch.truncate(start);
        nearest
    }
    /// A box that holds the inside; differs from [`Primitive::bounds`] where the inside goes on beyond the surface (discs).
    fn inside_bounds(&self) -> Bounds {
        self.bounds()
    }
    /// The unit normal of the true surface on the side of [`Primitive::normal`]; differs on smooth triangles.
    fn geometric_normal(&self, p: DVec3, crossing: &Crossing) -> DVec3 {
        self.normal(p, crossing)
    }
    /// Triangles of the surface, with so many segments to a full circle; of unbounded shapes within a box. `None`: they are found by
    /// asking for the inside ([`contour`]).
    fn facets(&self, segments: usize, within: &Bounds) -> Option<Vec<Facet>> {
        let _ = (segments, within);
        None
    }
    /// Textures of its own parts (triangles, blob components) in the solid's space; those of [`Primitive::part_textures`] by index.
    fn own_textures(&self) -> Vec<Arc<Texture>> {
        Vec::new()
    }
    /// Visits the textures at a crossing with their weights (sum 1): an index of [`Primitive::own_textures`], or `None` for the
    /// object's. Called only where there are own textures.
    fn part_textures(&self, p: DVec3, crossing: &Crossing, visit: &mut dyn FnMut(f64, Option<usize>)) {
        let _ = (p, crossing);
        visit(1.0, None);
    }
}

/// A hit in world space.
#[derive(Clone, Debug)]
pub struct SolidHit<'a> {
    /// Distance along the unit direction.
    pub t: f64,
    /// The point.
    pub p: DVec3,
    /// Unit normal of the surface, to the outside of the whole object (turned by inverses and differences).
    pub n: DVec3,
    /// Surface coordinates where the textures use them; see [`World::uv`].
    pub uv: DVec2,
    /// The part whose texture and interior count: the leaf, with what it inherits from its parents already filled in.
    pub object: &'a Object,
    /// Number of the leaf, the same for all hits of one leaf.
    pub leaf: u32,
    /// Number of the top-level object that the leaf is of.
    pub whole: u32,
    /// Where on the primitive, in its own terms.
    pub(crate) crossing: Crossing,
}

/// Which rays see an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RayKind {
    /// From the camera, and what goes on from it through transparent things: `no_image` objects are not there.
    Camera,
    /// Mirrored: `no_reflection` objects are not there.
    Reflection,
    /// To a light: `no_shadow` objects are not there.
    Shadow,
    /// Of radiosity: `no_radiosity` objects are not there.
    Radiosity,
    /// Of photons: everything is there.
    Photon,
}
