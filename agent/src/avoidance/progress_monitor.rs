//! Progress monitoring: detects a robot that makes no progress towards its desired position, and deadlocks.

use super::Sample;

/// Maximum progress deficit, as a fraction of the requested speed, of a robot that makes progress.
const PROGRESS_DEFICIT_MAX: f64 = 0.3;
/// Requested speed, as a fraction of v_max, below which a robot counts as having arrived.
const REQUESTED_SPEED_FRACTION_MIN: f64 = 0.05;
/// Minimum decrease of the distance to the desired position that counts as headway, as a fraction of d.
const HEADWAY_FRACTION_MIN: f64 = 0.05;
/// Increase of the distance to the desired position, as a fraction of d, from which on a new desired position
/// is assumed.
const NEW_SLOT_DISTANCE: f64 = 2.0;
/// Time without headway after which a robot rests, in d / v_max. It rests for the same time at first, and for
/// twice the previous time after each further attempt.
const ATTEMPT_TIME: f64 = 30.0;
/// Reciprocal of the fraction of [`ATTEMPT_TIME`] after which the dither starts to grow. The dither is complete at
/// twice that fraction.
const BLOCKED_DEGREE_SLOPE: f64 = 6.0;
/// Time for which a robot in standoff retries to reach its slot, in d / v_max. The first standoff lasts equally
/// long, and each further one twice as long as the previous.
const RETRY_TIME: f64 = 5.0;

/// Monitor of the progress of one robot.
#[derive(Debug)]
pub struct ProgressMonitor {
    distance_min: f64,
    /// Time without headway after which the robot rests, s.
    attempt_s: f64,
    /// Time constant of the progress deficit, s.
    smoothing_time_s: f64,
    /// Smoothed progress deficit, as a fraction of v_max.
    progress_deficit: f64,
    /// Minimum \|e\| up to now, m.
    error_min_m: f64,
    /// Time since the robot last made progress, s.
    time_without_progress_s: f64,
    /// Remaining time of the current rest, s.
    remaining_rest_s: f64,
    /// Duration of the next rest, s.
    next_rest_s: f64,
    /// Duration of a retry, s.
    retry_s: f64,
    /// Time spent in the current standoff, s.
    standoff_elapsed_s: f64,
    /// Remaining time of the current retry, s.
    remaining_retry_s: f64,
    /// Maximum duration of the next standoff, s.
    next_standoff_max_s: f64,
}

impl ProgressMonitor {
    /// Creates a monitor with d, m, v_max, m/s, and the time constant of the deficit, in d / v_max.
    pub fn new(d: f64, v_max: f64, smoothing_time: f64) -> ProgressMonitor {
        let attempt_s = ATTEMPT_TIME * d / v_max;
        ProgressMonitor {
            distance_min: d,
            attempt_s,
            smoothing_time_s: smoothing_time * d / v_max,
            progress_deficit: 0.0,
            error_min_m: f64::INFINITY,
            time_without_progress_s: 0.0,
            remaining_rest_s: 0.0,
            next_rest_s: attempt_s,
            retry_s: RETRY_TIME * d / v_max,
            standoff_elapsed_s: 0.0,
            remaining_retry_s: 0.0,
            next_standoff_max_s: RETRY_TIME * d / v_max,
        }
    }

    /// Updates the monitor with a sample, `dt` seconds after the previous one. `requested` is the requested speed
    /// and `missing` its missing part, both as fractions of v_max.
    pub fn observe(&mut self, dt: f64, sample: &Sample<'_>, [requested, missing]: [f64; 2]) {
        self.progress_deficit +=
            (missing.clamp(0.0, 1.0) - self.progress_deficit) * (dt / (dt + self.smoothing_time_s));
        let error = sample.error.map_or(f64::INFINITY, |error| error.norm());
        let is_nearer = error < self.error_min_m - HEADWAY_FRACTION_MIN * self.distance_min;
        if is_nearer || error > self.error_min_m + NEW_SLOT_DISTANCE * self.distance_min {
            self.error_min_m = error;
            (self.time_without_progress_s, self.remaining_rest_s, self.next_rest_s) =
                (0.0, 0.0, self.attempt_s);
            (self.standoff_elapsed_s, self.next_standoff_max_s) = (0.0, self.retry_s);
        } else if self.remaining_rest_s > 0.0 {
            self.remaining_rest_s -= dt;
        } else if requested > REQUESTED_SPEED_FRACTION_MIN
            && missing > PROGRESS_DEFICIT_MAX * requested
        {
            self.time_without_progress_s += dt;
            if self.time_without_progress_s > self.attempt_s {
                (self.time_without_progress_s, self.remaining_rest_s) = (0.0, self.next_rest_s);
                self.next_rest_s *= 2.0;
            }
        }
    }

    /// Returns `true` if the robot, `dt` seconds later, keeps the standoff from the robot that occupies its
    /// slot. Standoff and retries alternate, because the other robot may be waiting for this robot to move on.
    pub fn update_standoff(&mut self, dt: f64) -> bool {
        if self.remaining_retry_s > 0.0 {
            self.remaining_retry_s -= dt;
            return false;
        }
        self.standoff_elapsed_s += dt;
        let keeps_standoff = self.standoff_elapsed_s <= self.next_standoff_max_s;
        if !keeps_standoff {
            (self.standoff_elapsed_s, self.remaining_retry_s) = (0.0, self.retry_s);
            self.next_standoff_max_s *= 2.0;
        }
        keeps_standoff
    }

    /// Returns the degree of missing progress, from 0 to 1.
    pub fn missing_progress(&self) -> f64 {
        ((self.progress_deficit - PROGRESS_DEFICIT_MAX) / (1.0 - PROGRESS_DEFICIT_MAX))
            .clamp(0.0, 1.0)
    }

    /// Returns the degree to which the robot has tried in vain for a long time, from 0 to 1.
    pub fn blocked_degree(&self) -> f64 {
        (BLOCKED_DEGREE_SLOPE * self.time_without_progress_s / self.attempt_s - 1.0).clamp(0.0, 1.0)
    }

    /// Returns `true` while the robot rests after a failed attempt.
    pub fn is_resting(&self) -> bool {
        self.remaining_rest_s > 0.0
    }
}
