//! README of an export: description of each file, of the processing and of the coordinates.

use crate::coordinates::Quantity;
use crate::number::{fixed, with_half};
use crate::{FORMATS, InertiaSource, LinkKnown, OutFile, SubjectExport};

/// Provenance of the export, as stated in the README.
#[derive(Debug, Clone, Default)]
pub struct Making {
    /// Program and version.
    pub program: String,
    /// Name of the pipeline.
    pub pipeline: String,
    /// Hash of the pipeline file.
    pub pipeline_hash: String,
    /// Recordings: (file, hash).
    pub recordings: Vec<(String, String)>,
    /// Stages: (name, version, parameters as JSON).
    pub stages: Vec<(String, u32, String)>,
    /// Remarks on the results, in words.
    pub remarks: Vec<String>,
    /// Methods paragraph for a paper.
    pub methods: String,
}

/// The README, in Markdown.
pub fn readme(subject: &SubjectExport, files: &[OutFile], making: &Making) -> String {
    let mut t = format!("# {}: export of {}\n\n", subject.id, making.pipeline);
    t.push_str(&format!("Made by {}. All paths are relative to this folder.\n\n", making.program));
    t.push_str("## Inertias\n\n");
    match &subject.source {
        InertiaSource::Identified { rows, remarks, from_table, .. } => {
            t.push_str(&format!("The models carry masses, centres of mass and inertias **identified** from flights ({rows} rows); `…_prior.osim` has those from tables beside them.\n"));
            for remark in remarks {
                t.push_str(&format!("\n- {remark}"));
            }
            if !from_table.is_empty() {
                t.push_str("\n- **from tables**, because motion did not determine them: ");
                t.push_str(&from_table.join("; "));
            }
        }
        InertiaSource::Prior { reason } => {
            t.push_str(&format!("The models carry inertias **from tables**, not identified ones: {reason}.\n"));
        }
    }
    t.push_str(&inertias(subject));
    if !making.remarks.is_empty() {
        t.push_str("\n## To keep in mind\n\n");
        for remark in &making.remarks {
            t.push_str(&format!("- {}\n", one_line(remark)));
        }
    }
    t.push_str("\n## Files\n\n| file | what it is |\n|---|---|\n");
    for file in files {
        t.push_str(&format!("| `{}` | {} |\n", file.path, one_line(&file.what).replace('|', "/")));
    }
    t.push_str("\n| format | what | opened by |\n|---|---|---|\n");
    for format in FORMATS {
        t.push_str(&format!("| `{}` | {} | {} |\n", format.name, format.title, format.readers));
    }
    t.push_str(&conventions(subject));
    t.push_str(&made(making));
    t.push_str(&format!("\n## Methods, ready to paste\n\n{}\n", making.methods));
    t
}

/// Names in a text may contain line breaks, which would end a row or an item here.
fn one_line(text: &str) -> String {
    text.replace(char::is_control, " ")
}

fn inertias(subject: &SubjectExport) -> String {
    let mut t = "\n\n| link | mass, kg | centre of mass in the link frame, m | mass from tables, kg | values from |\n|---|---|---|---|---|\n"
        .to_owned();
    let from_tables = LinkKnown { from: "from tables".to_owned(), ..LinkKnown::default() };
    let known = subject.known.iter().chain(std::iter::repeat(&from_tables));
    let links = subject.subject.model.links.iter().zip(&subject.links).zip(&subject.subject.prior).zip(known);
    for (((link, own), prior), known) in links {
        let com: Vec<String> = (0..3).map(|k| with_half(own.com_m[k], known.com_m[k])).collect();
        t.push_str(&format!(
            "| {} | {} | {} | {} | {} |\n",
            link.name,
            with_half(own.mass_kg, known.mass_kg),
            com.join(", "),
            with_half(prior.mass_kg, None),
            known.from
        ));
    }
    let total: f64 = subject.links.iter().map(|l| l.mass_kg).sum();
    let words = match &subject.source {
        InertiaSource::Identified { intervals, .. } => {
            format!("± is half of a {intervals}. Model files carry all digits.")
        }
        InertiaSource::Prior { .. } => {
            "Values from tables have no interval: how far this body is from the tables is not known.".to_owned()
        }
    };
    t + &format!("\nThe total, {} kg, is stated and not measured by the motion. {words}\n", fixed(total, 3))
}

fn conventions(subject: &SubjectExport) -> String {
    let c = &subject.coordinates;
    let mut t = "\n## Axes, units, angles\n\n\
        - OpenSim files (`Models/*.osim`, `MarkerData`, `IK`, `ID`): ground with Y up; the laboratory's (x, y, z) with Z up is (x, z, −y) there. \
        Metres, newtons, degrees in tables; TRC in millimetres.\n\
        - OpenSim's own inverse kinematics agrees where every marker is seen; across gaps Aloft carries a missing marker's pull for up to 0.25 s, and OpenSim leaves it out.\n\
        - `Models/*.urdf`, `Models/*.xml`, `Tables`, `BIDS`: the laboratory's axes with Z up, SI, degrees in tables. Link frames are the same in all models.\n\
        - Paths in the set-up files of OpenSim are relative to their folder: start its tools there (`cd IK && opensim-cmd run-tool jump01_ik_setup.xml`).\n\
        - `C3D`: axes and length unit of the recording; new angles in degrees.\n\
        - Time is in seconds since the first frame of the recording. Missing is an empty cell, `NaN` or `n/a`, never zero.\n"
        .to_owned();
    t.push_str(&format!(
        "\nJoint angles follow the convention `{}` (`export: {{angles: model}}` or `{{angles: isb}}` in the pipeline). Turns are about axes of the moving \
        link, in the stated order; link frames have x forward, y up, z to the right on both sides, and left-hand coordinates about x and y are mirrored. \
        `model`: names and orders of OpenSim's full-body models. `isb`: Wu et al. 2002 (hip, ankle, spine: z-x-y), Wu et al. 2005 (shoulder: Y-X-Y \
        relative to the thorax, elevation negative; wrist: z-x-y). Series are continuous, so angles may exceed ±180°. Y-X-Y is singular with the arm at the side, \
        z-x-y with 90° of the second angle.\n\n| coordinate | moves | order | positive | unit |\n|---|---|---|---|---|\n",
        c.convention.word()
    ));
    for coordinate in &c.list {
        let joint = &c.joints[coordinate.link];
        let order = joint.sequence.map_or("hinge".to_owned(), |s| s.letters());
        let angle = coordinate.quantity == Quantity::Angle;
        t.push_str(&format!(
            "| `{}` | {} | {} | {} | {} |\n",
            coordinate.name,
            subject.subject.model.links[coordinate.link].name,
            if angle { order.as_str() } else { "–" },
            coordinate.positive,
            if angle { "deg" } else { "m" }
        ));
    }
    t
}

fn made(making: &Making) -> String {
    let mut t = "\n## How it was made\n\n".to_owned();
    t.push_str(&format!(
        "Pipeline `{}` (`pipeline.yaml` here, BLAKE3 {}), {}.\n\n| recording | BLAKE3 |\n|---|---|\n",
        making.pipeline, making.pipeline_hash, making.program
    ));
    for (file, hash) in &making.recordings {
        t.push_str(&format!("| `{file}` | {hash} |\n"));
    }
    t.push_str("\n| stage | version | parameters |\n|---|---|---|\n");
    for (stage, version, parameters) in &making.stages {
        t.push_str(&format!("| {stage} | {version} | `{}` |\n", parameters.replace('|', "/")));
    }
    t
}
