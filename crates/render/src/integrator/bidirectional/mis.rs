//! Weights of the techniques that make the same path (Veach 1997, section 10.2, with the power heuristic; Georgiev, Křivánek,
//! Davidovič, Slusallek 2012, "Light Transport Simulation with Vertex Connection and Merging", doi:10.1145/2366145.2366211).
//!
//! A path is a row of joints from the light (number 0) to the camera (the last, n − 1). Connecting after `s` joints: the first `s` were
//! made from the light, the others from the camera. `s` = 0 meets the light by chance, `s` = 1 samples a light for a surface,
//! `s` = n − 1 meets the camera. Merging at joint k: 0 to k were made from the light and k to n − 1 from the camera, and
//! the two ends lie within the radius of merging.
//!
//! The weight of a technique depends on the path alone, not on how it was found, so that the weights of all techniques sum to one. For
//! that each joint knows its density under both walks. Densities are by area (for infinite lights joint 0's is per solid
//! angle); roulette and the straight crossing of surfaces that let light through are left out on both sides. Delta lobes have
//! the same factor on both sides.

/// A vertex of a path, for the weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// Density with which the walk from the light makes it.
    pub light: f32,
    /// Density with which the walk from the camera makes it.
    pub camera: f32,
    /// Whether other vertices can be connected to it: not where the path scatters by a delta lobe.
    pub connectible: bool,
    /// Whether a medium scatters there: walks are merged on surfaces alone.
    pub in_medium: bool,
}

/// What is special about joint 0, the light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Origin {
    /// Density of joint 0 when a light is sampled for joint 1.
    pub nee: f32,
    /// No path meets the light by chance.
    pub delta: bool,
}

/// Which techniques there are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Techniques {
    /// Paths from the camera meet lights, sample them and are connected to paths from the lights.
    pub from_camera: bool,
    /// Paths from the light are connected to the camera.
    pub to_camera: bool,
    /// Area of merging times the number of paths from the lights; 0 without merging.
    pub merging: f64,
}

/// A technique.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Technique {
    /// The first joints, so many, are the light's.
    Connect(usize),
    /// The light's and the camera's walk both end here.
    Merge(usize),
}

impl Techniques {
    /// Light tracing.
    pub const ONLY_TO_CAMERA: Self = Self { from_camera: false, to_camera: true, merging: 0.0 };
    /// Bidirectional path tracing.
    pub const CONNECTIONS: Self = Self { from_camera: true, to_camera: true, merging: 0.0 };

    /// Whether a path of these joints can be made by connecting after `s` of them.
    pub fn can_connect(&self, joints: &[Joint], origin: &Origin, s: usize) -> bool {
        let n = joints.len();
        match s {
            // The camera sees lights themselves by its own walk alone.
            _ if n < 3 || s >= n => s == 0 && !origin.delta,
            _ if s == n - 1 => self.to_camera && joints[n - 2].connectible,
            _ if !self.from_camera => false,
            0 => !origin.delta,
            _ => joints[s - 1].connectible && joints[s].connectible,
        }
    }

    /// Whether a path of these joints can be made by merging at joint `k`.
    pub fn can_merge(&self, joints: &[Joint], k: usize) -> bool {
        self.merging > 0.0 && k >= 1 && k + 1 < joints.len() && joints[k].connectible && !joints[k].in_medium
    }

