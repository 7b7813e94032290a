//! Primitives against their own insides, combinations against Boolean identities, worlds against linear scans.

use std::sync::Arc;

use etendue_scene::desc::classic::{CurveKind, Mesh, Object, Outline, OutlineSegment, Solid, TextShape, Triangle};
use etendue_scene::span::Span;
use glam::{DAffine3, DMat3, DMat4, DVec2, DVec3};

use super::compile::{Compiler, Shape};
use super::testing::Random;
use super::{Line, Primitive, RayKind, World};

fn object(solid: Solid) -> Object {
    Object::new(Span::default(), solid)
}

fn arc(solid: Solid) -> Arc<Object> {
    Arc::new(object(solid))
}

fn moved(solid: Solid, m: DMat4) -> Arc<Object> {
    let mut o = object(solid);
    o.transform(&m);
    Arc::new(o)
}

fn shape(solid: &Solid) -> Option<Shape> {
    Compiler::new(None).shape(solid)
}

fn sphere(x: f64, radius: f64) -> Solid {
    Solid::Sphere { center: DVec3::X * x, radius }
}

fn cube(side: f64) -> Solid {
    Solid::Box { corners: [DVec3::splat(side), DVec3::splat(-side)] }
}

/// A closed mesh: octahedron.
fn octahedron() -> Mesh {
    Mesh {
        vertices: vec![DVec3::X, DVec3::Y, DVec3::Z, -DVec3::X, -DVec3::Y, -DVec3::Z],
        faces: vec![[0, 2, 1], [1, 2, 3], [3, 2, 4], [4, 2, 0], [1, 5, 0], [3, 5, 1], [4, 5, 3], [0, 5, 4]],
        inside_vector: Some(DVec3::new(0.3, 0.5, 0.7)),
        ..Mesh::default()
    }
}

/// A ring of straight and curved pieces with a square hole; outlines run with the ink on their right.
fn letter() -> TextShape {
    let p = DVec2::new;
    let line = |a: DVec2, b: DVec2| OutlineSegment::Line([a, b]);
    let outer = vec![
        OutlineSegment::Quadratic([p(0.0, 0.0), p(-0.5, 0.5), p(0.0, 1.0)]),
        line(p(0.0, 1.0), p(1.0, 1.0)),
        OutlineSegment::Quadratic([p(1.0, 1.0), p(1.2, 0.2), p(1.0, 0.0)]),
        line(p(1.0, 0.0), p(0.0, 0.0)),
    ];
    let hole = vec![
        line(p(0.3, 0.3), p(0.7, 0.3)),
        line(p(0.7, 0.3), p(0.7, 0.7)),
        line(p(0.7, 0.7), p(0.3, 0.7)),
        line(p(0.3, 0.7), p(0.3, 0.3)),
    ];
    TextShape {
        thickness: 0.5,
        outlines: vec![Outline { contours: vec![outer, hole] }],
        glyphs: vec![(0, DVec3::ZERO), (0, DVec3::X * 1.7)],
    }
}

fn solids() -> Vec<(&'static str, Solid)> {
    let v = DVec3::new;
    vec![
        ("sphere", Solid::Sphere { center: v(0.2, -0.1, 0.3), radius: 0.9 }),
        ("box", Solid::Box { corners: [v(0.8, -0.5, 0.2), v(-0.3, 0.6, -0.9)] }),
        ("cone", Solid::Cone { base: v(0.1, -0.8, 0.0), base_radius: 0.9, cap: v(0.3, 0.9, -0.2), cap_radius: 0.2, open: false }),
        ("point", Solid::Cone { base: v(0.1, -0.8, 0.0), base_radius: 0.0, cap: v(0.3, 0.9, -0.2), cap_radius: 0.7, open: false }),
        ("cylinder", Solid::Cylinder { base: v(-0.7, -0.5, 0.1), cap: v(0.7, 0.5, 0.2), radius: 0.4, open: false }),
        ("torus", Solid::Torus { major: 0.9, minor: 0.3 }),
        ("plane", Solid::Plane { normal: v(0.3, 2.0, -0.4), distance: 0.2 }),
        ("mesh", Solid::Mesh(Arc::new(octahedron()))),
        ("ellipsoid", Solid::Quadric { squares: v(1.5, 2.0, 3.0), mixed: v(0.4, -0.3, 0.2), linear: v(0.1, 0.2, -0.3), constant: -1.0 }),
        ("outside", Solid::Quadric { squares: -DVec3::ONE, mixed: DVec3::ZERO, linear: DVec3::ZERO, constant: 1.0 }),
        ("hyperboloid", Solid::Quadric { squares: v(1.0, -1.0, 1.0), mixed: DVec3::ZERO, linear: DVec3::ZERO, constant: -0.2 }),
        ("pipe", Solid::Quadric { squares: v(1.0, 0.0, 2.0), mixed: v(0.0, 0.3, 0.0), linear: v(0.2, 0.0, 0.0), constant: -0.3 }),
        ("text", Solid::Text(Arc::new(letter()))),
    ]
}

