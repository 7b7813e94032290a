//! The shapes: what stands between the braces before the modifiers.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::super::{Parse, Parser, Token};
use crate::desc::classic::{Solid, Triangle};
use crate::span::Span;

/// Most points, faces and components that a shape may have.
const COUNT_LIMIT: f64 = 1e8;

impl Parser {
    /// The shape of a word of [`super::OBJECT_WORDS`] that is neither a combination nor a light, up to its modifiers.
    pub(super) fn solid(&mut self, word: &str, span: Span) -> Parse<Solid> {
        Ok(match word {
            "sphere" => {
                let center = self.vector3()?;
                self.comma()?;
                Solid::Sphere { center, radius: self.float()? }
            }
            "box" => {
                let a = self.vector3()?;
                self.comma()?;
                Solid::Box { corners: [a, self.vector3()?] }
            }
            "cylinder" => {
                let base = self.vector3()?;
                self.comma()?;
                let cap = self.vector3()?;
                self.comma()?;
                let radius = self.float()?;
                Solid::Cylinder { base, cap, radius, open: self.accept("open")? }
            }
            "cone" => {
                let base = self.vector3()?;
                self.comma()?;
                let base_radius = self.float()?;
                self.comma()?;
                let cap = self.vector3()?;
                self.comma()?;
                let cap_radius = self.float()?;
                Solid::Cone { base, base_radius, cap, cap_radius, open: self.accept("open")? }
            }
            "torus" => {
                let major = self.float()?;
                self.comma()?;
                Solid::Torus { major, minor: self.float()? }
            }
            "plane" => {
                let normal = self.vector3()?;
                self.comma()?;
                Solid::Plane { normal, distance: self.float()? }
            }
            "disc" => {
                let center = self.vector3()?;
                self.comma()?;
                let normal = self.vector3()?;
                self.comma()?;
                let radius = self.float()?;
                self.comma()?;
                let hole_radius = if self.at_float()? { self.float()? } else { 0.0 };
                Solid::Disc { center, normal, radius, hole_radius }
            }
            "triangle" => {
                let corners = self.vectors3()?;
                Solid::Triangle(Box::new(Triangle { corners, normals: None }))
            }
            "smooth_triangle" => {
                let [a, na, b, nb, c, nc] = self.vectors3()?;
                Solid::Triangle(Box::new(Triangle { corners: [a, b, c], normals: Some([na, nb, nc]) }))
            }
            "polygon" => {
                let count = self.count("points")?;
                let mut points = Vec::new();
                for _ in 0..count {
                    self.comma()?;
                    points.push(self.vector3()?);
                }
                Solid::Polygon(Arc::new(points))
            }
            "quadric" => {
                let squares = self.vector3()?;
                self.comma()?;
                let mixed = self.vector3()?;
                self.comma()?;
                let linear = self.vector3()?;
                self.comma()?;
                Solid::Quadric { squares, mixed, linear, constant: self.float()? }
            }
            "cubic" => self.poly(3)?,
            "quartic" => self.poly(4)?,
            "poly" => {
                let order = self.order(span)?;
                self.comma()?;
                self.poly(order)?
            }
            "polynomial" => self.polynomial(span)?,
            "superellipsoid" => {
                let exponents = self.vector2()?;
                if !(exponents.min_element() > 0.0) {
                    return Err(self.error(span, "the exponents of a superellipsoid must be greater than 0"));
                }
                Solid::Superellipsoid { e: exponents.x, n: exponents.y }
            }
            "ovus" => {
                let bottom = self.float()?;
                self.comma()?;
                Solid::Ovus { bottom, top: self.float()? }
            }
            "lathe" => self.lathe()?,
            "sor" => self.sor()?,
            "prism" => self.prism()?,
            "sphere_sweep" => self.sphere_sweep(span)?,
            "bicubic_patch" => self.bicubic_patch()?,
            "blob" => self.blob()?,
            "height_field" => self.height_field(span)?,
            "julia_fractal" => self.julia_fractal(span)?,
            "mesh" => self.mesh()?,
            "mesh2" => self.mesh2()?,
            "text" => self.text(span)?,
            "isosurface" => self.isosurface()?,
            "parametric" => self.parametric()?,
            _ => return Err(self.unexpected("an object")),
        })
    }

