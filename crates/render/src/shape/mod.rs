//! Exact analytic shapes: intersection, bounds, surface geometry, and sampling by area and by solid angle.
//!
//! Conventions of every shape:
//! - a shape is in world space (or its instance's object space) and carries its own transform where it needs one;
//! - constructors return `None` for what is no surface: singular transforms, numbers that are not finite, no extent;
//! - `intersect` returns the nearest hit with `t_min` < t < `t_max` and the shape's own parameters `u`, `v`;
//! - `surface` takes the hit's point (`ray.at(t)`), moves it onto the surface to within a few units in the last place of the
//!   largest coordinate, and returns the differential geometry there;
//! - a ray that starts on the surface may meet it again at a t of about that size: the caller offsets the origin along
//!   `ng` by a few ulps of the position (plus the shape's extent), and no false hit is left;
//! - `ng` is unit. Without `flip_normals` it is that of the outside (sphere, cylinder) or local +z (the flat shapes).
//!   Where the transform mirrors, a sphere's normal turns inwards and a rectangle's is `dpdu` × `dpdv`, while disk and
//!   cylinder keep theirs, all as in Mitsuba 3.9;
//! - samples are uniform in what their `pdf` says: by area for `sample_area`, per solid angle at the reference point for
//!   `sample_solid_angle`. `pdf_solid_angle` is the density of the latter for a point on the surface that it sees.
//!
//! Solid angles of polygons are computed in `f64`: as sums of angles less 2π they lose all digits of an `f32` when small.

mod affine;
pub mod cylinder;
pub mod disk;
mod planar;
pub mod plane;
pub mod polygon;
pub mod rectangle;
pub mod sphere;
mod tessellate;
pub mod triangle;

pub use cylinder::Cylinder;
pub use disk::Disk;
pub use plane::Plane;
pub use polygon::Polygon;
pub use rectangle::Rectangle;
pub use sphere::Sphere;
pub use tessellate::Tessellation;

use etendue_scene::desc::GeometryDesc;

use crate::accel::Ray;
use crate::math::{Aabb, Mat4, Vec2, Vec3};

/// Where a ray meets a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeHit {
    /// Ray parameter.
    pub t: f32,
    /// First surface parameter of the shape at the hit, in [0, 1] but for planes and polygons.
    pub u: f32,
    /// Second surface parameter.
    pub v: f32,
}

/// Differential geometry at a point of a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceGeometry {
    /// The point, on the surface.
    pub p: Vec3,
    /// Geometric normal, unit.
    pub ng: Vec3,
    /// Surface parameters; texture coordinates.
    pub uv: Vec2,
    /// Derivative of the point by u; never zero.
    pub dpdu: Vec3,
    /// Derivative of the point by v; never zero.
    pub dpdv: Vec3,
    /// Derivative of the normal by u.
    pub dndu: Vec3,
    /// Derivative of the normal by v.
    pub dndv: Vec3,
}

/// A sampled point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaSample {
    /// The point.
    pub p: Vec3,
    /// Geometric normal, unit.
    pub ng: Vec3,
    /// Surface parameters (of a triangle: barycentric coordinates of the second and third vertex).
    pub uv: Vec2,
    /// Density: by area or per solid angle, as the function that made the sample says.
    pub pdf: f32,
}

impl AreaSample {
    /// The sample with its density by area turned into one per solid angle at `ref_p`; `None` where the surface is seen edge-on.
    #[inline]
    pub fn per_solid_angle(self, ref_p: Vec3) -> Option<Self> {
        let pdf = self.pdf * area_to_solid_angle(ref_p, self.p, self.ng);
        (pdf > 0.0 && pdf.is_finite()).then_some(Self { pdf, ..self })
    }
}

/// d² / |cos θ|: the factor from densities by area at `p` to densities per solid angle at `ref_p`. Infinite where seen edge-on.
#[inline]
pub fn area_to_solid_angle(ref_p: Vec3, p: Vec3, ng: Vec3) -> f32 {
    let d = p - ref_p;
    let dist2 = d.length_squared();
    dist2 * dist2.sqrt() / d.dot(ng).abs()
}

