"""A small simulated robot for fixtures/robot: joint logs, base pose and inertial unit with known truth (MuJoCo).

    python tests/peers/robot_fixture.py       (writes fixtures/robot)

A trunk with two arms of two hinges each is thrown by a virtual hand (a stiff wrench towards a reference pose) three times in each
of two recordings. Log at 250 Hz by the robot's clock: encoders of 16 bit a turn, rates, measured torques with gains off by about
2 %, gyroscope and accelerometer with bias. Base pose at 100 Hz by a clock of its own. model/nominal.urdf and .xml have the true
geometry and wrong inertias, truth.json the true ones. NAME_markers.c3d holds the same motion as markers on trunk and forearms (0.3 mm), its
clock starting 0.07 s after the robot's; it is read where NAME_base.csv is missing.
"""

import gzip
import json
import pathlib

import ezc3d
import mujoco
import numpy as np

OUT = pathlib.Path(__file__).resolve().parent.parent.parent / "fixtures" / "robot"
JOINTS = ["l_shoulder", "l_elbow", "r_shoulder", "r_elbow"]
IMU = np.array([0.02, -0.01, 0.03])
MARKERS = {
    "T1": ("trunk", (0.08, 0.06, 0.10)), "T2": ("trunk", (-0.07, 0.05, 0.11)), "T3": ("trunk", (0.07, -0.06, 0.12)),
    "T4": ("trunk", (-0.08, -0.05, 0.10)), "T5": ("trunk", (0.09, 0.01, -0.09)), "T6": ("trunk", (-0.08, 0.02, -0.10)),
    "L1": ("l_lower", (0.03, 0.0, -0.15)), "L2": ("l_lower", (-0.02, 0.02, -0.18)), "R1": ("r_lower", (0.03, 0.0, -0.15)),
}
LATE_FRAMES = 7
rng = np.random.default_rng(18)

# name, parent, joint, origin, axis, mass, centre of mass, principal inertia, armature, damping,
# friction
LINKS = [
    ("trunk", None, None, (0, 0, 0), None, 3.0, (0.01, -0.005, 0.02), (0.030, 0.022, 0.018), 0, 0, 0),
    ("l_upper", "trunk", "l_shoulder", (0, 0.12, 0.08), (0, 1, 0), 0.7, (0.01, 0.02, -0.09), (0.0030, 0.0031, 0.0006), 0.006, 0.10, 0.15),
    ("l_lower", "l_upper", "l_elbow", (0, 0.02, -0.2), (1, 0, 0), 0.5, (0.02, 0.01, -0.10), (0.0024, 0.0025, 0.0004), 0.004, 0.08, 0.10),
    ("r_upper", "trunk", "r_shoulder", (0, -0.12, 0.08), (0, 1, 0), 0.7, (0.01, -0.02, -0.09), (0.0030, 0.0031, 0.0006), 0.006, 0.10, 0.15),
    ("r_lower", "r_upper", "r_elbow", (0, -0.02, -0.2), (1, 0, 0), 0.5, (0.02, -0.01, -0.10), (0.0024, 0.0025, 0.0004), 0.004, 0.08, 0.10),
]


def perturbed(link):
    name, parent, joint, origin, axis, mass, com, inertia, armature, damping, friction = link
    r = rng.uniform
    return (
        name, parent, joint, origin, axis, mass * r(0.8, 1.2), tuple(np.add(com, r(-0.012, 0.012, 3))),
        tuple(np.multiply(inertia, r(0.85, 1.15))), armature * r(0.85, 1.15), damping * r(0.7, 1.3), friction * r(0.7, 1.3),
    )


def words(v):
    return " ".join(f"{x:.9g}" for x in v)


def mjcf(links):
    def body(name, depth):
        link = next(l for l in links if l[0] == name)
        _, _, joint, origin, axis, mass, com, inertia, armature, damping, friction = link
        pad = "  " * depth
        out = f'{pad}<body name="{name}" pos="{words(origin)}">\n'
        if joint is None:
            out += f"{pad}  <freejoint/>\n"
        else:
            out += f'{pad}  <joint name="{joint}" axis="{words(axis)}" armature="{armature:.6g}" damping="{damping:.6g}" frictionloss="{friction:.6g}"/>\n'
        full = words([*inertia, 0, 0, 0])
        out += f'{pad}  <inertial pos="{words(com)}" mass="{mass:.9g}" fullinertia="{full}"/>\n'
        for l in links:
            if l[1] == name:
                out += body(l[0], depth + 1)
        return out + f"{pad}</body>\n"

    motors = "".join(f'    <motor name="{j}" joint="{j}"/>\n' for j in JOINTS)
    return (
        '<mujoco model="two_arms">\n  <!-- inertias from drawings -->\n  <compiler angle="radian"/>\n'
        '  <option timestep="0.0005" integrator="RK4"/>\n  <worldbody>\n' + body("trunk", 2)
        + "  </worldbody>\n  <actuator>\n" + motors + "  </actuator>\n</mujoco>\n"
    )