    /// So many vectors with optional commas between them.
    pub(super) fn vectors3<const N: usize>(&mut self) -> Parse<[DVec3; N]> {
        let mut out = [DVec3::ZERO; N];
        for v in &mut out {
            *v = self.vector3()?;
            self.comma()?;
        }
        Ok(out)
    }

    /// So many vectors of two with optional commas.
    pub(super) fn points2(&mut self, count: usize) -> Parse<Arc<Vec<DVec2>>> {
        let mut points = Vec::new();
        for _ in 0..count {
            self.comma()?;
            points.push(self.vector2()?);
        }
        self.comma()?;
        Ok(Arc::new(points))
    }

    /// A number of things.
    pub(super) fn count(&mut self, things: &str) -> Parse<usize> {
        let span = self.span();
        let count = self.float()?;
        if !(0.0..=COUNT_LIMIT).contains(&count) {
            return Err(self.error(span, format!("the number of {things} must be between 0 and {COUNT_LIMIT}")));
        }
        Ok(count as usize)
    }

    fn order(&mut self, span: Span) -> Parse<u32> {
        let order = self.float()?;
        if !(2.0..=35.0).contains(&order) {
            return Err(self.error(span, "the order of a polynomial must be between 2 and 35"));
        }
        Ok(order as u32)
    }

    /// Coefficients in angle brackets.
    fn poly(&mut self, order: u32) -> Parse<Solid> {
        let count = coefficient_count(order);
        self.expect("<")?;
        let mut coefficients = Vec::with_capacity(count);
        for _ in 0..count {
            coefficients.push(self.float()?);
            self.comma()?;
        }
        self.expect(">")?;
        Ok(Solid::Polynomial { order, coefficients: Arc::new(coefficients) })
    }

    /// `polynomial { order, xyz(i, j, k): value … }`.
    fn polynomial(&mut self, span: Span) -> Parse<Solid> {
        let order = self.order(span)?;
        let mut coefficients = vec![0.0; coefficient_count(order)];
        loop {
            self.comma()?;
            match self.peek()? {
                Token::Word("xyz") => {}
                Token::Unknown(name) if &**name == "xyz" => {}
                _ => break,
            }
            self.next()?;
            let at = self.span();
            self.expect("(")?;
            let mut powers = [0u32; 3];
            for p in &mut powers {
                let power = self.float()?;
                self.comma()?;
                if !(0.0..=35.0).contains(&power) {
                    return Err(self.error(at, "a power must be between 0 and the order"));
                }
                *p = power as u32;
            }
            self.expect(")")?;
            self.expect(":")?;
            let value = self.float()?;
            match coefficient_index(order, powers).and_then(|i| coefficients.get_mut(i)) {
                Some(c) => *c = value,
                None => return Err(self.error(at, format!("the powers add up to more than the order {order}"))),
            }
        }
        Ok(Solid::Polynomial { order, coefficients: Arc::new(coefficients) })
    }
}

/// Number of terms of a polynomial in three variables.
fn coefficient_count(order: u32) -> usize {
    let n = order as usize;
    (n + 1) * (n + 2) * (n + 3) / 6
}

/// Place of a term among those of an order: powers of x fall first, then of y, then of z (documentation, "Poly", table of terms).
fn coefficient_index(order: u32, [x, y, z]: [u32; 3]) -> Option<usize> {
    let rest = order.checked_sub(x)? as usize;
    let below = rest.checked_sub(y as usize)?;
    let last = below.checked_sub(z as usize)?;
    Some(rest * (rest + 1) * (rest + 2) / 6 + below * (below + 1) / 2 + last)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Places from the documentation's table for orders 2 to 4.
    #[test]
    fn places_of_terms() {
        let order2 = [[2, 0, 0], [1, 1, 0], [1, 0, 1], [1, 0, 0], [0, 2, 0], [0, 1, 1], [0, 1, 0], [0, 0, 2], [0, 0, 1], [0, 0, 0]];
        for (i, powers) in order2.into_iter().enumerate() {
            assert_eq!(coefficient_index(2, powers), Some(i));
        }
        assert_eq!(coefficient_index(4, [2, 0, 0]), Some(9));
        assert_eq!(coefficient_index(4, [0, 0, 0]), Some(34));
        assert_eq!(coefficient_index(4, [3, 2, 0]), None);
    }
}
