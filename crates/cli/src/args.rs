//! The words that a user types. Help, man pages and completions are made from these definitions.

use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

mod actions;
mod options;
mod values;

pub use actions::{EffectAction, MarkerSetAction};
pub use options::{CompareArgs, DiscoverArgs, ExportArgs, ParametersArgs, RunArgs};

/// Learns the mass properties of a moving body from its motion in the air, and finds the physics
/// that a model is missing.
#[derive(Debug, Parser)]
#[command(
    name = "aloft",
    version,
    arg_required_else_help = true,
    after_help = "The loop:\n  aloft run P.yaml           from recordings to identified mass properties\n  aloft compare P.yaml       model against measurement, and where it fails\n  aloft discover P.yaml      which effect is missing\n  aloft effect add P.yaml E  add it to the model and show the new error\n  aloft report P.yaml        one page that tells the story\n  aloft status P.yaml        what is done, stale or failed\n\nExit codes: 0 all well; 1 some trials failed, the others are done and kept; 2 the command or configuration is wrong."
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
    /// Only these subjects of a study of several (name or pattern; may be given several times).
    #[arg(long, value_name = "GLOB")]
    pub subject: Vec<String>,
    /// Only these sessions (name or pattern; may be given several times).
    #[arg(long, value_name = "GLOB")]
    pub session: Vec<String>,
}

/// What a command that shows results does with results that are not up to date.
#[derive(Debug, Args, Clone, Copy)]
pub struct StrictArgs {
    /// Exit with 1 where results are stale, missing or damaged (a notice on stderr says so in any
    /// case).
    #[arg(long)]
    pub strict: bool,
}

/// Rows that results are built on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RowsArg {
    /// The paper's acceleration rows (`paper` means the same).
    #[value(alias = "paper")]
    Acceleration,
    /// Weak momentum rows.
    Weak,
}

/// Programs that run workflows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum EngineArg {
    /// Snakemake, on this machine or through its executors (Slurm and others).
    Snakemake,
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

/// Joint angles of exported files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AnglesArg {
    /// Names and axes of OpenSim's full-body models.
    Model,
    /// Recommendations of the International Society of Biomechanics.
    Isb,
}