def urdf(links):
    out = '<?xml version="1.0"?>\n<robot name="two_arms">\n  <!-- inertias from drawings -->\n'
    for name, _, _, _, _, mass, com, i, *_ in links:
        out += (
            f'  <link name="{name}"><inertial><origin xyz="{words(com)}" rpy="0 0 0"/><mass value="{mass:.9g}"/>'
            f'<inertia ixx="{i[0]:.9g}" ixy="0" ixz="0" iyy="{i[1]:.9g}" iyz="0" izz="{i[2]:.9g}"/></inertial></link>\n'
        )
    for name, parent, joint, origin, axis, *_, damping, friction in links:
        if joint:
            out += (
                f'  <joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="{name}"/><origin xyz="{words(origin)}"/>'
                f'<axis xyz="{words(axis)}"/><limit lower="-2.5" upper="2.5" effort="20" velocity="20"/>'
                f'<dynamics damping="{damping:.4g}" friction="{friction:.4g}"/></joint>\n'
            )
    return out + "</robot>\n"


def smooth(x):
    x = np.clip(x, 0, 1)
    return x**3 * (10 - 15 * x + 6 * x * x)


def record(model, name, seed, gains, gyro_bias, acc_bias):
    r = np.random.default_rng(seed)
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, 1.2, 1, 0, 0, 0]
    mujoco.mj_forward(model, data)
    phase = r.uniform(0, 2 * np.pi, (4, 3))
    speed = r.uniform(4, 14, (4, 3))
    size = r.uniform(0.2, 0.5, (4, 3))
    offset = r.uniform(-0.01, 0.01)
    rows, poses, flights, markers = [], [], [], []
    r_markers = np.random.default_rng(100 + seed)
    cycle, n = 1.5, int(3 * 1.5 / 0.0005) + 400
    spin = r.uniform(-4, 4, (3, 3))
    before = data.qvel.copy()
    for k in range(n):
        t = k * 0.0005
        i, s = min(int(t / cycle), 2), t - min(int(t / cycle), 2) * cycle
        want = (size * np.sin(speed * t + phase)).sum(axis=1)
        rate = (size * speed * np.cos(speed * t + phase)).sum(axis=1)
        tau = 25 * (want - data.qpos[7:]) + 1.2 * (rate - data.qvel[6:])
        data.ctrl[:] = tau
        data.xfrc_applied[:] = 0
        flying = 0.75 < s < 1.27 and t < 3 * cycle
        if not flying:
            # hand: hold, then throw up with a spin
            push = smooth((s - 0.45) / 0.3) if s <= 0.75 else 0
            v = np.array([0, 0, 2.5 * push])
            z = 1.2 + (0.35 * smooth((s - 0.45) / 0.3) if s <= 0.75 else 0)
            force = 900 * (np.array([0, 0, z]) - data.qpos[:3]) * (push == 0) + 90 * (v - data.qvel[:3]) + 5.4 * np.array([0, 0, 9.81])
            turn = np.zeros(3)
            mujoco.mju_quat2Vel(turn, data.qpos[3:7], 1)
            body = 6 * (push == 0) * -turn + 2.0 * (spin[i] * push - data.qvel[3:6])
            rot = np.zeros(9)
            mujoco.mju_quat2Mat(rot, data.qpos[3:7])
            data.xfrc_applied[1, :3] = force
            data.xfrc_applied[1, 3:] = rot.reshape(3, 3) @ body
        flights.append(flying)
        mujoco.mj_forward(model, data)
        if k % 8 == 0:
            rot = np.zeros(9)
            mujoco.mju_quat2Mat(rot, data.qpos[3:7])
            rot = rot.reshape(3, 3)
            w, dw = data.qvel[3:6], data.qacc[3:6]
            acc = rot.T @ (data.qacc[:3] + [0, 0, 9.81]) + np.cross(dw, IMU) + np.cross(w, np.cross(w, IMU))
            rows.append((t, data.qpos[7:].copy(), data.qvel[6:].copy(), tau.copy(), w.copy(), acc))
        if k % 20 == 0:
            poses.append((t, data.qpos[:7].copy()))
            seen = []
            for link, place in MARKERS.values():
                body = model.body(link).id
                seen.append(data.xpos[body] + data.xmat[body].reshape(3, 3) @ place + r_markers.normal(0, 0.0003, 3))
            markers.append(seen)
        mujoco.mj_step(model, data)
    step = 2 * np.pi / 65536
    head = ["time_s"] + [f"q_{j}_rad" for j in JOINTS] + [f"dq_{j}_rad_s" for j in JOINTS] + [f"tau_meas_{j}_nm" for j in JOINTS]
    head += [f"gyro_{a}_rad_s" for a in "xyz"] + [f"acc_{a}_m_s2" for a in "xyz"]
    lines = [",".join(head)]
    for t, q, dq, tau, w, acc in rows:
        values = [f"{t:.3f}"] + [f"{round(x / step) * step:.6f}" for x in q]
        values += [f"{x:.2f}" for x in dq + r.normal(0, 0.02, 4)] + [f"{x:.3f}" for x in gains * tau + r.normal(0, 0.05, 4)]
        values += [f"{x:.4f}" for x in w + gyro_bias + r.normal(0, 0.004, 3)] + [f"{x:.3f}" for x in acc + acc_bias + r.normal(0, 0.04, 3)]
        lines.append(",".join(values))
    packed = gzip.compress(("\n".join(lines) + "\n").encode(), 9, mtime=0)
    (OUT / f"{name}_robot.csv.gz").write_bytes(packed)
    lines = ["time_s,x_m,y_m,z_m,qw,qx,qy,qz"]
    for t, p in poses:
        turn = np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, np.array([1.0, 0, 0]), 0.0)
        noise = r.normal(0, np.radians(0.05) / 2, 3)
        small = np.array([1, *noise])
        q = np.zeros(4)
        mujoco.mju_mulQuat(q, small / np.linalg.norm(small), p[3:])
        x = p[:3] + r.normal(0, 0.0003, 3)
        lines.append(f"{t + offset:.5f}," + ",".join(f"{v:.5f}" for v in x) + "," + ",".join(f"{v:.6f}" for v in q))
    (OUT / f"{name}_base.csv").write_text("\n".join(lines) + "\n")
    write_markers(OUT / f"{name}_markers.c3d", np.array(markers)[LATE_FRAMES:])
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.array(flights, int), [0]])))
    return dict(clock_offset_s=offset, flights_s=[[a * 0.0005, b * 0.0005] for a, b in edges.reshape(-1, 2)])


