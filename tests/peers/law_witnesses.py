"""What general equation finders make of the residual wrenches in which `aloft discover` looks for unlisted laws.

    python3 benches/laws.py --body chain --laws 30 --strengths 4 --empty 0 --seed SEED --out OUT
    tests/peers/.venv/bin/python tests/peers/law_witnesses.py OUT [--aloft PROGRAM] [--sets N]

For every answered set of a chain in OUT the laboratory is simulated and processed again, and its wrenches and motion are
exported (`aloft export --format csv`). Two witnesses explain the residual in flight, PySINDy's sparse regression and the genetic
programming of Operon (pyoperon). They are told more than the program: the link on which the law acts, its point, and whether it
is a force or a couple. They see place, velocity and spin of that point in the axes of the world and of the link, the link's
heading, joint angle and rate, the clock and the time since take-off. The last two fifths of the recordings are held out.

Printed for each set, and counted at the end: the error left on the held-out recordings, in multiples of that of the twin (the
same session without the law; frames, not windows), beside the program's (windows) with its outcome. A witness is within 1.3
where its law leaves at most 1.3 times the twin's error. Results go to OUT/witnesses.jsonl; an interrupted run continues.
"""

import argparse
import json
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pysindy
from pyoperon.sklearn import SymbolicRegressor

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benches"))
import laboratory
import laws

WITHIN = 1.3
EDGE = 6                # frames left out at each end of a flight
EVALUATIONS = 300_000   # of the genetic search, for each component
THRESHOLDS = [0.003, 0.01, 0.03, 0.1, 0.3]   # of sparse regression, over the targets' spread


def quaternion_matrix(q):
    x, y, z, w = q.T
    rows = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    return np.moveaxis(np.array(rows), 2, 0)


def about_z(angle):
    c, s, o = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    return np.moveaxis(np.array([[c, -s, o], [s, c, o], [o, o, o + 1]]), 2, 0)


def frames_of(table, link, point, couple):
    """Features and targets of one recording in flight: (features, targets)."""
    vector = lambda what, of, unit: table[[f"{what} {of} {a} [{unit}]" for a in "xyz"]].to_numpy()
    time = table["time [s]"].to_numpy()
    root = table[[f"coordinate_filtered link0_t{a} [m]" for a in "xyz"]].to_numpy()
    r0 = quaternion_matrix(table[[f"orientation link0 {a} [1]" for a in "xyzw"]].to_numpy())
    angle = np.radians(table["coordinate_filtered link1_angle [deg]"].to_numpy())
    hinge = vector("joint_centre", "link1_JC", "m")
    centre = vector("centre_of_mass", "whole_body", "m")
    turn, origin = {"link0": (r0, root), "link1": (r0 @ about_z(angle), hinge)}.get(link, (r0, centre))
    place = origin + np.einsum("fij,j->fi", turn, point) if link != "body" else centre
    rate = lambda x: np.gradient(x, time, axis=0)
    velocity = rate(place)
    skew = np.einsum("fij,fkj->fik", rate(turn), turn)
    spin = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], 1)
    inside = lambda x: np.einsum("fji,fj->fi", turn, x)
    force, moment = vector("residual_force", "link0", "N"), vector("residual_moment", "link0", "N.m")
    target = moment - np.cross(centre - root, force) if couple else force
    flying = table["in_flight"].to_numpy() == 1
    starts = np.flatnonzero(flying & ~np.r_[False, flying[:-1]])
    ends = np.flatnonzero(flying & ~np.r_[flying[1:], False]) + 1
    since = np.zeros_like(time)
    keep = np.zeros_like(flying)
    for a, b in zip(starts, ends):
        since[a:b] = time[a:b] - time[a]
        keep[a + EDGE:b - EDGE] = True
    size = lambda x: np.linalg.norm(x, axis=1)
    features = np.column_stack([place, velocity, inside(velocity), size(velocity), spin, inside(spin), size(spin), turn[:, 2, :], angle, rate(angle), time, since])
    keep &= np.isfinite(features).all(1) & np.isfinite(target).all(1)
    return features[keep], target[keep]


NAMES = ["x", "y", "z", "vx", "vy", "vz", "ux", "uy", "uz", "speed", "wx", "wy", "wz", "px", "py", "pz", "spin", "up_x", "up_y", "up_z", "q", "qd", "t", "since"]


def recordings(aloft, scenarios, seed, entry):
    """Features and targets of every recording with flights, in the order of names."""
    bench = laboratory.Laboratories(argparse.Namespace(aloft=aloft, body="chain", seed=0, out=tempfile.gettempdir()))
    with tempfile.TemporaryDirectory() as folder:
        at = bench.processed(Path(folder), scenarios, seed)
        out = Path(folder) / "export"
        done = laboratory.call(aloft, "export", bench.pipeline, *at, "--to", out, "--format", "csv")
        if done.returncode:
            raise RuntimeError(done.stderr[-500:])
        point = np.array(entry.get("point_m", [0.0, 0.0, 0.0]))
        tables = [pd.read_csv(f) for f in sorted((out / "Tables").glob("throws_*.csv"))]
    found = [frames_of(table, entry["link"], point, "moment" in entry) for table in tables]
    return [f for f in found if len(f[0])]


