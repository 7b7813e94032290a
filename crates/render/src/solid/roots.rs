//! Real roots of polynomials in an interval.
//!
//! Between neighboring extrema a polynomial is monotone, so that a change of sign there holds exactly one root. Extrema are the roots of the
//! derivative, found the same way, down to the quadratic in closed form (Yuksel, "High-Performance Polynomial Root Finding for Graphics",
//! HPG 2022, sections 3 and 4). No root pair that the coefficients resolve is missed, and the number of roots always has the parity that
//! the signs at the ends of the interval ask for: solids rely on it.
//!
//! Coefficients come in ascending order. Zero counts as positive. Nothing here allocates.

use arrayvec::ArrayVec;

/// Highest degree of [`polynomial`].
pub const MAX_DEGREE: usize = 35;

/// Roots of a [`polynomial`], ascending.
pub type Roots = ArrayVec<f64, MAX_DEGREE>;

/// Value of a polynomial at `x`.
#[inline(always)]
pub fn eval(c: &[f64], x: f64) -> f64 {
    c.iter().rev().fold(0.0, |p, &a| p * x + a)
}

/// Value and derivative at `x`.
#[inline(always)]
fn eval2(c: &[f64], x: f64) -> (f64, f64) {
    let mut p = 0.0;
    let mut dp = 0.0;
    for &a in c.iter().rev() {
        dp = dp * x + p;
        p = p * x + a;
    }
    (p, dp)
}

#[inline(always)]
fn negative(x: f64) -> bool {
    x < 0.0
}

/// Relative size of the last step of Newton's method towards a root.
const EXACT: f64 = 4e-16;
/// The same towards an extremum that only divides an interval: the value there is exact already.
const DIVIDING: f64 = 1e-9;

/// The root between `a` and `b`, where the polynomial changes sign from `fa` to `fb`: Newton's method kept in the bracket.
#[inline(always)]
fn bracketed(c: &[f64], mut a: f64, mut b: f64, fa: f64, fb: f64, tolerance: f64) -> f64 {
    let rising = negative(fa);
    // A first guess by the secant, kept off the ends, where the slope may vanish.
    let s = fa / (fa - fb);
    let s = if s > 0.1 && s < 0.9 { s } else { 0.5 };
    let mut x = a + (b - a) * s;
    let mut last = b - a;
    for _ in 0..80 {
        let (f, df) = eval2(c, x);
        if negative(f) == rising {
            a = x;
        } else {
            b = x;
        }
        let mut next = x - f / df;
        // Written so that NaN bisects; so does a step that shrinks too slowly.
        if !(next > a && next < b && (next - x).abs() < 0.6 * last) {
            if f == 0.0 {
                return x;
            }
            next = 0.5 * (a + b);
        }
        last = (next - x).abs();
        x = next;
        if last <= tolerance * x.abs() || last < 1e-300 || !(b - a > 4e-16 * (a.abs() + b.abs())) {
            break;
        }
    }
    x
}

/// Roots of a polynomial in [lo, hi], whose extrema there are known.
#[inline(always)]
fn between<const N: usize>(c: &[f64], extrema: &[f64], lo: f64, hi: f64, out: &mut ArrayVec<f64, N>) {
    between_to(c, extrema, lo, hi, EXACT, out);
}

/// The same to a tolerance of the last step.
#[inline(always)]
fn between_to<const N: usize>(c: &[f64], extrema: &[f64], lo: f64, hi: f64, tolerance: f64, out: &mut ArrayVec<f64, N>) {
    let mut a = lo;
    let mut fa = eval(c, lo);
    for &b in extrema.iter().chain(std::iter::once(&hi)) {
        let fb = eval(c, b);
        if negative(fa) != negative(fb) && b > a {
            let x = bracketed(c, a, b, fa, fb, tolerance);
            // Never full: a polynomial of degree n has n − 1 extrema.
            let _ = out.try_push(x);
        }
        a = b;
        fa = fb;
    }
}

