//! `phalanx.real`: the elementary functions of the built-in laws, for laws in Python with identical trajectories.

use pyo3::prelude::*;

macro_rules! functions {
    ($($name:ident($($x:ident),+);)+) => {
        #[pymodule]
        pub mod real {
            use super::*;

            $(
                #[pyfunction]
                fn $name($($x: f64),+) -> f64 {
                    formation::portable_math::$name($($x),+)
                }
            )+
        }
    };
}

functions! {
    asin(x);
    atan(x);
    atan2(y, x);
    cos(x);
    exp(x);
    hypot(x, y);
    ln(x);
    pow(x, y);
    sin(x);
    tanh(x);
}
