//! The list of primitives: which shape of the description becomes which primitive.

use std::collections::HashMap;
use std::sync::Arc;

use etendue_procedural::{Images, Texture};
use etendue_scene::desc::classic::Solid;
use glam::{DAffine3, DMat3, DVec2, DVec3};

use super::cone::Cone;
use super::cuboid::Cuboid;
use super::disc::Disc;
use super::plane::Plane;
use super::sphere::Sphere;
use super::triangle::Triangle;
use super::{Bounds, Crossing, Line, Primitive};

/// Primitives: frequent small ones in place, all others shared.
#[derive(Clone)]
pub(super) enum Shape {
    Sphere(Sphere),
    Cuboid(Cuboid),
    Cone(Cone),
    Plane(Plane),
    Disc(Disc),
    Triangle(Triangle),
    Other(Arc<dyn Primitive>),
}

macro_rules! each {
    ($shape:expr, $p:ident => $call:expr) => {
        match $shape {
            Self::Sphere($p) => $call,
            Self::Cuboid($p) => $call,
            Self::Cone($p) => $call,
            Self::Plane($p) => $call,
            Self::Disc($p) => $call,
            Self::Triangle($p) => $call,
            Self::Other($p) => $call,
        }
    };
}

impl Primitive for Shape {
    fn bounds(&self) -> Bounds {
        each!(self, p => p.bounds())
    }
    #[inline]
    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        each!(self, p => p.crossings(line, t_min, t_max, out));
    }
    #[inline]
    fn inside(&self, point: DVec3) -> bool {
        each!(self, p => p.inside(point))
    }
    fn normal(&self, point: DVec3, crossing: &Crossing) -> DVec3 {
        each!(self, p => p.normal(point, crossing))
    }
    fn uv(&self, point: DVec3, crossing: &Crossing) -> DVec2 {
        each!(self, p => p.uv(point, crossing))
    }
    #[inline]
    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, scratch: &mut Vec<Crossing>) -> Option<Crossing> {
        each!(self, p => p.nearest(line, t_min, t_max, scratch))
    }
    fn inside_bounds(&self) -> Bounds {
        each!(self, p => p.inside_bounds())
    }
    fn geometric_normal(&self, point: DVec3, crossing: &Crossing) -> DVec3 {
        each!(self, p => p.geometric_normal(point, crossing))
    }
    fn own_textures(&self) -> Vec<Arc<Texture>> {
        each!(self, p => p.own_textures())
    }
    fn part_textures(&self, point: DVec3, crossing: &Crossing, visit: &mut dyn FnMut(f64, Option<usize>)) {
        each!(self, p => p.part_textures(point, crossing, visit));
    }
}

impl Shape {
    /// The box of its image under a transform.
    pub(super) fn extent(&self, m: &DAffine3) -> Bounds {
        match self {
            Self::Sphere(s) => s.extent(m),
            other => other.bounds().transformed(m),
        }
    }

    /// The shape moved to world space where it stays of its kind, and whether it did; otherwise lines are moved to its own space.
    pub(super) fn placed(self, m: &DAffine3) -> (Self, bool) {
        if *m == DAffine3::IDENTITY {
            return (self, true);
        }
        let moved = match &self {
            Self::Plane(p) => p.moved(m).map(Self::Plane),
            Self::Triangle(t) => t.moved(m).map(Self::Triangle),
            Self::Cone(c) => c.moved(m).map(Self::Cone),
            _ => None,
        };
        if let Some(moved) = moved {
            return (moved, true);
        }
        let scale = DVec3::new(m.matrix3.x_axis.x, m.matrix3.y_axis.y, m.matrix3.z_axis.z);
        // Positive scales only, so that surface coordinates and normals stay what they are.
        if m.matrix3 != DMat3::from_diagonal(scale) || !(scale.min_element() > 0.0) {
            return (self, false);
        }
        let moved = match &self {
            Self::Sphere(s) if scale.x == scale.y && scale.x == scale.z => Self::Sphere(s.scaled(scale.x, m.translation)),
            Self::Cuboid(c) => Self::Cuboid(c.scaled(scale, m.translation)),
            _ => return (self, false),
        };
        (moved, true)
    }
}

