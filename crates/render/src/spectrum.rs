//! Radiance and everything that multiplies it, in four lanes.
//!
//! In RGB mode the lanes are linear Rec. 709 R, G, B and one that is carried along unused; a spectral mode would
//! hold four hero wavelengths. Code between the edges (texture, emission, film) works lane by lane and does not look
//! at the mode.

use std::ops::{Add, AddAssign, Div, DivAssign, Index, Mul, MulAssign, Neg, Sub};

/// Four lanes of radiance, reflectance, throughput or importance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))]
pub struct Spectrum(pub [f32; 4]);

impl Spectrum {
    /// Nothing: black.
    pub const ZERO: Self = Self([0.0; 4]);
    /// One in every lane.
    pub const ONE: Self = Self([1.0; 4]);

    /// The same value in every lane.
    #[inline]
    pub const fn splat(v: f32) -> Self {
        Self([v; 4])
    }

    /// From linear Rec. 709 RGB.
    #[inline]
    pub const fn from_rgb(rgb: [f32; 3]) -> Self {
        Self([rgb[0], rgb[1], rgb[2], 0.0])
    }

    /// As linear Rec. 709 RGB.
    #[inline]
    pub const fn rgb(self) -> [f32; 3] {
        [self.0[0], self.0[1], self.0[2]]
    }

    /// Relative luminance (Rec. 709 weights).
    #[inline]
    pub fn luminance(self) -> f32 {
        0.212_671 * self.0[0] + 0.715_16 * self.0[1] + 0.072_169 * self.0[2]
    }

    /// The largest of the lanes in use.
    #[inline]
    pub fn max_component(self) -> f32 {
        self.0[0].max(self.0[1]).max(self.0[2])
    }

    /// The mean of the lanes in use.
    #[inline]
    pub fn average(self) -> f32 {
        (self.0[0] + self.0[1] + self.0[2]) * (1.0 / 3.0)
    }

    /// True where no lane in use carries anything.
    #[inline]
    pub fn is_black(self) -> bool {
        self.0[0] == 0.0 && self.0[1] == 0.0 && self.0[2] == 0.0
    }

    /// True where every lane in use is a finite number.
    #[inline]
    pub fn is_finite(self) -> bool {
        self.0[0].is_finite() && self.0[1].is_finite() && self.0[2].is_finite()
    }

    /// Applies a function to each lane.
    #[inline]
    pub fn map(self, mut f: impl FnMut(f32) -> f32) -> Self {
        Self([f(self.0[0]), f(self.0[1]), f(self.0[2]), f(self.0[3])])
    }

    /// Combines two spectra lane by lane.
    #[inline]
    pub fn zip(self, o: Self, mut f: impl FnMut(f32, f32) -> f32) -> Self {
        Self([f(self.0[0], o.0[0]), f(self.0[1], o.0[1]), f(self.0[2], o.0[2]), f(self.0[3], o.0[3])])
    }

    /// Each lane limited to the range.
    #[inline]
    pub fn clamp(self, lo: f32, hi: f32) -> Self {
        self.map(|v| v.clamp(lo, hi))
    }

    /// Linear interpolation from `self` (t = 0) to `o` (t = 1).
    #[inline]
    pub fn lerp(self, o: Self, t: f32) -> Self {
        self * (1.0 - t) + o * t
    }
}

macro_rules! lanewise {
    ($($trait:ident $f:ident $op:tt),*) => {$(
        impl $trait for Spectrum {
            type Output = Self;
            #[inline]
            fn $f(self, o: Self) -> Self {
                self.zip(o, |a, b| a $op b)
            }
        }
        impl $trait<f32> for Spectrum {
            type Output = Self;
            #[inline]
            fn $f(self, o: f32) -> Self {
                self.map(|a| a $op o)
            }
        }
    )*};
}
lanewise!(Add add +, Sub sub -, Mul mul *, Div div /);

impl AddAssign for Spectrum {
    #[inline]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}
impl MulAssign for Spectrum {
    #[inline]
    fn mul_assign(&mut self, o: Self) {
        *self = *self * o;
    }
}
impl MulAssign<f32> for Spectrum {
    #[inline]
    fn mul_assign(&mut self, o: f32) {
        *self = *self * o;
    }
}
impl DivAssign<f32> for Spectrum {
    #[inline]
    fn div_assign(&mut self, o: f32) {
        *self = *self / o;
    }
}
impl Mul<Spectrum> for f32 {
    type Output = Spectrum;
    #[inline]
    fn mul(self, o: Spectrum) -> Spectrum {
        o * self
    }
}
impl Neg for Spectrum {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        self.map(|v| -v)
    }
}
impl Index<usize> for Spectrum {
    type Output = f32;
    #[inline]
    fn index(&self, i: usize) -> &f32 {
        &self.0[i]
    }
}
