#!/usr/bin/env python3
"""Whether faults of a laboratory that look like missing physics are named before any effect is.

Chains by `mujoco_chain.py`, with nothing hidden: a marker that was put back 3 to 8 mm elsewhere from a recording on (the right
answer names it), and a hinge that gives way across its axis (the right answer names the joint). Counted are: the fault is named
on the first screen of `aloft run`; the gate is not passed; `aloft discover` says that nothing is missing; it names an effect.

  python3 benches/faults.py --sets 10 --seed 1 --out OUT      (numpy, mujoco, ezc3d from PyPI)
"""

import json
import math
import random
import sys
import tempfile
from pathlib import Path

from laboratory import ROOT, arguments, call, interval, read_lines

LABELS = ["L0_2", "L0_3", "L0_4", "L0_5", "L1_1", "L1_2", "L1_3", "L1_4"]


def drawn(kind, rng):
    """A fault, and the words that name it."""
    if kind == "moved":
        marker, size = rng.choice(LABELS), rng.uniform(0.003, 0.008)
        way = [rng.gauss(0, 1) for _ in range(3)]
        length = math.sqrt(sum(x * x for x in way))
        return {"moved": {"marker": marker, "by_m": [size * x / length for x in way], "from": rng.choice([2, 3, 4])}}, f"marker {marker} "
    return {"loose": {"stiffness_nmprad": math.exp(rng.uniform(math.log(0.3), math.log(1.5)))}}, "joint of link1"


def measured(aloft, kind, seed):
    rng = random.Random(seed)
    fault, words = drawn(kind, rng)
    body = {"kind": "chain", "throws": {"recordings": 5, "throws": 4}}
    pipeline = ROOT / "pipelines/chain.yaml"
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        scenario = {"name": "set", "seed": seed, "body": body, "hidden": [], "faults": fault, "capture": {"marker_noise_m": 0.0003, "gap_fraction": 0.008}}
        file, data = place / "scenario.yaml", place / "data"
        file.write_text(json.dumps(scenario))
        made = call(sys.executable, ROOT / "benches/mujoco_chain.py", file, "--out", data)
        if made.returncode:
            raise RuntimeError(made.stderr[-500:])
        at = ["--data", data, "--workspace", place / "ws"]
        ran = call(aloft, "run", pipeline, *at)
        first = " ".join(ran.stdout.split())
        found = json.loads(call(aloft, "discover", pipeline, *at, "--json").stdout)
    gate = "gate passed" not in first
    return {"kind": kind, "seed": seed, "fault": fault, "named": words in first, "gate_failed": gate, "verdict": found["verdict"], "effects": found["effects"]}


def score(folders):
    lines = [line for folder in folders for line in read_lines(Path(folder) / "sets.jsonl")]
    print("| fault | n | named | gate not passed | nothing missing | an effect named |\n|---|---|---|---|---|---|")
    for kind in ("moved", "loose"):
        own = [line for line in lines if line["kind"] == kind]
        share = lambda of: interval(sum(map(of, own)), len(own))
        print(f"| {kind} | {len(own)} | {share(lambda l: l['named'])} | {share(lambda l: l['gate_failed'])} | "
              f"{share(lambda l: l['verdict'] == 'nothing_missing')} | {share(lambda l: bool(l['effects']))} |")


def main():
    parser = arguments(__doc__)
    parser.add_argument("--sets", type=int, default=10)
    args = parser.parse_args()
    if args.score:
        return score(args.score)
    if not args.out:
        parser.error("--out is needed")
    out = Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    for kind in ("moved", "loose"):
        for index in range(args.sets):
            line = measured(args.aloft, kind, 7_000_000 + 1000 * args.seed + index)
            print({k: v for k, v in line.items() if k != "fault"}, flush=True)
            with open(out / "sets.jsonl", "a") as file:
                file.write(json.dumps(line) + "\n")
    score([out])


if __name__ == "__main__":
    main()
