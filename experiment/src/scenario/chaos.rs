//! `[chaos]`: kills, freezes and partitions at random times, drawn from the seed of the scenario.
//!
//! The same seed draws the same faults. They are then handled like planned faults: exact to the tick in lockstep, and
//! reported one by one.

use formation::portable_math;
use formation::random::draw_unit_by_number;

use super::availability::Availability;
use super::diagnostic::Diagnostic;
use super::fields::kinds;
use super::keys;
use super::table::{TableReader, TypedValue};
use super::{Fault, FaultKind, ns_to_seconds};

/// Maximum expected number of random faults. More are assumed to be a typing error.
const FAULTS_MAX: usize = 10_000;

/// Rates and durations of random faults.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Chaos {
    /// Mean time between kills, s.
    mean_time_between_kills_s: Option<f64>,
    /// Time from a kill to the start of the replacement process, ns.
    restart_after_ns: u64,
    /// Mean time between freezes, s.
    mean_time_between_freezes_s: Option<f64>,
    /// Mean duration of a freeze, s.
    mean_freeze_s: f64,
    /// Random partitions between hosts.
    partitions: Option<RandomPartitions>,
    /// Earliest time of a random fault, ns.
    earliest_start_ns: u64,
    /// Time from which on no random fault starts, ns.
    latest_start_ns: u64,
}

/// Rate and duration of partitions that isolate one of these hosts.
#[derive(Debug, Clone, PartialEq)]
struct RandomPartitions {
    /// Mean time between partitions, s.
    mean_interval_s: f64,
    /// Mean duration, s.
    mean_duration_s: f64,
    /// Names of the hosts.
    hosts: Vec<String>,
}

impl RandomPartitions {
    fn read(table: &TableReader<'_, keys::Chaos>) -> Result<Option<RandomPartitions>, Diagnostic> {
        let Some(mean_interval_s) =
            table.optional_number(keys::Chaos::mean_time_between_partitions_s)?
        else {
            return Ok(None);
        };
        let expected = "names of hosts of the fleet, such as [\"b\"]";
        let Some(hosts) = table.get(keys::Chaos::hosts) else {
            return Err(table.missing_key_error(keys::Chaos::hosts, expected));
        };
        let host_names = hosts.texts(&format!("expected {expected}"))?;
        if host_names.is_empty() {
            return Err(hosts.error_about_key("is empty", format!("expected {expected}")));
        }
        Ok(Some(RandomPartitions {
            mean_interval_s,
            mean_duration_s: table.number(keys::Chaos::mean_partition_s)?,
            hosts: host_names,
        }))
    }
}

impl Chaos {
    /// Parses the table.
    pub(super) fn read(
        value: &TypedValue<'_, kinds::Table<keys::Chaos>>,
        duration_ns: u64,
    ) -> Result<Chaos, Diagnostic> {
        let table = value.table()?;
        let until_ns = table.optional_time_ns(keys::Chaos::until_s)?;
        let from_ns = table.time_ns(keys::Chaos::from_s)?;
        if let (Some(until), Some(until_ns)) = (table.get(keys::Chaos::until_s), until_ns)
            && until_ns <= from_ns
        {
            let (from_s, until_s) = (ns_to_seconds(from_ns), ns_to_seconds(until_ns));
            return Err(until.error_about_key(
                format!("is {until_s}, but `from_s` {from_s}: no fault lies between them"),
                format!("expected more than `from_s`, {from_s} s"),
            ));
        }
        let until_ns = until_ns.unwrap_or(duration_ns);
        let chaos = Chaos {
            mean_time_between_kills_s: table
                .optional_number(keys::Chaos::mean_time_between_kills_s)?,
            restart_after_ns: table.time_ns(keys::Chaos::restart_after_s)?,
            mean_time_between_freezes_s: table
                .optional_number(keys::Chaos::mean_time_between_freezes_s)?,
            mean_freeze_s: table.number(keys::Chaos::mean_freeze_s)?,
            partitions: RandomPartitions::read(&table)?,
            earliest_start_ns: from_ns,
            latest_start_ns: until_ns.min(duration_ns),
        };
        let between_partitions_s =
            chaos.partitions.as_ref().map(|partitions| partitions.mean_interval_s);
        let means_s = [
            chaos.mean_time_between_kills_s,
            chaos.mean_time_between_freezes_s,
            between_partitions_s,
        ];
        if means_s.iter().all(Option::is_none) {
            return Err(table
                .required_value(keys::Chaos::mean_time_between_kills_s)
                .expect_err("it is not given"));
        }
        let span_s = ns_to_seconds(chaos.latest_start_ns.saturating_sub(chaos.earliest_start_ns));
        let expected: f64 = means_s.iter().flatten().map(|mean_s| span_s / mean_s).sum();
        if expected > FAULTS_MAX as f64 {
            return Err(value.error_about_key(
                format!("draws about {expected:.0} faults"),
                format!("expected longer mean times: at most {FAULTS_MAX} faults"),
            ));
        }
        Ok(chaos)
    }

