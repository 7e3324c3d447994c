//! Text form of faults, as on the command line (`kill r2 @10 restart 2`) and in reports.
//!
//! This module checks only the syntax. The text becomes a `[[fault]]` table like those of the file, and a table becomes
//! text, both by `FAULT_SYNTAXES`. `faults` converts between tables and faults, and checks that the robot exists and is
//! alive at that time.

use protocol::fault::{LinkFaultKind, Sensor, SensorFaultKind};
use toml_edit::{Array, Item, Table, Value, value};

use super::diagnostic::{DisplayedNumber, most_similar_word};
use super::{
    AffectedComponent, Fault, FaultKind, Scenario, SilencedSource, ns_to_seconds as in_seconds,
};

/// Syntax of a kind of fault: `KIND SUBJECT [WORD NUMBER]... @SECONDS [for SECONDS]` on the command line, keys in a
/// file.
#[derive(Debug)]
pub(crate) struct FaultSyntax {
    /// Value of the key `kind`, and first word on the command line.
    pub(crate) kind: &'static str,
    /// Description of the fault, in one line.
    pub(crate) description: &'static str,
    /// Component that the fault affects.
    target: FaultTarget,
    /// `true` if the fault has a duration and allows the key `for_s`.
    has_duration: bool,
    /// Parameters beyond subject, time and duration.
    parameters: &'static [ParameterSyntax],
    /// Syntax on the command line, in one line.
    pub(crate) grammar: &'static str,
}

/// Component that a fault affects, and the keys that name it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FaultTarget {
    /// A robot: `robot`.
    Robot,
    /// A link: `from` and `to`; `r1->r2` on the command line.
    Link,
    /// A message stream of a robot: `robot` and `stream`; `r1 commands` on the command line.
    Stream,
    /// All beacons of a robot: `robot`; `r1 beacons` on the command line.
    Beacons,
    /// A sensor of a robot: `robot` and `sensor`; `r1 proximity` on the command line.
    Sensor,
    /// Hosts of a fleet: `hosts`; `b` or `b,c` on the command line.
    Hosts,
    /// The machine; no key.
    Machine,
}

/// A keyword of the command line and the key that it sets.
#[derive(Debug)]
struct ParameterSyntax {
    keyword: &'static str,
    key: &'static str,
    value_type: ParameterType,
    is_required: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ParameterType {
    /// A number, at least 0.
    Number,
    /// A number of either sign.
    SignedNumber,
    Integer,
    /// `[x, y]`.
    Pair,
    /// No value: the keyword itself sets the key to `true`.
    Flag,
}

const fn optional_parameter(
    keyword: &'static str,
    value_type: ParameterType,
    key: &'static str,
) -> ParameterSyntax {
    ParameterSyntax { keyword, key, value_type, is_required: false }
}

const fn required_parameter(
    keyword: &'static str,
    value_type: ParameterType,
    key: &'static str,
) -> ParameterSyntax {
    ParameterSyntax { is_required: true, ..optional_parameter(keyword, value_type, key) }
}

/// Creates the syntax of a fault with a duration and without parameters.
const fn fault_syntax(
    kind: &'static str,
    target: FaultTarget,
    description: &'static str,
) -> FaultSyntax {
    FaultSyntax { kind, description, target, has_duration: true, parameters: &[], grammar: "" }
}

impl FaultSyntax {
    const fn with_grammar(self, grammar: &'static str) -> FaultSyntax {
        FaultSyntax { grammar, ..self }
    }

    const fn with_parameters(self, parameters: &'static [ParameterSyntax]) -> FaultSyntax {
        FaultSyntax { parameters, ..self }
    }

    const fn without_duration(self) -> FaultSyntax {
        FaultSyntax { has_duration: false, ..self }
    }
}

impl FaultTarget {
    /// Returns the keys that name the component, in their order on the command line.
    fn keys(self) -> &'static [&'static str] {
        match self {
            Robot | Beacons => &["robot"],
            Link => &["from", "to"],
            Stream => &["robot", "stream"],
            FaultTarget::Sensor => &["robot", "sensor"],
            Hosts => &["hosts"],
            Machine => &[],
        }
    }
}

