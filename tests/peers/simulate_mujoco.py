"""Goldens for crates/simulate: flights of a two-link chain by MuJoCo.

Writes crates/simulate/tests/goldens/mujoco_chain.json with
  free     flights of the chain without dry friction, integrated here by MuJoCo (RK4, 0.05 ms): viscous hinge or none;
  chain_a  flights of the recorded set `chain_a` (its own truth, dry friction in the hinge), where the data folder is given.

Usage: python tests/peers/simulate_mujoco.py [path/to/shared/data]
Needs mujoco and numpy.
"""
import json
import pathlib
import sys

import mujoco
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
OUT = ROOT / "crates/simulate/tests/goldens/mujoco_chain.json"

# a chain of its own, not one of the data sets: mass, centre of mass, inertia about it (link axes)
LINKS = [
    dict(mass=0.61, com=[-0.005, 0.12, 0.002],
         inertia=[[0.0040, 0.0002, -0.0001], [0.0002, 0.0012, 0.00015], [-0.0001, 0.00015, 0.0038]]),
    dict(mass=0.39, com=[-0.09, -0.007, 0.008],
         inertia=[[0.0006, -0.0001, 0.0002], [-0.0001, 0.0025, 0.00008], [0.0002, 0.00008, 0.0029]]),
]
HINGE_AT = [0.001, -0.03, 0.012]
AXIS = [0.0, 0.0, 1.0]
# rotation of link 1 in link 0 at zero: z of link 1 near x of link 0
R10 = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def quat(r):
    q = np.zeros(4)
    mujoco.mju_mat2Quat(q, np.asarray(r, float).ravel())
    return q


def words(values):
    return " ".join(repr(float(v)) for v in np.ravel(values))


def full(i):
    return words([i[0][0], i[1][1], i[2][2], i[0][1], i[0][2], i[1][2]])


def model(damping, step):
    a, b = LINKS
    xml = f"""
<mujoco><option timestep="{step}" integrator="RK4" gravity="0 0 -9.81"/>
<compiler balanceinertia="false" boundmass="0" boundinertia="0"/>
<worldbody><body name="link0"><freejoint/>
<inertial pos="{words(a['com'])}" mass="{a['mass']}" fullinertia="{full(a['inertia'])}"/>
<body name="link1" pos="{words(HINGE_AT)}" quat="{words(quat(R10))}">
<joint type="hinge" axis="{words(AXIS)}" damping="{damping}"/>
<inertial pos="{words(b['com'])}" mass="{b['mass']}" fullinertia="{full(b['inertia'])}"/>
</body></body></worldbody></mujoco>"""
    return mujoco.MjModel.from_xml_string(xml)


def ours(qpos, qvel):
    """MuJoCo (w x y z, linear velocity in the world) to aloft-body (x y z w, linear velocity in the link)."""
    w, x, y, z = qpos[3:7]
    r = np.zeros(9)
    mujoco.mju_quat2Mat(r, np.asarray(qpos[3:7], float))
    linear = r.reshape(3, 3).T @ qvel[:3]
    q = [*qpos[:3], x, y, z, w, *qpos[7:]]
    return [float(v) for v in q], [float(v) for v in (*linear, *qvel[3:])]


def free_flights():
    rng = np.random.default_rng(7)
    flights = []
    for damping in (0.0, 0.0, 2e-3):
        m = model(damping, 5e-5)
        d = mujoco.MjData(m)
        turn = rng.normal(size=4)
        d.qpos[:] = [0, 0, 1.2, *(turn / np.linalg.norm(turn)), rng.uniform(-2, 2)]
        d.qvel[:] = [*rng.normal(size=3), *rng.normal(size=3) * 4.0, rng.uniform(-8, 8)]
        d.qvel[2] = 3.4
        q, v = ours(d.qpos, d.qvel)
        flight = dict(hinge_damping=damping, q0=q, v0=v, samples=[])
        for k in range(1, 14001):
            mujoco.mj_step(m, d)
            if k % 2000 == 0:
                q, v = ours(d.qpos, d.qvel)
                flight["samples"].append(dict(t_s=k * 5e-5, q=q, v=v))
        flights.append(flight)
    return flights


def recorded_flights(folder):
    truth = json.loads((folder / "chain_a/truth/truth.json").read_text())
    order = [0, 1, 2, 3, 4, 6, 9, 8, 7, 5]  # m mc Ixx Ixy Iyy Ixz Iyz Izz -> m mc Ixx Iyy Izz Iyz Izx Ixy
    hinge = truth["hinge"]
    out = dict(
        phi=[[truth[link]["phi"][i] for i in order] for link in ("link0", "link1")],
        hinge_at_m=hinge["p_link0"], rotation=hinge["R_link0_link1_q0"],
        hinge_damping=hinge["damping"], hinge_friction=hinge["frictionloss"], flights=[])
    for name in ("throws_01", "throws_04"):
        data = np.load(folder / f"chain_a/truth/{name}.npz")
        for first, last in data["flight_intervals"][:3]:
            q, v = ours(data["qpos"][first], data["qvel"][first])
            flight = dict(recording=name, q0=q, v0=v, samples=[])
            for frame in range(first + 10, last + 1, 10):
                q, v = ours(data["qpos"][frame], data["qvel"][frame])
                flight["samples"].append(dict(t_s=(frame - first) / 200.0, q=q, v=v))
            out["flights"].append(flight)
    return out


def main():
    golden = dict(
        made_by="tests/peers/simulate_mujoco.py", mujoco=mujoco.__version__,
        links=LINKS, hinge_at_m=HINGE_AT, rotation=R10.tolist(), free=free_flights())
    if len(sys.argv) > 1:
        golden["chain_a"] = recorded_flights(pathlib.Path(sys.argv[1]))
    elif OUT.exists():
        old = json.loads(OUT.read_text())
        if "chain_a" in old:
            golden["chain_a"] = old["chain_a"]
    OUT.parent.mkdir(parents=True, exist_ok=True)
    OUT.write_text(json.dumps(golden) + "\n")


if __name__ == "__main__":
    main()