/// Inside changes exactly at crossings, normals point from inside to outside and along the gradient, and all is within the bounds.
#[test]
fn crossings_agree_with_inside() {
    let mut r = Random::new(1);
    for (name, solid) in solids() {
        let shape = shape(&solid).unwrap();
        let mut hits = Vec::new();
        let mut crossed = 0;
        for _ in 0..4000 {
            let line = Line { o: r.vector() * 3.0, d: r.vector() };
            hits.clear();
            shape.crossings(&line, 0.0, 5.0, &mut hits);
            hits.sort_by(|a, b| a.t.total_cmp(&b.t));
            let nearest = shape.nearest(&line, 0.0, 5.0, &mut Vec::new());
            assert_eq!(nearest.map(|c| c.t), hits.first().map(|c| c.t), "{name}");
            let mut inside = shape.inside(line.o);
            let mut last = 0.0;
            for (i, hit) in hits.iter().enumerate() {
                let next = hits.get(i + 1).map_or(5.0, |h| h.t);
                let middle = line.at(0.5 * (last + hit.t));
                // Very near pairs are beyond what points can tell.
                if hit.t - last > 1e-9 {
                    assert_eq!(shape.inside(middle), inside, "{name}: before {hit:?} of {line:?}");
                }
                inside = !inside;
                let p = line.at(hit.t);
                assert!(shape.bounds().padded().contains(p), "{name}: {p} beyond the bounds");
                let n = shape.normal(p, hit);
                assert!((n.length() - 1.0).abs() < 1e-9, "{name}: normal {n}");
                // Normals of letters' walls point inside, as POV-Ray's do.
                let n = if name == "text" && hit.part > 1 { -n } else { n };
                if next - hit.t > 1e-4 && hit.t - last > 1e-4 && n.dot(line.d).abs() > 0.05 {
                    assert_eq!(n.dot(line.d) < 0.0, inside, "{name}: normal {n} of {hit:?} on {line:?}");
                    assert!(!shape.inside(p + n * 1e-6) || shape.inside(p - n * 1e-6), "{name}: normal at {p}");
                }
                last = hit.t;
                crossed += 1;
            }
            if 5.0 - last > 1e-9 {
                assert_eq!(shape.inside(line.at(0.5 * (last + 5.0))), inside, "{name}: after the last of {hits:?} on {line:?}");
            }
            let p = r.vector() * 2.0;
            assert!(!shape.inside(p) || shape.inside_bounds().padded().contains(p), "{name}: inside beyond the box");
        }
        assert!(crossed > 100, "{name}: {crossed} crossings");
    }
}

