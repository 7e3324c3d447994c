//! Assignment of the processes of a lockstep run to logical processors: a pure function of the topology.
//!
//! In lockstep all processes wait for the slowest. Robots are therefore spread evenly over whole cores that
//! are about equally fast and close to each other, as many as increase the speed. The second thread of a
//! core gets no robots.

use protocol::barrier::GROUPS_MAX;

use super::topology::{Core, Topology};

/// Maximum number of robots for which one core is faster than two on every machine, because no wake-up
/// crosses cores.
const ROBOTS_PER_CORE_MIN: usize = 4;

/// Logical processor of each process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct CoreAssignment {
    /// Processor of each group of robots; robots are assigned to the groups round-robin.
    pub(super) groups: Vec<usize>,
    /// Processor of the plant: that of the group released last.
    pub(super) plant: usize,
    /// Processor of the supervisor; never that of the plant, for which all processes wait.
    pub(super) supervisor: usize,
}

impl CoreAssignment {
    /// Computes the assignment for `robots` robots. `first` is any number; it selects different cores for
    /// concurrent runs on a large machine. `None` with a single logical processor.
    pub(super) fn compute(
        topology: &Topology,
        robots: usize,
        first: usize,
    ) -> Option<CoreAssignment> {
        let wanted =
            ((robots + 1) / ROBOTS_PER_CORE_MIN).clamp(1, topology.whole_cores().min(GROUPS_MAX));
        let (fast, cores) = fast_together(topology, wanted);
        let taken = close_together(fast, cores, first);
        let groups: Vec<usize> = taken.iter().map(|core| core.threads[0]).collect();
        let plant = *groups.last()?;
        // A free core; otherwise a second thread, the plant's last; otherwise the core of another group.
        let free = topology.cores.iter().filter(|core| !taken.contains(core));
        let free = free.min_by_key(|core| distance(core, taken[0]));
        let second = taken.iter().find_map(|core| core.threads.get(1).copied());
        let other = groups.iter().copied().find(|&cpu| cpu != plant);
        let supervisor = free.map(|core| core.threads[0]).or(second).or(other)?;
        Some(CoreAssignment { groups, plant, supervisor })
    }

    /// Returns the processors on which robots run if `used` groups of robots each have their own processor.
    /// The last of them is the processor of the plant, which one group shares.
    pub(super) fn used_for_robots(&self, used: usize) -> &[usize] {
        &self.groups[self.groups.len() - used.clamp(1, self.groups.len())..]
    }

    /// Returns the processor of robot `i` if `used` groups have processors of their own.
    pub(super) fn processor_of_robot(&self, i: usize, used: usize) -> usize {
        let (group, used) = (i % self.groups.len(), self.used_for_robots(used));
        // From the end: the processor released last stays with the plant.
        used[used.len() - 1 - (self.groups.len() - 1 - group) % used.len()]
    }

    /// Returns all assigned processors.
    pub(super) fn assigned_processors(&self) -> impl Iterator<Item = usize> + '_ {
        let beside = (!self.groups.contains(&self.supervisor)).then_some(self.supervisor);
        self.groups.iter().copied().chain(beside)
    }
}

/// Returns the cores that may be used, and the number of them, at most `wanted`, on which evenly spread
/// robots have the highest throughput at the speed of the slowest core.
fn fast_together(topology: &Topology, wanted: usize) -> (Vec<&Core>, usize) {
    let mut speeds: Vec<u64> = topology.cores.iter().map(|core| core.speed).collect();
    speeds.sort_unstable_by_key(|&speed| std::cmp::Reverse(speed));
    let done = |&cores: &usize| cores as u64 * speeds[cores - 1];
    // Of equally fast numbers the smallest: fewer wake-ups cross cores.
    let cores = (1..=wanted.min(speeds.len())).rev().max_by_key(done).unwrap_or(0);
    let slowest = speeds.get(cores.wrapping_sub(1)).copied().unwrap_or(0);
    (topology.cores.iter().filter(|core| core.speed >= slowest).collect(), cores)
}

/// Key that is equal for cores of the same domain.
type Domain = fn(&Core) -> (usize, usize);

/// Selects `cores` cores: within one last-level cache if one has enough of them, otherwise within one NUMA
/// node, otherwise adjacent ones.
fn close_together(mut from: Vec<&Core>, cores: usize, first: usize) -> Vec<&Core> {
    from.sort_by_key(|core| (core.node, core.cache, core.threads[0]));
    let by: [Domain; 3] = [|core| (core.node, core.cache), |core| (core.node, 0), |_| (0, 0)];
    for domain in by {
        let domains = from.chunk_by(|a, b| domain(a) == domain(b));
        let enough: Vec<_> = domains.filter(|domain| domain.len() >= cores).collect();
        if let Some(&domain) = enough.get(first % enough.len().max(1)) {
            let start = first / enough.len();
            return (0..cores).map(|i| domain[(start + i) % domain.len()]).collect();
        }
    }
    Vec::new()
}

