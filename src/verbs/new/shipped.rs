//! The shipped scenarios of the repository, as templates for `phalanx new`.

macro_rules! shipped {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../../../scenarios/", $name, ".toml")))),*]
    };
}

/// Name and text of each scenario.
pub(super) const SCENARIOS: &[(&str, &str)] = shipped![
    "antipodal-8",
    "containment",
    "containment-chaos",
    "containment-inertia",
    "corridor",
    "doorway",
    "escort",
    "hallway",
    "intersection",
    "lattice-12",
    "liar-10",
    "line-5",
    "pentagon",
    "pentagon-cut",
    "pentagon-inertia",
    "random-swaps-10",
    "ring-6",
    "standing-leaders",
    "swap-8",
    "swap-8-burger",
    "swaps-128",
    "swarm64",
    "triangle",
    "triangle-b",
    "triangle-c",
    "triangle-d",
    "triangle-inertia",
    "triangle-kill",
    "warehouse",
];

/// Names and texts of the files that these scenarios refer to.
pub(super) const REFERENCED_FILES: &[(&str, &str)] =
    &[("swarm64.json", include_str!("../../../scenarios/swarm64.json"))];
