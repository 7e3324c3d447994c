//! Planned faults, as they are passed to the processes in which they act.
//!
//! Kills and freezes are not included: the supervisor applies them to processes. All faults are pure functions of
//! run time, a seed and a sample, so a lockstep run with faults is reproduced bit by bit, even by a process that
//! was restarted during the run.

use formation::portable_math;
use formation::random::draw_unit_by_number;
use serde::{Deserialize, Serialize};

use crate::law_message::{Broadcast, MessageFormat};
use crate::number::is_zero;

/// Half-open interval of run time, from `from_ns` to before `until_ns`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Span {
    /// First instant, ns.
    pub from_ns: u64,
    /// First instant after the interval, ns; at most [`Span::UNBOUNDED_END_NS`].
    pub until_ns: u64,
}

impl Span {
    /// End of an interval without an end, ns: later than the end of any run. TOML has no larger integers.
    pub const UNBOUNDED_END_NS: u64 = i64::MAX as u64;

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

/// Properties of a message on which the faults of its link depend.
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
pub enum TransmissionResult {
    /// The message is lost.
    Lost,
    /// The message may not be received before this run time, ns.
    NotBefore(u64),
}

impl LinkFault {
    /// Returns the effect of the fault on a message.
    pub fn transmission(
        &self,
        Transmission { tick, t_ns, distance_m }: Transmission,
    ) -> TransmissionResult {
        if !self.span.contains(t_ns) {
            return TransmissionResult::NotBefore(t_ns);
        }
        let result_if = |is_lost: bool| {
            if is_lost { TransmissionResult::Lost } else { TransmissionResult::NotBefore(t_ns) }
        };
        match self.kind {
            LinkFaultKind::Cut => TransmissionResult::Lost,
            LinkFaultKind::Loss { probability, burst } => {
                result_if(draw_unit_by_number(self.seed, tick / burst.max(1)) < probability)
            }
            LinkFaultKind::Bursts { probability, mean_burst_ns } => result_if(
                self.is_in_bad_state(t_ns - self.span.from_ns, probability, mean_burst_ns),
            ),
            LinkFaultKind::Fading { range_m, exponent } => {
                let arrival_probability = distance_m.map_or(1.0, |r_m| {
                    portable_math::exp(-portable_math::pow(r_m / range_m, exponent))
                });
                result_if(draw_unit_by_number(self.seed, tick) >= arrival_probability)
            }
            LinkFaultKind::Delay { delay_ns, jitter_ns } => {
                let jitter_draw_ns =
                    (draw_unit_by_number(self.seed, tick) * jitter_ns as f64) as u64;
                TransmissionResult::NotBefore(
                    t_ns.saturating_add(delay_ns).saturating_add(jitter_draw_ns),
                )
            }
        }
    }
}

impl LinkFault {
    /// Returns whether a link that is bad for `bad_fraction` of the time is bad `since_ns` after the fault
    /// began.
    ///
    /// Good and bad times alternate from the start of each block of [`BLOCK_LENGTH_CYCLES`] mean cycles; the state at
    /// the start of a block is drawn with probability `bad_fraction`. The result is thus a function of time,
    /// independent of the caller, and takes bounded time.
    fn is_in_bad_state(&self, since_ns: u64, bad_fraction: f64, mean_bad_ns: u64) -> bool {
        let mean_bad = mean_bad_ns as f64;
        let mean_good = mean_bad / bad_fraction - mean_bad;
        let block_ns = BLOCK_LENGTH_CYCLES * mean_bad / bad_fraction;
        let block = (since_ns as f64 / block_ns).floor();
        let mut remaining_ns = since_ns as f64 - block * block_ns;
        // No block has as many changes as this.
        let first = (block as u64) << 20;
        let mut is_bad = draw_unit_by_number(self.seed, first) < bad_fraction;
        for index in first + 1.. {
            let mean_ns = if is_bad { mean_bad } else { mean_good };
            remaining_ns +=
                mean_ns * portable_math::ln(1.0 - draw_unit_by_number(self.seed, index));
            if remaining_ns < 0.0 {
                break;
            }
            is_bad = !is_bad;
        }
        is_bad
    }
}

/// Length of a block that is drawn at once, in mean cycles of good and bad.
const BLOCK_LENGTH_CYCLES: f64 = 16.0;

/// Data stream between a robot and its body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RobotStream {
    /// Sensor samples, from the plant to the robot.
    Odometry,
    /// Commands, from the robot to the plant.
    Commands,
}

