//! The words that a user types. Help, man pages and completions are made from these definitions.

use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Learns the mass properties of a moving body from its motion in the air, and finds the physics that a model is missing.
#[derive(Debug, Parser)]
#[command(
    name = "aloft",
    version,
    arg_required_else_help = true,
    after_help = "The loop:\n  aloft run P.yaml           from recordings to identified mass properties\n  aloft compare P.yaml       model against measurement, and where it fails\n  aloft discover P.yaml      which effect is missing\n  aloft effect add P.yaml E  add it; the ladder shows the error fall\n  aloft report P.yaml        one page that tells the story\n  aloft status P.yaml        what is done, stale or failed\n\nExit codes: 0 all well; 1 some trials failed, the others are done and kept; 2 the command or configuration is wrong."
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// A pipeline and the folders that it works on.
#[derive(Debug, Args, Clone)]
pub struct PipelineArgs {
    /// Pipeline file (YAML).
    pub pipeline: PathBuf,
    /// Folder of recordings, instead of the pipeline's.
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Folder of results, instead of the pipeline's.
    #[arg(long, value_name = "DIR")]
    pub workspace: Option<PathBuf>,
}

/// Rows that results are built on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RowsArg {
    /// The paper's acceleration rows.
    Paper,
    /// Weak momentum rows.
    Weak,
}

/// Breakdowns of the error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ByArg {
    /// Trials.
    Trial,
    /// Contact, take-off, landing, flight.
    Phase,
    /// Flights.
    Flight,
    /// Fifths of a flight.
    Time,
    /// Axes of the body and of the world.
    Axis,
    /// Speed of the centre of mass.
    Speed,
    /// Acceleration of the centre of mass.
    Acceleration,
    /// Angular speed of the root.
    Turning,
    /// Spread of the body about its centre of mass.
    Posture,
    /// Links, by projection on their inertia and their drag.
    Segment,
}

/// What can be done with effects.
#[derive(Debug, Subcommand)]
pub enum EffectAction {
    /// List the catalogue, and the effects that a pipeline defines.
    List {
        /// Pipeline whose own effects are listed, too.
        pipeline: Option<PathBuf>,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Show one effect's documentation.
    Show {
        /// Identifier.
        name: String,
        /// Pipeline that defines the effect, for effects of your own.
        pipeline: Option<PathBuf>,
    },
    /// Add an effect to the model: a new revision, and what depends on it again.
    #[command(
        after_help = "Examples:\n  aloft effect add P.yaml quadratic_drag\n  aloft effect add P.yaml tether --set anchor_x=0.5"
    )]
    Add {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Identifier, with a target in brackets where there are several: `flywheel[torso]`; also one that the pipeline defines.
        name: String,
        /// Value of a nonlinear parameter, `name=value`; what the last `discover` found where not given.
        #[arg(long, value_name = "K=V", value_parser = key_value)]
        set: Vec<(String, f64)>,
    },
    /// Take an effect out of the model: a new revision without it.
    Remove {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Identifier.
        name: String,
    },
}

fn key_value(text: &str) -> Result<(String, f64), String> {
    let (key, value) = text.split_once('=').ok_or_else(|| format!("`{text}`: expected name=value"))?;
    let value = value.trim().parse().map_err(|_| format!("`{value}` is not a number"))?;
    Ok((key.trim().to_owned(), value))
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the stages of a pipeline; what is up to date is kept.
    #[command(
        after_help = "Examples:\n  aloft run pipelines/demo.yaml\n  aloft run pipelines/human.yaml --data lab/s01 --workspace out/s01\n  aloft run P.yaml --from filter            after a change of the cut-off\n  aloft run P.yaml --trial 'jump0*' --dry-run"
    )]
    Run {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Begin with this stage; earlier ones must be up to date.
        #[arg(long, value_name = "STAGE")]
        from: Option<String>,
        /// Run this stage only.
        #[arg(long, value_name = "STAGE", conflicts_with_all = ["from", "until"])]
        only: Option<String>,
        /// End with this stage.
        #[arg(long, value_name = "STAGE")]
        until: Option<String>,
        /// Only these trials (name or pattern; may be given several times).
        #[arg(long, value_name = "GLOB")]
        trial: Vec<String>,
        /// Say what would run, and run nothing.
        #[arg(long)]
        dry_run: bool,
        /// Run also what is up to date.
        #[arg(long)]
        force: bool,
        /// Threads (all cores where not given).
        #[arg(short = 'j', value_name = "N")]
        jobs: Option<usize>,
    },
    /// Check configuration, labels and files; changes nothing.
    Check {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
    },
    /// Show the grid of trials and stages: ok, warning, stale, failed, blocked, missing, excluded.
    Status {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Say why a result is stale or failed: which input, parameter or version changed.
    Explain {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Trial (or `_study` for stages that run once).
        trial: String,
        /// Stage.
        stage: String,
    },
    /// Show what is in a C3D or TRC file and what is wrong with it.
    Inspect {
        /// Recording.
        file: PathBuf,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Show the identified parameters with intervals and the prior beside them.
    Parameters {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Rows to show instead of the pipeline's choice.
        #[arg(long, value_enum)]
        rows: Option<RowsArg>,
        /// First try other window lengths, added noise (SIMEX) and motions that were not made; the answer stays in the workspace.
        #[arg(long)]
        assess: bool,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Compare the model with measurement: by trial, phase, axis, segment.
    #[command(
        after_help = "Examples:\n  aloft compare P.yaml\n  aloft compare P.yaml --estimators       rows × estimators × geometry on the same held-out motion\n  aloft compare P.yaml --leave-one-out    each trial predicted from the others: prior, flights, contact, both"
    )]
    Compare {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Every way of identifying on the same held-out motion: rows, estimators, landmark and calibrated geometry, the prior.
        #[arg(long)]
        estimators: bool,
        /// Each trial predicted from all others, contact and flight apart: from the prior, from flights, from contact, from both.
        #[arg(long, conflicts_with = "estimators")]
        leave_one_out: bool,
        /// Only these breakdowns (may be given several times, or as a list with commas).
        #[arg(long, value_enum, value_delimiter = ',', value_name = "WHAT")]
        by: Vec<ByArg>,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Say which physical effect or measurement artefact is missing, how sure, and what it can be confused with.
    Discover {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Only these effects (may be given several times).
        #[arg(long, value_name = "NAME")]
        only: Vec<String>,
        /// Not these effects.
        #[arg(long, value_name = "NAME")]
        without: Vec<String>,
        /// Inject effects of known size into these recordings and count how often they come out under their name.
        #[arg(long)]
        self_test: bool,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// List, show, add or remove effects of the model.
    Effect {
        /// What to do with effects.
        #[command(subcommand)]
        action: EffectAction,
    },
    /// Show the ladder: model revisions and their held-out error.
    History {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Write one self-contained HTML page.
    Report {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Where to write it (`report.html` in the workspace where not given).
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Make a laboratory folder of C3D trials with known truth.
    Simulate {
        /// Scenario file (YAML), or the name of a built-in scenario.
        scenario: String,
        /// New or empty folder for the recordings.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
        /// Seed instead of the scenario's.
        #[arg(long)]
        seed: Option<u64>,
    },
    /// Look at a folder of recordings and write a commented pipeline for it.
    Init {
        /// Folder of recordings.
        folder: PathBuf,
        /// Pipeline file to write (`aloft.yaml` in the current folder where not given).
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Show the JSON schema of pipeline files, for editors.
    Schema,
    /// Print shell completions.
    Completions {
        /// Shell.
        shell: clap_complete::Shell,
    },
    /// Print the manual page (troff).
    Man,
}
