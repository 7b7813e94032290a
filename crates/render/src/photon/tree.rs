//! A balanced kd-tree over photons (Bentley 1975, doi:10.1145/361002.361007), implicit in their order.
//!
//! The middle photon of a range splits it along the longest edge of the range's box; what is before it is on the lower side. There are
//! no pointers: photons and one byte each. The order is a function of the set of photons alone, not of threads.

use arrayvec::ArrayVec;
use std::cmp::Ordering;

use super::Photon;
use crate::accel::Ray;
use crate::math::{Aabb, Vec3};

/// Ranges up to this long are searched one by one.
const LEAF: usize = 8;
/// Longer ranges are built in two threads.
const PARALLEL: usize = 1 << 13;
/// The most neighbors of [`PhotonTree::nearest`].
pub const MAX_NEIGHBORS: usize = 256;

/// Photons by place.
#[derive(Clone, Debug, Default)]
pub struct PhotonTree {
    photons: Vec<Photon>,
    /// The axis along which the photon of the same index splits its range.
    axes: Vec<u8>,
}

/// Photons found, with their squared distances; a heap with the farthest first once it is full.
pub type Neighbors = ArrayVec<(f32, u32), MAX_NEIGHBORS>;

impl PhotonTree {
    /// Sorts photons into a tree. O(n log n); photons whose position is not finite must not be among them.
    pub fn new(mut photons: Vec<Photon>) -> Self {
        let mut axes = vec![0; photons.len()];
        build(&mut photons, &mut axes);
        Self { photons, axes }
    }

    /// Number of photons.
    pub fn len(&self) -> usize {
        self.photons.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.photons.is_empty()
    }

    /// The photons in the tree's order.
    pub fn photons(&self) -> &[Photon] {
        &self.photons
    }

    /// A photon by its index in the tree's order.
    #[inline]
    pub fn photon(&self, index: u32) -> &Photon {
        &self.photons[index as usize]
    }

    /// Calls `found` with every photon closer than `radius` and the squared distance, in an order that does not depend on threads.
    #[inline]
    pub fn within(&self, p: Vec3, radius: f32, mut found: impl FnMut(&Photon, f32)) {
        let mut limit = radius * radius;
        self.search(p, &mut limit, |photon, _, d2, _| found(photon, d2));
    }

    /// The `count` (at most [`MAX_NEIGHBORS`]) nearest photons that are closer than `radius` and that `accept` takes. Returns the
    /// squared radius of the search: the squared distance of the farthest of `count` photons, else that of `radius`.
    #[inline]
    pub fn nearest(&self, p: Vec3, count: usize, radius: f32, accept: impl Fn(&Photon) -> bool, out: &mut Neighbors) -> f32 {
        out.clear();
        let count = count.clamp(1, MAX_NEIGHBORS);
        let mut limit = radius * radius;
        self.search(p, &mut limit, |photon, index, d2, limit| {
            if !accept(photon) {
                return;
            }
            if out.len() < count {
                out.push((d2, index));
                if out.len() == count {
                    (0..count / 2).rev().for_each(|i| sift_down(out, i));
                    *limit = out[0].0;
                }
            } else {
                out[0] = (d2, index);
                sift_down(out, 0);
                *limit = out[0].0;
            }
        });
        limit
    }

    /// Calls `found` with every photon closer than `radius` to a ray between its origin and `t_max`, the ray parameter of the nearest
    /// point, and the squared distance. The direction must be unit.
    pub fn along(&self, ray: &Ray, t_max: f32, radius: f32, mut found: impl FnMut(&Photon, f32, f32)) {
        // A range and the part of the ray that may come near to it; the depth of the tree is below 32.
        let mut pending: ArrayVec<(u32, u32, f32, f32), 40> = ArrayVec::new();
        let mut at = (0, self.photons.len() as u32, 0.0, t_max);
        let mut test = |photon: &Photon| {
            let to = photon.position() - ray.o;
            let t = to.dot(ray.d);
            let d2 = (to - ray.d * t).length_squared();
            if t > 0.0 && t < t_max && d2 < radius * radius {
                found(photon, t, d2);
            }
        };
        loop {
            let (begin, end, t0, t1) = at;
            if (end - begin) as usize > LEAF {
                let middle = begin + (end - begin) / 2;
                let photon = &self.photons[middle as usize];
                let axis = usize::from(self.axes[middle as usize]);
                test(photon);
                let (o, d, split) = (ray.o[axis], ray.d[axis], photon.p[axis]);
                // The lower half: where the ray's coordinate is below split + radius; the upper: above split − radius.
                if let Some((a, b)) = clip(o, d, split + radius, t0, t1, true) {
                    pending.push((begin, middle, a, b));
                }
                if let Some((a, b)) = clip(o, d, split - radius, t0, t1, false) {
                    pending.push((middle + 1, end, a, b));
                }
            } else {
                self.photons[begin as usize..end as usize].iter().for_each(&mut test);
            }
            match pending.pop() {
                Some(next) => at = next,
                None => return,
            }
        }
    }

