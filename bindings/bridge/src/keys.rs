//! Table of the keys of fleet files, in the format of the scenario table, and the page of the book that lists
//! them.

use experiment::reference::sections;
use experiment::scenario::keys::Range::{NotNegative, Positive};
use experiment::scenario::keys::Takes::{Names, Tables, Text, Time, Word};
use experiment::scenario::keys::{Format, Key, Section, key};

/// Transport protocols: values of `transport`.
const TRANSPORTS: &[(&str, &str)] = &[
    ("tcp", "TCP: nothing is lost, and what is lost below comes late"),
    ("udp", "UDP: what is lost below is lost, and nothing waits for it; without certificates only"),
];

fn root() -> Vec<Key> {
    vec![
        key("description", Text).optional("what it is about").guesses("comment about notes"),
        key("plant", Text)
            .needed("the host of the plant, which coordinates the run, collects what came out, and judges it")
            .guesses("coordinator master main"),
        key("latency_max_s", Time(NotNegative))
            .default("0.01", "L: how long a sample from the plant to a robot of another host and the answer to \
                 it may be under way together; the command lifetime H grows by it, rounded up to whole \
                 periods, and commands that take longer are refused")
            .guesses("latency_s delay_s latency_allowed_s latency_max_ms"),
        key("transport", Word(TRANSPORTS))
            .default("'tcp'", "what carries samples between hosts")
            .guesses("protocol"),
        key("certificates", Text)
            .rule("no TLS, and then addresses of this machine only, unless `--insecure`", "the folder, as seen \
                 from the fleet file, with `ca.pem` and of this host `HOST.pem` and `HOST.key`")
            .guesses("tls keys certs pki"),
        key("join_within_s", Time(Positive))
            .default("60.0", "how long hosts wait for each other before the run")
            .guesses("timeout_s wait_s"),
        key("unreachable_after_s", Time(Positive))
            .default("1.0", "a host that was not heard for this long counts as unreachable"),
        key("silence_max_s", Time(Positive))
            .default("25.0", "without a sign of the plant's host for this long, another host's share of the run ends"),
        key("host", Tables("host"))
            .needed("the hosts, two or more")
            .guesses("hosts machine machines node"),
    ]
}

fn host() -> Vec<Key> {
    vec![
        key("name", Text)
            .needed("its name, and with certificates the common name of its own")
            .guesses("id host hostname"),
        key("address", Text)
            .needed("where the others reach it, as in \"192.168.1.10:7447\"")
            .guesses("endpoint listen ip addr url"),
        key("robots", Names)
            .rule("none", "the robots that live there")
            .guesses("robot agents names"),
    ]
}

/// Returns the keys that fleet files may have.
pub fn format() -> Format {
    Format::plain(vec![
        Section::new("fleet", "Several hosts that run one scenario together.", root()),
        Section::new("host", "One of them.", host()),
    ])
}

const HEAD: &str = "\
# Fleet files

Made of the table that the reader of fleet files uses, `bindings/bridge/src/keys.rs`. How to use them:
[several hosts](../fleet.md).

A key that is marked **needed** must be given where its table is.
";

/// Returns the page of the book that lists every key, in Markdown.
pub fn reference() -> String {
    HEAD.to_owned() + &sections(&format(), "The whole fleet file")
}
