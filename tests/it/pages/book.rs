//! `README.md`, `CONTRIBUTING.md` and the book in `docs/`: each block of shell is what the command line
//! takes, and is run if it can be; each block of TOML is read.
//!
//! A page is followed from its top in a folder of its own, which has `scenarios/` and `bindings/`. A block whose first
//! line is `# NAME` is the file of that name. A block of text right after a block of shell is what that
//! one prints, on both streams; `...` in it stands for anything. A command that ends with another exit
//! code than 0 says so: `# exit code 1`.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use clap::Parser as _;
use experiment::scenario::keys::{Format, Section, Takes};
use phalanx::command_line::CommandLine;
use tempfile::TempDir;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Commands that tests cannot run: they are the tests, take minutes or change the machine.
const ELSEWHERE: &[&str] = &[
    "cargo ",
    "tests/",
    "bench/",
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

/// Pages whose runs take long, and are run by `cargo test --test it -- --ignored pages::`.
const LONG: &[&str] =
    &["docs/how-to/chapter.md", "docs/how-to/faults.md", "docs/faults.md", "docs/chapter.md"];

/// Pages with Python in them, which needs what `tests/readers/install` installs.
const PYTHON: &[&str] = &["docs/how-to/graph.md", "docs/how-to/analyse.md"];

/// Pages about the Python package, which `tests/python/install` installs.
const PACKAGE: &[&str] = &[
    "bindings/python/README.md",
    "docs/tutorial/python.md",
    "docs/how-to/plant.md",
    "docs/hardware.md",
    "docs/how-to/policy.md",
];

/// Pages with C++, which needs what `tests/cpp/install` installs, and the library of `c/`.
const CPP: &[&str] = &["docs/how-to/cpp.md"];

/// Pages that change the program, and are played by tests of their own.
const BUILDS: &[&str] = &["docs/tutorial/law.md"];

#[derive(Debug, Clone)]
struct Block {
    language: String,
    line: usize,
    text: String,
    /// Nothing but blank lines between it and the block before it.
    follows: bool,
}

/// The fenced blocks of a page, in order.
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
    assert!(open.is_none(), "a block has no end");
    found
}

/// Every page: path and text.
fn pages() -> Vec<(String, String)> {
    let mut paths =
        vec!["README.md".into(), "CONTRIBUTING.md".into(), "bindings/python/README.md".into()];
    let mut folders = vec![PathBuf::from("docs")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(Path::new(ROOT).join(&folder)).unwrap() {
            let path = folder.join(entry.unwrap().file_name());
            if Path::new(ROOT).join(&path).is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "md") {
                paths.push(path.to_str().unwrap().to_owned());
            }
        }
    }
    paths.sort();
    let text = |path: String| {
        let text = std::fs::read_to_string(Path::new(ROOT).join(&path)).unwrap();
        (path, text)
    };
    paths.into_iter().map(text).collect()
}

/// The commands of a block of shell, as a reader types them who has `phalanx` on the path.
fn commands(block: &Block) -> Vec<String> {
    let text = block.text.replace("\\\n", " ");
    let lines = text.lines().filter(|line| !line.trim().is_empty() && !line.starts_with('#'));
    let said = [
        ("cargo run --release -- ", "phalanx "),
        ("cargo run --profile dist -p bench -- ", "phalanx bench "),
    ];
    lines.map(|line| said.iter().fold(line.to_owned(), |line, (a, b)| line.replace(a, b))).collect()
}

/// The words of a command, without quotes, comment, redirection and pipe.
fn words(command: &str) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), None::<String>, None);
    for letter in command.chars() {
        match (quote, letter) {
            (None, '\'' | '"') => {
                quote = Some(letter);
                word.get_or_insert_default();
            }
            (Some(mark), letter) if mark == letter => quote = None,
            (None, ' ') => words.extend(word.take()),
            _ => word.get_or_insert_default().push(letter),
        }
    }
    words.extend(word);
    let end = words.iter().position(|word| ["#", ">", "|", "&&"].contains(&word.as_str()));
    words.truncate(end.unwrap_or(words.len()));
    words
}

