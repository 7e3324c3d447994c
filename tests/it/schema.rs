//! The JSON Schemas of scenario and campaign files: they match the key tables of the readers and accept the existing
//! files. `PHALANX_BLESS=1` rewrites the committed files.

use std::path::{Path, PathBuf};

use crate::harness::{ExitsWith as _, phalanx};
use crate::recording::assert_script_succeeds;

const SCENARIO: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/scenario.schema.json");
const CAMPAIGN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/campaign.schema.json");

fn files(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let paths = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    paths.filter(|path| path.extension().is_some_and(|ending| ending == "toml")).collect()
}

fn assert_verdicts(schema: &str, verdict: &str, files: &[PathBuf]) {
    let mut args = vec![Path::new(schema), Path::new(verdict)];
    args.extend(files.iter().map(PathBuf::as_path));
    assert_script_succeeds("by_jsonschema", &args);
}

#[test]
fn committed_schemas_match_the_key_tables() {
    for (committed, words) in [(SCENARIO, &["schema"][..]), (CAMPAIGN, &["schema", "--campaign"])] {
        let schema = phalanx(words).exits_with(0).stdout;
        if std::env::var_os("PHALANX_BLESS").is_some() {
            std::fs::write(committed, &schema).unwrap();
        }
        assert!(
            std::fs::read_to_string(committed).unwrap() == schema,
            "regenerate {committed} with: phalanx {}",
            words.join(" ")
        );
    }
}

#[test]
#[ignore = "needs the readers that tests/readers/install installs"]
fn jsonschema_accepts_every_shipped_scenario() {
    let shipped = files("scenarios");
    assert!(shipped.len() >= 16);
    assert_verdicts(SCENARIO, "accepts", &shipped);
    let shipped = files("scenarios/campaigns");
    assert!(shipped.len() >= 5);
    assert_verdicts(CAMPAIGN, "accepts", &shipped);
}

#[test]
#[ignore = "needs the readers that tests/readers/install installs"]
fn jsonschema_refuses_files_of_the_wrong_structure() {
    const WRONG_STRUCTURE_FILES: &str = "expectation_misspelled fault_delay_of_nothing fault_for_no_time \
        fault_load_of_half_a_process fault_of_unknown_kind fault_of_unknown_sensor \
        fault_with_key_of_another_kind format_of_the_future gain_zero hears_in_defaults \
        hears_one_without_a_list hold_periods_with_fraction inline_robot_with_a_typo key_guessed \
        key_without_unit lemniscate_without_period missing_avoidance missing_period misspelled_key \
        no_robots number_as_string offset_with_three_numbers period_negative place_with_one_number \
        published_velocity_of_unknown_kind robot_as_single_table seed_negative \
        trajectory_key_of_another_kind unknown_avoidance unknown_key unknown_law \
        unknown_restart_policy unknown_silence_policy waypoint_with_three_numbers \
        waypoints_closed_in_words waypoints_without_speed limits_ramp_of_unknown_kind model_unknown";
    const WRONG_CAMPAIGN: &str =
        "box_with_one_side case_of_no_axis keep_of_unknown_kind key_misspelled";
    for (schema, folder, wrong) in [
        (SCENARIO, "tests/bad", WRONG_STRUCTURE_FILES),
        (CAMPAIGN, "tests/bad_campaigns", WRONG_CAMPAIGN),
    ] {
        let is_wrong = |path: &PathBuf| {
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            wrong.split_whitespace().any(|wrong| wrong == name)
        };
        let files: Vec<PathBuf> = files(folder).into_iter().filter(is_wrong).collect();
        assert_eq!(files.len(), wrong.split_whitespace().count());
        assert_verdicts(schema, "refuses", &files);
    }
}
