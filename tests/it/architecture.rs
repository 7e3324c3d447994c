//! Checks that the structure of the workspace is as `ARCHITECTURE.md` describes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use crate::harness::{ExitsWith as _, ROOT};

const PAGE: &str = include_str!("../../ARCHITECTURE.md");

#[test]
fn architecture_page_names_existing_files_and_functions() {
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
                let definitions = [format!("fn {function}("), format!("pub {function}:")];
                assert!(definitions.iter().any(|form| text.contains(form)), "no `{code}`: {line}");
                functions += 1;
            }
        }
    }
    assert!(files > 30 && functions >= 4, "{files} files, {functions} functions");
}

#[test]
fn each_course_of_the_page_has_at_most_six_steps() {
    let is_walkthrough =
        |part: &&str| part.lines().next().is_some_and(|head| head.ends_with("through the code"));
    let walkthroughs: Vec<_> = PAGE.split("\n## ").filter(is_walkthrough).collect();
    assert_eq!(walkthroughs.len(), 3);
    for walkthrough in walkthroughs {
        let steps =
            walkthrough.lines().filter(|line| line.starts_with(|c: char| c.is_ascii_digit()));
        assert!((4..=6).contains(&steps.count()), "{walkthrough}");
    }
}

/// Returns the output of `cargo tree`. Runs offline: all dependencies of the default build are available locally.
fn tree(arguments: &[&str]) -> String {
    let mut tree = Command::new(env!("CARGO"));
    tree.args(["tree", "--offline", "--locked", "--prefix", "none"])
        .args(arguments)
        .current_dir(ROOT);
    tree.exits_with(0).stdout
}

#[test]
fn experiment_does_not_depend_on_iceoryx2() {
    for package in ["experiment", "run", "supervisor"] {
        let text = tree(&["--edges", "normal", "-p", package]);
        // The second case shows that the test can find the crate.
        assert_eq!(text.contains("iceoryx2"), package == "supervisor", "{package}:\n{text}");
    }
}

/// The default build has no crate that only some runs need.
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

/// Returns the paths and texts of the Rust files in git.
fn sources() -> Vec<(String, String)> {
    let mut git = Command::new("git");
    let listed = git.args(["ls-files", "--", "*.rs"]).current_dir(ROOT).exits_with(0).stdout;
    // A file that was removed without a commit is still listed.
    let sources = listed.lines().filter_map(|path| {
        Some((path.to_owned(), std::fs::read_to_string(Path::new(ROOT).join(path)).ok()?))
    });
    sources.collect()
}

/// Maximum length of a function, in lines.
const FUNCTION_LINES_MAX: usize = 90;

#[test]
fn folders_and_packages_are_few() {
    let mut git = Command::new("git");
    let listed = git.args(["ls-files"]).current_dir(ROOT).exits_with(0).stdout;
    let folders: BTreeSet<&str> = listed
        .lines()
        .filter_map(|path| Some(path.split_once('/')?.0))
        .filter(|folder| !folder.starts_with('.'))
        .collect();
    assert!(folders.len() <= 15, "{folders:?}");
    let manifest = read_toml("Cargo.toml");
    let members = manifest["workspace"]["members"].as_array().unwrap();
    assert!(members.len() < 12, "with this package more than twelve: {members:?}");
}

fn read_toml(path: &str) -> toml::Table {
    std::fs::read_to_string(Path::new(ROOT).join(path)).unwrap().parse().unwrap()
}

/// Returns the packages of a `Cargo.lock`, each with its version.
fn locked(path: &str) -> BTreeSet<(String, String)> {
    let lock = read_toml(path);
    let text = |package: &toml::Value, key| package[key].as_str().unwrap().to_owned();
    let packages = lock["package"].as_array().unwrap().iter();
    packages.map(|package| (text(package, "name"), text(package, "version"))).collect()
}

