use super::*;

fn at(f: &Function, a: &[f64]) -> f64 {
    f.eval(a, &Context::at(DVec3::ZERO))
}
#[test]
fn loops_and_selections() {
    // sum(i, 1, a, select(i − 2, 1, 10, 100)): by hand 1 + 10 + 100 + 100.
    let mut b = Builder::new(vec!["a".into()]);
    let (a, one) = (b.parameter("a").unwrap(), b.number(1.0));
    let l = b.begin_loop("i".into(), one, a, false);
    let (i, two) = (b.parameter("i").unwrap(), b.number(2.0));
    let d = b.binary(Binary::Subtract, i, two);
    let mut s = b.begin_select(d);
    let values = [1.0, 10.0, 100.0].map(|v| b.number(v));
    b.next_case(&mut s, values[0]);
    b.next_case(&mut s, values[1]);
    let term = b.end_select(s, values[2]);
    let sum = b.end_loop(l, term);
    let f = b.finish(sum).unwrap();
    assert_eq!(at(&f, &[4.0]), 211.0);
    assert_eq!(at(&f, &[0.0]), 0.0);
    assert!(at(&f, &[1e300]).is_nan(), "an endless loop ends with NaN");
    assert!(f.program().unwrap().is_valid());
}

#[test]
fn calls_are_put_in_and_values_found_again() {
    // f(x) = x² + 1; g(x, y) = f(x + y) · f(x + y) + f(3).
    let mut b = Builder::new(vec!["x".into()]);
    let x = b.parameter("u").unwrap();
    let (xx, one) = (b.unary(Unary::Sqr, x), b.number(1.0));
    let r = b.binary(Binary::Add, xx, one);
    let f = Arc::new(b.finish(r).unwrap());
    let mut b = Builder::new(vec!["x".into(), "y".into()]);
    let (x, y, three) = (b.parameter("x").unwrap(), b.parameter("y").unwrap(), b.number(3.0));
    let s = b.binary(Binary::Add, x, y);
    let (p, q, c) =
        (b.call(&f, &[s], Component::Number(0)), b.call(&f, &[s], Component::Number(0)), b.call(&f, &[three], Component::Number(0)));
    assert_eq!(p, q);
    let pq = b.binary(Binary::Multiply, p, q);
    let r = b.binary(Binary::Add, pq, c);
    let g = b.finish(r).unwrap();
    assert_eq!(at(&g, &[1.0, 2.0]), 110.0);
    assert_eq!(g.program().unwrap().code.len(), 5, "x + y, its square, + 1, product, + 10");
}

#[test]
fn vector_functions_give_components() {
    let m = DMat4::from_scale(DVec3::splat(2.0)) * DMat4::from_translation(DVec3::new(10.0, 0.0, 0.0));
    let t = Arc::new(Function::transform(m));
    let mut b = Builder::new(xyz());
    let p: Vec<_> = ["z", "y", "x"].map(|n| b.parameter(n).unwrap()).to_vec();
    let gray = b.call(&t, &p, Component::Gray);
    let y = b.call(&t, &p, Component::from_name("v").unwrap());
    let r = b.binary(Binary::Add, gray, y);
    let f = b.finish(r).unwrap();
    let expected = 0.297 * (2.0 * 13.0) + 0.589 * 4.0 + 0.114 * 2.0 + 4.0;
    assert!((at(&f, &[1.0, 2.0, 3.0]) - expected).abs() < 1e-12);
}