def rms(x):
    return float(np.sqrt(np.mean(np.sum(x**2, 1))))


def scaled(features):
    spread = features.std(0)
    return features.mean(0), np.where(spread > 0, spread, 1.0)


def sparse(train, test):
    """PySINDy: products of two features, thresholded least squares; the threshold by a part of the training set."""
    (x, y), (x_test, y_test) = train, test
    middle, spread = scaled(x)
    size = y.std() or 1.0
    library = pysindy.PolynomialLibrary(degree=2).fit((x - middle) / spread)
    column = lambda f: np.asarray(library.transform((f - middle) / spread))
    inner = np.arange(len(x)) % 5 == 4
    best = None
    for threshold in THRESHOLDS:
        fit = pysindy.STLSQ(threshold=threshold, alpha=1e-3, max_iter=20)
        fit.fit(column(x)[~inner], y[~inner] / size)
        error = rms(column(x)[inner] @ fit.coef_.T - y[inner] / size)
        if best is None or error < best[0]:
            best = (error, threshold)
    fit = pysindy.STLSQ(threshold=best[1], alpha=1e-3, max_iter=20)
    fit.fit(column(x), y / size)
    return rms(y_test - size * column(x_test) @ fit.coef_.T), int(np.count_nonzero(fit.coef_))


def genetic(train, test):
    """Operon: an expression for each component; the shortest description decides."""
    (x, y), (x_test, y_test) = train, test
    middle, spread = scaled(x)
    size = y.std() or 1.0
    left, length = y_test.copy(), 0
    for k in range(3):
        model = SymbolicRegressor(allowed_symbols="add,sub,mul,div,constant,variable,sin,exp,sqrt,abs,square", max_length=30, max_evaluations=EVALUATIONS,
                                  generations=10_000, population_size=500, optimizer_iterations=3, n_threads=1, random_state=1)
        model.fit((x - middle) / spread, y[:, k] / size)
        said = np.nan_to_num(model.predict((x_test - middle) / spread))
        left[:, k] -= size * said.reshape(-1)
        length += int(model.stats_.get("model_length", 0)) if hasattr(model, "stats_") else 0
    return rms(left), length


def split(found):
    held = max(1, (2 * len(found)) // 5)
    join = lambda part: tuple(np.concatenate([p[i] for p in part]) for i in (0, 1))
    return join(found[:-held]), join(found[-held:])


def one(aloft, line):
    entry, twin_of = line["hidden"][0], laws.laboratory(line["session"], [])
    with_law = recordings(aloft, laws.laboratory(line["session"], line["hidden"]), line["seed"], entry)
    train, test = split(with_law)
    floor = rms(split(recordings(aloft, twin_of, line["seed"], entry))[1][1])
    out = {"set": line["set"], "family": line["family"], "expressible": line["expressible"], "strength": line["strength"],
           "before": rms(test[1]) / floor}
    for name, witness in (("sparse", sparse), ("genetic", genetic)):
        left, terms = witness(train, test)
        out[name] = {"left": left / floor, "terms": terms}
    opened = line["answer"].get("open") or {}
    after = opened.get("times_floor_after")
    out["program"] = {"left": after * line["floor"] / line["twin"] if after else None, "outcome": sorted(laws.judge(line))}
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--aloft", default=str(ROOT / "target/release/aloft"))
    parser.add_argument("--sets", type=int, default=10_000, help="at most this many")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    kept = args.out / "witnesses.jsonl"
    done = {line["set"]: line for line in laboratory.read_lines(kept)}
    wanted = [line for line in laboratory.read_lines(args.out / "sets.jsonl") if line.get("strength") and line["body"] == "chain" and "answer" in line]
    for line in wanted[:args.sets]:
        if line["set"] not in done:
            done[line["set"]] = one(args.aloft, line)
            with open(kept, "a") as file:
                file.write(json.dumps(done[line["set"]]) + "\n")
        told = done[line["set"]]
        program = told["program"]
        print(f"{told['set']:18s} {told['family']:30s} before {told['before']:5.1f}   sparse {told['sparse']['left']:5.2f} ({told['sparse']['terms']} terms)   "
              f"genetic {told['genetic']['left']:5.2f}   program {program['left'] or float('nan'):5.2f}  {', '.join(program['outcome'])}", flush=True)
    lines = list(done.values())
    print("\n| | sets | PySINDy within 1.3 | Operon within 1.3 | the program: formula within 1.3 | the program: link, direction, variable |\n|---|---|---|---|---|---|")
    for name, group in (("expressible", [t for t in lines if t["expressible"]]), ("not expressible", [t for t in lines if not t["expressible"]]), ("all", lines)):
        n = len(group)
        counts = [sum(t["sparse"]["left"] <= WITHIN for t in group), sum(t["genetic"]["left"] <= WITHIN for t in group),
                  sum("formula" in t["program"]["outcome"] for t in group), sum("direction, variable" in t["program"]["outcome"] for t in group)]
        print(f"| {name} | {n} | " + " | ".join(laboratory.interval(k, n) for k in counts) + " |")


if __name__ == "__main__":
    main()
