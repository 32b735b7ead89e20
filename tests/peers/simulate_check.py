"""Checks a simulated laboratory with other people's programs: ezc3d reads it, Pinocchio weighs it.

Usage: python tests/peers/simulate_check.py LAB_FOLDER     (scenario written with `trajectories: true`)

For every trial: recursive Newton-Euler by Pinocchio on the true q, v, a gives the wrench on the body; it must be what
truth says that ground and hidden effects did, zero in flight, and what the plates' channels show within their noise.
Markers must lie where truth puts them within noise and soft tissue. Needs numpy, ezc3d, pin.
"""
import json
import pathlib
import sys

import ezc3d
import numpy as np
import pinocchio as pin


def build(truth):
    model = pin.Model()
    model.gravity = pin.Motion(np.array([*truth["true_gravity"], 0, 0, 0]))
    index = {}
    for link in truth["links"]:
        joint = {"free": pin.JointModelFreeFlyer(), "spherical": pin.JointModelSpherical(),
                 "revolute_z": pin.JointModelRZ()}[link["joint"]]
        parent = index[link["parent"]] if link["parent"] else 0
        x, y, z, w = link["rotation_xyzw"]
        pose = pin.SE3(pin.Quaternion(w, x, y, z).normalized().toRotationMatrix(), np.array(link["offset"]))
        index[link["name"]] = model.addJoint(parent, joint, pose, link["name"])
        inertia = pin.Inertia.FromDynamicParameters(np.array(link["phi"]))
        model.appendBodyToJoint(index[link["name"]], inertia, pin.SE3.Identity())
    return model, index


def plate_wrench(c3d, plate):
    group = c3d["parameters"]["FORCE_PLATFORM"]
    corners = np.array(group["CORNERS"]["value"])[:, :, plate].T / 1000
    origin = np.array(group["ORIGIN"]["value"])[:, plate] / 1000
    channels = np.array(group["CHANNEL"]["value"])[:, plate].astype(int) - 1
    x = corners[0] + corners[3] - corners[1] - corners[2]
    y = corners[0] + corners[1] - corners[2] - corners[3]
    axes = np.column_stack([x / np.linalg.norm(x), y / np.linalg.norm(y), np.cross(x, y) / np.linalg.norm(np.cross(x, y))])
    data = c3d["data"]["analogs"][0][channels]
    force, moment = axes @ data[:3], axes @ (data[3:] / 1000)
    sensor = corners.mean(0) - axes @ origin
    return np.vstack([force, moment + np.cross(sensor, force.T).T])


def main():
    folder = pathlib.Path(sys.argv[1])
    truth = json.loads((folder / "truth/truth.json").read_text())
    model, index = build(truth)
    data = model.createData()
    worst = dict(wrench=0.0, flight=0.0)
    for trial in truth["trials"]:
        name = trial["trial"]
        z = np.load(folder / f"truth/truth_{name}.npz")
        c3d = ezc3d.c3d(str(folder / f"{name}.c3d"))
        labels = c3d["parameters"]["POINT"]["LABELS"]["value"]
        points = c3d["data"]["points"][:3] / 1000
        frames = len(z["t_frame"])
        assert points.shape[2] == frames == trial["frames"], (points.shape, frames)
        assert c3d["parameters"]["POINT"]["RATE"]["value"][0] == truth["header_rate_hz"]
        flying = np.zeros(frames, bool)
        for a, b in z["flight_intervals"]:
            flying[a:b + 1] = True
        error, air, distance = [], [0.0], []
        for f in range(0, frames, 3):
            q, v, a = z["q"][f], z["v"][f].astype(float), z["a"][f].astype(float)
            tau = pin.rnea(model, data, q, v, a)
            pin.forwardKinematics(model, data, q)
            root = data.oMi[1]
            force = root.rotation @ tau[:3]
            moment = root.rotation @ tau[3:6] + np.cross(root.translation, force)
            known = z["contact_wrench"][f] + z["effect_wrench"][f]
            error.append(np.abs(np.concatenate([force, moment]) - known).max())
            if flying[f]:
                air.append(np.abs(z["contact_wrench"][f]).max())
            for i, label in enumerate(labels):
                link, place = truth["markers"][label]
                p = data.oMi[index[link]].act(np.array(place))
                distance.append(np.linalg.norm(points[:, i, f] - p))
        distance = np.array(distance)
        seen = np.isfinite(distance)
        line = f"{name:12} wrench {max(error):.1e}  in flight {max(air):.1e}  markers rms {1000 * np.sqrt(np.mean(distance[seen] ** 2)):.2f} max {1000 * distance[seen].max():.2f} mm  missing {100 * (1 - seen.mean()):.2f} %"
        if c3d["parameters"]["FORCE_PLATFORM"]["USED"]["value"][0] == 2:
            total = plate_wrench(c3d, 0) + plate_wrench(c3d, 1)
            step = total.shape[1] // frames
            d = total[:, ::step] - z["contact_wrench"].T
            line += f"  plates off by {np.abs(d[:3].mean(1)).max():.2f} N, noise {d[:3].std(1).max():.2f} N {d[3:].std(1).max():.2f} Nm"
        print(line)
        worst["wrench"] = max(worst["wrench"], max(error))
        worst["flight"] = max(worst["flight"], max(air))
    print(worst)
    # q is stored in full, v and a in single precision: some 1e-4 N is their rounding
    assert worst["wrench"] < 5e-3 and worst["flight"] < 1e-9


if __name__ == "__main__":
    main()
