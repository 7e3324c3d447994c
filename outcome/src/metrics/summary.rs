//! Summary of a run, as in `summary.json`: the run writes it, its report reads it.
//!
//! Everything that depends on wall time is in the section `wall`. In lockstep, everything outside of it is a
//! function of the run alone. A file of another version may lack keys or have more keys: a missing value counts as
//! not known.

mod by_name;
mod facts;

use std::ops::{Add, AddAssign, Sub};

use protocol::brief::Pace;
pub use protocol::stage::LatenessCause;
use protocol::stage::Stage;
use serde::{Deserialize, Serialize};

use crate::columns::table;
use crate::metrics::blocked_robots::BlockedRobot;
use crate::metrics::clearance::Clearance;
use crate::metrics::expect::Expectation;
use crate::metrics::fault::FaultReport;
use crate::quantities::quantities;
use crate::report::digits::format_four_digits;

quantities! {
    /// Content of `summary.json`. A value that does not exist is `null`.
    #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
    #[serde(default)]
    pub struct Summary {
        /// Name of the scenario.
        pub scenario: String,
        /// Time mode (lockstep or real time).
        pub pace: Pace,
        /// Exit code.
        pub exit: u8,
        /// Whether a signal ended the run.
        pub interrupted: bool,
        /// Number of manual interventions through the live view.
        pub acts_by_hand: u64,
        /// Run time at the end, s.
        pub t_s: f64,
        /// Whether the run ended before `duration_s`, because it had been converged for `end_after_converged_s`. The
        /// last 10 % then refer to the time reached.
        pub ended_early: bool,
        /// Number of plant ticks.
        pub ticks: u64,
        /// Trajectory hash, in lockstep: equal if and only if two runs are equal bit by bit.
        pub trajectory_hash: Option<String>,
        /// Intermediate hashes, in lockstep: entry k is the hash of the run before k + 1 s.
        pub hash_by_second: Vec<String>,
        /// Smallest distance of two front points at any tick, m.
        pub min_distance_m: Option<f64>,
        /// Names of the two robots at this distance.
        pub min_distance_pair: Option<[String; 2]>,
        /// Run time of this distance, s.
        pub min_distance_t_s: Option<f64>,
        /// Smallest distance of two front points at any tick over the minimum distance of the two robots, in a team of
        /// robots with different sizes; otherwise the key is missing.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub min_distance_over_d: Option<f64>,
        /// Number of ticks at which some pair was nearer than d.
        pub violations: u64,
        /// Smallest distance of a front point from a wall or obstacle: `distance_m`, `robot`, `wall`, `at_m` (the front
        /// point) and `t_s`; `null` without walls and obstacles.
        pub min_clearance: Option<Clearance>,
        /// Number of ticks at which some front point was nearer to a wall or obstacle than the clearance.
        pub clearance_violations: u64,
        /// Largest error over the last 10 % of the run by robot, m.
        #[serde(with = "by_name")]
        pub final_error_m: Vec<(String, Option<f64>)>,
        /// Largest error of a living robot over the last 10 % of the run, m.
        pub final_error_m_max: Option<f64>,
        /// Largest error to the ideal formation over the last 10 % of the run by robot, m.
        #[serde(with = "by_name")]
        pub final_ideal_error_m: Vec<(String, Option<f64>)>,
        /// Largest error of a living robot to the ideal formation over the last 10 % of the run, m.
        pub final_ideal_error_m_max: Option<f64>,
        /// Largest tracking error of the main leader over the last 10 % of the run, m.
        pub tracking_error_m_max: Option<f64>,
        /// Integral of the error by robot over the time it was alive, m s.
        #[serde(with = "by_name")]
        pub integrated_error_m_s: Vec<(String, Option<f64>)>,
        /// Largest distance of a follower from the leaders' convex hull over the last 10 % of the run, m.
        pub hull_distance_m_max_final: Option<f64>,
        /// Time since which the errors of all living robots stayed below `converged_error_m`, s; empty or `null` if
        /// there is none.
        pub converged_at_s: Option<f64>,
        /// `true` if errors and convergence were not evaluated, because all robots were free and set no target;
        /// otherwise the key is missing.
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        pub is_unjudged: bool,
        /// Time since which the error of each robot stayed below `converged_error_m`, s; `null` if it did not arrive.
        #[serde(with = "by_name")]
        pub arrived_at_s: Vec<(String, Option<f64>)>,
        /// Path length of each front point until its arrival, or until the end of the run, m.
        #[serde(with = "by_name")]
        pub path_m: Vec<(String, Option<f64>)>,
        /// Total path length divided by the total length of straight lines, over the robots that arrived at goals;
        /// empty or `null` if there are none, and once a robot was sent to another goal.
        pub path_over_straight: Option<f64>,
        /// Blocked robots: robots that had not arrived at the end while another robot, a wall or an obstacle was in
        /// their slot or in their way. Each has `robot`, `error_m`, `for_robot` (the other robot), `why` (`taken`: it
        /// is in the slot; `blocked`: it is in the way; `wall`: a wall or obstacle, which `for_robot` then names, is in
        /// the way), and `lives`, whether the other robot is alive.
        pub waits: Vec<BlockedRobot>,
        /// Number of commands sent after their agent's next wake-up was due.
        pub deadline_misses: u64,
        /// Counts of commands at the plant, by outcome. `age_ns_max` is the maximum age of a command that moved a
        /// robot, counted from the stamp of the sample that it answers; in real time, `unanswered` is the number of
        /// samples that were too old for an answer.
        pub commands: CommandCounts,
        /// Number of beacons that each robot rejected: not finite, not plausible, old or from the future.
        #[serde(with = "by_name")]
        pub beacons_refused: Vec<(String, u64)>,
        /// Number of beacons that each robot sent, in real time up to its last report; only if a law sends messages or
        /// withholds beacons. Otherwise a robot sends one with each command.
        #[serde(with = "by_name", skip_serializing_if = "Vec::is_empty")]
        pub beacons_sent: Vec<(String, u64)>,
        /// Number of messages that each robot sent with these beacons.
        #[serde(with = "by_name", skip_serializing_if = "Vec::is_empty")]
        pub messages_sent: Vec<(String, u64)>,
        /// Number of messages of in-neighbors that each robot did not process: more than 16 were waiting, more than
        /// `message_queue` arrived between two calls of its law, or it was frozen.
        #[serde(with = "by_name", skip_serializing_if = "Vec::is_empty")]
        pub messages_dropped: Vec<(String, u64)>,
        /// Hash of all messages, in lockstep: two runs with the same one have sent the same messages at the same ticks.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub message_hash: Option<String>,
        /// Metrics of the experiment's own by name, as `[metrics]` defines them; `null` if no robot that was alive at
        /// the end recorded the signal, or if the program of the metric gave no value.
        #[serde(with = "by_name", skip_serializing_if = "Vec::is_empty")]
        pub metrics: Vec<(String, Option<f64>)>,
        /// Names of the robots that were alive at the end of the run.
        pub alive_at_end: Vec<String>,
        /// Number of ground-truth samples that the supervisor did not receive.
        pub truths_lost: u64,
        /// Periods longer than 0.1 s without a sample, start and end in s, in order.
        pub unseen_s: Vec<[f64; 2]>,
        /// Age of beacons when they were used, by stamps and by edge; in lockstep in simulated time.
        pub ages: Vec<StageLatency>,
        /// Information age of each edge: at every instant, now minus the stamp of the newest beacon received, silence
        /// included; in lockstep in simulated time. `robot` hears `from`; number of beacons `heard`, over the time
        /// `over_ns`; `mean_ns`, `peak_ns`.
        pub information_ages: Vec<InformationAge>,
        /// Number of restarts by robot.
        #[serde(with = "by_name")]
        pub restarts: Vec<(String, u64)>,
        /// Effect of each fault; see below.
        pub faults: Vec<FaultReport>,
        /// Expectations with their results: `name`, `value`, `bound`, `held`, `verdict` (`held`, `missed`, `unseen`),
        /// `reason`.
        pub expectations: Vec<Expectation>,
        /// Values that depend on wall time; see below.
        pub wall: WallTimeValues,
    }

    facts |summary| {
        min_distance_m "smallest distance" = facts::format_min_distance(summary),
        min_distance_over_d "smallest over d" = summary.min_distance_over_d.map(format_four_digits),
        min_clearance "smallest clearance" = facts::format_min_clearance(summary),
        converged_at_s "converged" =
            (!summary.is_unjudged).then(|| facts::format_convergence(summary.converged_at_s)),
        final_error_m "final errors, m" = facts::format_all_errors(&summary.final_error_m),
        final_error_m "largest errors, m" = facts::format_largest_errors(&summary.final_error_m),
        final_ideal_error_m "ideal errors, m" = facts::format_all_errors(&summary.final_ideal_error_m),
        final_ideal_error_m "largest ideal, m" = facts::format_largest_errors(&summary.final_ideal_error_m),
        waits "blocked" = facts::format_blocked_robots(&summary.waits),
        tracking_error_m_max "tracking error, m" = summary.tracking_error_m_max.map(format_four_digits),
        hull_distance_m_max_final "outside the hull, m" =
            summary.hull_distance_m_max_final.map(format_four_digits),
        metrics "metrics" = facts::format_metrics(&summary.metrics),
        t_s "time" = Some(facts::format_times(summary)),
        trajectory_hash "trajectory hash" = summary.trajectory_hash.clone(),
        messages_sent "messages" = facts::format_messages(summary),
        messages_dropped "messages dropped" = facts::format_dropped_messages(summary),
        message_hash "message hash" = summary.message_hash.clone(),
        deadline_misses "deadline misses" =
            (summary.pace == Pace::Realtime).then(|| summary.deadline_misses.to_string()),
        commands "commands" = Some(facts::format_commands(&summary.commands)),
        beacons_refused "beacons" = {
            let refused: u64 = summary.beacons_refused.iter().map(|(_, refused)| refused).sum();
            (refused > 0).then(|| format!("{refused} refused"))
        },
        truths_lost "samples lost" = facts::format_lost_samples(summary),
        wall "latencies lost" =
            (summary.wall.latencies_lost > 0).then(|| summary.wall.latencies_lost.to_string()),
        information_ages "information age" = facts::format_oldest_information(summary),
        wall "late wake-ups" = facts::format_late_wake_ups(summary),
        wall "goals from ROS 2" = summary.wall.goals.as_ref().map(facts::format_goals),
    }

    columns |summary, d_m| {
        trajectory_hash = summary.trajectory_hash.clone().unwrap_or_default(),
        t_s = facts::format_field(Some(summary.t_s)),
        ticks = summary.ticks.to_string(),
        distance_min_m "Minimum distance d of the scenario, m." = facts::format_field(Some(d_m)),
        min_distance_m = facts::format_field(summary.min_distance_m),
        min_distance_over_d "`min_distance_m` divided by d; in a team of different sizes the smallest such ratio of a \
                             pair." =
            facts::format_field(summary.distance_over_d(d_m)),
        violations = summary.violations.to_string(),
        min_clearance_m "Smallest distance of a front point from a wall or obstacle, m; empty without walls and \
                         obstacles." =
            facts::format_field(summary.min_clearance.as_ref().map(|clearance| clearance.distance_m)),
        clearance_violations = summary.clearance_violations.to_string(),
        converged "1 if the errors of all living robots stayed below `converged_error_m` from some time on, else 0." =
            u8::from(summary.converged_at_s.is_some()).to_string(),
        converged_at_s = facts::format_field(summary.converged_at_s),
        final_error_m_max = facts::format_field(summary.final_error_m_max),
        final_ideal_error_m_max = facts::format_field(summary.final_ideal_error_m_max),
        tracking_error_m_max = facts::format_field(summary.tracking_error_m_max),
        hull_distance_m_max_final = facts::format_field(summary.hull_distance_m_max_final),
        integrated_error_m_s "Integral of each robot's error over the time in which it was alive, summed over all \
                              robots, m s." =
            facts::format_field(facts::sum_if_complete(&summary.integrated_error_m_s)),
        alive_at_end "Number of robots that were alive at the end." = summary.alive_at_end.len().to_string(),
        restarts "Number of restarts of robots." =
            summary.restarts.iter().map(|(_, count)| count).sum::<u64>().to_string(),
        recovered_after_s_max "Longest time until the formation recovered from a fault, s; empty without faults, or \
                               if it did not recover from one." =
            facts::format_field(facts::slowest_recovery_s(summary)),
        arrived "Number of robots that stayed within `converged_error_m` of their targets from some time on." =
            facts::arrival_times_s(summary).len().to_string(),
        arrived_at_s_mean "Mean of these times, s; the time of the last arrival is `converged_at_s`." =
            facts::format_field(facts::mean(&facts::arrival_times_s(summary))),
        path_over_straight = facts::format_field(summary.path_over_straight),
    }
}

