//! `README.md`, `CONTRIBUTING.md` and the book in `docs/`: each shell block must parse, and is run if possible; each
//! TOML block is read.
//!
//! A page is followed from its top in its own folder, which has `scenarios/` and `bindings/`. A block whose first line
//! is `# NAME` is the file of that name. A text block right after a shell block is the expected output of both
//! streams; `...` in it matches anything. A command that ends with an exit code other than 0 states it: `# exit code
//! 1`.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use clap::Parser as _;
use experiment::scenario::keys::{FileFormat, Section, ValueType};
use phalanx::command_line::CommandLine;
use tempfile::TempDir;

use crate::harness::{PHALANX, ROOT, RunRoot, files_below, map_in_parallel};

/// Prefixes of commands that tests do not run: they run the tests themselves, take minutes or change the machine.
const NOT_RUN: &[&str] = &[
    "phalanx hunt scenarios/triangle.toml --runs 20000",
    "phalanx hunt scenarios/triangle.toml --minutes",
    "phalanx hunt scenarios/antipodal-8.toml",
    "phalanx hunt scenarios/intersection.toml",
    "phalanx hunt scenarios/doorway.toml",
    "phalanx hunt scenarios/triangle.toml --set duration_s=4",
    "phalanx hunt tests/planted/",
    "scenarios/campaigns/hunts/",
    "scenarios/campaigns/teams/",
    "cargo ",
    "tests/",
    "bench/",
    "bindings/",
    "proof/",
    "target/",
    ".ci/",
    "docker ",
    "pip ",
    ". ",
    "phalanx bench",
    "python3 ",
    "parallel ",
    "perf ",
];

/// Prefixes of commands that tests run.
const RUN: &[&str] =
    &["phalanx ", "export ", "cp ", "g++ ", "sed ", "head ", "cat ", "cmp ", "grep ", "ls "];

/// Requirement for following a page.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Needs {
    /// A minute or more of time.
    Time,
    /// The readers that `tests/readers/install` installs.
    Readers,
    /// The Python package that `tests/python/install` installs.
    Package,
    /// The Python package and trainers that `tests/learning/install` installs; `learning::` follows the page.
    Learning,
    /// The packages that `tests/cpp/install` installs, and the library of `bindings/c`.
    Cpp,
    /// A changed build of the program; a separate test follows the page.
    Build,
    /// Drawn pictures; `tests/book/gallery` follows the page.
    Pictures,
}

/// Pages with requirements. All other pages have none.
const PAGES: &[(&str, Needs)] = &[
    ("docs/how-to/chapter.md", Needs::Time),
    ("docs/how-to/faults.md", Needs::Time),
    ("docs/faults.md", Needs::Time),
    ("docs/chapter.md", Needs::Time),
    ("docs/how-to/graph.md", Needs::Readers),
    ("docs/how-to/analyse.md", Needs::Readers),
    ("bindings/python/README.md", Needs::Package),
    ("docs/tutorial/python.md", Needs::Package),
    ("docs/how-to/plant.md", Needs::Package),
    ("docs/hardware.md", Needs::Package),
    ("docs/how-to/policy.md", Needs::Package),
    (TRAIN, Needs::Learning),
    ("docs/how-to/cpp.md", Needs::Cpp),
    ("docs/tutorial/law.md", Needs::Build),
    ("docs/gallery.md", Needs::Pictures),
];

#[derive(Debug, Clone)]
struct Block {
    language: String,
    line: usize,
    text: String,
    /// `true` if only blank lines separate it from the preceding block.
    follows: bool,
}

/// Returns the fenced blocks of a page, in order.
fn blocks(page: &str) -> Vec<Block> {
    let mut found: Vec<Block> = Vec::new();
    let mut open: Option<Block> = None;
    let mut follows = false;
    for (number, line) in page.lines().enumerate() {
        match (&mut open, line.strip_prefix("```")) {
            (None, Some(language)) => {
                let (language, line) = (language.to_owned(), number + 1);
                open = Some(Block { language, line, text: String::new(), follows });
            }
            (Some(_), Some("")) => {
                found.extend(open.take());
                follows = true;
            }
            (Some(block), _) => block.text += &format!("{line}\n"),
            (None, None) => follows = follows && line.trim().is_empty(),
        }
    }
    assert!(open.is_none(), "a block is not closed");
    found
}

