//! Checks the values of a scenario.

use crate::error::SimulateError;
use crate::hidden::{Hidden, WHOLE_BODY};
use crate::physics::Body;
use crate::physics::law::FormulaLaw;
use crate::scenario::{BodySpec, Scenario};

/// Checks the ranges of the instruments' settings and of the hidden effects.
pub(crate) fn check_capture(scenario: &Scenario) -> Result<(), SimulateError> {
    let c = &scenario.capture;
    scenario.expect("capture.point_rate_hz", c.point_rate_hz, 20.0..=2000.0, "20 to 2000 Hz")?;
    scenario.expect("capture.analog_per_frame", c.analog_per_frame as f64, 1.0..=50.0, "1 to 50")?;
    scenario.expect("capture.marker_noise_m", c.marker_noise_m, 0.0..=1.0, "0 to 1 m")?;
    scenario.expect("capture.soft_tissue_m", c.soft_tissue_m, 0.0..=0.1, "0 to 0.1 m")?;
    scenario.expect("capture.soft_cluster_m", c.soft_cluster_m, 0.0..=0.1, "0 to 0.1 m")?;
    scenario.expect("capture.gap_fraction", c.gap_fraction, 0.0..=0.5, "0 to 0.5")?;
    scenario.expect("capture.plate_noise_n", c.plate_noise_n, 0.0..=1e3, "0 to 1000 N")?;
    scenario.expect("capture.plate_drift_n", c.plate_drift_n, 0.0..=1e3, "0 to 1000 N")?;
    if let Some(m) = &c.markerless {
        if !matches!(scenario.body, BodySpec::Human(_)) {
            return Err(scenario.value_error("capture.markerless", "an object", "a person"));
        }
        scenario.expect("capture.markerless.centre_sd_m", m.centre_sd_m, 0.0..=0.2, "0 to 0.2 m")?;
        scenario.expect("capture.markerless.noise_m", m.noise_m, 0.0..=0.2, "0 to 0.2 m")?;
        scenario.expect("capture.markerless.noise_rad", m.noise_rad, 0.0..=0.5, "0 to 0.5 rad")?;
        let nyquist = 0.49 * c.point_rate_hz;
        scenario.expect("capture.markerless.cutoff_hz", m.cutoff_hz, 1.0..=nyquist, "1 Hz to half the rate")?;
    }
    // without gravity objects do not come down; people's jumps are planned from their fall time
    let (least, words) = match scenario.body {
        BodySpec::Human(_) => (0.1, "0.1 to 30 m/s²"),
        BodySpec::Chain(_) | BodySpec::Custom(_) => (0.0, "0 to 30 m/s²"),
    };
    scenario.expect("capture.gravity_mps2", c.gravity_mps2, least..=30.0, words)?;
    for effect in &scenario.hidden {
        // JSON has no non-finite numbers: they become null
        let written = serde_json::to_value(effect)
            .map_err(|source| SimulateError::Json { scenario: scenario.name.clone(), source })?;
        if holds_null(&written) {
            let field = format!("hidden.{}", effect.name());
            return Err(scenario.value_error(&field, "not finite", "finite numbers"));
        }
        let field = |name: &str| format!("hidden.{}.{name}", effect.name());
        match effect {
            Hidden::TimeBase { true_rate_hz } => {
                scenario.expect(&field("true_rate_hz"), *true_rate_hz, 20.0..=2000.0, "20 to 2000 Hz")?;
            }
            Hidden::WobblingMass { mass_kg, frequency_hz, damping_ratio, .. } => {
                scenario.expect(&field("mass_kg"), *mass_kg, 1e-6..=1e3, "a positive mass")?;
                scenario.expect(&field("frequency_hz"), *frequency_hz, 0.5..=60.0, "0.5 to 60 Hz")?;
                scenario.expect(&field("damping_ratio"), *damping_ratio, 0.0..=2.0, "0 to 2")?;
            }
            Hidden::Rotor { axis, .. } => {
                let length = axis.iter().map(|x| x * x).sum::<f64>();
                scenario.expect(&field("axis"), length, 1e-12..=f64::MAX, "a direction")?;
            }
            Hidden::Panels { plates, air_density_kgpm3, normal_coefficient, .. } => {
                scenario.expect(&field("air_density_kgpm3"), *air_density_kgpm3, 0.0..=2e3, "0 to 2000 kg/m³")?;
                scenario.expect(&field("normal_coefficient"), *normal_coefficient, 0.0..=10.0, "0 to 10")?;
                for (i, plate) in plates.iter().enumerate() {
                    let length = plate.normal.iter().map(|x| x * x).sum::<f64>();
                    let place = |name: &str| field(&format!("plates[{i}].{name}"));
                    scenario.expect(&place("normal"), length, 1e-12..=f64::MAX, "a direction")?;
                    scenario.expect(&place("area_m2"), plate.area_m2, 0.0..=100.0, "0 to 100 m²")?;
                }
            }
            Hidden::Law { force, moment, delay_s, .. } => {
                if force.is_none() && moment.is_none() {
                    return Err(scenario.value_error(&field("force"), "missing", "`force`, `moment` or both"));
                }
                if *delay_s != 0.0 {
                    scenario.expect(&field("delay_s"), *delay_s, 0.005..=0.5, "0, or 0.005 to 0.5 s")?;
                }
            }
            _ => {}
        }
    }
    Ok(())
}

