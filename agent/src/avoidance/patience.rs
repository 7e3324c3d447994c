//! Progress monitoring: detects a robot that makes no progress towards its desired position, and deadlocks.

use super::Sample;

/// Maximum progress deficit, as a fraction of the requested speed, of a robot that makes progress.
const GETS_ON: f64 = 0.3;
/// Requested speed, as a fraction of v_max, below which a robot counts as having arrived.
const WANTS: f64 = 0.05;
/// Minimum decrease of the distance to the desired position that counts as headway, as a fraction of d.
const HEADWAY: f64 = 0.05;
/// Increase of the distance to the desired position, as a fraction of d, from which on a new desired position
/// is assumed.
const ANOTHER_PLACE: f64 = 2.0;
/// Time without headway after which a robot rests, in d / v_max. It rests for the same time at first, and for
/// twice the previous time after each further attempt.
const TRIES: f64 = 30.0;
/// Reciprocal of the fraction of that time after which the dither starts to grow. It is complete at twice that
/// fraction.
const TRIED: f64 = 6.0;
/// Time for which a robot in standoff retries to reach its slot, in d / v_max. The first standoff lasts equally
/// long, and each further one twice as long as the previous.
const INSISTS: f64 = 5.0;

/// Monitor of the progress of one robot.
#[derive(Debug)]
pub struct Patience {
    d: f64,
    /// Time without headway after which the robot rests, s.
    tries_s: f64,
    /// Time constant of `lacks`, s, and the smoothed progress deficit as a fraction of v_max.
    smooth_s: f64,
    lacks: f64,
    /// Minimum \|e\| up to now, m.
    nearest: f64,
    /// Time since the last headway, and remaining resting time, s.
    tried_s: f64,
    rests_s: f64,
    next_rest_s: f64,
    /// Duration of a retry, s.
    insists_s: f64,
    /// Time spent in the current standoff, remaining time of the retry, and maximum duration of the next
    /// standoff, s.
    stood_s: f64,
    still_insists_s: f64,
    next_stand_s: f64,
}

impl Patience {
    /// Creates a monitor with d, m, v_max, m/s, and the time constant of the deficit, in d / v_max.
    pub fn new(d: f64, v_max: f64, time: f64) -> Patience {
        let tries_s = TRIES * d / v_max;
        Patience {
            d,
            tries_s,
            smooth_s: time * d / v_max,
            lacks: 0.0,
            nearest: f64::INFINITY,
            tried_s: 0.0,
            rests_s: 0.0,
            next_rest_s: tries_s,
            insists_s: INSISTS * d / v_max,
            stood_s: 0.0,
            still_insists_s: 0.0,
            next_stand_s: INSISTS * d / v_max,
        }
    }

    /// Updates the monitor with a sample, `dt` seconds after the previous one. `wants` is the requested speed
    /// and `lacks` its missing part, both as fractions of v_max.
    pub fn observe(&mut self, dt: f64, sample: &Sample<'_>, [wants, lacks]: [f64; 2]) {
        self.lacks += (lacks.clamp(0.0, 1.0) - self.lacks) * (dt / (dt + self.smooth_s));
        let error = sample.error.map_or(f64::INFINITY, |error| error.norm());
        let nearer = error < self.nearest - HEADWAY * self.d;
        if nearer || error > self.nearest + ANOTHER_PLACE * self.d {
            self.nearest = error;
            (self.tried_s, self.rests_s, self.next_rest_s) = (0.0, 0.0, self.tries_s);
            (self.stood_s, self.next_stand_s) = (0.0, self.insists_s);
        } else if self.rests_s > 0.0 {
            self.rests_s -= dt;
        } else if wants > WANTS && lacks > GETS_ON * wants {
            self.tried_s += dt;
            if self.tried_s > self.tries_s {
                (self.tried_s, self.rests_s) = (0.0, self.next_rest_s);
                self.next_rest_s *= 2.0;
            }
        }
    }

    /// Returns `true` if the robot, `dt` seconds later, keeps the standoff from the robot that occupies its
    /// slot. Standoff and retries alternate, because the other robot may be waiting for this robot to move on.
    pub fn stands_off(&mut self, dt: f64) -> bool {
        if self.still_insists_s > 0.0 {
            self.still_insists_s -= dt;
            return false;
        }
        self.stood_s += dt;
        let stands = self.stood_s <= self.next_stand_s;
        if !stands {
            (self.stood_s, self.still_insists_s) = (0.0, self.insists_s);
            self.next_stand_s *= 2.0;
        }
        stands
    }

    /// Returns the degree of missing progress, from 0 to 1.
    pub fn lost(&self) -> f64 {
        ((self.lacks - GETS_ON) / (1.0 - GETS_ON)).clamp(0.0, 1.0)
    }

    /// Returns the degree to which the robot has tried in vain for a long time, from 0 to 1.
    pub fn has_tried(&self) -> f64 {
        (TRIED * self.tried_s / self.tries_s - 1.0).clamp(0.0, 1.0)
    }

    /// Returns `true` while the robot rests after a failed attempt.
    pub fn rests(&self) -> bool {
        self.rests_s > 0.0
    }
}
