"""Golden values of kinematics, dynamics and base rows from Pinocchio (4.1), for crates/body.

    python tests/peers/body_pinocchio.py

writes fixtures/goldens/body_pinocchio.json: three trees (all joint types at random, two links, a person), each with its
links, inertial parameters in Aloft's order, and frames of q, v, a with what Pinocchio makes of them.
"""

import json
import pathlib

import numpy as np
import pinocchio as pin

RNG = np.random.default_rng(20260701)
ROOT = pathlib.Path(__file__).resolve().parents[2]
GRAVITY = np.array([0.3, -0.2, -9.80665])
# Pinocchio's dynamic parameters: m, mc, Ixx Ixy Iyy Ixz Iyz Izz; ours: m, mc, Ixx Iyy Izz Iyz Izx
# Ixy.
OURS_FROM_PIN = [0, 1, 2, 3, 4, 6, 9, 8, 7, 5]


def unit(v):
    return v / np.linalg.norm(v)


def random_inertia():
    mass = RNG.uniform(0.3, 8.0)
    com = RNG.normal(0, 0.1, 3)
    # Second moment of a positive density: always a possible body.
    root = RNG.normal(0, 0.15, (3, 3))
    sigma = mass * (root @ root.T + 0.001 * np.eye(3))
    return pin.Inertia(mass, com, np.trace(sigma) * np.eye(3) - sigma)


def random_link(name, parent, joint, axis=None, place=True):
    link = {"name": name, "parent": parent, "joint": joint}
    link["axis"] = None if axis is None else list(unit(np.asarray(axis, float)))
    link["position_m"] = list(RNG.normal(0, 0.3, 3)) if place else [0.0] * 3
    link["rpy_rad"] = list(RNG.uniform(-1.4, 1.4, 3)) if place else [0.0] * 3
    return link


def build(links):
    model = pin.Model()
    model.gravity.linear = GRAVITY
    where = {}  # link name -> (joint id, placement of the link in that joint's frame)
    frames, phi = [], []
    for link in links:
        inertia = random_inertia()
        phi.append([float(inertia.toDynamicParameters()[k]) for k in OURS_FROM_PIN])
        placement = pin.SE3(pin.rpy.rpyToMatrix(*link["rpy_rad"]), np.array(link["position_m"]))
        parent, in_parent = where[link["parent"]] if link["parent"] else (0, pin.SE3.Identity())
        placement = in_parent * placement
        kind = link["joint"]
        if kind == "fixed":
            joint, own = parent, placement
        else:
            axis = None if link["axis"] is None else np.array(link["axis"])
            made = {
                "free": lambda: pin.JointModelFreeFlyer(),
                "spherical": lambda: pin.JointModelSpherical(),
                "revolute": lambda: pin.JointModelRevoluteUnaligned(axis),
                "prismatic": lambda: pin.JointModelPrismaticUnaligned(axis),
            }[kind]()
            joint, own = model.addJoint(parent, made, placement, link["name"]), pin.SE3.Identity()
        model.appendBodyToJoint(joint, inertia, own)
        where[link["name"]] = (joint, own)
        point = RNG.normal(0, 0.2, 3)
        link["point_m"] = list(point)
        frames.append(model.addFrame(pin.Frame(link["name"], joint, 0, own * pin.SE3(np.eye(3), point), pin.FrameType.OP_FRAME)))
    return model, where, frames, phi


def numbers(array):
    return [float(x) for x in np.asarray(array).flatten(order="F")]


