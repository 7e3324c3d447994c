//! Who leads in the main leader's place while it is lost: `deputies`.

use protocol::law::Reference;
use protocol::message::DEPUTIES_MAX;

use super::Scenario;
use super::diagnostic::Diagnostic;
use super::robots::robot_named;
use super::table::Table;

/// By their places, the best rank first.
pub(super) fn deputies(root: &Table<'_>, scenario: &Scenario) -> Result<Vec<usize>, Diagnostic> {
    let Some(list) = root.get("deputies") else { return Ok(Vec::new()) };
    let robots = &scenario.robots;
    let mut deputies: Vec<usize> = Vec::new();
    for value in list.elements("expected a list of names of robots: [\"r2\", \"r3\"]")? {
        let deputy = robot_named(&value, robots)?;
        let name = &robots[deputy].name;
        let wrong = |what: String, expected: String| Err(value.here(what, expected));
        let Some(leader) = scenario.leader() else {
            let what =
                format!("{name} is a deputy, but nobody leads: it has no trajectory to follow");
            return wrong(what, "expected a robot with a leader's law and `trajectory`".to_owned());
        };
        let leader = &robots[leader].name;
        match robots[deputy].role.reference {
            Reference::Offsets => {}
            Reference::Trajectory => {
                let what = format!("{name}, the leader, is to be its own deputy");
                return wrong(what, "expected robots that keep a place to it".to_owned());
            }
            Reference::Middle | Reference::Goal => {
                let what =
                    format!("{name} keeps no place to {leader}, and cannot lead in its place");
                return wrong(what, "expected a robot with a formation law".to_owned());
            }
        }
        if let Some(careful) = robots.iter().find(|robot| robot.liars_max() > 0) {
            let what = format!(
                "{} leaves liars out: it cannot tell {name}, which leads in {leader}'s place, from a liar",
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
