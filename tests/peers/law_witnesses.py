"""What general equation finders make of the residual wrenches in which `aloft discover` looks for unlisted laws.

    python3 benches/laws.py --body chain --laws 30 --strengths 4 --empty 0 --seed SEED --out OUT
    tests/peers/.venv/bin/python tests/peers/law_witnesses.py OUT [--aloft PROGRAM] [--sets N]

For every answered set of a chain in OUT the laboratory is simulated and processed again, and its wrenches and motion are
exported (`aloft export --format csv`). Two witnesses explain the residual in flight, PySINDy's sparse regression and the genetic
programming of Operon (pyoperon). They are told more than the program: the link on which the law acts, its point, and whether it
is a force or a couple. They see place, velocity and spin of that point in the axes of the world and of the link, the link's
heading, joint angle and rate, the clock and the time since take-off. Both see means over windows of 0.2 s, because noise hides
the laws in single frames (the sparse regression averages its columns, the genetic search the variables). The last two fifths of
the recordings are held out.

Printed for each set, and counted at the end: the error left on the held-out recordings, in multiples of that of the twin (the
same session without the law), beside the program's with its outcome. A witness is within 1.3
where its law leaves at most 1.3 times the twin's error; sets in which its wrenches do not show the law (less than 1.3 times the
twin's error before) are not counted as found. Results go to OUT/witnesses.jsonl; an interrupted run continues.
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
WINDOW, HOP = 41, 8     # frames
EVALUATIONS = 300_000   # of the genetic search, for each component
THRESHOLDS = [0.01, 0.03, 0.1, 0.3, 1.0]   # of sparse regression, over the targets' spread
RIDGES = [1e-3, 1e-1, 10.0]


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
    size = lambda x: np.linalg.norm(x, axis=1)
    flying = table["in_flight"].to_numpy() == 1
    starts = np.flatnonzero(flying & ~np.r_[False, flying[:-1]])
    ends = np.flatnonzero(flying & ~np.r_[flying[1:], False]) + 1
    since = np.zeros_like(time)
    for a, b in zip(starts, ends):
        since[a:b] = time[a:b] - time[a]
    features = np.column_stack([place, velocity, inside(velocity), size(velocity), spin, inside(spin), size(spin), turn[:, 2, :], angle, rate(angle), time, since])
    whole = np.isfinite(features).all(1) & np.isfinite(target).all(1)
    windows = [np.arange(k, k + WINDOW) for a, b in zip(starts, ends) for k in range(a + EDGE, b - EDGE - WINDOW + 1, HOP)]
    windows = [w for w in windows if whole[w].all()]
    return features[np.array(windows, int).reshape(-1, WINDOW)], target[np.array(windows, int).reshape(-1, WINDOW)]


BUMP = (1 - np.linspace(-1, 1, WINDOW + 2)[1:-1] ** 2) ** 2
BUMP /= BUMP.sum()


def averaged(x):
    """Weighted means over windows: (windows, frames, columns) to (windows, columns)."""
    return np.einsum("f,wfc->wc", BUMP, x)


def recordings(aloft, scenarios, seed, entry):
    """Features and targets of every recording with flights, in the order of names."""
    bench = laboratory.Laboratories(argparse.Namespace(aloft=aloft, body="chain", seed=0, out=tempfile.gettempdir()))
    with tempfile.TemporaryDirectory() as folder:
        _data, at = bench.processed(scenarios, seed)
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
    flat = features.reshape(-1, features.shape[-1])
    spread = flat.std(0)
    return flat.mean(0), np.where(spread > 0, spread, 1.0)


def sparse(train, inner, test):
    """PySINDy: products of two variables, averaged over windows; threshold and ridge by the last recording of the training set."""
    middle, spread = scaled(train[0])
    library = pysindy.PolynomialLibrary(degree=2).fit(((train[0] - middle) / spread)[:, 0])
    frames = lambda f: ((f - middle) / spread).reshape(-1, f.shape[-1])
    column = lambda f: averaged(np.asarray(library.transform(frames(f))).reshape(*f.shape[:2], -1))
    size = averaged(train[1]).std() or 1.0
    known, unknown = [(column(x), averaged(y) / size) for x, y in (train, inner)]
    best = None
    for threshold in THRESHOLDS:
        for ridge in RIDGES:
            fit = pysindy.STLSQ(threshold=threshold, alpha=ridge, max_iter=20)
            fit.fit(*known)
            error = rms(unknown[0] @ fit.coef_.T - unknown[1])
            if best is None or error < best[0]:
                best = (error, threshold, ridge)
    fit = pysindy.STLSQ(threshold=best[1], alpha=best[2], max_iter=20)
    fit.fit(*(np.concatenate(both) for both in zip(known, unknown)))
    return rms(averaged(test[1]) - size * column(test[0]) @ fit.coef_.T), int(np.count_nonzero(fit.coef_))


def genetic(train, inner, test):
    """Operon: an expression for each component, chosen by minimum description length."""
    x, y, x_test, y_test = (averaged(a) for a in (np.concatenate([train[0], inner[0]]), np.concatenate([train[1], inner[1]]), *test))
    middle, spread = scaled(x)
    size = y.std() or 1.0
    left = y_test.copy()
    for k in range(3):
        model = SymbolicRegressor(allowed_symbols="add,sub,mul,div,constant,variable,sin,exp,sqrt,abs,square", max_length=30, max_evaluations=EVALUATIONS,
                                  generations=10_000, population_size=500, optimizer_iterations=3, n_threads=1, random_state=1)
        model.fit((x - middle) / spread, y[:, k] / size)
        left[:, k] -= size * np.nan_to_num(model.predict((x_test - middle) / spread)).reshape(-1)
    return rms(left)


def split(found):
    """Recordings to learn from, the last of them apart, and those held out."""
    held = max(1, (2 * len(found)) // 5)
    join = lambda part: tuple(np.concatenate([p[i] for p in part]) for i in (0, 1))
    return join(found[:-held - 1]), join(found[-held - 1:-held]), join(found[-held:])


def one(aloft, line):
    entry = line["hidden"][0]
    train, inner, test = split(recordings(aloft, laws.laboratory(line["session"], line["hidden"]), line["seed"], entry))
    floor = rms(averaged(split(recordings(aloft, laws.laboratory(line["session"], []), line["seed"], entry))[2][1]))
    left, terms = sparse(train, inner, test)
    opened = line["answer"].get("open") or {}
    after = opened.get("times_floor_after")
    return {"set": line["set"], "family": line["family"], "expressible": line["expressible"], "strength": line["strength"],
            "before": rms(averaged(test[1])) / floor, "sparse": {"left": left / floor, "terms": terms},
            "genetic": {"left": genetic(train, inner, test) / floor},
            "program": {"left": after * line["floor"] / line["twin"] if after else None, "outcome": sorted(laws.judge(line))}}


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
    print("\n| | sets | law visible in its wrenches | PySINDy within 1.3 | Operon within 1.3 | the program: formula within 1.3 | the program: link, direction, variable |\n|---|---|---|---|---|---|---|")
    for name, group in (("expressible", [t for t in lines if t["expressible"]]), ("not expressible", [t for t in lines if not t["expressible"]]), ("all", lines)):
        n = len(group)
        within = lambda t, who: t["before"] > WITHIN and t[who]["left"] <= WITHIN
        counts = [sum(t["before"] > WITHIN for t in group), sum(within(t, "sparse") for t in group), sum(within(t, "genetic") for t in group),
                  sum("formula" in t["program"]["outcome"] for t in group), sum("direction, variable" in t["program"]["outcome"] for t in group)]
        print(f"| {name} | {n} | " + " | ".join(laboratory.interval(k, n) for k in counts) + " |")


if __name__ == "__main__":
    main()
