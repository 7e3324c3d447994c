//! `phalanx schema`: the format of scenario and campaign files, as JSON Schema or as a page.

use clap::Args;
use protocol::catalog::Catalog;

use super::screen::{OutputFormat, print, print_result};
use experiment::{reference, schema};

/// Arguments of `phalanx schema`.
#[derive(Debug, Args)]
pub struct SchemaArgs {
    /// Print a Markdown page that lists every key, instead of the JSON Schema.
    #[arg(long)]
    markdown: bool,
    /// Describe campaign files, for `phalanx sweep`, instead of scenario files.
    #[arg(long)]
    campaign: bool,
}

pub(super) fn schema(args: &SchemaArgs, catalog: &Catalog) -> u8 {
    match (args.campaign, args.markdown) {
        (true, true) => print(&experiment::campaign::keys::campaign_reference_page()),
        (true, false) => {
            print_result(OutputFormat::Json, &experiment::campaign::keys::campaign_schema())
        }
        (false, true) => print(&reference::reference_page(catalog)),
        (false, false) => print_result(OutputFormat::Json, &schema::scenario_schema(catalog)),
    }
}
