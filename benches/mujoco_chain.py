#!/usr/bin/env python3
"""A thrown chain of two links, simulated by MuJoCo: a generator of laboratories that shares no code with `aloft simulate`.

Reads a scenario as `aloft simulate` does (`seed`, `body.throws`, `hidden`, `capture`) and writes a folder of C3D files that
`pipelines/chain.yaml` takes: static, hinge_calib, throws_NN, object.yaml, truth.json. Body, markers, hinge, throws and
instruments are drawn here, other than there: links are rods and boxes of several densities, the hinge stands at any angle
within 40 degrees of x, 240 frames a second. Between two flights a hand carries the chain along smooth curves. Forces that the
catalogue knows are computed here from their definitions and applied by MuJoCo's integrator (RK4, eight steps a frame).
`faults` of the scenario spoil the laboratory: `moved: {marker, by_m, from}` (a marker put back elsewhere from a recording on),
`loose: {stiffness_nmprad}` (the hinge also gives way across its axis, against a spring).

  python3 benches/mujoco_chain.py SCENARIO.yaml --out FOLDER      (numpy, mujoco, ezc3d from PyPI)
  python3 benches/verdicts.py --simulator benches/mujoco_chain.py --body chain …
"""

import argparse
import json
import math
from pathlib import Path

import ezc3d
import mujoco
import numpy as np

RATE, PER_FRAME, GRAVITY = 240.0, 8, 9.81
STEP = 1 / (RATE * PER_FRAME)
RIGID = np.zeros(2)
LABELS = ["L0_1", "L0_2", "L0_3", "L0_4", "L0_5", "L1_1", "L1_2", "L1_3", "L1_4"]


def unit(x):
    return x / np.linalg.norm(x)


def direction(rng):
    return unit(rng.standard_normal(3))


