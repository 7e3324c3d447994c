//! Plane picture of a run as a page or fragment, replayed or live.
//!
//! One script and one style serve both. Text of a scenario reaches the page as JSON in a data block or as escaped
//! text, never as markup. The script is constant and allowed by its hash. The page sends requests to its own
//! address only.

use std::fmt::Write as _;

use base64::prelude::{BASE64_STANDARD, Engine as _};
use serde::Serialize;
use sha2::{Digest, Sha256};

use crate::report::markup::escape_markup;
use crate::report::rows::SHOWN_ROWS_MAX;
use crate::report::scene::{Scene, SceneFrame};

mod pack;

const SCRIPT: &str = include_str!("../../assets/page.js");
const STYLE: &str = include_str!("../../assets/page.css");
/// HTML of the picture, its tools and the list of robots, with a placeholder for the time line.
const PICTURE_HTML: &str = include_str!("../../assets/picture.html");
const TIME_LINE_PLACEHOLDER: &str = "<!-- time line -->";
/// HTML of the time line of a finished run: play, pause, seek.
const REPLAY_HTML: &str = include_str!("../../assets/replay.html");
/// HTML of the time line and connection state of a run in progress.
const LIVE_HTML: &str = include_str!("../../assets/live.html");
/// HTML of the parts that only a live page shows: events, latency, edges.
const PANELS_HTML: &str = include_str!("../../assets/panels.html");
const LEGEND_HTML: &str = include_str!("../../assets/legend.html");

/// Returns the animated replay: an HTML fragment with its own style and script, to be used once per document.
///
/// All frames are included; 20 per second of run time are enough. Positions are rounded to millimeters, headings to
/// milliradians.
pub fn replay_html(scene: &Scene, frames: &[SceneFrame]) -> String {
    let blocks = [
        data_block("scene", &limit_fault_rows(scene)),
        data_block("frames", &pack::pack_frames(scene, frames)),
    ];
    let mut html = picture_html("replay", "Replay of the run", REPLAY_HTML, "", &blocks);
    writeln!(html, "<script type=\"module\">{SCRIPT}</script>").expect("strings can be written");
    html
}

/// Returns a scene with the first [`SHOWN_ROWS_MAX`] faults, and how many there are.
fn limit_fault_rows(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    scene.faults_in_all = scene.faults.len();
    scene.faults.truncate(SHOWN_ROWS_MAX);
    scene
}

/// Returns the live page: a document that listens to the address `events` next to it and, with `control`, posts to
/// `control`.
pub fn live_html(scene: &Scene, control: bool) -> String {
    let mode = if control { "control" } else { "live" };
    let name = escape_markup(&scene.name);
    let picture = picture_html(
        mode,
        "The run, live",
        LIVE_HTML,
        PANELS_HTML,
        &[data_block("scene", &limit_fault_rows(scene))],
    );
    let policy = content_security_policy();
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\">\n\
         <meta name=\"referrer\" content=\"no-referrer\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <link rel=\"icon\" href=\"data:,\">\n<title>{name}, live</title>\n</head>\n\
         <body class=\"phalanx-live\">\n<h1>{name}</h1>\n{picture}\
         <script type=\"module\">{SCRIPT}</script>\n</body>\n</html>\n"
    )
}

/// Returns the content security policy of a document with a replay or the live page: it may run this one script,
/// use inline styles, and connect to its own address.
pub fn content_security_policy() -> String {
    let hash = BASE64_STANDARD.encode(Sha256::digest(SCRIPT));
    format!(
        "default-src 'none'; script-src 'sha256-{hash}'; style-src 'unsafe-inline'; \
         img-src data:; connect-src 'self'; base-uri 'none'; form-action 'none'"
    )
}

/// Returns the live picture as a fragment without document and script, for a page that computes the run itself.
pub fn live_picture_html(scene: &Scene) -> String {
    picture_html(
        "control",
        "The run",
        LIVE_HTML,
        PANELS_HTML,
        &[data_block("scene", &limit_fault_rows(scene))],
    )
}

fn picture_html(
    mode: &str,
    label: &str,
    time_line: &str,
    panels: &str,
    blocks: &[String],
) -> String {
    let (picture, blocks) =
        (PICTURE_HTML.replace(TIME_LINE_PLACEHOLDER, time_line), blocks.concat());
    format!(
        "<style>{STYLE}</style>\n\
         <section class=\"phalanx-picture\" data-mode=\"{mode}\" aria-label=\"{label}\">\n\
         {picture}{panels}{LEGEND_HTML}{blocks}</section>\n"
    )
}

/// Returns a JSON data block. No content can end the block early.
fn data_block(class: &str, value: &impl Serialize) -> String {
    let json = serde_json::to_string(value).expect("numbers and text become JSON");
    let json = json.replace('<', "\\u003c");
    format!("<script type=\"application/json\" class=\"{class}\">{json}</script>\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::scene::{SceneFault, SceneRobot};

    const HOSTILE_TEXT: &str = "</script><script>alert(1)</script><!--\"'&\u{2028}";

    fn hostile_scene() -> Scene {
        let name = HOSTILE_TEXT.to_owned();
        let robot =
            SceneRobot { name: name.clone(), front_point_m: f64::NAN, ..Default::default() };
        let fault = SceneFault { what: name.clone(), robots: vec![0], ..SceneFault::default() };
        let (robots, faults) = (vec![robot], vec![fault]);
        Scene { name, duration_s: f64::INFINITY, robots, faults, ..Scene::default() }
    }

    /// Returns the text inside of the data block of this class.
    fn data_block_text<'a>(html: &'a str, class: &str) -> &'a str {
        let opening = format!("<script type=\"application/json\" class=\"{class}\">");
        let (_, rest) = html.split_once(&opening).unwrap();
        rest.split_once("</script>").unwrap().0
    }

    #[test]
    fn hostile_names_stay_text() {
        for html in [replay_html(&hostile_scene(), &[]), live_html(&hostile_scene(), true)] {
            assert!(!html.contains("alert(1)</script>"), "{html}");
            let scene: serde_json::Value =
                serde_json::from_str(data_block_text(&html, "scene")).unwrap();
            assert_eq!(scene["name"], HOSTILE_TEXT);
            assert_eq!(scene["robots"][0]["name"], HOSTILE_TEXT);
            assert_eq!(scene["faults"][0]["what"], HOSTILE_TEXT);
        }
        assert!(live_html(&hostile_scene(), true).contains("<h1>&lt;/script&gt;"));
    }

    #[test]
    fn page_script_is_one_small_block_that_the_policy_allows() {
        assert!(!SCRIPT.contains("</script") && !SCRIPT.contains("<!--"));
        assert!(SCRIPT.len() < 40_000, "page.js has {} bytes", SCRIPT.len());
        let html = live_html(&hostile_scene(), false);
        let (_, script) = html.split_once("<script type=\"module\">").unwrap();
        let (script, _) = script.split_once("</script>").unwrap();
        let hash = BASE64_STANDARD.encode(Sha256::digest(script));
        assert!(html.contains(&format!("script-src 'sha256-{hash}'")), "{hash}");
    }
}
