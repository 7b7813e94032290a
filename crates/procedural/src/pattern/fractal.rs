//! Mandelbrot, Julia and magnet sets (documentation, "Fractal Pattern").

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// A fractal pattern.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fractal {
    /// Which set.
    pub set: FractalSet,
    /// `Some(c)` for the Julia set of c, `None` for the Mandelbrot-like set.
    pub julia: Option<DVec2>,
    /// Most iterations.
    pub iterations: u32,
    /// How points outside of the set get their value.
    pub exterior: Coloring,
    /// How points inside of the set get their value.
    pub interior: Coloring,
}

/// The map that is iterated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FractalSet {
    /// z ↦ zⁿ + c, with the exponent, 2 to 33.
    Power(u8),
    /// First model of magnetic renormalization.
    Magnet1,
    /// Second model of magnetic renormalization.
    Magnet2,
}

/// `exterior` or `interior`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coloring {
    /// Method, 0 to 8.
    pub method: u8,
    /// Factor of the value.
    pub factor: f64,
}

impl Fractal {
    /// A Mandelbrot set.
    pub fn mandelbrot(iterations: u32) -> Self {
        Self {
            set: FractalSet::Power(2),
            julia: None,
            iterations,
            exterior: Coloring { method: 1, factor: 1.0 },
            interior: Coloring { method: 0, factor: 1.0 },
        }
    }

    /// The value at a point of the x-y plane.
    ///
    /// Measured: the Mandelbrot-like sets begin at the point itself, the magnet ones at 0; a point has left when |z|² exceeds 4, in the
    /// magnet sets 10⁴, or comes as near to 1 as 10⁻⁴ there; interior method 6 is re² + factor · im².
    pub fn value(&self, p: DVec3) -> f64 {
        let point = DVec2::new(p.x, p.y);
        let c = self.julia.unwrap_or(point);
        let power = matches!(self.set, FractalSet::Power(_));
        let starts_at_zero = !power && self.julia.is_none();
        let mut z = if starts_at_zero { DVec2::ZERO } else { point };
        let mut least = if starts_at_zero { f64::INFINITY } else { z.length_squared() };
        let limit = if power { 4.0 } else { 1e4 };
        // Points inside of the set come into a cycle, mostly soon; where their last point does not matter, that settles it.
        let may_stop = !(2..=6).contains(&self.interior.method);
        if may_stop && self.set == FractalSet::Power(2) && self.julia.is_none() && self.interior.method != 1 && in_largest_parts(point) {
            return self.interior.factor;
        }
        let (mut seen, mut next) = (z, 8);
        for n in 0..self.iterations {
            z = self.step(z, c);
            if z == seen && may_stop {
                break;
            }
            if n == next {
                (seen, next) = (z, next.saturating_mul(2));
            }
            let size = z.length_squared();
            least = least.min(size);
            // Written so that NaN leaves as well.
            if !(size <= limit) || (!power && (z - DVec2::X).length_squared() < 1e-4) {
                return self.outside(z, n);
            }
        }
        let factor = self.interior.factor;
        match self.interior.method {
            1 => least.sqrt() * factor,
            6 => z.x * z.x + z.y * z.y * factor,
            method => of_last(method, z).unwrap_or(1.0) * factor,
        }
    }

    fn step(&self, z: DVec2, c: DVec2) -> DVec2 {
        match self.set {
            FractalSet::Power(2) => square(z) + c,
            FractalSet::Power(exponent) => power(z, exponent) + c,
            // Peitgen and Richter, "The Beauty of Fractals", 1986, pp. 129–147.
            FractalSet::Magnet1 => square(divide(square(z) + c - DVec2::X, z * 2.0 + c - DVec2::X * 2.0)),
            FractalSet::Magnet2 => {
                let (c1, c2) = (c - DVec2::X, c - DVec2::X * 2.0);
                let product = multiply(c1, c2);
                let z2 = square(z);
                let above = multiply(z2, z) + multiply(c1, z) * 3.0 + product;
                let below = z2 * 3.0 + multiply(c2, z) * 3.0 + product + DVec2::X;
                square(divide(above, below))
            }
        }
    }

    fn outside(&self, z: DVec2, iterations: u32) -> f64 {
        let factor = self.exterior.factor;
        match self.exterior.method {
            1 => f64::from(iterations) / f64::from(self.iterations),
            7 => (f64::from(iterations) % factor) / factor,
            8 => (f64::from(iterations) % (factor + 1.0)) / factor,
            method => of_last(method, z).unwrap_or(1.0) * factor,
        }
    }
}

/// Methods 2 to 6: numbers of the last point of the orbit.
fn of_last(method: u8, z: DVec2) -> Option<f64> {
    Some(match method {
        2 => z.x,
        3 => z.y,
        4 => z.x * z.x,
        5 => z.y * z.y,
        6 => z.length(),
        _ => return None,
    })
}

/// Whether a point is in the Mandelbrot set's cardioid or in the disc beside it.
fn in_largest_parts(c: DVec2) -> bool {
    let (x, y2) = (c.x - 0.25, c.y * c.y);
    let q = x * x + y2;
    q * (q + x) < 0.249_999 * y2 || (c.x + 1.0) * (c.x + 1.0) + y2 < 0.062_499
}

fn multiply(a: DVec2, b: DVec2) -> DVec2 {
    DVec2::new(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x)
}

fn square(a: DVec2) -> DVec2 {
    DVec2::new(a.x * a.x - a.y * a.y, 2.0 * a.x * a.y)
}

fn divide(a: DVec2, b: DVec2) -> DVec2 {
    multiply(a, DVec2::new(b.x, -b.y)) / b.length_squared()
}

/// zⁿ by repeated squaring.
fn power(z: DVec2, exponent: u8) -> DVec2 {
    let (mut result, mut base, mut left) = (DVec2::X, z, exponent);
    while left > 0 {
        if left & 1 == 1 {
            result = multiply(result, base);
        }
        base = square(base);
        left >>= 1;
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The value with all iterations done.
    fn plainly(f: &Fractal, p: DVec2) -> f64 {
        let is_power = matches!(f.set, FractalSet::Power(_));
        let starts_at_zero = !is_power && f.julia.is_none();
        let mut z = if starts_at_zero { DVec2::ZERO } else { p };
        let mut least = if starts_at_zero { f64::INFINITY } else { z.length_squared() };
        for n in 0..f.iterations {
            z = f.step(z, f.julia.unwrap_or(p));
            let size = z.length_squared();
            least = least.min(size);
            if !(size <= if is_power { 4.0 } else { 1e4 }) || (!is_power && (z - DVec2::X).length_squared() < 1e-4) {
                return f.outside(z, n);
            }
        }
        if f.interior.method == 1 { least.sqrt() * f.interior.factor } else { f.interior.factor }
    }

    #[test]
    fn cycles_end_the_iteration_and_change_nothing() {
        for set in [FractalSet::Power(2), FractalSet::Power(3), FractalSet::Magnet1] {
            for julia in [None, Some(DVec2::new(-0.12, 0.74)), Some(DVec2::new(0.3, 0.1))] {
                for method in [0, 1] {
                    let fractal = Fractal { set, julia, interior: Coloring { method, factor: 0.7 }, ..Fractal::mandelbrot(300) };
                    for i in 0..1600 {
                        let p = DVec2::new(f64::from(i % 40) / 12.0 - 2.2, f64::from(i / 40) / 16.0 - 1.2);
                        assert_eq!(fractal.value(p.extend(0.0)), plainly(&fractal, p), "{fractal:?} {p}");
                    }
                }
            }
        }
    }
}
