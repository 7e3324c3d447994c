//! Constants of the deflection, found by search: `scenarios/campaigns/deflection/search.py`. The guarantee of the guard
//! does not depend on them.

/// Declares the constants: fields of [`Constants`], with their tuned values.
macro_rules! constants {
    ($($(#[$about:meta])* $name:ident = $value:literal,)*) => {
        /// Tuned constants of the deflection.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct Constants {
            $($(#[$about])* pub $name: f64,)*
        }

        impl Constants {
            /// Result of the search.
            pub const TUNED: Constants = Constants { $($name: $value),* };

            /// Returns the constant `name`, or `None` if there is none.
            fn named(&mut self, name: &str) -> Option<&mut f64> {
                match name {
                    $(stringify!($name) => Some(&mut self.$name),)*
                    _ => None,
                }
            }
        }
    };
}

constants! {
    /// Amplitude of the dither (A), a periodic rotation of a blocked robot's direction, rad.
    dither_rad = 0.1,
    /// Amplitude of the dither if any robot has inertia, rad. A robot that waits in front of a narrow passage has to
    /// leave the path of the oncoming robot.
    dither_inertial_rad = 0.85,
    /// Tangential gain (a): fraction of the removed approach velocity that is added at right angles to it, to pass the
    /// other robot.
    around = 0.3,
    /// Tangential gain (a) of a robot that makes no progress.
    around_at_last = 1.6,
    /// Time constant of the detection of missing progress, in d / v_max.
    impatience_time = 0.9,
    /// Maximum approach to another robot within one period, as a fraction of their distance minus d_f (kappa). If it
    /// would approach faster, the robot is steered around the other one.
    slack_share = 0.17,
    /// Steering distance d_f minus d, in v_max H; at least 0.05 d. Robots closer than d_f are steered around each
    /// other.
    margin = 1.9,
    /// Look-ahead time of early avoidance, in d / v_max.
    look_ahead = 3.3,
    /// Look-ahead time of early avoidance of a robot that turns before it leaves its path, in d / v_max.
    look_ahead_along_heading = 6.0,
    /// Gain of early avoidance: fraction that it corrects of d_f minus the predicted passing distance.
    look_ahead_share = 1.7,
    /// Maximum angle by which early avoidance turns a robot, rad.
    look_ahead_turn_rad = 0.75,
    /// Maximum relative increase of d_f of a robot at its slot that yields to an approaching robot.
    yield_share = 0.45,
    /// Approach speed of the other robot from which on the increase of d_f is at its maximum, in
    /// v_max / (1 + 5 v_max H / d).
    yield_speed = 1.0,
    /// Distance from its slot at which the increase of d_f has fallen to 37 % (1/e), in d, plus 4 v_max H.
    yield_reach = 0.45,
}

impl Constants {
    /// Returns [`Constants::TUNED`]; in a build with the feature `tuning`, changed by the environment variable
    /// `PHALANX_DEFLECTION`: pairs `NAME=VALUE`, separated by commas. All processes of a run inherit it. The
    /// feature is for the search and for `tests/planted/run`.
    ///
    /// # Panics
    ///
    /// If a pair names no constant, or if its value is no positive number.
    pub fn build_constants() -> Constants {
        if !cfg!(feature = "tuning") {
            return Constants::TUNED;
        }
        static ENVIRONMENT_CONSTANTS: std::sync::OnceLock<Constants> = std::sync::OnceLock::new();
        *ENVIRONMENT_CONSTANTS.get_or_init(|| {
            let mut constants = Constants::TUNED;
            let changes = std::env::var("PHALANX_DEFLECTION").unwrap_or_default();
            for change in changes.split(',').filter(|change| !change.is_empty()) {
                let (name, value) = change.split_once('=').unwrap_or((change, ""));
                let value = value.parse().ok().filter(|value: &f64| value.is_finite() && *value > 0.0);
                match (constants.named(name), value) {
                    (Some(constant), Some(value)) => *constant = value,
                    _ => panic!("PHALANX_DEFLECTION has `{change}`; expected NAME=VALUE, a constant and a value above 0"),
                }
            }
            constants
        })
    }
}
