//! The structure is what `ARCHITECTURE.md` says.

use std::collections::{BTreeMap, BTreeSet};
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

/// What `cargo tree` says of a build. It may not use the network: what this build needs is here, and of the
/// default build everything.
fn tree(of: &[&str]) -> String {
    let tree = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--locked", "--prefix", "none"])
        .args(of)
        .current_dir(ROOT)
        .output()
        .unwrap();
    assert!(tree.status.success(), "{}", String::from_utf8_lossy(&tree.stderr));
    String::from_utf8(tree.stdout).unwrap()
}

#[test]
fn an_experiment_is_made_without_iceoryx2() {
    for package in ["experiment", "supervisor"] {
        let text = tree(&["--edges", "normal", "-p", package]);
        // The second shows that the question can be answered with yes.
        assert_eq!(text.contains("iceoryx2"), package == "supervisor", "{package}:\n{text}");
    }
}

/// Neither does the default build have a crate of what only some runs need.
#[test]
fn zenoh_is_built_with_the_feature_bridge_only() {
    let with = cfg!(feature = "bridge").then_some(&["--features", "bridge"][..]);
    for features in [&[][..]].into_iter().chain(with) {
        let text = tree(&[&["--workspace", "--edges", "normal,build,dev"], features].concat());
        let crates_of = |name: &str| text.lines().filter(|line| line.starts_with(name)).count();
        assert!(crates_of("bridge ") > 0 && crates_of("iceoryx2") > 0, "{text}");
        assert_eq!(crates_of("zenoh") > 0, !features.is_empty(), "{features:?}: {text}");
    }
}

/// The crates whose files may not import each other in a circle.
const CRATES: [&str; 11] = [
    ".",
    "formation",
    "protocol",
    "experiment",
    "agent",
    "plant",
    "outcome",
    "supervisor",
    "bench",
    "bindings/c",
    "bindings/bridge",
];

#[test]
fn no_files_import_each_other_in_a_circle() {
    let mut imports = 0;
    for package in CRATES {
        let files = modules(&Path::new(ROOT).join(package).join("src"), &[]);
        let known: BTreeSet<&Module> = files.iter().map(|(module, _)| module).collect();
        let mut edges: BTreeMap<&Module, BTreeSet<Module>> = BTreeMap::new();
        for (module, text) in &files {
            let uses = text.lines().filter_map(|line| line.trim_start().strip_prefix("use "));
            let found = uses.filter_map(|line| imported(module, line, &known));
            // A folder's own file and what is in the folder are one thing.
            let apart = found.filter(|to| !to.starts_with(module) && !module.starts_with(to));
            edges.insert(module, apart.collect());
        }
        imports += edges.values().map(BTreeSet::len).sum::<usize>();
        // Whoever imports nobody that is left is in no circle.
        while let Some(free) = edges
            .iter()
            .find_map(|(&module, to)| to.iter().all(|to| !edges.contains_key(to)).then_some(module))
        {
            edges.remove(free);
        }
        assert!(edges.is_empty(), "{package}: {edges:?} import each other");
    }
    assert!(imports > 100, "{imports} imports");
}

/// Where a file stands in its crate: the names of the modules down to it.
type Module = Vec<String>;

/// All files below a folder, without tests.
fn modules(folder: &Path, module: &[String]) -> Vec<(Module, String)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let below = [module, std::slice::from_ref(&name)].concat();
        if name == "tests" || name == "bin" {
        } else if path.is_dir() {
            found.extend(modules(&path, &below));
        } else if path.extension().is_some_and(|extension| extension == "rs") && name != "lib" {
            let text = std::fs::read_to_string(&path).unwrap();
            let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap().to_owned();
            found.push((if name == "mod" { module.to_vec() } else { below }, code));
        }
    }
    found
}

/// The file that a `use` of `module` takes something from, if it is one of this crate's.
fn imported(module: &Module, line: &str, known: &BTreeSet<&Module>) -> Option<Module> {
    let names: Vec<&str> =
        line.split([':', ';', '{', ' ']).filter(|name| !name.is_empty()).collect();
    let up = names.iter().take_while(|&&name| name == "super").count();
    let base = match names[0] {
        "crate" => &[][..],
        "self" => module,
        "super" => &module[..module.len().checked_sub(up)?],
        _ => return None,
    };
    let path = names[up.max(1)..].iter().map(|&name| name.to_owned());
    let mut path: Module = base.iter().cloned().chain(path).collect();
    while !known.contains(&path) {
        path.pop()?;
    }
    (!path.is_empty() && path != *module).then_some(path)
}
