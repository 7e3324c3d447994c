//! Key table of fleet files, of the same kind as that of scenarios, and the reference page generated from it.

use experiment::reference::format_sections;
use experiment::scenario::fields::table_section;
use experiment::scenario::format::FileFormat;
use experiment::scenario::keys::NumberRange::{NotNegative, Positive};
use experiment::{keys, tables};

/// Values of `transport`: the transport protocol between hosts.
const TRANSPORTS: &[(&str, &str)] = &[
    ("tcp", "lossless; packets lost in the network are retransmitted and arrive late"),
    (
        "udp",
        "lossy; packets lost in the network stay lost and delay no other packet; only without certificates",
    ),
];

tables! {
    Fleet "fleet" "Several hosts that run one scenario together." has Fleet;
    Host "host" "One host of the fleet." has Host;
}

keys! {
    /// Keys of a fleet file.
    pub Fleet;

    description: Text =>
        .optional("description of the fleet, for readers of the file")
        .with_synonyms("comment about notes");
    plant: Text =>
        .required("name of the host that runs the plant. It coordinates the run, collects the results and evaluates the expectations")
        .with_synonyms("coordinator master main");
    latency_max_s: Time(NotNegative) =>
        .default("0.01", "L: maximum round-trip latency of a sample from the plant to a robot on another host and \
            its answer. The command lifetime H grows by it, rounded up to whole periods, and commands that take \
            longer are rejected")
        .with_synonyms("latency_s delay_s latency_allowed_s latency_max_ms");
    transport: Word<String>(TRANSPORTS) =>
        .default("'tcp'", "transport protocol between hosts")
        .with_synonyms("protocol");
    certificates: Text =>
        .rule("no TLS; only addresses of this machine are then allowed, unless `--insecure` is given", "folder, \
            relative to the fleet file, with `ca.pem` and the `HOST.pem` and `HOST.key` of this host")
        .with_synonyms("tls keys certs pki");
    join_within_s: Time(Positive) =>
        .default("60.0", "maximum time that hosts wait for each other before the run")
        .with_synonyms("timeout_s wait_s");
    unreachable_after_s: Time(Positive) =>
        .default("1.0", "time without a message from a host after which it counts as unreachable");
    silence_max_s: Time(Positive) =>
        .default("25.0", "time without a message from the plant's host after which another host ends its part of the run");
    host: Tables<Host> =>
        .required("the hosts, two or more")
        .with_synonyms("hosts machine machines node");
}

keys! {
    /// Keys of `[[host]]`.
    pub Host;

    name: Text =>
        .required("name of the host; with certificates also the common name of its certificate")
        .with_synonyms("id host hostname");
    address: Text =>
        .required("address at which the other hosts reach this host, as in \"192.168.1.10:7447\"")
        .with_synonyms("endpoint listen ip addr url");
    robots: Names =>
        .rule("none", "names of the robots whose agents run on this host")
        .with_synonyms("robot agents names");
}

/// Returns the format of fleet files.
pub fn fleet_file_format() -> FileFormat {
    FileFormat::without_catalog(vec![table_section::<Fleet>(), table_section::<Host>()])
}

const PAGE_HEAD: &str = "\
# Fleet files

Generated from the key table that the fleet parser uses, `bindings/bridge/src/keys.rs`. How to use them:
[several hosts](../fleet.md).

A key that is marked **needed** is required if its table is given.
";

/// Returns the reference page of fleet keys, in Markdown.
pub fn reference_page() -> String {
    PAGE_HEAD.to_owned() + &format_sections(&fleet_file_format(), "The whole fleet file")
}