fn page(path: &str) -> String {
    std::fs::read_to_string(Path::new(ROOT).join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// Returns the paths of all pages.
fn pages() -> Vec<String> {
    let other_pages = ["README.md", "CONTRIBUTING.md", "bindings/python/README.md"];
    let docs = files_below(&Path::new(ROOT).join("docs")).into_iter();
    let docs = docs.filter(|path| path.extension().is_some_and(|ending| ending == "md"));
    let docs = docs.map(|path| path.strip_prefix(ROOT).unwrap().to_str().unwrap().to_owned());
    let mut paths: Vec<String> = docs.chain(other_pages.map(str::to_owned)).collect();
    paths.sort();
    paths
}

/// Returns the blocks of all pages in this language, each with its location.
fn all_blocks(language: &str) -> Vec<(String, Block)> {
    let blocks = pages().into_iter().flat_map(|path| {
        let found = blocks(&page(&path)).into_iter();
        found.map(move |block| (format!("{path}:{}", block.line), block))
    });
    blocks.filter(|(_, block)| block.language == language).collect()
}

/// Returns the commands of a shell block as a reader with `phalanx` on the PATH types them.
fn commands(block: &Block) -> Vec<String> {
    let text = block.text.replace("\\\n", " ");
    let lines = text.lines().filter(|line| !line.trim().is_empty() && !line.starts_with('#'));
    let installed = lines.map(|line| {
        line.replace("cargo run --release -- ", "phalanx ")
            .replace("cargo run --profile dist -p bench -- ", "phalanx bench ")
    });
    installed.collect()
}

/// Splits a command into arguments, without quotes, comment, redirection and pipe.
fn split_arguments(command: &str) -> Vec<String> {
    let (mut arguments, mut argument, mut quote) = (Vec::new(), None::<String>, None);
    for letter in command.chars() {
        match (quote, letter) {
            (None, '\'' | '"') => {
                quote = Some(letter);
                argument.get_or_insert_default();
            }
            (Some(mark), letter) if mark == letter => quote = None,
            (None, ' ') => arguments.extend(argument.take()),
            _ => argument.get_or_insert_default().push(letter),
        }
    }
    arguments.extend(argument);
    let end =
        arguments.iter().position(|argument| ["#", ">", "|", "&&"].contains(&argument.as_str()));
    arguments.truncate(end.unwrap_or(arguments.len()));
    arguments
}

/// Returns whether a test can run a command: it takes little time and no browser.
fn can_be_run(command: &str) -> bool {
    let is_listed_as_not_run = NOT_RUN.iter().any(|prefix| command.starts_with(prefix));
    let is_real_time = command.starts_with("phalanx run ") && !command.contains("--pace lockstep");
    !is_listed_as_not_run && !is_real_time && !command.contains("--view")
}

#[test]
fn commands_of_all_pages_are_accepted_by_the_program() {
    let mut parsed = 0;
    for (location, block) in all_blocks("sh") {
        for command in commands(&block) {
            let mut known = RUN.iter().chain(NOT_RUN);
            assert!(
                known.any(|prefix| command.starts_with(prefix)),
                "{location}: `{command}` is in neither RUN nor NOT_RUN"
            );
            let arguments = split_arguments(&command);
            let accepted = match &arguments[..] {
                [phalanx, bench, ..] if phalanx == "phalanx" && bench == "bench" => {
                    bench::cli::CommandLine::try_parse_from(&arguments[1..]).map(drop)
                }
                [phalanx, ..] if phalanx == "phalanx" => {
                    CommandLine::try_parse_from(&arguments).map(drop)
                }
                _ => continue,
            };
            accepted.unwrap_or_else(|error| panic!("{location}: `{command}`: {error}"));
            parsed += 1;
        }
    }
    assert!(parsed > 20, "{parsed} commands");
}

#[test]
fn toml_blocks_have_only_scenario_campaign_or_fleet_keys() {
    let scenario = FileFormat::new(&agent::catalog());
    let campaign = experiment::campaign::keys::campaign_format();
    let mut found = 0;
    for (location, block) in all_blocks("toml") {
        let table: toml::Table = block.text.parse().unwrap_or_else(|e| panic!("{location}: {e}"));
        if block.text.starts_with("# Cargo.toml") {
            continue;
        }
        found += 1;
        if table.contains_key("host") {
            let fleet = bridge::fleet::parse_text(Path::new(&location), &block.text);
            fleet.unwrap_or_else(|error| panic!("{location}: {}", error.render(false)));
        } else if table.contains_key("scenario") {
            assert_keys(&location, &table, campaign.root(), &campaign);
        } else {
            assert_keys(&location, &table, scenario.root(), &scenario);
        }
    }
    assert!(found >= 4, "{found} blocks");
}

#[track_caller]
fn assert_keys(location: &str, table: &toml::Table, section: &Section, format: &FileFormat) {
    for (name, value) in table {
        let key = section
            .find_key(name)
            .unwrap_or_else(|| panic!("{location}: no key {name} in {}", section.name));
        match (key.value_type, value) {
            // The table has keys of the scenario, set by a campaign.
            (ValueType::Table("set" | "vary"), toml::Value::Table(_)) => {}
            (
                ValueType::Table(inner) | ValueType::FileOrTable(inner),
                toml::Value::Table(table),
            ) => {
                assert_keys(location, table, format.section(inner), format);
            }
            (ValueType::Tables(inner), toml::Value::Array(tables)) => {
                for table in tables {
                    assert_keys(
                        location,
                        table.as_table().expect(name),
                        format.section(inner),
                        format,
                    );
                }
            }
            (ValueType::NamedTables(inner), toml::Value::Table(tables)) => {
                for table in tables.values() {
                    assert_keys(
                        location,
                        table.as_table().expect(name),
                        format.section(inner),
                        format,
                    );
                }
            }
            (ValueType::Table(_) | ValueType::Tables(_) | ValueType::NamedTables(_), _) => {
                panic!("{location}: {name} = {value}")
            }
            _ => {}
        }
    }
}

/// Follows a page as a reader does.
struct Reader {
    path: String,
    folder: TempDir,
    run_root: RunRoot,
    /// Python that finds the packages the pages import; `None`: no Python is run.
    python: Option<PathBuf>,
}

impl Reader {
    fn new(path: &str, python: Option<PathBuf>) -> Reader {
        let folder = tempfile::tempdir().unwrap();
        for shipped in ["scenarios", "bindings"] {
            let target = Path::new(ROOT).join(shipped);
            std::os::unix::fs::symlink(target, folder.path().join(shipped)).unwrap();
        }
        Reader { path: path.into(), folder, run_root: RunRoot::new(), python }
    }

    /// Performs all steps of the page that can be run.
    fn perform_steps(&self) {
        let mut printed: Option<String> = None;
        for block in blocks(&page(&self.path)) {
            let location = format!("{}:{}", self.path, block.line);
            if let Some(name) = file_name(&block) {
                let path = self.folder.path().join(name);
                std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                std::fs::write(path, &block.text).unwrap();
            } else if block.language == "sh" {
                printed = self.run(&location, &block);
                continue;
            } else if block.language == "text"
                && block.follows
                && let Some(printed) = &printed
            {
                assert!(
                    matches_pattern(&block.text, printed),
                    "{location}: the output differs from the page:\n{printed}"
                );
            }
            printed = None;
        }
    }

    /// Runs the commands of a block and returns their output. Returns `None` if not all of them can be run.
    fn run(&self, location: &str, block: &Block) -> Option<String> {
        let mut all = Some(String::new());
        for command in commands(block) {
            let python = command.starts_with("python3 ") && self.python.is_some();
            if !can_be_run(&command) && !python {
                all = None;
                continue;
            }
            let (code, printed) = self.shell(&command);
            let expected = command.split_once("# exit code ").map_or("0", |(_, code)| code.trim());
            assert_eq!(code.to_string(), expected, "{location}: `{command}`:\n{printed}");
            all = all.map(|all| all + &printed);
        }
        all
    }

    fn shell(&self, command: &str) -> (i32, String) {
        let program = Path::new(PHALANX).parent().into_iter();
        let folders = program.chain(self.python.as_deref()).map(Path::to_owned);
        let path = std::env::var_os("PATH").unwrap();
        let path = std::env::join_paths(folders.chain(std::env::split_paths(&path))).unwrap();
        let output = Command::new("bash")
            .args(["-o", "pipefail", "-c", &format!("exec 2>&1; {command}")])
            .current_dir(self.folder.path())
            .env("PATH", path)
            .env("PHALANX_RUN_ROOT", self.run_root.path())
            .env("NO_COLOR", "1")
            .stdin(Stdio::null())
            .output()
            .unwrap();
        (output.status.code().unwrap_or(-1), String::from_utf8_lossy(&output.stdout).into_owned())
    }
}

/// Returns the name of the file that a block contains, if its first line names one.
fn file_name(block: &Block) -> Option<&str> {
    let line = block.text.lines().next()?;
    let name = line.strip_prefix("# ").or(line.strip_prefix("// "))?;
    let looks_like_file = name.contains('.') && !name.contains(' ') && !name.ends_with('.');
    (looks_like_file && ["toml", "python", "rust", "cpp"].contains(&block.language.as_str()))
        .then_some(name)
}

/// Returns whether `text` matches `pattern`: equal except for trailing space, with `...` for anything.
fn matches_pattern(pattern: &str, text: &str) -> bool {
    let trimmed = |text: &str| {
        text.lines().map(str::trim_end).collect::<Vec<_>>().join("\n").trim().to_owned()
    };
    let (pattern, text) = (trimmed(pattern), trimmed(text));
    let mut parts = pattern.split("...");
    let Some(mut rest) = text.strip_prefix(parts.next().unwrap()) else { return false };
    let mut last = "";
    for part in parts {
        let Some(offset) = rest.find(part) else { return false };
        rest = &rest[offset + part.len()..];
        last = part;
    }
    // The part after the last `...` must be at the end, however often it occurred before.
    rest.is_empty() || (pattern.contains("...") && text.ends_with(last))
}

#[test]
fn text_matches_a_pattern_except_at_its_ellipses() {
    for (pattern, text, does) in [
        ("a\nb", "a \nb\n", true),
        ("a ... c", "a b c", true),
        ("a\n...\nd", "a\nb\nc\nd", true),
        ("a ...", "a b", true),
        ("... c", "b c c", true),
        ("a\nb", "a\nc", false),
        ("a ... c", "a b", false),
        ("a", "a b", false),
        ("... c", "c d", false),
    ] {
        assert_eq!(matches_pattern(pattern, text), does, "{pattern:?} {text:?}");
    }
}

/// Follows all pages with at most this requirement, with Python of the virtual environment below `target/`.
fn follow_pages(needs: Option<Needs>, environment: Option<&str>) {
    let python = environment.map(|name| Path::new(ROOT).join("target").join(name).join("bin"));
    let installed = python.as_ref().is_none_or(|python| python.join("python3").exists());
    assert!(installed, "run tests/{}/install first", environment.unwrap_or_default());
    let mut paths = pages();
    paths.retain(|path| {
        PAGES.iter().find(|(other, _)| path == other).map(|(_, needs)| *needs) == needs
    });
    map_in_parallel(&paths, |path| Reader::new(path, python.clone()).perform_steps());
}

#[test]
fn short_pages_run_as_documented() {
    follow_pages(None, None);
}

#[test]
#[ignore = "runs the chapter's cases and others to their ends: a minute"]
fn long_pages_run_as_documented() {
    follow_pages(Some(Needs::Time), None);
}

#[test]
#[ignore = "needs the readers that tests/readers/install installs"]
fn reader_pages_run_as_documented() {
    follow_pages(Some(Needs::Readers), Some("readers"));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn python_package_pages_run_as_documented() {
    follow_pages(Some(Needs::Package), Some("python"));
}

const TRAIN: &str = "docs/how-to/train.md";

/// Follows the page about training, with Python of target/learning.
pub fn follow_training() {
    follow_pages(Some(Needs::Learning), Some("learning"));
}

const CPP: &str = "docs/how-to/cpp.md";

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn cpp_law_page_runs_as_documented() {
    let reader = Reader::new(CPP, None);
    let workspace = reader.folder.path();
    std::fs::create_dir(workspace.join("target")).unwrap();
    std::os::unix::fs::symlink(crate::cpp::library(), workspace.join("target/release")).unwrap();
    reader.perform_steps();
}

#[test]
fn pages_show_their_example_files_verbatim() {
    let policy = ["policy.py", "train.py", "drive.py", "laws.toml"];
    let policy = policy.map(|name| {
        let page_name = format!("policy/{name}");
        ("docs/how-to/policy.md", "#", page_name, format!("bindings/python/examples/policy/{name}"))
    });
    let trained = ["train.py", "drive.py", "laws.toml"].map(|name| {
        (TRAIN, "#", format!("sb3/{name}"), format!("bindings/python/examples/sb3/{name}"))
    });
    let law = "bindings/c/examples/tanh.cpp".to_owned();
    for (path, comment, name, example) in
        policy.into_iter().chain(trained).chain([(CPP, "//", "cpp/tanh.cpp".to_owned(), law)])
    {
        let file_blocks = blocks(&page(path));
        let file_block =
            file_blocks.iter().find(|block| file_name(block) == Some(&name)).expect(&name);
        assert_eq!(file_block.text, format!("{comment} {name}\n{}", page(&example)), "{path}");
    }
}

#[test]
fn tutorial_pages_share_no_name_of_a_folder_or_run() {
    // A reader follows all chapters in one folder, where no command overwrites a run.
    let mut names = std::collections::BTreeMap::new();
    let summary = page("docs/SUMMARY.md");
    for path in summary.split(['(', ')']).filter(|part| part.starts_with("tutorial/")) {
        for command in blocks(&page(&format!("docs/{path}"))).iter().flat_map(commands) {
            let arguments = split_arguments(&command);
            for pair in arguments.windows(2).filter(|pair| ["new", "--out"].contains(&&*pair[0])) {
                let before = names.insert(pair[1].clone(), path.to_owned());
                assert!(before.is_none(), "{path} and {before:?} both make {}", pair[1]);
            }
        }
    }
    assert!(names.len() > 15, "{names:?}");
}

#[test]
fn readme_test_command_equals_the_ci_test_command() {
    let found = blocks(&page("README.md"));
    let command = found.iter().flat_map(commands).find(|command| command.starts_with("cargo test"));
    let command = command.expect("the README names the tests");
    assert!(page(".ci/run").lines().any(|line| line == command), "{command}");
}
