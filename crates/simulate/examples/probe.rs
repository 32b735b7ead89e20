use aloft_body::{Sex, State};
use aloft_simulate::human::{jump::jump_trial, posture::Stumble};
use aloft_simulate::human::Person;
use aloft_simulate::physics::Plant;
use aloft_simulate::random::Stream;
use aloft_simulate::*;
use nalgebra::Vector3;

fn main() {
    let seed: u64 = std::env::args().nth(1).and_then(|s| s.parse().ok()).unwrap_or(1);
    let spec = PersonSpec { sex: Sex::Female, height_m: 1.605, mass_kg: 56.2, variation: 1.0 };
    let lab = HumanLab { person: spec.clone(), protocol: JumpProtocol::default() };
    let scenario = Scenario {
        name: "probe".into(), seed, body: BodySpec::Human(lab.clone()), capture: CaptureSpec::default(),
        hidden: vec![], trajectories: false,
    };
    let person = Person::new(&scenario, &spec).unwrap();
    let plant = Plant::new(&person.body, &[], "").unwrap();
    for trial in 0..8 {
        for attempt in 0..6 {
            let mut rng = Stream::new(seed, &format!("jump{trial}/{attempt}"));
            let t = std::time::Instant::now();
            match jump_trial(&person, &plant, &lab.protocol, 1e-3, &mut rng) {
                Ok(j) => {
                    let m = &j.motion;
                    let n = m.n_ticks();
                    print!("trial {trial}.{attempt} {:?} {:.2} s in {:?} flights {:?}", j.styles, n as f64 * 1e-3, t.elapsed(), m.flights);
                    let mut res = 0.0f64;
                    for [a, b] in &m.flights { for k in *a..=*b { res = res.max(m.contact[k].force_n.norm()); } }
                    let air = |k: usize| m.flights.iter().any(|[a, b]| (*a..=*b).contains(&k));
                    let (mut fmin, mut fmax) = (f64::INFINITY, 0.0f64);
                    let (mut cx, mut cy) = ([f64::INFINITY, -f64::INFINITY], [f64::INFINITY, -f64::INFINITY]);
                    let mut bad = 0;
                    let mut count = 0;
                    for k in 0..n {
                        if air(k) { continue; }
                        let w = &m.contact[k];
                        fmin = fmin.min(w.force_n.z); fmax = fmax.max(w.force_n.z);
                        if w.force_n.z > 100.0 {
                            let (x, y) = (-w.moment_nm.y / w.force_n.z, w.moment_nm.x / w.force_n.z);
                            count += 1;
                            if !(-0.11..0.22).contains(&x) || y.abs() > 0.2 { bad += 1;
                                if bad % 12 == 1 && trial < 3 { let since = m.flights.iter().map(|f| k as i64 - f[1] as i64).filter(|d| *d>0).min().unwrap_or(-1); let until = m.flights.iter().map(|f| f[0] as i64 - k as i64).filter(|d| *d>0).min().unwrap_or(-1);
                                print!(" [{since}+ {until}- Fz {:.0} Fx {:.0} My {:.0} cop {x:.2}]", w.force_n.z, w.force_n.x, w.moment_nm.y); } }
                            cx = [cx[0].min(x), cx[1].max(x)]; cy = [cy[0].min(y), cy[1].max(y)];
                        }
                    }
                    println!(" res {res:.1e} Fz {fmin:.0}..{:.2} BW cop x {:.2}..{:.2} y {:.2}..{:.2} bad {}/{}", fmax / (56.2 * 9.81), cx[0], cx[1], cy[0], cy[1], bad, count);
                    // knees and feet
                    let (mut kmax, mut kmin, mut foot, mut rate) = (-9.0f64, 9.0f64, 9.0f64, 0.0f64);
                    let mut s = State::new(&plant.model);
                    let mut tilt = 0.0f64;
                    for k in 0..n {
                        for link in [10, 13] { let q = m.q(k)[plant.model.links[link].joint.q_offset]; kmax = kmax.max(q); kmin = kmin.min(q); }
                        s.forward_position(&plant.model, m.q(k));
                        for (side, link) in [(0, 11), (1, 14)] { foot = foot.min(s.point_in_world(link, &person.ball_m[side]).z); }
                        for v in m.v(k) { rate = rate.max(v.abs()); }
                        let up = s.world_from_link[0].rotation * Vector3::y();
                        tilt = tilt.max(up.z.acos().to_degrees());
                    }
                    println!("     knee {:.0}..{:.0} deg, ball lowest {:.4} m, rate {rate:.1}, pelvis tilt {tilt:.0} deg", kmin.to_degrees(), kmax.to_degrees(), foot);
                    break;
                }
                Err(Stumble::Infeasible(p)) => println!("trial {trial}.{attempt}: {p} ({:?})", t.elapsed()),
                Err(Stumble::Failed(e)) => println!("failed {e}"),
            }
        }
    }
}