impl Summary {
    /// Returns the smallest distance of two front points over their minimum distance. `d_m` is the minimum distance, m,
    /// if all pairs have the same.
    pub fn distance_over_d(&self, d_m: f64) -> Option<f64> {
        self.min_distance_over_d.or(self.min_distance_m.map(|distance_m| distance_m / d_m))
    }
}

/// Values that depend on wall time. They differ from run to run in both time modes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct WallTimeValues {
    /// Wall time from the start of the first process to t = 0, when all processes were ready, s.
    pub startup_s: Option<f64>,
    /// Wall time from t = 0 to the end, s.
    pub wall_s: f64,
    /// Plant ticks per second of wall time.
    pub ticks_per_s: f64,
    /// Run time divided by wall time.
    pub real_time_factor: f64,
    /// Latency distributions by stage and by robot or edge.
    pub latency: Vec<StageLatency>,
    /// Wake-up latency of all robots together.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wake_of_all: Option<StageLatency>,
    /// Number of latencies and beacon ages that did not reach the supervisor.
    pub latencies_lost: u64,
    /// Resource usage of each process.
    pub processes: Vec<ProcessUsage>,
    /// Summary of each host, if there are several.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub hosts: Vec<HostSummary>,
    /// Counts of external goals by outcome, if robots accept goals from outside.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub goals: Option<GoalSummary>,
}

