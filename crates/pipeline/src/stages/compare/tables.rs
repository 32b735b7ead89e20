//! Tables that the stage writes: series of a trial, and windows.

use aloft_compare::{Comparison, TrialSeries, WindowSample};
use aloft_workspace::table::Table;

const COMPONENTS: [&str; 6] = ["force_x_n", "force_y_n", "force_z_n", "moment_x_nm", "moment_y_nm", "moment_z_nm"];

pub(super) fn series_table(s: &TrialSeries, comparison: &Comparison) -> Table {
    let mut table = Table::default();
    table.push("time_s", s.time_s.clone());
    table.push("in_flight", s.in_flight.iter().map(|f| f64::from(u8::from(*f))).collect());
    table.push("counts", s.phase.iter().map(|p| f64::from(u8::from(p.is_some()))).collect());
    for (i, name) in COMPONENTS.iter().enumerate() {
        table.push(format!("measured.{name}"), s.measured.iter().map(|w| w[i]).collect());
    }
    for (model, values) in comparison.models().zip(&s.predicted) {
        for (i, name) in COMPONENTS.iter().enumerate() {
            table.push(format!("{}.{name}", model.model), values.iter().map(|w| w[i]).collect());
        }
    }
    table
}

/// Every window of a trial with the error of each model. The held-out error in flight is the root
/// mean square over the windows in flight of all trials that count, of force and of moment over a
/// lever of 0.1 m; in contact over those of trials held out.
pub(super) fn windows_table(s: &TrialSeries, comparison: &Comparison) -> Table {
    let mut table = Table::default();
    table.push("centre_s", s.windows.iter().map(|w| w.centre_s).collect());
    table.push("in_flight", s.windows.iter().map(|w| f64::from(u8::from(w.in_flight))).collect());
    for (m, model) in comparison.models().enumerate() {
        for (i, name) in COMPONENTS.iter().enumerate() {
            let error = |w: &WindowSample| w.residual.get(m).map_or(f64::NAN, |e| e[i]);
            table.push(format!("{}.{name}", model.model), s.windows.iter().map(error).collect());
        }
    }
    table
}