use FaultTarget::{Beacons, Hosts, Link, Machine, Robot, Stream};
use ParameterType::{Flag, Integer, Number, Pair, SignedNumber};

const LOSS_PARAMETERS: &[ParameterSyntax] = &[
    required_parameter("of", Number, "probability"),
    optional_parameter("burst", Integer, "burst"),
];
const BURST_PARAMETERS: &[ParameterSyntax] = &[
    required_parameter("of", Number, "probability"),
    required_parameter("mean", Number, "mean_burst_s"),
];
const DELAY_PARAMETERS: &[ParameterSyntax] = &[
    required_parameter("by", Number, "delay_s"),
    optional_parameter("jitter", Number, "jitter_s"),
];
const LIE_PARAMETERS: &[ParameterSyntax] = &[
    optional_parameter("by", Pair, "by_m"),
    optional_parameter("drift", Pair, "drift_m_s"),
    optional_parameter("random", Number, "random_m"),
    optional_parameter("turn", SignedNumber, "turn_rad"),
    optional_parameter("scale", SignedNumber, "message_scale"),
    optional_parameter("offset", SignedNumber, "message_offset"),
    optional_parameter("noise", Number, "message_noise"),
    optional_parameter("flips", Number, "message_bit_flips"),
];

/// Syntaxes of all faults. A kind that affects links and also streams or beacons has a syntax for each.
pub(crate) const FAULT_SYNTAXES: &[FaultSyntax] = &[
    fault_syntax("kill", Robot, "kills the process of a robot, or the plant (SIGKILL)")
        .with_grammar("kill ROBOT|plant @SECONDS [restart SECONDS]")
        .with_parameters(&[optional_parameter("restart", Number, "restart_after_s")])
        .without_duration(),
    fault_syntax("freeze", Robot, "stops the process of a robot (SIGSTOP) and resumes it at the end of the fault (SIGCONT)")
        .with_grammar("freeze ROBOT @SECONDS [for SECONDS]"),
    fault_syntax("slow", Robot, "delays the answers of a robot, as if it computed slowly")
        .with_grammar("slow ROBOT by SECONDS @SECONDS [for SECONDS]")
        .with_parameters(&[required_parameter("by", Number, "delay_s")]),
    fault_syntax("cut", Link, "takes a link down")
        .with_grammar("cut FROM->TO @SECONDS [for SECONDS]"),
    fault_syntax("loss", Link, "drops beacons of a link at random")
        .with_grammar("loss FROM->TO of SHARE [burst BEACONS] @SECONDS [for SECONDS]")
        .with_parameters(LOSS_PARAMETERS),
    fault_syntax("loss", Stream, "drops odometry samples or commands of a robot at random")
        .with_grammar("loss ROBOT odometry|commands of SHARE [burst MESSAGES] @SECONDS [for SECONDS]")
        .with_parameters(LOSS_PARAMETERS),
    fault_syntax("bursts", Link, "drops all beacons of a link while it is in a bad state of random duration (Gilbert-Elliott model)")
        .with_grammar("bursts FROM->TO of SHARE mean SECONDS @SECONDS [for SECONDS]")
        .with_parameters(BURST_PARAMETERS),
    fault_syntax("bursts", Stream, "drops all odometry samples or commands of a robot during a bad state of random duration (Gilbert-Elliott model)")
        .with_grammar("bursts ROBOT odometry|commands of SHARE mean SECONDS @SECONDS [for SECONDS]")
        .with_parameters(BURST_PARAMETERS),
    fault_syntax("fading", Link, "delivers a beacon over the distance r with probability exp(-(r / range)^exponent)")
        .with_grammar("fading FROM->TO range METERS [exponent NUMBER] @SECONDS [for SECONDS]")
        .with_parameters(&[required_parameter("range", Number, "range_m"), optional_parameter("exponent", Number, "exponent")]),
    fault_syntax("delay", Link, "delays the beacons of a link")
        .with_grammar("delay FROM->TO by SECONDS [jitter SECONDS] @SECONDS [for SECONDS]")
        .with_parameters(DELAY_PARAMETERS),
    fault_syntax("delay", Stream, "delays the odometry samples or commands of a robot")
        .with_grammar("delay ROBOT odometry|commands by SECONDS [jitter SECONDS] @SECONDS [for SECONDS]")
        .with_parameters(DELAY_PARAMETERS),
    fault_syntax("lie", Link, "falsifies the beacons of a robot to one out-neighbor, and the messages of its law (Byzantine fault); its motion is unaffected")
        .with_grammar("lie FROM->TO [by [X,Y]] [drift [VX,VY]] [random METERS] [turn RADIANS] [scale NUMBER] [offset NUMBER] [noise NUMBER] [flips SHARE] @SECONDS [for SECONDS]")
        .with_parameters(LIE_PARAMETERS),
    fault_syntax("lie", Beacons, "falsifies the beacons of a robot to all out-neighbors, and the messages of its law (Byzantine fault); its motion is unaffected")
        .with_grammar("lie ROBOT beacons [by [X,Y]] [drift [VX,VY]] [random METERS] [turn RADIANS] [scale NUMBER] [offset NUMBER] [noise NUMBER] [flips SHARE] @SECONDS [for SECONDS]")
        .with_parameters(LIE_PARAMETERS),
    fault_syntax("blackout", FaultTarget::Sensor, "sensor dropout: a sensor of a robot gives no data")
        .with_grammar("blackout ROBOT odometry|proximity @SECONDS [for SECONDS]"),
    fault_syntax("noise", FaultTarget::Sensor, "adds a bounded random error to a sensor of a robot")
        .with_grammar("noise ROBOT odometry|proximity by METERS [heading RADIANS] @SECONDS [for SECONDS]")
        .with_parameters(&[required_parameter("by", Number, "bound_m"), optional_parameter("heading", Number, "heading_bound_rad")]),
    fault_syntax("wheels", Robot, "blocks the wheels of a robot or limits their speed")
        .with_grammar("wheels ROBOT stuck|limit M_PER_S @SECONDS [for SECONDS]")
        .with_parameters(&[optional_parameter("stuck", Flag, "stuck"), optional_parameter("limit", Number, "speed_max_m_s")]),
    fault_syntax("partition", Hosts, "network partition between some hosts of a fleet and the others (only with --fleet)")
        .with_grammar("partition HOST[,HOST...] @SECONDS [for SECONDS]"),
    fault_syntax("load", Machine, "starts extra processes that take CPU time from the others")
        .with_grammar("load of PROCESSES @SECONDS [for SECONDS]")
        .with_parameters(&[required_parameter("of", Integer, "processes")]),
];