/// Counts of goals from outside, by outcome.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct GoalSummary {
    /// Number of accepted goals. If goals arrive faster than they are forwarded, only the newest counts.
    pub taken: u64,
    /// Number of rejected goals by reason.
    #[serde(with = "by_name")]
    pub refused: Vec<(String, u64)>,
}

/// One host of a run on several hosts.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct HostSummary {
    /// Name of the host.
    pub name: String,
    /// Robots on this host.
    pub robots: Vec<String>,
    /// Whether the host was reachable at the end.
    pub reachable: bool,
    /// Number of times that the host became unreachable.
    pub lost: u64,
    /// Number of restarts of the bridge.
    pub bridge_restarts: u64,
    /// Last measured round trip to the plant's host, ns; `None` for that host itself.
    pub round_trip_ns: Option<u64>,
    /// Upper bound of the error of the plant's stamps on this host, ns: half a round trip plus drift. Ages over
    /// edges between hosts are upper bounds, too large by at most twice this value.
    pub stamp_error_ns_max: Option<u64>,
    /// Number of frames that the bridge sent to other hosts.
    pub sent: u64,
    /// Number of odometry samples, commands and beacons among these frames.
    pub samples_sent: u64,
    /// Number of frames that the bridge received from other hosts.
    pub taken: u64,
    /// Number of reports of robots to the supervisor that were dropped, because the plant's host was unreachable
    /// for too long.
    pub told_dropped: u64,
    /// Number of samples that the bridge dropped, and of connections that it rejected, by reason.
    #[serde(with = "by_name")]
    pub dropped: Vec<(String, u64)>,
}

