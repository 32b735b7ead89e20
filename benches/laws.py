#!/usr/bin/env python3
"""How often `aloft discover` finds a law that no catalogue lists: hidden laws through the whole program.

A law is drawn from the population of `law_population.py` and hidden in a laboratory that `aloft simulate` writes (C3D files
with marker noise, gaps and, for people, soft tissue), which goes through `aloft run` and `aloft discover`. The strength of a
set is the held-out error with the law left out of the model, over that of its twin: the same session without the law, whose
error is the one that a model with the true law leaves. Each law is scaled until the set stands at the strengths asked for,
within 20 %. Empty sets vary in noise, soft tissue, gaps and number of flights.

Results are lines of JSON in OUT: `laws.jsonl` (each law with its scales) and `sets.jsonl` (each answer). A run that was
interrupted continues. Scoring is a step of its own and needs no program. `--from OTHER` takes laws and scales from another
run, so that two versions of the program see the same recordings. Usage:

  python3 benches/laws.py --body chain --laws 30 --strengths 2,4,8 --empty 50 --seed 1 --jobs 2 --out OUT
  python3 benches/laws.py --score OUT [OUT ...]

Outcome of a set, by the first law that the program states (`open.laws`). A law names a link and, where the recordings do
not exclude others, those (`also`); a link is right if it is among at most three that are named:

  formula      link, action, direction and variable right, a formula, error within 1.3 times that of the twin
  formula, loose  the same with more error left
  curve        link, action, direction and variable right, a free curve instead of a formula
  link         link and action right, direction or variable wrong
  known effect the effect of the catalogue that is exactly this law (a flat plate for the square of one component)
  catalogue    another effect of the catalogue
  wrong law    wrong link or action of any law stated, whatever else it names
  unexplained  the program says that something remains that it cannot name
  missed       nothing missing, or not detectable
"""

import hashlib
import json
import random
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import law_population
from laboratory import TOLERANCE, Laboratories, arguments, empty_session, following, interval, parsed, read_lines, session

FORMULA_WITHIN = 1.3
MOST_LINKS = 3
NAMED = ["link right", "first link right", "direction, variable", "diagnosis: link", "diagnosis: direction, variable", "formula", "formula, loose", "curve", "link", "known effect", "catalogue", "wrong law",
         "unexplained", "missed", "not usable"]


# ---- laboratories ------------------------------------------------------------------------------

def laboratory(where, hidden):
    """Scenarios of a session with what is hidden in it."""
    body, capture = where
    return [(body, hidden, capture)]


def scaled(entry, scale):
    """The hidden effect with `@` replaced by the law's scale."""
    number = f"{scale:.6g}"
    return {k: [f.replace("@", number) if isinstance(f, str) else f for f in v] if isinstance(v, list) else v for k, v in entry.items()}