class Chain:
    """Geometry, inertia and markers of one chain; link frames as `object.yaml` defines them."""

    def __init__(self, rng):
        self.length = [rng.uniform(0.2, 0.32), rng.uniform(0.16, 0.3)]
        # the hinge in the frame of link 0 (origin L0_1, y towards L0_2), and link 1 in that of the hinge at angle zero
        self.hinge = np.array([rng.uniform(-0.01, 0.01), -rng.uniform(0.01, 0.05), rng.uniform(-0.02, 0.02)])
        x = np.array([1.0, 0.0, 0.0])
        tilt, around = math.radians(rng.uniform(0, 40)), rng.uniform(0, 2 * math.pi)
        self.axis = unit(x * math.cos(tilt) + math.sin(tilt) * np.array([0.0, math.cos(around), math.sin(around)]))
        # link 1: z along the axis, its body away from link 0
        away = unit(np.array([0.0, -1.0, 0.0]) - self.axis * -self.axis[1])
        self.rotation = np.column_stack([-away, np.cross(self.axis, -away), self.axis])
        y, breadth = self.length[0], 0.05
        at = lambda lo, hi: rng.uniform(lo, hi)
        self.markers = {
            "L0_1": np.zeros(3),
            "L0_2": np.array([0.0, y * at(0.85, 1.0), 0.0]),
            "L0_3": np.array([0.0, y * at(0.3, 0.6), at(0.03, 0.06)]),
            "L0_4": np.array([at(0.03, 0.06), y * at(0.5, 0.8), at(-0.03, 0.03)]),
            "L0_5": np.array([-at(0.03, 0.06), y * at(0.1, 0.5), at(-0.03, 0.03)]),
            "L1_1": np.array([-self.length[1] * at(0.8, 1.0), 0.0, at(-0.03, 0.03)]),
            "L1_2": np.array([-self.length[1] * at(0.4, 0.7), breadth * at(0.6, 1.1), at(-0.02, 0.02)]),
            "L1_3": np.array([-self.length[1] * at(0.2, 0.5), -breadth * at(0.6, 1.1), at(-0.03, 0.03)]),
            "L1_4": np.array([-self.length[1] * at(0.5, 0.8), -breadth * at(0.6, 1.1), at(-0.04, 0.0)]),
        }
        self.inertia = [self.composite(rng, 0), self.composite(rng, 1)]
        self.damping = rng.uniform(0.0, 4e-4)

    def composite(self, rng, link):
        """Mass, centre and inertia about it of a rod and two boxes, in the frame of the link."""
        along = np.array([0.0, 1.0, 0.0]) if link == 0 else np.array([-1.0, 0.0, 0.0])
        mass, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
        parts = [(rng.uniform(0.2, 0.4), 0.5 * self.length[link] * along, np.array([0.02, 0.02, 0.02]) + self.length[link] * np.abs(along))]
        for _ in range(2):
            at = self.length[link] * rng.uniform(0.1, 0.95) * along + rng.uniform(-0.015, 0.015, 3)
            parts.append((rng.uniform(0.05, 0.25), at, rng.uniform(0.02, 0.07, 3)))
        for m, at, size in parts:
            mass += m
            first += m * at
            second += m * (np.outer(at, at) + np.diag(size**2) / 12)
        centre = first / mass
        second -= mass * np.outer(centre, centre)
        return mass, centre, np.trace(second) * np.eye(3) - second

    def mass(self):
        return sum(i[0] for i in self.inertia)

    def xml(self, tilt, loads, stiffness):
        """MuJoCo's model; `loads` are masses on links as (link, point, mass), `stiffness` that of the hinge across its axis."""
        inertia = [list(i) for i in self.inertia]
        for link, point, extra in loads:
            mass, centre, about = inertia[link]
            total = mass + extra
            both = (mass * centre + extra * point) / total
            moved = lambda m, c: m * (np.dot(c - both, c - both) * np.eye(3) - np.outer(c - both, c - both))
            inertia[link] = [total, both, about + moved(mass, centre) + moved(extra, point)]
        text = lambda x: " ".join(f"{v:.12g}" for v in np.ravel(x))
        def inertial(i):
            _, c, about = inertia[i]
            full = [about[0, 0], about[1, 1], about[2, 2], about[0, 1], about[0, 2], about[1, 2]]
            return f'<inertial pos="{text(c)}" mass="{inertia[i][0]:.12g}" fullinertia="{text(full)}"/>'
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, self.rotation.ravel())
        across = f'stiffness="{stiffness or 0:.9g}" damping="{0.01 * (stiffness or 0):.9g}"'
        loose = f'<joint type="hinge" axis="1 0 0" {across}/><joint type="hinge" axis="0 1 0" {across}/>' if stiffness else ""
        gravity = GRAVITY * np.array([tilt[0], tilt[1], -math.sqrt(1 - tilt[0] ** 2 - tilt[1] ** 2)])
        return (
            f'<mujoco><option timestep="{STEP}" integrator="RK4" gravity="{text(gravity)}"/>'
            f'<worldbody><body name="link0"><freejoint/>{inertial(0)}'
            f'<body name="link1" pos="{text(self.hinge)}" quat="{text(quat)}"><joint type="hinge" axis="0 0 1" damping="{self.damping:.9g}"/>{loose}{inertial(1)}</body>'
            "</body></worldbody></mujoco>"
        )


def point_of(h):
    return np.array(h.get("point_m", [0.0, 0.0, 0.0]))


