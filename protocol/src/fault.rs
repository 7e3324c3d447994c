//! Planned faults, as they are passed to the processes in which they act.
//!
//! Kills and freezes are not included: the supervisor applies them to processes. All faults are pure functions of
//! run time, a seed and a sample, so a lockstep run with faults is reproduced bit by bit, even by a process that
//! was restarted during the run.

use formation::portable_math;
use formation::random::draw;
use serde::{Deserialize, Serialize};

use crate::message::Beacon;
use crate::number::is_zero;

/// Half-open interval of run time, from `from_ns` to before `until_ns`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Span {
    /// First instant, ns.
    pub from_ns: u64,
    /// First instant after the interval, ns; at most [`Span::END_NS`].
    pub until_ns: u64,
}

impl Span {
    /// End of an interval without an end, ns: later than the end of any run. TOML has no larger integers.
    pub const END_NS: u64 = i64::MAX as u64;

    /// Returns whether the interval contains `t_ns`.
    pub fn contains(self, t_ns: u64) -> bool {
        (self.from_ns..self.until_ns).contains(&t_ns)
    }

    /// Returns the first bound of the interval after `t_ns`; `None` if there is none.
    pub fn next_bound_ns(self, t_ns: u64) -> Option<u64> {
        [self.from_ns, self.until_ns].into_iter().find(|&bound_ns| bound_ns > t_ns)
    }
}

/// Fault of a link: of that from one neighbor, or of one of the robot's own streams. It acts where messages
/// arrive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkFault {
    /// Time of the fault, by the stamps of beacons or by the times at which odometry and commands are sent.
    pub span: Span,
    /// Kind of the fault.
    pub kind: LinkFaultKind,
    /// Seed of the random draws of the fault.
    pub seed: u64,
}

/// Kind of a link fault.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
#[expect(missing_docs, reason = "the fields are named in the variants' comments")]
pub enum LinkFaultKind {
    /// All messages are lost.
    Cut,
    /// Messages are lost with this probability, `burst` consecutive ones together.
    Loss { probability: f64, burst: u64 },
    /// Gilbert-Elliott channel: the link is bad for this fraction of the time and then loses all messages. The
    /// durations of good and bad times are exponentially distributed; `mean_burst_ns` is the mean of the bad
    /// ones. (Gilbert 1960; Elliott 1963)
    Bursts { probability: f64, mean_burst_ns: u64 },
    /// Messages arrive with probability exp(-(r / range)^exponent) over the distance r: Rayleigh fading with the
    /// path loss exponent `exponent`, which is 2 in free space.
    Fading { range_m: f64, exponent: f64 },
    /// Messages are delayed by `delay_ns` plus a random draw of up to `jitter_ns` for each message.
    Delay { delay_ns: u64, jitter_ns: u64 },
}

/// A message, as a link sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transmission {
    /// Tick of the message; messages of a link have different ticks.
    pub tick: u64,
    /// Run time of sending, ns.
    pub t_ns: u64,
    /// Distance from the sender to the receiver, m; `None` if it is not known.
    pub distance_m: Option<f64>,
}

/// Effect of a fault on one message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Passage {
    /// The message is lost.
    Lost,
    /// The message may not be received before this run time, ns.
    At(u64),
}

impl LinkFault {
    /// Returns the effect of the fault on a message.
    pub fn transmission(&self, Transmission { tick, t_ns, distance_m }: Transmission) -> Passage {
        if !self.span.contains(t_ns) {
            return Passage::At(t_ns);
        }
        let lost = |lost: bool| if lost { Passage::Lost } else { Passage::At(t_ns) };
        match self.kind {
            LinkFaultKind::Cut => Passage::Lost,
            LinkFaultKind::Loss { probability, burst } => {
                lost(draw(self.seed, tick / burst.max(1)) < probability)
            }
            LinkFaultKind::Bursts { probability, mean_burst_ns } => {
                lost(self.is_bad(t_ns - self.span.from_ns, probability, mean_burst_ns))
            }
            LinkFaultKind::Fading { range_m, exponent } => {
                let through = distance_m.map_or(1.0, |r_m| {
                    portable_math::exp(-portable_math::pow(r_m / range_m, exponent))
                });
                lost(draw(self.seed, tick) >= through)
            }
            LinkFaultKind::Delay { delay_ns, jitter_ns } => {
                let later_ns = (draw(self.seed, tick) * jitter_ns as f64) as u64;
                Passage::At(t_ns.saturating_add(delay_ns).saturating_add(later_ns))
            }
        }
    }
}

