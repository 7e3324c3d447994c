//! Real processes, one test binary. Every test has its own run root, so tests run side by side.

mod bad_files;
mod cleanup;
mod faults;
mod formats;
mod harness;
mod hostile;
mod isolation;
mod lockstep;
mod model;
mod oracle;
mod realtime;
mod theory;