impl RobotStream {
    /// Returns the keyword in files and on the command line.
    pub fn keyword(self) -> &'static str {
        match self {
            RobotStream::Odometry => "odometry",
            RobotStream::Commands => "commands",
        }
    }
}

/// False data in the beacons and messages of a Byzantine robot, which moves as usual. It acts where they arrive.
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

/// Errors of a false beacon and of the message with it; they add up.
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
    /// Errors of the law's message that travels with the beacon.
    #[serde(skip_serializing_if = "MessageLie::is_none")]
    pub message: MessageLie,
}

/// Errors of the message of a control law: each number x becomes `scale` x + `offset` + e, with e drawn for it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MessageLie {
    /// Factor on each number.
    pub scale: f64,
    /// Constant error of each number, in its unit.
    pub offset: f64,
    /// Bound of the random error, drawn uniformly for each number of each message, in its unit.
    pub noise: f64,
    /// Probability with which each bit of the encoded message is inverted.
    pub bit_flips: f64,
}

impl Default for MessageLie {
    fn default() -> MessageLie {
        MessageLie { scale: 1.0, offset: 0.0, noise: 0.0, bit_flips: 0.0 }
    }
}

/// Number of random draws that the numbers of one message may use: a message has at most 2^13 numbers. Bits use the
/// draws after them, at most 2^19.
const MESSAGE_DRAWS: u64 = 1 << 20;
/// Mask of the bits of a tick that count, more than any run has. A foreign process may send any tick.
const TICKS_MASK: u64 = (1 << 40) - 1;

impl MessageLie {
    /// Returns whether the message is sent as it is.
    pub fn is_none(&self) -> bool {
        *self == MessageLie::default()
    }

    /// Returns whether it changes numbers, which messages without a structure do not have.
    pub fn changes_numbers(&self) -> bool {
        MessageLie { bit_flips: 0.0, ..*self } != MessageLie::default()
    }

    /// Falsifies the encoded message of `tick`.
    fn falsify_message(&self, bytes: &mut [u8], format: &MessageFormat, seed: u64, tick: u64) {
        // Other draws of the fault use the seed itself.
        let (seed, first) = (!seed, (tick & TICKS_MASK) * MESSAGE_DRAWS);
        if self.changes_numbers() && !format.is_bytes() {
            let (numbers, _) = bytes.as_chunks_mut();
            for (counter, number) in (first..).zip(numbers) {
                let error = self.noise * (2.0 * draw_unit_by_number(seed, counter) - 1.0);
                *number =
                    (self.scale * f64::from_le_bytes(*number) + self.offset + error).to_le_bytes();
            }
        }
        if self.bit_flips > 0.0 {
            for (counter, byte) in (first + MESSAGE_DRAWS / 2..).step_by(8).zip(bytes) {
                let is_flipped =
                    |bit: &u64| draw_unit_by_number(seed, counter + bit) < self.bit_flips;
                *byte ^= (0..8).filter(is_flipped).map(|bit| 1u8 << bit).sum::<u8>();
            }
        }
    }
}

impl LieFault {
    /// Falsifies a beacon sent at run time `t_ns`, and the message with it, if the fault is active then. `format`:
    /// format of the messages of the sender's law; `None` if it sends none.
    pub fn falsify_broadcast(
        &self,
        broadcast: &mut Broadcast,
        format: Option<&MessageFormat>,
        t_ns: u64,
    ) {
        if !self.span.contains(t_ns) {
            return;
        }
        let Broadcast { beacon, message } = broadcast;
        let Lie { by_m, drift_m_s, random_m, turn_rad, message: message_lie } = self.lie;
        if let (Some(bytes), Some(format), false) = (&mut *message, format, message_lie.is_none()) {
            let mut falsified = bytes.to_vec();
            message_lie.falsify_message(&mut falsified, format, self.seed, beacon.tick);
            *bytes = falsified.into();
        }
        let since_s = (t_ns - self.span.from_ns) as f64 / 1e9;
        let random_error_m = draw_point_in_disc(self.seed, beacon.tick << 1, random_m);
        let error_m = |axis: usize| by_m[axis] + drift_m_s[axis] * since_s + random_error_m[axis];
        beacon.x_m += error_m(0);
        beacon.y_m += error_m(1);
        beacon.vx_m_s += drift_m_s[0];
        beacon.vy_m_s += drift_m_s[1];
        beacon.frame_heading_rad += turn_rad;
    }
}

