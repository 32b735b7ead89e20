"""Planned flights played on the nominal model: MuJoCo against the limits of the URDF.

    python tests/peers/robot_next.py ROBOT_FOLDER PLAN.json NEXT_FOLDER

ROBOT_FOLDER holds model/nominal.urdf and .xml; PLAN.json is what `aloft parameters pipelines/robot.yaml --assess --json` printed, and
NEXT_FOLDER what `--next-flights` wrote. A controller (proportional and derivative, with the inverse dynamics of the model as feed-forward)
follows each file from the release that the plan names. Prints the largest use of range, rate and torque and what the controller misses; fails
if a limit is exceeded.
"""

import csv
import json
import pathlib
import sys
import xml.etree.ElementTree as xml

import mujoco
import numpy as np


def read(path):
    with open(path) as f:
        rows = list(csv.reader(f))
    names = [n.removeprefix("q_").removesuffix("_rad").removesuffix("_m") for n in rows[0][1:]]
    values = np.array(rows[1:], float)
    return names, values[:, 0], values[:, 1:]


def main():
    robot, plan, folder = map(pathlib.Path, sys.argv[1:4])
    plan = json.loads(plan.read_text())["assessment"]["next_flights"]
    limits = {}
    for joint in xml.parse(robot / "model" / "nominal.urdf").getroot().iter("joint"):
        limit = joint.find("limit")
        if limit is not None:
            limits[joint.get("name")] = {k: float(limit.get(k)) for k in ("lower", "upper", "velocity", "effort")}
    model = mujoco.MjModel.from_xml_path(str(robot / "model" / "nominal.xml"))
    model.opt.timestep = 0.0005
    worst = dict(range=0.0, rate=0.0, torque=0.0, missed=0.0)
    for flight in plan["flights"]:
        names, times, want = read(folder / flight["file"])
        joints = [model.joint(n) for n in names]
        qa = np.array([j.qposadr[0] for j in joints])
        va = np.array([j.dofadr[0] for j in joints])
        data = mujoco.MjData(model)
        data.qpos[:7] = [0, 0, 2, 1, 0, 0, 0]
        data.qpos[qa] = want[0]
        # the turn is that of the base; its velocity is such that the centre of mass rises as
        # planned
        data.qvel[3:6] = flight["turn_rad_s"]
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        data.qvel[:3] += np.array([0, 0, flight["speed_up_m_s"]]) - data.subtree_linvel[1]
        rate = np.gradient(want, times, axis=0, edge_order=2)
        change = np.gradient(rate, times, axis=0, edge_order=2)
        inertia = np.zeros((model.nv, model.nv))
        while data.time < flight["duration_s"]:
            at = lambda x: np.array([np.interp(data.time, times, x[:, j]) for j in range(len(names))])
            q, v, a = at(want), at(rate), at(change)
            mujoco.mj_forward(model, data)
            # torque for the wanted accelerations with a base that nothing pushes
            mujoco.mj_fullM(model, inertia, data.qM) if hasattr(data, "qM") else mujoco.mj_fullM(model, data, inertia)
            bias = data.qfrc_bias - data.qfrc_passive
            ask = a + 4000 * (q - data.qpos[qa]) + 120 * (v - data.qvel[va])
            base = np.linalg.solve(inertia[:6, :6], -bias[:6] - inertia[:6, va] @ ask)
            torque = inertia[np.ix_(va, range(6))] @ base + inertia[np.ix_(va, va)] @ ask + bias[va]
            friction = model.dof_frictionloss[va] * np.tanh(v / 0.05)
            data.qfrc_applied[:] = 0
            data.qfrc_applied[va] = torque + friction
            for j, n in enumerate(names):
                l = limits[n]
                middle, half = (l["upper"] + l["lower"]) / 2, (l["upper"] - l["lower"]) / 2
                worst["range"] = max(worst["range"], abs(data.qpos[qa[j]] - middle) / half)
                worst["rate"] = max(worst["rate"], abs(data.qvel[va[j]]) / l["velocity"])
                worst["torque"] = max(worst["torque"], abs(torque[j] + friction[j]) / l["effort"])
            worst["missed"] = max(worst["missed"], np.abs(data.qpos[qa] - q).max())
            mujoco.mj_step(model, data)
        height = data.subtree_com[1][2]
        print(f"{flight['file']}: centre of mass {height:.3f} m at the end, flight of {flight['duration_s']} s")
    print(
        f"largest use of the limits: range {100 * worst['range']:.0f} %, rate {100 * worst['rate']:.0f} %, torque {100 * worst['torque']:.0f} %; "
        f"the controller misses the files by {1e3 * worst['missed']:.2f} mrad at most"
    )
    assert worst["range"] < 1 and worst["rate"] < 1 and worst["torque"] < 1 and worst["missed"] < 0.02, worst


if __name__ == "__main__":
    main()