impl HostSummary {
    /// Formats the host's counts in one line.
    pub fn describe(&self) -> String {
        let ms = |ns: u64| format!("{:.3} ms", ns as f64 / 1e6);
        let robots = if self.robots.is_empty() { "no robots" } else { &self.robots.join(" ") };
        let mut text = robots.to_owned();
        if let (Some(round_trip_ns), Some(error_ns)) = (self.round_trip_ns, self.stamp_error_ns_max)
        {
            text += &format!("; round trip {}, stamps within {}", ms(round_trip_ns), ms(error_ns));
        }
        text += &format!("; {} sent, {} received", self.sent, self.taken);
        let dropped: Vec<String> =
            self.dropped.iter().map(|(reason, count)| format!("{reason} {count}")).collect();
        if !dropped.is_empty() {
            text += &format!("; dropped: {}", dropped.join(", "));
        }
        for (count, label) in [
            (self.lost, "times unreachable"),
            (self.bridge_restarts, "bridge restarts"),
            (self.told_dropped, "reports dropped"),
        ] {
            if count > 0 {
                text += &format!("; {count} {label}");
            }
        }
        if !self.reachable {
            text += "; UNREACHABLE at the end";
        }
        text
    }
}

/// Counts of commands at the plant, by outcome.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct CommandCounts {
    /// Rejected because the command had expired on arrival or was from the future.
    pub late: u64,
    /// Rejected because a newer command had been accepted.
    pub old: u64,
    /// Rejected because a number was not finite or not plausible.
    pub not_finite: u64,
    /// Scaled down to the speed limit.
    pub scaled: u64,
    /// Expired without a successor: the wheels stopped.
    pub expired: u64,
    /// Maximum age of a command that moved a robot, from the stamp of the sample that it answers, ns; at most the
    /// command timeout.
    pub age_ns_max: u64,
    /// Samples without an answer because they were too old, in real time.
    pub unanswered: u64,
    /// Commands that a newer one replaced before the plant received them, in real time.
    pub lost: u64,
}