class Bench(Laboratories):
    """Laws that no catalogue lists, each scaled to the strengths asked for."""

    def calibrate(self, index, strengths):
        """Law `index` with a scale for each strength; other draws are tried if it cannot reach them."""
        reasons = []
        for attempt in range(4):
            drawn = law_population.draw(self.kind, self.seed, index, attempt, random)
            rng = random.Random(f"session {self.kind} {self.seed} {index} {attempt}")
            where, seed = session(self.kind, rng), 2_000_000 + 10_000 * self.seed + 10 * index + attempt
            line = {"law": index, "body": self.kind, "attempt": attempt, **drawn, "session": where, "seed": seed}
            try:
                twin, floor = self.error_of(laboratory(where, []), seed)
                line |= {"twin": twin, "floor": floor, "scales": {}}
                guess = 0.1 if self.kind == "chain" else 5.0
                if "moment" in drawn["entry"]:
                    guess *= 0.05
                for wanted in sorted(strengths, key=lambda s: abs(s - 4)):
                    found = self.scale_for(lambda scale: laboratory(where, [scaled(drawn["entry"], scale)]), seed, twin, wanted, guess)
                    if found is None:
                        raise RuntimeError(f"{drawn['family']}: strength {wanted} not reached")
                    guess = found[0] * (0.45 if wanted == sorted(strengths, key=lambda s: abs(s - 4))[0] else 4.3)
                    line["scales"][str(wanted)] = found
                return {**line, "tried": reasons}
            except (RuntimeError, ValueError, KeyError) as problem:
                reasons.append(str(problem)[-300:])
        return {"law": index, "body": self.kind, "tried": reasons}

    # ---- one piece of work -----------------------------------------------------------------

    def law(self, index, strengths, known, done):
        line = known.get(index)
        if line is None or any(str(s) not in line.get("scales", {}) for s in strengths):
            line = self.calibrate(index, strengths)
            self.keep("laws.jsonl", line)
        if "entry" not in line:
            print(f"law {index:3d} not usable: {line['tried']}", file=sys.stderr, flush=True)
            return
        for wanted in strengths:
            name = f"{self.kind}-law{index}-x{wanted}"
            if name not in done:
                hidden = [scaled(line["entry"], line["scales"][str(wanted)][0])]
                of = {k: line[k] for k in ("law", "family", "expressible", "truth", "twin", "seed", "session")}
                self.answer(name, {**of, "strength": wanted, "hidden": hidden}, line["session"], hidden, line["seed"])

    def empty(self, index, done):
        name = f"{self.kind}-empty{index}"
        if name not in done:
            where = empty_session(self.kind, random.Random(f"empty {self.kind} {self.seed} {index}"))
            seed = 3_000_000 + 10_000 * self.seed + index
            self.answer(name, {"strength": 0, "session": where, "seed": seed}, where, [], seed)

    def answer(self, name, of, where, hidden, seed):
        line = {"set": name, "body": self.kind, "program": self.digest, **of}
        start = time.time()
        try:
            line |= self.ask(name, laboratory(where, hidden), seed)
        except (RuntimeError, ValueError, KeyError) as problem:
            line["problem"] = str(problem)[-500:]
        line["seconds"] = round(time.time() - start, 1)
        self.keep("sets.jsonl", line)
        print(describe(line), flush=True)


# ---- scoring -----------------------------------------------------------------------------------

def in_the_models_axes(name, truth):
    """A variable of the truth as the program names it. The simulator's links have the axes of the laboratory in the neutral
    posture, with palms to the thighs; the model's hands have z along the styloids (ISB), a quarter turn about y from there."""
    part, _, k = name.rpartition("_")
    turned = part in ("v_link", "omega_link", "tilt") and any(link.startswith("hand_") for link in truth["carriers"])
    return f"{part}_{dict(x='z', y='y', z='x')[k]}" if turned else name


def right_of(claim, truth):
    """Whether link and action, and whether direction and variables of a claim are right. The link is right if it is among at
    most three that are named."""
    links = [claim.get("carrier"), *(claim.get("also") or [])]
    named = links if len(links) <= MOST_LINKS else links[:1]
    where = any(link in truth["carriers"] for link in named) and claim.get("action") in truth["actions"]
    # the diagnosis has one variable, a law a list of them
    said = claim.get("variables", claim.get("variable"))
    said = set(said.split("*") if isinstance(said, str) else said or [])
    said -= {"1"}
    variables = bool(said or truth["constant"]) and any(said <= {in_the_models_axes(name, truth) for name in v} for v in truth["variables"])
    return where, claim.get("direction") in truth["directions"] and variables


def same_effects(line):
    """Effects of the catalogue that are exactly the law of a set: the square of one component of the velocity along an
    axis of the link, against that axis, is a flat plate in still air."""
    plate = line["family"] == "power of one component" and line["hidden"][0]["axes"] == "link" and any(
        str(f).endswith("^2)") for f in line["hidden"][0]["force"])
    return set(line["truth"]["known"]) | ({"panels"} if plate else set())