/// Both roots of a quadratic, ascending; a double root twice. None where all points or no points are roots.
#[inline]
pub fn quadratic(c: &[f64; 3]) -> ArrayVec<f64, 2> {
    let [c0, c1, c2] = *c;
    let mut out = ArrayVec::new();
    let half = -0.5 * c1;
    let d = half * half - c2 * c0;
    if !(d >= 0.0) || !d.is_finite() {
        return out;
    }
    // Without cancellation (Press et al., Numerical Recipes, section 5.6).
    let q = half + d.sqrt().copysign(half);
    let (r0, r1) = (q / c2, if q == 0.0 { 0.0 } else { c0 / q });
    match (r0.is_finite(), r1.is_finite()) {
        (true, true) => {
            out.push(r0.min(r1));
            out.push(r0.max(r1));
        }
        (false, true) if q != 0.0 => out.push(r1),
        _ => {}
    }
    out
}

/// Roots of a quadratic in [lo, hi], ascending, with the parity of the signs at the ends.
#[inline]
pub fn quadratic_in(c: &[f64; 3], lo: f64, hi: f64) -> ArrayVec<f64, 2> {
    let mut out = ArrayVec::new();
    if !(lo < hi) {
        return out;
    }
    let e = -c[1] / (2.0 * c[2]);
    let inside = e > lo && e < hi;
    between(c, if inside { std::slice::from_ref(&e) } else { &[] }, lo, hi, &mut out);
    out
}

/// Extrema of a cubic in (lo, hi).
#[inline(always)]
fn quadratic_open(c: &[f64; 3], lo: f64, hi: f64) -> ArrayVec<f64, 2> {
    quadratic(c).into_iter().filter(|x| *x > lo && *x < hi).collect()
}

/// Roots of a cubic in [lo, hi], ascending.
#[inline]
pub fn cubic_in(c: &[f64; 4], lo: f64, hi: f64) -> ArrayVec<f64, 3> {
    let mut out = ArrayVec::new();
    if !(lo < hi) || c.iter().any(|x| !x.is_finite()) {
        return out;
    }
    let extrema = quadratic_open(&[c[1], 2.0 * c[2], 3.0 * c[3]], lo, hi);
    between(c, &extrema, lo, hi, &mut out);
    out
}

/// Roots of a quartic in [lo, hi], ascending.
#[inline]
pub fn quartic_in(c: &[f64; 5], lo: f64, hi: f64) -> ArrayVec<f64, 4> {
    let mut out = ArrayVec::new();
    if !(lo < hi) || c.iter().any(|x| !x.is_finite()) {
        return out;
    }
    if one_sign(c, lo, hi) {
        return out;
    }
    let d = [c[1], 2.0 * c[2], 3.0 * c[3], 4.0 * c[4]];
    let mut extrema = ArrayVec::<f64, 3>::new();
    let turns = quadratic_open(&[d[1], 2.0 * d[2], 3.0 * d[3]], lo, hi);
    between_to(&d, &turns, lo, hi, DIVIDING, &mut extrema);
    between(c, &extrema, lo, hi, &mut out);
    out
}

/// The first root of a quartic in [lo, hi]: that of [`quartic_in`], without looking for extrema behind it.
#[inline]
pub fn quartic_first(c: &[f64; 5], lo: f64, hi: f64) -> Option<f64> {
    if !(lo < hi) || c.iter().any(|x| !x.is_finite()) || one_sign(c, lo, hi) {
        return None;
    }
    let d = [c[1], 2.0 * c[2], 3.0 * c[3], 4.0 * c[4]];
    let turns = quadratic_open(&[d[1], 2.0 * d[2], 3.0 * d[3]], lo, hi);
    let (mut from, mut f_from) = (lo, eval(c, lo));
    let mut to = |x: f64| {
        let f = eval(c, x);
        if negative(f_from) != negative(f) && x > from {
            return Some(bracketed(c, from, x, f_from, f, EXACT));
        }
        (from, f_from) = (x, f);
        None
    };
    let (mut a, mut da) = (lo, eval(&d, lo));
    for &b in turns.iter().chain(std::iter::once(&hi)) {
        let db = eval(&d, b);
        if negative(da) != negative(db)
            && b > a
            && let Some(root) = to(bracketed(&d, a, b, da, db, DIVIDING))
        {
            return Some(root);
        }
        (a, da) = (b, db);
    }
    to(hi)
}

