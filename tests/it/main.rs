//! One test binary. Real processes, each test in its own run root, so that tests run side by side;
//! and the same brains and world composed in one process: `oracle` (lockstep), `model` (real time).

#![expect(clippy::print_stderr, clippy::print_stdout, reason = "tests tell whoever runs them")]

mod architecture;
mod bad_files;
mod browser;
mod byte_equality;
mod campaigns;
mod chapter;
mod cleanup;
mod container;
mod every_fault;
mod faults;
mod foretold;
mod formats;
mod harness;
mod hostile;
mod hung;
mod ideal;
mod inertia;
mod isolation;
mod latency;
mod leader_frame;
mod lockstep;
mod lost_screen;
mod machine;
mod memory;
mod model;
mod oracle;
mod pages;
mod plant;
mod processes;
mod provenance;
mod realtime;
mod recording;
mod report;
mod schema;
mod security;
mod silence;
mod single_faults;
mod soak;
mod statistics;
mod theory;
mod verdicts;
mod verify;
mod view;
mod walls;
