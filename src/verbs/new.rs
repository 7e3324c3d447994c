//! `phalanx new`: creates a folder to start an experiment from.

mod shipped;

use std::fs;
use std::io;
use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;
use protocol::catalog::Catalog;
use protocol::process::exit;

use super::screen::{print, print_failure};
use experiment::schema;

const SCENARIO_TEMPLATE: &str = include_str!("new/scenario.toml");
const LAW_TEMPLATE: &str = include_str!("new/law.rs");

/// Arguments of `phalanx new`.
#[derive(Debug, Args)]
pub struct NewArgs {
    /// Name of the experiment and of the folder to create: a letter, then letters, digits, `-` or `_`.
    #[arg(value_name = "NAME", value_parser = parse_name)]
    name: String,
    /// Start from one of the shipped scenarios.
    #[arg(long, value_name = "SCENARIO", value_parser = PossibleValuesParser::new(shipped::SCENARIOS.iter().map(|(name, _)| *name)))]
    from: Option<String>,
}

fn parse_name(name: &str) -> Result<String, String> {
    let mut characters = name.chars();
    let has_valid_start =
        characters.next().is_some_and(|character| character.is_ascii_alphabetic());
    let has_valid_rest =
        characters.all(|character| character.is_ascii_alphanumeric() || "-_".contains(character));
    if has_valid_start && has_valid_rest {
        Ok(name.to_owned())
    } else {
        Err("must be a letter, then letters, digits, `-` or `_`".into())
    }
}

pub(super) fn new(NewArgs { name, from }: &NewArgs, catalog: &Catalog) -> u8 {
    let folder = PathBuf::from(name);
    if let Err(error) = fs::create_dir(&folder) {
        if error.kind() == io::ErrorKind::AlreadyExists {
            print_failure(&format_args!(
                "{} exists already; choose another name",
                folder.display()
            ));
            return exit::USAGE_ERROR;
        }
        return print_failure(&format_args!("cannot create {}: {error}", folder.display()));
    }
    let shipped_scenario =
        shipped::SCENARIOS.iter().find(|(shipped_name, _)| from.as_deref() == Some(shipped_name));
    let scenario = match shipped_scenario {
        Some((shipped_name, text)) => {
            let text =
                text.replace(&format!("name = \"{shipped_name}\""), &format!("name = \"{name}\""));
            format!("#:schema scenario.schema.json\n{text}")
        }
        None => SCENARIO_TEMPLATE.replace("NAME", name),
    };
    let referenced_files =
        shipped::REFERENCED_FILES.iter().filter(|(file, _)| scenario.contains(file));
    let referenced_files: Vec<_> = referenced_files
        .map(|&(file, text)| (file, text.to_owned(), "the scenario names it"))
        .collect();
    let files = [
        ("scenario.toml", scenario, "the experiment, with comments"),
        (
            "scenario.schema.json",
            schema::scenario_schema(catalog),
            "for completion and validation in editors",
        ),
        (
            "law.rs",
            LAW_TEMPLATE.to_owned(),
            "a control law to start from; delete it if you need none",
        ),
    ];
    let files = files.into_iter().chain(referenced_files);
    let mut listing = String::new();
    for (file, text, description) in files {
        let path = folder.join(file);
        if let Err(error) = fs::write(&path, text) {
            return print_failure(&format_args!("cannot write {}: {error}", path.display()));
        }
        listing += &format!("{:<32}  {description}\n", path.display().to_string());
    }
    print(&format!("{listing}\nnext: phalanx run {name}/scenario.toml --pace lockstep\n"))
}