/// Whether a test can run a command: neither for long nor with a browser.
fn runs(command: &str) -> bool {
    let elsewhere = ELSEWHERE.iter().any(|begins| command.starts_with(begins));
    let by_the_clock = command.starts_with("phalanx run ") && !command.contains("--pace lockstep");
    !elsewhere && !by_the_clock && !command.contains("--view")
}

#[test]
fn every_command_of_every_page_is_one_that_the_program_takes() {
    let mut parsed = 0;
    for (path, text) in pages() {
        for block in blocks(&text).iter().filter(|block| block.language == "sh") {
            for command in commands(block) {
                let Some(rest) = command.strip_prefix("phalanx ") else {
                    let known = [
                        "cargo ",
                        "tests/",
                        "bench/",
                        "proof/",
                        "target/",
                        ".ci/",
                        "docker ",
                        "pip ",
                        ". ",
                        "python3 ",
                        "export ",
                        "cp ",
                        "g++ ",
                        "sed ",
                        "head ",
                        "cat ",
                        "cmp ",
                        "grep ",
                        "ls ",
                        "parallel ",
                        "perf ",
                    ];
                    let known = known.iter().any(|begins| command.starts_with(begins));
                    assert!(known, "{path}:{}: what is `{command}`?", block.line);
                    continue;
                };
                let words = ["phalanx".to_owned()].into_iter().chain(words(rest));
                let words: Vec<String> = words.collect();
                let mut parsed_as = CommandLine::try_parse_from(&words).map(drop);
                if words[1] == "bench" {
                    parsed_as = bench::cli::CommandLine::try_parse_from(&words[1..]).map(drop);
                }
                if let Err(error) = parsed_as {
                    panic!("{path}:{}: `{command}`: {error}", block.line);
                }
                parsed += 1;
            }
        }
    }
    assert!(parsed > 20, "{parsed} commands");
}

#[test]
fn every_block_says_what_it_is() {
    let languages =
        ["sh", "toml", "text", "rust", "python", "c", "cpp", "xml", "json", "dockerfile"];
    for (path, text) in pages() {
        for block in blocks(&text) {
            let known = languages.contains(&block.language.as_str());
            assert!(known, "{path}:{}: a block of {:?}", block.line, block.language);
        }
    }
}

#[test]
fn every_block_of_toml_has_only_keys_of_scenarios_campaigns_or_fleets() {
    let format = Format::of(&agent::catalog());
    let mut found = 0;
    for (path, text) in pages() {
        for block in blocks(&text).iter().filter(|block| block.language == "toml") {
            let at = format!("{path}:{}", block.line);
            let table: toml::Table =
                block.text.parse().unwrap_or_else(|error| panic!("{at}: {error}"));
            if block.text.starts_with("# Cargo.toml") {
                continue;
            }
            if table.contains_key("host") {
                let fleet = bridge::fleet::read_text(Path::new(&path), &block.text);
                fleet.unwrap_or_else(|error| panic!("{at}: {}", error.render(false)));
                found += 1;
                continue;
            }
            let campaign = experiment::campaign::keys::format();
            let format = if table.contains_key("scenario") { &campaign } else { &format };
            assert_keys(&at, &table, format.root(), format);
            found += 1;
        }
    }
    assert!(found >= 4, "{found} blocks");
}

#[track_caller]
fn assert_keys(at: &str, table: &toml::Table, section: &Section, format: &Format) {
    for (name, value) in table {
        let key =
            section.key(name).unwrap_or_else(|| panic!("{at}: no key {name} in {}", section.name));
        match (key.takes, value) {
            // Of a campaign: keys of the scenario.
            (Takes::Table("set" | "vary"), toml::Value::Table(_)) => {}
            (Takes::Table(inner), toml::Value::Table(table)) => {
                assert_keys(at, table, format.section(inner), format);
            }
            (Takes::Tables(inner), toml::Value::Array(tables)) => {
                for table in tables {
                    assert_keys(at, table.as_table().expect(name), format.section(inner), format);
                }
            }
            (Takes::NamedTables(inner), toml::Value::Table(tables)) => {
                for table in tables.values() {
                    assert_keys(at, table.as_table().expect(name), format.section(inner), format);
                }
            }
            (Takes::Table(_) | Takes::Tables(_) | Takes::NamedTables(_), _) => {
                panic!("{at}: {name} = {value}")
            }
            _ => {}
        }
    }
}