/// Whether a quartic keeps its sign in [lo, hi] for sure: so do its Bernstein coefficients then (Farouki, "The Bernstein polynomial basis: A
/// centennial retrospective", CAGD 29, 2012, section 5). The usual case of lines that pass a shape.
#[inline(always)]
fn one_sign(c: &[f64; 5], lo: f64, hi: f64) -> bool {
    let w = hi - lo;
    // Taylor coefficients at lo, in units of the width.
    let [mut a0, mut a1, mut a2, mut a3, a4] = *c;
    a3 += a4 * lo;
    a2 += a3 * lo;
    a1 += a2 * lo;
    a0 += a1 * lo;
    a3 += a4 * lo;
    a2 += a3 * lo;
    a1 += a2 * lo;
    a3 += a4 * lo;
    a2 += a3 * lo;
    a3 += a4 * lo;
    let (w2, a1) = (w * w, a1 * w);
    let (a2, a3, a4) = (a2 * w2, a3 * w2 * w, a4 * w2 * w2);
    let b1 = a0 + a1 * 0.25;
    let b2 = a0 + a1 * 0.5 + a2 * (1.0 / 6.0);
    let b3 = a0 + a1 * 0.75 + a2 * 0.5 + a3 * 0.25;
    let b4 = a0 + a1 + a2 + a3 + a4;
    let smallest = a0.min(b1).min(b2).min(b3).min(b4);
    let largest = a0.max(b1).max(b2).max(b3).max(b4);
    smallest > 0.0 || largest < 0.0
}

/// Roots of a sextic in [lo, hi], ascending.
pub fn sextic_in(c: &[f64; 7], lo: f64, hi: f64) -> ArrayVec<f64, 6> {
    let mut out = ArrayVec::new();
    if !(lo < hi) || c.iter().any(|x| !x.is_finite()) {
        return out;
    }
    let d1 = [c[1], 2.0 * c[2], 3.0 * c[3], 4.0 * c[4], 5.0 * c[5], 6.0 * c[6]];
    let d2 = [d1[1], 2.0 * d1[2], 3.0 * d1[3], 4.0 * d1[4], 5.0 * d1[5]];
    let turns = quartic_in(&d2, lo, hi);
    let mut extrema = ArrayVec::<f64, 5>::new();
    between_to(&d1, &turns, lo, hi, DIVIDING, &mut extrema);
    between(c, &extrema, lo, hi, &mut out);
    out
}

/// Roots of a polynomial up to degree [`MAX_DEGREE`] in [lo, hi], ascending; none for higher degrees and where a coefficient is not finite.
/// Time grows with the square of the degree at least.
pub fn polynomial_in(c: &[f64], lo: f64, hi: f64) -> Roots {
    let mut out = Roots::new();
    if !(lo < hi) || c.iter().any(|x| !x.is_finite()) {
        return out;
    }
    // Derivatives cost; vanishing leading terms need none.
    let n = c.iter().rposition(|&x| x != 0.0).map_or(0, |n| n + 1);
    let c = &c[..n];
    match *c {
        [] | [_] => return out,
        [c0, c1] => {
            between(&[c0, c1], &[], lo, hi, &mut out);
            return out;
        }
        [c0, c1, c2] => return quadratic_in(&[c0, c1, c2], lo, hi).into_iter().collect(),
        [c0, c1, c2, c3] => return cubic_in(&[c0, c1, c2, c3], lo, hi).into_iter().collect(),
        [c0, c1, c2, c3, c4] => return quartic_in(&[c0, c1, c2, c3, c4], lo, hi).into_iter().collect(),
        _ if n > MAX_DEGREE + 1 => return out,
        _ => {}
    }
    // From the second derivative of degree 4 upward. The derivative of order k over k! keeps the numbers small.
    let mut taylor = [0.0; MAX_DEGREE + 1];
    let derivative = |k: usize, into: &mut [f64; MAX_DEGREE + 1]| {
        for (i, slot) in into[..n - k].iter_mut().enumerate() {
            *slot = c[i + k] * BINOMIALS[i + k][k];
        }
    };
    let k = n - 5;
    derivative(k, &mut taylor);
    let mut extrema: Roots = quartic_in(&[taylor[0], taylor[1], taylor[2], taylor[3], taylor[4]], lo, hi).into_iter().collect();
    for k in (0..k).rev() {
        derivative(k, &mut taylor);
        out.clear();
        between(&taylor[..n - k], &extrema, lo, hi, &mut out);
        extrema.clone_from(&out);
    }
    out
}

