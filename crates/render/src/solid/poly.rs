//! `cubic`, `quartic`, `poly`, `polynomial`: where a polynomial in x, y, z vanishes. Inside where it is negative.
//!
//! POV-Ray documentation, sections 3.4.5.3.2 to 3.4.5.3.5.

use glam::{DVec2, DVec3};

use super::roots::{self, MAX_DEGREE};
use super::{Bounds, Crossing, Line, Primitive};

/// Roots farther from the origin than this many units are not looked for.
const FARTHEST: f64 = 1e9;

/// A polynomial surface.
#[derive(Clone, Debug)]
pub struct Poly {
    order: usize,
    /// Powers of x descending, within them of y, within them of z.
    coefficients: Vec<f64>,
    /// For each power of x and y in that order: where its terms start, the highest power of z with a coefficient plus one, and that of all.
    rows: Vec<Row>,
}

#[derive(Clone, Copy, Debug)]
struct Row {
    /// Of the first coefficient that does not vanish.
    start: usize,
    /// Coefficients from there on; 0 for an empty row.
    len: usize,
}

/// How many coefficients a polynomial of this order has in x, y and z.
pub fn coefficient_count(order: usize) -> usize {
    (order + 1) * (order + 2) * (order + 3) / 6
}

/// Place of the term x^i y^j z^k among the coefficients of a polynomial of `order`; `None` where i + j + k is above it.
pub fn coefficient_index(order: usize, [i, j, k]: [usize; 3]) -> Option<usize> {
    let rest = order.checked_sub(i)?;
    let last = rest.checked_sub(j)?.checked_sub(k)?;
    // Terms with higher powers of x: those of polynomials in all three of order rest − 1; then of y.
    let before_x = rest * (rest + 1) * (rest + 2) / 6;
    let left = rest - j;
    let before_y = left * (left + 1) / 2;
    Some(before_x + before_y + last)
}

impl Poly {
    /// A polynomial of order 1 to 35 with its (n + 1)(n + 2)(n + 3)/6 coefficients in POV-Ray's order: A1 is that of the highest power of
    /// x. `None` for another order or number of coefficients, and where one is not finite.
    pub fn new(order: usize, coefficients: Vec<f64>) -> Option<Self> {
        if !(1..=MAX_DEGREE).contains(&order)
            || coefficients.len() != coefficient_count(order)
            || coefficients.iter().any(|a| !a.is_finite())
        {
            return None;
        }
        let mut rows = Vec::new();
        let mut start = 0;
        for rest in 0..=order {
            for left in 0..=rest {
                let end = start + left + 1;
                let zeros = coefficients[start..end].iter().take_while(|a| **a == 0.0).count();
                rows.push(Row { start: start + zeros, len: end - start - zeros });
                start = end;
            }
        }
        Some(Self { order, coefficients, rows })
    }

    /// The polynomial on a line, in powers of the parameter, lowest first: Horner's scheme on polynomials. `N` is above the order.
    #[inline(always)]
    fn on_line<const N: usize>(&self, o: DVec3, d: DVec3) -> [f64; N] {
        let mut in_x = [0.0; N];
        let mut rows = self.rows.iter();
        for rest in 0..=self.order {
            let mut in_y = [0.0; N];
            let mut any = false;
            for left in 0..=rest {
                if any {
                    times(&mut in_y, o.y, d.y, rest);
                }
                let Some(row) = rows.next() else { break };
                if row.len > 0 {
                    let mut in_z = [0.0; N];
                    for &a in &self.coefficients[row.start..row.start + row.len] {
                        times(&mut in_z, o.z, d.z, left);
                        in_z[0] += a;
                    }
                    for (y, z) in in_y.iter_mut().zip(&in_z) {
                        *y += z;
                    }
                    any = true;
                }
            }
            times(&mut in_x, o.x, d.x, self.order);
            if any {
                for (x, y) in in_x.iter_mut().zip(&in_y) {
                    *x += y;
                }
            }
        }
        in_x
    }

