//! Whether a robot gets where it wants: when it loses patience, and when it rests.

use super::Sample;

/// A robot that lacks less than this share of what it wants gets on.
const GETS_ON: f64 = 0.3;
/// A robot that wants less than this share of v_max is where it wants to be.
const WANTS: f64 = 0.05;
/// Nearer to its place than ever, by this share of d: headway.
const HEADWAY: f64 = 0.05;
/// The place itself is another, if it is farther away than ever by this share of d.
const ANOTHER_PLACE: f64 = 2.0;
/// Without headway for this long, in d / v_max, a robot rests for as long: twice as long each time.
const TRIES: f64 = 30.0;
/// It has tried for long from this part of that time on, and wholly from twice that part on.
const TRIED: f64 = 6.0;
/// Who stands off insists on its place for this long, in d / v_max, after as long: twice as long each time.
const INSISTS: f64 = 5.0;

/// What a robot has got of what it wanted.
#[derive(Debug)]
pub struct Patience {
    d: f64,
    /// How long it tries without headway before it rests, s.
    tries_s: f64,
    /// Over how long `lacks` is smoothed, s, and that share of its speed.
    smooth_s: f64,
    lacks: f64,
    /// The least \|e\| so far, m.
    nearest: f64,
    /// For how long it has tried since, and still rests, s.
    tried_s: f64,
    rests_s: f64,
    next_rest_s: f64,
    /// For how long it insists on its place.
    insists_s: f64,
    /// For how long it has stood off and still insists, and for how long it stands off the next time, s.
    stood_s: f64,
    still_insists_s: f64,
    next_stand_s: f64,
}

impl Patience {
    /// With d, m, v_max, m/s, and the time, in d / v_max, after which a robot counts as getting nowhere.
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

    /// Takes in, `dt` seconds after the last one, a sample at which the robot wants this share of v_max, and
    /// lacks that share.
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

    /// Whether it stands off, `dt` seconds later, from somebody who has its place: whoever is there may wait for
    /// just this robot to go on.
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

    /// How much it gets nowhere, from 0 to 1.
    pub fn lost(&self) -> f64 {
        ((self.lacks - GETS_ON) / (1.0 - GETS_ON)).clamp(0.0, 1.0)
    }

    /// How much it has tried for long, from 0 to 1.
    pub fn has_tried(&self) -> f64 {
        (TRIED * self.tried_s / self.tries_s - 1.0).clamp(0.0, 1.0)
    }

    /// Whether it has given up for now.
    pub fn rests(&self) -> bool {
        self.rests_s > 0.0
    }
}
