//! A camera that looks through an objective (Kolb, Mitchell, Hanrahan 1995, "A Realistic Camera Model for Computer Graphics",
//! doi:10.1145/218380.218463): rays start on the film and are refracted by each of its surfaces.
//!
//! Space: the film is the plane `a` = 0 of (x, y, a), the objective is in front of it at positive `a`. A ray starts to a random point of
//! the plane through the last surface's vertex, within a box that holds all through which light comes to that part of the film (the exit
//! pupil; Steinert et al. 2011, doi:10.1111/j.1467-8659.2011.01851.x). Of a few points of the box one is taken that light comes through.

use etendue_scene::desc::{ObjectiveDesc, StopShape};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::stop::{Stop, StopPicture};
use crate::math::{Vec2, Vec3};

/// Rings of the film, each of which has a box.
const RINGS: usize = 64;
/// Rows and columns of the rays that find a box, at first over all of the last surface and then over what they have found; and where
/// they find nothing.
const GRID: usize = 64;
const FINE_GRID: usize = 512;
/// Points of the pupil that are tried for one that light comes through.
const POINTS: u32 = 8;
/// The boxes lie within so many radii of the last surface.
const REACH: f64 = 1.5;

/// A surface of the objective.
#[derive(Clone, Copy, Debug)]
struct Interface {
    /// Where its vertex is.
    at: f64,
    /// Positive where its center lies towards the film; 0 is flat.
    radius: f64,
    /// Refractive index towards the film over that towards the scene.
    eta: f64,
    /// Square of the radius of its opening.
    opening: f64,
    /// Whether the opening has the shape of the stop.
    is_stop: bool,
}

/// A ray that has passed the objective.
#[derive(Clone, Copy, Debug)]
pub(super) struct Passed {
    /// In camera space, looking along −z.
    pub o: Vec3,
    /// Unit.
    pub d: Vec3,
    /// Irradiance of the film for each unit of radiance.
    pub weight: f32,
}

/// An objective that is focused.
#[derive(Clone, Debug)]
pub(super) struct Objective {
    /// From the film to the front.
    interfaces: Vec<Interface>,
    stop: Stop,
    /// Half of the film's width and height.
    film: DVec2,
    /// The boxes of the rings for film points at +x, from corner to corner.
    pupils: Vec<Option<[DVec2; 2]>>,
    /// From the film to the principal plane of its side.
    pub distance: f32,
}

impl Objective {
    /// Focuses an objective for a picture of an aspect ratio (width over height); `None` where it cannot focus.
    pub fn new(desc: &ObjectiveDesc, picture: Option<StopPicture>, aspect: f32) -> Option<Self> {
        let last = desc.film_distance().ok()?;
        let mut at = last;
        let mut interfaces = Vec::with_capacity(desc.interfaces.len());
        for (i, s) in desc.interfaces.iter().enumerate().rev() {
            let index = |i: usize| f64::from(desc.interfaces[i].ior);
            let towards_film = if i + 1 == desc.interfaces.len() { 1.0 } else { index(i) };
            let towards_scene = if i == 0 { 1.0 } else { index(i - 1) };
            if i + 1 < desc.interfaces.len() {
                at += f64::from(s.thickness);
            }
            let opening = f64::from(s.aperture_radius).powi(2);
            let is_stop = s.curvature_radius == 0.0 && desc.stop != StopShape::Circle;
            interfaces.push(Interface { at, radius: f64::from(s.curvature_radius), eta: towards_film / towards_scene, opening, is_stop });
        }
        let aspect = f64::from(aspect);
        let half_height = 0.5 * f64::from(desc.film_diagonal) / (1.0 + aspect * aspect).sqrt();
        let film = DVec2::new(aspect * half_height, half_height);
        let distance = (last + desc.thick_lens()?.principal[1]) as f32;
        let stop = Stop::new(desc.stop, picture);
        let mut objective = Self { interfaces, stop, film, pupils: Vec::new(), distance };
        objective.pupils = (0..RINGS).into_par_iter().map(|ring| objective.pupil(ring)).collect();
        Some(objective)
    }

    /// Half of the film's width and height.
    pub fn film(&self) -> Vec2 {
        self.film.as_vec2()
    }