    /// Value and gradient at a point.
    fn value(&self, p: DVec3) -> (f64, DVec3) {
        let (mut f, mut g) = (0.0, DVec3::ZERO);
        let mut rows = self.rows.iter();
        for rest in 0..=self.order {
            let (mut fy, mut gy, mut gz) = (0.0, 0.0, 0.0);
            for _ in 0..=rest {
                let Some(row) = rows.next() else { break };
                let (mut fz, mut dz) = (0.0, 0.0);
                for &a in &self.coefficients[row.start..row.start + row.len] {
                    dz = dz * p.z + fz;
                    fz = fz * p.z + a;
                }
                gy = gy * p.y + fy;
                gz = gz * p.y + dz;
                fy = fy * p.y + fz;
            }
            g = DVec3::new(g.x * p.x + f, g.y * p.x + gy, g.z * p.x + gz);
            f = f * p.x + fy;
        }
        (f, g)
    }
}

/// Multiplies a polynomial by o + d t; no term above `degree` comes out.
#[inline(always)]
fn times<const N: usize>(p: &mut [f64; N], o: f64, d: f64, degree: usize) {
    // Small arrays: without the bound the loop unrolls.
    let top = if N <= 5 { N - 1 } else { degree.min(N - 1) };
    for i in (1..=top).rev() {
        p[i] = p[i] * o + p[i - 1] * d;
    }
    p[0] *= o;
}