/// Whether a flat shape, within a circle about `center` with the given squared radius, is so far from a point that the densities of
/// its directions are about those of its area: then sampling by area is as good as by solid angle, and several times faster.
#[inline]
fn is_far(center: Vec3, radius2: f32, ref_p: Vec3) -> bool {
    (center - ref_p).length_squared() > 8.0 * radius2
}

macro_rules! shapes {
    ($($(#[$doc:meta])* $name:ident),* $(,)?) => {
        /// The closed set of analytic shapes.
        #[derive(Clone, Debug)]
        pub enum Shape {
            $($(#[$doc])* $name($name)),*
        }

        impl Shape {
            /// A box that holds the shape; infinite for unbounded shapes.
            pub fn bounds(&self) -> Aabb {
                match self { $(Self::$name(s) => s.bounds()),* }
            }

            /// The nearest hit in the ray's open interval.
            #[inline]
            pub fn intersect(&self, ray: &Ray) -> Option<ShapeHit> {
                match self { $(Self::$name(s) => s.intersect(ray)),* }
            }

            /// The geometry at the point of the surface that is next to `p`, which is that of a hit.
            #[inline]
            pub fn surface(&self, p: Vec3) -> SurfaceGeometry {
                match self { $(Self::$name(s) => s.surface(p)),* }
            }

            /// Surface area, of one side; infinite for unbounded shapes.
            pub fn area(&self) -> f32 {
                match self { $(Self::$name(s) => s.area()),* }
            }

            /// A point of the surface with its density by area (not constant on ellipsoids); `None` for unbounded shapes.
            #[inline]
            pub fn sample_area(&self, u: Vec2) -> Option<AreaSample> {
                match self { $(Self::$name(s) => s.sample_area(u)),* }
            }

            /// A point of the surface with its density per solid angle at `ref_p`; `None` for unbounded shapes and where
            /// the sample is of no use (seen edge-on).
            #[inline]
            pub fn sample_solid_angle(&self, ref_p: Vec3, u: Vec2) -> Option<AreaSample> {
                match self { $(Self::$name(s) => s.sample_solid_angle(ref_p, u)),* }
            }

            /// The density with which `sample_solid_angle` returns the point `p` with normal `ng` of the surface, seen from `ref_p`.
            #[inline]
            pub fn pdf_solid_angle(&self, ref_p: Vec3, p: Vec3, ng: Vec3) -> f32 {
                match self { $(Self::$name(s) => s.pdf_solid_angle(ref_p, p, ng)),* }
            }
        }
    };
}

shapes! {
    /// A sphere or an ellipsoid.
    Sphere,
    /// A disk or an ellipse.
    Disk,
    /// A rectangle or a parallelogram.
    Rectangle,
    /// An open cylinder.
    Cylinder,
    /// An infinite plane.
    Plane,
    /// A polygon with holes.
    Polygon,
}

impl Shape {
    /// The density by area with which `sample_area` returns the point `p` of the surface; 0 for unbounded shapes.
    pub fn pdf_area(&self, p: Vec3) -> f32 {
        match self {
            Self::Sphere(s) => s.pdf_area(p),
            Self::Cylinder(s) => s.pdf_area(p),
            _ => 1.0 / self.area(),
        }
    }

    /// The analytic shape of a description; `None` for meshes and cubes (which become triangles) and for what is no surface.
    pub fn from_desc(geometry: &GeometryDesc, world_from_object: Mat4, flip_normals: bool) -> Option<Self> {
        let m = world_from_object;
        match geometry {
            GeometryDesc::Mesh { .. } | GeometryDesc::Cube => None,
            GeometryDesc::Sphere { center, radius } => Sphere::from_transform(*center, *radius, m, flip_normals).map(Self::Sphere),
            GeometryDesc::Disk => Disk::from_transform(m, flip_normals).map(Self::Disk),
            GeometryDesc::Rectangle => Rectangle::from_transform(m, flip_normals).map(Self::Rectangle),
            GeometryDesc::Cylinder { p0, p1, radius } => Cylinder::from_transform(*p0, *p1, *radius, m, flip_normals).map(Self::Cylinder),
            GeometryDesc::Plane => Plane::from_transform(m, flip_normals).map(Self::Plane),
            GeometryDesc::Polygon { contours } => Polygon::from_transform(contours, m, flip_normals).map(Self::Polygon),
        }
    }
}
