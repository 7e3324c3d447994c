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
    neighbor_keys: &[NeighborKeys<'_>],
) -> Result<Vec<Succession>, Diagnostic> {
    let robots = &scenario.robots;
    let name = |robot: usize| &robots[robot].name;
    let receives_from =
        |to: usize, from: usize| scenario.graph.incoming_edges(to).any(|edge| edge.from == from);
    let mut all: Vec<Succession> = Vec::new();
    for (leader, robot_keys) in neighbor_keys.iter().enumerate() {
        let Some(list) = &robot_keys.deputies else { continue };
        let has_leader = scenario.leader().is_some();
        if !has_leader || robots[leader].role.reference != Reference::Offsets {
            return Err(list.error_at_value(
                format!("{} has deputies, but keeps no slot relative to a main leader", name(leader)),
                "expected `deputies` in the table of a secondary leader; those of the main leader are a key \
                 at the top level of the file",
            ));
        }
        let leader_name = name(leader);
        let mut deputies: Vec<usize> = Vec::new();
        for value in list.elements("expected a list of names of robots: [\"r2\", \"r3\"]")? {
            let deputy = parse_robot_index(&value, robots)?;
            let other = name(deputy);
            let error =
                |message: String, expected: String| Err(value.error_at_value(message, expected));
            if robots[deputy].role.reference != Reference::NeighborMean {
                let message =
                    format!("{other} is a deputy of {leader_name}, but has a slot of its own");
                return error(message, "expected contained robots".to_owned());
            }
            if !receives_from(deputy, leader) {
                let message = format!(
                    "{other} does not hear {leader_name}, and cannot detect whether it is lost"
                );
                return error(
                    message,
                    format!("expected contained robots that hear {leader_name}"),
                );
            }
            let successions =
                all.iter().map(|succession| (succession.leader, &succession.deputies));
            let has_deputy = |(_, deputies): &(usize, &Vec<usize>)| deputies.contains(&deputy);
            let first =
                successions.chain([(leader, &deputies)]).find(has_deputy).map(|(first, _)| first);
            if let Some(first) = first {
                let message = format!("{other} is a deputy of {} already", name(first));
                return error(message, "expected each deputy once".to_owned());
            }
            let mut in_neighbors =
                scenario.graph.incoming_edges(leader).map(|edge: &Edge| edge.from);
            if in_neighbors.all(|from| receives_from(deputy, from)) {
                let message = format!("{other} hears all in-neighbors of {leader_name}");
                let expected = format!(
                    "expected a robot that does not: it cannot move to their mean and keep the slot of {leader_name}"
                );
                return error(message, expected);
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
        let error =
            |message: String, expected: String| Err(value.error_at_value(message, expected));
        let Some(leader) = scenario.leader() else {
            let message = format!(
                "{name} is a deputy, but there is no leader: it has no trajectory to track"
            );
            return error(
                message,
                "expected a robot with a leader's law and `trajectory`".to_owned(),
            );
        };
        let leader = &robots[leader].name;
        match robots[deputy].role.reference {
            Reference::Offsets => {}
            Reference::Trajectory => {
                let message = format!("the leader {name} cannot be its own deputy");
                return error(
                    message,
                    "expected robots that keep a slot relative to it".to_owned(),
                );
            }
            Reference::NeighborMean | Reference::Goal | Reference::LawTarget => {
                let message =
                    format!("{name} keeps no slot relative to {leader}, so it cannot lead");
                return error(message, "expected a robot with a formation law".to_owned());
            }
        }
        if let Some(resilient) = robots.iter().find(|robot| robot.liars_max() > 0) {
            let message = format!(
                "{} has a resilient law: it cannot distinguish {name}, which leads in place of {leader}, \
                 from a Byzantine robot",
                resilient.name
            );
            return error(message, "expected no deputies, or no formation-robust".to_owned());
        }
        if deputies.contains(&deputy) {
            return error(format!("{name} is a deputy twice"), "expected it once".to_owned());
        }
        if deputies.len() as u64 == DEPUTIES_MAX {
            let message = format!("{name} is deputy {}", DEPUTIES_MAX + 1);
            return error(message, format!("expected at most {DEPUTIES_MAX}"));
        }
        deputies.push(deputy);
    }
    Ok(deputies)
}
