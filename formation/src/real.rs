//! The elementary functions, the same on every target.
//!
//! The standard library's are the platform's C library's, which differ in the last digit from one to the
//! next; a trajectory that goes through them has another hash elsewhere. These are one library's, in Rust,
//! whatever the target; `clippy.toml` keeps the standard library's out. Addition, multiplication, division, square root,
//! remainder and rounding to whole numbers are exact to the last digit everywhere, and are the standard library's.

pub use libm::{
    asin, atan, atan2, cos, erfc, exp, exp2, log as ln, log10, pow, sin, sincos as sin_cos, tanh,
};

/// x^2.
pub fn square(x: f64) -> f64 {
    x * x
}

/// The length of (x, y): of anything that robots do, whose squares neither overflow nor vanish.
#[inline]
pub fn hypot(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}
