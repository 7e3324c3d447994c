//! Runs of a campaign: for each a valid scenario, its command line and its identity.
//!
//! The identity is the SHA-256 of the time mode, of the effective scenario, of the external programs of the robots, and
//! of the executable. Runs with the same identity are the same run, however the file is written.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use crate::scenario::Scenario;
use crate::scenario::diagnostic::Diagnostic;
use crate::scenario::read::{Overrides, read_for_run, scenario_folder};
use protocol::catalog::Catalog;
use sha2::{Digest, Sha256};

use crate::campaign::axes::{AxisKind, NO_FAULT_VALUE, Setting};
use crate::campaign::file::Campaign;
use crate::campaign::starts::StartsError;

/// One run of a campaign.
#[derive(Debug, Clone, PartialEq)]
pub struct CampaignRun {
    /// Row in the table of all runs, from 1.
    pub number: usize,
    /// Index of the point of the grid.
    pub point_index: usize,
    /// Seed of the random number generator.
    pub seed: u64,
    /// Identity, 64 hexadecimal digits. It is the name of the run's directory.
    pub id: String,
    /// Path of the scenario file that the run is based on.
    pub scenario: PathBuf,
    /// Overrides that turn the scenario file into this run.
    pub overrides: Overrides,
    /// d, minimum distance, m.
    pub distance_min_m: f64,
    /// Maximum duration of the run, s.
    pub duration_s: f64,
}

/// Reason why a run of the campaign is invalid.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum CampaignRunError {
    /// The scenario of the run has an error.
    #[error("{diagnostic}")]
    Scenario { diagnostic: Box<Diagnostic>, run: String },
    /// A file of an external program that robots of the run execute cannot be read.
    #[error("cannot read {}: {source} ({run})", path.display())]
    Program { path: PathBuf, source: io::Error, run: String },
    /// No starts can be drawn.
    #[error("{source} ({run})")]
    Starts { source: StartsError, run: String },
}

/// Returns the runs whose numbers are selected, in order. Seeds vary fastest.
pub fn campaign_runs(
    campaign: &Campaign,
    catalog: &Catalog,
    executable: &str,
    is_selected: impl Fn(usize) -> bool,
) -> Result<Vec<CampaignRun>, CampaignRunError> {
    let mut runs = Vec::new();
    for point in 0..campaign.point_count() {
        let settings = campaign.settings_at(point);
        let overrides = point_overrides(campaign, &settings);
        // The last axis that sets it takes precedence.
        let cases = || settings.iter().rev().map(|setting| &setting.case);
        let file = cases().find_map(|case| case.scenario.as_ref()).unwrap_or(&campaign.scenario);
        let starts = cases()
            .find_map(|case| case.random_starts.as_ref())
            .or(campaign.random_starts.as_ref());
        // The first run of a point determines its robots.
        let mut point_scenario: Option<Scenario> = None;
        let seeds: Vec<Option<u64>> = match campaign.seeds.is_empty() {
            true => vec![None],
            false => campaign.seeds.iter().copied().map(Some).collect(),
        };
        let first_number = point * campaign.runs_per_point() + 1;
        for (number, seed) in (first_number..).zip(seeds).filter(|(number, _)| is_selected(*number))
        {
            let run = || describe_settings(campaign, &settings, seed);
            let to_error = |diagnostic| CampaignRunError::Scenario {
                diagnostic: Box::new(diagnostic),
                run: run(),
            };
            let read =
                |overrides: &Overrides| read_for_run(file, overrides, catalog).map_err(to_error);
            let mut overrides = Overrides { seed, ..overrides.clone() };
            if let (Some(starts), Some(seed)) = (starts, seed) {
                if point_scenario.is_none() {
                    point_scenario = Some(read(&overrides)?.0);
                }
                let assignments = starts.draw(point_scenario.as_ref().expect("just read"), seed);
                overrides.assignments.extend(
                    assignments
                        .map_err(|source| CampaignRunError::Starts { source, run: run() })?,
                );
            }
            let (scenario, ..) = read(&overrides)?;
            let mut hash = Sha256::new();
            for part in [campaign.pace.keyword(), &format!("{scenario:?}"), executable] {
                hash.update((part.len() as u64).to_le_bytes());
                hash.update(part);
            }
            for (name, path) in program_files(&scenario, file) {
                let text = std::fs::read(&path).map_err(|source| CampaignRunError::Program {
                    path: path.clone(),
                    source,
                    run: run(),
                })?;
                hash.update((name.len() as u64).to_le_bytes());
                hash.update(name);
                hash.update((text.len() as u64).to_le_bytes());
                hash.update(text);
            }
            runs.push(CampaignRun {
                number,
                point_index: point,
                seed: scenario.seed,
                id: format_hex(&hash.finalize()),
                scenario: file.clone(),
                overrides,
                distance_min_m: scenario.avoidance.distance_min_m,
                duration_s: formation::ns_to_seconds(scenario.duration_ns),
            });
        }
    }
    Ok(runs)
}

