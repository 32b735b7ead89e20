//! What `regressor` and `identify` do with the torques in a robot's log: rows of the joints, and
//! friction, reflected inertia and gains from them.

use crate::factors::{load_named, save_named};
use crate::graph::{StageInputs, StageReport};
use crate::stages::robot::{failed, load_log};
use crate::trial_rows::{TrialRows, each_stretch};
use aloft_body::{BaseParameters, Subject};
use aloft_effects::{EffectInstance, Family, Scene, Target};
use aloft_identify::{LinkPrior, Parameters};
use aloft_regressor::{EffectColumns, Factor, Stretch};
use aloft_robot::joint_fit::{Estimate as JointValue, JointRows, joint_fit};
use aloft_robot::noise::white_sd;
use aloft_robot::torque::{TorqueEffects, TorqueSource, Torques, needed_of_measured, size, torque_factor};
use aloft_study::effects::{KnownEffects, ModelEffects};
use aloft_study::robot::RobotSetup;
use aloft_study::subject_session::Role;
use aloft_workspace::disk::is_there;
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::{read_json, write_json};
use nalgebra::DVector;

/// Files of torque rows.
pub(crate) const TORQUE: &str = "torque_factors";
/// What the torque's noise adds to their gains' columns.
const NOISE: &str = "torque_noise.json";
/// Correlation of measured torques with those that the model needs from which a wrong unit is sure.
const SURE: f64 = 0.5;
/// Torques may be off by this factor before they count as another unit.
const ANOTHER_UNIT: f64 = 5.0;
/// Needed torque, as a multiple of the measured one, below which the measured one has the opposite
/// sign: masses and friction of a model file are wrong by tens of percent, not in their sign.
const OPPOSITE: f64 = -0.3;

/// Laws of joints in a model.
pub(crate) fn laws_of_joints<'k>(
    known: &'k KnownEffects,
    scene: &Scene,
    model: &ModelEffects,
) -> Result<Vec<EffectInstance<'k>>, StageFailure> {
    let all = model.model.iter().map(|e| known.choice(scene, e)).collect::<Result<Vec<_>, _>>()?;
    Ok(all.into_iter().filter(|c| c.effect.acts().in_joints()).collect())
}

/// Effects of the base rows as changes of the body's parameters, each with its name; `None` for one
/// that does not enter the rows of the joints.
pub(crate) type Carried = Vec<(String, Option<DVector<f64>>)>;

/// The effects of a model in the rows of joints; none if one of them is a force from outside, of
/// which these rows do not know where it enters. A force or couple on the root passes through no
/// joint, and changes none of their rows.
pub(crate) fn carried(
    rows: &TrialRows,
    columns: Option<&EffectColumns>,
    model: &ModelEffects,
) -> Result<Option<Carried>, StageFailure> {
    let Some(columns) = columns else { return Ok(Some(Vec::new())) };
    let scene = Scene::new(&rows.subject.model, &rows.subject.prior_phi(), &[]);
    let known = KnownEffects::of(&model.own, &scene)?;
    let all = model.model.iter().map(|e| known.choice(&scene, e)).collect::<Result<Vec<_>, _>>()?;
    let on_root: Vec<String> = all
        .iter()
        .filter(|c| c.target == Target::Link(0) && c.effect.about().family == Family::Forces)
        .flat_map(|c| c.names(&scene))
        .collect();
    let outside = |c: usize| {
        rows.flights.iter().any(|r| columns.wrench[r.clone()].iter().any(|w| w.column(c).iter().any(|x| *x != 0.0)))
    };
    let one = |(c, name): (usize, &String)| {
        let change = columns.inertia.get(c).cloned().flatten();
        (change.is_some() || on_root.contains(name) || !outside(c)).then(|| (name.clone(), change))
    };
    Ok(columns.names.iter().enumerate().map(one).collect())
}

