//! Processors that this process may use: whole cores, their threads, speeds, and distances.
//!
//! Read from sysfs, the calling thread's affinity (which respects a cpuset) and the quota of its cgroups.
//! Missing data defaults to one thread per core, equal speeds and equal distances.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use protocol::cgroup;
use rustix::thread::{CpuSet, sched_getaffinity};

/// Speed of the fastest cores, in units of the kernel's `cpu_capacity`.
const FULL_SPEED: u64 = 1024;
/// Speed of the small cores of a hybrid processor whose kernel has no `cpu_capacity`.
const SMALL_SPEED: u64 = 600;

/// Processor core. Its threads share one execution unit, so that two busy threads slow each other down.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Core {
    /// Usable logical processors of the core, ascending; at least one.
    pub threads: Vec<usize>,
    /// ID of the last-level cache of the core. Cores with the same ID share it.
    pub cache_id: usize,
    /// Number of the NUMA node of the core.
    pub numa_node: usize,
    /// Speed of the core. The fastest cores of a machine have 1024.
    pub speed: u64,
}

/// Usable processors.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Topology {
    /// Cores, ascending by their first thread.
    pub cores: Vec<Core>,
    /// CPU quota of the cgroups, in cores; `None` without a limit.
    pub quota_cores: Option<f64>,
}

impl Topology {
    /// Reads the topology of this machine for the calling thread. `None` if the kernel does not report the
    /// usable processors.
    pub fn for_this_thread() -> Option<Topology> {
        let affinity = sched_getaffinity(None).ok()?;
        let usable_cpus: Vec<usize> =
            (0..CpuSet::MAX_CPU).filter(|&cpu| affinity.is_set(cpu)).collect();
        (!usable_cpus.is_empty()).then(|| Topology::read(Path::new("/"), &usable_cpus))
    }

    /// Reads the topology of the logical processors `usable_cpus` (ascending) from the files below `root`, which
    /// is `/` on a real machine.
    pub fn read(root: &Path, usable_cpus: &[usize]) -> Topology {
        let system = root.join("sys/devices/system");
        let small_cpus = read_list(&root.join("sys/devices/cpu_atom/cpus"));
        let nodes = read_numa_nodes(&system.join("node"));
        let mut cores = BTreeMap::<usize, Core>::new();
        for &cpu in usable_cpus {
            let folder = system.join(format!("cpu/cpu{cpu}"));
            let siblings = read_list(&folder.join("topology/thread_siblings_list"));
            let core = siblings.first().copied().unwrap_or(cpu);
            let default_speed = if small_cpus.contains(&cpu) { SMALL_SPEED } else { FULL_SPEED };
            let core = cores.entry(core).or_insert_with(|| Core {
                threads: Vec::new(),
                cache_id: read_last_cache_id(&folder.join("cache")).unwrap_or(0),
                numa_node: nodes.iter().position(|node| node.contains(&cpu)).unwrap_or(0),
                speed: read_number(folder.join("cpu_capacity")).unwrap_or(default_speed),
            });
            core.threads.push(cpu);
        }
        let mut cores: Vec<Core> = cores.into_values().collect();
        cores.sort_by_key(|core| core.threads[0]);
        Topology { cores, quota_cores: read_smallest_quota(root) }
    }

    /// Returns how many whole cores may be busy concurrently: at least one, and at most the quota.
    pub fn whole_cores(&self) -> usize {
        let quota = self.quota_cores.map_or(usize::MAX, |quota| quota.floor() as usize);
        self.cores.len().min(quota).max(1)
    }

    /// Returns all logical processors, ordered by core.
    pub fn threads(&self) -> impl Iterator<Item = usize> + '_ {
        self.cores.iter().flat_map(|core| core.threads.iter().copied())
    }
}

/// Parses a file with a list such as `0-3,8`; empty if there is no such file.
fn read_list(path: &Path) -> Vec<usize> {
    fs::read_to_string(path).map(|text| parse_list(text.trim())).unwrap_or_default()
}

