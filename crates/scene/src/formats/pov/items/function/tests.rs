use etendue_procedural::Context;
use glam::DVec3;

use super::*;

/// Value of a function given as `(parameters) { body }` or `{ body }`.
fn value(function: &str, arguments: &[f64]) -> Result<f64, String> {
    let mut p = Parser::from_text(&format!("function {function}"));
    match p.function() {
        Ok(f) => Ok(f.eval(arguments, &Context::at(DVec3::ZERO))),
        Err(_) => Err(format!("{:?}", p.report)),
    }
}

/// Bodies of functions of `a`, its value, and the value that POV-Ray 3.7.0 writes.
#[test]
fn values_are_those_of_pov_ray() {
    const NAN: f64 = f64::NAN;
    const INF: f64 = f64::INFINITY;
    for (body, a, v) in [
        ("sqrt(a)", -1.0, NAN),
        ("ln(a)", 0.0, -INF),
        ("log(a)", 100.0, 2.0),
        ("1/a", 0.0, INF),
        ("0/a", 0.0, NAN),
        ("pow(a,1/3)", -8.0, NAN),
        ("pow(a,2)", -3.0, 9.0),
        ("pow(a,-1)", 0.0, INF),
        ("pow(0,a)", 0.0, 1.0),
        ("asin(a)", 2.0, NAN),
        ("mod(a,3)", -5.0, -2.0),
        ("mod(a,0)", 5.0, NAN),
        ("mod(a,-3)", 5.0, 2.0),
        ("int(a)", -1.5, -1.0),
        ("int(a)", 1e12, -2147483648.0),
        ("floor(a)", -1.5, -2.0),
        ("ceil(a)", -1.5, -1.0),
        ("div(a,2)", -7.5, -3.0),
        ("div(7.5,a)", 0.0, -2147483648.0),
        ("exp(a)", 800.0, INF),
        ("atanh(a)", 1.0, INF),
        ("acosh(a)", 2.0, 1.3169578969248166),
        ("a<2", 1.0, 1.0),
        ("a<2<3", 1.0, 0.0),
        ("1<a=1", 3.0, 0.0),
        ("a=1", 1.0 + 1e-12, 0.0),
        ("a&0.5", 0.3, 1.0),
        ("a|0", 1e-12, 1.0),
        ("1|a&0", 2.0, 1.0),
        ("-a*2+3", 3.0, -3.0),
        ("2/-a", 4.0, -0.5),
        ("a--1", 1.0, 2.0),
        ("a-1-1", 5.0, 3.0),
        ("8/a/2", 4.0, 1.0),
        ("1+2*a-3/a", 3.0, 6.0),
        ("select(a,1,2)", 0.0, 2.0),
        ("select(a,1,2)", -1.0, 1.0),
        ("select(a,1,2,3)", 0.0, 2.0),
        ("select(a,1,2,3)", 4.0, 3.0),
        ("select(a,1,2,3)", -4.0, 1.0),
        ("min(a,1,2)", 3.0, 1.0),
        ("max(a,1,7,2)", 1.0, 7.0),
        ("min(a,0/0)", 1.0, 1.0),
        ("sum(i,1,a,i*i)", 4.0, 30.0),
        ("sum(i,1,3,sum(k,1,i,k*a))", 1.0, 10.0),
        ("sum(i,0.5,a,i)", 3.2, 4.5),
        ("prod(i,1,a,i)", 5.0, 120.0),
        ("prod(i,a,1,i)", 4.0, 1.0),
        ("atan2(a,1)", 1.0, std::f64::consts::FRAC_PI_4),
        ("degrees(a)", std::f64::consts::PI, 180.0),
        ("pi*a", 1.0, std::f64::consts::PI),
        ("2*sqr(a) - a", 3.0, 15.0),
    ] {
        let got = value(&format!("(a) {{ {body} }}"), &[a]).unwrap();
        assert!((got - v).abs() < 1e-14 || got == v || (got.is_nan() && v.is_nan()), "{body} of {a}: {got} instead of {v}");
    }
}

