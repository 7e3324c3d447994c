//! What breaks when, in words: on the command line, `kill r2 @10 restart 2`, and in reports.
//!
//! Here only the words are read. Whether there is such a robot, and whether it is alive then, is
//! asked in `faults`, where those of the file are read too: both become the same `[[fault]]` tables.

use protocol::fault::{Lie, LinkFaultKind, Sensor, SensorFaultKind, WheelFaultKind};
use toml_edit::{Array, Item, Table, value};

use super::diagnostic::{Shown, meant};
use super::{Fault, FaultKind, Scenario, Silenced, Struck, seconds as in_seconds};

/// How a kind of fault is written: as `KIND SUBJECT [WORD NUMBER]... @SECONDS [for SECONDS]` on the
/// command line, as keys in a file.
#[derive(Debug)]
pub(crate) struct Form {
    /// Value of the key `kind`, and first word.
    pub(crate) kind: &'static str,
    /// What it is, in one line.
    pub(crate) says: &'static str,
    /// Whom it strikes.
    subject: Subject,
    /// Whether it lasts: it may have `for_s`.
    lasts: bool,
    /// What else there may be.
    details: &'static [Detail],
    /// One line for people.
    pub(crate) grammar: &'static str,
}

/// Whom a fault strikes, and which keys say so.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Subject {
    /// `robot`.
    Robot,
    /// `from` and `to`: `r1->r2`.
    Link,
    /// `robot` and `stream`: `r1 commands`.
    Stream,
    /// `robot`: `r1 beacons`.
    Beacons,
    /// `robot` and `sensor`: `r1 proximity`.
    Sensor,
    /// `hosts`: `b`, or `b,c`.
    Hosts,
    /// Nobody.
    Machine,
}

/// A word of the command line, and the key that it stands for.
#[derive(Debug)]
struct Detail {
    word: &'static str,
    key: &'static str,
    value: DetailValue,
    needed: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum DetailValue {
    /// From 0.
    Number,
    /// A number of either sign.
    Signed,
    Whole,
    /// `[x, y]`.
    Pair,
    /// The word alone says it all.
    Yes,
}

const fn may(word: &'static str, value: DetailValue, key: &'static str) -> Detail {
    Detail { word, key, value, needed: false }
}

const fn needs(word: &'static str, value: DetailValue, key: &'static str) -> Detail {
    Detail { needed: true, ..may(word, value, key) }
}

/// A form without details, of a fault that lasts.
const fn form(kind: &'static str, subject: Subject, says: &'static str) -> Form {
    Form { kind, says, subject, lasts: true, details: &[], grammar: "" }
}

impl Form {
    const fn written(self, grammar: &'static str) -> Form {
        Form { grammar, ..self }
    }

    const fn with(self, details: &'static [Detail]) -> Form {
        Form { details, ..self }
    }

    const fn at_once(self) -> Form {
        Form { lasts: false, ..self }
    }
}

impl Subject {
    /// Which keys say whom it strikes, in the order of their words.
    fn keys(self) -> &'static [&'static str] {
        match self {
            Robot | Beacons => &["robot"],
            Link => &["from", "to"],
            Stream => &["robot", "stream"],
            Subject::Sensor => &["robot", "sensor"],
            Hosts => &["hosts"],
            Machine => &[],
        }
    }
}

use DetailValue::{Number, Pair, Signed, Whole, Yes};
use Subject::{Beacons, Hosts, Link, Machine, Robot, Stream};

const LOSS: &[Detail] = &[needs("of", Number, "probability"), may("burst", Whole, "burst")];
const BURSTS: &[Detail] =
    &[needs("of", Number, "probability"), needs("mean", Number, "mean_burst_s")];
const DELAY: &[Detail] = &[needs("by", Number, "delay_s"), may("jitter", Number, "jitter_s")];
const LIE: &[Detail] = &[
    may("by", Pair, "by_m"),
    may("drift", Pair, "drift_m_s"),
    may("random", Number, "random_m"),
    may("turn", Signed, "turn_rad"),
];

