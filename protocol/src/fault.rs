//! What is to break when, as the processes are told in which it breaks.
//!
//! Kills and freezes are not here: the supervisor does them to processes. Everything here is a
//! pure function of run time, a seed and a sample, so that a lockstep run with faults is repeated
//! bit by bit, even by a process that was restarted half-way.

use formation::random::draw;
use serde::{Deserialize, Serialize};

use crate::number::is_zero;

/// From `from_ns` of run time on, until before `until_ns`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Span {
    /// The first instant, ns.
    pub from_ns: u64,
    /// The first instant after it, ns; at most [`Span::END_NS`].
    pub until_ns: u64,
}

impl Span {
    /// Later than any run's end; TOML has no larger integers.
    pub const END_NS: u64 = i64::MAX as u64;

    /// Whether `t_ns` falls into it.
    pub fn holds(self, t_ns: u64) -> bool {
        (self.from_ns..self.until_ns).contains(&t_ns)
    }

    /// Its first bound after `t_ns`, if there is one.
    pub fn next_bound_ns(self, t_ns: u64) -> Option<u64> {
        [self.from_ns, self.until_ns].into_iter().find(|&bound_ns| bound_ns > t_ns)
    }
}

/// What is wrong with the link from one neighbour. It acts in the robot that hears.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkFault {
    /// When: by the stamps of the beacons.
    pub span: Span,
    /// What.
    pub kind: LinkFaultKind,
    /// Seed of its draws.
    pub seed: u64,
}

/// What may be wrong with a link.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum LinkFaultKind {
    /// Nothing gets through.
    Cut,
    /// Some beacons do not get through.
    Loss {
        /// Share of the beacons that are lost.
        probability: f64,
        /// So many beacons in a row are lost together.
        burst: u64,
    },
    /// Beacons get through late.
    Delay {
        /// At least this late, counted from their stamp, ns.
        delay_ns: u64,
        /// And up to this much later, each by a draw of its own, ns.
        jitter_ns: u64,
    },
}

/// What a fault makes of one beacon.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Passage {
    /// It never arrives.
    Lost,
    /// It may not be heard before this run time, ns.
    At(u64),
}

impl LinkFault {
    /// What becomes of the beacon of `tick`, stamped `t_ns` of run time.
    pub fn passage(&self, tick: u64, t_ns: u64) -> Passage {
        if !self.span.holds(t_ns) {
            return Passage::At(t_ns);
        }
        match self.kind {
            LinkFaultKind::Cut => Passage::Lost,
            LinkFaultKind::Loss { probability, burst } => {
                match draw(self.seed, tick / burst.max(1)) < probability {
                    true => Passage::Lost,
                    false => Passage::At(t_ns),
                }
            }
            LinkFaultKind::Delay { delay_ns, jitter_ns } => {
                let later_ns = (draw(self.seed, tick) * jitter_ns as f64) as u64;
                Passage::At(t_ns.saturating_add(delay_ns).saturating_add(later_ns))
            }
        }
    }
}

/// A robot that needs longer to answer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlowFault {
    /// When, by the stamps of the odometry it answers.
    pub span: Span,
    /// By how much, ns. In lockstep a robot that needs a period or more has no answer at all.
    pub delay_ns: u64,
}

/// Which of a robot's sensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sensor {
    /// Its own pose.
    Odometry,
    /// The front points of those near.
    Proximity,
}

/// What is wrong with a sensor. It acts in the plant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorFault {
    /// When.
    pub span: Span,
    /// Which.
    pub sensor: Sensor,
    /// What.
    pub kind: SensorFaultKind,
    /// Seed of its draws.
    pub seed: u64,
}

/// What may be wrong with a sensor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum SensorFaultKind {
    /// It says nothing.
    Blackout,
    /// Positions are off, and the heading of odometry, by a draw for each sample.
    Noise {
        /// Positions by no more than this, m.
        bound_m: f64,
        /// The heading by no more than this, rad.
        #[serde(default, skip_serializing_if = "is_zero")]
        heading_bound_rad: f64,
    },
}

impl SensorFault {
    /// By how much the position number `item` of the sample of `tick` is off, m: a point of the
    /// disc of radius `bound_m`, each as likely as any other.
    pub fn offset_m(&self, tick: u64, item: u64) -> [f64; 2] {
        let SensorFaultKind::Noise { bound_m, .. } = self.kind else { return [0.0, 0.0] };
        // A sample has far fewer than 2^10 positions, and each takes two draws.
        let counter = (tick << 10 | item) << 1;
        let radius_m = bound_m * draw(self.seed, counter).sqrt();
        let (sin, cos) = (std::f64::consts::TAU * draw(self.seed, counter | 1)).sin_cos();
        [radius_m * cos, radius_m * sin]
    }

