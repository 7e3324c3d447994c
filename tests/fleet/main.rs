//! Runs on several hosts: each is a set of Linux namespaces with a network, a /dev/shm and a monotonic
//! clock of its own. They need root: `cargo test --features bridge --test fleet -- --ignored --test-threads 1`.

#![expect(clippy::print_stderr, reason = "tests tell whoever runs them")]

mod faults;
mod hosts;
mod run;
mod soak;
mod splits;