impl FaultSyntax {
    /// Returns the syntax of `kind`, or `None` if there is no such kind. If the kind has several, `is_robot_stream`
    /// selects the one for a stream or the beacons of a robot.
    pub(crate) fn find(kind: &str, is_robot_stream: bool) -> Option<&'static FaultSyntax> {
        let mut syntaxes = FAULT_SYNTAXES.iter().filter(|syntax| syntax.kind == kind);
        let is_suitable =
            |syntax: &&FaultSyntax| syntax.affects_messages_of_robot() == is_robot_stream;
        syntaxes.clone().find(is_suitable).or_else(|| syntaxes.next())
    }

    /// Returns whether the fault affects a stream or the beacons of a robot.
    fn affects_messages_of_robot(&self) -> bool {
        matches!(self.target, Stream | Beacons)
    }

    /// Returns the keys that are required in addition to `kind`.
    pub(crate) fn required_keys(&self) -> Vec<&'static str> {
        let parameters = self
            .parameters
            .iter()
            .filter(|parameter| parameter.is_required)
            .map(|parameter| parameter.key);
        let target = self.target.keys().iter().copied();
        ["at_s"].into_iter().chain(target).chain(parameters).collect()
    }

    /// Returns the optional keys.
    pub(crate) fn optional_keys(&self) -> Vec<&'static str> {
        let parameters = self
            .parameters
            .iter()
            .filter(|parameter| !parameter.is_required)
            .map(|parameter| parameter.key);
        parameters.chain(self.has_duration.then_some("for_s")).collect()
    }
}

