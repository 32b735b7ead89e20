//! Recordings that went through the whole pipeline (a folder named by ALOFT_DISCOVER_DATA): what does a discovery say?

use aloft_body::{BaseParameters, Motion, Subject};
use aloft_discover::*;
use aloft_effects::PlateSeries;
use aloft_identify::LinkPrior;
use aloft_regressor::{Stretch, WeakOptions};
use nalgebra::{Vector3, Vector6};
use std::time::Instant;

fn print(d: &Discovery) {
    println!("  {:?} {:?} | floor {:.4} error {:.4} after {:.4}", d.verdict, d.effects, d.noise_floor, d.held_out_error, d.held_out_error_after);
    println!("  {}", d.words);
    for f in &d.found { println!("   found {} {:?} {:?}", f.key, f.coefficients.iter().map(|e| format!("{} {:.4}±{:.4}", e.name, e.value, e.se)).collect::<Vec<_>>(), f.nonlinear.iter().map(|e| format!("{} {:.3}±{:.3}", e.name, e.value, e.se)).collect::<Vec<_>>()); }
    for r in &d.rounds {
        println!("    round {} clusters {} thr {:.3} null {:?} parts {:?} {:?} {:?}", r.judged_on, r.clusters, r.threshold, r.null_quantiles, r.held_out_parts, r.verdict, r.effects);
        for c in r.candidates.iter().take(7) {
            println!("        {}", c.alternatives.iter().map(|a| format!("{} {:.3}", a.key, a.held_out_ratio)).collect::<Vec<_>>().join(", "));
            println!("      {:28} {:.3} [{:.3} {:.3}] p {:.3} bel {} pl {} mdd {:.4} {:?}", c.key, c.held_out_ratio, c.ci95[0], c.ci95[1], c.family_wise_p, c.believed, c.plausible, c.minimum_detectable,
                c.coefficients.iter().chain(&c.nonlinear).map(|e| format!("{:.3}±{:.3}", e.value, e.se)).collect::<Vec<_>>().join(" "));
        }
    }
}

