"""What the benchmarks of answers share: laboratories through the whole program, strength, shares."""

import argparse
import hashlib
import json
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import OrderedDict
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TOLERANCE = 0.2
# processed laboratories that are kept: an answer is asked of the recordings that gave its scale
KEPT = 12
# effects or laws of one answer
MOST_ADDED = 4


def read_lines(path):
    """Lines of JSON; the last one may be cut off by an interruption."""
    out = []
    for text in path.read_text().splitlines() if path.exists() else []:
        try:
            out.append(json.loads(text))
        except json.JSONDecodeError:
            print(f"{path}: a line cut off is left out", file=sys.stderr)
    return out


def arguments(doc, body="chain"):
    """A parser with what the benchmarks that score answers have in common: program, body, seed, jobs and folders."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--aloft", default=str(ROOT / "target/release/aloft"))
    parser.add_argument("--body", choices=["chain", "human"], default=body)
    parser.add_argument("--simulator", metavar="SCRIPT", help="a Python script that simulates the scenarios in place of `aloft simulate`")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out")
    parser.add_argument("--score", nargs="+", metavar="OUT", help="only score these folders")
    return parser


def parsed(parser, score):
    """The arguments of a measurement, with the threads of each job set; with `--score` only scores and ends."""
    args = parser.parse_args()
    if args.score:
        score(args.score)
        sys.exit()
    if not args.out:
        parser.error("--out is needed")
    os.environ.setdefault("RAYON_NUM_THREADS", str(max(1, (os.cpu_count() or 1) // args.jobs)))
    return args


def call(aloft, *args):
    return subprocess.run([aloft, *map(str, args)], capture_output=True, text=True)


def copied(pipeline, place):
    """A copy of a pipeline whose references to other files stay valid: what is added to it stays in `place`."""
    shutil.copytree(ROOT / "configs", place / "configs")
    (place / "pipelines").mkdir()
    return Path(shutil.copy(pipeline, place / "pipelines"))


def proposed(aloft, pipeline, at):
    """The words of the `effect add` that the program proposes next, from the answer that it holds; None if it proposes none."""
    said = call(aloft, "compare", pipeline, *at)
    text = re.sub(r"\\\n\s*", " ", said.stdout + said.stderr)
    found = re.search(r"^\s*next\W+aloft (effect add .*)$", text, re.MULTILINE)
    return shlex.split(found.group(1)) if found else None


def prepare(aloft, place, scenarios, seed, simulator=None):
    """The folder of recordings, by `aloft simulate` or another simulator; of two scenarios, recordings 1-2 of the first and 3-5 of the second."""
    folders = []
    for k, (body, hidden, *capture) in enumerate(scenarios):
        file, out = place / f"scenario{k}.yaml", place / f"data{k}"
        scenario = {"name": f"set{k}", "seed": seed, "body": body, "hidden": hidden}
        file.write_text(json.dumps({**scenario, "capture": capture[0]} if capture else scenario))
        done = call(sys.executable, simulator, file, "--out", out) if simulator else call(aloft, "simulate", file, "--out", out)
        if done.returncode:
            raise RuntimeError(done.stderr[-500:])
        folders.append(out)
    if len(folders) == 2:
        for name in ("throws_01", "throws_02"):
            for file in folders[0].glob(f"{name}*"):
                shutil.copy(file, folders[1] / file.name)
        return folders[1]
    return folders[0]


def interval(k, n, independent=None):
    """95 % interval of a share, Wilson. Of `n` cases only `independent` ones count: the same laboratory at several strengths has
    the same noise, and several values of one answer have the same errors."""
    if n == 0:
        return "–"
    p, z = k / n, 1.96
    n = min(n, independent or n)
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return f"{100 * p:.0f} % ({100 * max(middle - half, 0):.0f}-{100 * min(middle + half, 1):.0f})"


def following(lines):
    """Prints how often the proposed `effect add` could be run, and led to the error that `discover` had promised."""
    made = [line["followed"] for line in lines if line.get("followed")]
    if not made:
        return
    worst = [max((error / f["promised"][of] for of, error in f["errors"].items() if f["promised"].get(of)), default=float("nan")) for f in made if "errors" in f]
    kept = sum(ratio <= 1.02 for ratio in worst)
    print(f"\n`effect add` was proposed for {len(made)} sets and refused for {len(made) - len(worst)}; the error after it is at most 2 % above the "
          f"promised one, in flight and in contact, for {interval(kept, len(worst))}; the largest ratio is {max(worst, default=float('nan')):.3f}")


def session(kind, rng):
    """Body and instruments of the laboratory of a law, near `chain_clean` and `human_clean`: 20 to 30 flights."""
    if kind == "chain":
        throws = {"recordings": 5, "throws": rng.choice([4, 5, 6])}
        return {"kind": "chain", "throws": throws}, {"marker_noise_m": 0.0003, "gap_fraction": 0.008}
    person = {"sex": rng.choice("MF"), "height_m": round(rng.uniform(1.55, 1.9), 3), "mass_kg": round(rng.uniform(52, 90), 1)}
    return {"kind": "human", "person": person, "protocol": {"jumps": rng.choice([8, 9, 10]), "exercises": 2}}, {"marker_noise_m": 0.0003, "soft_tissue_m": 0.003}


def empty_session(kind, rng):
    """The laboratory of an empty set: instruments and number of flights vary."""
    body, capture = session(kind, rng)
    capture["marker_noise_m"] = round(rng.choice([0.00015, 0.0003, 0.0006, 0.001]), 6)
    capture["gap_fraction"] = rng.choice([0.0, 0.002, 0.01, 0.03])
    if kind == "chain":
        body["throws"] = {"recordings": rng.choice([3, 5, 6]), "throws": rng.choice([4, 6, 7])}
    else:
        capture["soft_tissue_m"] = rng.choice([0.001, 0.003, 0.005, 0.007])
        body["protocol"]["jumps"] = rng.choice([6, 8, 12])
    return body, capture


class Laboratories:
    """The program, the recordings that it is asked about, and where answers go.

    A laboratory is a list of one or two scenarios (body, hidden effects, capture), as `prepare` takes it."""

    def __init__(self, args):
        self.aloft, self.kind, self.seed = args.aloft, args.body, args.seed
        self.simulator = getattr(args, "simulator", None)
        self.pipeline = ROOT / f"pipelines/{args.body}.yaml"
        self.out, self.lock = Path(args.out), threading.Lock()
        self.places = OrderedDict()
        self.kept = Path(args.keep) if getattr(args, "keep", None) else None
        self.follows = getattr(args, "follow", False)
        self.out.mkdir(parents=True, exist_ok=True)
        self.digest = hashlib.sha256(Path(self.aloft).read_bytes()).hexdigest()[:12]

    def lines(self, name):
        return read_lines(self.out / name)

    def keep(self, name, line):
        with self.lock, open(self.out / name, "a") as file:
            file.write(json.dumps(line) + "\n")

    def processed(self, scenarios, seed):
        """Simulates and runs, unless this laboratory is still there: its folder, which exists while a caller holds it, and
        options for the commands that ask."""
        key = json.dumps([scenarios, seed])
        with self.lock:
            if key in self.places:
                return self.places[key]
        folder = tempfile.TemporaryDirectory()
        place = Path(folder.name)
        data = prepare(self.aloft, place, scenarios, seed, self.simulator)
        at = ["--data", data, "--workspace", place / "ws"]
        done = call(self.aloft, "run", self.pipeline, *at)
        if done.returncode:
            raise RuntimeError(done.stderr[-500:])
        with self.lock:
            self.places[key] = folder, at
            while len(self.places) > KEPT:
                # the folder is removed with the last reference to it
                self.places.popitem(last=False)
        return folder, at

    def compared(self, at, pipeline=None):
        return json.loads(call(self.aloft, "compare", pipeline or self.pipeline, *at, "--json").stdout)

    @staticmethod
    def held_out(compared):
        """Error on left-out flights (left-out contact where nothing acts in flight is asked by `judged_on`), and the floor: N."""
        return {entry["judged_on"]: (entry["held_out_error"], entry["floor"]["noise_floor"]) for entry in compared["against_floor"]}

    def error_of(self, scenarios, seed, judged_on="flight"):
        _folder, at = self.processed(scenarios, seed)
        errors = self.held_out(self.compared(at))
        if judged_on not in errors:
            raise RuntimeError(f"no comparison in {judged_on}")
        return errors[judged_on]

    def ask(self, name, scenarios, seed, judged_on="flight", options=()):
        """The program's answer: a line for `sets.jsonl`. With `--keep` the recordings stay in a folder of the set's name."""
        folder, at = self.processed(scenarios, seed)
        if self.kept:
            shutil.copytree(folder.name, self.kept / name, dirs_exist_ok=True)
        compared = self.compared(at)
        error, floor = self.held_out(compared)[judged_on]
        start = time.time()
        done = call(self.aloft, "discover", self.pipeline, *at, "--json", *options)
        if done.returncode and not done.stdout:
            raise RuntimeError(done.stderr[-500:])
        found = json.loads(done.stdout)
        kept = {k: found.get(k) for k in ("verdict", "effects", "words", "noise_floor", "noise_floor_ci95", "held_out_error", "held_out_error_after", "open", "groups", "against")}
        if kept["open"]:
            kept["open"] = {**kept["open"], "atlas": (kept["open"].get("atlas") or [])[:5]}
        # the stated mass is said to be wrong before any effect is looked for
        kept["wrong_mass"] = bool((compared.get("impulse_mass") or {}).get("wrong"))
        # share of the error that each effect leaves when it is the first one, by kind of motion
        kept["leaves"] = {}
        for made in found.get("rounds", []):
            kept["leaves"].setdefault(made["judged_on"], {c["effect"]: c["held_out_ratio"] for c in made["candidates"]})
        kept["found"] = [f["key"] for f in found.get("found", [])]
        kept["also_on"] = {f["key"]: f.get("also_on", []) for f in found.get("found", [])}
        kept["estimates"] = {f"{f['key']}.{c['name']}": [c["value"], *(c["ci95"] or [None, None])] for f in found.get("found", []) for c in f["coefficients"] + f["nonlinear"]}
        line = {"held_out": error, "floor": floor, "discover_s": round(time.time() - start, 2), "answer": kept}
        if self.follows:
            line["followed"] = self.followed(folder, found)
        return line

    def followed(self, folder, found):
        """What the proposed commands add, in a copy of the folder: the errors that were promised and those that all stages compute.
        None if nothing is proposed."""
        with tempfile.TemporaryDirectory() as copy:
            place = Path(copy) / "set"
            shutil.copytree(folder.name, place)
            data = sorted(place.glob("data*"))[-1]
            pipeline, at = copied(self.pipeline, place), ["--data", data, "--workspace", place / "ws"]
            added = []
            # of several effects or laws the next one is proposed after the first was added
            while len(added) < MOST_ADDED and (words := proposed(self.aloft, pipeline, at)):
                added.append(words[-1])
                done = call(self.aloft, *words)
                if done.returncode:
                    return {"added": added, "refused": done.stderr[-500:]}
            if not added:
                return None
            promised = {e["judged_on"]: e["held_out_error"] for e in found.get("errors_after", [])}
            return {"added": added, "promised": promised, "errors": {of: error for of, (error, _) in self.held_out(self.compared(at, pipeline)).items()}}

    def scale_for(self, scenarios_at, seed, twin, wanted, guess, judged_on="flight"):
        """Scale of what is hidden at which the error is `wanted` times that of the twin: (scale, strength) or None.

        `scenarios_at` gives the laboratory at a scale. The part of the error that is hidden is near proportional to its
        scale; secant steps on its logarithm, between bounds once both sides are known."""
        low, high, scale = None, None, guess
        for _ in range(9):
            try:
                strength = self.error_of(scenarios_at(scale), seed, judged_on)[0] / twin
            except RuntimeError as problem:
                # only a body that does not fly any more is too strongly disturbed
                if not any(word in str(problem) for word in ("diverged", "no feasible motion", "flight")):
                    raise
                strength = float("inf")
            if abs(strength / wanted - 1) <= TOLERANCE * 0.6:
                return scale, strength
            if strength < wanted:
                low = scale
            else:
                high = scale
            part = (strength**2 - 1) if strength > 1.02 else 0.04
            step = ((wanted**2 - 1) / part) ** 0.5 if strength != float("inf") else 0.1
            scale *= min(max(step, 1 / 30), 30)
            if low and high and not low < scale < high:
                scale = (low * high) ** 0.5
        return None
