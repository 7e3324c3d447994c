//! The structure is what `ARCHITECTURE.md` says.

use std::path::Path;
use std::process::Command;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const PAGE: &str = include_str!("../../ARCHITECTURE.md");

#[test]
fn every_file_and_function_of_the_page_is_where_it_says() {
    let (mut files, mut functions) = (0, 0);
    for line in PAGE.lines() {
        let mut text = String::new();
        for code in line.split('`').skip(1).step_by(2) {
            if code.contains('/') && !code.contains([' ', '<']) && code != "plant/truth" {
                let path = [ROOT, "agent/src"].map(|root| Path::new(root).join(code));
                let path = path.iter().find(|path| path.exists());
                let path = path.unwrap_or_else(|| panic!("{code} is not there: {line}"));
                text = std::fs::read_to_string(path).unwrap_or_default();
                files += 1;
            } else if let Some((_, function)) = code.split_once("::") {
                let there = [format!("fn {function}("), format!("pub {function}:")];
                assert!(there.iter().any(|form| text.contains(form)), "no `{code}`: {line}");
                functions += 1;
            }
        }
    }
    assert!(files > 30 && functions >= 4, "{files} files, {functions} functions");
}

#[test]
fn each_way_has_at_most_six_steps() {
    let ways: Vec<_> = PAGE.split("\n## ").filter(|part| part.starts_with("The way of")).collect();
    assert_eq!(ways.len(), 3);
    for way in ways {
        let steps = way.lines().filter(|line| line.starts_with(|c: char| c.is_ascii_digit()));
        assert!((4..=6).contains(&steps.count()), "{way}");
    }
}

#[test]
fn experiment_and_metrics_are_built_without_iceoryx2() {
    for package in ["experiment", "metrics", "supervisor"] {
        let tree = Command::new(env!("CARGO"))
            .args(["tree", "--offline", "--locked", "--edges", "normal", "-p", package])
            .current_dir(ROOT)
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&tree.stdout);
        assert!(tree.status.success(), "{}", String::from_utf8_lossy(&tree.stderr));
        // The third shows that the question can be answered with yes.
        assert_eq!(text.contains("iceoryx2"), package == "supervisor", "{package}:\n{text}");
    }
}