impl LinkFault {
    /// Returns whether a link that is bad for the fraction `share` of the time is bad `since_ns` after the fault
    /// began.
    ///
    /// Good and bad times alternate from the beginning of each stretch of [`BLOCK_CYCLES`] mean cycles; the state at
    /// the beginning of a stretch is drawn with probability `share`. The result is thus a function of time,
    /// independent of the caller, and takes bounded time.
    fn is_bad(&self, since_ns: u64, share: f64, mean_bad_ns: u64) -> bool {
        let mean_bad = mean_bad_ns as f64;
        let mean_good = mean_bad / share - mean_bad;
        let stretch_ns = BLOCK_CYCLES * mean_bad / share;
        let stretch = (since_ns as f64 / stretch_ns).floor();
        let mut left_ns = since_ns as f64 - stretch * stretch_ns;
        // No stretch has as many changes as this.
        let first = (stretch as u64) << 20;
        let mut bad = draw(self.seed, first) < share;
        for change in first + 1.. {
            let mean_ns = if bad { mean_bad } else { mean_good };
            left_ns += mean_ns * portable_math::ln(1.0 - draw(self.seed, change));
            if left_ns < 0.0 {
                break;
            }
            bad = !bad;
        }
        bad
    }
}

/// Length of a stretch that is drawn at once, in mean cycles of good and bad.
const BLOCK_CYCLES: f64 = 16.0;

/// Data stream between a robot and its body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stream {
    /// Sensor samples, from the plant to the robot.
    Odometry,
    /// Commands, from the robot to the plant.
    Commands,
}

impl Stream {
    /// Returns the keyword in files and on the command line.
    pub fn keyword(self) -> &'static str {
        match self {
            Stream::Odometry => "odometry",
            Stream::Commands => "commands",
        }
    }
}

/// False data in the beacons of a Byzantine robot, which moves as usual. It acts where the beacons arrive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LieFault {
    /// Time of the fault, by the stamps of beacons.
    pub span: Span,
    /// Errors added to the beacons.
    pub lie: Lie,
    /// Seed of the random draws of the fault.
    pub seed: u64,
}

/// Errors of a false beacon; they add up.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Lie {
    /// Constant position error, m.
    pub by_m: [f64; 2],
    /// Growth of the position error, m/s, which is also added to the published velocity.
    pub drift_m_s: [f64; 2],
    /// Radius of the disc from which a position error is drawn for each beacon, m.
    pub random_m: f64,
    /// Error of the heading of the leader's frame in the beacon, rad.
    pub turn_rad: f64,
}

impl LieFault {
    /// Falsifies a beacon sent at run time `t_ns`, if the fault is active then.
    pub fn falsify_beacon(&self, beacon: &mut Beacon, t_ns: u64) {
        if !self.span.contains(t_ns) {
            return;
        }
        let Lie { by_m, drift_m_s, random_m, turn_rad } = self.lie;
        let since_s = (t_ns - self.span.from_ns) as f64 / 1e9;
        let drawn_m = draw_in_disc(self.seed, beacon.tick << 1, random_m);
        let off_m = |axis: usize| by_m[axis] + drift_m_s[axis] * since_s + drawn_m[axis];
        beacon.x_m += off_m(0);
        beacon.y_m += off_m(1);
        beacon.vx_m_s += drift_m_s[0];
        beacon.vy_m_s += drift_m_s[1];
        beacon.frame_heading_rad += turn_rad;
    }
}

/// Returns a point drawn uniformly from the disc of this radius, by the random draws `counter` and the next one.
fn draw_in_disc(seed: u64, counter: u64, radius_m: f64) -> [f64; 2] {
    let radius_m = radius_m * draw(seed, counter).sqrt();
    let (sin, cos) = portable_math::sin_cos(std::f64::consts::TAU * draw(seed, counter | 1));
    [radius_m * cos, radius_m * sin]
}