/// A reader of a page.
struct Reader {
    path: String,
    folder: TempDir,
    run_root: TempDir,
    /// In which Python finds what pages import; none: no Python is run.
    python: Option<PathBuf>,
}

impl Reader {
    fn of(path: &str) -> Reader {
        let folder = tempfile::tempdir().unwrap();
        for shipped in ["scenarios", "bindings"] {
            let target = Path::new(ROOT).join(shipped);
            std::os::unix::fs::symlink(target, folder.path().join(shipped)).unwrap();
        }
        let run_root = tempfile::Builder::new().prefix("phx").tempdir_in("/dev/shm").unwrap();
        Reader { path: path.into(), folder, run_root, python: None }
    }

    /// Does all that the page says that can be done.
    fn follow(&self) {
        let text = std::fs::read_to_string(Path::new(ROOT).join(&self.path)).unwrap();
        let mut printed: Option<String> = None;
        for block in blocks(&text) {
            let at = format!("{}:{}", self.path, block.line);
            if let Some(name) = file_name(&block) {
                let path = self.folder.path().join(name);
                std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                std::fs::write(path, &block.text).unwrap();
            } else if block.language == "sh" {
                printed = self.run(&at, &block);
                continue;
            } else if block.language == "text"
                && block.follows
                && let Some(printed) = &printed
            {
                assert!(fits(&block.text, printed), "{at}: not so, but:\n{printed}");
            }
            printed = None;
        }
    }

    /// What the commands of a block print; none if not all of them can be run.
    fn run(&self, at: &str, block: &Block) -> Option<String> {
        let mut all = Some(String::new());
        for command in commands(block) {
            let python = command.starts_with("python3 ") && self.python.is_some();
            if !runs(&command) && !python {
                all = None;
                continue;
            }
            let (code, printed) = self.shell(&command);
            let expected = command.split_once("# exit code ").map_or("0", |(_, code)| code.trim());
            assert_eq!(code.to_string(), expected, "{at}: `{command}`:\n{printed}");
            all = all.map(|all| all + &printed);
        }
        all
    }

    fn shell(&self, command: &str) -> (i32, String) {
        let program = Path::new(env!("CARGO_BIN_EXE_phalanx")).parent().unwrap();
        let path = std::env::var("PATH").unwrap();
        let python =
            self.python.as_ref().map_or(String::new(), |python| format!("{}:", python.display()));
        let output = Command::new("bash")
            .args(["-o", "pipefail", "-c", &format!("exec 2>&1; {command}")])
            .current_dir(self.folder.path())
            .env("PATH", format!("{}:{python}{path}", program.display()))
            .env("PHALANX_RUN_ROOT", self.run_root.path())
            .env("NO_COLOR", "1")
            .stdin(Stdio::null())
            .output()
            .unwrap();
        (output.status.code().unwrap_or(-1), String::from_utf8_lossy(&output.stdout).into_owned())
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        for base in std::fs::read_dir(self.run_root.path()).into_iter().flatten().flatten() {
            protocol::run_root::sweep(&base.path());
        }
    }
}

/// The file that a block is, if its first line says so.
fn file_name(block: &Block) -> Option<&str> {
    let name = block.text.lines().next()?.strip_prefix("# ").or(block
        .text
        .lines()
        .next()?
        .strip_prefix("// "))?;
    let like_a_file = name.contains('.') && !name.contains(' ') && !name.ends_with('.');
    (like_a_file && ["toml", "python", "rust", "cpp"].contains(&block.language.as_str()))
        .then_some(name)
}

