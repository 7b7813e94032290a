//! Light sources: how much of their color a point gets, before shadows.

use etendue_procedural::fns;
use etendue_scene::desc::classic::{AreaLight, ClassicScene, Light, LightKind};
use glam::{DVec2, DVec3};

use std::f64::consts::{FRAC_PI_4, PI};
use std::sync::atomic::AtomicU32;

use crate::solid::{Line, Outlook, World};

/// A light source ready for use.
pub(super) struct Lamp {
    pub(super) light: Light,
    /// Along the axis of a spot, cylinder or parallel light, unit.
    axis: DVec3,
    cos_radius: f64,
    cos_falloff: f64,
    /// Neither direction nor distance change its color.
    is_even: bool,
    /// What its light has to pass.
    pub(super) gate: Option<World>,
    /// What is seen from its place, where light from all others comes differently or not at all.
    pub(super) outlook: Option<Outlook>,
    /// What blocked its light last, for [`World::shadow`].
    pub(super) last_blocker: AtomicU32,
}

impl Lamp {
    pub(super) fn new(light: &Light) -> Self {
        let axis = (light.point_at - light.location).normalize_or(DVec3::Z);
        let cos = |degrees: f64| fns::cos(degrees.clamp(-180.0, 180.0) * PI / 180.0);
        Self {
            axis,
            cos_radius: cos(light.radius),
            cos_falloff: cos(light.falloff),
            is_even: light.kind == LightKind::Point && !fades(light),
            outlook: None,
            gate: light.projected_through.as_ref().map(|o| World::new(std::slice::from_ref(o))),
            light: light.clone(),
            last_blocker: AtomicU32::new(u32::MAX),
        }
    }

    /// Finds out what is seen from its place, for shadows.
    pub(super) fn look_around(&mut self, world: &World) {
        let is_point = !self.light.parallel && self.light.area.is_none() && !self.light.shadowless;
        self.outlook = if is_point { world.outlook(self.light.location) } else { None };
    }

    /// Unit direction from a point to the light, and the distance that shadow rays go.
    pub(super) fn towards(&self, p: DVec3) -> (DVec3, f64) {
        self.towards_from(self.light.location, p)
    }

    /// The same for a point of an area light.
    pub(super) fn towards_from(&self, location: DVec3, p: DVec3) -> (DVec3, f64) {
        if self.light.parallel {
            // Rays leave the plane through the light that stands upright on the axis.
            let distance = (p - location).dot(self.axis);
            return if distance >= 0.0 { (-self.axis, distance) } else { (-self.axis, 0.0) };
        }
        let d = location - p;
        let distance = d.length();
        (d * distance.max(1e-300).recip(), distance)
    }

    /// The color at a point for light from a place of the lamp: fading with distance and falloff from the axis.
    pub(super) fn color(&self, location: DVec3, p: DVec3) -> DVec3 {
        let light = &self.light;
        if self.is_even {
            return light.color;
        }
        let away = p - location;
        let distance = away.length();
        let cone = match light.kind {
            LightKind::Point => 1.0,
            LightKind::Spot => self.spot(away.dot(self.axis) / distance.max(1e-300)),
            LightKind::Cylinder => self.cylinder(away),
        };
        if cone == 0.0 {
            return DVec3::ZERO;
        }
        light.color * (cone * self.fading(distance))
    }

    /// 2 / (1 + (d / fade_distance) ^ fade_power) (documentation, "Light Fading").
    pub(super) fn fading(&self, distance: f64) -> f64 {
        let light = &self.light;
        if !fades(light) {
            return 1.0;
        }
        2.0 / (1.0 + fns::pow(distance / light.fade_distance.abs(), light.fade_power))
    }

    /// Full within `radius`, then a smooth step of the cosine (3t² − 2t³) to `falloff`, times cos^tightness; measured to 1e−4.
    fn spot(&self, cos: f64) -> f64 {
        let step = if cos >= self.cos_radius {
            1.0
        } else if cos > self.cos_falloff {
            smooth_step((cos - self.cos_falloff) / (self.cos_radius - self.cos_falloff))
        } else {
            return 0.0;
        };
        step * tighten(cos, self.light.tightness)
    }

