use aloft_body::*;
use aloft_flight::*;
#[test]
fn adhoc() {
    let text = std::fs::read_to_string("/work/shared/data/subject_a/truth/truth.json").unwrap();
    let v: serde_json::Value = serde_json::from_str(&text).unwrap();
    let mut links = Vec::new();
    let mut phis = Vec::new();
    for l in v["links"].as_array().unwrap() {
        let f = |k: &str| l[k].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect::<Vec<f64>>();
        let o = f("offset");
        links.push(LinkSpec {
            name: l["name"].as_str().unwrap().into(),
            parent: l["parent"].as_str().map(|s| s.to_owned()),
            joint: match l["joint"].as_str().unwrap() {
                "free" => JointSpec::Free,
                "spherical" => JointSpec::Spherical,
                _ => JointSpec::Revolute([0.0, 1.0, 0.0]),
            },
            position_m: [o[0], o[1], o[2]],
            rpy_rad: [0.0; 3],
            inertia: None,
        });
        let p = f("phi");
        phis.push(Phi::from([p[0], p[1], p[2], p[3], p[4], p[6], p[9], p[8], p[7], p[5]]));
    }
    let model = Model::from_spec(&ModelSpec { name: "s".into(), links }).unwrap();
    // a wrong prior: masses off by 15 %, coms off by 2 cm
    let wrong: Vec<Phi> = phis
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let m = p[0] * (1.0 + 0.15 * ((i * 7 % 5) as f64 / 2.0 - 1.0));
            let mut w = *p * (m / p[0]);
            for k in 0..3 {
                w[1 + k] += m * 0.015 * (((i * 3 + k * 5) % 7) as f64 / 3.0 - 1.0);
            }
            w
        })
        .collect();
    let truth: [&[(usize, usize)]; 8] = [
        &[(243, 349), (452, 553), (637, 736)],
        &[(229, 329), (421, 524)],
        &[(256, 356), (470, 578), (676, 780)],
        &[(252, 363), (463, 564), (655, 760)],
        &[(258, 357), (449, 553)],
        &[(249, 354), (455, 558), (674, 784)],
        &[(252, 361), (458, 562)],
        &[(227, 330), (411, 519), (610, 721)],
    ];
    for n in 1..=8 {
        let bytes = std::fs::read(format!("/tmp/sa_jump0{n}_q.bin")).unwrap();
        let q: Vec<f64> = bytes.chunks_exact(8).map(|c| f64::from_le_bytes(c.try_into().unwrap())).collect();
        let motion = Motion { trial: "j".into(), rate_hz: 200.0, nq: 51, nv: 40, q, ..Motion::default() };
        let c3d = std::fs::read(format!("/work/shared/data/subject_a/jump0{n}.c3d")).unwrap();
        let trial = aloft_trial::Trial::from_c3d("j", &c3d, &Default::default()).unwrap();
        let plates = from_plates(&trial, trial.markers.n_frames, 200.0, &Default::default());
        let both = find_flights(&trial, Some((&model, &wrong, &motion)), &Default::default()).unwrap();
        let mut line = format!("{n} ");
        let show = |r: &FlightReport| -> String {
            if r.flights.len() != truth[n - 1].len() {
                return format!("{:?} {:?}", r.flights.iter().map(|f| (f.start, f.end)).collect::<Vec<_>>(), r.rejected);
            }
            r.flights
                .iter()
                .zip(truth[n - 1])
                .map(|(f, t)| {
                    format!("{:+}/{:+} {:.2} ", f.start as i64 - t.0 as i64, f.end as i64 - t.1 as i64, f.mean_acceleration_mps2[2])
                })
                .collect()
        };
        line += &format!("plates {} | both {} ", show(&plates), show(&both));
        for (phi, refine) in [(&phis, false), (&wrong, false), (&wrong, true)] {
            let o = FlightOptions { refine, ..Default::default() };
            let r = from_motion(&model, phi, &motion, &o).unwrap();
            line += &format!("| {} ", show(&r));
        }
        println!("{line}\n   {:?} {:?}", plates.tare.iter().map(|t| (t.force_n[0].z, t.noise_n, t.samples)).collect::<Vec<_>>(), both.warnings);
    }
}