impl Primitive for Poly {
    fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::splat(f64::NEG_INFINITY), max: DVec3::splat(f64::INFINITY) }
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        // Around the point nearest to the origin, where these shapes live, and in units of length: the coefficients keep their digits.
        let speed = line.d.length();
        if !(speed > 0.0) || !speed.is_finite() {
            return;
        }
        let d = line.d / speed;
        let middle = -line.o.dot(d);
        let o = line.o + d * middle;
        let (lo, hi) = (t_min * speed - middle, t_max * speed - middle);
        let mut push = |s: f64| {
            let t = (s + middle) / speed;
            if t > t_min && t < t_max {
                out.push(Crossing { t, part: 0, uv: DVec2::ZERO });
            }
        };
        if self.order <= 4 {
            let c = self.on_line::<5>(o, d);
            let far = roots::root_bound(&c).min(FARTHEST);
            roots::quartic_in(&c, lo.max(-far), hi.min(far)).into_iter().for_each(&mut push);
        } else {
            let c = self.on_line::<{ MAX_DEGREE + 1 }>(o, d);
            let far = roots::root_bound(&c[..=self.order]).min(FARTHEST);
            roots::polynomial_in(&c[..=self.order], lo.max(-far), hi.min(far)).into_iter().for_each(&mut push);
        }
    }

    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, scratch: &mut Vec<Crossing>) -> Option<Crossing> {
        if self.order <= 4 {
            let speed = line.d.length();
            if !(speed > 0.0) || !speed.is_finite() {
                return None;
            }
            let d = line.d / speed;
            let middle = -line.o.dot(d);
            let c = self.on_line::<5>(line.o + d * middle, d);
            let far = roots::root_bound(&c).min(FARTHEST);
            let first = roots::quartic_first(&c, (t_min * speed - middle).max(-far), (t_max * speed - middle).min(far))?;
            let t = (first + middle) / speed;
            if t > t_min && t < t_max {
                return Some(Crossing { t, part: 0, uv: DVec2::ZERO });
            }
        }
        let start = scratch.len();
        self.crossings(line, t_min, t_max, scratch);
        let nearest = scratch[start..].iter().copied().min_by(|a, b| a.t.total_cmp(&b.t));
        scratch.truncate(start);
        nearest
    }

    fn inside(&self, p: DVec3) -> bool {
        self.value(p).0 < 0.0
    }

    fn normal(&self, p: DVec3, _: &Crossing) -> DVec3 {
        self.value(p).1.try_normalize().unwrap_or(DVec3::X)
    }

    fn uv(&self, _: DVec3, _: &Crossing) -> DVec2 {
        DVec2::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::super::measured::{Tolerance, alternates, compare, hostile_lines};
    use super::*;

    #[rustfmt::skip]
    fn torus() -> Poly {
        Poly::new(4, vec![
            1., 0., 0., 0., 2., 0., 0., 2., 0., -104., 0., 0., 0., 0., 0., 0., 0., 0., 0., 0., 1., 0., 0., 2., 0., 56., 0., 0., 0., 0., 1., 0.,
            -104., 0., 784.,
        ]).unwrap()
    }

    fn sextic() -> Poly {
        let mut c = vec![0.0; coefficient_count(6)];
        for (power, a) in
            [([6, 0, 0], 1.0), ([0, 6, 0], 2.0), ([0, 0, 6], 1.0), ([2, 2, 2], -3.0), ([1, 0, 1], 0.4), ([0, 3, 0], 0.3), ([0, 0, 0], -0.5)]
        {
            c[coefficient_index(6, power).unwrap()] = a;
        }
        Poly::new(6, c).unwrap()
    }

    #[test]
    fn indices_follow_the_documented_table() {
        assert_eq!(coefficient_index(2, [2, 0, 0]), Some(0));
        assert_eq!(coefficient_index(2, [0, 1, 1]), Some(5));
        assert_eq!(coefficient_index(4, [0, 2, 2]), Some(23));
        assert_eq!(coefficient_index(7, [1, 3, 3]), Some(62));
        assert_eq!(coefficient_index(7, [0, 0, 0]), Some(119));
        assert_eq!(coefficient_index(3, [2, 1, 1]), None);
    }

    #[test]
    fn as_pov_ray() {
        let cubic = vec![1., 0.2, 0., 0.1, -0.3, 0., 0., 1., 0., -0.4, 0., 1., 0.3, 0.2, 0., -1., 0.5, 0., 0., 0.1];
        compare(&torus(), include_str!("measured/quartic_torus.txt"), &Tolerance::default());
        compare(&Poly::new(3, cubic).unwrap(), include_str!("measured/cubic.txt"), &Tolerance::default());
        compare(&sextic(), include_str!("measured/poly6.txt"), &Tolerance::default());
    }

    #[test]
    fn inside_alternates() {
        alternates(&torus(), DVec3::ZERO, 10.0, 2000, 0);
        alternates(&sextic(), DVec3::ZERO, 1.5, 500, 0);
    }

    #[test]
    fn degree_35() {
        // x^35 + y^35 + z^35 = 1: on the diagonal at the 35th root of 1/3.
        let mut c = vec![0.0; coefficient_count(35)];
        for power in [[35, 0, 0], [0, 35, 0], [0, 0, 35]] {
            c[coefficient_index(35, power).unwrap()] = 1.0;
        }
        *c.last_mut().unwrap() = -1.0;
        let poly = Poly::new(35, c).unwrap();
        let mut out = Vec::new();
        poly.crossings(&Line { o: DVec3::splat(-0.2), d: DVec3::ONE }, 0.0, 10.0, &mut out);
        assert_eq!(out.len(), 1);
        assert!((out[0].t - 0.2 - etendue_procedural::fns::pow(1.0 / 3.0, 1.0 / 35.0)).abs() < 1e-12);
        hostile_lines(&poly);
    }

    #[test]
    fn hostile() {
        assert!(Poly::new(36, vec![0.0; coefficient_count(36)]).is_none());
        assert!(Poly::new(4, vec![0.0; 34]).is_none());
        assert!(Poly::new(2, vec![f64::NAN; 10]).is_none());
        assert!(Poly::new(0, vec![1.0]).is_none());
        hostile_lines(&torus());
        hostile_lines(&Poly::new(2, vec![1e300; 10]).unwrap());
        hostile_lines(&Poly::new(2, vec![0.0; 10]).unwrap());
    }
}