/// Every kind of fault; those that strike links and streams have a form for each.
pub(crate) const FORMS: &[Form] = &[
    form("kill", Robot, "SIGKILL of a robot's process, or of the plant")
        .written("kill ROBOT|plant @SECONDS [restart SECONDS]")
        .with(&[may("restart", Number, "restart_after_s")])
        .at_once(),
    form("freeze", Robot, "SIGSTOP of a robot's process, and SIGCONT at its end")
        .written("freeze ROBOT @SECONDS [for SECONDS]"),
    form("slow", Robot, "a robot that needs longer to answer")
        .written("slow ROBOT by SECONDS @SECONDS [for SECONDS]")
        .with(&[needs("by", Number, "delay_s")]),
    form("cut", Link, "a link that carries nothing")
        .written("cut FROM->TO @SECONDS [for SECONDS]"),
    form("loss", Link, "a link that loses beacons")
        .written("loss FROM->TO of SHARE [burst BEACONS] @SECONDS [for SECONDS]")
        .with(LOSS),
    form("loss", Stream, "a robot's odometry or commands, of which some are lost")
        .written("loss ROBOT odometry|commands of SHARE [burst MESSAGES] @SECONDS [for SECONDS]")
        .with(LOSS),
    form("bursts", Link, "a link that loses all beacons while it is bad, for times of random lengths (Gilbert-Elliott)")
        .written("bursts FROM->TO of SHARE mean SECONDS @SECONDS [for SECONDS]")
        .with(BURSTS),
    form("bursts", Stream, "the same of a robot's odometry or commands")
        .written("bursts ROBOT odometry|commands of SHARE mean SECONDS @SECONDS [for SECONDS]")
        .with(BURSTS),
    form("fading", Link, "a link that carries a beacon with probability exp(-(r / range)^exponent) over the distance r")
        .written("fading FROM->TO range METERS [exponent NUMBER] @SECONDS [for SECONDS]")
        .with(&[needs("range", Number, "range_m"), may("exponent", Number, "exponent")]),
    form("delay", Link, "a link that delays beacons")
        .written("delay FROM->TO by SECONDS [jitter SECONDS] @SECONDS [for SECONDS]")
        .with(DELAY),
    form("delay", Stream, "a robot's odometry or commands that come late")
        .written("delay ROBOT odometry|commands by SECONDS [jitter SECONDS] @SECONDS [for SECONDS]")
        .with(DELAY),
    form("lie", Link, "a robot that says what is not so to one that hears it, and moves as ever")
        .written("lie FROM->TO [by [X,Y]] [drift [VX,VY]] [random METERS] [turn RADIANS] @SECONDS [for SECONDS]")
        .with(LIE),
    form("lie", Beacons, "the same to all that hear it")
        .written("lie ROBOT beacons [by [X,Y]] [drift [VX,VY]] [random METERS] [turn RADIANS] @SECONDS [for SECONDS]")
        .with(LIE),
    form("blackout", Subject::Sensor, "a sensor that sees nothing")
        .written("blackout ROBOT odometry|proximity @SECONDS [for SECONDS]"),
    form("noise", Subject::Sensor, "a sensor that sees not exactly")
        .written("noise ROBOT odometry|proximity by METERS [heading RADIANS] @SECONDS [for SECONDS]")
        .with(&[needs("by", Number, "bound_m"), may("heading", Number, "heading_bound_rad")]),
    form("wheels", Robot, "wheels that are stuck, or slow")
        .written("wheels ROBOT stuck|limit M_PER_S @SECONDS [for SECONDS]")
        .with(&[may("stuck", Yes, "stuck"), may("limit", Number, "speed_max_m_s")]),
    form("partition", Hosts, "hosts of a fleet and all others, which cannot hear each other (runs with --fleet only)")
        .written("partition HOST[,HOST...] @SECONDS [for SECONDS]"),
    form("load", Machine, "processes that take processor time from everybody")
        .written("load of PROCESSES @SECONDS [for SECONDS]")
        .with(&[needs("of", Whole, "processes")]),
];

