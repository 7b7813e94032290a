//! Shapes of the classic model. Small ones stand in the list, large ones in [`Arc`]s, so that copies of objects share them.

use std::sync::Arc;

use glam::{DVec2, DVec3, DVec4};
use serde::{Deserialize, Serialize};

use super::{Blob, HeightField, Isosurface, JuliaFractal, Light, Mesh, Object, Parametric, TextShape};

/// Shapes. Radii and sizes are as in the file: negative and zero ones too.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Solid {
    /// All of several; inner surfaces stay.
    Union(Vec<Arc<Object>>),
    /// What is inside of all.
    Intersection(Vec<Arc<Object>>),
    /// What is inside of the first and outside of all others.
    Difference(Vec<Arc<Object>>),
    /// All of several without inner surfaces.
    Merge(Vec<Arc<Object>>),
    /// Sphere.
    Sphere {
        /// Center.
        center: DVec3,
        /// Radius.
        radius: f64,
    },
    /// Box with faces along the axes.
    Box {
        /// Two opposite corners, in any order.
        corners: [DVec3; 2],
    },
    /// Cone or frustum.
    Cone {
        /// Center of the base.
        base: DVec3,
        /// Radius there.
        base_radius: f64,
        /// Center of the cap.
        cap: DVec3,
        /// Radius there.
        cap_radius: f64,
        /// Without end discs.
        open: bool,
    },
    /// Cylinder.
    Cylinder {
        /// Center of one end.
        base: DVec3,
        /// Center of the other end.
        cap: DVec3,
        /// Radius.
        radius: f64,
        /// Without end discs.
        open: bool,
    },
    /// Ring around the y axis.
    Torus {
        /// From the center to the middle of the tube.
        major: f64,
        /// Radius of the tube.
        minor: f64,
    },
    /// Half-space.
    Plane {
        /// Normal, of any length, to the outside.
        normal: DVec3,
        /// Distance from the origin along the unit normal.
        distance: f64,
    },
    /// Flat disc, perhaps with a hole.
    Disc {
        /// Center.
        center: DVec3,
        /// Normal, of any length.
        normal: DVec3,
        /// Radius.
        radius: f64,
        /// Radius of the hole; 0 for none.
        hole_radius: f64,
    },
    /// Triangle, smooth or flat.
    Triangle(Box<Triangle>),
    /// Polygons in one plane: closed by repetition of their first points, holes where they overlap an even number of times.
    Polygon(Arc<Vec<DVec3>>),
    /// Triangles that share vertices (`mesh` and `mesh2`).
    Mesh(Arc<Mesh>),
    /// Second-order polynomial.
    Quadric {
        /// Coefficients of x², y², z².
        squares: DVec3,
        /// Coefficients of xy, xz, yz.
        mixed: DVec3,
        /// Coefficients of x, y, z.
        linear: DVec3,
        /// Constant.
        constant: f64,
    },
    /// `cubic`, `quartic`, `poly` and `polynomial`.
    Polynomial {
        /// Order, 2 to 35.
        order: u32,
        /// (order + 1)(order + 2)(order + 3) / 6 coefficients, in `poly`'s order.
        coefficients: Arc<Vec<f64>>,
    },
    /// Surface where fields around points and lines reach a threshold.
    Blob(Arc<Blob>),
    /// Curve turned around the y axis.
    Lathe {
        /// Kind of curve.
        spline: CurveKind,
        /// (radius, height) points.
        points: Arc<Vec<DVec2>>,
    },
    /// Surface of revolution: radius² as a function of height.
    Sor {
        /// (radius, height) points; the first and last give slopes only.
        points: Arc<Vec<DVec2>>,
        /// Without end discs.
        open: bool,
    },
    /// Closed curves in the xz plane swept along y.
    Prism(Arc<Prism>),
    /// (|x|^(2/e) + |y|^(2/e))^(e/n) + |z|^(2/n) = 1.
    Superellipsoid {
        /// East–west exponent.
        e: f64,
        /// North–south exponent.
        n: f64,
    },
    /// Landscape over the unit square of x and z, heights along y.
    HeightField(Arc<HeightField>),
    /// Bézier patch.
    BicubicPatch(Arc<BicubicPatch>),
    /// Slice of a four-dimensional Julia set.
    JuliaFractal(Arc<JuliaFractal>),
    /// Surface of a function of space.
    Isosurface(Box<Isosurface>),
    /// Surface of functions of u and v.
    Parametric(Arc<Parametric>),
    /// Envelope of a sphere moving on a curve.
    SphereSweep(Arc<SphereSweep>),
    /// Egg.
    Ovus {
        /// Radius of the sphere at the origin.
        bottom: f64,
        /// Radius of the sphere on top.
        top: f64,
    },
    /// Extruded letters.
    Text(Arc<TextShape>),
    /// A light source in a union or group; taken out when the object is added to the scene.
    Light(Box<Light>),
}

/// Curves of `lathe` and `prism`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum CurveKind {
    /// Straight segments.
    #[default]
    Linear,
    /// Each segment of degree two through its ends, slope at the start from the point before.
    Quadratic,
    /// Each segment of degree three, slopes from the neighboring points.
    Cubic,
    /// Four points for each segment.
    Bezier,
}

/// A triangle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Triangle {
    /// Corners.
    pub corners: [DVec3; 3],
    /// Normals at the corners of a smooth triangle.
    pub normals: Option<[DVec3; 3]>,
}

/// `prism`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Prism {
    /// Kind of curves.
    pub spline: CurveKind,
    /// Shrinks towards y = 0 (`conic_sweep`): full size at y = 1.
    pub conic: bool,
    /// Heights between which it reaches, in any order.
    pub heights: [f64; 2],
    /// (x, z) points of all sub-prisms in a row, control points among them.
    pub points: Vec<DVec2>,
    /// Without end faces.
    pub open: bool,
}

/// `bicubic_patch`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BicubicPatch {
    /// 0 keeps control points only, 1 subdivides beforehand. The picture is the same.
    pub kind: u32,
    /// Parts flatter than this are not divided further; 0 divides all.
    pub flatness: f64,
    /// Levels of division along u.
    pub u_steps: u32,
    /// Levels of division along v.
    pub v_steps: u32,
    /// Four rows of four control points.
    pub points: [DVec3; 16],
    /// Surface coordinates of the corners (u, v) = (0, 0), (1, 0), (1, 1), (0, 1).
    pub uv: [DVec2; 4],
}

/// `sphere_sweep`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SphereSweep {
    /// Kind of curve.
    pub spline: SweepKind,
    /// Center (x, y, z) and radius (w) of each sphere.
    pub spheres: Vec<DVec4>,
    /// Depth tolerance.
    pub tolerance: f64,
}

/// Curves of `sphere_sweep`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SweepKind {
    /// Straight tubes.
    Linear,
    /// Cubic B-spline.
    BSpline,
    /// Catmull–Rom: through all points but the first and last.
    Cubic,
}

impl Solid {
    /// Parts of unions, intersections, differences and merges; `None` for everything else.
    pub fn parts(&self) -> Option<&[Arc<Object>]> {
        match self {
            Self::Union(parts) | Self::Intersection(parts) | Self::Difference(parts) | Self::Merge(parts) => Some(parts),
            _ => None,
        }
    }
}
