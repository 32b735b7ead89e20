#!/usr/bin/env python3
"""The loop to its end on scenarios: simulate, run, discover, and every command that `next:` proposes, until it proposes no effect.

For each scenario one line of JSON: verdict, and the errors in flight and in contact (newtons, multiples of the floor), before and after
each addition. The pipeline is a copy in a temporary folder. Usage:

  python3 benches/cases.py FOLDER [--only NAME,NAME] [--seeds 3] [--pipeline NAME=FILE] [--out OUT] [--check benches/cases.json]

`--seeds N` repeats each scenario with N other seeds; `--pipeline` gives one of them another pipeline (groups of recordings).
`--check FILE` compares with what a scenario has to come to, says where it does not, and then ends with exit code 1. For each scenario
the file gives `hidden` (effects that must be named, and no class without one of them), `law` (its name), `to_correct` (words of what is
to correct), `ends` (verdicts at the end), and `floors` (the largest errors at the end, in multiples of the floor).
"""

import argparse
import json
import re
import shlex
import sys
import tempfile
from pathlib import Path

from laboratory import ROOT, call, copied, proposed

ROUNDS = 5


def standing(aloft, pipeline, at):
    """Errors and what is to correct, as `compare --json` says them."""
    view = json.loads(call(aloft, "compare", pipeline, *at, "--json").stdout)
    errors = {}
    for entry in view["against_floor"]:
        floor = (entry.get("floor") or {}).get("noise_floor")
        newtons = entry["held_out_error"]
        errors[entry["judged_on"]] = [round(newtons, 3), round(newtons / floor, 2) if floor else None]
    return errors, (view.get("to_correct") or {}).get("words")


def follow(aloft, file, seed, given):
    """One scenario to its end."""
    kind = re.search(r"kind:\s*(\w+)", file.read_text()).group(1)
    line = {"case": file.stem, "seed": seed, "steps": []}
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        pipeline = copied(given or ROOT / f"pipelines/{kind}.yaml", place)
        at = ["--data", place / "data", "--workspace", place / "results"]
        made = [
            ["simulate", file, "--out", place / "data", *(["--seed", seed] if seed else [])],
            ["run", pipeline, *at],
        ]
        for command in made:
            done = call(aloft, *command)
            if done.returncode:
                return {**line, "refused": done.stderr[-400:]}
        for _ in range(ROUNDS):
            errors, correct = standing(aloft, pipeline, at)
            found = json.loads(call(aloft, "discover", pipeline, *at, "--json").stdout)
            step = {"errors": errors, "verdict": found["verdict"], "groups": [g["effects"] for g in found["groups"]], "words": found["words"]}
            step.update({"to_correct": correct} if correct else {})
            line["steps"].append(step)
            words = proposed(aloft, pipeline, at)
            if not words:
                break
            step["added"] = shlex.join(words)
            done = call(aloft, *words)
            if done.returncode:
                step["refused"] = done.stderr[-400:]
                break
    return line


def differences(line, wanted):
    """Where a scenario did not come to what is wanted, in words."""
    refused = [step["refused"] for step in [line, *line["steps"]] if "refused" in step]
    if refused or not line["steps"]:
        return refused or ["nothing was asked"]
    last, classes = line["steps"][-1], [set(names) for step in line["steps"] for names in step["groups"]]
    hidden, added = set(wanted["hidden"]), [step["added"] for step in line["steps"] if "added" in step]
    out = [f"`{name}` was not named" for name in wanted["hidden"] if not any(name in names for names in classes)]
    out += [f"{sorted(names)} was named" for names in classes if not names & hidden]
    if "law" in wanted and not any(wanted["law"] in words for words in added):
        out.append(f"no law `{wanted['law']}` was added")
    if "to_correct" in wanted and wanted["to_correct"] not in line["steps"][0].get("to_correct", ""):
        out.append(f"\"{wanted['to_correct']}\" is not to correct")
    if last["verdict"] not in wanted["ends"]:
        out.append(f"it ends with {last['verdict']}")
    for of, most in wanted.get("floors", {}).items():
        _, floors = last["errors"].get(of, (None, None))
        if floors is None or floors > most:
            out.append(f"it ends at {floors} times the floor in {of}, more than {most}")
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--aloft", default=str(ROOT / "target/release/aloft"))
    parser.add_argument("--only", help="names, separated by commas")
    parser.add_argument("--pipeline", action="append", default=[], help="NAME=FILE")
    parser.add_argument("--seeds", type=int, default=0)
    parser.add_argument("--first-seed", type=int, default=7001)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--check", type=Path, metavar="FILE", help="what the scenarios have to come to")
    args = parser.parse_args()
    expected = json.loads(args.check.read_text()) if args.check else {}
    wrong = 0
    given = dict(p.split("=", 1) for p in args.pipeline)
    for file in sorted(args.folder.glob("*.yaml")):
        wanted = not args.only or file.stem in args.only.split(",")
        if not wanted or "kind:" not in file.read_text():
            continue
        for seed in [None, *range(args.first_seed, args.first_seed + args.seeds)]:
            made = follow(args.aloft, file, seed, given.get(file.stem))
            line = json.dumps(made)
            print(line, flush=True)
            if args.out:
                with open(args.out, "a") as out:
                    out.write(line + "\n")
            for words in differences(made, expected[file.stem]) if file.stem in expected else []:
                wrong += 1
                print(f"{file.stem}, seed {seed or 'of the scenario'}: {words}", file=sys.stderr, flush=True)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
