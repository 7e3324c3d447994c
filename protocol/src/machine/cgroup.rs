//! CPU bandwidth limits of the control groups of this process, and how long they throttled it.
//!
//! A limit of a cgroup applies to all cgroups below it, so the cgroups above the own one count too. Supports
//! version 1 and version 2 at their usual mount points.

use std::fs;
use std::path::{Path, PathBuf};

/// A cgroup with a CPU bandwidth limit.
#[derive(Debug, Clone, PartialEq)]
pub struct LimitedCgroup {
    /// Permitted CPU time per wall time; 1.5 is one and a half cores.
    pub quota_cores: f64,
    /// File with the counter of its throttled time.
    pub stat_path: PathBuf,
}

/// Returns the limits that apply to this process, the own cgroup first. `root` is used in place of `/`.
pub fn find_limited_cgroups(root: &Path) -> Vec<LimitedCgroup> {
    let to_limited = |CgroupFolder { path, is_version_2 }: CgroupFolder| {
        let quota_cores = read_quota(&path, is_version_2)?;
        Some(LimitedCgroup { quota_cores, stat_path: path.join("cpu.stat") })
    };
    find_cgroup_folders(root, "cpu").into_iter().filter_map(to_limited).collect()
}

/// Folder of a cgroup.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CgroupFolder {
    /// Path of the folder.
    pub path: PathBuf,
    /// Whether the folder belongs to the unified hierarchy of cgroup version 2, and not to that of one controller.
    pub is_version_2: bool,
}

/// Returns the cgroups of this process and those above them that have this controller or are of version 2, the
/// own ones first. `root` is used in place of `/`.
pub fn find_cgroup_folders(root: &Path, controller: &str) -> Vec<CgroupFolder> {
    let groups = fs::read_to_string(root.join("proc/self/cgroup")).unwrap_or_default();
    // Fields: number, controllers (empty for version 2) and path.
    let folders = groups.lines().filter_map(|line| {
        let mut parts = line.splitn(3, ':').skip(1);
        let (controllers, path) = (parts.next()?, PathBuf::from(parts.next()?));
        let (mount, is_version_2) = match controllers {
            "" => ("sys/fs/cgroup".to_owned(), true),
            some if some.split(',').any(|name| name == controller) => {
                (format!("sys/fs/cgroup/{some}"), false)
            }
            _ => return None,
        };
        let mount = root.join(mount);
        let in_mount = |path: &Path| mount.join(path.strip_prefix("/").unwrap_or(path));
        let folders =
            path.ancestors().map(|path| CgroupFolder { path: in_mount(path), is_version_2 });
        Some(folders.collect::<Vec<_>>())
    });
    folders.flatten().collect()
}

/// Returns the limit of one cgroup; `None` if it has none.
fn read_quota(folder: &Path, is_version_2: bool) -> Option<f64> {
    let read = |name| fs::read_to_string(folder.join(name)).ok();
    let (quota, period) = if is_version_2 {
        let text = read("cpu.max")?;
        // The keyword `max` means no limit.
        let (quota, period) = text.trim().split_once(' ')?;
        (quota.parse().ok()?, period.parse().ok()?)
    } else {
        // -1 means no limit.
        let number = |name| read(name)?.trim().parse().ok();
        (number("cpu.cfs_quota_us")?, number("cpu.cfs_period_us")?)
    };
    let (quota, period): (f64, f64) = (quota, period);
    (quota > 0.0 && period > 0.0).then_some(quota / period)
}

/// Returns the throttled time of a cgroup, summed over cores, ns, from the text of its `cpu.stat`; `None` if it
/// has none.
pub fn parse_throttled_ns(stat: &str) -> Option<u64> {
    stat.lines().find_map(|line| {
        let (name, number) = line.split_once(' ')?;
        let number: u64 = number.trim().parse().ok()?;
        match name {
            "throttled_time" => Some(number),
            "throttled_usec" => Some(number.saturating_mul(1_000)),
            _ => None,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::machine_files::create_machine_files;

    fn limits_of_machine(files: &[(&str, &str)]) -> Vec<(f64, String)> {
        let root = create_machine_files(files);
        let limits = super::find_limited_cgroups(root.path()).into_iter();
        let relative =
            |path: PathBuf| path.strip_prefix(root.path()).unwrap().display().to_string();
        limits.map(|cgroup| (cgroup.quota_cores, relative(cgroup.stat_path))).collect()
    }

    #[test]
    fn limits_of_own_and_parent_cgroups_are_found() {
        let version_2 = limits_of_machine(&[
            ("proc/self/cgroup", "0::/docker/run"),
            ("sys/fs/cgroup/docker/run/cpu.max", "max 100000"),
            ("sys/fs/cgroup/docker/cpu.max", "150000 100000"),
        ]);
        assert_eq!(version_2, [(1.5, "sys/fs/cgroup/docker/cpu.stat".to_owned())]);
        let version_1 = limits_of_machine(&[
            ("proc/self/cgroup", "5:memory:/x\n3:cpu,cpuacct:/job\n0::/"),
            ("sys/fs/cgroup/cpu,cpuacct/job/cpu.cfs_quota_us", "70000"),
            ("sys/fs/cgroup/cpu,cpuacct/job/cpu.cfs_period_us", "100000"),
            ("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us", "50000"),
            ("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_period_us", "100000"),
        ]);
        let folder = "sys/fs/cgroup/cpu,cpuacct";
        assert_eq!(
            version_1,
            [(0.7, format!("{folder}/job/cpu.stat")), (0.5, format!("{folder}/cpu.stat"))]
        );
        assert_eq!(limits_of_machine(&[("proc/self/cgroup", "0::/")]), []);
        assert_eq!(limits_of_machine(&[]), []);
    }

    #[test]
    fn throttled_time_is_read_in_both_cgroup_versions() {
        for (stat, expected) in [
            ("nr_periods 12\nnr_throttled 9\nthrottled_time 720123456\n", Some(720_123_456)),
            ("usage_usec 5\nnr_throttled 1\nthrottled_usec 80123\n", Some(80_123_000)),
            ("usage_usec 5\nuser_usec 3\n", None),
        ] {
            assert_eq!(parse_throttled_ns(stat), expected);
        }
    }
}
