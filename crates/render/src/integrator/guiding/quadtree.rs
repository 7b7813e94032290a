//! Distributions of directions: quadtrees over the octahedral square (Cigolle et al. 2014, "A Survey of Efficient Representations for
//! Independent Unit Vectors", JCGT 3(2)), as in Müller et al. 2017 (doi:10.1111/cgf.13227) over another square.

use crate::math::{ONE_MINUS_EPSILON, Vec2, Vec3};

/// Deepest level: cells of the square's side over 2¹⁰.
const MOST_LEVELS: u32 = 10;
/// Cells with more than this share of all light are divided,
const LEAST_SHARE: f32 = 0.01;
/// if so many samples show what is in them.
const LEAST_SAMPLES: usize = 12;
/// One sample counts at most for this share of what all show: those that were found by luck would hide the others.
const MOST_OF_ONE: f64 = 0.05;
/// Rounds in which that is found; a value is at most 20 times smaller after each.
const ROUNDS: u32 = 40;

/// The point of the unit square for a unit direction.
#[inline]
pub(super) fn square_from_direction(d: Vec3) -> Vec2 {
    let v = d / (d.x.abs() + d.y.abs() + d.z.abs());
    let p = if v.z >= 0.0 { Vec2::new(v.x, v.y) } else { Vec2::new((1.0 - v.y.abs()).copysign(v.x), (1.0 - v.x.abs()).copysign(v.y)) };
    p * 0.5 + 0.5
}

/// The unit direction for a point of the unit square.
#[inline]
fn direction_from_square(p: Vec2) -> Vec3 {
    let q = p * 2.0 - 1.0;
    let z = 1.0 - q.x.abs() - q.y.abs();
    let d = if z >= 0.0 { Vec3::new(q.x, q.y, z) } else { Vec3::new((1.0 - q.y.abs()).copysign(q.x), (1.0 - q.x.abs()).copysign(q.y), z) };
    d.normalize()
}

/// Density per solid angle over that per area of the square: the face's plane is 1/√3 away, and its area √3 times what it covers.
#[inline]
fn density_on_sphere(d: Vec3) -> f32 {
    let length = 1.0 / (d.x.abs() + d.y.abs() + d.z.abs());
    0.25 * length * length * length
}

/// A sample to learn from: a point of the square and the light there over the density with which the point was sampled.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weighted {
    pub at: Vec2,
    pub weight: f32,
}

/// A cell divided in four: (0, 0), (1, 0), (0, 1), (1, 1).
#[derive(Clone, Copy, Debug, Default)]
struct Node {
    /// Shares of the cell's light.
    shares: [f32; 4],
    /// Where the quarters are divided; 0 where they are not.
    children: [u32; 4],
}

/// Many trees, each known by its root.
#[derive(Clone, Debug, Default)]
pub(super) struct Quadtrees {
    nodes: Vec<Node>,
}

impl Quadtrees {
    /// Adds the tree of some samples, which are reordered, and returns its root; none where they show no light.
    pub fn add(&mut self, samples: &mut [Weighted]) -> Option<u32> {
        let most = most_of_one(samples.iter().map(|s| s.weight));
        for s in samples.iter_mut() {
            // Relative to the most, as sums of what single precision holds need not be such numbers.
            s.weight = (f64::from(s.weight) / most).min(1.0) as f32;
        }
        let total: f32 = samples.iter().map(|s| s.weight).sum();
        if !(most > 0.0 && total > 0.0) {
            return None;
        }
        Some(self.divide(samples, Vec2::ZERO, 1.0, total * LEAST_SHARE))
    }

    /// Appends all trees of another; returns what its roots are to be raised by.
    pub fn append(&mut self, other: &Self) -> u32 {
        let offset = self.nodes.len() as u32;
        let raised = |child: u32| if child == 0 { 0 } else { child + offset };
        self.nodes.extend(other.nodes.iter().map(|n| Node { children: n.children.map(raised), ..*n }));
        offset
    }