impl Form {
    /// The form of that kind which strikes what one robot sends or gets, if `of_robot`, or whatever
    /// else; the only one of a kind that has one.
    pub(crate) fn of(kind: &str, of_robot: bool) -> Option<&'static Form> {
        let mut forms = FORMS.iter().filter(|form| form.kind == kind);
        let suits = |form: &&Form| form.is_beside_links() == of_robot;
        forms.clone().find(suits).or_else(|| forms.next())
    }

    /// Whether it strikes what one robot sends or gets, where another of its kind strikes links.
    fn is_beside_links(&self) -> bool {
        matches!(self.subject, Stream | Beacons)
    }

    /// The keys that its table must have, beside `kind`.
    pub(crate) fn needs(&self) -> Vec<&'static str> {
        let details = self.details.iter().filter(|detail| detail.needed).map(|detail| detail.key);
        let subject = self.subject.keys().iter().copied();
        ["at_s"].into_iter().chain(subject).chain(details).collect()
    }

    /// The keys that it may have.
    pub(crate) fn may(&self) -> Vec<&'static str> {
        let details = self.details.iter().filter(|detail| !detail.needed).map(|detail| detail.key);
        details.chain(self.lasts.then_some("for_s")).collect()
    }
}

impl Fault {
    /// What it is and for how long, in words.
    pub fn words(&self, scenario: &Scenario) -> String {
        let (what, _) = self.kind.struck(scenario);
        let lasts = |ns| format!("{} s", in_seconds(ns));
        match (&self.kind, self.for_ns) {
            (FaultKind::KillPlant, _) => what,
            (FaultKind::Kill { restart_after_ns: None, .. }, _) => format!("{what}, for good"),
            (FaultKind::Kill { restart_after_ns: Some(after_ns), .. }, _) => {
                format!("{what}, back after {}", lasts(*after_ns))
            }
            (_, None) => format!("{what}, to the end"),
            (_, Some(for_ns)) => format!("{what}, for {}", lasts(for_ns)),
        }
    }
}

impl FaultKind {
    /// What it is, in words, and whom it strikes.
    pub fn struck(&self, scenario: &Scenario) -> (String, Struck) {
        let name = |robot: usize| scenario.robots[robot].name.as_str();
        let strikes = |robot| Struck { robot: Some(robot), ..Struck::default() };
        let silences = |robot| Struck { silenced: Silenced::Robot(robot), ..strikes(robot) };
        match *self {
            FaultKind::Kill { robot, .. } => (format!("kill {}", name(robot)), silences(robot)),
            FaultKind::KillPlant => ("kill plant".to_owned(), Struck::default()),
            FaultKind::Freeze { robot } => (format!("freeze {}", name(robot)), silences(robot)),
            FaultKind::Slow { robot, delay_ns } => {
                (format!("slow {} by {}", name(robot), in_seconds(delay_ns)), strikes(robot))
            }
            FaultKind::Link { edge, ref kind } => {
                let ends = scenario.graph.edges()[edge];
                let what = failing(&format!("{}->{}", name(ends.from), name(ends.to)), kind);
                let silenced = match kind {
                    LinkFaultKind::Cut => Silenced::Edge(edge),
                    LinkFaultKind::Loss { .. }
                    | LinkFaultKind::Bursts { .. }
                    | LinkFaultKind::Fading { .. }
                    | LinkFaultKind::Delay { .. } => Silenced::Nobody,
                };
                let (robot, hearer) = (Some(ends.from), Some(ends.to));
                (what, Struck { robot, hearer, silenced, lies: false })
            }
            FaultKind::Lie { robot, hearer, ref lie } => {
                let whom = match hearer {
                    Some(hearer) => format!("{}->{}", name(robot), name(hearer)),
                    None => format!("{} beacons", name(robot)),
                };
                (lying(&whom, lie), Struck { hearer, lies: true, ..strikes(robot) })
            }
            FaultKind::Stream { robot, stream, ref kind } => {
                (failing(&format!("{} {}", name(robot), stream.word()), kind), strikes(robot))
            }
            FaultKind::Sensor { robot, sensor, kind } => {
                let word = match sensor {
                    Sensor::Odometry => "odometry",
                    Sensor::Proximity => "proximity",
                };
                let what = match kind {
                    SensorFaultKind::Blackout => format!("blackout {} {word}", name(robot)),
                    SensorFaultKind::Noise { bound_m, heading_bound_rad: 0.0 } => {
                        format!("noise {} {word} by {}", name(robot), Shown(bound_m))
                    }
                    SensorFaultKind::Noise { bound_m, heading_bound_rad } => {
                        let (robot, bound_m) = (name(robot), Shown(bound_m));
                        let heading_rad = Shown(heading_bound_rad);
                        format!("noise {robot} {word} by {bound_m} heading {heading_rad}")
                    }
                };
                // Who does not know where it is says nothing about it.
                match (sensor, kind) {
                    (Sensor::Odometry, SensorFaultKind::Blackout) => (what, silences(robot)),
                    _ => (what, strikes(robot)),
                }
            }
            FaultKind::Wheels { robot, kind } => {
                let what = match kind {
                    WheelFaultKind::Stuck => format!("wheels {} stuck", name(robot)),
                    WheelFaultKind::Limit { speed_max_m_s } => {
                        format!("wheels {} limit {}", name(robot), Shown(speed_max_m_s))
                    }
                };
                (what, strikes(robot))
            }
            FaultKind::Partition { ref hosts } => {
                (format!("partition {}", hosts.join(",")), Struck::default())
            }
            FaultKind::Load { processes } => (format!("load {processes}"), Struck::default()),
        }
    }