impl Fault {
    /// Returns the fault and its duration as text.
    pub fn describe(&self, scenario: &Scenario) -> String {
        let text = self.kind.describe(scenario);
        let duration = |ns| format!("{} s", in_seconds(ns));
        match (&self.kind, self.duration_ns) {
            (FaultKind::KillPlant, _) => text,
            (FaultKind::Kill { restart_after_ns: None, .. }, _) => format!("{text}, for good"),
            (FaultKind::Kill { restart_after_ns: Some(after_ns), .. }, _) => {
                format!("{text}, back after {}", duration(*after_ns))
            }
            (_, None) => format!("{text}, to the end"),
            (_, Some(duration_ns)) => format!("{text}, for {}", duration(duration_ns)),
        }
    }
}

impl FaultKind {
    /// Returns the fault without its times, in the syntax of the command line.
    pub fn describe(&self, scenario: &Scenario) -> String {
        let mut table = self.to_table(scenario);
        table.remove("restart_after_s");
        format_fault(&table)
    }

    /// Returns the component that the fault affects.
    pub fn affected_component(&self, scenario: &Scenario) -> AffectedComponent {
        let affects =
            |robot| AffectedComponent { robot: Some(robot), ..AffectedComponent::default() };
        let silenced = |robot| AffectedComponent {
            silenced_source: SilencedSource::Robot(robot),
            ..affects(robot)
        };
        match *self {
            FaultKind::Kill { robot, .. } | FaultKind::Freeze { robot } => silenced(robot),
            FaultKind::Slowdown { robot, .. }
            | FaultKind::Stream { robot, .. }
            | FaultKind::Wheels { robot, .. } => affects(robot),
            FaultKind::Link { edge, ref kind } => {
                let endpoints = scenario.graph.edges()[edge];
                let silenced_source = match kind {
                    LinkFaultKind::Cut => SilencedSource::Edge(edge),
                    _ => SilencedSource::NoSource,
                };
                let (robot, receiver) = (Some(endpoints.from), Some(endpoints.to));
                AffectedComponent { robot, receiver, silenced_source, is_byzantine: false }
            }
            FaultKind::Lie { robot, receiver, .. } => {
                AffectedComponent { receiver, is_byzantine: true, ..affects(robot) }
            }
            // A robot without odometry sends no beacons.
            FaultKind::Sensor {
                robot,
                sensor: Sensor::Odometry,
                kind: SensorFaultKind::Blackout,
            } => silenced(robot),
            FaultKind::Sensor { robot, .. } => affects(robot),
            FaultKind::KillPlant | FaultKind::Partition { .. } | FaultKind::Load { .. } => {
                AffectedComponent::default()
            }
        }
    }

