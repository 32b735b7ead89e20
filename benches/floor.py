#!/usr/bin/env python3
"""The noise floor against the error of a perfect model, on simulated laboratories with nothing hidden.

`aloft simulate` writes recordings with their truth, `aloft run` computes the floor, and the example `true_error` computes
the error with the true link parameters, geometry and marker places over the same windows. Bodies, instruments and skin are
drawn from the seed. With `--skins K` each body repeats the same motion K times with other skin, noise and gaps: the scatter
of the true error about its mean is what no estimate of the expected error can follow.

Printed for every body: floor, interval, true error, held-out error; then the geometric mean and the spread (one standard
deviation of the logarithm) of floor / true, and how often the true error lies in the interval. With several skins also the
scatter of the true error, and floor / mean true error of each body. Results are lines of JSON in OUT (`floors.jsonl`); with
`--keep` the recordings stay there, and another build computes only what is stale. Usage:

  cargo build --release && cargo build --release -p aloft-pipeline -p aloft-cli --example true_error
  python3 benches/floor.py --body human --count 40 --seed 1 --jobs 2 --out OUT
  python3 benches/floor.py --body human --count 6 --skins 8 --seed 1 --out OUT
  python3 benches/floor.py --score OUT
"""

import json
import math
import random
import shutil
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from laboratory import ROOT, Laboratories, arguments, call, interval, parsed, prepare


def body_of(kind, rng):
    """Body and instruments."""
    if kind == "chain":
        throws = {"recordings": 5, "throws": rng.choice([4, 6, 7])}
        noise = round(math.exp(rng.uniform(math.log(0.0002), math.log(0.001))), 6)
        capture = {"point_rate_hz": rng.choice([100, 200, 250]), "marker_noise_m": noise, "gap_fraction": rng.choice([0.0, 0.002, 0.01])}
        return {"kind": "chain", "throws": throws, "object": {"variation": round(rng.uniform(0.5, 1.5), 2)}}, capture
    person = {"sex": rng.choice("MF"), "height_m": round(rng.uniform(1.5, 1.95), 3), "mass_kg": round(rng.uniform(48, 95), 1),
              "variation": round(rng.uniform(0.5, 1.5), 2)}
    capture = {"point_rate_hz": rng.choice([100, 120, 200, 240, 250]), "marker_noise_m": round(rng.uniform(0.0002, 0.0006), 6),
               "soft_tissue_m": round(rng.uniform(0.001, 0.006), 5), "gap_fraction": rng.choice([0.0, 0.002, 0.01])}
    return {"kind": "human", "person": person, "protocol": {"jumps": rng.choice([6, 8, 10]), "exercises": 2}}, capture


class Floors(Laboratories):
    """Floors and true errors, body by body."""

    def __init__(self, args):
        super().__init__(args)
        self.example, self.stays = args.example, args.keep

    def one(self, index, skin, done):
        name = f"{self.kind}-{self.seed}-{index}-{skin}"
        if name in done:
            return
        body, capture = body_of(self.kind, random.Random(f"floor {self.kind} {self.seed} {index}"))
        capture["seed"] = 7_000_000 + 10_000 * self.seed + 100 * index + skin
        place = self.out / name
        line = {"set": name, "index": index, "skin": skin, "program": self.digest, "capture": capture}
        try:
            place.mkdir(exist_ok=True)
            data, workspace, known = place / "data0", place / "ws", place / "true.json"
            if not data.exists():
                prepare(self.aloft, place, [(body, [], capture)], 6_000_000 + 10_000 * self.seed + index)
            at = ["--data", data, "--workspace", workspace]
            made = call(self.aloft, "run", self.pipeline, *at)
            if made.returncode:
                raise RuntimeError(made.stderr[-300:])
            if not known.exists():
                of_truth = call(self.example, self.pipeline, data, workspace)
                if of_truth.returncode:
                    raise RuntimeError(of_truth.stderr[-300:])
                known.write_text(of_truth.stdout)
            true = json.loads(known.read_text())
            for entry in json.loads(call(self.aloft, "compare", self.pipeline, *at, "--json").stdout)["against_floor"]:
                judged, floor = entry["judged_on"], entry["floor"]
                if true[judged]["windows"] != floor["windows"]:
                    line["problem"] = f"{judged}: {floor['windows']} windows, {true[judged]['windows']} in the true geometry"
                line[judged] = {"held_out": entry["held_out_error"], "floor": floor["noise_floor"], "ci95": floor["ci95"],
                                "at_floor": entry["at_floor"], "true": true[judged]["true"]}
        except (RuntimeError, ValueError, KeyError) as problem:
            line["problem"] = str(problem)
        if not self.stays:
            shutil.rmtree(place, ignore_errors=True)
        self.keep("floors.jsonl", line)