    /// Whether it acts in agents, plant or bridges by their briefs, with nobody doing anything.
    pub fn acts_by_brief(&self) -> bool {
        match self {
            FaultKind::Slow { .. }
            | FaultKind::Link { .. }
            | FaultKind::Stream { .. }
            | FaultKind::Lie { .. }
            | FaultKind::Sensor { .. }
            | FaultKind::Wheels { .. }
            | FaultKind::Partition { .. } => true,
            FaultKind::Kill { .. }
            | FaultKind::KillPlant
            | FaultKind::Freeze { .. }
            | FaultKind::Load { .. } => false,
        }
    }
}

/// What is wrong with a link or a stream, in words.
fn failing(link: &str, kind: &LinkFaultKind) -> String {
    match *kind {
        LinkFaultKind::Cut => format!("cut {link}"),
        LinkFaultKind::Loss { probability, burst: 1 } => {
            format!("loss {link} of {}", Shown(probability))
        }
        LinkFaultKind::Loss { probability, burst } => {
            format!("loss {link} of {} burst {burst}", Shown(probability))
        }
        LinkFaultKind::Bursts { probability, mean_burst_ns } => {
            let probability = Shown(probability);
            format!("bursts {link} of {probability} mean {}", in_seconds(mean_burst_ns))
        }
        LinkFaultKind::Fading { range_m, exponent } => {
            format!("fading {link} range {} exponent {}", Shown(range_m), Shown(exponent))
        }
        LinkFaultKind::Delay { delay_ns, jitter_ns: 0 } => {
            format!("delay {link} by {}", in_seconds(delay_ns))
        }
        LinkFaultKind::Delay { delay_ns, jitter_ns } => {
            let (by_s, jitter_s) = (in_seconds(delay_ns), in_seconds(jitter_ns));
            format!("delay {link} by {by_s} jitter {jitter_s}")
        }
    }
}

/// What a robot lies, in words.
fn lying(whom: &str, lie: &Lie) -> String {
    let &Lie { by_m, drift_m_s, random_m, turn_rad } = lie;
    let mut words = format!("lie {whom}");
    for (word, [x, y]) in [("by", by_m), ("drift", drift_m_s)] {
        if [x, y] != [0.0, 0.0] {
            words += &format!(" {word} [{}, {}]", Shown(x), Shown(y));
        }
    }
    for (word, number) in [("random", random_m), ("turn", turn_rad)] {
        if number != 0.0 {
            words += &format!(" {word} {}", Shown(number));
        }
    }
    words
}