/// Formats and examples.
fn export_help() -> String {
    let mut text = "Formats:\n".to_owned();
    for format in aloft_analysis::export::formats() {
        text.push_str(&format!("  {:<8} {}; {}\n", format.name, format.title, format.readers));
    }
    text + "\nExamples:\n  aloft export P.yaml --to out/s01\n  aloft export P.yaml --format osim,trc,mot --trial 'jump*'\n  aloft export P.yaml --angles isb --to out/s01_isb"
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the stages of a pipeline; what is up to date is kept.
    #[command(
        after_help = "Examples:\n  aloft run pipelines/demo.yaml\n  aloft run pipelines/human.yaml --data lab/s01 --workspace out/s01\n  aloft run P.yaml --from filter            after a change of the cut-off\n  aloft run P.yaml --trial 'jump0*' --dry-run\n  aloft run P.yaml --subject sub-02 --session 'ses-0*'"
    )]
    Run(RunArgs),
    /// Check configuration, labels and files; changes nothing.
    #[command(
        after_help = "Examples:\n  aloft check P.yaml\n  aloft check P.yaml --data lab/s01\n  aloft check P.yaml --details            every remark on every recording\n\nRemarks of one kind are one line, with the recordings that it concerns. After a run, the session check is shown, too: time of the plates against the cameras, weights, zeros, vertical, labels and markers, each with its interval and what it should be."
    )]
    Check {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Every remark on every recording.
        #[arg(long)]
        details: bool,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Show the grid of trials and stages: ok, warning, stale, damaged, failed, blocked, missing,
    /// excluded.
    #[command(after_help = "Examples:\n  aloft status P.yaml\n  aloft status P.yaml --subject sub-02 --json")]
    Status {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Results that are not up to date.
        #[command(flatten)]
        strict: StrictArgs,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Show the summary: one row a trial with markers, gaps, errors, flights, comparison and
    /// reasons of quality control.
    #[command(
        after_help = "Examples:\n  aloft summary P.yaml\n  aloft summary P.yaml --subject sub-02 --json\n\nEvery run writes the same table as summary.csv, summary.parquet and summary.txt into the workspace."
    )]
    Summary {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Results that are not up to date.
        #[command(flatten)]
        strict: StrictArgs,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Compare every file of the results with the hash under which it was written; changes nothing.
    #[command(
        after_help = "Examples:\n  aloft verify P.yaml\n  aloft verify P.yaml --json\n\nExit code 1 where a file is damaged, and with --strict also where results are stale or missing. `aloft run` makes damaged results again."
    )]
    Verify {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Results that are not up to date.
        #[command(flatten)]
        strict: StrictArgs,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Remove everything that the workspace holds about one subject; recordings are not touched.
    #[command(
        after_help = "Examples:\n  aloft forget P.yaml sub-02 --dry-run   what would be removed\n  aloft forget P.yaml sub-02\n\nResults, stored answers and exports of the subject go, and tables and pages of the whole study, which the next `run` and `report` write without the subject. Delete or exclude the recordings, too: a run makes results of every recording that it finds."
    )]
    Forget {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Name of the subject, as `status` shows it.
        #[arg(value_name = "NAME")]
        name: String,
        /// Only say what would be removed.
        #[arg(long)]
        dry_run: bool,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Say why a result is stale or failed: which file, parameter or version changed.
    #[command(
        after_help = "Examples:\n  aloft explain P.yaml                     everything that is not up to date\n  aloft explain P.yaml jump03              one trial\n  aloft explain P.yaml jump03 filter       one result, with what it was made from\n  aloft explain P.yaml _study identify --subject sub-02"
    )]
    Explain {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Results that are not up to date.
        #[command(flatten)]
        strict: StrictArgs,
        /// Trial (or `_study` for stages that run once); all where not given.
        trial: Option<String>,
        /// Stage; all where not given.
        stage: Option<String>,
    },
    /// Show what is in a C3D or TRC file and what is wrong with it.
    #[command(
        after_help = "Examples:\n  aloft inspect jump01.c3d\n  aloft inspect jump01.trc --json\n  aloft inspect jump01.c3d --values LASI,RASI\n  aloft inspect jump01.c3d --values FP1 --csv > fp1.csv"
    )]
    Inspect {
        /// Recording.
        file: PathBuf,
        /// Values of these markers, plates, computed points or analog channels, frame by frame
        /// (commas between them).
        #[arg(long, value_name = "NAMES", value_delimiter = ',')]
        values: Vec<String>,
        /// Values as CSV: of all markers, or of those under --values.
        #[arg(long, conflicts_with = "json")]
        csv: bool,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Show the identified parameters with intervals and those from tables beside them.
    #[command(
        after_help = "Examples:\n  aloft parameters P.yaml\n  aloft parameters P.yaml --rows acceleration\n  aloft parameters P.yaml --subject sub-02 --json"
    )]
    Parameters(ParametersArgs),
    /// Compare the model with measurement: by trial, phase, axis, segment.
    #[command(
        after_help = "Examples:\n  aloft compare P.yaml\n  aloft compare P.yaml --by segment,posture\n  aloft compare P.yaml --estimators       rows × estimators × geometry on the same held-out motion\n  aloft compare P.yaml --leave-one-out    each trial predicted from the others: tables, flights, contact, both"
    )]
    Compare(CompareArgs),
    /// Say which physical effect or measurement artefact is missing, how sure, and what it can be
    /// confused with. Where error remains above the floor, laws beyond the catalogue are sought;
    /// what is known already is printed on stderr meanwhile.
    #[command(
        after_help = "Examples:\n  aloft discover P.yaml\n  aloft discover P.yaml --without plate_origin\n  aloft discover P.yaml --only tether --only wind --json\n  aloft discover P.yaml --self-test       inject effects into these recordings and count the right names"
    )]
    Discover(DiscoverArgs),
    /// List, show, add or remove effects of the model.
    #[command(
        after_help = "Examples:\n  aloft effect list\n  aloft effect show tether\n  aloft effect add P.yaml tether\n  aloft effect remove P.yaml tether"
    )]
    Effect {
        /// What to do with effects.
        #[command(subcommand)]
        action: EffectAction,
    },
    /// Show the ladder: model revisions and their held-out error.
    #[command(after_help = "Examples:\n  aloft history P.yaml\n  aloft history P.yaml --json")]
    History {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Results that are not up to date.
        #[command(flatten)]
        strict: StrictArgs,
        /// Also effects, explainable share, singular values, marker error, changes of base
        /// parameters.
        #[arg(long)]
        details: bool,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Write one self-contained HTML page.
    #[command(
        after_help = "Examples:\n  aloft report P.yaml\n  aloft report P.yaml --subject sub-02 --out sub-02.html"
    )]
    Report {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Results that are not up to date.
        #[command(flatten)]
        strict: StrictArgs,
        /// Where to write it (`report.html` in the workspace where not given).
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Open the report as a live page in the browser: switch effects, keep them, try settings.
    #[command(
        after_help = "Examples:\n  aloft studio P.yaml\n  aloft studio P.yaml --port 8080 --no-open\n  aloft studio study.yaml --subject sub-02\n\nThe page is served to this machine only, at an address that holds a random token. Nothing in the workspace changes until `Keep` is pressed. Ctrl-C ends it."
    )]
    Studio {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Port on this machine (any free one where not given).
        #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
        port: u16,
        /// Print the address and open no browser.
        #[arg(long)]
        no_open: bool,
    },
    /// Write files for other programs: OpenSim, C3D, Parquet, CSV, BIDS-Motion, URDF, MuJoCo; a
    /// README says what each is.
    #[command(
        after_help = export_help(),
        long_about = "Write files for other programs. The folder must be new, empty or an earlier export; nothing else is overwritten."
    )]
    Export(ExportArgs),
    /// Make a laboratory folder of C3D trials with known truth.
    #[command(
        after_help = "Examples:\n  aloft simulate chain_clean --out lab\n  aloft simulate configs/scenarios/human_tether.yaml --out lab --seed 3"
    )]
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
    #[command(
        after_help = "Examples:\n  aloft init lab/s01\n  aloft init study --out study.yaml\n  aloft init lab --subject S07            only the files that name this subject\n\nSubjects and sessions are recognised by participants.tsv, by folders called sub-… and ses-…, or by folders that hold recordings of the same names. A folder with robot.yaml holds joint logs of a robot.\n\nRecordings that cannot be read are named and counted, and the exit code is 0: the pipeline is whole. They fail in `aloft check` and `aloft run`, whose exit code is then 1."
    )]
    Init {
        /// Folder of recordings.
        folder: PathBuf,
        /// Pipeline file to write (`aloft.yaml` in the current folder where not given).
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// All recordings are of one person, whatever names and folders say.
        #[arg(long, conflicts_with = "subject")]
        one_subject: bool,
        /// Use only the files that name this subject (SUBJECTS:NAMES of C3D files, or the name
        /// before the labels), and only this person's markers in files that hold several people.
        #[arg(long, value_name = "NAME")]
        subject: Option<String>,
    },
    /// Check whether an OpenSim model balances with its own motion, in flight and on plates.
    #[command(
        after_help = "Examples:\n  aloft audit Models/final.osim --motion IK/*_ik.mot --markers MarkerData/*.trc --forces ID/*_grf.mot\n\nFiles of a recording are matched by the name of its markers: DJ1.trc, DJ1_ik.mot, DJ1_grf.mot."
    )]
    Audit {
        /// Model (OSIM, OpenSim 4).
        model: PathBuf,
        /// Coordinates from inverse kinematics (MOT or STO).
        #[arg(long, required = true, num_args = 1.., value_name = "FILE")]
        motion: Vec<PathBuf>,
        /// Markers (TRC).
        #[arg(long, required = true, num_args = 1.., value_name = "FILE")]
        markers: Vec<PathBuf>,
        /// Ground reactions (MOT).
        #[arg(long, num_args = 1.., value_name = "FILE")]
        forces: Vec<PathBuf>,
        /// Machine-readable output.
        #[arg(long)]
        json: bool,
    },
    /// Check a marker-set file, or draft one from recordings.
    #[command(
        name = "markerset",
        after_help = "Examples:\n  aloft markerset check lab.yaml\n  aloft markerset draft lab/s01 --out lab.yaml\n\nA marker set is a YAML file with a label, a link and a landmark a line; `marker_set: lab.yaml` in a pipeline uses it."
    )]
    MarkerSet {
        /// What to do.
        #[command(subcommand)]
        action: MarkerSetAction,
    },
    /// Write the pipeline as a Snakefile: each stage of each trial a job, on this machine's cores
    /// or on a cluster.
    #[command(
        after_help = "Examples:\n  aloft workflow P.yaml --out Snakefile\n  snakemake -s Snakefile --cores 8 --keep-going\n  snakemake -s Snakefile --jobs 100 --keep-going --executor slurm --default-resources mem_mb=1000 runtime=10\n  aloft workflow P.yaml --verdict        what is missing or failed; exit code 1 where something is"
    )]
    Workflow {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Program that runs the workflow.
        #[arg(long, value_enum, default_value = "snakemake")]
        engine: EngineArg,
        /// Where to write it.
        #[arg(long, value_name = "FILE", default_value = "Snakefile")]
        out: PathBuf,
        /// Write nothing; say what a finished workflow lacks.
        #[arg(long)]
        verdict: bool,
    },
    /// Merge one node of the tree of flight factors (a job of `aloft workflow`).
    #[command(
        after_help = "Examples:\n  aloft merge P.yaml --node 1-0     the first eight trials\n  aloft merge P.yaml --node 2-0     what level 1 gave"
    )]
    Merge {
        /// The pipeline.
        #[command(flatten)]
        pipeline: PipelineArgs,
        /// Node: level from 1, index from 0.
        #[arg(long, value_name = "LEVEL-INDEX")]
        node: aloft_pipeline::merge::Node,
    },
    /// Show the JSON schema of pipeline files, for editors.
    #[command(
        after_help = "Examples:\n  aloft schema > aloft.schema.json\n  # first line of a pipeline, for editors: # yaml-language-server: $schema=aloft.schema.json"
    )]
    Schema,
    /// Print shell completions.
    #[command(
        after_help = "Examples:\n  aloft completions bash > ~/.local/share/bash-completion/completions/aloft\n  aloft completions zsh > ~/.zfunc/_aloft\n  aloft completions powershell >> $PROFILE"
    )]
    Completions {
        /// Shell.
        shell: clap_complete::Shell,
    },
    /// Print the manual page (troff).
    #[command(after_help = "Examples:\n  aloft man > ~/.local/share/man/man1/aloft.1\n  aloft man | man -l -")]
    Man,
    /// Print the licences and notices of the libraries that the program contains.
    #[command(after_help = "Examples:\n  aloft licenses > THIRD-PARTY-NOTICES")]
    Licenses,
}
