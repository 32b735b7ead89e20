"""True joint centres of a simulated subject in its static trial, for the tests of aloft-scale.

usage: python scale_truth.py DATA/subject_a OUT.json

Reads truth/truth.json (links, offsets) and truth/truth_static.npz (q), and writes, per link in the names of the model human34,
the world position of its proximal joint centre at the static's middle frame, and its mass, centre of mass (world) and inertia
about it (world axes). Forward kinematics is written out here on numpy alone.
"""
import json
import sys

import numpy as np

NAMES = {
    "pelvis": "pelvis", "torso": "torso", "head": "head",
    "ruarm": "upper_arm_r", "rfarm": "forearm_r", "rhand": "hand_r",
    "luarm": "upper_arm_l", "lfarm": "forearm_l", "lhand": "hand_l",
    "rthigh": "thigh_r", "rshank": "shank_r", "rfoot": "foot_r",
    "lthigh": "thigh_l", "lshank": "shank_l", "lfoot": "foot_l",
}


def rotation(quaternion):
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


def main(folder, out):
    truth = json.load(open(f"{folder}/truth/truth.json"))
    qs = np.load(f"{folder}/truth/truth_static.npz")["q"]
    q = qs[len(qs) // 2]
    poses, result, at = {}, {}, 0
    for link in truth["links"]:
        if link["joint"] == "free":
            r, p = rotation(q[3:7]), q[:3]
            at = 7
        else:
            rp, pp = poses[link["parent"]]
            p = pp + rp @ np.array(link["offset"])
            if link["joint"] == "spherical":
                r = rp @ rotation(q[at:at + 4])
                at += 4
            else:
                c, s = np.cos(q[at]), np.sin(q[at])
                r = rp @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
                at += 1
        poses[link["name"]] = (r, p)
        result[NAMES[link["name"]]] = {
            "joint_m": [float(x) for x in p],
            "mass_kg": link["mass"],
            "com_m": [float(x) for x in p + r @ np.array(link["com"])],
            "inertia_com_kgm2": (r @ np.array(link["I_com"]) @ r.T).tolist(),
        }
    assert at == len(q)
    json.dump(result, open(out, "w"), indent=1)


if __name__ == "__main__":
    main(*sys.argv[1:3])