    /// By how much the heading of the sample of `tick` is off, rad: each within the bound as likely
    /// as any other.
    pub fn heading_offset_rad(&self, tick: u64) -> f64 {
        let SensorFaultKind::Noise { heading_bound_rad, .. } = self.kind else { return 0.0 };
        // Of an odometry's draws only number 0 is taken, by its position.
        let counter = (tick << 10 | 1) << 1;
        heading_bound_rad * (2.0 * draw(self.seed, counter) - 1.0)
    }
}

/// What is wrong with a robot's wheels. It acts in the plant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WheelFault {
    /// When.
    pub span: Span,
    /// What.
    pub kind: WheelFaultKind,
}

/// What may be wrong with wheels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum WheelFaultKind {
    /// They do not turn.
    Stuck,
    /// No wheel's rim goes faster than this, m/s; (v, w) is scaled down together.
    Limit {
        /// m/s.
        speed_max_m_s: f64,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(kind: LinkFaultKind) -> LinkFault {
        LinkFault { span: Span { from_ns: 100, until_ns: 1_000_000 }, kind, seed: 7 }
    }

    #[test]
    fn a_fault_acts_in_its_span_and_nowhere_else() {
        let cut = link(LinkFaultKind::Cut);
        let passages = [99, 100, 999_999, 1_000_000].map(|t_ns| cut.passage(0, t_ns));
        let [before, first, last, after] = passages;
        assert_eq!((before, after), (Passage::At(99), Passage::At(1_000_000)));
        assert_eq!((first, last), (Passage::Lost, Passage::Lost));
        assert_eq!(cut.span.next_bound_ns(5), Some(100));
        assert_eq!(cut.span.next_bound_ns(100), Some(1_000_000));
        assert_eq!(cut.span.next_bound_ns(1_000_000), None);
    }

    #[test]
    fn the_asked_for_share_is_lost_in_bursts_of_the_asked_for_length() {
        for burst in [1, 5] {
            let lossy = link(LinkFaultKind::Loss { probability: 0.3, burst });
            let lost: Vec<bool> =
                (0..50_000).map(|tick| lossy.passage(tick, 200) == Passage::Lost).collect();
            let share = lost.iter().filter(|&&lost| lost).count() as f64 / 5e4;
            assert!((share - 0.3).abs() < 0.02, "{share}");
            let whole = lost.chunks(burst as usize);
            assert!(whole.clone().all(|chunk| chunk.iter().all(|&lost| lost == chunk[0])));
        }
    }

    #[test]
    fn a_delay_lies_between_its_bounds() {
        let late = link(LinkFaultKind::Delay { delay_ns: 50, jitter_ns: 10 });
        let found: Vec<Passage> = (0..1000).map(|tick| late.passage(tick, 200)).collect();
        assert!(found.iter().all(|p| matches!(p, Passage::At(t_ns) if (250..260).contains(t_ns))));
        assert!(found.iter().any(|passage| *passage != found[0]));
    }

    #[test]
    fn noise_fills_its_disc_and_never_leaves_it() {
        let noisy = SensorFault {
            span: Span { from_ns: 0, until_ns: Span::END_NS },
            sensor: Sensor::Proximity,
            kind: SensorFaultKind::Noise { bound_m: 0.02, heading_bound_rad: 0.3 },
            seed: 3,
        };
        let offsets: Vec<f64> =
            (0..10_000).map(|n| noisy.offset_m(n / 8, n % 8)).map(|[x, y]| x.hypot(y)).collect();
        assert!(offsets.iter().all(|&off| off <= 0.02));
        // Half of the disc's area lies within 0.71 of its radius.
        let inner = offsets.iter().filter(|&&off| off < 0.02 * 0.5f64.sqrt()).count();
        assert!((4700..5300).contains(&inner), "{inner}");

        let turned: Vec<f64> = (0..10_000).map(|tick| noisy.heading_offset_rad(tick)).collect();
        assert!(turned.iter().all(|turned_rad| turned_rad.abs() <= 0.3));
        for part in 0..6 {
            let from = -0.3 + 0.1 * f64::from(part);
            let within = turned.iter().filter(|&&rad| rad >= from && rad < from + 0.1).count();
            assert!((1500..1850).contains(&within), "{within} from {from}");
        }
    }
}