/// Whether a text is a pattern: the same but for trailing space, where `...` is anything.
fn fits(pattern: &str, text: &str) -> bool {
    let trimmed = |text: &str| {
        text.lines().map(str::trim_end).collect::<Vec<_>>().join("\n").trim().to_owned()
    };
    let (pattern, text) = (trimmed(pattern), trimmed(text));
    let mut parts = pattern.split("...");
    let Some(mut rest) = text.strip_prefix(parts.next().unwrap()) else { return false };
    let mut last = "";
    for part in parts {
        let Some(at) = rest.find(part) else { return false };
        rest = &rest[at + part.len()..];
        last = part;
    }
    // After the last `...` comes the end, however often that part was there before.
    rest.is_empty() || (pattern.contains("...") && text.ends_with(last))
}

#[test]
fn a_text_fits_a_pattern_if_only_what_it_leaves_open_differs() {
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
        assert_eq!(fits(pattern, text), does, "{pattern:?} {text:?}");
    }
}

#[test]
fn what_the_short_pages_say_happens() {
    let special = [LONG, PYTHON, PACKAGE, CPP, BUILDS].concat();
    for (path, _) in pages().iter().filter(|(path, _)| !special.contains(&path.as_str())) {
        Reader::of(path).follow();
    }
}

#[test]
#[ignore = "runs the chapter's cases and others to their ends: a minute"]
fn what_the_long_pages_say_happens() {
    for path in LONG {
        Reader::of(path).follow();
    }
}

#[test]
#[ignore = "needs the readers that tests/readers/install installs"]
fn what_the_pages_with_python_say_happens_where_readers_are() {
    let python = Path::new(ROOT).join("target/readers/bin");
    assert!(python.join("python3").exists(), "run tests/readers/install first");
    for path in PYTHON {
        let mut reader = Reader::of(path);
        reader.python = Some(python.clone());
        reader.follow();
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn what_the_pages_about_the_python_package_say_happens() {
    let python = Path::new(ROOT).join("target/python/bin");
    assert!(python.join("phalanx").exists(), "run tests/python/install first");
    for path in PACKAGE {
        let mut reader = Reader::of(path);
        reader.python = Some(python.clone());
        reader.follow();
    }
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn what_the_page_about_laws_in_cpp_says_happens() {
    for path in CPP {
        let reader = Reader::of(path);
        let there = reader.folder.path();
        std::fs::create_dir(there.join("target")).unwrap();
        std::os::unix::fs::symlink(crate::cpp::library(), there.join("target/release")).unwrap();
        reader.follow();
    }
}

#[test]
fn the_page_about_laws_in_cpp_shows_the_example() {
    let page = std::fs::read_to_string(Path::new(ROOT).join(CPP[0])).unwrap();
    let example =
        std::fs::read_to_string(Path::new(ROOT).join("bindings/c/examples/tanh.cpp")).unwrap();
    let shown = blocks(&page).into_iter().find(|block| file_name(block) == Some("vee/tanh.cpp"));
    assert_eq!(shown.expect("the law").text, format!("// vee/tanh.cpp\n{example}"));
}

#[test]
fn the_page_about_a_policy_shows_the_example() {
    let page = std::fs::read_to_string(Path::new(ROOT).join("docs/how-to/policy.md")).unwrap();
    let shown = blocks(&page);
    for name in ["policy.py", "train.py", "drive.py", "laws.toml"] {
        let file = Path::new(ROOT).join("bindings/python/examples/policy").join(name);
        let file = std::fs::read_to_string(file).unwrap();
        let name = format!("policy/{name}");
        let block = shown.iter().find(|block| file_name(block) == Some(&name));
        assert_eq!(block.expect(&name).text, format!("# {name}\n{file}"));
    }
}

#[test]
fn the_readmes_test_command_is_the_one_that_continuous_integration_runs() {
    let readme = std::fs::read_to_string(Path::new(ROOT).join("README.md")).unwrap();
    let found = blocks(&readme);
    let command = found.iter().flat_map(commands).find(|command| command.starts_with("cargo test"));
    let command = command.expect("the README names the tests");
    let ci = std::fs::read_to_string(Path::new(ROOT).join(".ci/run")).unwrap();
    assert!(ci.lines().any(|line| line == command), "{command}");
}
