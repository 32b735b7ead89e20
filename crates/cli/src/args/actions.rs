//! Actions of the commands `effect` and `markerset`.

use super::PipelineArgs;
use super::values::key_value;
use clap::Subcommand;
use std::path::PathBuf;

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
    #[command(
        after_help = "Examples:\n  aloft effect show tether\n  aloft effect show P.yaml my_drag      an effect that the pipeline defines"
    )]
    Show {
        /// Identifier; before it the pipeline, for effects of your own.
        #[arg(num_args = 1..=2, required = true, value_name = "[PIPELINE] NAME")]
        words: Vec<String>,
    },
    /// Add an effect to the model: a new revision, and what depends on it again.
    #[command(
        after_help = "Examples:\n  aloft effect add P.yaml quadratic_drag\n  aloft effect add P.yaml tether --set anchor_x=0.5"
    )]
    Add {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Identifier, with a target in brackets where there are several: `flywheel[torso]`; also
        /// one that the pipeline defines.
        name: String,
        /// Value of a nonlinear parameter, `name=value`; what the last `discover` found where not
        /// given.
        #[arg(long, value_name = "K=V", value_parser = key_value)]
        set: Vec<(String, f64)>,
        /// Every warning, and more about the revisions.
        #[arg(long)]
        details: bool,
        /// Wait where another process holds the workspace, instead of saying who it is.
        #[arg(long)]
        wait: bool,
    },
    /// Take an effect out of the model: a new revision without it.
    Remove {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Identifier.
        name: String,
        /// Every warning, and more about the revisions.
        #[arg(long)]
        details: bool,
        /// Wait where another process holds the workspace, instead of saying who it is.
        #[arg(long)]
        wait: bool,
    },
}

/// What can be done with marker sets.
#[derive(Debug, Subcommand)]
pub enum MarkerSetAction {
    /// Check a marker-set file: links and landmarks that do not exist, duplicate labels, missing
    /// landmarks.
    #[command(after_help = "Examples:\n  aloft markerset check lab.yaml\n  aloft markerset check lab.yaml --json")]
    Check {
        /// The file.
        file: PathBuf,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Propose a marker set from recordings: by labels, by which markers move together, and by
    /// their sides.
    #[command(
        after_help = "Examples:\n  aloft markerset draft lab/s01 --out lab.yaml\n\nEach line states its evidence; review the lines marked CHECK."
    )]
    Draft {
        /// Folder of recordings of one subject, best with a static trial.
        folder: PathBuf,
        /// File to write (standard output where not given).
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// Machine-readable output.
        #[arg(long, conflicts_with = "out")]
        json: bool,
    },
}