def judge(line):
    """Outcome of a set and what else is counted of it: a set of words out of `NAMED`."""
    if "answer" not in line:
        return {"not usable"}
    answer = line["answer"]
    opened = answer.get("open") or {}
    claims = opened.get("laws") or []
    catalogue = answer["effects"] if answer["verdict"] not in ("unexplained", "nothing_missing", "not_detectable") else []
    if line["strength"] == 0:
        return {"catalogue"} if catalogue else {"wrong law"} if claims else {"unexplained"} if answer["verdict"] == "unexplained" else {"missed"}
    truth, out = line["truth"], set()
    diagnosis = opened.get("diagnosis") or {}
    if claims and right_of(claims[0], truth)[0]:
        out.add("link right")
        if claims[0]["carrier"] in truth["carriers"]:
            out.add("first link right")
    if (claims and right_of(claims[0], truth)[0]) or (not claims and diagnosis and right_of(diagnosis, truth)[0]):
        out.add("diagnosis: link")
    if (claims and all(right_of(claims[0], truth))) or (not claims and diagnosis and all(right_of(diagnosis, truth))):
        out.add("diagnosis: direction, variable")
    if claims and all(right_of(claims[0], truth)):
        out.add("direction, variable")
    if catalogue:
        return out | ({"catalogue"} if set(catalogue) - same_effects(line) else {"known effect"})
    if any(not right_of(claim, truth)[0] for claim in claims):
        return out | {"wrong law"}
    if not claims:
        return out | ({"unexplained"} if answer["verdict"] == "unexplained" else {"missed"})
    if "direction, variable" not in out:
        return out | {"link"}
    if claims[0].get("kind") != "formula":
        return out | {"curve"}
    # `times_floor` is in multiples of the program's floor; a model with the true law stands where
    # the twin does
    best = max(line["twin"] / line["floor"], 1.0)
    left = opened.get("times_floor_after") or claims[0].get("times_floor") or float("inf")
    return out | ({"formula"} if left <= FORMULA_WITHIN * best else {"formula, loose"})


def describe(line):
    outcome = ", ".join(n for n in NAMED if n in judge(line))
    if "answer" not in line:
        return f"{line['set']:20s} not usable: {line['problem']}"
    answer, above = line["answer"], line["held_out"] / line["floor"]
    laws = (answer.get("open") or {}).get("laws") or []
    said = answer["verdict"] + "".join(f" {e}" for e in answer["effects"]) + "".join(
        f" [{c.get('kind')}: {c.get('carrier')} {c.get('action')} {c.get('direction')} {','.join(c.get('variables') or [])}]" for c in laws)
    twin = f"{line['held_out'] / line['twin']:.1f} x twin, " if "twin" in line else ""
    return f"{line['set']:20s} {line.get('family', 'empty'):34s} {twin}{above:.1f} x floor  {outcome or '-':28s} said: {said}  ({line['seconds']:.0f} s)"