    fn divide(&mut self, samples: &mut [Weighted], corner: Vec2, size: f32, least: f32) -> u32 {
        let half = 0.5 * size;
        let middle = corner + half;
        let by_y = partition(samples, |s| s.at.y < middle.y);
        let (low, high) = samples.split_at_mut(by_y);
        let (a, b) = (partition(low, |s| s.at.x < middle.x), partition(high, |s| s.at.x < middle.x));
        let ((q0, q1), (q2, q3)) = (low.split_at_mut(a), high.split_at_mut(b));
        let quarters = [q0, q1, q2, q3];
        let light: [f32; 4] = std::array::from_fn(|i| quarters[i].iter().map(|s| s.weight).sum());
        let total: f32 = light.iter().sum();
        // Quarters in which nothing was seen yet may have some.
        let shares = if total > 0.0 { light.map(|l| 0.97 * l / total + 0.0075) } else { [0.25; 4] };
        let index = self.nodes.len() as u32;
        self.nodes.push(Node { shares, children: [0; 4] });
        for (i, quarter) in quarters.into_iter().enumerate() {
            if light[i] > least && quarter.len() >= LEAST_SAMPLES && half * (1u32 << MOST_LEVELS) as f32 > 1.0 {
                let corner = corner + Vec2::new((i & 1) as f32, (i >> 1) as f32) * half;
                self.nodes[index as usize].children[i] = self.divide(quarter, corner, half, least);
            }
        }
        index
    }

    /// Samples a direction by two numbers; returns its density per solid angle as well.
    #[inline]
    pub fn sample(&self, root: u32, mut u: Vec2) -> (Vec3, f32) {
        let (mut corner, mut size, mut pdf, mut node) = (Vec2::ZERO, 1.0f32, 1.0f32, root);
        loop {
            let Node { shares, children } = &self.nodes[node as usize];
            let upper = u32::from(choose(&mut u.y, shares[0] + shares[1]));
            let row = (2 * upper) as usize;
            let right = u32::from(choose(&mut u.x, shares[row] / (shares[row] + shares[row + 1])));
            let i = row + right as usize;
            size *= 0.5;
            corner += Vec2::new(right as f32, upper as f32) * size;
            pdf *= 4.0 * shares[i];
            node = children[i];
            if node == 0 {
                let d = direction_from_square(corner + u * size);
                return (d, pdf * density_on_sphere(d));
            }
        }
    }

    /// The density per solid angle of a direction.
    #[inline]
    pub fn pdf(&self, root: u32, d: Vec3) -> f32 {
        let mut p = square_from_direction(d).clamp(Vec2::ZERO, Vec2::splat(ONE_MINUS_EPSILON));
        let (mut pdf, mut node) = (1.0f32, root);
        loop {
            let Node { shares, children } = &self.nodes[node as usize];
            p *= 2.0;
            let (right, upper) = (p.x >= 1.0, p.y >= 1.0);
            p -= Vec2::new(f32::from(u8::from(right)), f32::from(u8::from(upper)));
            let i = usize::from(right) + 2 * usize::from(upper);
            pdf *= 4.0 * shares[i];
            node = children[i];
            if node == 0 {
                return pdf * density_on_sphere(d);
            }
        }
    }
}

/// How much one of some values (not negative) may count, so that none is more than its share of all; 0 where all are.
fn most_of_one(values: impl Iterator<Item = f32> + Clone) -> f64 {
    let mut most = f64::INFINITY;
    for _ in 0..ROUNDS {
        let next = MOST_OF_ONE * values.clone().map(|v| f64::from(v).min(most)).sum::<f64>();
        if next >= 0.99 * most {
            break;
        }
        most = next;
    }
    most
}

/// Whether a number is in the part above the share `low`; the number becomes one of that part.
#[inline]
fn choose(u: &mut f32, low: f32) -> bool {
    let above = *u >= low;
    *u = if above { (*u - low) / (1.0 - low) } else { *u / low }.min(ONE_MINUS_EPSILON);
    above
}

