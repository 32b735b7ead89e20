"""Identified base parameters of simulated robots against their truth.

    python tests/peers/robot_truth.py PARAMETERS.json ROBOT_FOLDER

PARAMETERS.json is the output of `aloft parameters pipelines/robot.yaml --json`; ROBOT_FOLDER holds `truth/truth.json` and
`truth/base_map.npz`. Prints errors relative to max(|true|, 10 % of the median of the parameter's type), for the identified
links, for the nominal model, and how often 95 % intervals of base parameters hold the truth.
"""

import json
import pathlib
import sys

import numpy as np


def phi(mass, com, inertia_com):
    c = np.asarray(com)
    i = np.asarray(inertia_com).reshape(3, 3) + mass * (c @ c * np.eye(3) - np.outer(c, c))
    # the order of the truth: m, mc, Ixx, Ixy, Iyy, Ixz, Iyz, Izz
    return [mass, *(mass * c), i[0, 0], i[0, 1], i[1, 1], i[0, 2], i[1, 2], i[2, 2]]


def kind(name):
    last = name.split()[0].split(".")[-1]
    return "m" if last == "m" else "mc" if last.startswith("m") else "I"


def report(label, names, value, true):
    kinds = [kind(n) for n in names]
    size = {k: np.median([abs(t) for t, j in zip(true, kinds) if j == k]) for k in set(kinds)}
    scale = np.array([max(abs(t), 0.1 * size[k]) for t, k in zip(true, kinds)])
    use = np.array([k != "m" for k in kinds])
    error = (np.abs(value - true) / scale)[use]
    worst = np.array([n.split()[0] for n in names])[use][error.argmax()]
    out = [f"{label}: median {100 * np.median(error):.2f} %, worst {error.max():.2f} x ({worst})"]
    for k in ("mc", "I"):
        at = np.array([j == k for j in kinds])
        out.append(f"{k} by norm {100 * np.linalg.norm((value - true)[at]) / np.linalg.norm(true[at]):.3f} %")
    print("; ".join(out))


def main():
    found = json.loads(pathlib.Path(sys.argv[1]).read_text())
    folder = pathlib.Path(sys.argv[2]) / "truth"
    truth = json.loads((folder / "truth.json").read_text())["base_parameters"]
    base = np.load(folder / "base_map.npz")
    b = base[base.files[0]]
    for key in base.files:
        if base[key].shape == (len(truth["names"]), len(truth["columns"])):
            b = base[key]
    links = {l["name"]: l for l in found["links"]}
    order = [c.split(".")[0] for c in truth["columns"][::10]]
    ours = np.concatenate([phi(links[n]["mass_kg"], links[n]["com_m"], links[n]["inertia_kgm2"]) for n in order])
    prior = np.concatenate(
        [phi(*[links[n]["prior"][k] for k in ("mass_kg", "com_m", "inertia_com_kgm2")]) for n in order]
    )
    true = np.asarray(truth["values"])
    assert np.allclose(b @ np.asarray(truth["phi"]).ravel(), true, atol=1e-9), "the map does not fit the truth"
    report("prior", truth["names"], b @ prior, true)
    report("identified", truth["names"], b @ ours, true)
    # intervals: our own base parameters of the true links, by the ratio of what our estimate says
    z = []
    for name in order:
        l = links[name]
        t = np.asarray(truth["phi"]).ravel()[10 * order.index(name) : 10 * order.index(name) + 10]
        lo, hi = l["ci95"]["mass_kg"]
        z.append(lo <= t[0] <= hi)
        for axis in range(3):
            lo, hi = l["ci95"]["com_m"][axis]
            z.append(lo <= t[1 + axis] / t[0] <= hi)
    print(f"95 % intervals of links' masses and centres of mass hold the truth in {100 * np.mean(z):.1f} % of {len(z)}")


if __name__ == "__main__":
    main()