/// Returns an ordering key for the distance of two cores; smaller is closer.
fn distance(a: &Core, b: &Core) -> (bool, bool, u64) {
    (a.node != b.node, a.cache != b.cache, a.speed.abs_diff(b.speed))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::fmt::Write as _;
    use std::fs;
    use std::path::{Path, PathBuf};

    use super::super::topology::numbers;
    use super::*;

    fn folder() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("src/cores/topologies")
    }

    /// Parses the description of a machine: `quota`, and for each kind of core its threads (threads of a
    /// core joined by `+`), cache, node and speed.
    fn read(text: &str) -> Topology {
        let mut topology = Topology::default();
        for line in text.lines().filter(|line| !line.starts_with('#')) {
            let words: Vec<&str> = line.split_whitespace().collect();
            match words[..] {
                ["quota", quota] => topology.quota = Some(quota.parse().unwrap()),
                ["cores", threads, "cache", cache, "node", node, "speed", speed] => {
                    let threads: Vec<Vec<usize>> = threads.split('+').map(numbers).collect();
                    topology.cores.extend((0..threads[0].len()).map(|i| Core {
                        threads: threads.iter().map(|thread| thread[i]).collect(),
                        cache: cache.parse().unwrap(),
                        node: node.parse().unwrap(),
                        speed: speed.parse().unwrap(),
                    }));
                }
                _ => panic!("{line}"),
            }
        }
        topology
    }

    /// Returns all machines of the folder, by name.
    fn machines() -> Vec<(String, Topology)> {
        let files = fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().path());
        let files = files.filter(|path| path.extension().is_some_and(|of| of == "cores"));
        let mut machines: Vec<_> = files
            .map(|path| {
                let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
                (name, read(&fs::read_to_string(&path).unwrap()))
            })
            .collect();
        machines.sort_by(|a, b| a.0.cmp(&b.0));
        assert!(machines.len() >= 12, "{}", machines.len());
        machines
    }

    #[test]
    fn groups_have_separate_permitted_cores() {
        for (name, topology) in machines() {
            for (robots, first) in (1..200).flat_map(|robots| (0..40).map(move |i| (robots, i))) {
                let Some(deal) = CoreAssignment::compute(&topology, robots, first) else {
                    assert!(topology.threads().count() < 2, "{name}");
                    continue;
                };
                let core = |cpu: usize| {
                    let found = topology.cores.iter().position(|c| c.threads.contains(&cpu));
                    found.expect("it may be used")
                };
                let cores: BTreeSet<_> = deal.groups.iter().map(|&cpu| core(cpu)).collect();
                assert_eq!(cores.len(), deal.groups.len(), "{name} {deal:?}");
                assert!(cores.len() <= topology.whole_cores().min(GROUPS_MAX).min(robots));
                assert_eq!(Some(&deal.plant), deal.groups.last());
                core(deal.supervisor);
                assert_ne!(deal.supervisor, deal.plant, "{name}");
                for used in 1..=deal.groups.len() {
                    let all: BTreeSet<_> =
                        (0..robots).map(|i| deal.processor_of_robot(i, used)).collect();
                    assert_eq!(all.len(), used, "{name} {deal:?}");
                    assert!(all.contains(&deal.plant));
                    assert!(all.iter().all(|cpu| deal.groups.contains(cpu)));
                }
                let (i, all) = (robots - 1, deal.groups.len());
                assert_eq!(deal.processor_of_robot(i, all), deal.groups[i % all], "in turns");
            }
        }
    }

    /// Checks the assignments against the reviewed table. `PHALANX_BLESS=1` rewrites it.
    #[test]
    fn core_assignments_match_the_reviewed_table() {
        let mut table =
            "machine                robots  groups' processors | plant | supervisor\n".to_owned();
        for (name, topology) in machines() {
            for robots in [3, 8, 64] {
                let dealt = match CoreAssignment::compute(&topology, robots, 0) {
                    None => "no process is pinned".to_owned(),
                    Some(CoreAssignment { groups, plant, supervisor }) => {
                        let groups: Vec<String> = groups.iter().map(usize::to_string).collect();
                        format!("{} | {plant} | {supervisor}", groups.join(" "))
                    }
                };
                writeln!(table, "{name:<22} {robots:>6}  {dealt}").unwrap();
            }
        }
        let path = folder().join("placements.txt");
        if std::env::var_os("PHALANX_BLESS").is_some() {
            fs::write(&path, &table).unwrap();
        }
        assert_eq!(fs::read_to_string(&path).unwrap(), table);
    }
}
