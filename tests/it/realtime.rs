//! Real time, where the clock itself is the subject.

use crate::harness::run;

#[test]
fn a_run_takes_the_time_it_says_in_one_process_per_robot_and_one_for_the_plant() {
    let mut running = run("triangle").set("duration_s=12").start();
    running.wait_for_event("contact");
    let mut names: Vec<String> = running.children().into_iter().map(|(_, name)| name).collect();
    names.sort();
    assert_eq!(names, ["plant", "r1", "r2", "r3"]);
    for (pid, name) in running.children() {
        let shown = std::fs::read_to_string(format!("/proc/{pid}/comm")).unwrap();
        let expected = if name == "plant" { "phalanx-plant" } else { "phalanx-agent" };
        assert_eq!(shown.trim(), expected, "{name}");
    }
    let ended = running.finish();
    ended.exits_with(0).leaves_nothing();
    ended.claim(ended.number("/t_s") == 12.0, "12 s of run time");
    ended.claim(ended.number("/wall_s") > 11.9, "in no less of wall time");
    ended.claim(ended.number("/min_distance_m") >= 0.2, "nobody came nearer than d");
    ended.claim(ended.number("/violations") == 0.0, "at no arc's end");
    ended.claim(ended.number("/final_error_m_max") < 1e-3, "and the formation stands");
    ended.claim(ended.summary["trajectory_hash"].is_null(), "real time has no hash");
}