    /// Returns the faults that `seed` draws. Each affects a robot that is up at that time.
    pub(super) fn draw(&self, seed: u64, availability: &mut Availability) -> Vec<Fault> {
        let mut rng =
            RandomSequence { seed: seed ^ u64::from_le_bytes(*b"in chaos"), draw_count: 0 };
        let mut times = Vec::new();
        for (mean_s, is_freeze) in
            [(self.mean_time_between_kills_s, false), (self.mean_time_between_freezes_s, true)]
        {
            let Some(mean_s) = mean_s else { continue };
            times.extend(
                self.draw_event_times_ns(mean_s, &mut rng)
                    .into_iter()
                    .map(|start_ns| (start_ns, is_freeze)),
            );
        }
        times.sort_unstable();
        times.truncate(2 * FAULTS_MAX);
        let mut faults = Vec::new();
        for (start_ns, is_freeze) in times {
            let available = availability.available_robots(start_ns);
            if available.is_empty() {
                continue;
            }
            let robot = available[(rng.next_unit() * available.len() as f64) as usize];
            let fault = if is_freeze {
                // At least 1 ns, because a fault must have a duration.
                let duration_ns = Some(rng.next_exponential_ns(self.mean_freeze_s).max(1));
                Fault { start_ns, duration_ns, kind: FaultKind::Freeze { robot } }
            } else {
                let restart_after_ns = Some(self.restart_after_ns);
                Fault {
                    start_ns,
                    duration_ns: None,
                    kind: FaultKind::Kill { robot, restart_after_ns },
                }
            };
            // A planned fault later in the file can conflict. Then this one is omitted.
            if availability.record_fault(&fault).is_ok() {
                faults.push(fault);
            }
        }
        faults.extend(
            self.partitions.iter().flat_map(|partitions| self.draw_partitions(seed, partitions)),
        );
        faults.sort_by_key(|fault| fault.start_ns);
        faults
    }

    /// Draws partitions. Their random numbers are independent, so they do not change the other faults.
    fn draw_partitions(&self, seed: u64, partitions: &RandomPartitions) -> Vec<Fault> {
        let mut rng =
            RandomSequence { seed: seed ^ u64::from_le_bytes(*b"of hosts"), draw_count: 0 };
        let times = self.draw_event_times_ns(partitions.mean_interval_s, &mut rng);
        let fault = |start_ns| {
            let host = (rng.next_unit() * partitions.hosts.len() as f64) as usize;
            let duration_ns = Some(rng.next_exponential_ns(partitions.mean_duration_s).max(1));
            let kind = FaultKind::Partition { hosts: vec![partitions.hosts[host].clone()] };
            Fault { start_ns, duration_ns, kind }
        };
        times.into_iter().map(fault).collect()
    }