def frame(model, links, where, frames, matrices):
    data = model.createData()
    q = pin.integrate(model, pin.neutral(model), RNG.normal(0, 1.5, model.nv))
    v, a = RNG.normal(0, 3, model.nv), RNG.normal(0, 20, model.nv)
    out = {"q": numbers(q), "v": numbers(v), "a": numbers(a)}
    out["tau"] = numbers(pin.rnea(model, data, q, v, a))
    pin.forwardKinematics(model, data, q, v, a)
    pin.updateFramePlacements(model, data)
    aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    out["links"] = []
    for link, f in zip(links, frames):
        joint, own = where[link["name"]]
        pose = data.oMi[joint] * own
        velocity, acceleration = own.actInv(data.v[joint]), own.actInv(data.a[joint])
        out["links"].append(
            {
                "rotation": numbers(pose.rotation),
                "origin": numbers(pose.translation),
                "velocity": numbers(velocity.vector),
                "acceleration": numbers(acceleration.vector),
                "point": numbers(data.oMf[f].translation),
                "point_velocity": numbers(pin.getFrameVelocity(model, data, f, aligned).linear),
                "point_acceleration": numbers(pin.getFrameClassicalAcceleration(model, data, f, aligned).linear),
            }
        )
    pin.computeCentroidalMomentum(model, data, q, v)
    p, l = np.array(data.hg.linear), np.array(data.hg.angular)
    com = pin.centerOfMass(model, data, q, v)
    out["mass"] = float(pin.computeTotalMass(model))
    out["com"] = numbers(com)
    out["momentum_about_world_origin"] = numbers(np.concatenate([p, l + np.cross(com, p)]))
    step = RNG.normal(0, 1.0, model.nv)
    out["step"] = numbers(step)
    out["integrated"] = numbers(pin.integrate(model, q, step))
    other = pin.integrate(model, pin.neutral(model), RNG.normal(0, 1.5, model.nv))
    out["other"] = numbers(other)
    out["difference"] = numbers(pin.difference(model, q, other))
    if matrices:
        mass = pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        out["mass_matrix_upper"] = numbers(mass[np.triu_indices(model.nv)])
        regressor = pin.computeJointTorqueRegressor(model, data, q, v, a)[:6]
        # Links on fixed joints have no columns of their own in Pinocchio.
        out["base_rows"] = {
            link["name"]: numbers(regressor[:, 10 * (where[link["name"]][0] - 1) + np.array(OURS_FROM_PIN)])
            for link in links
            if link["joint"] != "fixed"
        }
        last = frames[-1]
        out["last_point_jacobian"] = numbers(pin.computeFrameJacobian(model, data, q, last, aligned)[:3])
    return out


def case(name, links, n_frames):
    model, where, frames, phi = build(links)
    return {
        "name": name,
        "gravity": list(GRAVITY),
        "links": links,
        "phi": phi,
        "frames": [frame(model, links, where, frames, k == 0) for k in range(n_frames)],
    }


def tree():
    # Branches one after the other: Pinocchio's composite-rigid-body algorithm needs each subtree in
    # one piece.
    return [
        random_link("root", None, "free", place=False),
        random_link("ball", "root", "spherical"),
        random_link("slider", "ball", "prismatic", RNG.normal(size=3)),
        random_link("hinge", "slider", "revolute", RNG.normal(size=3)),
        random_link("bolt", "hinge", "fixed"),
        random_link("ball2", "bolt", "spherical"),
        random_link("slider_z", "ball", "prismatic", [0, 0, 1]),
        random_link("hinge_z", "slider_z", "revolute", [0, 0, 1]),
        random_link("hinge_x", "root", "revolute", [1, 0, 0]),
        random_link("hinge_y", "hinge_x", "revolute", [0, 1, 0]),
    ]


def two_link():
    return [random_link("link0", None, "free", place=False), random_link("link1", "link0", "revolute", [0, 0, 1])]


def human():
    def link(name, parent, joint, position):
        axis = [0, 0, 1] if joint == "revolute" else None
        made = random_link(name, parent, joint, axis, place=False)
        made["position_m"] = position
        return made

    links = [link("pelvis", None, "free", [0.0] * 3)]
    links += [link("torso", "pelvis", "spherical", [-0.02, 0.11, 0.0]), link("head", "torso", "spherical", [0.01, 0.4, 0.0])]
    for side, sign in (("r", 1.0), ("l", -1.0)):
        links += [
            link(f"upper_arm_{side}", "torso", "spherical", [0.0, 0.33, sign * 0.16]),
            link(f"forearm_{side}", f"upper_arm_{side}", "revolute", [0.0, -0.26, sign * 0.01]),
            link(f"hand_{side}", f"forearm_{side}", "spherical", [0.0, -0.25, 0.0]),
        ]
    for side, sign in (("r", 1.0), ("l", -1.0)):
        links += [
            link(f"thigh_{side}", "pelvis", "spherical", [0.0, 0.0, sign * 0.085]),
            link(f"shank_{side}", f"thigh_{side}", "revolute", [0.0, -0.4, 0.0]),
            link(f"foot_{side}", f"shank_{side}", "spherical", [0.0, -0.39, sign * 0.005]),
        ]
    return links


def main():
    cases = [case("tree", tree(), 4), case("two_link", two_link(), 4), case("human", human(), 2)]
    out = {"made_by": "tests/peers/body_pinocchio.py", "pinocchio": pin.__version__, "cases": cases}
    path = ROOT / "fixtures" / "goldens" / "body_pinocchio.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(out, separators=(",", ":")) + "\n")
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
