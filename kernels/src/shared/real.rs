//! Arithmetic on small vectors of f32 or f64, so that one generic reference function works with both types. Its results in f64 count as exact. The
//! error of its results in f32 shows which error to expect of the shader.

use num_traits::Float;

/// The number type of the generic reference functions: `f32` or `f64`.
pub trait Real: Float + std::fmt::Debug + Send + Sync + 'static {
    /// The nearest value of this type.
    fn of(value: f64) -> Self;
    /// The value as f64 (exact for both types).
    fn to_f64(self) -> f64;
}

impl Real for f32 {
    #[allow(clippy::cast_possible_truncation, reason = "rounding to the nearest f32 is the purpose")]
    fn of(value: f64) -> Self {
        value as f32
    }
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
}

impl Real for f64 {
    fn of(value: f64) -> Self {
        value
    }
    fn to_f64(self) -> f64 {
        self
    }
}

/// Dot product.
#[inline]
pub fn dot<T: Real, const N: usize>(a: [T; N], b: [T; N]) -> T {
    let mut sum = T::zero();
    for i in 0..N {
        sum = sum + a[i] * b[i];
    }
    sum
}

/// Componentwise sum.
#[inline]
pub fn add<T: Real, const N: usize>(a: [T; N], b: [T; N]) -> [T; N] {
    std::array::from_fn(|i| a[i] + b[i])
}

/// Componentwise difference.
#[inline]
pub fn sub<T: Real, const N: usize>(a: [T; N], b: [T; N]) -> [T; N] {
    std::array::from_fn(|i| a[i] - b[i])
}

/// Product with a number.
#[inline]
pub fn scale<T: Real, const N: usize>(a: [T; N], s: T) -> [T; N] {
    a.map(|x| x * s)
}

/// Euclidean length.
#[inline]
pub fn length<T: Real, const N: usize>(a: [T; N]) -> T {
    dot(a, a).sqrt()
}

/// Unit vector along `a`; the z axis if the length of `a` is 0 or not finite.
#[inline]
pub fn normalize<T: Real>(a: [T; 3]) -> [T; 3] {
    let l = length(a);
    if l > T::zero() && l.is_finite() { scale(a, T::one() / l) } else { [T::zero(), T::zero(), T::one()] }
}