#[test]
fn parameters_go_by_their_names() {
    assert_eq!(value("(z,y) { y+z*10 }", &[5.0, 6.0]), Ok(56.0));
    assert_eq!(value("(u,v) { x+y*10 }", &[5.0, 6.0]), Ok(65.0));
    assert_eq!(value("{ x + y*10 + z*100 }", &[1.0, 2.0, 3.0]), Ok(321.0));
    assert_eq!(value("{ internal(61) }", &[1.0, 2.0, 2.0, 0.5]), Ok(2.5));
    for wrong in ["(a) { x }", "{ q }", "{ min(x) }", "{ pow(x) }", "{ internal(77) }", "{ x + }", "{ internal(-1) }", "{ <1,2,3> }", "{ x"]
    {
        assert!(value(wrong, &[1.0]).is_err(), "{wrong}");
    }
}

#[test]
fn functions_call_functions() {
    let text = "#declare F = function(a) { a*a + 1 } #declare T = function { transform { translate x*10 scale 2 } }
        #declare S = function { spline { linear_spline 0,<0,0> 2,<2,4> } } #declare A = array[2] { 7, 8 } #declare V = <3,4,5>;
        function (p, q) { F(p + q) + F(F(1)) * T(p, q, 0).y + S(q).y + A[1] + V.z }";
    let mut p = Parser::from_text(text);
    // The directives are obeyed on the way to the item.
    let f = p.function().unwrap();
    let (a, b) = (0.25, 0.5);
    let expected = (a + b) * (a + b) + 1.0 + 5.0 * (2.0 * b) + 2.0 * b + 8.0 + 5.0;
    assert_eq!(f.eval(&[a, b], &Context::at(DVec3::ZERO)), expected);
    let mut p = Parser::from_text("#declare F = function(a) { a*a + 1 } function { F(x, y) }");
    assert!(p.function().is_err(), "one argument too many");
}

#[test]
fn splines_are_read() {
    let mut p = Parser::from_text("#declare S = spline { 1, <1,2,3> 0, <0,0,0,5> } spline { S natural_spline 2, <3,3>, }");
    let s = p.spline().unwrap();
    assert_eq!((s.kind(), s.components(), s.points().len()), (SplineKind::Natural, 4, 3));
    assert_eq!(s.eval(0.0), [0.0, 0.0, 0.0, 5.0, 0.0]);
    assert!(Parser::from_text("spline { linear_spline }").spline().is_err());
}

#[test]
fn hostile_functions_end() {
    let deep = format!("{{ {}x{} }}", "(".repeat(100_000), ")".repeat(100_000));
    assert!(value(&deep, &[1.0]).is_err());
    assert_eq!(value(&format!("{{ {}x }}", "-".repeat(100_001)), &[1.0]), Ok(-1.0));
    assert_eq!(value(&format!("{{ x{} }}", "+x".repeat(50_000)), &[1.0]), Ok(50_001.0));
    assert_eq!(value(&format!("{{ 1{} }}", "<1".repeat(50_001)), &[1.0]), Ok(0.0));
    // A function that doubles its calls at each of many levels runs out of fuel, not out of time.
    let mut text = "#declare F0 = function(x) { sum(i, 1, 3, sin(x + i)) }\n".to_owned();
    for i in 1..50 {
        text.push_str(&format!("#declare F{i} = function(x) {{ F{0}(x) + F{0}(x + {i}) }}\n", i - 1));
    }
    text.push_str("function(x) { F49(x) }");
    let mut p = Parser::from_text(&text);
    let f = p.function().unwrap();
    assert!(f.eval(&[0.1], &Context::at(DVec3::ZERO)).is_nan());
    // Deeper than calls may go.
    let mut text = "#declare F0 = function(x) { sum(i, 1, 3, sin(x + i)) }\n".to_owned();
    for i in 1..100 {
        text.push_str(&format!("#declare F{i} = function(x) {{ sum(i, 1, 2, F{}(x)) }}\n", i - 1));
    }
    text.push_str("function(x) { F99(x) }");
    assert!(Parser::from_text(&text).function().is_err());
}