def write_markers(path, seen):
    """Markers in mm at 100 Hz, with a gap of one marker."""
    points = np.ones((4, len(MARKERS), len(seen)))
    points[:3] = 1000 * seen.transpose(2, 1, 0)
    points[:3, 1, 120:150] = np.nan
    c3d = ezc3d.c3d()
    c3d["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    c3d["parameters"]["POINT"]["LABELS"]["value"] = list(MARKERS)
    c3d["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    c3d.add_parameter("POINT", "X_SCREEN", ["+X"])
    c3d.add_parameter("POINT", "Y_SCREEN", ["+Z"])
    c3d["data"]["points"] = points
    c3d.write(str(path))


def main():
    (OUT / "model").mkdir(parents=True, exist_ok=True)
    nominal = [perturbed(l) for l in LINKS]
    (OUT / "model" / "nominal.urdf").write_text(urdf(nominal))
    (OUT / "model" / "nominal.xml").write_text(mjcf(nominal))
    model = mujoco.MjModel.from_xml_string(mjcf(LINKS))
    gains = rng.normal(1, 0.02, 4)
    gyro_bias, acc_bias = rng.normal(0, 0.008, 3), rng.normal(0, 0.08, 3)
    recordings = {n: record(model, n, s, gains, gyro_bias, acc_bias) for n, s in (("throw_01", 1), ("throw_02", 2))}
    mass = sum(l[5] for l in LINKS)
    (OUT / "robot.yaml").write_text(
        "# a simulated robot of two arms; made by tests/peers/robot_fixture.py\nname: two_arms\n"
        f"total_mass_kg: {mass:.3f}\ngravity_m_s2: 9.81\nbase_link: trunk\n"
        "model: {urdf: model/nominal.urdf, mjcf: model/nominal.xml}\n"
        f"imu: {{link: trunk, position_m: [{', '.join(str(x) for x in IMU)}]}}\n"
        "noise: {position_m: 0.0003, orientation_deg: 0.05, dq_rad_s: 0.02, torque_nm: 0.05, gyro_rad_s: 0.004, acc_m_s2: 0.04}\n"
        "markers:\n" + "".join(f"  {m}: {{link: {l}, position_m: {list(p)}}}\n" for m, (l, p) in MARKERS.items())
    )
    truth = dict(
        links={l[0]: dict(mass_kg=l[5], com_m=l[6], inertia_kgm2=l[7]) for l in LINKS},
        joints={l[2]: dict(armature=l[8], damping=l[9], friction=l[10]) for l in LINKS if l[2]},
        gains=dict(zip(JOINTS, gains.tolist())),
        recordings=recordings,
    )
    (OUT / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")


if __name__ == "__main__":
    main()