/// Checks that the links and plates named by hidden effects exist.
pub(crate) fn check_hidden(scenario: &Scenario, body: &Body, n_plates: usize) -> Result<(), SimulateError> {
    let model = &body.model;
    let find = |effect: &Hidden, link: &str| {
        model.links.iter().position(|l| l.name == link).ok_or_else(|| {
            let known: Vec<&str> = model.links.iter().map(|l| l.name.as_str()).collect();
            SimulateError::UnknownLink {
                scenario: scenario.name.clone(),
                effect: effect.name().to_owned(),
                link: link.to_owned(),
                known: known.join(", "),
            }
        })
    };
    for (entry, effect) in scenario.hidden.iter().enumerate() {
        match effect {
            Hidden::Law { link, point_m, .. } => {
                if find(effect, link).is_err() && link == WHOLE_BODY {
                    if point_m.iter().any(|x| *x != 0.0) {
                        let found = format!("{point_m:?}");
                        let expected = "no point: `body` is the centre of mass";
                        return Err(scenario.value_error("hidden.law.point_m", found, expected));
                    }
                } else {
                    find(effect, link)?;
                }
            }
            Hidden::Panels { plates, .. } => {
                for plate in plates {
                    find(effect, &plate.link)?;
                }
            }
            _ => {}
        }
        FormulaLaw::new(model, effect, entry, 0, &scenario.name)?;
        if let Some(link) = effect.link() {
            let index = find(effect, link)?;
            if let Hidden::WobblingMass { mass_kg, .. } = effect {
                let half = 0.5 * body.phi[index][0];
                scenario.expect(
                    "hidden.wobbling_mass.mass_kg",
                    *mass_kg,
                    0.0..=half,
                    "at most half of the link's mass",
                )?;
            }
        }
        if let Some(plate) = effect.plate()
            && !(1..=n_plates).contains(&plate)
        {
            let effect = effect.name().to_owned();
            return Err(SimulateError::UnknownPlate { scenario: scenario.name.clone(), effect, plate, n_plates });
        }
    }
    Ok(())
}

fn holds_null(value: &serde_json::Value) -> bool {
    match value {
        serde_json::Value::Null => true,
        serde_json::Value::Array(items) => items.iter().any(holds_null),
        serde_json::Value::Object(map) => map.values().any(holds_null),
        _ => false,
    }
}