/// Rows of the joints' torques in the flights of a recording; notes their number. Without torques,
/// and with torques of another unit or sign, nothing is written.
pub fn save_torque_rows(
    robot: &RobotSetup,
    inputs: &StageInputs<'_>,
    rows: &TrialRows,
    model: &ModelEffects,
    columns: Option<&EffectColumns>,
    done: &mut StageReport,
) -> Result<(), StageFailure> {
    let name = inputs.trial()?;
    let (log, _) = load_log(robot, inputs.results, name)?;
    let torques = log.torques_at_frames().map_err(|e| failed(&e))?;
    let Some(values) = torques else { return Ok(()) };
    let Some(carried) = carried(rows, columns, model)? else {
        done.note("torques", "not judged: an effect of the model acts from outside the body, and where it enters the joints is not known");
        return Ok(());
    };
    let subject = &rows.subject;
    let base = BaseParameters::of(&subject.model);
    let prior = subject.prior_phi();
    let scene = Scene::new(&subject.model, &prior, &[]);
    let known = KnownEffects::of(&model.own, &scene)?;
    let joints = laws_of_joints(&known, &scene, model)?;
    let effects = TorqueEffects { carried: &carried, joints: &joints };
    let sd_nm = robot.description.noise.torque_nm;
    // the stated noise may be a wide guess: the log itself shows at most how large it is
    let white_nm: Vec<f64> =
        values.iter().map(|t| white_sd(std::slice::from_ref(t)).map_or(sd_nm, |sd| sd.min(sd_nm))).collect();
    let torques = Torques { values: &values, sd_nm, white_nm: &white_nm };
    let mut noise = Vec::new();
    let (factors, _) = each_stretch(rows, |stretch| {
        let source = TorqueSource { scene: &scene, motion: &rows.motion, stretch, torques };
        let (factor, of_flight) = torque_factor(&robot.model, &base, source, effects)?;
        noise.push(of_flight);
        Ok(factor)
    })?;
    let plain: Vec<Factor> = factors.iter().map(|(_, f)| f.clone()).collect();
    if let Some((slope, correlation)) = size(&robot.model, &base, &prior, &plain)
        && correlation.abs() > SURE
        && !(1.0 / ANOTHER_UNIT..ANOTHER_UNIT).contains(&slope)
    {
        let times = if slope.abs() < 1.0 {
            format!("1/{:.0} of", 1.0 / slope.abs())
        } else {
            format!("{:.0} times", slope.abs())
        };
        done.warnings.push(if slope < 0.0 {
            format!(
                "the torques have the opposite sign of those that the motion needs ({times} them); they are not used"
            )
        } else {
            format!(
                "the torques are {times} those that the motion needs, expected N·m (N·mm, kN·m?); they are not used"
            )
        });
        return Ok(());
    }
    save_named(inputs.out, TORQUE, &factors)?;
    write_json(&inputs.out.join(NOISE), &noise)?;
    done.note("torque_rows", plain.iter().map(|f| f.n_rows).sum::<usize>());
    Ok(())
}

/// Error of the gain that all joints have in common above which it is named.
const COMMON_GAIN: f64 = 0.1;

/// Friction, reflected inertia and gains of the joints: `joints.json`.
pub fn fit_joints(
    robot: &RobotSetup,
    inputs: &StageInputs<'_>,
    subject: &Subject,
    factors: &[(Stretch, Factor)],
    parameters: &Parameters,
    widening: &[(String, f64)],
    done: &mut StageReport,
) -> Result<(), StageFailure> {
    let (mut torque, mut noise) = (Vec::new(), Vec::new());
    for name in inputs.trials_with_role("regressor", |role| role == Role::Identify) {
        let folder = inputs.results.place("regressor", &name)?;
        if is_there(&folder.join(format!("{TORQUE}.json")))? {
            torque.extend(load_named(&folder, TORQUE)?.into_iter().map(|(_, f)| f));
            noise.extend(read_json::<Vec<Vec<f64>>>(&folder.join(NOISE))?);
        }
    }
    let base = BaseParameters::of(&subject.model);
    let fail = |e: aloft_identify::IdentifyError| StageFailure::new(e.to_string());
    let prior = LinkPrior::of_subject(subject).map_err(fail)?.base(&base).map_err(fail)?;
    let plain: Vec<Factor> = factors.iter().map(|(_, f)| f.clone()).collect();
    let rows = JointRows {
        base: &plain,
        torque: &torque,
        noise: &noise,
        base_row_sd: parameters.row_sd,
        prior: &prior,
        mass_kg: subject.facts.mass_kg,
    };
    if let Some(mut fit) = joint_fit(&robot.model, &rows) {
        // nonlinear parameters of laws were fitted to the same recordings
        for law in &mut fit.laws {
            let by = widening.iter().find(|w| w.0 == law.name).map_or(1.0, |w| w.1);
            law.ci95 = law.ci95.map(|end| law.value + by * (end - law.value));
        }
        done.note("torque_rows", fit.rows);
        done.note("torque_weight", fit.weight);
        done.note("torque_ratio", fit.torque_ratio);
        let needed = needed_of_measured(&robot.model, &base, &subject.prior_phi(), &torque);
        for (joint, needed) in fit.joints.iter().zip(needed) {
            let negative = |e: &JointValue| e.ci95[1] < 0.0;
            if needed < OPPOSITE {
                done.warnings.push(format!(
                    "the torque of the joint `{}` has the opposite sign of what its motion needs ({needed:.2} times the measured one): its \
                     friction, reflected inertia, gain and delay are not to be used",
                    joint.name
                ));
            } else if negative(&joint.friction) || negative(&joint.armature) {
                done.warnings.push(format!(
                    "the torque of the joint `{}` would need negative friction ({:.3}) and reflected inertia ({:.4}): its column has the opposite \
                     sign of the others, or a driving law is missing; its values are not to be used",
                    joint.name, joint.friction.value, joint.armature.value
                ));
            }
        }
        let mut gains: Vec<f64> = fit.joints.iter().map(|j| j.gain.value).collect();
        let middle = aloft_signal::median(&mut gains);
        if (middle - 1.0).abs() > COMMON_GAIN {
            done.warnings.push(format!(
                "the torques of all joints are {:.0} % too {} for a robot of {:.2} kg: check the mass from the scale and the torques' unit",
                100.0 * (middle - 1.0).abs(),
                if middle > 1.0 { "large" } else { "small" },
                subject.facts.mass_kg
            ));
        }
        write_json(&inputs.out.join("joints.json"), &fit)?;
    }
    Ok(())
}
