//! Nothing, in place of bindgen: iceoryx2 names it as a build dependency on every system, but calls it
//! on QNX only. Without it 20 crates and a twelfth of a cold build are gone. `Cargo.toml` patches it
//! in; to have the real one again, remove the patch.
