//! Simulates a scenario file into a folder: `cargo run --release -p aloft-simulate --example
//! write_lab -- SCENARIO.yaml OUT`.
#![allow(clippy::print_stdout, reason = "an example talks to the terminal")]

use aloft_simulate::{Scenario, simulate};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut words = std::env::args().skip(1);
    let (Some(scenario), Some(out)) = (words.next(), words.next()) else {
        return Err("usage: write_lab SCENARIO.yaml OUT".into());
    };
    let scenario: Scenario = serde_yaml::from_str(&std::fs::read_to_string(scenario)?)?;
    let start = std::time::Instant::now();
    let lab = simulate(&scenario)?;
    println!("{} simulated in {:.2} s", lab.name, start.elapsed().as_secs_f64());
    for file in &lab.files {
        let path = std::path::Path::new(&out).join(&file.path);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        std::fs::write(&path, &file.bytes)?;
    }
    for trial in &lab.truth.trials {
        println!(
            "{:12} {:4} frames, {} flights {:?}, {} draws, residual {:.1e} N",
            trial.trial,
            trial.frames,
            trial.flights.len(),
            trial.styles,
            trial.attempts,
            trial.flight_resid
        );
    }
    println!("{:.2} MB", lab.files.iter().map(|f| f.bytes.len()).sum::<usize>() as f64 / 1e6);
    Ok(())
}