/// Returns a point drawn uniformly from the disc of this radius, by the random draws `counter` and the next one.
fn draw_point_in_disc(seed: u64, counter: u64, radius_m: f64) -> [f64; 2] {
    let radius_m = radius_m * draw_unit_by_number(seed, counter).sqrt();
    let (sin, cos) =
        portable_math::sin_cos(std::f64::consts::TAU * draw_unit_by_number(seed, counter | 1));
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
    pub fn position_error_m(&self, tick: u64, item: u64) -> [f64; 2] {
        let SensorFaultKind::Noise { bound_m, .. } = self.kind else { return [0.0, 0.0] };
        // A sample has far fewer than 2^10 positions, and each uses two draws.
        draw_point_in_disc(self.seed, (tick << 10 | item) << 1, bound_m)
    }

    /// Returns the heading error of the sample of `tick`, rad, drawn uniformly within its bound.
    pub fn heading_error_rad(&self, tick: u64) -> f64 {
        let SensorFaultKind::Noise { heading_bound_rad, .. } = self.kind else { return 0.0 };
        // Of the draws of an odometry sample, its position uses only number 0.
        let counter = (tick << 10 | 1) << 1;
        heading_bound_rad * (2.0 * draw_unit_by_number(self.seed, counter) - 1.0)
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
    use crate::law_message::MessageArray;
    use crate::message::Beacon;

    const NS_PER_MS: u64 = 1_000_000;

    fn link_fault(kind: LinkFaultKind) -> LinkFault {
        LinkFault { span: Span { from_ns: 100, until_ns: Span::UNBOUNDED_END_NS }, kind, seed: 7 }
    }

    /// Returns the ticks whose messages are lost, for one message per tick of 1 ms.
    fn lost_ticks(fault: &LinkFault, distance_m: Option<f64>, ticks: u64) -> Vec<bool> {
        let sent = |tick| Transmission { tick, t_ns: 100 + tick * NS_PER_MS, distance_m };
        (0..ticks).map(|tick| fault.transmission(sent(tick)) == TransmissionResult::Lost).collect()
    }

    fn lost_fraction(lost: &[bool]) -> f64 {
        lost.iter().filter(|&&lost| lost).count() as f64 / lost.len() as f64
    }

    #[test]
    fn fault_acts_only_in_its_span() {
        let span = Span { from_ns: 100, until_ns: 1000 };
        let cut = LinkFault { span, kind: LinkFaultKind::Cut, seed: 7 };
        let results = [99, 100, 999, 1000]
            .map(|t_ns| cut.transmission(Transmission { tick: 0, t_ns, distance_m: None }));
        assert_eq!(
            results,
            [
                TransmissionResult::NotBefore(99),
                TransmissionResult::Lost,
                TransmissionResult::Lost,
                TransmissionResult::NotBefore(1000)
            ]
        );
        let bounds = [5, 100, 1000].map(|t_ns| span.next_bound_ns(t_ns));
        assert_eq!(bounds, [Some(100), Some(1000), None]);
    }

    #[test]
    fn loss_has_its_probability_and_burst_length() {
        for burst in [1, 5] {
            let lost = lost_ticks(
                &link_fault(LinkFaultKind::Loss { probability: 0.3, burst }),
                None,
                50_000,
            );
            assert!((lost_fraction(&lost) - 0.3).abs() < 0.02, "{}", lost_fraction(&lost));
            let bursts = lost.chunks(burst as usize);
            assert!(bursts.clone().all(|chunk| chunk.iter().all(|&lost| lost == chunk[0])));
        }
    }

    #[test]
    fn bursts_have_their_share_and_mean_and_are_deterministic() {
        for (probability, mean_burst_ns) in
            [(0.2, 100 * NS_PER_MS), (0.5, 30 * NS_PER_MS), (0.9, 400 * NS_PER_MS)]
        {
            let bursty = link_fault(LinkFaultKind::Bursts { probability, mean_burst_ns });
            let found = lost_ticks(&bursty, None, 1_000_000);
            let fraction = lost_fraction(&found);
            assert!((fraction / probability - 1.0).abs() < 0.1, "{fraction} of {probability}");
            let bursts = found.chunk_by(|a, b| a == b).filter(|chunk| chunk[0]).count() as f64;
            let mean_ms = fraction * 1e6 / bursts;
            // Gaps and bursts of less than a millisecond do not show.
            let expected_ms = mean_burst_ns as f64 / 1e6;
            assert!((mean_ms / expected_ms - 1.0).abs() < 0.15, "{mean_ms} of {expected_ms} ms");
            let transmission_at = |tick: u64| Transmission {
                tick: 0,
                t_ns: 100 + tick * NS_PER_MS,
                distance_m: None,
            };
            let is_lost =
                |tick| bursty.transmission(transmission_at(tick)) == TransmissionResult::Lost;
            assert!([77_003, 5, 940_000].iter().all(|&tick| is_lost(tick) == found[tick as usize]));
        }
    }

    #[test]
    fn fading_grows_with_distance_and_needs_a_known_one() {
        let fading = link_fault(LinkFaultKind::Fading { range_m: 2.0, exponent: 2.0 });
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
        let delayed = link_fault(LinkFaultKind::Delay { delay_ns: 50, jitter_ns: 10 });
        let sent = |tick| Transmission { tick, t_ns: 200, distance_m: None };
        let found: Vec<TransmissionResult> =
            (0..1000).map(|tick| delayed.transmission(sent(tick))).collect();
        assert!(found.iter().all(
            |p| matches!(p, TransmissionResult::NotBefore(t_ns) if (250..260).contains(t_ns))
        ));
        assert!(found.iter().any(|passage| *passage != found[0]));
    }

    #[test]
    fn lie_changes_only_motion_and_frame_in_its_span() {
        let span = Span { from_ns: 1000 * NS_PER_MS, until_ns: 3000 * NS_PER_MS };
        let lie =
            Lie { by_m: [0.5, -0.25], drift_m_s: [0.0, 0.125], turn_rad: 0.5, ..Lie::default() };
        let sent_beacon =
            Beacon { tick: 3, x_m: 1.0, vx_m_s: 0.25, frame_scale: 2.0, ..Beacon::default() };
        let received = |lie, t_ns| {
            let mut broadcast = Broadcast::from(sent_beacon);
            LieFault { span, lie, seed: 7 }.falsify_broadcast(&mut broadcast, None, t_ns);
            broadcast.beacon
        };
        assert_eq!(
            [999 * NS_PER_MS, 3000 * NS_PER_MS].map(|t_ns| received(lie, t_ns)),
            [sent_beacon; 2]
        );
        let expected = Beacon { x_m: 1.5, vy_m_s: 0.125, frame_heading_rad: 0.5, ..sent_beacon };
        assert_eq!(received(lie, 2000 * NS_PER_MS), Beacon { y_m: -0.125, ..expected });
        let random = Lie { random_m: 0.5, ..Lie::default() };
        let drawn = received(random, 2000 * NS_PER_MS);
        assert_eq!(drawn, received(random, 2500 * NS_PER_MS), "by the tick alone");
        let error_m = (drawn.position() - sent_beacon.position()).norm();
        assert!(error_m > 0.0 && error_m <= 0.5, "{error_m}");
        assert_eq!(Beacon { x_m: sent_beacon.x_m, y_m: sent_beacon.y_m, ..drawn }, sent_beacon);
    }

    /// Returns the message 1, -2, 0.5 at `tick`, falsified.
    fn falsified_message(message: MessageLie, tick: u64) -> Vec<f64> {
        let array = MessageArray { name: "x_m".into(), shape: vec![3].into() };
        let format = MessageFormat::with_arrays(vec![array]);
        let bytes = format.encode(&[("x_m", &[1.0, -2.0, 0.5])]).unwrap();
        let span = Span { from_ns: 100, until_ns: Span::UNBOUNDED_END_NS };
        let lie = LieFault { span, lie: Lie { message, ..Lie::default() }, seed: 7 };
        let sent = Broadcast { beacon: Beacon { tick, ..Beacon::default() }, message: Some(bytes) };
        let (mut early, mut delayed) = (sent.clone(), sent.clone());
        lie.falsify_broadcast(&mut early, Some(&format), 99);
        lie.falsify_broadcast(&mut delayed, Some(&format), 100);
        assert_eq!(early, sent, "before the fault");
        assert_eq!(delayed.beacon, sent.beacon);
        let (_, numbers) = format.decode_arrays(delayed.message.as_ref().unwrap()).next().unwrap();
        numbers
    }

    #[test]
    fn lie_in_messages_scales_offsets_and_draws_each_number() {
        let none = MessageLie::default();
        assert_eq!(falsified_message(none, 3), [1.0, -2.0, 0.5]);
        let linear = MessageLie { scale: -2.0, offset: 0.25, ..none };
        assert_eq!(falsified_message(linear, 3), [-1.75, 4.25, -0.75]);
        let noisy = MessageLie { noise: 0.5, ..none };
        let errors =
            |tick| [0, 1, 2].map(|i| falsified_message(noisy, tick)[i] - [1.0, -2.0, 0.5][i]);
        assert_eq!(errors(3), errors(3), "by seed and tick alone");
        assert_ne!(errors(3), errors(4));
        let all: Vec<f64> = (0..2000).flat_map(errors).collect();
        assert!(all.iter().all(|error| error.abs() <= 0.5));
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        assert!(mean.abs() < 0.02, "{mean}");
        assert!(all.iter().filter(|error| error.abs() > 0.25).count().abs_diff(3000) < 150);
        assert_ne!(errors(3)[0], errors(3)[1]);
    }

    #[test]
    fn bits_of_messages_flip_with_their_probability() {
        let flipped = |bit_flips, tick| {
            let numbers =
                falsified_message(MessageLie { bit_flips, ..MessageLie::default() }, tick);
            let pairs = numbers.iter().zip([1.0f64, -2.0, 0.5]);
            pairs.map(|(a, b)| (a.to_bits() ^ b.to_bits()).count_ones()).sum::<u32>()
        };
        assert_eq!(flipped(1.0, 3), 192);
        let fraction = (0..1000).map(|tick| flipped(0.1, tick)).sum::<u32>() as f64 / 192e3;
        assert!((fraction - 0.1).abs() < 0.005, "{fraction}");
    }

    #[test]
    fn noise_fills_its_disc_and_stays_within_it() {
        let noisy = SensorFault {
            span: Span { from_ns: 0, until_ns: Span::UNBOUNDED_END_NS },
            sensor: Sensor::Proximity,
            kind: SensorFaultKind::Noise { bound_m: 0.02, heading_bound_rad: 0.3 },
            seed: 3,
        };
        let offsets: Vec<f64> = (0..10_000)
            .map(|n| noisy.position_error_m(n / 8, n % 8))
            .map(|[x, y]| x.hypot(y))
            .collect();
        assert!(offsets.iter().all(|&error_m| error_m <= 0.02));
        // Half of the disc's area lies within 0.71 of its radius.
        let inner = offsets.iter().filter(|&&error_m| error_m < 0.02 * 0.5f64.sqrt()).count();
        assert!((4700..5300).contains(&inner), "{inner}");
        let errors_rad: Vec<f64> = (0..10_000).map(|tick| noisy.heading_error_rad(tick)).collect();
        assert!(errors_rad.iter().all(|error_rad| error_rad.abs() <= 0.3));
        for part in 0..6 {
            let from = -0.3 + 0.1 * f64::from(part);
            let count = errors_rad.iter().filter(|&&rad| rad >= from && rad < from + 0.1).count();
            assert!((1500..1850).contains(&count), "{count} from {from}");
        }
    }
}
