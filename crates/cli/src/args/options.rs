//! Options of the commands that have many.

use super::values::seconds;
use super::{AnglesArg, ByArg, PipelineArgs, RowsArg, StrictArgs};
use clap::Args;
use std::path::PathBuf;

/// What `aloft run` runs.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// The pipeline.
    #[command(flatten)]
    pub pipeline: PipelineArgs,
    /// Begin with this stage; earlier ones must be up to date.
    #[arg(long, value_name = "STAGE")]
    pub from: Option<String>,
    /// Run this stage only.
    #[arg(long, value_name = "STAGE", conflicts_with_all = ["from", "until"])]
    pub only: Option<String>,
    /// End with this stage.
    #[arg(long, value_name = "STAGE")]
    pub until: Option<String>,
    /// Only these trials (name or pattern; may be given several times).
    #[arg(long, value_name = "GLOB")]
    pub trial: Vec<String>,
    /// Say what would run, and run nothing.
    #[arg(long)]
    pub dry_run: bool,
    /// Run also what is up to date.
    #[arg(long)]
    pub force: bool,
    /// Work beside other runs on the same workspace, each on trials or stages of its own (jobs
    /// of a cluster).
    #[arg(long)]
    pub shared: bool,
    /// Wait where another run holds the workspace, instead of saying who it is.
    #[arg(long)]
    pub wait: bool,
    /// Threads (all cores where not given).
    #[arg(short = 'j', value_name = "N")]
    pub jobs: Option<usize>,
    /// Also every warning, single frames, and the table of all recordings.
    #[arg(long)]
    pub details: bool,
}

/// Which parameters `aloft parameters` shows.
#[derive(Debug, Args)]
pub struct ParametersArgs {
    /// The pipeline.
    #[command(flatten)]
    pub pipeline: PipelineArgs,
    /// Results that are not up to date.
    #[command(flatten)]
    pub strict: StrictArgs,
    /// Rows to show instead of the pipeline's choice.
    #[arg(long, value_enum)]
    pub rows: Option<RowsArg>,
    /// First try other window lengths, added noise (SIMEX) and motions that were not made; the
    /// answer stays in the workspace.
    #[arg(long)]
    pub assess: bool,
    /// Robots: also write the trajectories of the flights to record next to this folder, as CSV
    /// to play.
    #[arg(long, value_name = "DIR", requires = "assess")]
    pub next_flights: Option<PathBuf>,
    /// Machine-readable output.
    #[arg(long)]
    pub json: bool,
}

/// What `aloft compare` compares.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The pipeline.
    #[command(flatten)]
    pub pipeline: PipelineArgs,
    /// Results that are not up to date.
    #[command(flatten)]
    pub strict: StrictArgs,
    /// Every way of identifying on the same held-out motion: rows, estimators, landmark and
    /// calibrated geometry, tables.
    #[arg(long)]
    pub estimators: bool,
    /// Each trial predicted from all others, contact and flight apart: from tables, from
    /// flights, from contact, from both.
    #[arg(long, conflicts_with = "estimators")]
    pub leave_one_out: bool,
    /// Only these breakdowns (may be given several times, or as a list with commas).
    #[arg(long, value_enum, value_delimiter = ',', value_name = "WHAT")]
    pub by: Vec<ByArg>,
    /// All breakdowns, single frames, calibration.
    #[arg(long)]
    pub details: bool,
    /// Machine-readable output.
    #[arg(long)]
    pub json: bool,
}

/// What `aloft discover` ranks and shows.
#[derive(Debug, Args)]
pub struct DiscoverArgs {
    /// The pipeline.
    #[command(flatten)]
    pub pipeline: PipelineArgs,
    /// Results that are not up to date.
    #[command(flatten)]
    pub strict: StrictArgs,
    /// Only these effects (may be given several times).
    #[arg(long, value_name = "NAME")]
    pub only: Vec<String>,
    /// Not these effects.
    #[arg(long, value_name = "NAME")]
    pub without: Vec<String>,
    /// Rank the catalogue only: no search for laws beyond it.
    #[arg(long)]
    pub closed: bool,
    /// Time for the search, s (`10` or `10s`): the search for laws beyond the catalogue then
    /// begins nothing new, and the answer says that more time may find more.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub budget: Option<f64>,
    /// Inject effects of known size into these recordings and count how often they come out
    /// under their name.
    #[arg(long)]
    pub self_test: bool,
    /// Compute the answer anew. Without it an answer to the same question is shown again if
    /// nothing that it rests on has changed.
    #[arg(long)]
    pub again: bool,
    /// More candidates, and how each round was decided.
    #[arg(long)]
    pub details: bool,
    /// Machine-readable output.
    #[arg(long)]
    pub json: bool,
}

/// What `aloft export` writes.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// The pipeline.
    #[command(flatten)]
    pub pipeline: PipelineArgs,
    /// Results that are not up to date.
    #[command(flatten)]
    pub strict: StrictArgs,
    /// Folder to write (`export` in the workspace where not given).
    #[arg(long, visible_alias = "out", value_name = "DIR")]
    pub to: Option<PathBuf>,
    /// Formats, with commas between them (all where not given).
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub format: Vec<String>,
    /// Only these trials (name or pattern; may be given several times).
    #[arg(long, value_name = "GLOB")]
    pub trial: Vec<String>,
    /// Joint angles instead of the pipeline's choice.
    #[arg(long, value_enum)]
    pub angles: Option<AnglesArg>,
}
