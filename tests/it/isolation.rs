//! An agent's process opens only its own services and the beacons of its in-neighbors. Checked from outside, with
//! iceoryx2's tags of its node and with the memory mappings that the kernel lists.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::harness::{RunInProgress, files_below, run};

#[test]
fn agent_opens_only_its_services_and_in_neighbor_beacons() {
    let in_neighbors = BTreeMap::from([("r1", "r2"), ("r2", "r3"), ("r3", "r1")]);
    let mut running = run("triangle").set("duration_s=60").start();
    running.wait_for_event("contact");
    let services = services(&running);
    assert_eq!(services.len(), 18, "{services:?}");
    for (pid, name) in running.children().iter().filter(|(_, name)| name != "plant") {
        let mut expected: BTreeSet<String> = ["odometry", "command", "beacon", "status", "latency"]
            .iter()
            .map(|service| format!("robot/{name}/{service}"))
            .collect();
        expected.insert(format!("robot/{}/beacon", in_neighbors[name.as_str()]));

        let tagged = tagged(&running, *pid, &services);
        assert_eq!(tagged, expected, "tags of {name}");
        let mapped = mapped(*pid);
        let open: BTreeSet<String> = services
            .values()
            .filter(|service| mapped.iter().any(|path| path.ends_with(&service.management)))
            .map(|service| service.name.clone())
            .collect();
        assert_eq!(open, expected, "mappings of {name}");
        // One data segment for each sender: four of the agent, one of the plant, one of the neighbor.
        let data = mapped.iter().filter(|path| path.ends_with(".data")).count();
        assert_eq!(data, 6, "{name}: {mapped:?}");
    }
}

/// r3 receives from r4, and from r5 instead while r4 is dead.
#[test]
fn agent_opens_a_spare_beacon_only_while_it_uses_the_spare() {
    let set = ["duration_s=60", "expect={}", "repair=spares", "repair_after_s=0.5"];
    let mut running = run("pentagon").sets(set).fault("kill r4 @3 restart 4").start();
    running.wait_for_event("contact");
    let services = services(&running);
    let spare = "robot/r5/beacon".to_owned();
    let r3 = running.pid_of("r3");
    let open = |running: &RunInProgress| -> [BTreeSet<String>; 2] {
        let mapped = mapped(r3);
        let is_mapped =
            |service: &&Service| mapped.iter().any(|path| path.ends_with(&service.management));
        let mapped = services.values().filter(is_mapped).map(|service| service.name.clone());
        [tagged(running, r3, &services), mapped.collect()]
    };
    let own = ["odometry", "command", "beacon", "status", "latency"];
    let mut without_spare: BTreeSet<String> = own.map(|what| format!("robot/r3/{what}")).into();
    without_spare.insert("robot/r4/beacon".into());
    let with_spare: BTreeSet<String> = without_spare.iter().cloned().chain([spare]).collect();
    // On a busy machine a robot may be lost and received again at any time: the open services converge to this.
    let mut wait_for_services = |what: &str, expected: &BTreeSet<String>| {
        running.wait_for(what, |running| {
            let [tagged, mapped] = open(running);
            assert!(
                tagged.is_subset(&with_spare) && mapped.is_subset(&with_spare),
                "{tagged:?} {mapped:?}"
            );
            (tagged == *expected && mapped == *expected).then_some(())
        });
    };
    wait_for_services("r3 hears r4", &without_spare);
    wait_for_services("r3 uses r5 while r4 is dead", &with_spare);
    wait_for_services("r3 hears r4 again", &without_spare);
}

#[derive(Debug)]
struct Service {
    name: String,
    /// Suffix of the name of the service's management segment.
    management: String,
}

/// Returns the services of the run by hash.
fn services(running: &RunInProgress) -> BTreeMap<String, Service> {
    let files = files_below(running.run_root());
    let described = files.iter().filter(|path| path.extension().is_some_and(|e| e == "service"));
    described
        .map(|path| {
            let text = std::fs::read_to_string(path).unwrap();
            let table: toml::Table = text.parse().unwrap();
            let id = &table["unique_service_id"];
            let part = |key: &str| id[key].as_integer().unwrap() as u64 as u128;
            let id = part("unique_value") << 64 | part("payload_value");
            let service = Service {
                name: table["service_name"].as_str().unwrap().into(),
                management: format!("_{id}.dynamic"),
            };
            (table["service_hash"].as_str().unwrap().to_owned(), service)
        })
        .collect()
}

/// Returns the names of the services that the node of process `pid` is tagged with.
fn tagged(
    running: &RunInProgress,
    pid: u32,
    services: &BTreeMap<String, Service>,
) -> BTreeSet<String> {
    let node = files_below(running.run_root())
        .into_iter()
        .filter(|path| path.extension().is_some_and(|end| end == "details"))
        .find(|path| {
            // The node of a dead process may be removed during the loop.
            let text = std::fs::read_to_string(path).unwrap_or_default();
            text.lines().any(|line| line == format!("process = {pid}"))
        })
        .unwrap_or_else(|| panic!("process {pid} has no node"));
    files_below(node.parent().unwrap())
        .iter()
        .filter_map(|path| path.file_name()?.to_str()?.strip_suffix(".service_tag"))
        .map(|tag| tag.rsplit('_').next().unwrap())
        .map(|hash| services[hash].name.clone())
        .collect()
}

/// Returns the files on tmpfs that the process has mapped.
fn mapped(pid: u32) -> BTreeSet<String> {
    let maps: PathBuf = Path::new("/proc").join(pid.to_string()).join("maps");
    let text = std::fs::read_to_string(maps).unwrap();
    let paths = text.lines().filter_map(|line| line.split_whitespace().nth(5));
    paths.filter(|path| path.starts_with("/dev/shm/")).map(str::to_owned).collect()
}