    /// The weight of the technique `own`, by which the path was found: its density must not be zero.
    pub fn weight(&self, joints: &[Joint], origin: &Origin, own: Technique) -> f32 {
        let n = joints.len();
        let density = |v: f32| f64::from(v);
        // Densities relative to that of `own`. `rest` is that of all joints but 0 made by the camera; joint 0 may be made in three ways.
        let (anchor, mut from_light) = match own {
            Technique::Connect(s) => (s, 1.0),
            Technique::Merge(k) => (k, 1.0 / (self.merging * density(joints[k].light))),
        };
        let mut sum = 0.0;
        // Connection after s joints, and merging at joint s: the same joints from the camera, and s from the light as well.
        let mut add = |s: usize, p: f64| {
            if s >= 2 && self.can_connect(joints, origin, s) {
                sum += p * p;
            }
            if s >= 1 && self.can_merge(joints, s) {
                let p = p * self.merging * density(joints[s].light);
                sum += p * p;
            }
        };
        let mut p = from_light;
        let rest = match own {
            Technique::Connect(0) => 1.0 / density(joints[0].camera),
            Technique::Connect(1) => 1.0 / density(origin.nee),
            _ => {
                // Towards the light: joint by joint goes over to the camera.
                for s in (1..anchor).rev() {
                    p *= density(joints[s].camera) / density(joints[s].light);
                    add(s, p);
                }
                p / density(joints[0].light)
            }
        };
        if anchor < 2 && own != Technique::Merge(1) {
            from_light = rest * density(joints[0].light);
            add(1, from_light);
        } else {
            add(anchor, from_light);
        }
        // Towards the camera.
        let mut p = from_light;
        for (s, joint) in joints.iter().enumerate().take(n - 1).skip(anchor.max(1)) {
            p *= density(joint.light) / density(joint.camera);
            add(s + 1, p);
        }
        for (s, own_density) in [(0, joints[0].camera), (1, origin.nee)] {
            if self.can_connect(joints, origin, s) {
                let p = rest * density(own_density);
                sum += p * p;
            }
        }
        // Densities beyond the range of numbers: the technique that found the path is as good as any, and what is lost is nothing.
        let weight = 1.0 / sum;
        if weight.is_finite() { weight as f32 } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{hash_words, unit_float};

    /// Random paths of all lengths: the weights of all techniques that can make one sum to one.
    #[test]
    fn weights_sum_to_one() {
        let mut checked = 0;
        for case in 0..4000u64 {
            let rnd = |i: u64| unit_float(hash_words([case, i]) as u32);
            let n = 3 + (rnd(0) * 7.0) as usize;
            let density = |i: u64| crate::math::fns::pow(10.0, 6.0 * rnd(i) - 3.0);
            let mut joints: Vec<Joint> = (0..n as u64)
                .map(|i| Joint {
                    light: density(3 * i + 10),
                    camera: density(3 * i + 11),
                    connectible: rnd(3 * i + 12) < 0.7,
                    in_medium: rnd(3 * i + 100) < 0.3,
                })
                .collect();
            joints[n - 1].connectible = true;
            joints[0].connectible = true;
            let origin = Origin { nee: density(1), delta: rnd(2) < 0.3 };
            let merging = if rnd(3) < 0.5 { 0.0 } else { f64::from(density(4)) };
            let techniques = Techniques { from_camera: rnd(6) < 0.8, to_camera: rnd(5) < 0.7, merging };
            let connections = (0..n).filter(|&s| techniques.can_connect(&joints, &origin, s)).map(Technique::Connect);
            let merges = (0..n).filter(|&k| techniques.can_merge(&joints, k)).map(Technique::Merge);
            let all: Vec<Technique> = connections.chain(merges).collect();
            if all.is_empty() {
                continue;
            }
            checked += 1;
            let sum: f32 = all.iter().map(|&own| techniques.weight(&joints, &origin, own)).sum();
            assert!((sum - 1.0).abs() < 1e-4, "{sum} of {all:?} for {joints:?}");
            // By the definition: the product of the densities.
            let camera = |from: usize| joints[from..].iter().map(|j| f64::from(j.camera)).product::<f64>();
            let light = |to: usize| joints[..to].iter().map(|j| f64::from(j.light)).product::<f64>();
            let density = |t: &Technique| match *t {
                Technique::Connect(1) => f64::from(origin.nee) * camera(1),
                Technique::Connect(s) => light(s) * camera(s),
                Technique::Merge(k) => light(k + 1) * camera(k) * merging,
            };
            // Lights without chance of being met, or of emission, still have weights.
            let total: f64 = all.iter().map(|t| density(t) * density(t)).sum();
            for t in &all {
                let weight = f64::from(techniques.weight(&joints, &origin, *t));
                let known = density(t) * density(t) / total;
                assert!((weight - known).abs() < 1e-4 * (1.0 + known), "{t:?}: {weight} instead of {known}");
            }
        }
        assert!(checked > 3000);
    }

    #[test]
    fn zero_densities_make_no_numbers_that_are_none() {
        let joint = |light, camera| Joint { light, camera, connectible: true, in_medium: false };
        let joints = [joint(0.0, 0.0), joint(1.0, 2.0), joint(0.0, 1.0)];
        let origin = Origin { nee: 0.5, delta: true };
        let techniques = Techniques::CONNECTIONS;
        assert_eq!(techniques.weight(&joints, &origin, Technique::Connect(1)), 1.0);
        let huge = [joint(1e38, 1e-38), joint(1e38, 1e-38), joint(1e38, 1e-38), joint(0.0, 1.0)];
        assert!(techniques.weight(&huge, &origin, Technique::Connect(1)).is_finite());
    }
}
