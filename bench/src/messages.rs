//! Cost of messages in lockstep: the processor time per tick of a ring whose law sends and reads a message of 256 bytes
//! with each beacon, compared with the same ring without messages.
//!
//! Both runs have the same trajectory. They alternate, and the order changes from round to round. As in `growth`, the
//! processor time of a run with a few ticks is subtracted from each.

use std::borrow::Cow;

use agent::laws::{
    Gains, Law, LawOutput, LawRow, MessageArray, MessageFormat, SendDecision, Situation, find_row,
};
use agent::roles::FORMATION_ROLE;
use anyhow::ensure;
use formation::Vec2;
use protocol::brief::Pace;

use crate::growth;
use crate::lockstep::{PERIOD_S, START_TICKS};
use crate::ring::{self, RING_LAW};
use crate::rounds::{BenchCase, BenchSettings};
use crate::run::RunProcess;

/// Length of a message, in numbers of 8 bytes.
const MESSAGE_NUMBERS: usize = 32;
/// Key of the array in a message.
const STATE_KEY: &str = "state";
/// Name of the baseline.
const NO_MESSAGES_BASELINE: &str = "no messages";

/// Arrays of a message.
static MESSAGE_ARRAYS: [MessageArray; 1] =
    [MessageArray { name: Cow::Borrowed(STATE_KEY), shape: Cow::Borrowed(&[MESSAGE_NUMBERS]) }];
/// Format of the messages.
static MESSAGE_FORMAT: MessageFormat =
    MessageFormat { bytes_max: 8 * MESSAGE_NUMBERS, arrays: Cow::Borrowed(&MESSAGE_ARRAYS) };

/// Control law of a ring whose robots move as with `RING_LAW` and exchange messages of 256 bytes.
pub const MESSAGE_LAW: LawRow = LawRow {
    name: "formation-unit-messages",
    role: FORMATION_ROLE,
    source: "(18)",
    gain_keys: &["speed_m_s"],
    feed_forward: false,
    correction_max: Some("speed_m_s"),
    message_format: Some(&MESSAGE_FORMAT),
    may_withhold_beacon: false,
    signals: &[],
    build: |gains: &Gains<'_>| {
        let motion = (find_row(RING_LAW).expect("a built-in law").build)(gains);
        Box::new(AveragingLaw { motion, state: [0.0; MESSAGE_NUMBERS] })
    },
};

/// A law that averages its state with the states of its in-neighbors (consensus). The state does not change the motion.
struct AveragingLaw {
    motion: Box<dyn Law>,
    state: [f64; MESSAGE_NUMBERS],
}

impl Law for AveragingLaw {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        self.motion.gamma(situation)
    }

    fn output(&mut self, situation: &Situation<'_>) -> LawOutput {
        let messages =
            situation.neighbor_estimates.iter().filter_map(|neighbor| neighbor.message.as_ref());
        let received: Vec<Vec<f64>> =
            messages.filter_map(|message| message.numbers(STATE_KEY)).collect();
        // Before the first message, the state is the own position.
        if received.is_empty() {
            self.state.fill(situation.pose.x_m);
        }
        let count = (received.len() + 1) as f64;
        for (i, value) in self.state.iter_mut().enumerate() {
            *value = (*value + received.iter().map(|state| state[i]).sum::<f64>()) / count;
        }
        self.motion.output(situation)
    }

    fn send_decision(&mut self) -> SendDecision {
        let message = MESSAGE_FORMAT.encode(&[(STATE_KEY, &self.state)]);
        SendDecision::Message(message.expect("finite numbers in the declared shape"))
    }
}

/// Measured values of a run.
struct MeasuredCost {
    /// Processor time per robot and tick without start-up, us.
    tick_us: f64,
    /// Processor time of the run with its start-up, s.
    total_s: f64,
    trajectory_hash: String,
    has_messages: bool,
}

/// Returns a case for each number of robots.
pub(crate) fn cases<'a>(settings: &'a BenchSettings<'_>, robots: &[usize]) -> Vec<BenchCase<'a>> {
    let case = |&robots: &usize| {
        let ticks = growth::tick_count(robots, settings);
        let mut measures_baseline_first = false;
        BenchCase::new(format!("{robots} robots"), move |table| {
            measures_baseline_first = !measures_baseline_first;
            let measure = |law| measure_run(settings, robots, ticks, law);
            let (with_messages, without_messages);
            if measures_baseline_first {
                without_messages = measure(RING_LAW)?;
                with_messages = measure(MESSAGE_LAW.name)?;
            } else {
                with_messages = measure(MESSAGE_LAW.name)?;
                without_messages = measure(RING_LAW)?;
            }
            ensure!(with_messages.has_messages, "the run with messages has no message hash");
            for (quantity, run, baseline) in [
                (
                    "processor time per robot and tick, us",
                    with_messages.tick_us,
                    without_messages.tick_us,
                ),
                ("processor time of the run, s", with_messages.total_s, without_messages.total_s),
            ] {
                table.record_run(quantity, run);
                table.record_baseline(quantity, NO_MESSAGES_BASELINE, baseline);
            }
            table.record_trajectory(
                robots,
                ticks,
                "256 bytes per beacon",
                &with_messages.trajectory_hash,
            );
            let hash = &without_messages.trajectory_hash;
            table.record_trajectory(robots, ticks, NO_MESSAGES_BASELINE, hash);
            Ok(())
        })
    };
    robots.iter().map(case).collect()
}

/// Runs the ring with this law twice, with a few ticks and with all of them.
fn measure_run(
    settings: &BenchSettings<'_>,
    robots: usize,
    ticks: u64,
    law: &str,
) -> anyhow::Result<MeasuredCost> {
    let run_ring = |ticks| {
        let text = ring::ring_scenario_text_with_law(robots, ticks, PERIOD_S, law);
        RunProcess::start(settings, &text, Pace::Lockstep, &[])?.wait_for_summary()
    };
    let (short_run, full_run) = (run_ring(START_TICKS)?, run_ring(ticks)?);
    let tick_us: f64 = growth::processor_time_per_tick_us(&short_run, &full_run)?.iter().sum();
    Ok(MeasuredCost {
        tick_us: tick_us / robots as f64,
        total_s: full_run.cpu_time_s()?.iter().sum(),
        trajectory_hash: full_run.0["trajectory_hash"].as_str().unwrap_or("none").to_owned(),
        has_messages: full_run.0["message_hash"].is_string(),
    })
}