/// Puts those for which something holds before the others, in an order that depends on nothing but theirs; returns how many.
fn partition<T>(items: &mut [T], holds: impl Fn(&T) -> bool) -> usize {
    let mut end = 0;
    for i in 0..items.len() {
        if holds(&items[i]) {
            items.swap(i, end);
            end += 1;
        }
    }
    end
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::HashRng;

    fn random(rng: &mut HashRng) -> Vec2 {
        Vec2::new(rng.next_1d(), rng.next_1d())
    }

    /// A tree that has seen light from about a direction and a little from everywhere.
    fn tree(rng: &mut HashRng) -> (Quadtrees, u32) {
        let toward = Vec3::new(0.3, -0.5, 0.8).normalize();
        let mut samples: Vec<Weighted> = (0..4000)
            .map(|_| random(rng))
            .map(|at| Weighted { at, weight: if direction_from_square(at).dot(toward) > 0.97 { 50.0 } else { 0.1 } })
            .collect();
        let mut trees = Quadtrees::default();
        let root = trees.add(&mut samples).unwrap();
        (trees, root)
    }

    #[test]
    fn the_square_covers_the_sphere_once() {
        let mut rng = HashRng::new(1);
        let mut sphere = 0.0;
        for _ in 0..20_000 {
            let at = random(&mut rng);
            let d = direction_from_square(at);
            assert!((d.length() - 1.0).abs() < 1e-6 && (square_from_direction(d) - at).length() < 1e-5, "{at}");
            sphere += 1.0 / density_on_sphere(d) / 20_000.0;
        }
        assert!((sphere / (4.0 * crate::math::PI) - 1.0).abs() < 0.02, "{sphere}");
    }

    /// Directions come as often as their density says, in each of many cells, and most from where the light is.
    #[test]
    fn directions_come_by_their_density() {
        let mut rng = HashRng::new(2);
        let (trees, root) = tree(&mut rng);
        const CELLS: usize = 16;
        let cell = |d: Vec3| {
            let at = square_from_direction(d) * CELLS as f32;
            (at.x as usize).min(CELLS - 1) + (at.y as usize).min(CELLS - 1) * CELLS
        };
        let n = 200_000;
        let (mut found, mut expected) = (vec![0.0f64; CELLS * CELLS], vec![0.0f64; CELLS * CELLS]);
        for _ in 0..n {
            let (d, pdf) = trees.sample(root, random(&mut rng));
            assert!((pdf / trees.pdf(root, d) - 1.0).abs() < 1e-3, "{d}: {pdf} instead of {}", trees.pdf(root, d));
            found[cell(d)] += 1.0 / f64::from(n);
            let other = direction_from_square(random(&mut rng));
            expected[cell(other)] += f64::from(trees.pdf(root, other) / density_on_sphere(other)) / f64::from(n);
        }
        assert!((expected.iter().sum::<f64>() - 1.0).abs() < 0.02, "the density does not integrate to 1");
        for (f, e) in found.iter().zip(&expected) {
            assert!((f - e).abs() < 0.1 * e + 6.0 * (e / f64::from(n)).sqrt(), "{f} instead of {e}");
        }
        let toward = Vec3::new(0.3, -0.5, 0.8).normalize();
        let near = (0..1000).filter(|_| trees.sample(root, random(&mut rng)).0.dot(toward) > 0.95).count();
        assert!(near > 650, "{near} of 1000");
    }

    #[test]
    fn one_sample_found_by_luck_does_not_count_for_all() {
        let mut rng = HashRng::new(3);
        let mut samples: Vec<Weighted> = (0..1000).map(|_| Weighted { at: random(&mut rng), weight: 1.0 }).collect();
        samples[7].weight = 1e3;
        let mut trees = Quadtrees::default();
        let root = trees.add(&mut samples).unwrap();
        let d = direction_from_square(Vec2::splat(0.9));
        assert!(trees.pdf(root, d) / density_on_sphere(d) > 0.8, "{}", trees.pdf(root, d) / density_on_sphere(d));
    }

    #[test]
    fn darkness_has_no_tree() {
        for weight in [0.0, -0.0] {
            let mut samples = vec![Weighted { at: Vec2::splat(0.5), weight }; 100];
            assert!(Quadtrees::default().add(&mut samples).is_none(), "{weight}");
        }
        assert!(Quadtrees::default().add(&mut []).is_none());
    }
}
