"""Golden of crates/robot: the number of base parameters of random trees, by the rank of Pinocchio's joint-torque regressor.

    python tests/peers/robot_trees.py       (writes fixtures/goldens/robot_trees.json)

Twenty small trees of revolute, continuous, prismatic and fixed joints, and two of the size of real robots (12 and 22 hinges). The rank
is that of the regressor of all rows (base and joints) over random states, and of the base rows alone; all links have inertia.
"""

import json
import pathlib

import numpy as np
import pinocchio as pin

OUT = pathlib.Path(__file__).resolve().parent.parent.parent / "fixtures" / "goldens" / "robot_trees.json"
rng = np.random.default_rng(7)


def words(v):
    return " ".join(f"{x:.4g}" for x in v)


def tree(n, kinds):
    out = '<robot name="t">'
    for i in range(n):
        out += (
            f'<link name="l{i}"><inertial><origin xyz="{words(rng.uniform(-0.1, 0.1, 3))}" rpy="0 0 0"/><mass value="{rng.uniform(0.5, 3):.3g}"/>'
            '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.025"/></inertial></link>'
        )
    for i in range(1, n):
        kind = rng.choice(kinds)
        axis = rng.normal(size=3) if rng.random() < 0.5 else np.eye(3)[rng.integers(3)]
        out += (
            f'<joint name="j{i}" type="{kind}"><parent link="l{rng.integers(max(0, i - 3), i)}"/><child link="l{i}"/>'
            f'<origin xyz="{words(rng.uniform(-0.3, 0.3, 3))}" rpy="{words(rng.uniform(-1, 1, 3))}"/>'
            f'<axis xyz="{words(axis / np.linalg.norm(axis))}"/>'
            + ('<limit lower="-2" upper="2" effort="1" velocity="1"/>' if kind in ("revolute", "prismatic") else "")
            + "</joint>"
        )
    return out + "</robot>"


def ranks(text):
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    data = model.createData()
    rows = []
    for _ in range(12 * model.njoints):
        q = pin.integrate(model, pin.neutral(model), rng.uniform(-1, 1, model.nv))
        rows.append(pin.computeJointTorqueRegressor(model, data, q, rng.normal(0, 2, model.nv), rng.normal(0, 4, model.nv)).copy())
    a = np.array(rows)
    scale = np.maximum(np.linalg.norm(a.reshape(-1, a.shape[2]), axis=0), 1e-12)

    def rank(m):
        s = np.linalg.svd(m.reshape(-1, m.shape[2]) / scale, compute_uv=False)
        return int((s > 1e-9 * s[0]).sum())

    return rank(a[:, :6]), rank(a)


def main():
    mixed = ["revolute", "continuous", "prismatic", "fixed"]
    cases = [tree(int(rng.integers(3, 8)), mixed) for _ in range(20)] + [tree(13, ["revolute"]), tree(23, ["revolute"])]
    out = []
    for urdf in cases:
        base, every = ranks(urdf)
        out.append(dict(urdf=urdf, base_rank=base, torque_rank=every))
    OUT.write_text(json.dumps(out, indent=0) + "\n")
    print([(c["base_rank"], c["torque_rank"]) for c in out])


if __name__ == "__main__":
    main()