/// Slowdown: a robot that needs longer to answer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlowFault {
    /// Time of the fault, by the stamps of the odometry it answers.
    pub span: Span,
    /// Additional computation time, ns. In lockstep a robot with a period or more sends no command at all.
    pub delay_ns: u64,
}

/// Sensor of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sensor {
    /// Pose and twist of the robot itself.
    Odometry,
    /// Front points of robots in range.
    Proximity,
}

/// Fault of a sensor. It acts in the plant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorFault {
    /// Time of the fault.
    pub span: Span,
    /// The faulty sensor.
    pub sensor: Sensor,
    /// Kind of the fault.
    pub kind: SensorFaultKind,
    /// Seed of the random draws of the fault.
    pub seed: u64,
}

/// Kind of a sensor fault.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum SensorFaultKind {
    /// Dropout: the sensor reports nothing.
    Blackout,
    /// Bounded noise on positions and on the heading of odometry, drawn for each sample.
    Noise {
        /// Maximum position error, m.
        bound_m: f64,
        /// Maximum heading error, rad.
        #[serde(default, skip_serializing_if = "is_zero")]
        heading_bound_rad: f64,
    },
}

impl SensorFault {
    /// Returns the position error of entry `item` of the sample of `tick`, m: drawn uniformly from the disc of
    /// radius `bound_m`.
    pub fn offset_m(&self, tick: u64, item: u64) -> [f64; 2] {
        let SensorFaultKind::Noise { bound_m, .. } = self.kind else { return [0.0, 0.0] };
        // A sample has far fewer than 2^10 positions, and each uses two draws.
        draw_in_disc(self.seed, (tick << 10 | item) << 1, bound_m)
    }

    /// Returns the heading error of the sample of `tick`, rad, drawn uniformly within its bound.
    pub fn heading_offset_rad(&self, tick: u64) -> f64 {
        let SensorFaultKind::Noise { heading_bound_rad, .. } = self.kind else { return 0.0 };
        // Of the draws of an odometry sample, its position uses only number 0.
        let counter = (tick << 10 | 1) << 1;
        heading_bound_rad * (2.0 * draw(self.seed, counter) - 1.0)
    }
}

/// Fault of a robot's wheels. It acts in the plant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WheelFault {
    /// Time of the fault.
    pub span: Span,
    /// Kind of the fault.
    pub kind: WheelFaultKind,
}