class Forces:
    """The hidden effects, as forces and moments on the links, from the state of MuJoCo."""

    def __init__(self, chain, hidden):
        self.chain, self.hidden = chain, hidden
        self.tilt, self.loads = [0.0, 0.0], []
        for h in hidden:
            if h["effect"] == "gravity_tilt":
                about = [math.radians(h["about_x_deg"]), math.radians(h["about_y_deg"])]
                # turning g about x moves it along y, about y along -x
                self.tilt = [-math.sin(about[1]), math.sin(about[0]) * math.cos(about[1])]
            # air that is carried along has mass and no weight
            if h["effect"] in ("payload", "added_mass"):
                self.loads.append((int(h["link"][-1]), point_of(h), h["mass_kg"]))

    def apply(self, model, data, time):
        data.qfrc_applied[:] = 0.0
        for h in self.hidden:
            links = [int(h["link"][-1])] if "link" in h else [0, 1]
            for link in links:
                body = link + 1
                rotation = data.xmat[body].reshape(3, 3)
                velocity = np.zeros(6)
                mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0)
                turning, of_origin = velocity[:3], velocity[3:]
                local = point_of(h) if "point_m" in h else self.chain.inertia[link][1] if "link" not in h else np.zeros(3)
                point = data.xpos[body] + rotation @ local
                speed = of_origin + np.cross(turning, rotation @ local)
                force, moment = self.of(h, rotation, point, speed, turning, time)
                mujoco.mj_applyFT(model, data, force, moment, point, body, data.qfrc_applied)

    def of(self, h, rotation, point, speed, turning, time):
        zero = np.zeros(3)
        kind = h["effect"]
        share = 0.5 if "link" not in h else 1.0
        if kind == "constant_force":
            return np.array(h["force_n"]), zero
        if kind == "thrust":
            return rotation @ np.array(h["force_n"]), zero
        if kind == "quadratic_drag":
            return -0.5 * 1.2 * share * h["drag_area_m2"] * np.linalg.norm(speed) * speed, zero
        if kind == "wind":
            through = speed - np.array(h["velocity_mps"])
            return -0.5 * 1.2 * share * h["drag_area_m2"] * np.linalg.norm(through) * through, zero
        if kind == "linear_drag":
            return -share * h["coefficient_nspm"] * speed, zero
        if kind == "rotational_drag":
            return zero, -share * h["coefficient_nmsprad"] * turning
        if kind == "tether":
            line = np.array(h["anchor_m"]) - point
            long = np.linalg.norm(line)
            return h["stiffness_npm"] * max(long - h["rest_length_m"], 0.0) * line / long, zero
        if kind == "crane":
            return h["tension_n"] * unit(np.array(h["pulley_m"]) - point), zero
        if kind == "flywheel":
            return zero, -np.cross(turning, rotation @ np.array(h["momentum_nms"]))
        if kind == "rotor":
            axis, phase = rotation @ np.array(h["axis"]), 2 * math.pi * h["frequency_hz"] * time
            momentum = h["mean_nms"] + h["swing_nms"] * math.sin(phase)
            rate = h["swing_nms"] * 2 * math.pi * h["frequency_hz"] * math.cos(phase)
            return zero, -rate * axis - np.cross(turning, momentum * axis)
        if kind == "added_mass":
            return np.array([0.0, 0.0, h["mass_kg"] * GRAVITY]), zero
        if kind in ("payload", "gravity_tilt"):
            return zero, zero
        raise SystemExit(f"{kind} is not simulated here")


def hermite(s, p0, v0, p1, v1, duration):
    """A smooth curve between two states; `s` from 0 to 1."""
    a, b, c, d = 2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, -2 * s**3 + 3 * s**2, s**3 - s**2
    return a * p0 + b * duration * v0 + c * p1 + d * duration * v1


def turned(quat, axis, angle):
    """A turn about an axis of the world, before the orientation."""
    turn, out = np.zeros(4), np.zeros(4)
    mujoco.mju_axisAngle2Quat(turn, axis, angle)
    mujoco.mju_mulQuat(out, turn, quat)
    return out


