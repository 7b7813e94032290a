//! What reaches a point from a light: the surfaces and interiors on the way.

use std::sync::Arc;

use etendue_procedural::{Context, Texture, fns};
use etendue_scene::desc::classic::{Interior, Media};
use glam::{DVec2, DVec3};

use super::light::Lamp;
use super::photons::takes_shadow;
use super::refract::{Identity, Stack, attenuation, identity};
use super::trace::Tracer;
use super::{ClassicWorld, peak};
use crate::solid::{Line, Outlook, RayKind, SolidHit};

/// Things nearer to the lit point than this cast no shadow on it: measured, 7e−4 does not and 1.3e−3 does.
const NEAR: f64 = 1e-3;

/// A surface that a shadow ray passes.
struct Pass {
    t: f64,
    identity: Identity,
    color: DVec3,
    interior: Option<Arc<Interior>>,
    /// Cosine between the ray and the outward normal: negative where the ray enters.
    cos: f64,
    hollow: bool,
}

/// A point that light is to reach.
#[derive(Clone, Copy)]
pub(super) struct Receiver<'i> {
    pub(super) p: DVec3,
    /// What the ray that found it was inside of.
    pub(super) inside: &'i Stack,
    /// Shadows of photons' targets are left to the photons.
    pub(super) by_photons: bool,
}

impl<'a> Tracer<'a, '_> {
    /// The color of a lamp at a point, after shadows: from its whole area, averaged. `towards` is [`Lamp::towards`] of the point.
    pub(super) fn lamp_color(&mut self, lamp: &Lamp, lit: Receiver<'_>, towards: (DVec3, f64)) -> DVec3 {
        let color = lamp.color(lamp.light.location, lit.p);
        if peak(color.abs()) == 0.0 {
            return DVec3::ZERO;
        }
        let passing = match &lamp.light.area {
            Some(_) if !lamp.light.shadowless => self.area_passing(lamp, lit),
            _ => self.passing(lamp, lamp.outlook.as_ref(), lit, towards),
        };
        color * passing
    }

    /// The share of a lamp's light, color by color, that arrives at a point from one of the lamp's places, in a direction and from a
    /// distance; `outlook` is that of the place, where there is one.
    pub(super) fn passing(&mut self, lamp: &Lamp, outlook: Option<&Outlook>, lit: Receiver<'_>, (d, mut distance): (DVec3, f64)) -> DVec3 {
        let world: &'a ClassicWorld = self.world;
        let line = Line { o: lit.p, d };
        if let Some(gate) = &lamp.gate {
            // What is beyond the gate, seen from the lit point, does not matter.
            match gate.nearest(&line, NEAR, distance, RayKind::Photon) {
                Some(hit) => distance = hit.t,
                None => return DVec3::ZERO,
            }
        }
        let mut passing = DVec3::ONE;
        if lamp.light.media_attenuation {
            passing *= world.fog_passing(&line, distance);
        }
        if lamp.light.shadowless || !(distance > NEAR) {
            return passing * self.air_passing(lamp, &line, [0.0, distance]);
        }
        let mut passes: Vec<Pass> = Vec::new();
        let mut dark = false;
        let outlook = outlook.filter(|_| lamp.gate.is_none());
        let blocked = world.world.shadow(outlook, &line, NEAR, distance - NEAR, &lamp.last_blocker, &mut |hit| {
            if lit.by_photons && takes_shadow(&hit.object.photons, lamp) {
                dark = true;
                return false;
            }
            let color = world.surface_passing(&hit, &line);
            if !(peak(color.abs()) > 0.0) {
                dark = true;
                return false;
            }
            let interior = hit.object.interior.clone();
            passes.push(Pass {
                t: hit.t,
                identity: identity(hit.object, hit.whole),
                color,
                interior,
                cos: hit.n.dot(line.d),
                hollow: hit.object.hollow,
            });
            true
        });
        if blocked || dark {
            return DVec3::ZERO;
        }
        if passes.is_empty() {
            return passing * self.air_passing(lamp, &line, [0.0, distance]);
        }
        passes.sort_by(|a, b| a.t.total_cmp(&b.t));
        let mut within: Vec<_> = lit.inside.iter().map(|w| (w.identity, w.interior.as_deref(), w.hollow)).collect();
        let mut last = 0.0;
        for pass in &passes {
            passing *= pass.color;
            let from = std::mem::replace(&mut last, pass.t);
            if within.iter().all(|(.., hollow)| *hollow) {
                let mut media: Vec<&Media> = within.iter().filter_map(|(_, interior, _)| *interior).flat_map(|i| &i.media).collect();
                if lamp.light.media_attenuation {
                    media.extend(&world.scene.atmosphere);
                }
                if !media.is_empty() {
                    passing *= world.media_passing(&media, &line, [from, pass.t], &mut || f64::from(self.stream.next_1d()));
                }
            }
            let left = within.iter().position(|(identity, ..)| *identity == pass.identity).map(|at| within.swap_remove(at));
            if left.is_none() {
                within.push((pass.identity, pass.interior.as_deref(), pass.hollow));
            }
            let Some(interior) = &pass.interior else { continue };
            if interior.caustics != 0.0 {
                passing *= focus(interior.caustics, pass.cos);
            }
            // Only ways that end where the light leaves, from the last surface on, and only with a power (all measured).
            if left.is_some() && interior.fade_power > 0.0 {
                passing *= attenuation(interior, pass.t - from);
            }
        }
        // Interiors in which the light itself is do not weaken it (measured).
        passing * self.air_passing(lamp, &line, [last, distance])
    }

    /// What atmospheric media let through of a lamp that they weaken.
    fn air_passing(&mut self, lamp: &Lamp, line: &Line, t: [f64; 2]) -> DVec3 {
        let air = &self.world.scene.atmosphere;
        if air.is_empty() || !lamp.light.media_attenuation {
            return DVec3::ONE;
        }
        let media: Vec<&Media> = air.iter().collect();
        self.world.media_passing(&media, line, t, &mut || f64::from(self.stream.next_1d()))
    }

    /// The mean of [`Tracer::passing`] over an area light: its whole grid, or with `adaptive` as much of it as differs.
    fn area_passing(&mut self, lamp: &Lamp, lit: Receiver<'_>) -> DVec3 {
        let Some(area) = lamp.light.area else { return DVec3::ONE };
        let [m, n] = area.size.map(|s| s as usize);
        let mut grid = Grid { lamp, lit, size: [m, n], seen: vec![None; m * n], area };
        match area.adaptive {
            Some(level) if m > 1 && n > 1 && level < 16 => self.quarter(&mut grid, [0.0, 0.0], [m as f64 - 1.0, n as f64 - 1.0], level),
            _ => {
                let mut sum = DVec3::ZERO;
                for i in 0..m {
                    for j in 0..n {
                        sum += self.grid_point(&mut grid, i, j);
                    }
                }
                sum / (m * n) as f64
            }
        }
    }

    /// A rectangle of the grid from its four corners, split where they differ or while `level` asks for it.
    fn quarter(&mut self, grid: &mut Grid, from: [f64; 2], to: [f64; 2], level: u32) -> DVec3 {
        let index = |v: f64| (v + 0.5).floor().max(0.0) as usize;
        let (i0, i1, j0, j1) = (index(from[0]), index(to[0]), index(from[1]), index(to[1]));
        let corners = [(i0, j0), (i1, j0), (i0, j1), (i1, j1)].map(|(i, j)| self.grid_point(grid, i, j));
        let mean = (corners[0] + corners[1] + corners[2] + corners[3]) * 0.25;
        let differ = corners.iter().any(|c| peak((*c - mean).abs()) > 0.05);
        if (i1 - i0 <= 1 && j1 - j0 <= 1) || !(differ || level > 0) {
            return mean;
        }
        let middle = [0.5 * (from[0] + to[0]), 0.5 * (from[1] + to[1])];
        let below = level.saturating_sub(1);
        let mut sum = DVec3::ZERO;
        for (a, b) in [(from, middle), ([middle[0], from[1]], [to[0], middle[1]]), ([from[0], middle[1]], [middle[0], to[1]]), (middle, to)]
        {
            sum += self.quarter(grid, a, b, below);
        }
        sum * 0.25
    }

    fn grid_point(&mut self, grid: &mut Grid, i: usize, j: usize) -> DVec3 {
        let slot = i.min(grid.size[0] - 1) * grid.size[1] + j.min(grid.size[1] - 1);
        if let Some(seen) = grid.seen[slot] {
            return seen;
        }
        let jitter = if grid.area.jitter { self.jitter() } else { DVec2::ZERO };
        let location = grid.lamp.place(&grid.area, i as f64, j as f64, jitter, grid.lit.p);
        let passing = self.passing(grid.lamp, None, grid.lit, grid.lamp.towards_from(location, grid.lit.p));
        grid.seen[slot] = Some(passing);
        passing
    }
}