/// Returns the files of the external programs of the robots, with their paths.
fn program_files(scenario: &Scenario, path: &Path) -> Vec<(String, PathBuf)> {
    scenario.programs().flat_map(|program| program.files(scenario_folder(path))).collect()
}

/// Returns the overrides of all runs at a point of the grid.
fn point_overrides(campaign: &Campaign, settings: &[&Setting]) -> Overrides {
    let mut overrides =
        Overrides { assignments: campaign.assignments.clone(), ..Overrides::default() };
    let mut templates = campaign.faults.clone();
    for (axis, setting) in campaign.axes.iter().zip(settings) {
        match axis.kind {
            AxisKind::Key => overrides.assignments.push(format!("{}={}", axis.key, setting.toml)),
            AxisKind::Fault => overrides.faults.extend(setting.faults.iter().cloned()),
            AxisKind::Cases => {
                overrides.assignments.extend(setting.case.assignments.iter().cloned());
                overrides.faults.extend(setting.faults.iter().cloned());
            }
            AxisKind::FaultPlaceholder => {
                let placeholder = format!("{{{}}}", axis.key);
                if setting.display_text == NO_FAULT_VALUE {
                    templates.retain(|fault| !fault.contains(&placeholder));
                }
                for fault in &mut templates {
                    *fault = fault.replace(&placeholder, &setting.display_text);
                }
            }
        }
    }
    overrides.faults.extend(templates);
    overrides
}

fn describe_settings(campaign: &Campaign, settings: &[&Setting], seed: Option<u64>) -> String {
    let mut description = String::from("in the run");
    let axes = campaign.axes.iter().zip(settings);
    let mut separator = " with";
    for (key, value) in
        axes.map(|(axis, setting)| (axis.key.as_str(), setting.display_text.clone()))
    {
        let _ = write!(description, "{separator} {key} = {value}");
        separator = ",";
    }
    if let Some(seed) = seed {
        let _ = write!(description, "{separator} seed {seed}");
    }
    description + &format!(" of {}", campaign.path.display())
}

impl CampaignRun {
    /// Returns the settings of a run as text.
    pub fn describe(&self, campaign: &Campaign) -> String {
        describe_settings(campaign, &campaign.settings_at(self.point_index), self.overrides.seed)
    }

    /// Returns the arguments that run it with the output directory `output_folder`, without the executable.
    pub fn arguments(&self, campaign: &Campaign, output_folder: &Path) -> Vec<String> {
        let text = |path: &Path| path.to_string_lossy().into_owned();
        // Absolute, because the working directory of the run is unknown.
        let scenario = self.scenario.canonicalize();
        let mut arguments = vec![
            "run".to_owned(),
            text(scenario.as_deref().unwrap_or(&self.scenario)),
            "--pace".into(),
            campaign.pace.keyword().into(),
        ];
        if let Some(seed) = self.overrides.seed {
            arguments.extend(["--seed".into(), seed.to_string()]);
        }
        for set in &self.overrides.assignments {
            arguments.extend(["--set".into(), set.clone()]);
        }
        for fault in &self.overrides.faults {
            arguments.extend(["--fault".into(), fault.clone()]);
        }
        let (keep, deadline) = (campaign.file_retention.keyword(), campaign.deadline_s.to_string());
        arguments.extend(["--cell".into(), text(output_folder), "--keep".into(), keep.into()]);
        arguments.extend(["--deadline-s".into(), deadline]);
        arguments
    }
}

/// Returns the SHA-256 of the running executable.
pub fn executable_sha256() -> io::Result<String> {
    sha256(File::open("/proc/self/exe")?)
}

/// Returns the SHA-256 of the content of a reader, as 64 hexadecimal digits.
pub fn sha256(mut reader: impl Read) -> io::Result<String> {
    let (mut hash, mut buffer) = (Sha256::new(), vec![0; 1 << 16]);
    loop {
        match reader.read(&mut buffer) {
            Ok(0) => return Ok(format_hex(&hash.finalize())),
            Ok(read) => hash.update(&buffer[..read]),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

fn format_hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |text, byte| text + &format!("{byte:02x}"))
}
