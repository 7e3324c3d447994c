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
    pub(super) group_processors: Vec<usize>,
    /// Processor of the plant: that of the group released last.
    pub(super) plant_processor: usize,
    /// Processor of the supervisor; never that of the plant, for which all processes wait.
    pub(super) supervisor_processor: usize,
}

impl CoreAssignment {
    /// Computes the assignment for `robots` robots. `first` is any number; it selects different cores for
    /// concurrent runs on a large machine. `None` with a single logical processor.
    pub(super) fn compute(
        topology: &Topology,
        robots: usize,
        first: usize,
    ) -> Option<CoreAssignment> {
        let core_count =
            ((robots + 1) / ROBOTS_PER_CORE_MIN).clamp(1, topology.whole_cores().min(GROUPS_MAX));
        let (fast_cores, cores) = select_fastest_cores(topology, core_count);
        let selected = select_close_cores(fast_cores, cores, first);
        let groups: Vec<usize> = selected.iter().map(|core| core.threads[0]).collect();
        let plant = *groups.last()?;
        // A free core; otherwise a second thread, the plant's last; otherwise the core of another group.
        let free_core = topology.cores.iter().filter(|core| !selected.contains(core));
        let free_core = free_core.min_by_key(|core| core_distance_key(core, selected[0]));
        let second_thread = selected.iter().find_map(|core| core.threads.get(1).copied());
        let other_group_core = groups.iter().copied().find(|&cpu| cpu != plant);
        let supervisor =
            free_core.map(|core| core.threads[0]).or(second_thread).or(other_group_core)?;
        Some(CoreAssignment {
            group_processors: groups,
            plant_processor: plant,
            supervisor_processor: supervisor,
        })
    }

    /// Returns the processors on which robots run if `used` groups of robots each have their own processor.
    /// The last of them is the processor of the plant, which one group shares.
    pub(super) fn robot_processors(&self, used: usize) -> &[usize] {
        &self.group_processors
            [self.group_processors.len() - used.clamp(1, self.group_processors.len())..]
    }

    /// Returns the processor of robot `i` if `used` groups have processors of their own.
    pub(super) fn processor_of_robot(&self, i: usize, used: usize) -> usize {
        let (group, used) = (i % self.group_processors.len(), self.robot_processors(used));
        // From the end: the processor released last stays with the plant.
        used[used.len() - 1 - (self.group_processors.len() - 1 - group) % used.len()]
    }

    /// Returns all assigned processors.
    pub(super) fn assigned_processors(&self) -> impl Iterator<Item = usize> + '_ {
        let supervisor = (!self.group_processors.contains(&self.supervisor_processor))
            .then_some(self.supervisor_processor);
        self.group_processors.iter().copied().chain(supervisor)
    }
}

/// Returns the cores that may be used, and the number of them, at most `count_max`, on which evenly spread
/// robots have the highest throughput at the speed of the slowest core.
fn select_fastest_cores(topology: &Topology, count_max: usize) -> (Vec<&Core>, usize) {
    let mut speeds: Vec<u64> = topology.cores.iter().map(|core| core.speed).collect();
    speeds.sort_unstable_by_key(|&speed| std::cmp::Reverse(speed));
    let throughput = |&cores: &usize| cores as u64 * speeds[cores - 1];
    // Of equally fast numbers the smallest: fewer wake-ups cross cores.
    let cores = (1..=count_max.min(speeds.len())).rev().max_by_key(throughput).unwrap_or(0);
    let slowest = speeds.get(cores.wrapping_sub(1)).copied().unwrap_or(0);
    (topology.cores.iter().filter(|core| core.speed >= slowest).collect(), cores)
}

/// Key that is equal for cores of the same domain.
type DomainKey = fn(&Core) -> (usize, usize);

/// Selects `cores` cores: within one last-level cache if one has enough of them, otherwise within one NUMA
/// node, otherwise adjacent ones.
fn select_close_cores(mut candidates: Vec<&Core>, cores: usize, first: usize) -> Vec<&Core> {
    candidates.sort_by_key(|core| (core.numa_node, core.cache_id, core.threads[0]));
    let domain_keys: [DomainKey; 3] =
        [|core| (core.numa_node, core.cache_id), |core| (core.numa_node, 0), |_| (0, 0)];
    for domain in domain_keys {
        let domains = candidates.chunk_by(|a, b| domain(a) == domain(b));
        let suitable_domains: Vec<_> = domains.filter(|domain| domain.len() >= cores).collect();
        if let Some(&domain) = suitable_domains.get(first % suitable_domains.len().max(1)) {
            let start = first / suitable_domains.len();
            return (0..cores).map(|i| domain[(start + i) % domain.len()]).collect();
        }
    }
    Vec::new()
}