class Recorder:
    """Postures at the rate of the cameras."""

    def __init__(self, chain, rng):
        self.chain, self.rng = chain, rng
        self.postures, self.flights = [], []

    def carry(self, position, quat, joint, release, duration):
        """From rest at one posture to the state at release: position, velocity, axis and rate of turning, angle, its rate."""
        to, velocity, axis, rate, angle, angle_rate = release
        n = int(duration * RATE)
        for k in range(n):
            s = k / n
            turn = hermite(s, 0.0, 0.0, 0.5 * rate * duration, rate, duration)
            posture = hermite(s, position, np.zeros(3), to, velocity, duration)
            self.postures.append((posture, turned(quat, axis, turn), hermite(s, joint, 0.0, angle, angle_rate, duration), RIGID))
        return turned(quat, axis, 0.5 * rate * duration)

    def catch(self, state, duration):
        """From the end of a flight to rest."""
        position, velocity, quat, turning, joint, joint_rate, bent = state
        n, rate = int(duration * RATE), np.linalg.norm(turning)
        end = position + 0.4 * duration * velocity
        for k in range(n):
            s = k / n
            turn = hermite(s, 0.0, rate, 0.4 * rate * duration, 0.0, duration)
            self.postures.append((
                hermite(s, position, velocity, end, np.zeros(3), duration),
                turned(quat, unit(turning), turn),
                hermite(s, joint, joint_rate, joint + 0.4 * duration * joint_rate, 0.0, duration),
                (1 - s) ** 2 * bent,
            ))
        return end, turned(quat, unit(turning), 0.4 * rate * duration), joint + 0.4 * duration * joint_rate, RIGID

    def hold(self, posture, duration):
        self.postures += [posture] * int(duration * RATE)

    def fly(self, model, forces, release, quat, duration):
        data = mujoco.MjData(model)
        position, velocity, axis, rate, angle, angle_rate = release
        data.qpos[:3], data.qpos[3:7], data.qpos[7] = position, quat, angle
        # MuJoCo's free joint: linear velocity in the world, angular in the body
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, quat)
        data.qvel[:3], data.qvel[3:6], data.qvel[6] = velocity, rotation.reshape(3, 3).T @ (rate * axis), angle_rate
        first = len(self.postures)
        mujoco.mj_forward(model, data)
        for step in range(int(duration * RATE) * PER_FRAME):
            if step % PER_FRAME == 0:
                self.postures.append((data.qpos[:3].copy(), data.qpos[3:7].copy(), float(data.qpos[7]), self.bent(data)))
            forces.apply(model, data, (first + step / PER_FRAME) / RATE)
            mujoco.mj_step(model, data)
            mujoco.mj_forward(model, data)
        self.flights.append([first, len(self.postures)])
        rotation = data.xmat[1].reshape(3, 3)
        turning = rotation @ data.qvel[3:6]
        return data.qpos[:3].copy(), data.qvel[:3].copy(), data.qpos[3:7].copy(), turning, float(data.qpos[7]), float(data.qvel[6]), self.bent(data)

    @staticmethod
    def bent(data):
        """Angles of the hinge across its axis."""
        return data.qpos[8:10].copy() if len(data.qpos) > 8 else RIGID

    def markers(self, noise, gaps, moved):
        """Marker positions in mm, by frame; NaN in gaps."""
        chain = self.chain
        out = np.zeros((len(self.postures), len(LABELS), 3))
        z = np.array([0.0, 0.0, 1.0])
        matrix = lambda quat: (mujoco.mju_quat2Mat(flat, quat), flat.reshape(3, 3).copy())[1]
        about = lambda axis, angle: matrix(turned(np.array([1.0, 0.0, 0.0, 0.0]), axis, angle))
        flat, x, y = np.zeros(9), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
        for f, (position, quat, angle, bent) in enumerate(self.postures):
            base = matrix(quat)
            second = base @ chain.rotation @ about(z, angle) @ about(x, bent[0]) @ about(y, bent[1])
            for i, label in enumerate(LABELS):
                p = chain.markers[label] + moved.get(label, 0.0)
                out[f, i] = position + (base @ p if label.startswith("L0") else base @ chain.hinge + second @ p)
        out += noise * self.rng.standard_normal(out.shape)
        while np.isnan(out[:, :, 0]).mean() < gaps:
            first, marker = self.rng.integers(len(out)), self.rng.integers(len(LABELS))
            out[first : first + self.rng.integers(5, 40), marker] = np.nan
        return 1000 * out

    def write(self, path, noise, gaps, moved):
        c3d = ezc3d.c3d()
        c3d["parameters"]["POINT"]["RATE"]["value"] = [RATE]
        c3d["parameters"]["POINT"]["LABELS"]["value"] = tuple(LABELS)
        c3d["parameters"]["POINT"]["UNITS"]["value"] = ("mm",)
        points = self.markers(noise, gaps, moved)
        c3d["data"]["points"] = np.concatenate([points.transpose(2, 1, 0), np.ones((1, len(LABELS), len(points)))])
        c3d.write(str(path))


