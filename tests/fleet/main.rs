//! Runs on several hosts, each a set of Linux namespaces with a separate network, /dev/shm and monotonic clock. They
//! need root: `cargo test --features bridge --test fleet -- --ignored --test-threads 1`.

#![expect(clippy::print_stderr, reason = "tests print measurements")]

mod faults;
mod hosts;
mod run;
mod soak;
mod splits;
