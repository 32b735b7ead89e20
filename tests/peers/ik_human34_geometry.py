"""Writes crates/ik/tests/data/human34.json: link offsets and marker places of the simulated subject `subject_a`,
turned from laboratory axes (x forward, y left, z up) to link axes (x forward, y up, z right).

usage: python ik_human34_geometry.py <data>/subject_a/truth/truth.json crates/ik/tests/data/human34.json
"""

import json
import sys

NAMES = {
    "ruarm": "upper_arm_r", "rfarm": "forearm_r", "rhand": "hand_r",
    "luarm": "upper_arm_l", "lfarm": "forearm_l", "lhand": "hand_l",
    "rthigh": "thigh_r", "rshank": "shank_r", "rfoot": "foot_r",
    "lthigh": "thigh_l", "lshank": "shank_l", "lfoot": "foot_l",
}
STATIC_ONLY = {"LKNM", "RKNM", "LANM", "RANM", "LELM", "RELM"}


def turned(v):
    return [round(x, 6) + 0.0 for x in (v[0], v[2], -v[1])]


def main(source, target):
    truth = json.load(open(source))
    name = lambda n: NAMES.get(n, n)
    links = [
        {
            "name": name(link["name"]),
            "parent": link["parent"] and name(link["parent"]),
            "joint": "revolute_z" if link["joint"].startswith("revolute") else link["joint"],
            "position_m": turned(link["offset"]),
        }
        for link in truth["links"]
    ]
    markers = [
        {"label": label, "link": name(link), "position_m": turned(at)}
        for label, (link, at) in truth["markers"].items()
        if label not in STATIC_ONLY
    ]
    with open(target, "w") as out:
        json.dump({"links": links, "markers": markers}, out, indent=1)
        out.write("\n")


main(*sys.argv[1:])