/// Why an argument is no fault, and how it would be one.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct FaultError {
    reason: String,
    /// How the fault that was meant is written, or all of them.
    pub expected: String,
}

/// The keys of the `[[fault]]` table that `argument` stands for.
pub fn parse(argument: &str) -> Result<Table, FaultError> {
    let mut words = argument.split_whitespace();
    let kind = words.next().unwrap_or_default();
    // A link is written with an arrow.
    let is_link = words.clone().next().is_some_and(|subject| subject.contains("->"));
    let of_robot = !is_link && words.clone().next().is_some();
    let Some(form) = Form::of(kind, of_robot) else {
        let mut kinds: Vec<&str> = FORMS.iter().map(|form| form.kind).collect();
        kinds.dedup();
        let reason = match kind {
            "" => "it is empty".to_owned(),
            kind => format!("there is no fault `{kind}`"),
        };
        let expected = match meant(kind, kinds.iter().copied()) {
            Some(close) => format!("did you mean `{close}`?"),
            None => format!("expected one of {}, such as kill r2 @10 restart 2", kinds.join(", ")),
        };
        return Err(FaultError { reason, expected });
    };
    let wrong =
        |reason: String| FaultError { reason, expected: format!("expected {}", form.grammar) };
    let no_word = |word: &str, reason: String| {
        let known = form.grammar.split(|sign: char| !sign.is_ascii_lowercase());
        let mistaken = wrong(reason);
        match meant(word, known.filter(|known| !known.is_empty())) {
            Some(close) => FaultError {
                expected: format!("did you mean `{close}`? {}", mistaken.expected),
                ..mistaken
            },
            None => mistaken,
        }
    };
    let mut table = Table::new();
    table["kind"] = value(kind);
    for &key in form.subject.keys().iter().filter(|key| **key != "to") {
        let needs = |what: &str| wrong(format!("`{kind}` needs {what}"));
        let word = words.next();
        let item = match key {
            "from" => {
                let link = word.and_then(|link| link.split_once("->"));
                let (from, to) = link.ok_or_else(|| needs("a link, such as r1->r2"))?;
                table["from"] = value(from);
                table["to"] = value(to);
                continue;
            }
            "hosts" => {
                let hosts = word.filter(|word| !word.starts_with('@'));
                let hosts = hosts.ok_or_else(|| needs("a host of the fleet"))?;
                value(Array::from_iter(hosts.split(',')))
            }
            "stream" => {
                let stream = word.filter(|word| ["odometry", "commands"].contains(word));
                let what = "a link, such as r1->r2, or a robot's odometry or commands";
                let reason = || format!("`{kind}` needs {what}");
                value(stream.ok_or_else(|| no_word(word.unwrap_or_default(), reason()))?)
            }
            key => value(word.ok_or_else(|| needs(&format!("a {key}")))?),
        };
        table[key] = item;
    }
    let beacons = if form.subject == Beacons { words.next() } else { Some("beacons") };
    if beacons != Some("beacons") {
        let reason = format!("`{kind}` needs a link, such as r1->r2, or a robot's beacons");
        return Err(no_word(beacons.unwrap_or_default(), reason));
    }
    while let Some(word) = words.next() {
        let of_time = match word {
            "for" if form.lasts => Some("for_s"),
            _ => None,
        };
        let detail = form.details.iter().find(|detail| detail.word == word);
        let (key, item) = match (word.strip_prefix('@'), of_time, detail) {
            (Some(at), ..) => ("at_s", value(parsed(at).map_err(wrong)?)),
            (None, Some(key), _) => (key, value(number_after(word, &mut words).map_err(wrong)?)),
            (None, None, Some(detail)) => (detail.key, detail.read(&mut words).map_err(wrong)?),
            (None, None, None) => {
                return Err(no_word(word, format!("`{word}` has no place here")));
            }
        };
        if table.contains_key(key) {
            return Err(wrong(format!("`{word}` says again what was said before")));
        }
        table[key] = item;
    }
    if !table.contains_key("at_s") {
        return Err(wrong(format!("`{kind}` needs a time, such as @10")));
    }
    Ok(table)
}

