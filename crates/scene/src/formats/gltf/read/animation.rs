//! Animations: where nodes are at a moment, and the weights of their morph targets (glTF 2.0, 3.11 and appendix C).

use std::collections::HashMap;

use glam::{DQuat, DVec3};

use super::Reader;
use super::accessor::Component::{F32, I8, I16, U8, U16};
use crate::desc::AnimationDesc;
use crate::formats::gltf::json::Value;

/// What an animation says of a node at a moment; the rest is as the node itself says.
#[derive(Clone, Debug, Default)]
pub(super) struct Pose {
    pub translation: Option<DVec3>,
    pub rotation: Option<DQuat>,
    pub scale: Option<DVec3>,
    pub weights: Option<Vec<f32>>,
}

/// How values go from one key to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Interpolation {
    Step,
    Linear,
    /// Each key has an in-tangent, a value and an out-tangent.
    CubicSpline,
}

impl<'a> Reader<'a> {
    /// Notes the file's animations, and returns the poses that the chosen one gives nodes at the time of the options; none without a time.
    pub(super) fn poses(&mut self) -> HashMap<usize, Pose> {
        let animations = self.list("animations");
        for animation in animations {
            let (name, secs) = (self.name(animation), self.animation_secs(animation));
            self.desc.animations.push(AnimationDesc { name, secs });
        }
        let mut poses = HashMap::new();
        let Some(first) = animations.first() else { return poses };
        let Some(time) = self.options.time else {
            self.loss(first, "animations", "still: the pose that nodes have without animation; a clock gives the pose at that second");
            return poses;
        };
        let chosen = match self.options.animation.as_deref() {
            None => 0,
            Some(wanted) => {
                let by_number = wanted.parse().ok().filter(|&i: &usize| i < animations.len());
                let Some(i) = self.desc.animations.iter().position(|a| a.name == wanted).or(by_number) else {
                    let known: Vec<String> = self.desc.animations.iter().enumerate().map(|(i, a)| format!("{i} `{}`", a.name)).collect();
                    self.error(self.root, format!("no animation `{wanted}`; there are: {}", known.join(", ")));
                    return poses;
                };
                i
            }
        };
        if animations.len() > 1 && self.options.animation.is_none() {
            self.warning(first, format!("the first of {} animations is shown; others by name or number", animations.len()));
        }
        for channel in self.array(&animations[chosen], "channels") {
            self.channel(&animations[chosen], channel, time, &mut poses);
        }
        poses
    }

    /// The time of an animation's last key.
    fn animation_secs(&mut self, animation: &'a Value<'a>) -> f64 {
        let mut last = 0.0f64;
        for sampler in self.array(animation, "samplers") {
            // Keys must have their bounds in the file, so that nothing is decoded for this.
            let Some((_, accessor)) = self.reference(sampler, "input", "accessors") else { continue };
            if let Some(max) = self.array(accessor, "max").first().and_then(Value::as_f64) {
                last = last.max(max);
            }
        }
        last
    }

    fn channel(&mut self, animation: &'a Value<'a>, channel: &'a Value<'a>, time: f64, poses: &mut HashMap<usize, Pose>) {
        let Some(target) = self.required(channel, "target") else { return };
        let path = self.string(target, "path");
        if let Some(pointer) = self.extension(target, "KHR_animation_pointer") {
            self.loss(pointer, "KHR_animation_pointer", "what it points to stays as it is");
            return;
        }
        if target.get("node").is_none() {
            // For an extension; as the specification says, it is left out.
            return;
        }
        let Some((i, node)) = self.reference(target, "node", "nodes") else { return };
        let samplers = self.array(animation, "samplers");
        let Some(n) = self.required(channel, "sampler").and_then(|v| self.integer_of(v)) else { return };
        let Some(sampler) = samplers.get(n as usize) else {
            self.error(channel, format!("there is no sampler {n}: the animation has {}", samplers.len()));
            return;
        };
        let width = match path {
            Some("translation" | "scale") => 3,
            Some("rotation") => 4,
            Some("weights") => 1,
            _ => {
                self.error(target, "unknown or missing `path`");
                return;
            }
        };
        if width > 1 && node.get("matrix").is_some() {
            self.error(channel, "the node has a matrix, and cannot be moved by an animation");
            return;
        }
        let Some(value) = self.sample(sampler, width, path == Some("rotation"), time) else { return };
        let pose = poses.entry(i).or_default();
        let vector = |v: &[f64]| DVec3::new(v[0], v[1], v[2]);
        match path {
            Some("translation") => pose.translation = Some(vector(&value)),
            Some("scale") => pose.scale = Some(vector(&value)),
            Some("rotation") => pose.rotation = Some(DQuat::from_xyzw(value[0], value[1], value[2], value[3])),
            _ => pose.weights = Some(value.iter().map(|w| *w as f32).collect()),
        }
    }