/// Kind of a wheel fault.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum WheelFaultKind {
    /// The wheels do not turn.
    Stuck,
    /// Wheel speed limit; (v, w) is scaled down together.
    Limit {
        /// Maximum speed of a wheel's rim, m/s.
        speed_max_m_s: f64,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn link(kind: LinkFaultKind) -> LinkFault {
        LinkFault { span: Span { from_ns: 100, until_ns: Span::END_NS }, kind, seed: 7 }
    }

    /// Returns the ticks whose messages are lost, for one message per tick of 1 ms.
    fn lost_ticks(fault: &LinkFault, distance_m: Option<f64>, ticks: u64) -> Vec<bool> {
        let sent = |tick| Transmission { tick, t_ns: 100 + tick * MS, distance_m };
        (0..ticks).map(|tick| fault.transmission(sent(tick)) == Passage::Lost).collect()
    }

    fn lost_fraction(lost: &[bool]) -> f64 {
        lost.iter().filter(|&&lost| lost).count() as f64 / lost.len() as f64
    }

    #[test]
    fn fault_acts_only_in_its_span() {
        let span = Span { from_ns: 100, until_ns: 1000 };
        let cut = LinkFault { span, kind: LinkFaultKind::Cut, seed: 7 };
        let passages = [99, 100, 999, 1000]
            .map(|t_ns| cut.transmission(Transmission { tick: 0, t_ns, distance_m: None }));
        assert_eq!(passages, [Passage::At(99), Passage::Lost, Passage::Lost, Passage::At(1000)]);
        let bounds = [5, 100, 1000].map(|t_ns| span.next_bound_ns(t_ns));
        assert_eq!(bounds, [Some(100), Some(1000), None]);
    }

    #[test]
    fn loss_has_its_probability_and_burst_length() {
        for burst in [1, 5] {
            let lost =
                lost_ticks(&link(LinkFaultKind::Loss { probability: 0.3, burst }), None, 50_000);
            assert!((lost_fraction(&lost) - 0.3).abs() < 0.02, "{}", lost_fraction(&lost));
            let whole = lost.chunks(burst as usize);
            assert!(whole.clone().all(|chunk| chunk.iter().all(|&lost| lost == chunk[0])));
        }
    }

    #[test]
    fn bursts_have_their_share_and_mean_and_are_deterministic() {
        for (probability, mean_burst_ns) in [(0.2, 100 * MS), (0.5, 30 * MS), (0.9, 400 * MS)] {
            let bursty = link(LinkFaultKind::Bursts { probability, mean_burst_ns });
            let found = lost_ticks(&bursty, None, 1_000_000);
            let share = lost_fraction(&found);
            assert!((share / probability - 1.0).abs() < 0.1, "{share} of {probability}");
            let bursts = found.chunk_by(|a, b| a == b).filter(|chunk| chunk[0]).count() as f64;
            let mean_ms = share * 1e6 / bursts;
            // Gaps and bursts of less than a millisecond do not show.
            let expected_ms = mean_burst_ns as f64 / 1e6;
            assert!((mean_ms / expected_ms - 1.0).abs() < 0.15, "{mean_ms} of {expected_ms} ms");
            let asked =
                |tick: u64| Transmission { tick: 0, t_ns: 100 + tick * MS, distance_m: None };
            let again = |tick| bursty.transmission(asked(tick)) == Passage::Lost;
            assert!([77_003, 5, 940_000].iter().all(|&tick| again(tick) == found[tick as usize]));
        }
    }

    #[test]
    fn fading_grows_with_distance_and_needs_a_known_one() {
        let fading = link(LinkFaultKind::Fading { range_m: 2.0, exponent: 2.0 });
        for (distance_m, expected) in [
            (None, 1.0),
            (Some(0.0), 1.0),
            (Some(1.0), 0.778_8),
            (Some(2.0), 0.367_9),
            (Some(4.0), 0.018_3),
        ] {
            let found = 1.0 - lost_fraction(&lost_ticks(&fading, distance_m, 50_000));
            assert!((found - expected).abs() < 0.01, "{found} at {distance_m:?}");
        }
    }

    #[test]
    fn delay_lies_between_its_bounds() {
        let late = link(LinkFaultKind::Delay { delay_ns: 50, jitter_ns: 10 });
        let sent = |tick| Transmission { tick, t_ns: 200, distance_m: None };
        let found: Vec<Passage> = (0..1000).map(|tick| late.transmission(sent(tick))).collect();
        assert!(found.iter().all(|p| matches!(p, Passage::At(t_ns) if (250..260).contains(t_ns))));
        assert!(found.iter().any(|passage| *passage != found[0]));
    }

    #[test]
    fn lie_changes_only_motion_and_frame_in_its_span() {
        let span = Span { from_ns: 1000 * MS, until_ns: 3000 * MS };
        let lie = Lie { by_m: [0.5, -0.25], drift_m_s: [0.0, 0.125], random_m: 0.0, turn_rad: 0.5 };
        let said =
            Beacon { tick: 3, x_m: 1.0, vx_m_s: 0.25, frame_scale: 2.0, ..Beacon::default() };
        let heard = |lie, t_ns| {
            let mut beacon = said;
            LieFault { span, lie, seed: 7 }.falsify_beacon(&mut beacon, t_ns);
            beacon
        };
        assert_eq!([999 * MS, 3000 * MS].map(|t_ns| heard(lie, t_ns)), [said; 2]);
        let expected = Beacon { x_m: 1.5, vy_m_s: 0.125, frame_heading_rad: 0.5, ..said };
        assert_eq!(heard(lie, 2000 * MS), Beacon { y_m: -0.125, ..expected });
        let random = Lie { random_m: 0.5, ..Lie::default() };
        let drawn = heard(random, 2000 * MS);
        assert_eq!(drawn, heard(random, 2500 * MS), "by the tick alone");
        let off_m = (drawn.position() - said.position()).norm();
        assert!(off_m > 0.0 && off_m <= 0.5, "{off_m}");
        assert_eq!(Beacon { x_m: said.x_m, y_m: said.y_m, ..drawn }, said);
    }

    #[test]
    fn noise_fills_its_disc_and_stays_within_it() {
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