/// Tangential displacements stay on the surface to first order: the normal is the surface's.
#[test]
fn normals_are_of_the_surface() {
    let mut r = Random::new(2);
    for (name, solid) in solids() {
        let shape = shape(&solid).unwrap();
        let mut hits = Vec::new();
        let mut wrong = 0;
        let mut all = 0;
        for _ in 0..1000 {
            let line = Line { o: r.vector() * 3.0, d: r.vector() };
            hits.clear();
            shape.crossings(&line, 0.0, 9.0, &mut hits);
            for hit in &hits {
                let p = line.at(hit.t);
                let n = shape.normal(p, hit);
                let (u, v) = n.any_orthonormal_pair();
                for tangent in [u, v] {
                    // A line along the normal beside the point meets the surface at a height of second order.
                    let h = 1e-4;
                    let beside = Line { o: p + tangent * h + n * 1e-2, d: -n };
                    let met = shape.nearest(&beside, 0.0, 2e-2, &mut Vec::new());
                    all += 1;
                    wrong += u32::from(!met.is_some_and(|m| (m.t - 1e-2).abs() < 0.05 * h));
                }
            }
        }
        // Edges and strong curvature excepted.
        assert!(f64::from(wrong) < 0.03 * f64::from(all), "{name}: {wrong} of {all}");
    }
}

#[test]
fn hostile_sizes() {
    let odd = [0.0, -0.0, 1.0, -1.0, 1e-300, 1e300, f64::NAN, f64::INFINITY, f64::MIN_POSITIVE];
    let mut r = Random::new(3);
    let mut pick = || odd[(r.unit() * odd.len() as f64) as usize];
    for k in 0..4000 {
        let (a, b, c, d) = (pick(), pick(), pick(), pick());
        let (p, q) = (DVec3::new(a, b, c), DVec3::new(d, a, b));
        let solid = match k % 11 {
            0 => Solid::Sphere { center: p, radius: d },
            1 => Solid::Box { corners: [p, q] },
            2 => Solid::Cone { base: p, base_radius: a, cap: q, cap_radius: b, open: false },
            3 => Solid::Cylinder { base: p, cap: q, radius: d, open: k % 2 == 0 },
            4 => Solid::Torus { major: a, minor: b },
            5 => Solid::Plane { normal: p, distance: d },
            6 => Solid::Disc { center: p, normal: q, radius: c, hole_radius: d },
            7 => Solid::Triangle(Box::new(Triangle { corners: [p, q, DVec3::splat(c)], normals: Some([q, p, q]) })),
            8 => Solid::Polygon(Arc::new(vec![p, q, DVec3::new(c, d, a), DVec3::ONE, p])),
            9 => Solid::Quadric { squares: p, mixed: q, linear: DVec3::splat(d), constant: a },
            _ => Solid::Mesh(Arc::new(Mesh { vertices: vec![p, q, DVec3::ONE], faces: vec![[0, 1, 2], [0, 1, 9]], ..Mesh::default() })),
        };
        let m = DMat4::from_scale(DVec3::new(pick(), 1.0, pick()));
        let world = World::new(&[moved(solid.clone(), m), arc(solid)]);
        let line = Line { o: DVec3::new(pick(), 0.1, pick()), d: DVec3::new(pick(), 0.3, 0.2) };
        for l in [line, Line { o: DVec3::splat(-3.0), d: DVec3::ONE.normalize() }] {
            let _ = world.nearest(&l, 1e-6, f64::INFINITY, RayKind::Camera);
            world.visit(&l, 1e-6, 1e9, RayKind::Shadow, &mut |_| true);
            world.containing(l.o, &mut |_, _| {});
        }
    }
}

/// All hits along a line, sorted.
fn hits(world: &World, line: &Line) -> Vec<f64> {
    let mut t = Vec::new();
    world.visit(line, 0.0, 100.0, RayKind::Photon, &mut |h| {
        t.push(h.t);
        true
    });
    t.sort_by(f64::total_cmp);
    t
}

fn transforms() -> Vec<DMat4> {
    vec![
        DMat4::IDENTITY,
        DMat4::from_translation(DVec3::new(0.3, 0.1, -0.2)),
        DMat4::from_scale(DVec3::new(0.5, 1.5, 0.8)) * DMat4::from_translation(DVec3::X * 0.1),
        DMat4::from_rotation_x(0.7) * DMat4::from_scale(DVec3::splat(0.8)),
        DMat4::from_rotation_z(1.1) * DMat4::from_scale(DVec3::new(-0.6, 0.9, 1.2)),
        // A shear, as from matrix <...>.
        DMat4::from_mat3(DMat3::from_cols(DVec3::X, DVec3::new(0.5, 1.0, 0.0), DVec3::new(0.0, 0.3, 0.7))),
    ]
}

