//! THE table of the format of fleet files, in the rows of which scenarios are made too; and the page
//! of the book that lists them.

use experiment::reference::sections;
use experiment::scenario::keys::{Format, Key, Otherwise, Range, Section, Takes, key};

/// What carries frames: words of `transport`.
pub(crate) const TRANSPORTS: &[(&str, &str)] = &[
    ("tcp", "TCP: nothing is lost, and what is lost below comes late"),
    ("udp", "UDP: what is lost below is lost, and nothing waits for it; without certificates only"),
];

const ROOT: &[Key] = &[
    key("description", Takes::Text, Otherwise::Absent, "what it is about")
        .guessed(&["comment", "about", "notes"]),
    key(
        "plant",
        Takes::Text,
        Otherwise::Needed,
        "the host of the plant, which coordinates the run, collects what came out, and judges it",
    )
    .guessed(&["coordinator", "master", "main"]),
    key(
        "latency_max_s",
        Takes::Time(Range::NotNegative),
        Otherwise::Number(0.01),
        "L: how long a sample from the plant to a robot of another host and the answer to it may be under way \
         together; the command lifetime H grows by it, rounded up to whole periods, and commands that take longer \
         are refused",
    )
    .guessed(&["latency_s", "delay_s", "latency_allowed_s", "latency_max_ms"]),
    key(
        "transport",
        Takes::Word(TRANSPORTS),
        Otherwise::Word("tcp"),
        "what carries samples between hosts",
    )
    .guessed(&["protocol"]),
    key(
        "certificates",
        Takes::Text,
        Otherwise::Rule("no TLS, and then addresses of this machine only, unless `--insecure`"),
        "the folder, as seen from the fleet file, with `ca.pem` and of this host `HOST.pem` and `HOST.key`",
    )
    .guessed(&["tls", "keys", "certs", "pki"]),
    key(
        "join_within_s",
        Takes::Time(Range::Positive),
        Otherwise::Number(60.0),
        "how long hosts wait for each other before the run",
    )
    .guessed(&["timeout_s", "wait_s"]),
    key(
        "unreachable_after_s",
        Takes::Time(Range::Positive),
        Otherwise::Number(1.0),
        "a host that was not heard for this long counts as unreachable",
    ),
    key(
        "silence_max_s",
        Takes::Time(Range::Positive),
        Otherwise::Number(25.0),
        "without a sign of the plant's host for this long, another host's share of the run ends",
    ),
    key("host", Takes::Tables("host"), Otherwise::Needed, "the hosts, two or more")
        .guessed(&["hosts", "machine", "machines", "node"]),
];

const HOST: &[Key] = &[
    key(
        "name",
        Takes::Text,
        Otherwise::Needed,
        "its name, and with certificates the common name of its own",
    )
    .guessed(&["id", "host", "hostname"]),
    key(
        "address",
        Takes::Text,
        Otherwise::Needed,
        "where the others reach it, as in \"192.168.1.10:7447\"",
    )
    .guessed(&["endpoint", "listen", "ip", "addr", "url"]),
    key("robots", Takes::Names, Otherwise::Rule("none"), "the robots that live there")
        .guessed(&["robot", "agents", "names"]),
];

/// The keys that fleet files may have.
pub fn format() -> Format {
    let section =
        |name, says, keys: &[Key]| Section { name, says, keys: keys.to_vec(), kinds: Vec::new() };
    Format {
        sections: vec![
            section("fleet", "Several hosts that run one scenario together.", ROOT),
            section("host", "One of them.", HOST),
        ],
        laws: Vec::new(),
        methods: Vec::new(),
    }
}

const HEAD: &str = "\
# Fleet files

Made of the table that the reader of fleet files uses, `bindings/bridge/src/keys.rs`. How to use them:
[several hosts](../fleet.md).

A key that is marked **needed** must be given where its table is.
";

/// The page of the book that lists every key, in Markdown.
pub fn reference() -> String {
    HEAD.to_owned() + &sections(&format(), "The whole fleet file")
}