/// Returns an ordering key for the distance of two cores; smaller is closer.
fn core_distance_key(a: &Core, b: &Core) -> (bool, bool, u64) {
    (a.numa_node != b.numa_node, a.cache_id != b.cache_id, a.speed.abs_diff(b.speed))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::fmt::Write as _;
    use std::fs;
    use std::path::{Path, PathBuf};

    use super::super::topology::parse_list;
    use super::*;

    fn folder() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("src/cores/topologies")
    }

    /// Parses the description of a machine: `quota`, and for each kind of core its threads (threads of a
    /// core joined by `+`), cache, node and speed.
    fn parse_machine(text: &str) -> Topology {
        let mut topology = Topology::default();
        for line in text.lines().filter(|line| !line.starts_with('#')) {
            let words: Vec<&str> = line.split_whitespace().collect();
            match words[..] {
                ["quota", quota] => topology.quota_cores = Some(quota.parse().unwrap()),
                ["cores", threads, "cache", cache, "node", node, "speed", speed] => {
                    let threads: Vec<Vec<usize>> = threads.split('+').map(parse_list).collect();
                    topology.cores.extend((0..threads[0].len()).map(|i| Core {
                        threads: threads.iter().map(|thread| thread[i]).collect(),
                        cache_id: cache.parse().unwrap(),
                        numa_node: node.parse().unwrap(),
                        speed: speed.parse().unwrap(),
                    }));
                }
                _ => panic!("{line}"),
            }
        }
        topology
    }

    /// Returns all machines of the folder, by name.
    fn read_machines() -> Vec<(String, Topology)> {
        let files = fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().path());
        let files =
            files.filter(|path| path.extension().is_some_and(|extension| extension == "cores"));
        let mut machines: Vec<_> = files
            .map(|path| {
                let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
                (name, parse_machine(&fs::read_to_string(&path).unwrap()))
            })
            .collect();
        machines.sort_by(|a, b| a.0.cmp(&b.0));
        assert!(machines.len() >= 12, "{}", machines.len());
        machines
    }

    #[test]
    fn groups_have_separate_permitted_cores() {
        for (name, topology) in read_machines() {
            for (robots, first) in (1..200).flat_map(|robots| (0..40).map(move |i| (robots, i))) {
                let Some(assignment) = CoreAssignment::compute(&topology, robots, first) else {
                    assert!(topology.threads().count() < 2, "{name}");
                    continue;
                };
                let core = |cpu: usize| {
                    let found = topology.cores.iter().position(|c| c.threads.contains(&cpu));
                    found.expect("it may be used")
                };
                let cores: BTreeSet<_> =
                    assignment.group_processors.iter().map(|&cpu| core(cpu)).collect();
                assert_eq!(cores.len(), assignment.group_processors.len(), "{name} {assignment:?}");
                assert!(cores.len() <= topology.whole_cores().min(GROUPS_MAX).min(robots));
                assert_eq!(Some(&assignment.plant_processor), assignment.group_processors.last());
                core(assignment.supervisor_processor);
                assert_ne!(assignment.supervisor_processor, assignment.plant_processor, "{name}");
                for used in 1..=assignment.group_processors.len() {
                    let processors: BTreeSet<_> =
                        (0..robots).map(|i| assignment.processor_of_robot(i, used)).collect();
                    assert_eq!(processors.len(), used, "{name} {assignment:?}");
                    assert!(processors.contains(&assignment.plant_processor));
                    assert!(processors.iter().all(|cpu| assignment.group_processors.contains(cpu)));
                }
                let (i, processors) = (robots - 1, assignment.group_processors.len());
                assert_eq!(
                    assignment.processor_of_robot(i, processors),
                    assignment.group_processors[i % processors],
                    "in turns"
                );
            }
        }
    }

    /// Checks the assignments against the reviewed table. `PHALANX_BLESS=1` rewrites it.
    #[test]
    fn core_assignments_match_the_reviewed_table() {
        let mut table =
            "machine                robots  groups' processors | plant | supervisor\n".to_owned();
        for (name, topology) in read_machines() {
            for robots in [3, 8, 64] {
                let assignment_text = match CoreAssignment::compute(&topology, robots, 0) {
                    None => "no process is pinned".to_owned(),
                    Some(CoreAssignment {
                        group_processors: groups,
                        plant_processor: plant,
                        supervisor_processor: supervisor,
                    }) => {
                        let groups: Vec<String> = groups.iter().map(usize::to_string).collect();
                        format!("{} | {plant} | {supervisor}", groups.join(" "))
                    }
                };
                writeln!(table, "{name:<22} {robots:>6}  {assignment_text}").unwrap();
            }
        }
        let path = folder().join("placements.txt");
        if std::env::var_os("PHALANX_BLESS").is_some() {
            fs::write(&path, &table).unwrap();
        }
        assert_eq!(fs::read_to_string(&path).unwrap(), table);
    }
}