/// Transformed shapes are the shapes met by transformed lines, with normals that still point outside.
#[test]
fn transforms_of_shapes() {
    let mut r = Random::new(4);
    for (name, solid) in solids() {
        for (k, m) in transforms().into_iter().enumerate() {
            let world = World::new(&[moved(solid.clone(), m)]);
            let shape = shape(&solid).unwrap();
            let inverse = DAffine3::from_mat4(m).inverse();
            for _ in 0..200 {
                let line = Line { o: r.vector() * 3.0, d: r.vector().normalize() };
                let mut own = Vec::new();
                shape.crossings(&Line { o: inverse.transform_point3(line.o), d: inverse.matrix3 * line.d }, 0.0, 100.0, &mut own);
                let mut expected: Vec<f64> = own.iter().map(|c| c.t).collect();
                expected.sort_by(f64::total_cmp);
                let found = hits(&world, &line);
                let same = found.len() == expected.len() && found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-6 * (1.0 + a));
                // Grazing pairs may vanish.
                let grazing = expected.len() >= 2 && expected.windows(2).any(|w| w[1] - w[0] < 1e-4);
                assert!(same || grazing, "{name} {k}: {found:?}, not {expected:?}");
                if let Some(h) = world.nearest(&line, 0.0, 100.0, RayKind::Camera) {
                    assert!((h.n.length() - 1.0).abs() < 1e-9);
                    let inside = world.inside(line.at(h.t * (1.0 - 1e-7)));
                    let n_ok = name == "text" || h.n.dot(line.d).abs() < 0.05;
                    assert!(n_ok || (h.n.dot(line.d) > 0.0) == inside, "{name} {k}: normal");
                }
                assert_eq!(world.inside(line.o), shape.inside(inverse.transform_point3(line.o)), "{name} {k}");
            }
        }
    }
}

/// inside() of combinations is Boolean, and their surfaces are where it changes.
#[test]
fn combinations() {
    let mut r = Random::new(5);
    let parts = || vec![arc(cube(0.8)), arc(sphere(0.4, 0.9)), moved(cube(0.5), DMat4::from_rotation_z(0.6))];
    let mut inverse = object(Solid::Union(parts()));
    inverse.inverse = true;
    let (a, b, c) = (World::new(&parts()[..1]), World::new(&parts()[1..2]), World::new(&parts()[2..]));
    type Rule = fn(bool, bool, bool) -> bool;
    let cases: Vec<(&str, Object, Rule)> = vec![
        ("intersection", object(Solid::Intersection(parts())), |a, b, c| a && b && c),
        ("difference", object(Solid::Difference(parts())), |a, b, c| a && !b && !c),
        ("merge", object(Solid::Merge(parts())), |a, b, c| a || b || c),
        ("inverse union", inverse, |a, b, c| !(a || b || c)),
        ("nested", object(Solid::Difference(vec![parts()[0].clone(), arc(Solid::Intersection(parts()[1..].to_vec()))])), |a, b, c| {
            a && !(b && c)
        }),
        (
            "box minus sphere or inside both",
            object(Solid::Merge(vec![arc(Solid::Difference(parts()[..2].to_vec())), arc(Solid::Intersection(parts()[..2].to_vec()))])),
            |a, _, _| a,
        ),
    ];
    for (name, o, rule) in cases {
        let world = World::new(&[Arc::new(o)]);
        for _ in 0..1500 {
            let line = Line { o: r.vector() * 2.0, d: r.vector().normalize() };
            let expected = |p: DVec3| rule(a.inside(p), b.inside(p), c.inside(p));
            assert_eq!(world.inside(line.o), expected(line.o), "{name} at {}", line.o);
            let mut state = expected(line.o);
            let mut last = 0.0;
            let found = hits(&world, &line);
            for &t in &found {
                if t - last > 1e-6 {
                    assert_eq!(expected(line.at(0.5 * (t + last))), state, "{name}: {found:?}");
                    last = t;
                }
                // Coincident faces of "box minus sphere or both" may be there twice or not at all.
                state = expected(line.at(t + 1e-7));
            }
            if name != "nested" && name != "box minus sphere or inside both" {
                let changes = (0..400).map(|i| expected(line.at(f64::from(i) * 0.01))).collect::<Vec<_>>();
                let expected = changes.windows(2).filter(|w| w[0] != w[1]).count();
                assert!(found.iter().filter(|t| **t < 3.99).count() >= expected, "{name}: {found:?}, {expected} changes");
            }
            let nearest = world.nearest(&line, 0.0, 100.0, RayKind::Camera).map(|h| h.t);
            assert_eq!(nearest, found.first().copied(), "{name}");
        }
    }
}