impl Detail {
    /// The value that follows its word.
    fn read<'w>(&self, words: &mut impl Iterator<Item = &'w str>) -> Result<Item, String> {
        let word = self.word;
        Ok(match self.value {
            Yes => value(true),
            Number => value(number_after(word, words)?),
            Whole => {
                let number = number_after(word, words)?;
                if number.fract() != 0.0 || number > 1e9 {
                    return Err(format!("`{word} {number}` is not a whole number"));
                }
                value(number as i64)
            }
            Signed => {
                let number = words.next().ok_or(format!("`{word}` needs a number after it"))?;
                let wrong = || format!("`{number}` is not a number");
                value(number.parse().ok().filter(|n: &f64| n.is_finite()).ok_or_else(wrong)?)
            }
            Pair => {
                let mut text = String::new();
                while !text.ends_with(']') {
                    let next = words.next();
                    text += next.ok_or(format!("`{word}` needs two numbers after it: [x, y]"))?;
                }
                let inner = text.strip_prefix('[').and_then(|text| text.strip_suffix(']'));
                let numbers = inner.unwrap_or_default().split(',').map(str::parse::<f64>);
                let numbers: Vec<f64> = numbers.filter_map(Result::ok).collect();
                if numbers.len() != 2 || numbers.iter().any(|number| !number.is_finite()) {
                    return Err(format!("`{text}` is not two numbers: [x, y]"));
                }
                value(Array::from_iter(numbers))
            }
        })
    }
}

fn number_after<'w>(word: &str, words: &mut impl Iterator<Item = &'w str>) -> Result<f64, String> {
    parsed(words.next().ok_or_else(|| format!("`{word}` needs a number after it"))?)
}

