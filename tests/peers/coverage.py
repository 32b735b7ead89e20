"""Do 95 % intervals cover the truth through the whole program? Laboratories with fresh noise and a fresh body for every seed.

    python coverage.py ALOFT DRAWS [SCENARIO PIPELINE]        (default: chain_gentle and chain_clean, pipelines/chain.yaml)

For each seed: `aloft simulate`, `aloft run`, `aloft parameters --json` against truth/truth.json. Prints the share of base parameters whose interval holds
the truth, and the largest error. For people the links' frames differ from the simulated ones, so base parameters have no common truth: use chains.
"""
import json, pathlib, subprocess, sys, tempfile

aloft, draws = sys.argv[1], int(sys.argv[2])
root = pathlib.Path(__file__).resolve().parents[2]
sets = [tuple(sys.argv[3:5])] if len(sys.argv) > 4 else [("chain_gentle", "chain"), ("chain_clean", "chain")]


def call(*words):
    return subprocess.run([aloft, *map(str, words)], check=True, capture_output=True, text=True).stdout


for scenario, pipeline in sets:
    covered = total = 0
    worst = 0.0
    for seed in range(1, draws + 1):
        with tempfile.TemporaryDirectory() as folder:
            lab, ws = pathlib.Path(folder) / "lab", pathlib.Path(folder) / "ws"
            call("simulate", root / f"configs/scenarios/{scenario}.yaml", "--out", lab, "--seed", 1000 + seed)
            words = [root / f"pipelines/{pipeline}.yaml", "--data", lab, "--workspace", ws]
            call("run", *words)
            found = json.loads(call("parameters", *words, "--json"))["base"]
            truth = json.loads((lab / "truth/truth.json").read_text())["base"]
            for b, t in list(zip(found, truth))[1:]:
                covered += b["ci95"][0] <= t["value"] <= b["ci95"][1]
                total += 1
                worst = max(worst, abs(b["value"] - t["value"]))
    print(f"{scenario}: {draws} laboratories, 95 % intervals cover {100 * covered / total:.1f} % of {total}, largest error {worst:.1e}")