table! {
    /// Latency distribution of one stage at one robot or edge: a line of `latency.csv`, and an entry of the summary's
    /// `ages` or of `latency` in its section `wall`.
    #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
    #[serde(default)]
    pub struct StageLatency in "latency.csv" {
        /// Keyword of the stage.
        pub stage: String,
        /// Name of the robot at which, or in whose control loop, the stage is measured, or `plant`.
        pub robot: String,
        /// Name of the in-neighbor that sends, for a stage of an edge.
        pub from: Option<String>,
        /// Number of values.
        pub count: u64,
        /// Minimum, ns.
        pub min_ns: u64,
        /// Median (p50), ns.
        pub p50_ns: u64,
        /// 90th percentile, ns.
        pub p90_ns: u64,
        /// 99th percentile, ns.
        pub p99_ns: u64,
        /// 99.9th percentile, ns.
        pub p99_9_ns as "p99.9_ns": u64,
        /// 99.99th percentile, ns.
        pub p99_99_ns as "p99.99_ns": u64,
        /// Maximum, ns.
        pub max_ns: u64,
        /// Mean, ns.
        pub mean_ns: f64,
    }
}

table! {
    /// Latency distribution of one stage at one robot or edge in one interval of run time: a line of
    /// `latency_over_time.csv`.
    #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
    pub struct LatencyInterval in "latency_over_time.csv" {
        /// Middle of the interval, s.
        pub t_s: f64,
        /// Keyword of the stage.
        pub stage: String,
        /// Name of the robot at which, or in whose control loop, the stage is measured, or `plant`.
        pub robot: String,
        /// Name of the in-neighbor that sends, for a stage of an edge.
        pub from: Option<String>,
        /// Number of values in the interval.
        pub count: u64,
        /// Median (p50), ns.
        pub p50_ns: u64,
        /// 99th percentile, ns.
        pub p99_ns: u64,
        /// Maximum, ns.
        pub max_ns: u64,
    }
}

