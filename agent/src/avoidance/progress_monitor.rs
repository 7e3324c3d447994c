//! Progress monitoring: detects a robot that makes no progress towards its desired position, and deadlocks.

use super::Sample;

/// Maximum progress deficit, as a fraction of the requested speed, of a robot that makes progress.
const PROGRESS_DEFICIT_MAX: f64 = 0.3;
/// Requested speed, as a fraction of v_max, below which a robot counts as having arrived.
const REQUEST_MIN: f64 = 0.05;
/// Minimum decrease of the distance to the desired position that counts as headway, as a fraction of d.
const HEADWAY_MIN: f64 = 0.05;
/// Increase of the distance to the desired position, as a fraction of d, from which on a new desired position
/// is assumed.
const NEW_SLOT_DISTANCE: f64 = 2.0;
/// Time without headway after which a robot rests, in d / v_max. It rests for the same time at first, and for
/// twice the previous time after each further attempt.
const ATTEMPT_TIME: f64 = 30.0;
/// Reciprocal of the fraction of [`ATTEMPT_TIME`] after which the dither starts to grow. The dither is complete at
/// twice that fraction.
const BLOCKED_RATE: f64 = 6.0;
/// Time for which a robot in standoff retries to reach its slot, in d / v_max. The first standoff lasts equally
/// long, and each further one twice as long as the previous.
const RETRY_TIME: f64 = 5.0;

/// Monitor of the progress of one robot.
#[derive(Debug)]
pub struct ProgressMonitor {
    d: f64,
    /// Time without headway after which the robot rests, s.
    attempt_s: f64,
    /// Time constant of the progress deficit, s.
    smooth_s: f64,
    /// Smoothed progress deficit, as a fraction of v_max.
    progress_deficit: f64,
    /// Minimum \|e\| up to now, m.
    nearest: f64,
    /// Time since the robot last made progress, s.
    tried_s: f64,
    /// Remaining time of the current rest, s.
    rests_s: f64,
    /// Duration of the next rest, s.
    next_rest_s: f64,
    /// Duration of a retry, s.
    retry_s: f64,
    /// Time spent in the current standoff, s.
    standoff_s: f64,
    /// Remaining time of the current retry, s.
    retry_left_s: f64,
    /// Maximum duration of the next standoff, s.
    next_standoff_s: f64,
}

impl ProgressMonitor {
    /// Creates a monitor with d, m, v_max, m/s, and the time constant of the deficit, in d / v_max.
    pub fn new(d: f64, v_max: f64, time: f64) -> ProgressMonitor {
        let attempt_s = ATTEMPT_TIME * d / v_max;
        ProgressMonitor {
            d,
            attempt_s,
            smooth_s: time * d / v_max,
            progress_deficit: 0.0,
            nearest: f64::INFINITY,
            tried_s: 0.0,
            rests_s: 0.0,
            next_rest_s: attempt_s,
            retry_s: RETRY_TIME * d / v_max,
            standoff_s: 0.0,
            retry_left_s: 0.0,
            next_standoff_s: RETRY_TIME * d / v_max,
        }
    }

    /// Updates the monitor with a sample, `dt` seconds after the previous one. `wants` is the requested speed
    /// and `lacks` its missing part, both as fractions of v_max.
    pub fn observe(&mut self, dt: f64, sample: &Sample<'_>, [wants, lacks]: [f64; 2]) {
        self.progress_deficit +=
            (lacks.clamp(0.0, 1.0) - self.progress_deficit) * (dt / (dt + self.smooth_s));
        let error = sample.error.map_or(f64::INFINITY, |error| error.norm());
        let nearer = error < self.nearest - HEADWAY_MIN * self.d;
        if nearer || error > self.nearest + NEW_SLOT_DISTANCE * self.d {
            self.nearest = error;
            (self.tried_s, self.rests_s, self.next_rest_s) = (0.0, 0.0, self.attempt_s);
            (self.standoff_s, self.next_standoff_s) = (0.0, self.retry_s);
        } else if self.rests_s > 0.0 {
            self.rests_s -= dt;
        } else if wants > REQUEST_MIN && lacks > PROGRESS_DEFICIT_MAX * wants {
            self.tried_s += dt;
            if self.tried_s > self.attempt_s {
                (self.tried_s, self.rests_s) = (0.0, self.next_rest_s);
                self.next_rest_s *= 2.0;
            }
        }
    }

    /// Returns `true` if the robot, `dt` seconds later, keeps the standoff from the robot that occupies its
    /// slot. Standoff and retries alternate, because the other robot may be waiting for this robot to move on.
    pub fn keeps_standoff(&mut self, dt: f64) -> bool {
        if self.retry_left_s > 0.0 {
            self.retry_left_s -= dt;
            return false;
        }
        self.standoff_s += dt;
        let stands = self.standoff_s <= self.next_standoff_s;
        if !stands {
            (self.standoff_s, self.retry_left_s) = (0.0, self.retry_s);
            self.next_standoff_s *= 2.0;
        }
        stands
    }

    /// Returns the degree of missing progress, from 0 to 1.
    pub fn missing_progress(&self) -> f64 {
        ((self.progress_deficit - PROGRESS_DEFICIT_MAX) / (1.0 - PROGRESS_DEFICIT_MAX))
            .clamp(0.0, 1.0)
    }

    /// Returns the degree to which the robot has tried in vain for a long time, from 0 to 1.
    pub fn blocked_degree(&self) -> f64 {
        (BLOCKED_RATE * self.tried_s / self.attempt_s - 1.0).clamp(0.0, 1.0)
    }

    /// Returns `true` while the robot rests after a failed attempt.
    pub fn is_resting(&self) -> bool {
        self.rests_s > 0.0
    }
}
