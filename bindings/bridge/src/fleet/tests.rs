use super::*;
use experiment::examples::row_of_three;
use experiment::scenario::Fault;
use protocol::brief::Brief as _;

const TWO_HOST_FLEET: &str = "\
plant = \"a\"
latency_max_s = 0.02
[[host]]
name = \"a\"
address = \"127.0.0.1:7501\"
robots = [\"r1\", \"r2\"]
[[host]]
name = \"b\"
address = \"[::1]:7502\"
robots = [\"r3\"]
";

fn parse_fleet(text: &str) -> Result<Fleet, String> {
    parse_text(Path::new("fleet.toml"), text).map_err(|diagnostic| diagnostic.render(false))
}

#[test]
fn bridge_brief_has_hosts_and_robots_of_the_fleet() {
    let fleet = parse_fleet(TWO_HOST_FLEET).unwrap();
    let scenario = row_of_three();
    let names: Vec<&str> = scenario.robots.iter().map(|robot| robot.name.as_str()).collect();
    assert_eq!(names, ["r1", "r2", "r3"]);
    assert_eq!(fleet.hosts_of_robots(&scenario).unwrap(), [0, 0, 1]);
    assert_eq!((fleet.latency_max_ns, fleet.plant_host), (20_000_000, 0));
    let brief = fleet.bridge_brief(1, &scenario, "text").unwrap();
    assert_eq!((brief.here, brief.plant, brief.hosts.len()), (1, 0, 2));
    let text = brief.to_toml();
    let again: BridgeBrief = toml::from_str(&text).unwrap();
    assert_eq!(again, brief);
    assert_ne!(fleet.bridge_brief(1, &scenario, "other").unwrap().experiment, brief.experiment);
    assert_eq!(fleet.bridge_brief(0, &scenario, "text").unwrap().experiment, brief.experiment);
}

#[test]
fn fleet_file_error_names_line_and_key() {
    for (find, replace, words) in [
        ("plant = \"a\"", "plant = \"c\"", ["is \"c\", which is no host", "expected one of a, b"]),
        ("plant", "plnat", ["no key `plnat`", "did you mean `plant`"]),
        ("\"b\"", "\"a\"", ["is \"a\" again", "another name"]),
        ("\"b\"", "\"b c\"", ["is \"b c\"", "letters, digits"]),
        ("\"[::1]:7502\"", "\"::1:7502\"", ["is \"::1:7502\"", "an address and a port"]),
        ("\"[::1]:7502\"", "\"127.0.0.1:7501\"", ["that of a", "another address"]),
        ("\"[::1]:7502\"", "\"127.0.0.1\"", ["is \"127.0.0.1\"", "an address and a port"]),
        ("[\"r3\"]", "[\"r2\"]", ["already on host a", "each robot on one host"]),
        ("latency_max_s = 0.02", "latency_max_s = -1", ["latency_max_s", "expected"]),
        ("latency_max_s = 0.02", "transport = \"udp\"\ncertificates = \"k\"", ["with UDP", "tcp"]),
    ] {
        let error = parse_fleet(&TWO_HOST_FLEET.replacen(find, replace, 1)).unwrap_err();
        assert!(words.iter().all(|word| error.contains(word)), "{replace}:\n{error}");
        assert!(error.contains("fleet.toml:"), "{error}");
    }
    let one = TWO_HOST_FLEET.split("[[host]]\nname = \"b\"").next().unwrap();
    assert!(parse_fleet(one).unwrap_err().contains("has 1 hosts"));
}

#[test]
fn fleet_mismatch_with_scenario_is_explained() {
    let mut scenario = row_of_three();
    let without = parse_fleet(&TWO_HOST_FLEET.replace("[\"r1\", \"r2\"]", "[\"r1\"]")).unwrap();
    let error = without.hosts_of_robots(&scenario).unwrap_err().to_string();
    assert!(error.contains("no host for r2"), "{error}");
    let other = parse_fleet(&TWO_HOST_FLEET.replace("\"r3\"", "\"r3\", \"r9\"")).unwrap();
    let error = other.hosts_of_robots(&scenario).unwrap_err().to_string();
    assert!(error.contains("\"r9\"") && error.contains("such as r1"), "{error}");
    let two = parse_fleet(TWO_HOST_FLEET).unwrap();
    assert!(two.find_host("z").unwrap_err().to_string().contains("expected one of a, b"));
    for (hosts, word) in [(vec!["z"], "no host of the fleet"), (vec!["a", "b"], "all hosts")] {
        let hosts = hosts.into_iter().map(str::to_owned).collect();
        scenario.faults =
            vec![Fault { start_ns: 1, duration_ns: None, kind: FaultKind::Partition { hosts } }];
        let error = two.bridge_brief(0, &scenario, "").unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn public_address_without_certificates_is_refused() {
    assert_eq!(parse_fleet(TWO_HOST_FLEET).unwrap().check_certificates_configured(), Ok(()));
    for address in ["0.0.0.0:7502", "192.168.1.2:7502", "robot-7:7502", "[fe80::1]:7502"] {
        let open = parse_fleet(&TWO_HOST_FLEET.replace("[::1]:7502", address)).unwrap();
        let error = open.check_certificates_configured().unwrap_err().to_string();
        assert!(error.contains(address) && error.contains("--insecure"), "{error}");
        let mut closed = open;
        closed.certificates = Some("keys".into());
        assert_eq!(closed.check_certificates_configured(), Ok(()));
        let error = closed.bridge_brief(0, &row_of_three(), "").unwrap_err().to_string();
        assert!(error.contains("ca.pem"), "{error}");
    }
    let named = parse_fleet(&TWO_HOST_FLEET.replace("[::1]", "localhost")).unwrap();
    assert_eq!(named.check_certificates_configured(), Ok(()));
}
