"""Pinocchio's regressor and numpy's factorisations on the frames that crates/regressor/benches/rows.rs uses.

    python identify_bench.py crates/regressor/tests/data

Prints times per call, and checks that six rows of Pinocchio's joint-torque regressor times the true parameters vanish.
"""
import json, pathlib, sys, time
import numpy as np
import pinocchio as pin
from ours import ours

data = pathlib.Path(sys.argv[1])
spec = json.loads((data / "subject_a.json").read_text())
model = pin.Model()
model.gravity.linear = np.array(spec["gravity_mps2"], float)
ids = {}
for i, link in enumerate(spec["model"]["links"]):
    joint = link["joint"]
    if joint == "free":
        kind = pin.JointModelFreeFlyer()
    elif joint == "spherical":
        kind = pin.JointModelSpherical()
    else:
        kind = pin.JointModelRevoluteUnaligned(np.array(joint["revolute"], float))
    parent = ids[link["parent"]] if "parent" in link else 0
    ids[link["name"]] = model.addJoint(parent, kind, pin.SE3(np.eye(3), np.array(link["position_m"], float)), link["name"])
    m, mx, my, mz, xx, yy, zz, yz, zx, xy = spec["phi"][i]
    pin_phi = np.array([m, mx, my, mz, xx, xy, yy, zx, yz, zz])
    model.appendBodyToJoint(ids[link["name"]], pin.Inertia.FromDynamicParameters(pin_phi), pin.SE3.Identity())
work = model.createData()
q = np.fromfile(data / "subject_a.i32", "<i4").reshape(-1, model.nq)[::4] * 5e-9
va = np.fromfile(data / "subject_a.f32", "<f4").reshape(-1, 2 * model.nv).astype(float)
for row in q:
    for joint in model.joints[1:]:
        if joint.nq in (4, 7):
            s = slice(joint.idx_q + joint.nq - 4, joint.idx_q + joint.nq)
            row[s] /= np.linalg.norm(row[s])
n = min(len(q), len(va))
phi = np.concatenate([model.inertias[i].toDynamicParameters() for i in range(1, model.njoints)])


def timed(name, call, repeat=5):
    best = min(_once(call) for _ in range(repeat))
    print(f"{name}: {1e6 * best:.1f} µs")


def _once(call):
    start = time.perf_counter()
    count = call()
    return (time.perf_counter() - start) / count


def regressors():
    for i in range(n):
        pin.computeJointTorqueRegressor(model, work, q[i], va[i, :model.nv], va[i, model.nv:])
    return n


worst = max(np.abs((pin.computeJointTorqueRegressor(model, work, q[i], va[i, :model.nv], va[i, model.nv:])[:6] @ phi)).max() for i in range(n))
print(f"pinocchio {pin.__version__}, numpy {np.__version__}: largest base wrench in flight {worst:.1e} (N, N·m)")
timed("pinocchio joint-torque regressor, one frame (40 × 150)", regressors)
rng = np.random.default_rng(0)
tall = rng.standard_normal((624, 129))
pair = np.vstack([np.linalg.qr(tall, "r"), np.linalg.qr(rng.standard_normal((624, 129)), "r")])
square = np.linalg.qr(tall, "r")[:128, :128]
ours_rows = ours("aloft-body", "regressor", "rows")
ours_rows.update(ours("aloft-body", "regressor", "batch of eight"))
for name, seconds in ours_rows.items():
    frames = 8 if "batch" in name else 1
    print(f"aloft {name}: {1e6 * seconds / frames:.2f} µs a frame")
timed("numpy QR of 624 × 129 (one flight of 104 frames)", lambda: [np.linalg.qr(tall, "r") for _ in range(10)] and 10)
timed("numpy QR of two stacked triangles of 129", lambda: [np.linalg.qr(pair, "r") for _ in range(10)] and 10)
timed("numpy SVD of 128 × 128", lambda: [np.linalg.svd(square) for _ in range(10)] and 10)
