//! What people look at: the picture in the plane.
//!
//! - [`page`]: the picture for a browser, replayed or live
//! - [`scene`]: what is in the picture, and one instant of it
//!
//! Reads no clock, starts no process and knows nothing of iceoryx2.

pub mod page;
pub mod scene;
