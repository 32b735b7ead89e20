"""Do 95 % intervals hold the truth through the whole program? Laboratories with fresh noise and a fresh body for every seed.

    python coverage.py ALOFT DRAWS [SCENARIO PIPELINE [FIRST_SEED]]   (default: chain_gentle and chain_clean, pipelines/chain.yaml, 1001)

For each seed: `aloft simulate`, `aloft run`, `aloft parameters --json` against truth/truth.json. Prints the share of base parameters whose interval holds
the truth, over all and for the lowest and highest of them, and the largest error. For people the links' frames differ from the simulated ones, so base
parameters have no common truth: use chains.
"""
import json, pathlib, subprocess, sys, tempfile
from collections import Counter

aloft, draws = sys.argv[1], int(sys.argv[2])
root = pathlib.Path(__file__).resolve().parents[2]
sets = [tuple(sys.argv[3:5])] if len(sys.argv) > 4 else [("chain_gentle", "chain"), ("chain_clean", "chain")]
first = int(sys.argv[5]) if len(sys.argv) > 5 else 1001


def call(*words):
    return subprocess.run([aloft, *map(str, words)], check=True, capture_output=True, text=True).stdout


for scenario, pipeline in sets:
    hits, worst = Counter(), 0.0
    for seed in range(first, first + draws):
        with tempfile.TemporaryDirectory() as folder:
            lab, ws = pathlib.Path(folder) / "lab", pathlib.Path(folder) / "ws"
            call("simulate", root / f"configs/scenarios/{scenario}.yaml", "--out", lab, "--seed", seed)
            words = [root / f"pipelines/{pipeline}.yaml", "--data", lab, "--workspace", ws]
            call("run", *words)
            found = json.loads(call("parameters", *words, "--json"))["base"]
            truth = json.loads((lab / "truth/truth.json").read_text())["base"]
            for b, t in list(zip(found, truth))[1:]:
                hits[b["name"]] += b["ci95"][0] <= t["value"] <= b["ci95"][1]
                worst = max(worst, abs(b["value"] - t["value"]))
    ranked = sorted(hits.items(), key=lambda h: h[1])
    (low, fewest), (high, most) = ranked[0], ranked[-1]
    print(f"{scenario}: {draws} laboratories, 95 % intervals hold {100 * sum(hits.values()) / (draws * len(hits)):.1f} % of {len(hits)} parameters, "
          f"{low} {100 * fewest / draws:.1f} % to {high} {100 * most / draws:.1f} %, largest error {worst:.1e}", flush=True)