/// Cargo compiles a third-party crate once for both only if version and settings are the same.
#[test]
fn python_package_has_versions_and_profiles_of_the_workspace() {
    let ours = locked("Cargo.lock");
    let theirs = locked("bindings/python/Cargo.lock");
    let other_versions: Vec<_> = theirs
        .difference(&ours)
        .filter(|(name, _)| ours.iter().any(|(known, _)| known == name))
        .collect();
    assert!(other_versions.is_empty(), "{other_versions:?}");
    for profile in ["dev", "release"] {
        let mut expected = read_toml("Cargo.toml")["profile"][profile].clone();
        let packages = expected["package"].as_table_mut().unwrap();
        packages.retain(|name, _| name == "*" || theirs.iter().any(|(package, _)| package == name));
        let found = &read_toml("bindings/python/Cargo.toml")["profile"][profile];
        assert_eq!(*found, expected, "{profile}");
    }
}

/// Returns the names of functions, each with the number of lines from its signature to its end. Relies on rustfmt: a
/// function ends with a brace at the indentation of its signature.
fn functions(text: &str) -> Vec<(&str, usize)> {
    let lines: Vec<&str> = text.lines().collect();
    let starts = lines.iter().enumerate().filter_map(|(start, line)| {
        let (before, after) = line.split_once("fn ")?;
        let modifiers = ["pub", "pub(crate)", "pub(super)", "const", "unsafe", "extern", "\"C\""];
        let declared = before.split_whitespace().all(|word| modifiers.contains(&word));
        let name = after.split(['(', '<']).next()?;
        (declared && !name.is_empty()).then_some((start, name))
    });
    let functions = starts.filter_map(|(start, name)| {
        let inwards = lines[start].len() - lines[start].trim_start().len();
        let end = lines[start..].iter().position(|line| {
            let rest = line.get(inwards..).unwrap_or_default();
            rest == "}" || rest.ends_with(';') && !rest.starts_with(' ')
        })?;
        Some((name, end + 1))
    });
    functions.collect()
}

#[test]
fn functions_are_short() {
    let mut found = 0;
    let mut too_long = Vec::new();
    for (path, text) in sources() {
        for (name, lines) in functions(&text) {
            found += 1;
            if lines > FUNCTION_LINES_MAX {
                too_long.push(format!("{path} {name}: {lines} lines"));
            }
        }
    }
    assert!(found > 3_000, "{found} functions");
    assert!(too_long.is_empty(), "{too_long:#?}");
}

/// Returns the name of the type that a line declares, if it declares one. An indented `type` is part of a trait.
fn declared_type(line: &str) -> Option<&str> {
    let code = line.trim_start();
    let modifiers = ["pub ", "pub(crate) ", "pub(super) "];
    let code = modifiers.iter().find_map(|word| code.strip_prefix(word)).unwrap_or(code);
    let keywords = ["struct ", "enum ", "trait ", "union "];
    let alias = code.strip_prefix("type ").filter(|_| !line.starts_with(' '));
    let name = keywords.iter().find_map(|keyword| code.strip_prefix(keyword)).or(alias)?;
    name.split(|c: char| !c.is_alphanumeric() && c != '_').next().filter(|name| !name.is_empty())
}

#[test]
fn types_of_one_crate_have_distinct_names() {
    let mut files: BTreeMap<(String, String), Vec<String>> = BTreeMap::new();
    for (path, text) in sources() {
        let parts: Vec<&str> = path.split('/').collect();
        let folders = if parts[0] == "bindings" { 2 } else { 1 };
        let folder = parts[..folders].join("/");
        for name in text.lines().filter_map(declared_type) {
            files.entry((folder.clone(), name.to_owned())).or_default().push(path.clone());
        }
    }
    assert!(files.len() > 500, "{} types", files.len());
    let repeated: Vec<_> = files.iter().filter(|(_, paths)| paths.len() > 1).collect();
    assert!(repeated.is_empty(), "{repeated:#?}");
}

/// Packages whose files may not import each other in a circle.
const PACKAGES: [&str; 12] = [
    "formation",
    "protocol",
    "experiment",
    "agent",
    "plant",
    "outcome",
    "run",
    "supervisor",
    "bench",
    "bindings/c",
    "bindings/bridge",
    ".",
];

