//! Leader failover: the backup leaders of the main leader and of secondary leaders, key `deputies`.

use formation::graph::Edge;
use formation::rewiring::Succession;
use protocol::law::Reference;
use protocol::message::DEPUTIES_MAX;

use super::Scenario;
use super::diagnostic::Diagnostic;
use super::keys;
use super::robots::{NeighborKeys, parse_robot_index};
use super::table::TableReader;

/// Returns the succession of every secondary leader that declares deputies.
pub(super) fn parse_successions(
    scenario: &Scenario,
    ties: &[NeighborKeys<'_>],
) -> Result<Vec<Succession>, Diagnostic> {
    let robots = &scenario.robots;
    let name = |robot: usize| &robots[robot].name;
    let hears =
        |to: usize, from: usize| scenario.graph.incoming_edges(to).any(|edge| edge.from == from);
    let mut all: Vec<Succession> = Vec::new();
    for (leader, tie) in ties.iter().enumerate() {
        let Some(list) = &tie.deputies else { continue };
        let led = scenario.leader().is_some();
        if !led || robots[leader].role.reference != Reference::Offsets {
            return Err(list.error_at_value(
                format!("{} has deputies, but keeps no slot relative to a main leader", name(leader)),
                "expected `deputies` in the table of a secondary leader; those of the main leader are a key \
                 at the top level of the file",
            ));
        }
        let of = name(leader);
        let mut deputies: Vec<usize> = Vec::new();
        for value in list.elements("expected a list of names of robots: [\"r2\", \"r3\"]")? {
            let deputy = parse_robot_index(&value, robots)?;
            let other = name(deputy);
            let wrong = |what: String, expected: String| Err(value.error_at_value(what, expected));
            if robots[deputy].role.reference != Reference::NeighborMean {
                let what = format!("{other} is a deputy of {of}, but has a slot of its own");
                return wrong(what, "expected contained robots".to_owned());
            }
            if !hears(deputy, leader) {
                let what =
                    format!("{other} does not hear {of}, and cannot detect whether it is lost");
                return wrong(what, format!("expected contained robots that hear {of}"));
            }
            let named = all.iter().map(|one| (one.leader, &one.deputies));
            let is_one = |(_, deputies): &(usize, &Vec<usize>)| deputies.contains(&deputy);
            let first = named.chain([(leader, &deputies)]).find(is_one).map(|(first, _)| first);
            if let Some(first) = first {
                let what = format!("{other} is a deputy of {} already", name(first));
                return wrong(what, "expected each deputy once".to_owned());
            }
            let mut by = scenario.graph.incoming_edges(leader).map(|edge: &Edge| edge.from);
            if by.all(|from| hears(deputy, from)) {
                let what = format!("{other} hears all in-neighbors of {of}");
                let expected = format!(
                    "expected a robot that does not: it cannot move to their mean and keep the slot of {of}"
                );
                return wrong(what, expected);
            }
            deputies.push(deputy);
        }
        all.push(Succession { leader, deputies });
    }
    Ok(all)
}

/// Returns the indices of the backup leaders of the main leader, in order of preference.
pub(super) fn parse_deputies(
    root: &TableReader<'_, keys::Root>,
    scenario: &Scenario,
) -> Result<Vec<usize>, Diagnostic> {
    let Some(list) = root.get(keys::Root::deputies) else { return Ok(Vec::new()) };
    let robots = &scenario.robots;
    let mut deputies: Vec<usize> = Vec::new();
    for value in list.elements("expected a list of names of robots: [\"r2\", \"r3\"]")? {
        let deputy = parse_robot_index(&value, robots)?;
        let name = &robots[deputy].name;
        let wrong = |what: String, expected: String| Err(value.error_at_value(what, expected));
        let Some(leader) = scenario.leader() else {
            let what = format!(
                "{name} is a deputy, but there is no leader: it has no trajectory to track"
            );
            return wrong(what, "expected a robot with a leader's law and `trajectory`".to_owned());
        };
        let leader = &robots[leader].name;
        match robots[deputy].role.reference {
            Reference::Offsets => {}
            Reference::Trajectory => {
                let what = format!("the leader {name} cannot be its own deputy");
                return wrong(what, "expected robots that keep a slot relative to it".to_owned());
            }
            Reference::NeighborMean | Reference::Goal | Reference::LawTarget => {
                let what = format!("{name} keeps no slot relative to {leader}, so it cannot lead");
                return wrong(what, "expected a robot with a formation law".to_owned());
            }
        }
        if let Some(careful) = robots.iter().find(|robot| robot.liars_max() > 0) {
            let what = format!(
                "{} has a resilient law: it cannot distinguish {name}, which leads in place of {leader}, \
                 from a Byzantine robot",
                careful.name
            );
            return wrong(what, "expected no deputies, or no formation-robust".to_owned());
        }
        if deputies.contains(&deputy) {
            return wrong(format!("{name} is a deputy twice"), "expected it once".to_owned());
        }
        if deputies.len() as u64 == DEPUTIES_MAX {
            let what = format!("{name} is deputy {}", DEPUTIES_MAX + 1);
            return wrong(what, format!("expected at most {DEPUTIES_MAX}"));
        }
        deputies.push(deputy);
    }
    Ok(deputies)
}