def quaternion(rng):
    return unit(rng.standard_normal(4))


def simulated(scenario, out):
    rng = np.random.default_rng([scenario["seed"], 77])
    chain = Chain(rng)
    capture = scenario.get("capture", {})
    noise, gaps = capture.get("marker_noise_m", 3e-4), capture.get("gap_fraction", 0.0)
    hidden = scenario.get("hidden", [])
    out.mkdir(parents=True, exist_ok=True)
    forces = Forces(chain, hidden)
    faults = scenario.get("faults", {})
    fault = faults.get("moved", {})
    moved = {fault["marker"]: np.array(fault["by_m"])} if fault else {}
    model = mujoco.MjModel.from_xml_string(chain.xml(forces.tilt, forces.loads, faults.get("loose", {}).get("stiffness_nmprad")))
    static = Recorder(chain, rng)
    static.hold((np.array([0.1, 0.2, 0.9]), quaternion(rng), 0.0, RIGID), 2.5)
    static.write(out / "static.c3d", noise, 0.0, {})
    swing = Recorder(chain, rng)
    quat, phases = quaternion(rng), rng.uniform(0, 6, 8)
    for k in range(int(10 * RATE)):
        t = k / RATE
        position = np.array([0.2 * math.sin(0.7 * t + phases[0]), 0.2 * math.sin(0.9 * t + phases[1]), 1.0 + 0.1 * math.sin(0.5 * t + phases[2])])
        at = turned(turned(quat, np.array([0.0, 0.0, 1.0]), 0.8 * math.sin(0.6 * t + phases[3])), np.array([1.0, 0.0, 0.0]), 0.8 * math.sin(0.8 * t + phases[4]))
        swing.postures.append((position, at, 1.2 * math.sin(2.3 * t + phases[5]) - 1.2 * math.sin(phases[5]), RIGID))
    swing.write(out / "hinge_calib.c3d", noise, gaps, {})
    throws = scenario["body"].get("throws", {"recordings": 5, "throws": 5})
    flights = {}
    for r in range(throws["recordings"]):
        record = Recorder(chain, rng)
        at = (np.array([rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), 1.0]), quaternion(rng), rng.uniform(-0.8, 0.8), RIGID)
        record.hold(at, 0.8)
        for _ in range(throws["throws"]):
            position, quat, joint, _ = at
            to = np.array([rng.uniform(-0.6, 0.6), rng.uniform(-0.6, 0.6), rng.uniform(1.1, 1.5)])
            up = rng.uniform(2.3, 3.4)
            velocity = np.array([*rng.uniform(-1.2, 1.2, 2), up])
            release = (to, velocity, direction(rng), rng.uniform(3.0, 9.0), joint + rng.uniform(-0.5, 0.5), rng.uniform(-9.0, 9.0))
            quat = record.carry(position, quat, joint, release, rng.uniform(0.7, 1.1))
            state = record.fly(model, forces, release, quat, 2 * up / GRAVITY + rng.uniform(-0.03, 0.05))
            at = record.catch(state, rng.uniform(0.35, 0.5))
            record.hold(at, rng.uniform(0.2, 0.5))
        name = f"throws_{r + 1:02d}"
        record.write(out / f"{name}.c3d", noise, gaps, moved if r + 1 >= fault.get("from", 1) else {})
        flights[name] = record.flights
    (out / "object.yaml").write_text(f"name: chain of MuJoCo\ntotal_mass_kg: {chain.mass():.6f}\ngravity_m_s2: {GRAVITY}\n")
    links = [{"mass_kg": m, "centre_m": list(c), "inertia_kgm2": about.tolist()} for m, c, about in chain.inertia]
    (out / "truth").mkdir(exist_ok=True)
    (out / "truth" / "truth.json").write_text(json.dumps({"hidden": hidden, "links": links, "flights": flights}))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    # the benchmarks write scenarios as JSON, which is YAML
    simulated(json.loads(args.scenario.read_text()), args.out)
