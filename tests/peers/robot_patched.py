"""Model files with identified inertials in Pinocchio and MuJoCo, against the nominal file on true motion.

    python tests/peers/robot_patched.py ROBOT_FOLDER EXPORT_FOLDER

ROBOT_FOLDER holds model/nominal.urdf and .xml and truth/*.npz; EXPORT_FOLDER is what `aloft export --format urdf,mjcf` wrote.
Prints what a flight's base wrench (zero for a true model) and the joint torques miss in inverse dynamics, and how far a rollout of
the robot in free flight departs from the true motion, for both files.
"""

import pathlib
import sys

import mujoco
import numpy as np
import pinocchio as pin


def states(path):
    z = np.load(path)
    for first, last in z["flight_intervals"]:
        at = np.flatnonzero((z["frames"] >= first) & (z["frames"] <= last))
        yield z["qpos"][at], z["qvel"][at], z["qacc"][at], z["tau"][at] - z["passive"][at]


def wrench(model, q, v, a):
    data = model.createData()
    w, x, y, z = q[3:7]
    rot = pin.Quaternion(w, x, y, z).matrix()
    # MuJoCo: linear velocity in the world, angular in the body; Pinocchio: both in the body
    lin, omega = rot.T @ v[:3], v[3:6]
    acc = rot.T @ a[:3] - np.cross(omega, lin)
    order = [model.joints[model.getJointId(n)] for n in model.names[2:]]
    qp, vp, ap = np.zeros(model.nq), np.zeros(model.nv), np.zeros(model.nv)
    qp[:7] = [*q[:3], x, y, z, w]
    vp[:6], ap[:6] = [*lin, *omega], [*acc, *a[3:6]]
    for k, j in enumerate(order):
        qp[j.idx_q], vp[j.idx_v], ap[j.idx_v] = q[7 + NAMES.index(model.names[2 + k])], v[6 + NAMES.index(model.names[2 + k])], a[6 + NAMES.index(model.names[2 + k])]
    return pin.rnea(model, data, qp, vp, ap)


def main():
    global NAMES
    robot, export = map(pathlib.Path, sys.argv[1:3])
    recordings = sorted((robot / "truth").glob("flight_*.npz"))
    nominal = mujoco.MjModel.from_xml_path(str(robot / "model" / "nominal.xml"))
    NAMES = [mujoco.mj_id2name(nominal, mujoco.mjtObj.mjOBJ_JOINT, i) for i in range(1, nominal.njnt)]
    files = {"nominal": robot / "model", "identified": export / "Models"}
    for label, folder in files.items():
        end = "" if label == "nominal" else "_identified"
        model = pin.buildModelFromUrdf(str(folder / f"nominal{end}.urdf"), pin.JointModelFreeFlyer())
        model.gravity.linear = np.array([0, 0, -9.81])
        force, moment = [], []
        for path in recordings:
            for q, v, a, _ in states(path):
                for k in range(0, len(q), 5):
                    tau = wrench(model, q[k], v[k], a[k])
                    force.append(np.abs(tau[:3]).mean())
                    moment.append(np.abs(tau[3:6]).mean())
        same = mujoco.MjModel.from_xml_path(str(folder / f"nominal{end}.xml"))
        drift = []
        for path in recordings:
            for q, v, _, tau in states(path):
                data = mujoco.MjData(same)
                data.qpos[:], data.qvel[:] = q[0], v[0]
                same.opt.timestep = 0.0005
                # the joints follow the recorded accelerations only in the true model: hold their
                # motion, watch the base
                for k in range(min(len(q), 30) - 1):
                    for s in range(20):
                        share = s / 20
                        data.qpos[7:] = q[k, 7:] * (1 - share) + q[k + 1, 7:] * share
                        data.qvel[6:] = v[k, 6:] * (1 - share) + v[k + 1, 6:] * share
                        full = np.zeros((same.nv, same.nv))
                        acc = (v[k + 1, 6:] - v[k, 6:]) * 100
                        mujoco.mj_forward(same, data)
                        mujoco.mj_fullM(same, full, data.qM) if hasattr(data, "qM") else mujoco.mj_fullM(same, data, full)
                        base = np.linalg.solve(full[:6, :6], -data.qfrc_bias[:6] - full[:6, 6:] @ acc)
                        data.qvel[:6] += 0.0005 * base
                        step = np.zeros(same.nv)
                        step[:6] = data.qvel[:6]
                        mujoco.mj_integratePos(same, data.qpos, step, 0.0005)
                end_q = q[min(len(q), 30) - 1]
                turn = np.zeros(3)
                inverse = np.zeros(4)
                mujoco.mju_negQuat(inverse, end_q[3:7])
                between = np.zeros(4)
                mujoco.mju_mulQuat(between, inverse, data.qpos[3:7])
                mujoco.mju_quat2Vel(turn, between, 1)
                drift.append((np.linalg.norm(data.qpos[:3] - end_q[:3]), np.degrees(np.linalg.norm(turn))))
        drift = np.array(drift)
        print(
            f"{label}: mass {sum(i.mass for i in model.inertias):.3f} kg in Pinocchio, {same.body_mass.sum():.3f} kg in MuJoCo; base wrench in "
            f"flight {np.mean(force):.3f} N, {np.mean(moment):.4f} N·m; after 0.3 s of free rollout the base is off by "
            f"{1e3 * drift[:, 0].mean():.2f} mm, {drift[:, 1].mean():.3f}°"
        )


if __name__ == "__main__":
    main()