#[test]
fn no_files_import_each_other_in_a_circle() {
    let mut imports = 0;
    for package in PACKAGES {
        let files = modules(&Path::new(ROOT).join(package).join("src"), &[]);
        let known: BTreeSet<&Module> = files.iter().map(|(module, _)| module).collect();
        let mut edges: BTreeMap<&Module, BTreeSet<Module>> = BTreeMap::new();
        for (module, text) in &files {
            let found = paths(text);
            let found = found.iter().filter_map(|path| imported_module(module, path, &known));
            // The file of a module and the files in its folder count as one.
            let outside = found.filter(|to| !to.starts_with(module) && !module.starts_with(to));
            edges.insert(module, outside.collect());
        }
        imports += edges.values().map(BTreeSet::len).sum::<usize>();
        // A module that imports no remaining module is in no circle.
        while let Some(free) = edges
            .iter()
            .find_map(|(&module, to)| to.iter().all(|to| !edges.contains_key(to)).then_some(module))
        {
            edges.remove(free);
        }
        // A module that no remaining module imports is in no circle.
        while let Some(&free) =
            edges.keys().find(|module| edges.values().all(|to| !to.contains(**module)))
        {
            edges.remove(free);
        }
        assert!(edges.is_empty(), "{package}: {edges:?} import each other");
    }
    assert!(imports > 300, "{imports} imports");
}

/// Path of a module in its crate: the names of the modules from the root to it.
type Module = Vec<String>;

/// Returns all files below a folder, without tests.
fn modules(folder: &Path, module: &[String]) -> Vec<(Module, String)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let below = [module, std::slice::from_ref(&name)].concat();
        if ["tests", "bin", "main"].contains(&name.as_str()) {
        } else if path.is_dir() {
            found.extend(modules(&path, &below));
        } else if path.extension().is_some_and(|extension| extension == "rs") && name != "lib" {
            let text = std::fs::read_to_string(&path).unwrap();
            let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap().lines();
            let code: Vec<&str> =
                code.filter(|line| !line.trim_start().starts_with("//")).collect();
            found.push((if name == "mod" { module.to_vec() } else { below }, code.join("\n")));
        }
    }
    found
}

/// Returns every path within its crate that a text names, in a `use` or elsewhere, as its segments.
fn paths(code: &str) -> Vec<Vec<&str>> {
    let starts = ["crate::", "super::"].iter().flat_map(|root| code.match_indices(root));
    let starts = starts.filter(|(start, _)| !code[..*start].ends_with("::"));
    let paths = starts.flat_map(|(start, _)| {
        let (base, rest) = path(&code[start..]);
        let listed = rest.strip_prefix('{').and_then(|rest| rest.split('}').next());
        let further = listed.unwrap_or_default().split(',').map(|text| path(text.trim()).0);
        further.map(|further| [&base[..], &further].concat()).collect::<Vec<_>>()
    });
    paths.collect()
}

/// Returns the segments of the path at the start of a text, and the rest of the text.
fn path(text: &str) -> (Vec<&str>, &str) {
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_' && c != ':');
    let (path, rest) = text.split_at(end.unwrap_or(text.len()));
    (path.split("::").filter(|segment| !segment.is_empty()).collect(), rest)
}

/// Returns the module of this crate that a path in `module` refers to, if it is another one.
fn imported_module(
    module: &Module,
    segments: &[&str],
    known: &BTreeSet<&Module>,
) -> Option<Module> {
    let up = segments.iter().take_while(|&&segment| segment == "super").count();
    let base = if up > 0 { &module[..module.len().checked_sub(up)?] } else { &[] };
    let further = segments[up.max(1)..].iter().map(|&segment| segment.to_owned());
    let mut path: Module = base.iter().cloned().chain(further).collect();
    while !known.contains(&path) {
        path.pop()?;
    }
    (!path.is_empty() && path != *module).then_some(path)
}