    /// Calls `found` with every photon whose squared distance is below the limit, which `found` may lower.
    #[inline]
    fn search(&self, p: Vec3, limit: &mut f32, mut found: impl FnMut(&Photon, u32, f32, &mut f32)) {
        // A range and the squared distance of what it lies behind; the depth of the tree is below 32.
        let mut pending: ArrayVec<(u32, u32, f32), 40> = ArrayVec::new();
        let (mut begin, mut end) = (0, self.photons.len());
        loop {
            while end - begin > LEAF {
                let middle = begin + (end - begin) / 2;
                let photon = &self.photons[middle];
                let axis = usize::from(self.axes[middle]);
                let behind = p[axis] - photon.p[axis];
                let (near, far) = if behind < 0.0 { ((begin, middle), (middle + 1, end)) } else { ((middle + 1, end), (begin, middle)) };
                // Later, and only if the limit is still wide enough then.
                if far.0 < far.1 && behind * behind < *limit {
                    pending.push((far.0 as u32, far.1 as u32, behind * behind));
                }
                let d2 = (photon.position() - p).length_squared();
                if d2 < *limit {
                    found(photon, middle as u32, d2, limit);
                }
                (begin, end) = near;
            }
            for index in begin..end {
                let photon = &self.photons[index];
                let d2 = (photon.position() - p).length_squared();
                if d2 < *limit {
                    found(photon, index as u32, d2, limit);
                }
            }
            loop {
                let Some((next_begin, next_end, d2)) = pending.pop() else { return };
                if d2 < *limit {
                    (begin, end) = (next_begin as usize, next_end as usize);
                    break;
                }
            }
        }
    }
}

/// The part of [t0, t1] in which o + t·d is below (or above) a plane, a little widened for rounding.
#[inline]
fn clip(o: f32, d: f32, plane: f32, t0: f32, t1: f32, below: bool) -> Option<(f32, f32)> {
    let t = (plane - o) / d;
    // Parallel to the plane, or a plane at infinity: by the origin.
    if !t.is_finite() {
        return if below { o <= plane } else { o >= plane }.then_some((t0, t1));
    }
    let slack = 1e-5 * t.abs();
    let (a, b) = if (d > 0.0) == below { (t0, t1.min(t + slack)) } else { (t0.max(t - slack), t1) };
    (a <= b).then_some((a, b))
}

/// Restores the heap below `i`: the farthest is first.
fn sift_down(heap: &mut [(f32, u32)], mut i: usize) {
    loop {
        let mut largest = i;
        for child in [2 * i + 1, 2 * i + 2] {
            if child < heap.len() && heap[child].0 > heap[largest].0 {
                largest = child;
            }
        }
        if largest == i {
            return;
        }
        heap.swap(i, largest);
        i = largest;
    }
}

/// An order of photons without ties but of equal records, along an axis first.
fn compare(a: &Photon, b: &Photon, axis: usize) -> Ordering {
    a.p[axis].total_cmp(&b.p[axis]).then_with(|| bytemuck::cast_ref::<Photon, [u32; 8]>(a).cmp(bytemuck::cast_ref(b)))
}

