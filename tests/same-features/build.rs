//! Empty: what is wanted of it is its dependencies.

fn main() {}