#[test]
fn look_recorded() {
    let Some(folder) = std::env::var_os("ALOFT_DISCOVER_DATA").map(std::path::PathBuf::from) else {
        println!("skipped: ALOFT_DISCOVER_DATA names no folder");
        return;
    };
    let which = std::env::var("ALOFT_DISCOVER_SETS").unwrap_or_else(|_| "chain_b subject_b dj subject_a chain_a chain_p".into());
    for name in which.split_whitespace() {
        let json: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(folder.join(format!("{name}.json"))).unwrap()).unwrap();
        let subject: Subject = serde_json::from_value(json["subject"].clone()).unwrap();
        let raw = std::fs::read(folder.join(format!("{name}.bin"))).unwrap();
        let values: Vec<f64> = raw.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect();
        let model = &subject.model;
        let base = BaseParameters::of(model);
        let phi = subject.prior_phi();
        let prior = LinkPrior::of_subject(&subject).unwrap().base(&base).unwrap();
        let mut motions = Vec::new();
        let mut stretches = Vec::new();
        let mut plates: Vec<Vec<PlateSeries>> = Vec::new();
        let mut totals = Vec::new();
        let mut centers: Vec<Vector3<f64>> = Vec::new();
        for t in json["trials"].as_array().unwrap() {
            let (n, nq, at) = (t["n"].as_u64().unwrap() as usize, t["nq"].as_u64().unwrap() as usize, t["at"].as_u64().unwrap() as usize);
            let trial = t["name"].as_str().unwrap().to_owned();
            let motion = Motion { trial: trial.clone(), rate_hz: t["rate_hz"].as_f64().unwrap(), nq, nv: model.nv, q: values[at..at + n * nq].to_vec(), ..Motion::default() };
            let flights: Vec<[usize; 2]> = serde_json::from_value(t["flights"].clone()).unwrap();
            let mut s: Vec<Stretch> = flights.iter().enumerate().map(|(i, f)| Stretch::flight(trial.clone(), i, f[0], f[1])).collect();
            let mut p = Vec::new();
            for plate in t["plates"].as_array().unwrap() {
                let at = plate["at"].as_u64().unwrap() as usize;
                let v = |f: usize, k: usize| Vector3::new(values[at + 6 * f + k], values[at + 6 * f + k + 1], values[at + 6 * f + k + 2]);
                p.push(PlateSeries { force_n: (0..n).map(|f| v(f, 0)).collect(), moment_nm: (0..n).map(|f| v(f, 3)).collect() });
                let c: [f64; 3] = serde_json::from_value(plate["center"].clone()).unwrap();
                if centers.len() < p.len() { centers.push(c.into()); }
            }
            let total: Vec<Vector6<f64>> = (0..n).map(|f| p.iter().fold(Vector6::zeros(), |s, q: &PlateSeries| s + Vector6::new(q.force_n[f].x, q.force_n[f].y, q.force_n[f].z, q.moment_nm[f].x, q.moment_nm[f].y, q.moment_nm[f].z))).collect();
            if !p.is_empty() {
                let edge = (0.05 * motion.rate_hz) as usize;
                let weight = subject.facts.mass_kg * 9.81;
                let ok = |f: usize| motion.is_valid(f) && total[f].z > 0.2 * weight && !flights.iter().any(|x| f + edge >= x[0] && f < x[1] + edge);
                let mut begin = None;
                for f in 0..=n {
                    match (begin, f < n && ok(f)) {
                        (None, true) => begin = Some(f),
                        (Some(b), false) => {
                            if f - b > (0.2 * motion.rate_hz) as usize { s.push(Stretch::contact(trial.clone(), s.len(), b, f)); }
                            begin = None;
                        }
                        _ => {}
                    }
                }
            }
            motions.push(motion);
            stretches.push(s);
            plates.push(p);
            totals.push(total);
        }
        let body = Body { model, base: &base, phi: &phi, prior: Some(&prior), mass_kg: subject.facts.mass_kg, plate_centers_m: &centers };
        let trials: Vec<TrialInput> = (0..motions.len()).map(|i| TrialInput { motion: &motions[i], stretches: &stretches[i], measured: (!plates[i].is_empty()).then_some(&totals[i][..]), plates: &plates[i], group: None, session_time_s: 0.0 }).collect();
        let start = Instant::now();
        let scene = scene_of(&body, &trials);
        let session = Session::new(&body, &scene, &trials, &WeakOptions::default()).unwrap();
        let built = start.elapsed().as_secs_f64();
        let d = discover(&session, &catalogue(), &[], &DiscoverOptions::default()).unwrap();
        if name == "chain_b" {
            use aloft_effects::*;
            let make = |id: &str, link: &str, at: [f64; 3], force: [&str; 3], moment: Option<[&str; 3]>, c: &[(&str, &str)], axes| FormulaEffect {
                id: id.into(), title: String::new(), point: FormulaPoint { link: link.into(), position_m: Some(at) }, axes,
                force: Some(force.map(str::to_owned)), moment: moment.map(|m| m.map(str::to_owned)),
                coefficients: c.iter().map(|(n, u)| FormulaCoefficient { name: (*n).into(), unit: (*u).into(), lower: None, upper: None }).collect(),
                parameters: vec![], acts: ActsIn::Both, kind: EffectKind::Physics, documentation: String::new() };
            let points = [("link0", [-0.008, 0.149, -0.001]), ("link1", [-0.082, -0.002, 0.006])];
            let iso = ["-c*speed*v_x", "-c*speed*v_y", "-c*speed*v_z"];
            let lin = ["-c*speed*v_x-d*v_x", "-c*speed*v_y-d*v_y", "-c*speed*v_z-d*v_z"];
            let axial = ["-a*abs(v_x)*v_x", "-b*abs(v_y)*v_y", "-c*abs(v_z)*v_z"];
            let axial2 = ["-a*speed*v_x", "-b*speed*v_y", "-c*speed*v_z"];
            let spin = ["-p*spin*omega_x", "-p*spin*omega_y", "-p*spin*omega_z"];
            let k = "kg/m";
            let cases: Vec<(&str, [&str; 3], Option<[&str; 3]>, Vec<(&str, &str)>, FormulaAxes)> = vec![
                ("iso", iso, None, vec![("c", k)], FormulaAxes::World),
                ("iso+lin", lin, None, vec![("c", k), ("d", "kg/s")], FormulaAxes::World),
                ("axial", axial, None, vec![("a", k), ("b", k), ("c", k)], FormulaAxes::Link),
                ("axial speed", axial2, None, vec![("a", k), ("b", k), ("c", k)], FormulaAxes::Link),
                ("iso+spin", iso, Some(spin), vec![("c", k), ("p", "kg*m^2")], FormulaAxes::World),
                ("axial speed+spin", axial2, Some(spin), vec![("a", k), ("b", k), ("c", k), ("p", "kg*m^2")], FormulaAxes::Link),
            ];
            for (what, force, moment, c, axes) in cases {
                let made: Vec<CompiledFormula> = points.iter().map(|(l, at)| make(&format!("f_{l}"), l, *at, force, moment, &c, axes).compile(&scene).unwrap()).collect();
                let accepted: Vec<Choice> = made.iter().map(|m| Choice::new(m, m.targets(&scene)[0], &scene)).collect();
                let d = discover(&session, &catalogue(), &accepted, &DiscoverOptions { rounds: 1, only: vec!["gravity_tilt".into(), "joint_centre".into(), "rotational_drag".into()], ..Default::default() }).unwrap();
                println!("  {what}: error {:.4} {}", d.held_out_error, d.candidates.iter().take(3).map(|c| format!("{} {:.3}", c.key, c.held_out_ratio)).collect::<Vec<_>>().join(", "));
            }
        }
        println!("== {name}: rows {built:.2} s, all {:.2} s, warnings {:?}", start.elapsed().as_secs_f64(), d.warnings);
        print(&d);
    }
}