/// The points of an area light that have been tested from one point.
struct Grid<'l> {
    lamp: &'l Lamp,
    area: etendue_scene::desc::classic::AreaLight,
    lit: Receiver<'l>,
    size: [usize; 2],
    seen: Vec<Option<DVec3>>,
}

impl ClassicWorld {
    /// What a surface lets through of light straight on: the product over its layers of color · filter + transmit.
    fn surface_passing(&self, hit: &SolidHit<'_>, line: &Line) -> DVec3 {
        let back = hit.n.dot(line.d) > 0.0;
        let context = Context { normal: hit.n, ray: line.d, uv: hit.uv, ..self.context(hit.p) };
        let mut sum = DVec3::ZERO;
        self.world.textures(hit, back, &mut |weight, texture: Option<&Texture>| {
            let Some(texture) = texture else { return };
            texture.resolve(&context, &mut |share, layers, context| {
                let mut passing = DVec3::ONE;
                for layer in layers.iter().rev() {
                    passing *= layer.pigment.color(context).passing();
                    if passing == DVec3::ZERO {
                        break;
                    }
                }
                sum += passing * (weight * share);
            });
        });
        sum
    }
}

/// Brightening of shadows by simulated caustics: 1 + cos^(45 · power), measured to four digits.
fn focus(power: f64, cos: f64) -> f64 {
    1.0 + fns::pow(cos.abs(), 45.0 * power.abs())
}
