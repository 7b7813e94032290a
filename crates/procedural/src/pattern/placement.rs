//! Where a pattern is: transforms, warps and turbulence (documentation, "Warp", "Turbulence versus Turbulence Warp").

use glam::{DAffine3, DMat4, DVec3};
use serde::{Deserialize, Serialize};

use crate::noise::{self, Turbulence};
use crate::warp::Warp;

/// Transforms and warps of a pattern. Turbulence outside of a `warp` comes first whatever the order in the text, that is, it acts
/// next to the pattern; all else acts in the order of the text.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Placement {
    /// In the order of the text: the last acts first on a point. Transforms in a row are one.
    pub operations: Vec<Operation>,
    /// Turbulence outside of `warp`.
    pub turbulence: Option<Turbulent>,
}

/// One step of the way from world space into a pattern's space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Operation {
    /// A transform, already inverted: takes points of the outer space to the inner one.
    Inner(DAffine3),
    /// A warp.
    Warp(Warp),
}

/// Turbulence: amount along each axis and the walk's parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Turbulent {
    /// Amounts.
    pub amount: DVec3,
    /// Octaves, omega, lambda.
    pub walk: Turbulence,
}

impl Turbulent {
    /// The point pushed about.
    pub fn push(&self, p: DVec3, generator: u8) -> DVec3 {
        if self.amount == DVec3::ZERO { p } else { p + self.amount * noise::vector_turbulence(p, &self.walk, generator) }
    }
}

impl Placement {
    /// Whether points stay where they are.
    pub fn is_identity(&self) -> bool {
        self.operations.is_empty() && self.turbulence.is_none()
    }

    /// The point in the pattern's space; `keep_turbulence` leaves the turbulence outside of warps to the pattern's own formula.
    pub fn apply(&self, p: DVec3, generator: u8, keep_turbulence: bool) -> DVec3 {
        let mut p = p;
        for operation in self.operations.iter().rev() {
            p = match operation {
                Operation::Inner(inner_from_outer) => inner_from_outer.transform_point3(p),
                Operation::Warp(warp) => warp.apply(p, generator),
            };
        }
        match &self.turbulence {
            Some(t) if !keep_turbulence => t.push(p, generator),
            _ => p,
        }
    }

    /// A normal, of world space, in the pattern's space. Warps leave it as it is (measured).
    pub fn normal_inwards(&self, n: DVec3) -> DVec3 {
        let mut n = n;
        for operation in self.operations.iter().rev() {
            if let Operation::Inner(inner_from_outer) = operation {
                // Inverse transpose, by cofactors.
                let m = inner_from_outer.matrix3;
                let determinant = m.determinant();
                n = (m.y_axis.cross(m.z_axis) * n.x + m.z_axis.cross(m.x_axis) * n.y + m.x_axis.cross(m.y_axis) * n.z) / determinant;
            }
        }
        n
    }

    /// A normal of the pattern's space in world space, not of length 1.
    pub fn normal_outwards(&self, n: DVec3) -> DVec3 {
        self.operations.iter().fold(n, |n, operation| match operation {
            Operation::Inner(inner_from_outer) => inner_from_outer.matrix3.transpose() * n,
            Operation::Warp(_) => n,
        })
    }

    /// Moves the pattern. A transform without inverse leaves it where it is.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        let inverse = DAffine3::from_mat4(*world_from_old).inverse();
        if !inverse.is_finite() {
            return;
        }
        if let Some(Operation::Inner(old)) = self.operations.last_mut() {
            let joined = *old * inverse;
            if joined.is_finite() {
                *old = joined;
            }
        } else {
            self.operations.push(Operation::Inner(inverse));
        }
    }

    /// Adds a warp after all that was said before.
    pub fn warp(&mut self, warp: Warp) {
        self.operations.push(Operation::Warp(warp));
    }
}