    /// The same over the distance from the axis, with (1 − distance / falloff) in place of the cosine; measured to 1e−4.
    fn cylinder(&self, away: DVec3) -> f64 {
        let along = away.dot(self.axis);
        if !(along > 0.0) {
            return 0.0;
        }
        let aside = (away - self.axis * along).length();
        let (radius, falloff) = (self.light.radius, self.light.falloff);
        let step = if aside <= radius {
            1.0
        } else if aside < falloff {
            smooth_step((falloff - aside) / (falloff - radius))
        } else {
            return 0.0;
        };
        step * tighten((1.0 - aside / falloff.max(radius)).max(0.0), self.light.tightness)
    }

    /// Where a line enters and leaves the cone or cylinder.
    pub(super) fn crossings(&self, line: &Line) -> arrayvec::ArrayVec<f64, 2> {
        let o = line.o - self.light.location;
        let (oa, da) = (o.dot(self.axis), line.d.dot(self.axis));
        // |q|² − (q·a)² (1 + tan²) = 0 on the cone, |q|² − (q·a)² − r² = 0 on the cylinder.
        let (k, r2) = match self.light.kind {
            LightKind::Cylinder => (1.0, self.light.falloff * self.light.falloff),
            _ => (1.0 / (self.cos_falloff * self.cos_falloff).max(1e-12), 0.0),
        };
        let a = 1.0 - k * da * da;
        let b = o.dot(line.d) - k * oa * da;
        let c = o.length_squared() - k * oa * oa - r2;
        let root = b * b - a * c;
        let mut out = arrayvec::ArrayVec::new();
        if root > 0.0 && a.abs() > 1e-12 {
            for t in [(-b - root.sqrt()) / a, (-b + root.sqrt()) / a] {
                // Of the cone's two halves only the one in front of the light counts.
                if oa + t * da > 0.0 && t.is_finite() {
                    out.push(t);
                }
            }
        }
        out
    }

    /// Where the point (i, j) of an area light's grid is, moved by `jitter` in cells, as seen from `p`.
    pub(super) fn place(&self, area: &AreaLight, i: f64, j: f64, jitter: DVec2, p: DVec3) -> DVec3 {
        let [m, n] = area.size.map(f64::from);
        let share = |k: f64, n: f64, shift: f64| if n > 1.0 { (k + shift) / (n - 1.0) - 0.5 } else { shift };
        let mut q = DVec2::new(share(i, m, jitter.x), share(j, n, jitter.y));
        if area.circular {
            q = round(q * 2.0) * 0.5;
        }
        let (axis1, axis2) = if area.orient { self.facing(area, p) } else { (area.axis1, area.axis2) };
        self.light.location + axis1 * q.x + axis2 * q.y
    }

    /// The axes turned so that the light faces a point.
    fn facing(&self, area: &AreaLight, p: DVec3) -> (DVec3, DVec3) {
        let Some(n) = (p - self.light.location).try_normalize() else { return (area.axis1, area.axis2) };
        let length = area.axis1.length();
        let helper = if n.y.abs() < 0.9 { DVec3::Y } else { DVec3::X };
        let a = n.cross(helper).normalize_or(DVec3::X);
        (a * length, n.cross(a) * length)
    }
}

/// Whether its light gets weaker with the distance.
fn fades(light: &Light) -> bool {
    !(light.fade_power <= 0.0 || light.fade_distance == 0.0)
}

fn tighten(v: f64, tightness: f64) -> f64 {
    if tightness == 0.0 { 1.0 } else { fns::pow(v.max(0.0), tightness) }
}

