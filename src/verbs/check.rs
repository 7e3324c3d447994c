//! `phalanx check`: validates a scenario and prints what can be predicted before it runs.

use std::time::{Duration, Instant};

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use outcome::results::summary::to_json;
use protocol::catalog::Catalog;
use serde::Serialize;
use supervisor::requirements::Requirements;

use super::scenario::ScenarioArgs;
use super::screen::{OutputFormat, print, print_info, print_result};
use experiment::check::{self, Theory};
use experiment::drawing::{DrawingLanguage, draw_graph};

/// Arguments of `phalanx check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Output format.
    #[arg(long, value_enum, default_value_t = OutputFormat::Text)]
    output: OutputFormat,
    /// Print the formation graph as a drawing instead.
    #[arg(long, value_parser = drawing_parser(), value_name = "FORMAT", conflicts_with = "output")]
    graph: Option<DrawingLanguage>,
}

/// Minimum time between two progress lines of a check.
const PROGRESS_INTERVAL_MIN: Duration = Duration::from_secs(2);

/// Progress lines on stderr for a check that takes long.
struct CheckProgress {
    last_print_time: Instant,
}

impl CheckProgress {
    /// Prints how many single failures and link cuts have been checked, at most once in [`PROGRESS_INTERVAL_MIN`].
    fn print_if_due(&mut self, checked: usize, total: usize) {
        if self.last_print_time.elapsed() >= PROGRESS_INTERVAL_MIN {
            self.last_print_time = Instant::now();
            print_info(&format!("{checked} of {total} single deaths and cuts checked"));
        }
    }
}

/// Results of a check, as JSON has them.
#[derive(Serialize)]
struct CheckResults<'t> {
    #[serde(flatten)]
    theory: &'t Theory<'t>,
    /// Resources of the machine that a run needs.
    needs: Requirements,
}

fn drawing_parser() -> impl TypedValueParser<Value = DrawingLanguage> {
    let mermaid =
        PossibleValue::new("mermaid").help("Mermaid, which GitHub and many editors render");
    let dot = PossibleValue::new("dot").help("Graphviz; convert with `| dot -Tsvg`");
    let to_language =
        |text: String| if text == "dot" { DrawingLanguage::Dot } else { DrawingLanguage::Mermaid };
    PossibleValuesParser::new([mermaid, dot]).map(to_language)
}

pub(super) fn check(args: &CheckArgs, catalog: &Catalog) -> Result<u8, u8> {
    let (scenario, _) = args.scenario.read(catalog)?;
    if let Some(drawing) = args.graph {
        return Ok(print(&draw_graph(&scenario, drawing)));
    }
    let needs = Requirements::for_run(&scenario);
    for refusal in needs.refusals() {
        print_info(&format!("warning: this machine would refuse the run: {refusal}"));
    }
    let mut progress = CheckProgress { last_print_time: Instant::now() };
    let theory =
        Theory::compute_with_progress(&scenario, &mut |done, all| progress.print_if_due(done, all));
    let text = match args.output {
        OutputFormat::Text => check::format_report(&scenario, &theory) + &needs.to_string(),
        OutputFormat::Json => to_json(&CheckResults { theory: &theory, needs }),
    };
    Ok(print_result(args.output, &text))
}