    /// Draws the times of events with the mean interval `mean_s`, ns (Poisson process).
    fn draw_event_times_ns(&self, mean_s: f64, rng: &mut RandomSequence) -> Vec<u64> {
        let mut times = Vec::new();
        let mut at_ns = self.earliest_start_ns;
        loop {
            at_ns = at_ns.saturating_add(rng.next_exponential_ns(mean_s));
            // The limit is reached for less than one seed in a million.
            if at_ns >= self.latest_start_ns || times.len() == 2 * FAULTS_MAX {
                return times;
            }
            times.push(at_ns);
        }
    }
}

/// Sequence of random numbers.
struct RandomSequence {
    seed: u64,
    draw_count: u64,
}

impl RandomSequence {
    fn next_unit(&mut self) -> f64 {
        self.draw_count += 1;
        draw_unit_by_number(self.seed, self.draw_count)
    }

    /// Draws an exponentially distributed time with the mean `mean_s`, ns.
    fn next_exponential_ns(&mut self, mean_s: f64) -> u64 {
        let draw = self.next_unit();
        (-portable_math::ln(1.0 - draw) * mean_s * 1e9) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example_chaos() -> Chaos {
        Chaos {
            mean_time_between_kills_s: Some(0.5),
            restart_after_ns: 300_000_000,
            mean_time_between_freezes_s: Some(1.0),
            mean_freeze_s: 0.4,
            partitions: None,
            earliest_start_ns: 2_000_000_000,
            latest_start_ns: 102_000_000_000,
        }
    }

    fn draw_faults(seed: u64) -> Vec<Fault> {
        example_chaos().draw(seed, &mut Availability::new(3))
    }

    #[test]
    fn chaos_faults_are_determined_by_the_seed() {
        assert_eq!(draw_faults(1), draw_faults(1));
        assert_ne!(draw_faults(1), draw_faults(2));
    }

    #[test]
    fn partitions_affect_one_host_at_a_time() {
        let hosts = vec!["b".to_owned(), "c".to_owned()];
        let partitions =
            Some(RandomPartitions { mean_interval_s: 1.0, mean_duration_s: 0.5, hosts });
        let chaos = Chaos { partitions, ..example_chaos() };
        for seed in 0..20 {
            let all = chaos.draw(seed, &mut Availability::new(3));
            assert!(all.is_sorted_by_key(|fault| fault.start_ns));
            let (partitions, others): (Vec<Fault>, Vec<Fault>) = all
                .into_iter()
                .partition(|fault| matches!(fault.kind, FaultKind::Partition { .. }));
            assert_eq!(others, draw_faults(seed));
            // The expected number is 100.
            assert!((60..140).contains(&partitions.len()), "seed {seed}: {}", partitions.len());
            let count = |name: &str| {
                let host = FaultKind::Partition { hosts: vec![name.to_owned()] };
                partitions.iter().filter(|fault| fault.kind == host).count()
            };
            assert!(
                count("b") > 20 && count("c") > 20 && count("b") + count("c") == partitions.len()
            );
            assert!(
                partitions.iter().all(|fault| fault.duration_ns.is_some_and(|for_ns| for_ns > 0))
            );
        }
    }

    #[test]
    fn chaos_faults_match_rate_and_window_and_hit_live_robots() {
        for seed in 0..20 {
            let faults = draw_faults(seed);
            let kills = faults.iter().filter(|f| matches!(f.kind, FaultKind::Kill { .. })).count();
            let freezes = faults.len() - kills;
            // The expected numbers are 200 and 100. Few find no robot that is up.
            assert!((140..240).contains(&kills), "seed {seed}: {kills} kills");
            assert!((60..135).contains(&freezes), "seed {seed}: {freezes} freezes");
            let is_in_window =
                |fault: &Fault| (2_000_000_000..102_000_000_000).contains(&fault.start_ns);
            assert!(
                faults.is_sorted_by_key(|fault| fault.start_ns) && faults.iter().all(is_in_window)
            );
            let mut availability = Availability::new(3);
            for fault in &faults {
                assert_eq!(availability.record_fault(fault), Ok(()), "seed {seed}: {fault:?}");
            }
        }
    }
}
