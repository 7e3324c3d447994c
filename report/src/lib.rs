//! What people look at: the picture in the plane.
//!
//! - [`scene`]: what is in the picture, and one instant of it
//!
//! Reads no clock, starts no process and knows nothing of iceoryx2.

pub mod scene;