/// Binomial coefficients n over k.
const BINOMIALS: [[f64; MAX_DEGREE + 1]; MAX_DEGREE + 1] = {
    let mut b = [[0.0; MAX_DEGREE + 1]; MAX_DEGREE + 1];
    let mut n = 0;
    while n <= MAX_DEGREE {
        b[n][0] = 1.0;
        let mut k = 1;
        while k <= n {
            b[n][k] = b[n - 1][k - 1] + b[n - 1][k];
            k += 1;
        }
        n += 1;
    }
    b
};

/// A bound of the size of all roots, complex ones too (Fujiwara 1916); infinite for constants.
pub fn root_bound(c: &[f64]) -> f64 {
    let Some(n) = c.iter().rposition(|&x| x != 0.0) else { return f64::INFINITY };
    if n == 0 {
        return f64::INFINITY;
    }
    let lead = c[n].abs();
    let mut bound: f64 = 0.0;
    for (i, &a) in c[..n].iter().enumerate() {
        let ratio = a.abs() / lead;
        if ratio > 0.0 {
            let root = match n - i {
                1 => ratio,
                2 => ratio.sqrt(),
                4 => ratio.sqrt().sqrt(),
                k => etendue_procedural::fns::pow(ratio, 1.0 / k as f64),
            };
            bound = bound.max(root);
        }
    }
    2.0 * bound * (1.0 + 1e-9) + f64::MIN_POSITIVE
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A linear congruential generator (Knuth, MMIX) in [0, 1).
    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*state >> 11) as f64 / (1u64 << 53) as f64
    }

    fn expand(roots: &[f64], scale: f64) -> Vec<f64> {
        let mut c = vec![scale];
        for r in roots {
            let mut next = vec![0.0; c.len() + 1];
            for (i, a) in c.iter().enumerate() {
                next[i + 1] += a;
                next[i] -= a * r;
            }
            c = next;
        }
        c
    }

    #[test]
    fn the_first_root_of_quartics() {
        let mut s = 5;
        for i in 0..20_000 {
            let mut c = [0.0; 5].map(|_: f64| random(&mut s) * 2.0 - 1.0);
            if i % 3 == 0 {
                c[4] = 0.0;
            }
            let lo = -2.0 * random(&mut s);
            let (first, all) = (quartic_first(&c, lo, 1.5), quartic_in(&c, lo, 1.5));
            match (first, all.first()) {
                (Some(a), Some(b)) => assert!((a - b).abs() < 1e-12 * (1.0 + b.abs()), "{c:?}: {a} {b}"),
                (None, None) => {}
                other => panic!("{c:?} from {lo}: {other:?}"),
            }
        }
    }

    #[test]
    fn random_quartics_with_known_roots() {
        let mut s = 1;
        for _ in 0..20_000 {
            let mut roots: Vec<f64> = (0..4).map(|_| random(&mut s) * 4.0 - 2.0).collect();
            roots.sort_by(f64::total_cmp);
            let c: [f64; 5] = expand(&roots, random(&mut s) - 0.5).try_into().unwrap();
            let found = quartic_in(&c, -3.0, 3.0);
            let gap = roots.windows(2).map(|w| w[1] - w[0]).fold(1.0, f64::min);
            if gap < 1e-5 {
                continue;
            }
            assert_eq!(found.len(), 4, "{roots:?}");
            for (a, b) in found.iter().zip(&roots) {
                // The condition of a root falls with the distances to its neighbors.
                assert!((a - b).abs() < 1e-13 / (gap * gap), "{roots:?} {found:?}");
            }
        }
    }

    #[test]
    fn roots_a_millionth_apart_are_told_apart() {
        for gap in [1e-3, 1e-5, 1e-6] {
            let found = quartic_in(&expand(&[0.3, 0.3 + gap, 0.9, -0.4], 2.0).try_into().unwrap(), -1.0, 1.0);
            assert_eq!(found.len(), 4, "{gap}");
            assert!((found[2] - found[1] - gap).abs() < 0.01 * gap, "{gap} {found:?}");
            let found = sextic_in(&expand(&[0.3, 0.3 + gap, 0.9, -0.4, -0.4 - gap, 0.7], 2.0).try_into().unwrap(), -1.0, 1.0);
            assert_eq!(found.len(), 6, "{gap}");
        }
    }

    #[test]
    fn number_of_roots_has_the_parity_of_the_ends() {
        let mut s = 7;
        for round in 0..20_000 {
            let c: [f64; 7] = std::array::from_fn(|_| {
                let x = random(&mut s) - 0.5;
                // Zeros, and sizes far apart.
                if round % 3 == 0 && random(&mut s) < 0.3 { 0.0 } else { x * [1.0, 1e-9, 1e9][round % 3] }
            });
            let (lo, hi) = (-random(&mut s) * 3.0, random(&mut s) * 3.0);
            let q: [f64; 5] = c[..5].try_into().unwrap();
            let k: [f64; 4] = c[..4].try_into().unwrap();
            let z: [f64; 3] = c[..3].try_into().unwrap();
            for (poly, found) in [
                (&c[..], sextic_in(&c, lo, hi).len()),
                (&c[..], polynomial_in(&c, lo, hi).len()),
                (&q[..], quartic_in(&q, lo, hi).len()),
                (&k[..], cubic_in(&k, lo, hi).len()),
                (&z[..], quadratic_in(&z, lo, hi).len()),
            ] {
                let odd = negative(eval(poly, lo)) != negative(eval(poly, hi));
                assert_eq!(found % 2 == 1, odd, "{poly:?} {lo} {hi}");
            }
        }
    }

    #[test]
    fn high_degrees() {
        // Chebyshev polynomials: all roots real, in (−1, 1), clustered at the ends.
        let (mut a, mut b) = (vec![1.0], vec![0.0, 1.0]);
        for n in 2..=24 {
            let mut c = vec![0.0; n + 1];
            for (i, x) in b.iter().enumerate() {
                c[i + 1] += 2.0 * x;
            }
            for (i, x) in a.iter().enumerate() {
                c[i] -= x;
            }
            a = std::mem::replace(&mut b, c);
            let found = polynomial_in(&b, -1.0, 1.0);
            assert_eq!(found.len(), n);
            for (k, x) in found.iter().rev().enumerate() {
                let exact = etendue_procedural::fns::cos(std::f64::consts::PI * (k as f64 + 0.5) / n as f64);
                assert!((x - exact).abs() < 1e-6, "{n} {k} {x} {exact}");
            }
            assert!(root_bound(&b) >= 1.0 - 1e-3 || found.iter().all(|x| x.abs() <= root_bound(&b)));
        }
        let mut c = vec![0.0; 36];
        c[35] = 1.0;
        c[0] = -0.5;
        let found = polynomial_in(&c, -2.0, 2.0);
        assert_eq!(found.len(), 1);
        assert!((eval(&c, found[0])).abs() < 1e-13);
    }

    #[test]
    fn hostile_coefficients() {
        for bad in [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e300, -1e300, 1e-300, 0.0] {
            for at in 0..7 {
                let mut c = [1.0, -2.0, 0.5, 0.3, -0.7, 0.1, 0.4];
                c[at] = bad;
                for (lo, hi) in [(0.0, 1.0), (-1e300, 1e300), (f64::NEG_INFINITY, f64::INFINITY), (f64::NAN, 1.0), (1.0, 0.0)] {
                    assert!(sextic_in(&c, lo, hi).len() <= 6);
                    assert!(polynomial_in(&c, lo, hi).len() <= 6);
                    assert!(quartic_in(&c[..5].try_into().unwrap(), lo, hi).len() <= 4);
                    assert!(cubic_in(&c[..4].try_into().unwrap(), lo, hi).len() <= 3);
                    assert!(quadratic(&c[..3].try_into().unwrap()).len() <= 2);
                }
            }
        }
        assert!(polynomial_in(&[1.0; 60], 0.0, 1.0).is_empty());
    }
}