/// Age of information of one edge, from the first beacon received over it to the last beacon that the receiving
/// robot reported. Periods in which the receiver is dead do not count.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct InformationAge {
    /// Name of the receiving robot.
    pub robot: String,
    /// Name of the sending robot.
    pub from: String,
    /// Number of received beacons.
    pub heard: u64,
    /// Length of the observed time, ns.
    pub over_ns: u64,
    /// Time average of the age, ns.
    pub mean_ns: f64,
    /// Maximum age, ns.
    pub peak_ns: u64,
}

impl StageLatency {
    /// Returns the robot's name, or the edge as `r1 -> r2`.
    pub fn robot_or_edge_name(&self) -> String {
        match &self.from {
            Some(from) => format!("{from} -> {}", self.robot),
            None => self.robot.clone(),
        }
    }
}

/// Resource usage of one process, summed over all its incarnations.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ProcessUsage {
    /// Name of the process: `supervisor`, `plant`, or the robot.
    pub name: String,
    /// Number of starts.
    pub starts: u64,
    /// Resource usage.
    #[serde(flatten)]
    pub usage: Usage,
}

/// Resource usage of a process, or of several processes in sequence.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Usage {
    /// Processor time in user mode, s.
    pub user_s: f64,
    /// Processor time in the kernel, s.
    pub system_s: f64,
    /// Number of voluntary context switches (the process waited for something).
    pub voluntary_switches: u64,
    /// Number of involuntary context switches (the process was preempted).
    pub involuntary_switches: u64,
    /// Number of page faults without disk access.
    pub minor_faults: u64,
    /// Number of page faults with disk access.
    pub major_faults: u64,
}

impl AddAssign for Usage {
    fn add_assign(&mut self, other: Usage) {
        *self = self.combine(&other, Add::add, Add::add);
    }
}

impl Usage {
    /// Returns the processor time in user mode and in the kernel, s.
    pub fn processor_time_s(&self) -> f64 {
        self.user_s + self.system_s
    }

    /// Returns the usage since `earlier`.
    pub fn usage_since(&self, earlier: &Usage) -> Usage {
        self.combine(earlier, Sub::sub, Sub::sub)
    }

    fn combine(
        &self,
        other: &Usage,
        combine_s: fn(f64, f64) -> f64,
        combine_count: fn(u64, u64) -> u64,
    ) -> Usage {
        Usage {
            user_s: combine_s(self.user_s, other.user_s),
            system_s: combine_s(self.system_s, other.system_s),
            voluntary_switches: combine_count(self.voluntary_switches, other.voluntary_switches),
            involuntary_switches: combine_count(
                self.involuntary_switches,
                other.involuntary_switches,
            ),
            minor_faults: combine_count(self.minor_faults, other.minor_faults),
            major_faults: combine_count(self.major_faults, other.major_faults),
        }
    }
}

impl Summary {
    /// Returns the expectation with this name, if the scenario has it.
    pub fn find_expectation(&self, name: &str) -> Option<&Expectation> {
        self.expectations.iter().find(|expectation| expectation.name == name)
    }

    /// Returns the wake-up latency of all robots together and that of the control timer, if both are known.
    pub fn wake_latency_pair(&self) -> Option<[&StageLatency; 2]> {
        let machine_stage = Stage::Machine.keyword();
        let machine = self.wall.latency.iter().find(|line| line.stage == machine_stage)?;
        Some([self.wall.wake_of_all.as_ref()?, machine])
    }

