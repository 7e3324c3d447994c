//! Figures and page of a run, as a user gets them.

use std::path::Path;

use crate::harness::{CommandOutput, ExitsWith as _, FinishedRun, phalanx, run};

/// Maximum size of a page, bytes.
const PAGE_BYTES_MAX: usize = 3_000_000;

#[track_caller]
fn report(run_dir: &Path, code: i32) -> CommandOutput {
    phalanx([Path::new("report"), run_dir]).exits_with(code)
}

/// Returns the page of a finished run. Asserts that every figure is a valid SVG file.
#[track_caller]
fn page(ended: &FinishedRun, figures: &[&str]) -> String {
    report(&ended.run_dir(), 0);
    for name in figures {
        let svg = ended.file(&format!("figures/{name}.svg"));
        let document = roxmltree::Document::parse(&svg);
        let is_svg = document.as_ref().is_ok_and(|svg| svg.root_element().has_tag_name("svg"));
        ended.assert_holds(is_svg, format!("{name}.svg is one: {document:?}"));
    }
    let page = ended.file("report.html");
    ended.assert_holds(page.len() < PAGE_BYTES_MAX, format!("the page has {} bytes", page.len()));
    // The namespace URI of SVG is not fetched.
    let markup = page.replace("http://www.w3.org/2000/svg", "");
    for reference in ["http:", "https:", "src=", "url("] {
        ended.assert_holds(
            !markup.contains(reference),
            format!("the page asks for nothing: {reference}"),
        );
    }
    page
}

/// Returns the names of the scenario's expectations. Asserts that all of them held.
#[track_caller]
fn expectation_names(ended: &FinishedRun) -> Vec<String> {
    ended.exits_with(0);
    let expectations = ended.summary["expectations"].as_array().unwrap();
    expectations.iter().map(|each| each["name"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn killed_robot_is_marked_in_every_figure_over_time() {
    let ended = run("triangle").lockstep().fault("kill r2 @2.5 restart 2").finish();
    let over_time = ["distances", "errors", "error_components", "information_age"];
    let page = page(&ended, &over_time);
    for name in over_time {
        let svg = ended.file(&format!("figures/{name}.svg"));
        ended.assert_holds(svg.contains("kill r2"), format!("{name}.svg names the fault"));
    }
    let (pair, distance_m) = (&ended.summary["min_distance_pair"], ended.number("/min_distance_m"));
    let mark = format!("smallest {distance_m:.4} m, {} \u{2013}", pair[0].as_str().unwrap());
    ended.assert_holds(page.contains(&mark), format!("the page says: {mark}"));
    ended.assert_holds(page.contains("every expectation held"), "the page shows the result");
    let over_time = ended.file("latency_over_time.csv");
    ended.assert_holds(over_time.lines().count() > 100, "latencies over time were written");
}

#[test]
fn chapter_figure_claims_are_expected_and_drawn() {
    let all = ["min_distance_m", "final_error_m_max", "converged_by_s"];
    let with_leader = [&all[..2], &["tracking_error_m_max"], &all[2..]].concat();
    let contained = [&with_leader[..3], &["hull_distance_m_max"], &with_leader[3..]].concat();
    let plane = ["trajectories", "distances", "errors", "ideal_errors", "error_components"];
    let hull = [&plane[..], &["hull_distance"]].concat();
    for (name, keys, figures) in [
        ("triangle", &all[..], &plane[..]),
        ("pentagon", &with_leader, &plane),
        ("containment", &contained, &hull),
    ] {
        let ended = run(name).lockstep().set("duration_s=12").finish();
        ended.assert_holds(expectation_names(&ended) == keys, format!("{keys:?} are expected"));
        let page = page(&ended, figures);
        let held_count = page.matches(": held.").count();
        ended.assert_holds(
            held_count >= keys.len(),
            format!("{held_count} verdicts stand below the figures"),
        );
        ended.assert_holds(!page.contains(": missed."), "none was missed");
    }
}

#[test]
fn run_without_expectations_has_no_verdict() {
    for (expected, verdict, class) in [
        ("expect={}", "no expectations declared; exit code 0", "verdict undeclared"),
        ("expect={exit=0}", "every expectation held", "verdict held"),
    ] {
        let ended = run("triangle").lockstep().set("duration_s=1").set(expected).finish();
        ended.exits_with(0);
        let page = page(&ended, &[]);
        ended.assert_holds(ended.stdout.contains(verdict), format!("the screen says: {verdict}"));
        ended.assert_holds(page.contains(verdict), format!("the page says: {verdict}"));
        ended.assert_holds(page.contains(class), format!("the page shows it as {class}"));
    }
}

#[test]
fn run_draws_its_figures_and_passes_without_them() {
    for is_page_blocked in [false, true] {
        let mut running = run("triangle").set("duration_s=1").set("expect={}").drawing().start();
        if is_page_blocked {
            let page = running.run_dir().join("report.html");
            running.wait_for("a run directory", |_| std::fs::create_dir(&page).ok());
        }
        let ended = running.finish();
        ended.exits_with(0);
        let has_complained = ended.stderr.contains("cannot write") && !ended.summary.is_null();
        ended.assert_holds(
            has_complained == is_page_blocked,
            "it complains if and only if it cannot",
        );
        let is_svg = ended.file("figures/trajectories.svg").contains("<svg");
        ended.assert_holds(is_svg, "the figures are there");
    }
}

#[test]
fn killed_supervisor_leaves_enough_for_a_report() {
    let mut running = run("triangle").start();
    running.wait_for("samples", |run| {
        let samples = std::fs::metadata(run.run_dir().join("samples.csv")).ok()?;
        (samples.len() > 20_000).then_some(())
    });
    running.signal(rustix::process::Signal::KILL);
    let ended = running.finish();
    ended.assert_holds(ended.summary.is_null(), "there is no summary");
    let page = page(&ended, &["trajectories", "distances", "errors"]);
    ended.assert_holds(page.contains("cut short"), "the page reports the interruption");
    let text = report(&ended.run_dir(), 0).stdout;
    ended.assert_holds(text.starts_with("triangle: cut short"), format!("and the screen: {text}"));
}

#[test]
fn folder_without_a_run_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for path in [folder.path().to_path_buf(), folder.path().join("none")] {
        let error = report(&path, 2).stderr;
        assert!(error.contains("is no run directory") && error.lines().count() == 1, "{error}");
    }
    std::fs::write(folder.path().join("scenario.toml"), "name = 3\n").unwrap();
    report(folder.path(), 3);
    std::fs::copy("scenarios/triangle.toml", folder.path().join("scenario.toml")).unwrap();
    std::fs::write(folder.path().join("summary.json"), "{ \"t_s\": ").unwrap();
    let error = report(folder.path(), 4).stderr;
    assert!(error.contains("summary.json:1: "), "{error}");
}
