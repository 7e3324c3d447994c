//! Checks of teams: robots with different sizes or speed limits.

use protocol::avoidance::DistanceGuarantee;
use protocol::number::format_short;

use super::finding::{Finding, error_finding, warning_finding};
use crate::scenario::Scenario;
use crate::scenario::team::CLASSES_MAX;

/// Refuses teams with too many classes. Warns about sizes that are not sensed, and about methods that do not distinguish
/// sizes.
pub(super) fn check_team(scenario: &Scenario) -> Vec<Finding> {
    if !scenario.is_team() {
        return Vec::new();
    }
    let mut findings = Vec::new();
    let classes = scenario.classes().len();
    if scenario.classes_sensed && classes > CLASSES_MAX {
        findings.push(error_finding(
            "robot",
            format!("the robots have {classes} different pairs of `keep_m` and `speed_max_m_s`"),
            format!("expected at most {CLASSES_MAX}, or `avoidance.classes_sensed = false`"),
        ));
    }
    if scenario.has_different_sizes() {
        findings.extend(check_unsensed_sizes(scenario));
        if scenario.avoidance_method.distance_guarantee != DistanceGuarantee::Unconditional {
            let name = scenario.avoidance_method.name;
            findings.push(warning_finding(
                "avoidance.kind",
                format!(
                    "avoidance \"{name}\" does not distinguish sizes: each robot keeps from all others the distance that \
                     it would keep from the largest"
                ),
                "expected `kind = \"guard\"`, or the same `keep_m` for all robots",
            ));
        }
    }
    findings
}

/// Warns about different sizes that robots do not sense.
fn check_unsensed_sizes(scenario: &Scenario) -> Option<Finding> {
    if scenario.classes_sensed {
        return None;
    }
    let largest = scenario.robots.iter().max_by(|a, b| a.keep_m.total_cmp(&b.keep_m))?;
    Some(warning_finding(
        "avoidance.classes_sensed",
        format!(
            "robots do not sense the sizes of others: each keeps its own `keep_m` + {} m, that of {}, from all others, \
             and some may not arrive in a crowd",
            format_short(largest.keep_m),
            largest.name
        ),
        "expected `classes_sensed = true`, or the same `keep_m` for all robots",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::examples::row_of_three;

    /// Returns three robots with a method whose guarantee holds always.
    fn guarded() -> Scenario {
        let mut scenario = row_of_three();
        scenario.avoidance_method.distance_guarantee = DistanceGuarantee::Unconditional;
        scenario
    }

    #[test]
    fn different_sizes_that_are_not_sensed_are_warned_of() {
        let mut scenario = guarded();
        assert_eq!(check_team(&scenario), []);
        scenario.robots[1].keep_m = 0.15;
        assert_eq!(check_team(&scenario), []);
        scenario.classes_sensed = false;
        let [warned] = &check_team(&scenario)[..] else { panic!("one warning") };
        assert_eq!(warned.path, "avoidance.classes_sensed");
        assert!(warned.message.contains("`keep_m` + 0.15 m, that of r2"), "{}", warned.message);
        scenario.classes_sensed = true;
        scenario.avoidance_method.distance_guarantee = DistanceGuarantee::UnderIdealAssumptions;
        let [warned] = &check_team(&scenario)[..] else { panic!("one warning") };
        assert_eq!(warned.path, "avoidance.kind");
    }
}