    /// The ray from a point of the film, in units of half of its width and height with +x right and +y up in the picture, by a point of
    /// the pupil; `None` where it does not come through.
    pub fn ray(&self, picture: Vec2, u: Vec2) -> Option<Passed> {
        // The picture on the film is upside down.
        let film = -picture.as_dvec2() * self.film;
        let radius = film.length();
        let ring = (radius / self.film.length() * RINGS as f64) as usize;
        let [a, b] = (*self.pupils.get(ring.min(RINGS - 1))?)?;
        let turn = if radius > 0.0 { film / radius } else { DVec2::X };
        let last = self.interfaces.first()?.at;
        let o = film.extend(0.0);
        // The points of a lattice through `u`, of which each is as likely to be the first.
        let by = |point: u32| {
            let at = (u.as_dvec2() + DVec2::new(1.0, 3.0) * f64::from(point) / f64::from(POINTS)).fract();
            let d = (turn.rotate(a + (b - a) * at).extend(last) - o).normalize();
            self.trace(o, d, false).map(|(p, w, through)| (p, w, d.z, through))
        };
        let (missed, (p, w, cos, through)) = (0..POINTS).find_map(|i| Some((i, by(i)?)))?;
        // This point is taken wherever one of the missed before it comes first: it stands for all of them.
        let before = (missed..POINTS - 1).take_while(|i| by(POINTS + missed - 1 - i).is_none()).count();
        let chances = f64::from(missed + 1) + before as f64;
        let area = (b - a).x * (b - a).y;
        let weight = through * cos.powi(4) * area / (last * last * chances);
        let flip = |v: DVec3| DVec3::new(v.x, v.y, -v.z).as_vec3();
        Some(Passed { o: flip(p), d: flip(w), weight: weight as f32 })
    }

    /// Where and into which direction a ray from the film leaves the front, and how much of its light the stop lets through; `None` where it does
    /// not. `all`: of the stop counts the circle that holds all of its opening, so that what is found holds for the film all round.
    fn trace(&self, mut o: DVec3, mut d: DVec3, all: bool) -> Option<(DVec3, DVec3, f64)> {
        let mut through = 1.0;
        for s in &self.interfaces {
            let (t, n) = if s.radius == 0.0 {
                ((s.at - o.z) / d.z, DVec3::NEG_Z)
            } else {
                let center = DVec3::new(0.0, 0.0, s.at - s.radius);
                let to = o - center;
                let b = to.dot(d);
                let root = (b * b - (to.length_squared() - s.radius * s.radius)).sqrt();
                // The vertex is the sphere's end towards the scene where its center lies towards the film.
                let t = if s.radius > 0.0 { -b + root } else { -b - root };
                let n = (to + d * t) / s.radius;
                (t, if n.dot(d) > 0.0 { -n } else { n })
            };
            if !(t > 0.0) {
                return None;
            }
            o += d * t;
            if s.is_stop {
                let q = o.truncate() / s.opening.sqrt();
                if !all {
                    through *= self.stop.weight(q);
                }
                if !(through > 0.0 && (!all || q.length() <= self.stop.reach())) {
                    return None;
                }
            } else if !(o.x * o.x + o.y * o.y <= s.opening) {
                return None;
            }
            if s.eta != 1.0 {
                let cos = -d.dot(n);
                let square = 1.0 - s.eta * s.eta * (1.0 - cos * cos);
                if !(square > 0.0) {
                    return None;
                }
                d = (d * s.eta + n * (s.eta * cos - square.sqrt())).normalize();
            }
            if !(d.z > 0.0) {
                return None;
            }
        }
        Some((o, d, through))
    }

    /// The box of a ring.
    fn pupil(&self, ring: usize) -> Option<[DVec2; 2]> {
        let last = self.interfaces.first()?;
        let reach = if last.is_stop { self.stop.reach() } else { 1.0 };
        let all = DVec2::splat(REACH * reach * last.opening.sqrt());
        let coarse = self.passing(ring, [-all, all], GRID).or_else(|| self.passing(ring, [-all, all], FINE_GRID))?;
        Some(self.passing(ring, coarse, GRID).unwrap_or(coarse))
    }

    /// The part of a box where rays of a grid pass, with a cell around it.
    fn passing(&self, ring: usize, [a, b]: [DVec2; 2], grid: usize) -> Option<[DVec2; 2]> {
        let last = self.interfaces.first()?.at;
        let cell = (b - a) / grid as f64;
        let mut found: Option<[DVec2; 2]> = None;
        for i in 0..3 {
            let o = DVec3::new(self.film.length() * (ring as f64 + 0.5 * f64::from(i)) / RINGS as f64, 0.0, 0.0);
            for k in 0..grid * grid {
                let p = a + cell * (DVec2::new((k % grid) as f64, (k / grid) as f64) + 0.5);
                if self.trace(o, (p.extend(last) - o).normalize(), true).is_some() {
                    let [least, most] = found.unwrap_or([p, p]);
                    found = Some([least.min(p), most.max(p)]);
                }
            }
        }
        found.map(|[least, most]| [least - cell, most + cell])
    }
}