fn build(photons: &mut [Photon], axes: &mut [u8]) {
    if photons.len() <= LEAF {
        photons.sort_unstable_by(|a, b| compare(a, b, 0));
        return;
    }
    let bounds = photons.iter().fold(Aabb::EMPTY, |b, q| Aabb { min: b.min.min(q.position()), max: b.max.max(q.position()) });
    let extent = bounds.max - bounds.min;
    let axis = if extent.x >= extent.y && extent.x >= extent.z {
        0
    } else if extent.y >= extent.z {
        1
    } else {
        2
    };
    let middle = photons.len() / 2;
    photons.select_nth_unstable_by(middle, |a, b| compare(a, b, axis));
    axes[middle] = axis as u8;
    let (low, rest) = photons.split_at_mut(middle);
    let (low_axes, rest_axes) = axes.split_at_mut(middle);
    let (high, high_axes) = (&mut rest[1..], &mut rest_axes[1..]);
    if low.len() > PARALLEL {
        rayon::join(|| build(low, low_axes), || build(high, high_axes));
    } else {
        build(low, low_axes);
        build(high, high_axes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{mix32, unit_float};
    use crate::photon::Route;
    use crate::spectrum::Spectrum;

    fn photons(n: u32, spread: Vec3) -> Vec<Photon> {
        let u = |i: u32| unit_float(mix32(i));
        let at = |i: u32| Vec3::new(u(3 * i), u(3 * i + 1), u(3 * i + 2)) * spread;
        (0..n).map(|i| Photon::new(at(i), Vec3::Z, Vec3::Z, Spectrum::splat(i as f32), 0, 0, Route::Direct)).collect()
    }

    #[test]
    fn searches_find_what_looking_at_all_finds() {
        // A cloud, a plane, a line, and photons that all lie in one point.
        for spread in [Vec3::ONE, Vec3::new(1.0, 1.0, 0.0), Vec3::X, Vec3::ZERO] {
            for n in [0, 1, 8, 9, 100, 3000] {
                let all = photons(n, spread);
                let tree = PhotonTree::new(all.clone());
                for q in photons(20, Vec3::splat(1.2)) {
                    let p = q.position();
                    let d2 = |x: &Photon| (x.position() - p).length_squared();
                    for radius in [0.05, 0.3, 3.0] {
                        let (mut found, mut sum) = (0, 0.0);
                        tree.within(p, radius, |x, d| {
                            found += 1;
                            sum += f64::from(x.power[0]);
                            assert_eq!(d, d2(x));
                        });
                        let expected: Vec<_> = all.iter().filter(|x| d2(x) < radius * radius).collect();
                        assert_eq!(found, expected.len());
                        assert_eq!(sum, expected.iter().map(|x| f64::from(x.power[0])).sum::<f64>());
                        for count in [1, 2, 10, 50] {
                            let mut neighbors = Neighbors::new();
                            let even = |x: &Photon| (x.power[0] as u32).is_multiple_of(2);
                            let limit = tree.nearest(p, count, radius, even, &mut neighbors);
                            let mut expected: Vec<f32> = all.iter().filter(|x| even(x)).map(d2).filter(|d| *d < radius * radius).collect();
                            expected.sort_by(f32::total_cmp);
                            expected.truncate(count);
                            let mut distances: Vec<f32> = neighbors.iter().map(|n| n.0).collect();
                            distances.sort_by(f32::total_cmp);
                            assert_eq!(distances, expected);
                            let full = expected.len() == count;
                            assert_eq!(limit, if full { expected[count - 1] } else { radius * radius });
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn photons_along_rays_are_those_that_looking_at_all_finds() {
        for spread in [Vec3::ONE, Vec3::new(1.0, 1.0, 0.0), Vec3::ZERO] {
            let all = photons(2000, spread);
            let tree = PhotonTree::new(all.clone());
            for (i, q) in photons(60, Vec3::ONE).into_iter().enumerate() {
                let d = [Vec3::new(0.3, -0.5, 0.7), Vec3::X, -Vec3::Y, Vec3::new(-0.2, 0.9, 0.0)][i % 4].normalize();
                let ray = Ray::new(q.position() - d * 0.5, d);
                for (t_max, radius) in [(f32::INFINITY, 0.1), (0.7, 0.05), (1e30, 1.0)] {
                    let near = |x: &Photon| {
                        let to = x.position() - ray.o;
                        let t = to.dot(d);
                        t > 0.0 && t < t_max && (to - d * t).length_squared() < radius * radius
                    };
                    let mut found = Vec::new();
                    tree.along(&ray, t_max, radius, |x, _, _| found.push(x.power[0]));
                    found.sort_by(f32::total_cmp);
                    let mut expected: Vec<f32> = all.iter().filter(|x| near(x)).map(|x| x.power[0]).collect();
                    expected.sort_by(f32::total_cmp);
                    assert_eq!(found, expected);
                }
            }
        }
    }

    #[test]
    fn the_order_does_not_depend_on_that_of_the_input_or_on_threads() {
        let all = photons(30_000, Vec3::ONE);
        let mut turned = all.clone();
        turned.reverse();
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let (a, b) = (PhotonTree::new(all), one.install(|| PhotonTree::new(turned)));
        assert_eq!(a.photons(), b.photons());
        assert_eq!(a.axes, b.axes);
    }
}
