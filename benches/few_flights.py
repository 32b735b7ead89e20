#!/usr/bin/env python3
"""What a correct model leaves where a few flights determine the body: the error against what the program expects.

Sets with nothing hidden: chains of two or three recordings with one to three throws each, people with two to five jumps.
For each set the held-out error, the upper end of the floor's interval and `error_by_parameters` of `discover --closed`, all in
multiples of the floor, and the verdict. `error_by_parameters` should be exceeded by one set in forty. Usage:

  python3 benches/few_flights.py --body chain --sets 80 --seed 1 --out OUT
"""

import argparse
import json
import random

from laboratory import Laboratories, call, interval


def laboratory(kind, rng):
    """Body and instruments."""
    noise = rng.choice([0.0003, 0.001])
    if kind == "chain":
        recordings, throws = rng.choice([(2, 1), (2, 2), (3, 1), (2, 3), (3, 2)])
        return {"kind": "chain", "throws": {"recordings": recordings, "throws": throws}}, {"marker_noise_m": noise}
    person = {"sex": rng.choice("MF"), "height_m": round(rng.uniform(1.55, 1.9), 3), "mass_kg": round(rng.uniform(52, 90), 1)}
    protocol = {"jumps": rng.choice([2, 3, 4, 5]), "exercises": 2}
    return {"kind": "human", "person": person, "protocol": protocol}, {"marker_noise_m": noise, "soft_tissue_m": 0.003}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--aloft", default="target/release/aloft")
    parser.add_argument("--body", choices=["chain", "human"], default="chain")
    parser.add_argument("--sets", type=int, default=80)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--out", required=True)
    args = parser.parse_args()
    labs = Laboratories(args)
    known = {line["seed"]: line for line in labs.lines("few.jsonl")}
    for seed in range(args.seed, args.seed + args.sets):
        if seed in known:
            continue
        body, capture = laboratory(args.body, random.Random(seed))
        _folder, at = labs.processed([(body, [], capture)], seed)
        done = call(labs.aloft, "discover", labs.pipeline, *at, "--closed", "--json")
        if not done.stdout:
            line = {"seed": seed, "refused": done.stderr.strip().splitlines()[:3]}
        else:
            found = json.loads(done.stdout)
            floor = found["noise_floor"]
            line = {"seed": seed, "body": body, "verdict": found["verdict"], "error": found["held_out_error"] / floor,
                    "floor_high": found["noise_floor_ci95"][1] / floor, "expected": (found.get("error_by_parameters") or 0) / floor}
        known[seed] = line
        labs.keep("few.jsonl", line)
        print(json.dumps(line), flush=True)
    lines = [known[s] for s in sorted(known) if "error" in known[s]]
    print(f"{len(lines)} sets judged, {len(known) - len(lines)} refused")
    for name, share in [
        ("above the floor's interval and 1.5 floors", [max(e["floor_high"], 1.5) for e in lines]),
        ("above error_by_parameters and 1.5 floors", [max(e["expected"], 1.5) for e in lines]),
    ]:
        above = sum(e["error"] > limit for e, limit in zip(lines, share))
        print(f"  {name}: {above}, {interval(above, len(lines))}")
    for verdict in sorted({e["verdict"] for e in lines}):
        print(f"  {verdict}: {sum(e['verdict'] == verdict for e in lines)}")


if __name__ == "__main__":
    main()