/// Makes primitives; those of shared data are made once.
pub(super) struct Compiler<'a> {
    images: Option<&'a dyn Images>,
    /// By the address of the data, which the description keeps alive.
    shared: HashMap<usize, Option<Arc<dyn Primitive>>>,
}

impl<'a> Compiler<'a> {
    pub(super) fn new(images: Option<&'a dyn Images>) -> Self {
        Self { images, shared: HashMap::new() }
    }

    /// The primitive of a shape; `None` for those that have no surface (degenerate numbers) and for combinations and lights.
    pub(super) fn shape(&mut self, solid: &Solid) -> Option<Shape> {
        Some(match solid {
            Solid::Sphere { center, radius } => Shape::Sphere(Sphere::new(*center, *radius)?),
            Solid::Box { corners } => Shape::Cuboid(Cuboid::new(*corners)?),
            Solid::Cone { base, base_radius, cap, cap_radius, open } => {
                Shape::Cone(Cone::new(*base, *base_radius, *cap, *cap_radius, *open)?)
            }
            Solid::Cylinder { base, cap, radius, open } => Shape::Cone(Cone::new(*base, *radius, *cap, *radius, *open)?),
            Solid::Plane { normal, distance } => Shape::Plane(Plane::new(*normal, *distance)?),
            Solid::Disc { center, normal, radius, hole_radius } => Shape::Disc(Disc::new(*center, *normal, *radius, *hole_radius)?),
            Solid::Triangle(t) => Shape::Triangle(Triangle::new(t)?),
            _ => Shape::Other(self.other(solid)?),
        })
    }

    fn other(&mut self, solid: &Solid) -> Option<Arc<dyn Primitive>> {
        let address = match solid {
            Solid::Polygon(data) => Arc::as_ptr(data) as usize,
            Solid::Mesh(data) => Arc::as_ptr(data) as usize,
            Solid::Blob(data) => Arc::as_ptr(data) as usize,
            Solid::Prism(data) => Arc::as_ptr(data) as usize,
            Solid::HeightField(data) => Arc::as_ptr(data) as usize,
            Solid::BicubicPatch(data) => Arc::as_ptr(data) as usize,
            Solid::JuliaFractal(data) => Arc::as_ptr(data) as usize,
            Solid::SphereSweep(data) => Arc::as_ptr(data) as usize,
            Solid::Text(data) => Arc::as_ptr(data) as usize,
            Solid::Parametric(data) => Arc::as_ptr(data) as usize,
            _ => return self.make(solid),
        };
        if let Some(made) = self.shared.get(&address) {
            return made.clone();
        }
        let made = self.make(solid);
        self.shared.insert(address, made.clone());
        made
    }

    fn make(&self, solid: &Solid) -> Option<Arc<dyn Primitive>> {
        match solid {
            Solid::Torus { major, minor } => shared(super::torus::Torus::new(*major, *minor)),
            Solid::Polygon(points) => shared(super::polygon::Polygon::new(points)),
            Solid::Mesh(mesh) => shared(super::mesh::Mesh::new(mesh)),
            Solid::Quadric { squares, mixed, linear, constant } => {
                shared(super::quadric::Quadric::new(*squares, *mixed, *linear, *constant))
            }
            Solid::Text(text) => shared(super::text::Text::new(text)),
            Solid::Isosurface(iso) => shared(super::isosurface::Isosurface::new(iso)),
            Solid::Parametric(surface) => shared(super::parametric::Parametric::new(surface)),
            _ => super::advanced::make(solid, self.images),
        }
    }
}

fn shared<P: Primitive + 'static>(made: Option<P>) -> Option<Arc<dyn Primitive>> {
    made.map(|p| Arc::new(p) as Arc<dyn Primitive>)
}