/// A number from 0, written as Rust writes one.
fn parsed(word: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        Ok(number) if number.is_finite() && number >= 0.0 => Ok(number),
        _ => Err(format!("`{word}` is not a number from 0")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Arguments, and the table that a file would hold.
    const FAULTS: &str = "\
kill r2 @10 restart 2 => kind = 'kill', robot = 'r2', at_s = 10.0, restart_after_s = 2.0
  kill plant   @0.5 => kind = 'kill', robot = 'plant', at_s = 0.5
freeze r2 @12 for 1.5 => kind = 'freeze', robot = 'r2', at_s = 12.0, for_s = 1.5
slow r2 by 0.01 @5 => kind = 'slow', robot = 'r2', delay_s = 0.01, at_s = 5.0
cut r1->r2 for 5 @1 => kind = 'cut', from = 'r1', to = 'r2', for_s = 5.0, at_s = 1.0
loss a->b of 0.3 burst 5 @1 => kind = 'loss', from = 'a', to = 'b', probability = 0.3, burst = 5, at_s = 1.0
delay a->b by 0.02 jitter 0.01 @0 => kind = 'delay', from = 'a', to = 'b', delay_s = 0.02, jitter_s = 0.01, at_s = 0.0
blackout r2 proximity @5 => kind = 'blackout', robot = 'r2', sensor = 'proximity', at_s = 5.0
noise r2 odometry by 0.01 @5 => kind = 'noise', robot = 'r2', sensor = 'odometry', bound_m = 0.01, at_s = 5.0
noise r2 odometry by 0 heading 0.02 @5 => kind = 'noise', robot = 'r2', sensor = 'odometry', bound_m = 0.0, heading_bound_rad = 0.02, at_s = 5.0
wheels r2 stuck @5 => kind = 'wheels', robot = 'r2', stuck = true, at_s = 5.0
wheels r2 limit 0.2 @5 => kind = 'wheels', robot = 'r2', speed_max_m_s = 0.2, at_s = 5.0
load of 2 @5 => kind = 'load', processes = 2, at_s = 5.0
partition b,c @5 for 2 => kind = 'partition', hosts = ['b', 'c'], at_s = 5.0, for_s = 2.0
bursts a->b of 0.2 mean 0.1 @1 => kind = 'bursts', from = 'a', to = 'b', probability = 0.2, mean_burst_s = 0.1, at_s = 1.0
fading a->b range 4 exponent 3 @1 => kind = 'fading', from = 'a', to = 'b', range_m = 4.0, exponent = 3.0, at_s = 1.0
loss * commands of 0.2 @0 => kind = 'loss', robot = '*', stream = 'commands', probability = 0.2, at_s = 0.0
lie r3 beacons by [0.5, -0.25] @10 for 20 => kind = 'lie', robot = 'r3', by_m = [0.5, -0.25], at_s = 10.0, for_s = 20.0
lie a->b drift [0,1e-2] random 0.2 turn -0.5 @1 => kind = 'lie', from = 'a', to = 'b', drift_m_s = [0.0, 0.01], random_m = 0.2, turn_rad = -0.5, at_s = 1.0
delay r1 odometry by 0.04 jitter 0.01 @1 for 2 => kind = 'delay', robot = 'r1', stream = 'odometry', delay_s = 0.04, jitter_s = 0.01, at_s = 1.0, for_s = 2.0";

    /// Arguments, and what of each is named.
    const MISTAKES: &str = "\
explode r2 @1 => no fault `explode`
kill => needs a robot
kill r2 => needs a time
kill r2 10 => `10` has no place
kill r2 @ten => `ten` is not a number
kill r2 @inf => `inf` is not a number
kill r2 @-1 => `-1` is not a number
kill r2 @1 restart => `restart` needs a number
kill r2 @1 again 2 => `again` has no place
kill r2 @1 restart 2 3 => `3` has no place
kill r2 @1 @2 => `@2` says again
kill r2 @1 for 2 => `for` has no place
cut r1 @1 => needs a link
loss r1 @1 => needs a link, such as r1->r2, or a robot's odometry
delay r1 proximity by 1 @1 => needs a link, such as r1->r2, or a robot's odometry
delay => needs a link
noise r1 => needs a sensor
lie r1 by [1, 0] @1 => needs a link, such as r1->r2, or a robot's beacons
lie r1 beacons by [1, nan] @1 => `[1,nan]` is not two numbers
lie r1 beacons by [1] @1 => `[1]` is not two numbers
lie r1 beacons by [1, 2 @1 => needs two numbers
lie r1->r2 turn inf @1 => `inf` is not a number
partition @1 => needs a host
load of 1.5 @1 => `of 1.5` is not a whole number";

    fn rows(table: &'static str) -> impl Iterator<Item = (&'static str, &'static str)> {
        table.lines().map(|line| line.split_once(" => ").unwrap())
    }

    #[test]
    fn every_kind_becomes_the_table_that_a_file_would_hold() {
        for (argument, table) in rows(FAULTS) {
            let found = parse(argument).unwrap().to_string();
            assert_eq!(found.trim().replace('\n', ", ").replace('"', "'"), table, "{argument}");
        }
    }

    #[test]
    fn each_mistake_is_named() {
        for (argument, word) in rows(MISTAKES) {
            let error = parse(argument).unwrap_err();
            assert!(error.to_string().contains(word), "{argument}: {error}");
            assert!(!error.expected.is_empty());
        }
        assert!(parse(" ").unwrap_err().to_string().contains("empty"));
        for (argument, meant) in [
            ("frezze r1 @1", "freeze"),
            ("kill r2 @10 restrt 2", "restart"),
            ("freeze r2 @1 fro 2", "for"),
            ("loss r2 odometri of 0.1 @2", "odometry"),
            ("lie r2 beacon by [1, 0] @2", "beacons"),
        ] {
            let expected = parse(argument).unwrap_err().expected;
            assert!(expected.starts_with(&format!("did you mean `{meant}`?")), "{expected}");
        }
        assert!(parse("kill r2 @1 flurb").unwrap_err().expected.starts_with("expected kill"));
    }
}