fn smooth_step(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The square [−1, 1]² on the disc: points keep their direction's octant and their distance by the larger coordinate.
fn round(q: DVec2) -> DVec2 {
    let r = q.x.abs().max(q.y.abs());
    if r == 0.0 {
        return q;
    }
    let (a, b) = (q.x / r, q.y / r);
    let phi = if a.abs() >= b.abs() { FRAC_PI_4 * b / a } else { FRAC_PI_4 * a / b };
    let (sin, cos) = fns::sin_cos(phi);
    if a.abs() >= b.abs() { DVec2::new(cos, sin) * (r * a) } else { DVec2::new(sin, cos) * (r * b) }
}

/// Which lamps light objects of each light group: its own, those of the groups around it, and the world's if it wants them.
pub(super) fn sets(scene: &ClassicScene) -> Vec<Vec<u32>> {
    let of = |group: u32| (0u32..).zip(&scene.lights).filter(move |(_, l)| l.group == group).map(|(i, _)| i);
    let mut sets = vec![of(0).collect::<Vec<_>>()];
    for (i, group) in scene.light_groups.iter().enumerate() {
        let mut set: Vec<u32> = of(i as u32 + 1).collect();
        let mut around = group.parent;
        // As many steps as there are groups: a cycle ends as well.
        for _ in 0..scene.light_groups.len() {
            let Some(outer) = (around as usize).checked_sub(1).and_then(|k| scene.light_groups.get(k)) else { break };
            set.extend(of(around));
            around = outer.parent;
        }
        if group.global_lights {
            set.extend(of(0));
        }
        set.sort_unstable();
        set.dedup();
        sets.push(set);
    }
    sets
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light on the plane z = 0 from `z` = −10 over the origin, at a distance from it.
    fn at(light: &Light, x: f64) -> f64 {
        Lamp::new(light).color(light.location, DVec3::new(x, 0.0, 0.0)).x
    }

    #[test]
    fn cones_and_cylinders_fall_off_as_measured() {
        let mut light = Light::new(DVec3::new(0.0, 0.0, -10.0), DVec3::ONE);
        light.kind = LightKind::Spot;
        [light.radius, light.falloff] = [10.0, 30.0];
        // POV-Ray 3.7.0.10, an orthographic view of a plane with brilliance 0, 16 bits.
        let tangent = |degrees: f64| 10.0 * fns::tan(degrees * PI / 180.0);
        for (degrees, value) in [(9.9, 1.0), (15.0, 0.93222), (20.0, 0.67681), (25.0, 0.26702), (30.1, 0.0)] {
            assert!((at(&light, tangent(degrees)) - value).abs() < 3e-4, "{degrees}");
        }
        light.tightness = 10.0;
        for (degrees, value) in [(5.0, 0.96258), (15.0, 0.65911), (25.0, 0.09984)] {
            assert!((at(&light, tangent(degrees)) - value).abs() < 3e-4, "{degrees}");
        }
        light.kind = LightKind::Cylinder;
        [light.radius, light.falloff] = [1.0, 3.0];
        for (x, value) in [(0.5, 0.1615), (0.9, 0.02824), (1.5, 0.00082), (3.01, 0.0)] {
            assert!((at(&light, x) - value).abs() < 3e-5, "{x}");
        }
        light.tightness = 0.0;
        for (x, value) in [(0.99, 1.0), (1.5, 0.84375), (2.0, 0.5), (2.5, 0.15625)] {
            assert!((at(&light, x) - value).abs() < 3e-5, "{x}");
        }
    }

    #[test]
    fn light_fades_as_measured() {
        let mut light = Light::new(DVec3::new(0.0, 0.0, -1.0), DVec3::ONE);
        for (distance, power, value) in [(2.0, 2.0, 1.6), (2.0, 1.0, 4.0 / 3.0), (5.0, 3.0, 1.98413), (0.0, 2.0, 1.0), (3.0, 0.0, 1.0)] {
            [light.fade_distance, light.fade_power] = [distance, power];
            assert!((at(&light, 0.0) - value).abs() < 1e-4);
        }
    }

    #[test]
    fn groups_inherit_and_cycles_end() {
        use etendue_scene::desc::classic::LightGroup;
        let light = |group| Light { group, ..Light::default() };
        let mut scene = ClassicScene { lights: vec![light(0), light(1), light(2)], ..ClassicScene::default() };
        scene.light_groups = vec![LightGroup { parent: 0, global_lights: false }, LightGroup { parent: 1, global_lights: true }];
        assert_eq!(sets(&scene), [vec![0], vec![1], vec![0, 1, 2]]);
        scene.light_groups[0].parent = 2;
        assert_eq!(sets(&scene)[1], [1, 2]);
    }
}