def score(folders):
    lines = {}
    for folder in folders:
        for line in read_lines(Path(folder) / "sets.jsonl"):
            lines[(str(folder), line["set"])] = line
    lines = list(lines.values())
    for kind in sorted({line["body"] for line in lines}):
        of_kind = [line for line in lines if line["body"] == kind]
        hidden = [line for line in of_kind if line["strength"]]
        strengths = sorted({line["strength"] for line in hidden})
        groups = [("all", hidden)]
        groups += [(f"strength {s}", [line for line in hidden if line["strength"] == s]) for s in strengths]
        groups += [(f"expressible, {s}", [line for line in hidden if line["strength"] == s and line["expressible"]]) for s in strengths]
        groups += [(f"not expressible, {s}", [line for line in hidden if line["strength"] == s and not line["expressible"]]) for s in strengths]
        groups += [("empty", [line for line in of_kind if not line["strength"]])]
        print(f"\n## {kind}\n")
        print("| sets | n | " + " | ".join(NAMED) + " | wrong claims |")
        print("|---" * (len(NAMED) + 3) + "|")
        for name, group in groups:
            usable = [judge(line) for line in group]
            n = sum("not usable" not in j for j in usable)
            laws = len({line.get("law", line["set"]) for line, j in zip(group, usable) if "not usable" not in j})
            cells = [interval(sum(what in j for j in usable), n, laws) if what != "not usable" else str(len(group) - n) for what in NAMED]
            wrong = interval(sum(bool(j & {"catalogue", "wrong law"}) for j in usable), n, laws)
            print(f"| {name} | {n} | " + " | ".join(cells) + f" | {wrong} |")
        following(of_kind)
        times = sorted(line["discover_s"] for line in of_kind if "discover_s" in line)
        off = [line["set"] for line in hidden if "answer" in line and abs(line["held_out"] / line["twin"] / line["strength"] - 1) > TOLERANCE]
        if times:
            print(f"\ndiscover: median {times[len(times) // 2]:.1f} s, longest {times[-1]:.1f} s; strength off by more than {TOLERANCE:.0%}: {', '.join(off) or 'none'}")
    print("\n`link right`, `first link right` (the one stated first), `direction, variable` and `diagnosis: …` (the same of the stated law, else of the diagnosis) are counted beside the outcomes `formula` to `missed`, which exclude each other. "
          "`wrong claims` is `catalogue` and `wrong law` together; of empty sets, all claims; `missed` of empty sets is right.")


def main():
    parser = arguments(__doc__)
    parser.add_argument("--laws", type=int, default=30)
    parser.add_argument("--strengths", default="2,4,8")
    parser.add_argument("--empty", type=int, default=50)
    parser.add_argument("--keep", metavar="FOLDER", help="keep the recordings and workspace of each set in this folder")
    parser.add_argument("--follow", action="store_true", help="also run the `effect add` that is proposed, and keep the error after it")
    parser.add_argument("--from", dest="origin", help="take laws and their scales from this folder")
    parser.add_argument("--list", action="store_true", help="only print the laws drawn")
    args = parser.parse_args()
    if args.list:
        for index in range(args.laws):
            drawn = law_population.draw(args.body, args.seed, index, 0, random)
            print(index, "expressible" if drawn["expressible"] else "-", drawn["family"], json.dumps(drawn["entry"]), json.dumps(drawn["truth"]))
        return None
    args = parsed(parser, score)
    bench = Bench(args)
    strengths = [int(s) if float(s).is_integer() else float(s) for s in args.strengths.split(",")]
    population = hashlib.sha256(Path(law_population.__file__).read_bytes()).hexdigest()[:12]
    stamp = {"body": args.body, "seed": args.seed, "population": population}
    setup = bench.out / "setup.json"
    if setup.exists() and json.loads(setup.read_text()) != stamp:
        parser.error(f"{setup} is of another body, seed or population: {setup.read_text()}")
    setup.write_text(json.dumps(stamp))
    if args.origin and json.loads((Path(args.origin) / "setup.json").read_text()) != stamp:
        parser.error(f"{args.origin} is of another body, seed or population")
    if args.origin and not (bench.out / "laws.jsonl").exists():
        for line in read_lines(Path(args.origin) / "laws.jsonl"):
            bench.keep("laws.jsonl", line)
    known = {line["law"]: line for line in bench.lines("laws.jsonl")}
    done = {line["set"] for line in bench.lines("sets.jsonl") if "answer" in line}
    others = {line["program"] for line in bench.lines("sets.jsonl")} - {bench.digest}
    if others:
        print(f"warning: {bench.out} also holds answers of other builds ({', '.join(sorted(others))})", file=sys.stderr)
    with ThreadPoolExecutor(args.jobs) as pool:
        work = [pool.submit(bench.law, i, strengths, known, done) for i in range(args.laws)]
        work += [pool.submit(bench.empty, i, done) for i in range(args.empty)]
        for piece in work:
            piece.result()
    score([args.out])
    return None


if __name__ == "__main__":
    sys.exit(main())