def mean_and_spread(logs):
    mean = sum(logs) / len(logs)
    return mean, math.sqrt(sum((x - mean) ** 2 for x in logs) / (len(logs) - 1)) if len(logs) > 1 else float("nan")


def score(folders):
    """Tables of the last answer to every set."""
    lines = {}
    for folder in folders:
        for text in (Path(folder) / "floors.jsonl").read_text().splitlines():
            line = json.loads(text)
            lines[line["set"]] = line
    for line in lines.values():
        if "problem" in line:
            print(f"{line['set']}: {line['problem']}")
    for judged in ["flight", "contact"]:
        rows = sorted((l for l in lines.values() if judged in l and l[judged]["floor"]), key=lambda l: (l["index"], l["skin"]))
        if not rows:
            continue
        print(f"\n## {judged}\n\n| set | skin (mm) | noise (mm) | Hz | held out | floor (95 %) | true | floor / true | held out / floor |\n" + "|---" * 9 + "|")
        for l in rows:
            f, c = l[judged], l["capture"]
            print(f"| {l['set']} | {1000 * c.get('soft_tissue_m', 0):.1f} | {1000 * c['marker_noise_m']:.2f} | {c['point_rate_hz']} | {f['held_out']:.4g} | "
                  f"{f['floor']:.4g} ({f['ci95'][0]:.4g} to {f['ci95'][1]:.4g}) | {f['true']:.4g} | {f['floor'] / f['true']:.2f} | {f['held_out'] / f['floor']:.2f} |")
        summary(rows, judged)


def summary(rows, judged):
    ratios = [math.log(l[judged]["floor"] / l[judged]["true"]) for l in rows]
    mean, spread = mean_and_spread(ratios)
    held = mean_and_spread([math.log(l[judged]["held_out"] / l[judged]["floor"]) for l in rows])
    within = [l[judged]["ci95"][0] <= l[judged]["true"] <= l[judged]["ci95"][1] for l in rows]
    above = sum(l[judged]["true"] > l[judged]["ci95"][1] for l in rows)
    width = sum(math.log(l[judged]["ci95"][1] / l[judged]["floor"]) for l in rows) / len(rows)
    print(f"\n{judged}: {len(rows)} sets; floor / true {math.exp(mean):.3f}, spread {spread:.3f}; inside the interval {interval(sum(within), len(rows))}, "
          f"above it {above}; upper end over floor {math.exp(width):.2f}; held out / floor {math.exp(held[0]):.3f}, spread {held[1]:.3f}")
    bodies = {}
    for l in rows:
        bodies.setdefault(l["index"], []).append(l[judged])
    many = {index: of for index, of in bodies.items() if len(of) > 2}
    if not many:
        return
    print("\n| body | skins | scatter of the true error | scatter of the floor | floor / mean true error |\n" + "|---" * 5 + "|")
    true_spread, floor_spread, middle = [], [], []
    for index, of in sorted(many.items()):
        (true, s), (floor, t) = (mean_and_spread([math.log(f[key]) for f in of]) for key in ["true", "floor"])
        true_spread, floor_spread, middle = true_spread + [s], floor_spread + [t], middle + [floor - true]
        print(f"| {index} | {len(of)} | {s:.3f} | {t:.3f} | {math.exp(floor - true):.3f} ± {math.exp(floor - true) * math.hypot(s, t) / math.sqrt(len(of)):.3f} |")
    rms = lambda x: math.sqrt(sum(a * a for a in x) / len(x))
    mean, spread = mean_and_spread(middle)
    print(f"\n{judged}, {len(many)} bodies: scatter of the true error {rms(true_spread):.3f}, of the floor {rms(floor_spread):.3f}; "
          f"floor / mean true error {math.exp(mean):.3f}, spread over bodies {spread:.3f}")


def main():
    parser = arguments(__doc__, body="human")
    parser.add_argument("--example", default=str(ROOT / "target/release/examples/true_error"))
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--skins", type=int, default=1)
    parser.add_argument("--keep", action="store_true", help="keep recordings and results")
    args = parsed(parser, score)
    bench = Floors(args)
    done = {l["set"] for l in bench.lines("floors.jsonl") if "problem" not in l and l["program"] == bench.digest}
    with ThreadPoolExecutor(args.jobs) as pool:
        for piece in [pool.submit(bench.one, i, k, done) for i in range(args.count) for k in range(args.skins)]:
            piece.result()
    score([args.out])
    return None


if __name__ == "__main__":
    sys.exit(main())