    /// Returns whether the agents, the plant or the bridges apply the fault themselves, from their configuration. The
    /// supervisor applies the other faults.
    pub fn is_applied_by_processes(&self) -> bool {
        match self {
            FaultKind::Slowdown { .. }
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

/// Returns the `[[fault]]` table `table` in the syntax of the command line: the inverse of [`parse`].
///
/// # Panics
///
/// If the table lacks a key that its kind requires.
pub fn format_fault(table: &Table) -> String {
    let text = |key: &str| {
        let text = table.get(key).and_then(Item::as_str);
        text.unwrap_or_else(|| panic!("a fault has the text `{key}`"))
    };
    let kind = text("kind");
    let syntax =
        FaultSyntax::find(kind, table.contains_key("robot")).expect("a fault has a known kind");
    let mut parts = vec![kind.to_owned()];
    match syntax.target {
        Robot => parts.push(text("robot").to_owned()),
        Link => parts.push(format!("{}->{}", text("from"), text("to"))),
        Stream => parts.push(format!("{} {}", text("robot"), text("stream"))),
        Beacons => parts.push(format!("{} beacons", text("robot"))),
        FaultTarget::Sensor => parts.push(format!("{} {}", text("robot"), text("sensor"))),
        Hosts => {
            let hosts = table["hosts"].as_array().into_iter().flatten();
            let hosts: Vec<&str> = hosts.filter_map(|host| host.as_str()).collect();
            parts.push(hosts.join(","));
        }
        Machine => {}
    }
    for parameter in syntax.parameters {
        if let Some(value) = table.get(parameter.key) {
            parts.push(parameter.keyword.to_owned());
            parts.extend(format_number(value));
        }
    }
    parts.extend(table.get("at_s").and_then(format_number).map(|at| format!("@{at}")));
    parts.extend(
        table.get("for_s").and_then(format_number).map(|duration| format!("for {duration}")),
    );
    parts.join(" ")
}

/// Returns a number or a pair of numbers as text, or `None` for other values.
fn format_number(item: &Item) -> Option<String> {
    let number = |value: &Value| {
        let integer = value.as_integer().map(|integer| integer.to_string());
        integer.or_else(|| Some(DisplayedNumber(value.as_float()?).to_string()))
    };
    match item.as_value()? {
        Value::Array(pair) => {
            let numbers: Vec<String> = pair.iter().filter_map(number).collect();
            Some(format!("[{}]", numbers.join(", ")))
        }
        value => number(value),
    }
}

/// Syntax error in a fault on the command line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct FaultSyntaxError {
    reason: String,
    /// Remedy: the correct syntax, or the known kinds.
    pub remedy: String,
}

/// Parses a fault of the command line into a `[[fault]]` table.
///
/// # Errors
///
/// A syntax error: unknown kind, missing or repeated parameter, or invalid number.
pub fn parse(argument: &str) -> Result<Table, FaultSyntaxError> {
    let mut words = argument.split_whitespace();
    let kind = words.next().unwrap_or_default();
    // The syntax of a link has an arrow.
    let is_link = words.clone().next().is_some_and(|subject| subject.contains("->"));
    let is_robot_stream = !is_link && words.clone().next().is_some();
    let syntax =
        FaultSyntax::find(kind, is_robot_stream).ok_or_else(|| unknown_kind_error(kind))?;
    let error = |reason: String| FaultSyntaxError {
        reason,
        remedy: format!("expected {}", syntax.grammar),
    };
    let word_error = |word: &str, reason: String| {
        let known_words = syntax.grammar.split(|sign: char| !sign.is_ascii_lowercase());
        let syntax_error = error(reason);
        match most_similar_word(word, known_words.filter(|known| !known.is_empty())) {
            Some(close) => FaultSyntaxError {
                remedy: format!("did you mean `{close}`? {}", syntax_error.remedy),
                ..syntax_error
            },
            None => syntax_error,
        }
    };
    let mut table = Table::new();
    table["kind"] = value(kind);
    for &key in syntax.target.keys().iter().filter(|key| **key != "to") {
        let missing = |what: &str| error(format!("`{kind}` needs {what}"));
        let word = words.next();
        let item = match key {
            "from" => {
                let link = word.and_then(|link| link.split_once("->"));
                let (from, to) = link.ok_or_else(|| missing("a link, such as r1->r2"))?;
                table["from"] = value(from);
                table["to"] = value(to);
                continue;
            }
            "hosts" => {
                let hosts = word.filter(|word| !word.starts_with('@'));
                let hosts = hosts.ok_or_else(|| missing("a host of the fleet"))?;
                value(Array::from_iter(hosts.split(',')))
            }
            "stream" => {
                let stream = word.filter(|word| ["odometry", "commands"].contains(word));
                let what = "a link, such as r1->r2, or a robot's odometry or commands";
                let reason = || format!("`{kind}` needs {what}");
                value(stream.ok_or_else(|| word_error(word.unwrap_or_default(), reason()))?)
            }
            key => value(word.ok_or_else(|| missing(&format!("a {key}")))?),
        };
        table[key] = item;
    }
    let beacons = if syntax.target == Beacons { words.next() } else { Some("beacons") };
    if beacons != Some("beacons") {
        let reason = format!("`{kind}` needs a link, such as r1->r2, or a robot's beacons");
        return Err(word_error(beacons.unwrap_or_default(), reason));
    }
    while let Some(word) = words.next() {
        let duration_key = match word {
            "for" if syntax.has_duration => Some("for_s"),
            _ => None,
        };
        let parameter = syntax.parameters.iter().find(|parameter| parameter.keyword == word);
        let (key, item) = match (word.strip_prefix('@'), duration_key, parameter) {
            (Some(start), ..) => ("at_s", value(parse_nonnegative(start).map_err(error)?)),
            (None, Some(key), _) => {
                (key, value(parse_number_after(word, &mut words).map_err(error)?))
            }
            (None, None, Some(parameter)) => {
                (parameter.key, parameter.read(&mut words).map_err(error)?)
            }
            (None, None, None) => {
                return Err(word_error(word, format!("`{word}` is not expected here")));
            }
        };
        if table.contains_key(key) {
            return Err(error(format!("`{word}` is given twice")));
        }
        table[key] = item;
    }
    if !table.contains_key("at_s") {
        return Err(error(format!("`{kind}` needs a time, such as @10")));
    }
    Ok(table)
}

/// Returns the error for a fault that begins with a word other than a kind of fault.
fn unknown_kind_error(word: &str) -> FaultSyntaxError {
    let mut kinds: Vec<&str> = FAULT_SYNTAXES.iter().map(|form| form.kind).collect();
    kinds.dedup();
    let reason = match word {
        "" => "it is empty".to_owned(),
        word => format!("there is no fault `{word}`"),
    };
    let expected = match most_similar_word(word, kinds.iter().copied()) {
        Some(close) => format!("did you mean `{close}`?"),
        None => format!("expected one of {}, such as kill r2 @10 restart 2", kinds.join(", ")),
    };
    FaultSyntaxError { reason, remedy: expected }
}

impl ParameterSyntax {
    /// Parses the value after the keyword from `words`.
    fn read<'w>(&self, words: &mut impl Iterator<Item = &'w str>) -> Result<Item, String> {
        let word = self.keyword;
        Ok(match self.value_type {
            Flag => value(true),
            Number => value(parse_number_after(word, words)?),
            Integer => {
                let number = parse_number_after(word, words)?;
                if number.fract() != 0.0 || number > 1e9 {
                    return Err(format!("`{word} {number}` is not a whole number"));
                }
                value(number as i64)
            }
            SignedNumber => {
                let number = words.next().ok_or(format!("`{word}` needs a number after it"))?;
                let invalid = || format!("`{number}` is not a number");
                value(number.parse().ok().filter(|n: &f64| n.is_finite()).ok_or_else(invalid)?)
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

fn parse_number_after<'w>(
    word: &str,
    words: &mut impl Iterator<Item = &'w str>,
) -> Result<f64, String> {
    parse_nonnegative(words.next().ok_or_else(|| format!("`{word}` needs a number after it"))?)
}

/// Parses a finite number of at least 0.
fn parse_nonnegative(word: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        Ok(number) if number.is_finite() && number >= 0.0 => Ok(number),
        _ => Err(format!("`{word}` is not a number of at least 0")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Arguments, and the equivalent tables of a file.
    const FAULT_EXAMPLES: &str = "\
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
lie a->b scale -2 offset 0.5 noise 0.25 flips 0.125 @1 => kind = 'lie', from = 'a', to = 'b', message_scale = -2.0, message_offset = 0.5, message_noise = 0.25, message_bit_flips = 0.125, at_s = 1.0
delay r1 odometry by 0.04 jitter 0.01 @1 for 2 => kind = 'delay', robot = 'r1', stream = 'odometry', delay_s = 0.04, jitter_s = 0.01, at_s = 1.0, for_s = 2.0";

    /// Invalid arguments, and a part of the error message of each.
    const INVALID_ARGUMENTS: &str = "\
explode r2 @1 => no fault `explode`
kill => needs a robot
kill r2 => needs a time
kill r2 10 => `10` is not expected
kill r2 @ten => `ten` is not a number
kill r2 @inf => `inf` is not a number
kill r2 @-1 => `-1` is not a number
kill r2 @1 restart => `restart` needs a number
kill r2 @1 again 2 => `again` is not expected
kill r2 @1 restart 2 3 => `3` is not expected
kill r2 @1 @2 => `@2` is given twice
kill r2 @1 for 2 => `for` is not expected
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

    fn split_rows(table: &'static str) -> impl Iterator<Item = (&'static str, &'static str)> {
        table.lines().map(|line| line.split_once(" => ").unwrap())
    }

    #[test]
    fn every_fault_kind_becomes_the_equivalent_table() {
        for (argument, table) in split_rows(FAULT_EXAMPLES) {
            let found = parse(argument).unwrap().to_string();
            assert_eq!(found.trim().replace('\n', ", ").replace('"', "'"), table, "{argument}");
        }
    }

    /// Returns a table of a fault with this syntax, with values drawn from `seed`.
    fn draw_table(syntax: &FaultSyntax, seed: u64) -> Table {
        let mut rng = formation::random::SplitMix64::new(seed);
        let mut draw = |bound: u64| rng.next_u64() % bound;
        let mut table = Table::new();
        table["kind"] = value(syntax.kind);
        for &key in syntax.target.keys() {
            table[key] = match key {
                "stream" => value(["odometry", "commands"][draw(2) as usize]),
                "sensor" => value(["odometry", "proximity"][draw(2) as usize]),
                "hosts" => {
                    value(Array::from_iter(["a", "b", "c"].into_iter().take(1 + draw(3) as usize)))
                }
                _ => value(["r1", "a-b_2", "*"][draw(3) as usize]),
            };
        }
        for parameter in syntax.parameters {
            let number = |drawn: u64| drawn as f64 / [1e9, 1e3, 1.0, 1e-3][drawn as usize % 4];
            if parameter.is_required || draw(2) == 0 {
                table[parameter.key] = match parameter.value_type {
                    Flag => value(true),
                    Number => value(number(draw(1 << 40))),
                    SignedNumber => value(number(draw(1 << 40)) - 1e3),
                    Integer => value(draw(1_000_000_000) as i64),
                    Pair => {
                        value(Array::from_iter([number(draw(1 << 30)), -number(draw(1 << 30))]))
                    }
                };
            }
        }
        table["at_s"] = value(draw(1 << 40) as f64 / 1e9);
        if syntax.has_duration && draw(2) == 0 {
            table["for_s"] = value(draw(1 << 40) as f64 / 1e9);
        }
        table
    }

    proptest::proptest! {
        #[test]
        fn printed_tables_of_all_forms_parse_to_the_same(seed: u64) {
            for (number, form) in (0u64..).zip(FAULT_SYNTAXES) {
                let table = draw_table(form, seed.wrapping_add(number));
                let text = format_fault(&table);
                let parsed = parse(&text).unwrap_or_else(|error| panic!("{text}: {error}"));
                assert_eq!(parsed.to_string(), table.to_string(), "{text}");
            }
        }
    }

    #[test]
    fn every_syntax_error_of_a_fault_is_named() {
        for (argument, expected_part) in split_rows(INVALID_ARGUMENTS) {
            let error = parse(argument).unwrap_err();
            assert!(error.to_string().contains(expected_part), "{argument}: {error}");
            assert!(!error.remedy.is_empty());
        }
        assert!(parse(" ").unwrap_err().to_string().contains("empty"));
        for (argument, suggestion) in [
            ("frezze r1 @1", "freeze"),
            ("kill r2 @10 restrt 2", "restart"),
            ("freeze r2 @1 fro 2", "for"),
            ("loss r2 odometri of 0.1 @2", "odometry"),
            ("lie r2 beacon by [1, 0] @2", "beacons"),
        ] {
            let expected = parse(argument).unwrap_err().remedy;
            assert!(expected.starts_with(&format!("did you mean `{suggestion}`?")), "{expected}");
        }
        assert!(parse("kill r2 @1 flurb").unwrap_err().remedy.starts_with("expected kill"));
    }
}
