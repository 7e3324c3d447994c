//! Elementary functions that are bit-identical on every target.
//!
//! The standard library's functions come from the platform's C library and differ in the last digit between
//! platforms, so a trajectory would have a different hash elsewhere. These come from the Rust crate `libm` on
//! every target, and `clippy.toml` forbids the standard library's. Addition, multiplication, division, square
//! root, remainder and rounding to integers are correctly rounded everywhere and remain the standard library's.

pub use libm::{
    asin, atan, atan2, cos, erfc, exp, exp2, log as ln, log10, pow, sin, sincos as sin_cos, tanh,
};

/// Returns x^2.
pub fn square(x: f64) -> f64 {
    x * x
}

/// Returns the length of the vector (x, y). The squares must neither overflow nor underflow, which holds for
/// all quantities of robots.
#[inline]
pub fn hypot(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}