pub(super) fn parse_list(text: &str) -> Vec<usize> {
    let range = |part: &str| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        Some(first.trim().parse().ok()?..=last.trim().parse().ok()?)
    };
    text.split(',').filter_map(range).flatten().collect()
}

/// Parses a file that contains one number.
pub fn read_number(path: impl AsRef<Path>) -> Option<u64> {
    fs::read_to_string(path).ok()?.trim().parse().ok()
}

/// Returns the processors of each NUMA node.
fn read_numa_nodes(folder: &Path) -> Vec<Vec<usize>> {
    let nodes = read_list(&folder.join("online"));
    nodes.iter().map(|node| read_list(&folder.join(format!("node{node}/cpulist")))).collect()
}

/// Returns the first processor that shares the cache of the highest level.
fn read_last_cache_id(folder: &Path) -> Option<usize> {
    let caches = fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path());
    let with_level = caches.filter_map(|cache| Some((read_number(cache.join("level"))?, cache)));
    let (_, last_cache) = with_level.max()?;
    read_list(&last_cache.join("shared_cpu_list")).first().copied()
}

/// Returns the smallest quota of the cgroups of this process and of their ancestors.
fn read_smallest_quota(root: &Path) -> Option<f64> {
    cgroup::find_limited_cgroups(root)
        .into_iter()
        .map(|limited| limited.quota_cores)
        .min_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Creates a directory with these files, given as names and texts. It is used in place of `/`.
    fn machine(files: &[(&str, &str)]) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = root.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, format!("{text}\n")).unwrap();
        }
        root
    }

    #[test]
    fn threads_caches_nodes_and_speeds_are_read_from_sysfs() {
        let cpu = |i: usize, name: &str| format!("sys/devices/system/cpu/cpu{i}/{name}");
        let mut files = vec![
            ("sys/devices/system/node/online".to_owned(), "0-1"),
            ("sys/devices/system/node/node0/cpulist".to_owned(), "0,2"),
            ("sys/devices/system/node/node1/cpulist".to_owned(), "1,3"),
            ("sys/devices/cpu_atom/cpus".to_owned(), "3"),
        ];
        for (i, siblings, cache) in
            [(0, "0,2", "0,2"), (2, "0,2", "0,2"), (1, "1", "1,3"), (3, "3", "1,3")]
        {
            files.push((cpu(i, "topology/thread_siblings_list"), siblings));
            files.push((cpu(i, "cache/index0/level"), "1"));
            files.push((cpu(i, "cache/index0/shared_cpu_list"), siblings));
            files.push((cpu(i, "cache/index3/level"), "3"));
            files.push((cpu(i, "cache/index3/shared_cpu_list"), cache));
        }
        files.push((cpu(1, "cpu_capacity"), "446"));
        let files: Vec<(&str, &str)> = files.iter().map(|(name, text)| (&**name, *text)).collect();
        let root = machine(&files);
        let core = |threads: &[usize], cache, node, speed| Core {
            threads: threads.to_vec(),
            cache_id: cache,
            numa_node: node,
            speed,
        };
        let all = Topology::read(root.path(), &[0, 1, 2, 3]);
        assert_eq!(
            all.cores,
            [core(&[0, 2], 0, 0, 1024), core(&[1], 1, 1, 446), core(&[3], 1, 1, SMALL_SPEED)]
        );
        let some = Topology::read(root.path(), &[2, 3]);
        assert_eq!(some.cores, [core(&[2], 0, 0, 1024), core(&[3], 1, 1, SMALL_SPEED)]);
        assert_eq!((all.whole_cores(), some.whole_cores(), all.quota_cores), (3, 2, None));
    }

    #[test]
    fn missing_sysfs_gives_one_thread_per_core_within_the_quota() {
        let files = [("proc/self/cgroup", "0::/"), ("sys/fs/cgroup/cpu.max", "150000 100000")];
        let topology = Topology::read(machine(&files).path(), &[4, 6]);
        let threads: Vec<_> = topology.cores.iter().map(|core| core.threads.clone()).collect();
        assert_eq!((threads, topology.quota_cores), (vec![vec![4], vec![6]], Some(1.5)));
        assert_eq!(topology.whole_cores(), 1);
    }
}