#[test]
fn clips_and_flags() {
    let mut o = object(sphere(0.0, 1.0));
    o.clipped_by.push(arc(Solid::Plane { normal: DVec3::Y, distance: 0.0 }));
    o.no_image = true;
    let world = World::new(&[Arc::new(o)]);
    let down = Line { o: DVec3::new(0.1, 3.0, 0.0), d: DVec3::NEG_Y };
    assert!(world.nearest(&down, 0.0, 9.0, RayKind::Camera).is_none());
    let hit = world.nearest(&down, 0.0, 9.0, RayKind::Reflection).unwrap();
    assert!(hit.p.y < 0.0 && hit.n.y < 0.0, "the upper half is cut away: {hit:?}");
    assert!(world.bounds().max.y < 1e-6);
    // Clips move with the object.
    let mut o = object(sphere(0.0, 1.0));
    o.clipped_by.push(arc(Solid::Plane { normal: DVec3::Y, distance: 0.0 }));
    o.transform(&DMat4::from_rotation_x(std::f64::consts::PI));
    let world = World::new(&[Arc::new(o)]);
    assert!(world.nearest(&down, 0.0, 9.0, RayKind::Camera).unwrap().p.y > 0.0);
}

#[test]
fn parts_inherit() {
    use etendue_procedural::{Layer, Texture};
    let texture = Arc::new(Texture::Layers(vec![Layer::default()]));
    let mut part = object(sphere(3.0, 1.0));
    part.hollow_stated = true;
    let mut union = object(Solid::Union(vec![arc(sphere(0.0, 1.0)), Arc::new(part)]));
    union.texture = Some(texture.clone());
    union.hollow = true;
    union.hollow_stated = true;
    union.no_shadow = true;
    union.transform(&DMat4::from_translation(DVec3::Y * 5.0));
    let world = World::new(&[Arc::new(union)]);
    let seen: Vec<(bool, bool)> = [0.0, 3.0]
        .map(|x| {
            let hit = world.nearest(&Line { o: DVec3::new(x, 5.0, -9.0), d: DVec3::Z }, 0.0, 99.0, RayKind::Camera).unwrap();
            (hit.object.hollow, hit.object.texture.is_some())
        })
        .to_vec();
    assert_eq!(seen, [(true, true), (false, true)]);
    assert!(world.nearest(&Line { o: DVec3::new(0.0, 5.0, -9.0), d: DVec3::Z }, 0.0, 99.0, RayKind::Shadow).is_none());
    let mut inside = 0;
    world.containing(DVec3::new(0.0, 5.0, 0.0), &mut |_, _| inside += 1);
    assert_eq!(inside, 1);
}

/// A scene of all sorts against each object on its own.
#[test]
fn worlds_find_what_scans_find() {
    let mut r = Random::new(6);
    let all = solids();
    let mut objects = Vec::new();
    for k in 0..200 {
        let (_, solid) = &all[k % all.len()];
        if matches!(solid, Solid::Plane { .. } | Solid::Quadric { .. }) && k > 30 {
            continue;
        }
        let m = DMat4::from_translation(r.vector() * 10.0) * transforms()[k % 6];
        objects.push(match k % 3 {
            0 => moved(solid.clone(), m),
            1 => moved(Solid::Union(vec![arc(solid.clone()), moved(cube(0.2), DMat4::from_translation(DVec3::X))]), m),
            _ => moved(Solid::Difference(vec![arc(solid.clone()), arc(sphere(0.5, 0.5))]), m),
        });
    }
    let world = World::new(&objects);
    let single: Vec<World> = objects.iter().map(|o| World::new(std::slice::from_ref(o))).collect();
    for _ in 0..500 {
        let line = Line { o: r.vector() * 12.0, d: r.vector().normalize() };
        let expected = single.iter().filter_map(|w| w.nearest(&line, 0.0, 1e3, RayKind::Camera)).map(|h| h.t).fold(f64::INFINITY, f64::min);
        let found = world.nearest(&line, 0.0, 1e3, RayKind::Camera).map_or(f64::INFINITY, |h| h.t);
        // Roots of quartics may differ in their last bits, as they are looked for up to the nearest hit so far.
        assert!(found == expected || (found - expected).abs() < 1e-12 * expected, "{found}, not {expected}");
        let count: usize = single.iter().map(|w| hits(w, &line).len()).sum();
        assert_eq!(hits(&world, &line).len(), count);
        assert_eq!(world.inside(line.o), single.iter().any(|w| w.inside(line.o)));
    }
}