    /// Returns all latencies and beacon ages.
    pub fn latencies(&self) -> impl Iterator<Item = &StageLatency> {
        self.wall.latency.iter().chain(&self.ages)
    }

    /// Returns the edge with the largest age of information; `None` if no beacon was received.
    pub fn oldest_information(&self) -> Option<&InformationAge> {
        self.information_ages.iter().max_by_key(|age| age.peak_ns)
    }

    /// Returns the number of late wake-ups and answers of robots for each cause that occurred.
    pub fn late_wake_ups_by_cause(&self) -> Vec<(LatenessCause, u64)> {
        let count = |cause: LatenessCause| {
            let lines = self.latencies().filter(|line| line.stage == cause.stage().keyword());
            (cause, lines.map(|line| line.count).sum())
        };
        LatenessCause::ALL.map(count).into_iter().filter(|&(_, count)| count > 0).collect()
    }

    /// Returns for each stage the robot or edge with the largest p99.9, then the largest maximum. Stages that count
    /// lateness by cause are left out.
    pub fn worst_latencies(&self) -> Vec<&StageLatency> {
        let mut worst: Vec<&StageLatency> = Vec::new();
        let cause_stages = LatenessCause::ALL.map(|cause| cause.stage().keyword());
        for line in self.latencies().filter(|line| !cause_stages.contains(&line.stage.as_str())) {
            let tail = |line: &StageLatency| (line.p99_9_ns, line.max_ns);
            match worst.iter_mut().find(|known| known.stage == line.stage) {
                Some(known) if tail(known) <= tail(line) => *known = line,
                Some(_) => {}
                None => worst.push(line),
            }
        }
        worst
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stage_latency(stage: &str, robot: &str, p99_9_ns: u64, max_ns: u64) -> StageLatency {
        let (stage, robot) = (stage.into(), robot.into());
        StageLatency { stage, robot, p99_9_ns, max_ns, ..StageLatency::default() }
    }

    #[test]
    fn summary_round_trip_keeps_robot_order_and_infinite_errors() {
        let summary = Summary {
            scenario: "row".into(),
            pace: Pace::Lockstep,
            min_distance_m: Some(0.1 + 0.2),
            final_error_m: ["r2", "r10", "r1"].map(|robot| (robot.into(), None)).into(),
            restarts: vec![("r10".into(), 3), ("r1".into(), 0)],
            ages: vec![stage_latency("beacon_age", "r1", 1, 2)],
            faults: vec![FaultReport { peak_error_m: f64::INFINITY, ..FaultReport::default() }],
            wall: WallTimeValues {
                startup_s: Some(0.25),
                wall_s: 3.0,
                ..WallTimeValues::default()
            },
            ..Summary::default()
        };
        let text = serde_json::to_string(&summary).unwrap();
        assert_eq!(serde_json::from_str::<Summary>(&text).unwrap(), summary);
    }

    #[test]
    fn missing_field_of_another_version_is_read_as_unknown() {
        let summary: Summary = serde_json::from_str(r#"{ "t_s": 2.0, "novelty": [1] }"#).unwrap();
        assert_eq!(summary, Summary { t_s: 2.0, ..Summary::default() });
    }

    #[test]
    fn worst_of_a_stage_has_the_longest_tail() {
        let summary = Summary {
            ages: vec![stage_latency("beacon_age", "r1", 5, 5)],
            wall: WallTimeValues {
                latency: vec![
                    stage_latency("wake", "r1", 1, 9),
                    stage_latency("wake", "r2", 3, 3),
                    stage_latency("wake", "r3", 3, 4),
                    stage_latency("compute", "r1", 0, 0),
                ],
                ..WallTimeValues::default()
            },
            ..Summary::default()
        };
        let worst: Vec<String> = summary
            .worst_latencies()
            .iter()
            .map(|line| format!("{} {}", line.stage, line.robot))
            .collect();
        assert_eq!(worst, ["wake r3", "compute r1", "beacon_age r1"]);
    }
}
