//! Empty replacement of bindgen: iceoryx2 has it as a build dependency on every system, but calls it on
//! QNX only. Without it, a cold build needs 20 crates and a twelfth of the time less. The patch is in
//! `Cargo.toml`; remove it to use the real crate.
