//! Which process of a lockstep run gets which logical processor: a pure function of the machine.
//!
//! In lockstep everybody waits for the slowest. So robots are dealt evenly to whole cores, as many as
//! are worth it, all about equally fast, close to each other; a second thread of a core gets none.

use protocol::barrier::GROUPS_MAX;

use super::topology::{Core, Topology};

/// Robots for which one core is faster than two on every machine: on one, nobody is woken from afar.
const ROBOTS_PER_CORE_MIN: usize = 4;

/// Which logical processor is whose.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Deal {
    /// Of each group of robots; robots are dealt to the groups in turns.
    pub(super) groups: Vec<usize>,
    /// That of the group which is released last.
    pub(super) plant: usize,
    /// Never the plant's, for whom everybody waits.
    pub(super) supervisor: usize,
}

impl Deal {
    /// For so many robots. `first`: any number; runs side by side on a large machine shall not all
    /// take the same cores. `None` with a single logical processor.
    pub(super) fn of(topology: &Topology, robots: usize, first: usize) -> Option<Deal> {
        let wanted =
            ((robots + 1) / ROBOTS_PER_CORE_MIN).clamp(1, topology.whole_cores().min(GROUPS_MAX));
        let (fast, cores) = fast_together(topology, wanted);
        let taken = close_together(fast, cores, first);
        let groups: Vec<usize> = taken.iter().map(|core| core.threads[0]).collect();
        let plant = *groups.last()?;
        // A free core; else a second thread, the plant's last; else another group's.
        let free = topology.cores.iter().filter(|core| !taken.contains(core));
        let free = free.min_by_key(|core| distance(core, taken[0]));
        let second = taken.iter().find_map(|core| core.threads.get(1).copied());
        let other = groups.iter().copied().find(|&cpu| cpu != plant);
        let supervisor = free.map(|core| core.threads[0]).or(second).or(other)?;
        Some(Deal { groups, plant, supervisor })
    }

    /// Those that robots are on if only so many of the groups' are used; that of the plant is among them.
    pub(super) fn used_for_robots(&self, used: usize) -> &[usize] {
        &self.groups[self.groups.len() - used.clamp(1, self.groups.len())..]
    }

    /// That of a robot, if only so many are used.
    pub(super) fn of_robot(&self, i: usize, used: usize) -> usize {
        let (group, used) = (i % self.groups.len(), self.used_for_robots(used));
        // From the end: what is released last stays with the plant.
        used[used.len() - 1 - (self.groups.len() - 1 - group) % used.len()]
    }

    /// All that it gives to anybody.
    pub(super) fn used(&self) -> impl Iterator<Item = usize> + '_ {
        let beside = (!self.groups.contains(&self.supervisor)).then_some(self.supervisor);
        self.groups.iter().copied().chain(beside)
    }
}

/// On how many cores, `wanted` at most, robots that are dealt evenly get most done, all at the pace of
/// the slowest; with all cores that are fast enough for it.
fn fast_together(topology: &Topology, wanted: usize) -> (Vec<&Core>, usize) {
    let mut speeds: Vec<u64> = topology.cores.iter().map(|core| core.speed).collect();
    speeds.sort_unstable_by_key(|&speed| std::cmp::Reverse(speed));
    let done = |&cores: &usize| cores as u64 * speeds[cores - 1];
    // Of equals the smaller number: fewer are woken from afar.
    let cores = (1..=wanted.min(speeds.len())).rev().max_by_key(done).unwrap_or(0);
    let slowest = speeds.get(cores.wrapping_sub(1)).copied().unwrap_or(0);
    (topology.cores.iter().filter(|core| core.speed >= slowest).collect(), cores)
}

/// What close cores have in common.
type Domain = fn(&Core) -> (usize, usize);

/// So many of these: with one last-level cache if any has enough of them, else on one node, else
/// next to each other.
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

/// The nearer, the smaller.
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

    /// A machine as these files have it: `quota`, and for each kind of cores their threads (of one
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

    /// Every machine of the folder, by name.
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
    fn no_two_groups_share_a_core_and_nobody_is_where_it_may_not_be() {
        for (name, topology) in machines() {
            for (robots, first) in (1..200).flat_map(|robots| (0..40).map(move |i| (robots, i))) {
                let Some(deal) = Deal::of(&topology, robots, first) else {
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
                    let all: BTreeSet<_> = (0..robots).map(|i| deal.of_robot(i, used)).collect();
                    assert_eq!(all.len(), used, "{name} {deal:?}");
                    assert!(all.contains(&deal.plant));
                    assert!(all.iter().all(|cpu| deal.groups.contains(cpu)));
                }
                let (i, all) = (robots - 1, deal.groups.len());
                assert_eq!(deal.of_robot(i, all), deal.groups[i % all], "in turns");
            }
        }
    }

    /// The file is the table that was reviewed. `PHALANX_BLESS=1` writes it again.
    #[test]
    fn every_machines_table_is_as_reviewed() {
        let mut table =
            "machine                robots  groups' processors | plant | supervisor\n".to_owned();
        for (name, topology) in machines() {
            for robots in [3, 8, 64] {
                let dealt = match Deal::of(&topology, robots, 0) {
                    None => "nobody is kept anywhere".to_owned(),
                    Some(Deal { groups, plant, supervisor }) => {
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