#[cfg(test)]
mod tests {
    use etendue_scene::desc::LensInterface;

    use super::*;

    fn surface(curvature_radius: f32, thickness: f32, ior: f32, aperture_radius: f32) -> LensInterface {
        LensInterface { curvature_radius, thickness, ior, aperture_radius }
    }

    /// A thin symmetric lens of 100 mm behind a stop.
    fn lens(stop: f32, focus_distance: f32) -> Objective {
        with_stop(StopShape::Circle, stop, focus_distance)
    }

    fn with_stop(shape: StopShape, stop: f32, focus_distance: f32) -> Objective {
        let interfaces = vec![surface(0.0, 0.0, 1.0, stop), surface(0.1, 0.001, 1.5, 0.03), surface(-0.1, 0.1, 1.0, 0.03)];
        let desc = ObjectiveDesc { interfaces, film_diagonal: 0.035, focus_distance, stop: shape };
        Objective::new(&desc, None, 1.5).unwrap()
    }

    const SHAPES: [StopShape; 5] = [StopShape::Circle, StopShape::Gaussian, StopShape::Square, StopShape::Pentagon, StopShape::Star];

    /// Rays of a point of the film meet in the plane in focus, upside down by the magnification of the lens equation.
    #[test]
    fn what_is_in_focus_is_sharp() {
        let o = lens(0.004, 2.0);
        let picture = Vec2::new(0.3, -0.5);
        let at = |u: Vec2| {
            let r = o.ray(picture, u).unwrap();
            r.o + r.d * ((-2.0 - r.o.z) / r.d.z)
        };
        let magnification = (2.0 - o.distance) / o.distance;
        for u in [Vec2::splat(0.5), Vec2::new(0.3, 0.5), Vec2::new(0.5, 0.75)] {
            let wanted = picture * o.film() * magnification;
            assert!((at(u).truncate() - wanted).length() < 5e-3 * wanted.length(), "{} instead of {wanted}", at(u));
        }
    }

    /// In the middle of the film the irradiance is π sin²θ of the radiance, θ being half of the angle of the pupil's cone.
    #[test]
    fn the_middle_has_the_irradiance_of_its_cone() {
        // Stops of other shapes let as much light through.
        for shape in SHAPES {
            let o = with_stop(shape, 0.01, 2.0);
            let n = 400;
            let sum: f64 = (0..n * n)
                .filter_map(|i| o.ray(Vec2::ZERO, Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32))
                .map(|r| f64::from(r.weight))
                .sum();
            // The stop lies in the lens: the cone is its radius over the distance of the film.
            let tan = 0.01 / f64::from(o.distance);
            let wanted = std::f64::consts::PI * tan * tan / (1.0 + tan * tan);
            let mean = sum / f64::from(n * n);
            assert!((mean / wanted - 1.0).abs() < 0.02, "{shape:?}: {mean} instead of {wanted}");
        }
    }

    /// Boxes hold all through which light comes: beyond them nothing passes.
    #[test]
    fn pupils_hold_all_light() {
        for o in SHAPES.map(|shape| with_stop(shape, 0.012, 1.0)) {
            let last = o.interfaces[0].at;
            for i in 0..20_000u32 {
                let u = |k: u32| f64::from(crate::math::hash::mix32(i * 7 + k)) / 4_294_967_296.0;
                let film = u(0) * o.film.length();
                let ring = (film / o.film.length() * RINGS as f64) as usize;
                let turn = DVec2::from_angle(7.0 * u(3));
                let film = (turn * film).extend(0.0);
                let p = DVec2::new(u(1) - 0.5, u(2) - 0.5) * 0.09;
                let passes = o.trace(film, (turn.rotate(p).extend(last) - film).normalize(), false).is_some();
                let inside = o.pupils[ring].is_some_and(|[a, b]| p.cmpge(a).all() && p.cmple(b).all());
                assert!(!passes || inside, "{:?}: {film} by {p}", o.stop);
            }
        }
    }
}
