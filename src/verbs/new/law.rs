//! A control law to start from: it keeps a formation slot, with an integrator.
//!
//! To build it in: this file goes to `agent/src/laws/my_law.rs`; `mod my_law;` and `my_law::LAW` go
//! into `agent/src/laws/mod.rs`. Scenarios may then say `law = "my-law"` with `k_per_s` and `reset_s`.

use formation::Vec2;

use super::{FORMATION_ROLE, Gains, Law, LawRow, Situation};

pub(super) const LAW: LawRow = LawRow {
    name: "my-law",
    role: FORMATION_ROLE,               // the error is relative to a slot
    source: "PI, our own",              // reference, for documentation
    gain_keys: &["k_per_s", "reset_s"], // keys in scenarios, all positive
    feed_forward: true,                 // it uses the velocities of the in-neighbors
    correction_max: None,               // no gain bounds its correction
    message_format: None,               // it sends no message with its beacons
    may_withhold_beacon: false,         // it sends a beacon with every answer
    signals: &[],                       // it records no numbers of its own
    build: |gains: &Gains<'_>| {
        Box::new(MyLaw {
            k: gains.get("k_per_s"),
            reset_s: gains.get("reset_s"),
            integral: Vec2::zeros(),
        })
    },
};

struct MyLaw {
    k: f64,
    reset_s: f64,
    /// Integral of the error, m s. A replacement process starts from zero.
    integral: Vec2,
}

impl Law for MyLaw {
    /// Returns the desired velocity of the front point, m/s.
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        let e = situation.error; // own front point - desired point, m
        if e.norm() < 0.1 {
            // Anti-windup: the error is integrated only close to the desired point.
            self.integral += situation.period_s * e;
        }
        situation.desired_velocity - self.k * (e + self.integral / self.reset_s)
    }
}