    /// A sampler's value. `width` is that of an element; weights have as many elements for each key as there are targets.
    fn sample(&mut self, sampler: &'a Value<'a>, width: usize, is_rotation: bool, time: f64) -> Option<Vec<f64>> {
        let interpolation = match self.string(sampler, "interpolation") {
            None | Some("LINEAR") => Interpolation::Linear,
            Some("STEP") => Interpolation::Step,
            Some("CUBICSPLINE") => Interpolation::CubicSpline,
            Some(other) => {
                self.error(sampler, format!("unknown interpolation `{other}`"));
                return None;
            }
        };
        let input = self.required(sampler, "input")?;
        let output = self.required(sampler, "output")?;
        let times = self.elements::<f32>(input, &[1], &[F32])?.data;
        let components: &[_] = if width == 3 { &[F32] } else { &[F32, I8, U8, I16, U16] };
        let values = self.elements::<f32>(output, &[width], components)?.data;
        if times.is_empty() || !times.windows(2).all(|w| w[0] < w[1]) || !times.iter().chain(&values).all(|v| v.is_finite()) {
            self.error(sampler, "keys must have finite values and times, each later than the one before");
            return None;
        }
        let per_key = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
        let keys = times.len() * per_key;
        if values.is_empty() || values.len() % keys != 0 || (width > 1 && values.len() != keys * width) {
            self.error(sampler, format!("{} keys do not go with {} values", times.len(), values.len() / width));
            return None;
        }
        Some(interpolate(&times, &values, interpolation, is_rotation, time))
    }
}

/// The value at a time; before the first and after the last key theirs.
fn interpolate(times: &[f32], values: &[f32], interpolation: Interpolation, is_rotation: bool, time: f64) -> Vec<f64> {
    let per_key = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
    let width = values.len() / (times.len() * per_key);
    // Part 0 of a spline's key is its in-tangent, 1 its value, 2 its out-tangent.
    let part = |key: usize, part: usize| {
        let at = (key * per_key + part) * width;
        values[at..at + width].iter().map(|v| f64::from(*v))
    };
    let value = |key: usize| part(key, per_key / 2);
    let after = times.partition_point(|t| f64::from(*t) <= time);
    if after == 0 || after == times.len() || interpolation == Interpolation::Step {
        return value(after.saturating_sub(1)).collect();
    }
    let key = after - 1;
    let length = f64::from(times[after]) - f64::from(times[key]);
    let t = (time - f64::from(times[key])) / length;
    if interpolation == Interpolation::CubicSpline {
        let (t2, t3) = (t * t, t * t * t);
        let [a, b, c, d] = [2.0 * t3 - 3.0 * t2 + 1.0, length * (t3 - 2.0 * t2 + t), 3.0 * t2 - 2.0 * t3, length * (t3 - t2)];
        let from = value(key).zip(part(key, 2));
        let to = value(after).zip(part(after, 0));
        return from.zip(to).map(|((v, out), (w, into))| a * v + b * out + c * w + d * into).collect();
    }
    if is_rotation {
        let quaternion = |key: usize| {
            let q: Vec<f64> = value(key).collect();
            DQuat::from_xyzw(q[0], q[1], q[2], q[3])
        };
        let (a, b) = (quaternion(key), quaternion(after));
        if a.length() > 1e-6 && b.length() > 1e-6 {
            return a.normalize().slerp(b.normalize(), t).to_array().to_vec();
        }
    }
    value(key).zip(value(after)).map(|(a, b)| a + t * (b - a)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_and_what_lies_between() {
        let times = [1.0, 2.0, 4.0];
        let values = [0.0, 10.0, 2.0, 20.0, 6.0, 0.0];
        let at = |mode, t| interpolate(&times, &values, mode, false, t);
        for mode in [Interpolation::Linear, Interpolation::Step] {
            assert_eq!(at(mode, 0.0), [0.0, 10.0]);
            assert_eq!(at(mode, 1.0), [0.0, 10.0]);
            assert_eq!(at(mode, 2.0), [2.0, 20.0]);
            assert_eq!(at(mode, 9.0), [6.0, 0.0]);
        }
        assert_eq!(at(Interpolation::Linear, 3.5), [5.0, 5.0]);
        assert_eq!(at(Interpolation::Step, 3.5), [2.0, 20.0]);
        assert_eq!(at(Interpolation::Linear, f64::NAN), [0.0, 10.0]);
    }

    /// A cubic polynomial with its derivatives as tangents comes out exactly.
    #[test]
    fn splines_are_cubic() {
        let f = |t: f64| t * t * t - 2.0 * t + 1.0;
        let slope = |t: f64| 3.0 * t * t - 2.0;
        let times = [0.0f32, 0.5, 2.0];
        let values: Vec<f32> = times.iter().map(|t| f64::from(*t)).flat_map(|t| [slope(t), f(t), slope(t)]).map(|v| v as f32).collect();
        for t in [0.0, 0.2, 0.5, 0.9, 1.7, 2.0] {
            let got = interpolate(&times, &values, Interpolation::CubicSpline, false, t);
            assert!((got[0] - f(t)).abs() < 1e-6, "{t}: {got:?} instead of {}", f(t));
        }
    }

    #[test]
    fn rotations_take_the_short_way_at_even_speed() {
        let half = (0.5f64).sqrt() as f32;
        // A quarter turn about z, given by the quaternion of the other sign.
        let values = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -half, -half];
        let q = interpolate(&[0.0, 1.0], &values, Interpolation::Linear, true, 1.0 / 3.0);
        let turned = DQuat::from_xyzw(q[0], q[1], q[2], q[3]) * DVec3::X;
        let angle = std::f64::consts::FRAC_PI_6;
        assert!((turned - DVec3::new(angle.cos(), angle.sin(), 0.0)).length() < 1e-6, "{turned}");
    }
}