/// Many subtracted parts take the way through hierarchies.
/// From a camera to anywhere and from anywhere to a light, with planes and things around the place.
#[test]
fn outlooks_change_no_answer() {
    use std::sync::atomic::AtomicU32;
    let mut r = Random::new(5);
    for n in [3, 20, 200] {
        let mut objects: Vec<Arc<Object>> = (0..n)
            .map(|i| {
                let m = DMat4::from_translation(r.vector() * 6.0) * DMat4::from_scale(r.vector().abs() * 0.5 + 0.1);
                moved(if i % 2 == 0 { sphere(0.0, 1.0) } else { cube(1.0) }, m)
            })
            .collect();
        objects.push(arc(Solid::Plane { normal: DVec3::Y, distance: -3.0 }));
        let world = World::new(&objects);
        for _ in 0..20 {
            let place = r.vector() * 6.0;
            let outlook = world.outlook(place).unwrap();
            for _ in 0..200 {
                let p = r.vector() * 8.0;
                let (d, distance) = ((p - place).normalize(), (p - place).length());
                let line = Line { o: place, d };
                let [with, without] = [Some(&outlook), None]
                    .map(|o| world.nearest_from(o, &line, 1e-4, f64::INFINITY, RayKind::Camera).map(|h| (h.t, h.leaf)));
                assert_eq!(with, without);
                let back = Line { o: p, d: -d };
                let [with, without] = [Some(&outlook), None].map(|o| {
                    let mut hits = Vec::new();
                    let blocked = world.shadow(o, &back, 1e-3, distance - 1e-3, &AtomicU32::new(u32::MAX), &mut |hit| {
                        hits.push(hit.t);
                        true
                    });
                    hits.sort_by(f64::total_cmp);
                    // What blocks may be found before or behind the others.
                    (blocked, if blocked { Vec::new() } else { hits })
                });
                assert_eq!(with, without);
            }
        }
    }
}

#[test]
fn differences_of_many() {
    let mut r = Random::new(8);
    let holes: Vec<Arc<Object>> = (0..100).map(|_| moved(sphere(0.0, 0.2), DMat4::from_translation(r.vector()))).collect();
    let mut parts = vec![arc(cube(1.0))];
    parts.extend(holes.iter().cloned());
    let world = World::new(&[arc(Solid::Difference(parts))]);
    let union = World::new(&holes);
    let merge = World::new(&[arc(Solid::Difference(vec![arc(cube(1.0)), arc(Solid::Merge(holes))]))]);
    for _ in 0..2000 {
        let line = Line { o: r.vector() * 1.5, d: r.vector().normalize() };
        let inside = line.o.abs().max_element() <= 1.0 && !union.inside(line.o);
        assert_eq!(world.inside(line.o), inside);
        assert_eq!(hits(&world, &line), hits(&merge, &line));
    }
}

#[test]
fn unknown_shapes_are_left_out() {
    let none = Solid::Lathe { spline: CurveKind::Linear, points: Arc::new(Vec::new()) };
    assert_eq!(World::new(&[arc(none.clone())]).leaves(), 0);
    let world = World::new(&[arc(Solid::Difference(vec![arc(cube(1.0)), arc(none)]))]);
    assert!(world.inside(DVec3::ZERO));
}
