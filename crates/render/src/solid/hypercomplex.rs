//! Functions of hypercomplex numbers for `julia_fractal`.
//!
//! With ij = k and i² = j² = −1 in a commutative algebra, k² = 1, and x + yi + zj + wk ↦ (x − w + (y + z) i, x + w + (y − z) i) maps it to
//! pairs of complex numbers that are added and multiplied by themselves. So are analytic functions.

use etendue_procedural::fns;
use etendue_scene::desc::classic::JuliaFunction;

/// A complex number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Complex {
    pub re: f64,
    pub im: f64,
}

impl Complex {
    pub const ONE: Self = Self::new(1.0, 0.0);
    const I: Self = Self::new(0.0, 1.0);

    pub const fn new(re: f64, im: f64) -> Self {
        Self { re, im }
    }
    pub fn square_length(self) -> f64 {
        self.re * self.re + self.im * self.im
    }
    pub fn plus(self, b: Self) -> Self {
        Self::new(self.re + b.re, self.im + b.im)
    }
    fn minus(self, b: Self) -> Self {
        Self::new(self.re - b.re, self.im - b.im)
    }
    pub fn times(self, b: Self) -> Self {
        Self::new(self.re * b.re - self.im * b.im, self.re * b.im + self.im * b.re)
    }
    fn scaled(self, k: f64) -> Self {
        Self::new(self.re * k, self.im * k)
    }
    fn reciprocal(self) -> Self {
        let k = 1.0 / self.square_length();
        Self::new(self.re * k, -self.im * k)
    }
    fn exp(self) -> Self {
        let r = fns::exp(self.re);
        let (s, c) = fns::sin_cos(self.im);
        Self::new(r * c, r * s)
    }
    fn ln(self) -> Self {
        Self::new(0.5 * fns::log(self.square_length()), fns::atan2(self.im, self.re))
    }
    /// The root with a real part that is not negative.
    fn sqrt(self) -> Self {
        let r = self.square_length().sqrt();
        let re = (0.5 * (r + self.re)).max(0.0).sqrt();
        let im = (0.5 * (r - self.re)).max(0.0).sqrt();
        Self::new(re, im.copysign(self.im))
    }
    fn sin(self) -> Self {
        let (s, c) = fns::sin_cos(self.re);
        Self::new(s * fns::cosh(self.im), c * fns::sinh(self.im))
    }
    fn cos(self) -> Self {
        let (s, c) = fns::sin_cos(self.re);
        Self::new(c * fns::cosh(self.im), -s * fns::sinh(self.im))
    }
    /// −i ln(iz + √(1 − z²))
    fn asin(self) -> Self {
        let root = Self::ONE.minus(self.times(self)).sqrt();
        let l = Self::I.times(self).plus(root).ln();
        Self::new(l.im, -l.re)
    }
    /// i/2 (ln(1 − iz) − ln(1 + iz))
    fn atan(self) -> Self {
        let iz = Self::I.times(self);
        let l = Self::ONE.minus(iz).ln().minus(Self::ONE.plus(iz).ln());
        Self::new(-0.5 * l.im, 0.5 * l.re)
    }
    /// f(iz)/i for functions of circles gives those of hyperbolas.
    fn turned(self, f: impl Fn(Self) -> Self) -> Self {
        let w = f(Self::new(-self.im, self.re));
        Self::new(w.im, -w.re)
    }
}

/// Value and derivative of an iterated function.
pub(super) fn evaluate(function: JuliaFunction, z: Complex) -> (Complex, Complex) {
    let one = Complex::ONE;
    let square = z.times(z);
    match function {
        JuliaFunction::Sqr => (square, z.scaled(2.0)),
        JuliaFunction::Cube => (square.times(z), square.scaled(3.0)),
        JuliaFunction::Exp => {
            let e = z.exp();
            (e, e)
        }
        JuliaFunction::Reciprocal => {
            let r = z.reciprocal();
            (r, r.times(r).scaled(-1.0))
        }
        JuliaFunction::Sin => (z.sin(), z.cos()),
        JuliaFunction::Cos => (z.cos(), z.sin().scaled(-1.0)),
        JuliaFunction::Sinh => (z.turned(Complex::sin), Complex::new(-z.im, z.re).cos()),
        JuliaFunction::Cosh => (Complex::new(-z.im, z.re).cos(), z.turned(Complex::sin)),
        JuliaFunction::Tan => {
            let t = z.sin().times(z.cos().reciprocal());
            (t, one.plus(t.times(t)))
        }
        JuliaFunction::Tanh => {
            let t = z.turned(|w| w.sin().times(w.cos().reciprocal()));
            (t, one.minus(t.times(t)))
        }
        JuliaFunction::Asin => (z.asin(), one.minus(square).sqrt().reciprocal()),
        JuliaFunction::Acos => {
            let s = z.asin();
            (Complex::new(std::f64::consts::FRAC_PI_2 - s.re, -s.im), one.minus(square).sqrt().reciprocal().scaled(-1.0))
        }
        JuliaFunction::Asinh => (z.turned(Complex::asin), one.plus(square).sqrt().reciprocal()),
        JuliaFunction::Acosh => {
            // ln(z + √(z − 1) √(z + 1))
            let root = z.minus(one).sqrt().times(z.plus(one).sqrt());
            (z.plus(root).ln(), root.reciprocal())
        }
        JuliaFunction::Atan => (z.atan(), one.plus(square).reciprocal()),
        JuliaFunction::Atanh => (z.turned(Complex::atan), one.minus(square).reciprocal()),
        JuliaFunction::Ln => (z.ln(), z.reciprocal()),
        JuliaFunction::Pwr(x, y) => {
            let c = Complex::new(x, y);
            let w = c.times(z.ln()).exp();
            (w, c.times(w).times(z.reciprocal()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_the_values() {
        use JuliaFunction::*;
        let all = [
            Sqr,
            Cube,
            Exp,
            Reciprocal,
            Sin,
            Asin,
            Sinh,
            Asinh,
            Cos,
            Acos,
            Cosh,
            Acosh,
            Tan,
            Atan,
            Tanh,
            Atanh,
            Ln,
            Pwr(2.4, 0.1),
            Pwr(-0.5, 1.0),
        ];
        for f in all {
            for z in [Complex::new(0.3, 0.4), Complex::new(-0.5, 0.7), Complex::new(0.2, -0.9)] {
                let h = 1e-6;
                let (_, d) = evaluate(f, z);
                for step in [Complex::new(h, 0.0), Complex::new(0.0, h)] {
                    let difference = evaluate(f, z.plus(step)).0.minus(evaluate(f, z.minus(step)).0).scaled(0.5);
                    assert!(difference.minus(d.times(step)).square_length().sqrt() < 1e-8 * h.sqrt(), "{f:?} {z:?}");
                }
            }
        }
    }

    #[test]
    fn inverses() {
        use JuliaFunction::*;
        let z = Complex::new(0.3, 0.4);
        for (f, g) in
            [(Sin, Asin), (Cos, Acos), (Tan, Atan), (Sinh, Asinh), (Cosh, Acosh), (Tanh, Atanh), (Exp, Ln), (Reciprocal, Reciprocal)]
        {
            assert!(evaluate(f, evaluate(g, z).0).0.minus(z).square_length() < 1e-24, "{f:?}");
        }
    }
}
