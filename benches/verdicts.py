#!/usr/bin/env python3
"""How often `aloft discover` names what is hidden: effects of the catalogue at given strengths.

Each set is a laboratory that `aloft simulate` writes (C3D files with marker noise, gaps and, for people, soft tissue),
processed by `aloft run` and asked by `aloft discover`. Body, kinds, links and directions are drawn from the seed; nothing is
chosen by what the program finds. The strength of a set is the held-out error without the hidden effects in the model, over
that of its twin: the same laboratory with nothing hidden, whose error is the one that a model with the true effects leaves.
Sizes are scaled until a set stands at the strength asked for, within 20 %. Effects that show on force plates only are scaled
by the error in contact.

An answer consists of classes ("one of wind, tilt"), one for each effect that the program found. It counts as

  right        only the hidden effects are named
  class        every hidden effect is named, no class has more than three members, and each holds a hidden effect
  wide class   the same with a larger class
  partial      every class holds a hidden effect, but of several hidden effects not all are named
  unexplained  the program says that something remains that it cannot name
  missed       "nothing missing" or "not detectable"
  wrong link   every class holds a hidden effect, and one that is stated on a link acts on none of the links that are named
  wrong        a class holds no hidden effect

Rows "told apart" hold the sets of one effect whose error is below that of each other effect, by itself, by more than the
floor's spread (half of its 95 % interval): where the recordings tell the effect from all others.

Of empty sets "nothing missing" and "not detectable" are right. Results are lines of JSON in OUT (`sizes.jsonl`,
`sets.jsonl`); a run that was interrupted continues. Usage:

  python3 benches/verdicts.py --body chain --sets 50 --strengths 1.5,2,4 --empty 130 --seed 1 --jobs 2 --out OUT
  python3 benches/verdicts.py --score OUT [OUT ...]
"""

import json
import math
import random
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from laboratory import TOLERANCE, Laboratories, arguments, empty_session, following, interval, parsed, read_lines, session

OUTCOMES = ["right", "class", "wide class", "partial", "unexplained", "missed", "wrong link", "wrong"]
ON_PLATES = {"plate_time_offset", "plate_gain", "body_mass"}
# a load that is always there makes the body heavier than stated
HEAVIER = {"body_mass", "plate_gain"}


def unit(rng):
    x = [rng.gauss(0, 1) for _ in range(3)]
    n = math.sqrt(sum(a * a for a in x))
    return [a / n for a in x]


def times(direction, size):
    return [round(a * size, 7) for a in direction]


def chain_effect(rng):
    """One effect on the thrown chain: its entry at a size, and the names that are right."""
    link = rng.choice(["link0", "link1"])
    kind = rng.choice(["quadratic_drag", "linear_drag", "rotational_drag", "wind", "constant_force", "gravity_tilt",
                       "tether", "crane", "flywheel", "rotor", "thrust", "added_mass", "payload"])
    anchor = [round(rng.uniform(-1.5, 1.5), 3), round(rng.uniform(-1.5, 1.5), 3), round(rng.uniform(2.0, 3.0), 3)]
    point = [round(rng.uniform(-0.1, 0.1), 3), 0.0, 0.0]
    way, angle = unit(rng), rng.uniform(0, 2 * math.pi)
    entry = {
        "quadratic_drag": lambda s: {"drag_area_m2": 0.03 * s},
        "linear_drag": lambda s: {"coefficient_nspm": 0.05 * s},
        "rotational_drag": lambda s: {"coefficient_nmsprad": 0.0006 * s},
        "wind": lambda s: {"velocity_mps": times(way, 2), "drag_area_m2": 0.03 * s},
        "constant_force": lambda s: {"link": link, "point_m": point, "force_n": times(way, 0.15 * s)},
        "gravity_tilt": lambda s: {"about_x_deg": 1.5 * s * math.cos(angle), "about_y_deg": 1.5 * s * math.sin(angle)},
        "tether": lambda s: {"link": link, "anchor_m": anchor, "rest_length_m": 0.5, "stiffness_npm": 0.2 * s},
        "crane": lambda s: {"link": link, "pulley_m": anchor, "tension_n": 0.3 * s},
        "flywheel": lambda s: {"link": link, "momentum_nms": times(way, 0.004 * s)},
        "rotor": lambda s: {"link": link, "axis": way, "mean_nms": 0.003 * s, "swing_nms": 0.003 * s, "frequency_hz": 3.0},
        "thrust": lambda s: {"link": link, "point_m": point, "force_n": times(way, 0.2 * s)},
        "added_mass": lambda s: {"link": link, "mass_kg": 0.03 * s},
        "payload": lambda s: {"link": link, "point_m": point, "mass_kg": 0.03 * s},
    }[kind]
    return kind, lambda size: {"effect": kind, **entry(size)}, {kind}


def human_effect(rng):
    """The same on a person who jumps."""
    limb = rng.choice(["hand_r", "hand_l", "forearm_r", "shank_l", "thigh_r", "torso", "pelvis"])
    kind = rng.choice(["tether", "constant_force", "crane", "payload", "payload", "load", "wind", "gravity_tilt",
                       "plate_time_offset", "plate_gain", "body_mass", "gravity_scale"])
    anchor = [round(rng.uniform(-1, 1), 3), round(rng.uniform(-1, 1), 3), round(rng.uniform(2.5, 3.5), 3)]
    way, angle, sign = unit(rng), rng.uniform(0, 2 * math.pi), rng.choice([-1, 1])
    across = [math.cos(angle), math.sin(angle), 0.0]
    half = ["jump05", "jump06", "jump07", "jump08"]
    entry, names = {
        "tether": (lambda s: {"link": "pelvis", "anchor_m": anchor, "rest_length_m": 1.0, "stiffness_npm": 40 * s}, None),
        "constant_force": (lambda s: {"link": limb, "force_n": times(way, 15 * s)}, None),
        "crane": (lambda s: {"link": "pelvis", "pulley_m": anchor, "tension_n": 40 * s}, None),
        "payload": (lambda s: {"link": limb, "mass_kg": 1.5 * s, "trials": half}, None),
        "load": (lambda s: {"link": limb, "mass_kg": 1.5 * s}, {"link_mass", "payload"}),
        "wind": (lambda s: {"velocity_mps": times(across, 4), "drag_area_m2": 0.5 * s}, None),
        "gravity_tilt": (lambda s: {"about_x_deg": s * math.cos(angle), "about_y_deg": s * math.sin(angle)}, None),
        "plate_time_offset": (lambda s: {"offset_s": 0.006 * s * sign}, None),
        "plate_gain": (lambda s: {"plate": 1, "gain": [1.0 + 0.04 * s * sign] * 6}, None),
        "body_mass": (lambda s: {"error_kg": 2.5 * s * sign}, {"body_mass", "plate_gain"}),
        "gravity_scale": (lambda s: {"factor": 1 + 0.02 * s * sign}, None),
    }[kind]
    return kind, lambda size: {"effect": "payload" if kind == "load" else kind, **entry(size)}, names or {kind}


def draw(body, rng, case=None, only=None):
    """A laboratory as `drawn` makes it, of this case and of one of these kinds where they are asked for."""
    while True:
        made = drawn(body, rng)
        if case in (None, made[2]) and (only is None or made[3] in only):
            return made


def drawn(body, rng):
    """A laboratory at a size, what is hidden (a list of sets of right names), the case, and where it is judged."""
    where, capture = session(body, rng)
    if body == "chain":
        where["object"] = {"variation": round(rng.uniform(0.5, 1.5), 2)}
        kind, one, names = chain_effect(rng)
        case = rng.choice(["one", "one", "one", "one", "two", "part"])
        if kind == "payload" or case == "part":
            return lambda s: [(where, [one(s)], capture), (where, [], capture)], [names], "part", kind, "flight"
        if case == "two":
            second, other, more = chain_effect(rng)
            # wind contains drag in still air, and a rotor contains a flywheel: two of them are one
            same = [{"wind", "quadratic_drag", "linear_drag"}, {"rotor", "flywheel"}]
            if second not in ("payload", kind) and not any({kind, second} <= of for of in same):
                return lambda s: [(where, [one(s), other(s)], capture)], [names, more], "two", f"{kind} + {second}", "flight"
        return lambda s: [(where, [one(s)], capture)], [names], "one", kind, "flight"
    where["person"]["variation"] = round(rng.uniform(0.5, 1.5), 2)
    if rng.random() < 0.15:
        links = rng.choice([("shank_l", "shank_r"), ("forearm_l", "forearm_r"), ("thigh_l", "thigh_r")])
        trials = ["jump01", "jump03", "jump05", "jump07"]
        pair = lambda s: [{"effect": "payload", "link": l, "mass_kg": 1.2 * s, "trials": trials} for l in links]
        return lambda s: [(where, pair(s), capture)], [{"payload"}], "two of a kind", "payload + payload", "flight"
    kind, one, names = human_effect(rng)
    judged_on = "contact" if kind in ON_PLATES else "flight"
    return lambda s: [(where, [one(s)], capture)], [names], "one", kind, judged_on


def true_values(hidden):
    """Coefficients and places of hidden effects as the program would report them: key and name to value."""
    out = {}
    for h in hidden:
        kind, on = h["effect"], f"[{h['link']}]" if "link" in h else ""
        axes = lambda name, values: {f"{kind}{on}.{name}_{axis}": x for axis, x in zip("xyz", values)}
        out |= {
            "payload": lambda: {f"payload{on}.mass": h["mass_kg"]},
            "added_mass": lambda: {f"added_mass{on}.added_mass": h["mass_kg"]},
            "constant_force": lambda: axes("force", h["force_n"]),
            "flywheel": lambda: axes("momentum", h["momentum_nms"]),
            "tether": lambda: {f"tether{on}.stiffness": h["stiffness_npm"]},
            "crane": lambda: {f"crane{on}.tension": h["tension_n"]},
            "gravity_scale": lambda: {"gravity_scale.gravity_excess": h["factor"] - 1},
            "gravity_tilt": lambda: {f"gravity_tilt.dg_{axis}": x for axis, x in zip("xy", tilted(h))},
            # what the readings have to be multiplied by is one more than the gain
            "plate_gain": lambda: {f"plate_gain[plate{h['plate']}].gain_{axis}": 1 / g - 1 for axis, g in zip(["fx", "fy", "fz", "mx", "my", "mz"], h["gain"])},
            "body_mass": lambda: {"body_mass.mass_error": -h["error_kg"]},
            "plate_time_offset": lambda: {"plate_time_offset.delay": h["offset_s"]},
        }.get(kind, dict)()
        # places in the room, and on the link (its origin, if none is stated)
        out |= {
            "tether": lambda: {**axes("anchor", h["anchor_m"]), f"tether{on}.rest_length": h["rest_length_m"]},
            "crane": lambda: axes("pulley", h["pulley_m"]),
            "rotor": lambda: {f"rotor{on}.frequency": h["frequency_hz"]},
        }.get(kind, dict)()
        if kind in ("payload", "added_mass", "constant_force", "tether", "crane"):
            out |= axes("point", h.get("point_m", [0.0, 0.0, 0.0]))
    return out


def is_place(name):
    """True for parameters in which an effect is not linear: places, a rest length, a frequency."""
    return name.rpartition(".")[2].startswith(("anchor_", "pulley_", "point_", "rest_length", "frequency"))


def true_links(hidden):
    """Links on which each hidden effect acts."""
    out = {}
    for h in hidden:
        if "link" in h:
            out.setdefault(h["effect"], []).append(h["link"])
    return out


def tilted(entry):
    """Horizontal components of a tilted gravity, m/s²."""
    x, y = math.radians(entry["about_x_deg"]), math.radians(entry["about_y_deg"])
    angle = math.hypot(x, y)
    size = 9.80665 * math.sin(angle) / angle
    return [-y * size, x * size]


class Bench(Laboratories):
    """Effects of the catalogue, scaled to the strengths asked for."""

    def __init__(self, args):
        super().__init__(args)
        self.case, self.only = args.case, args.only.split(",") if args.only else None

    def sizes(self, index, strengths):
        """Set `index` with a size for each strength; other draws are tried if it cannot reach them."""
        reasons = []
        for attempt in range(4):
            at, truth, case, kind, judged_on = draw(self.kind, random.Random(f"verdict {self.kind} {self.seed} {index} {attempt}"), self.case, self.only)
            seed = 4_000_000 + 10_000 * self.seed + 10 * index + attempt
            line = {"index": index, "attempt": attempt, "seed": seed, "case": case, "kind": kind, "judged_on": judged_on,
                    "truth": [sorted(t) for t in truth], "sizes": {}}
            try:
                line["twin"] = self.error_of([(where, [], capture) for where, _, capture in at(1.0)], seed, judged_on)[0]
                guess = 1.0
                for wanted in sorted(strengths):
                    found = self.scale_for(at, seed, line["twin"], wanted, guess, judged_on)
                    if found is None:
                        raise RuntimeError(f"{kind}: strength {wanted} not reached")
                    guess = 2 * found[0]
                    line["sizes"][str(wanted)] = found
                return {**line, "tried": reasons}
            except (RuntimeError, ValueError, KeyError) as problem:
                reasons.append(str(problem)[-300:])
        return {"index": index, "tried": reasons}

    def one(self, index, strengths, known, done):
        line = known.get(index)
        if line is None or any(str(s) not in line.get("sizes", {}) for s in strengths):
            line = self.sizes(index, strengths)
            self.keep("sizes.jsonl", line)
        if "kind" not in line:
            print(f"set {index:3d} not usable: {line['tried']}", file=sys.stderr, flush=True)
            return
        at = draw(self.kind, random.Random(f"verdict {self.kind} {self.seed} {index} {line['attempt']}"), self.case, self.only)[0]
        for wanted in strengths:
            name = f"{self.kind}-{index}-x{wanted}"
            if name not in done:
                of = {k: line[k] for k in ("index", "case", "kind", "truth", "twin", "judged_on", "seed")}
                scenarios = at(line["sizes"][str(wanted)][0])
                of |= {"strength": wanted, "true_values": true_values(scenarios[0][1]), "links": true_links(scenarios[0][1])}
                self.answer(name, of, scenarios, line["seed"], line["judged_on"])

    def empty(self, index, done):
        name = f"{self.kind}-empty{index}"
        if name not in done:
            where, capture = empty_session(self.kind, random.Random(f"verdict empty {self.kind} {self.seed} {index}"))
            seed = 5_000_000 + 10_000 * self.seed + index
            self.answer(name, {"strength": 0, "truth": [], "case": "empty", "kind": "empty"}, [(where, [], capture)], seed, "flight")

    def answer(self, name, of, scenarios, seed, judged_on):
        line = {"set": name, "body": self.kind, "program": self.digest, **of}
        start = time.time()
        try:
            line |= self.ask(name, scenarios, seed, judged_on)
        except (RuntimeError, ValueError, KeyError) as problem:
            line["problem"] = str(problem)[-500:]
        line["seconds"] = round(time.time() - start, 1)
        self.keep("sets.jsonl", line)
        print(describe(line), flush=True)


def judge(line):
    if "answer" not in line:
        return "not usable"
    found = line["answer"]
    classes = [set(group["effects"]) for group in found.get("groups") or []] or [set(found["effects"])]
    named = set().union(*classes)
    if found.get("wrong_mass") and not named:
        named, classes = {"body_mass"}, [{"body_mass"}]
    if not line["truth"] and not (found.get("open") or {}).get("laws"):
        return "wrong" if named else "unexplained" if found["verdict"] == "unexplained" else "right"
    if (found.get("open") or {}).get("laws"):
        return "wrong"
    if found["verdict"] == "unexplained":
        return "unexplained"
    if not named:
        return "missed"
    truth = [set(right) | (HEAVIER if line["kind"] == "load" else set()) for right in line["truth"]]
    hidden = set().union(*truth)
    if not all(members & hidden for members in classes):
        return "wrong"
    if any(not among for _, among, _ in stated_links(line)):
        return "wrong link"
    if not all(named & right for right in truth):
        return "partial"
    if not named - hidden:
        return "right"
    return "class" if max(map(len, classes)) <= 3 else "wide class"


def describe(line):
    if "answer" not in line:
        return f"{line['set']:20s} {line['kind']:26s} not usable: {line['problem']}"
    a = line["answer"]
    floor, most = a["noise_floor"] or float("nan"), (a["noise_floor_ci95"] or [float("nan")] * 2)[1]
    laws = "".join(f" [law: {c.get('carrier')} {c.get('action')}]" for c in (a.get("open") or {}).get("laws") or [])
    return (f"{line['set']:20s} {line['kind']:26s} {line['case']:13s} {judge(line):11s} said: {a['verdict']} {','.join(a['effects'])}{laws} "
            f"[{', '.join(a['found'])}] {a['held_out_error'] / floor:.2f} -> {a['held_out_error_after'] / floor:.2f} x floor (to {most / floor:.2f})")


def score(folders):
    lines = {}
    for folder in folders:
        for line in read_lines(Path(folder) / "sets.jsonl"):
            lines[(str(folder), line["set"])] = line
    for body in sorted({line["body"] for line in lines.values()}):
        of_body = [line for line in lines.values() if line["body"] == body]
        hidden = [line for line in of_body if line["strength"]]
        strengths = sorted({line["strength"] for line in hidden})
        groups = [("hidden, all", hidden)]
        groups += [(f"strength {s}", [line for line in hidden if line["strength"] == s]) for s in strengths]
        groups += [(case, [line for line in hidden if line["case"] == case]) for case in sorted({line["case"] for line in hidden})]
        groups += [(f"strength {s}, told apart", [line for line in hidden if line["strength"] == s and told_apart(line)]) for s in strengths]
        groups += [("empty", [line for line in of_body if not line["strength"]])]
        print(f"\n## {body}\n\n| sets | n | " + " | ".join(OUTCOMES) + " |\n" + "|---" * (len(OUTCOMES) + 2) + "|")
        for name, group in groups:
            asked = [line for line in group if "answer" in line]
            usable = [judge(line) for line in asked]
            print(f"| {name} | {len(usable)} | " + " | ".join(interval(usable.count(o), len(usable), laboratories(asked)) for o in OUTCOMES) + " |")
        off = [line["set"] for line in hidden if "answer" in line and abs(line["held_out"] / line["twin"] / line["strength"] - 1) > TOLERANCE]
        times_s = sorted(line["discover_s"] for line in of_body if "discover_s" in line)
        unusable = sum("answer" not in line for line in of_body)
        intervals(hidden)
        links(hidden)
        following(of_body)
        if times_s:
            print(f"\ndiscover: median {times_s[len(times_s) // 2]:.1f} s, longest {times_s[-1]:.1f} s; not usable: {unusable}; "
                  f"strength off by more than {TOLERANCE:.0%}: {', '.join(off) or 'none'}")


def laboratories(lines):
    """Number of laboratories among these sets."""
    return len({(line["seed"] if "seed" in line else line["set"]) for line in lines})


def told_apart(line):
    """True if the one hidden effect leaves less than each other effect by more than the floor's spread: half of its 95 % interval."""
    answer = line.get("answer") or {}
    leaves, spread = (answer.get("leaves") or {}).get(line.get("judged_on")), answer.get("noise_floor_ci95")
    if line["case"] not in ("one", "part") or not leaves or not spread:
        return False
    hidden = set(line["truth"][0]) | (HEAVIER if line["kind"] == "load" else set())
    own, other = ([x for e, x in leaves.items() if (e in hidden) == hides and x is not None] for hides in (True, False))
    return bool(own and other) and (min(other) - min(own)) * answer["held_out_error"] > (spread[1] - spread[0]) / 2


def stated_links(line):
    """Of each hidden effect that an answer states on a link: whether it acts there, whether it acts on that link or on one said to
    be as good, and how many are said to be. Of two links that are named together (`thigh_l and thigh_r`) each counts."""
    known, also_on = line.get("links") or {}, (line.get("answer") or {}).get("also_on") or {}
    out = []
    for key, further in also_on.items():
        effect, _, link = key.rstrip("]").partition("[")
        # a load that is always there is `link_mass`, and a payload in the scenario
        effect = "payload" if effect == "link_mass" and line["kind"] == "load" else effect
        if effect in known and link:
            acts_on = set(known[effect])
            named = {link, *(name for among in further for name in among.split(" and "))}
            out.append((link in acts_on, bool(named & acts_on), len(further)))
    return out


def links(lines):
    """How often the link of an effect that was named rightly is one on which it acts: the stated one, or one said to be as good."""
    all_of = [(found, line) for line in lines for found in stated_links(line)]
    stated, among, others = ([found[i] for found, _ in all_of] for i in range(3))
    of = [line for _, line in all_of]
    if stated:
        print(f"\nlinks of effects that act: the stated one right {interval(sum(stated), len(stated), laboratories(of))} of {len(stated)}, among the stated and those said to be "
              f"as good {interval(sum(among), len(among), laboratories(of))}; of those {sum(others) / len(others):.1f} a time, at most {max(others)}")


def intervals(lines):
    """How often the intervals of effects that were named contain the truth; a set counts as a whole and by coefficient. Sizes and
    places apart."""
    for what in ("coefficients", "places, lengths and frequencies"):
        contained(lines, what, lambda name: is_place(name) == (what != "coefficients"))


def contained(lines, what, of):
    """The intervals of the values whose names `of` accepts."""
    inside, sets, errors, of_line = [], [], [], []
    for line in lines:
        known, found = line.get("true_values") or {}, (line.get("answer") or {}).get("estimates") or {}
        pairs = [(x, found[name]) for name, x in known.items() if of(name) and name in found and found[name][1] is not None]
        within = [low <= x <= high for x, (_, low, high) in pairs]
        inside += within
        sets += [all(within)] if within else []
        of_line += [line] if within else []
        errors += [2 * abs(value - x) / (high - low) if high > low else math.inf for x, (value, low, high) in pairs]
    if inside:
        errors.sort()
        print(f"\nintervals of {what} that contain the truth: {interval(sum(inside), len(inside), laboratories(of_line))} of {len(inside)}, all of a set {interval(sum(sets), len(sets), laboratories(of_line))} "
              f"of {len(sets)}; error over half of the interval: median {errors[len(errors) // 2]:.2f}, largest {errors[-1]:.2f}")


def main():
    parser = arguments(__doc__)
    parser.add_argument("--sets", type=int, default=50)
    parser.add_argument("--strengths", default="1.5,2,4")
    parser.add_argument("--empty", type=int, default=10)
    parser.add_argument("--case", choices=["one", "part", "two", "two of a kind"], help="only laboratories of this case")
    parser.add_argument("--only", metavar="KINDS", help="only laboratories that hide one of these, with commas: payload,load,payload + payload")
    parser.add_argument("--keep", metavar="FOLDER", help="keep the recordings and workspace of each set in this folder")
    parser.add_argument("--follow", action="store_true", help="also run the `effect add` that is proposed, and keep the error after it")
    args = parsed(parser, score)
    bench = Bench(args)
    strengths = [int(s) if float(s).is_integer() else float(s) for s in args.strengths.split(",")]
    stamp = {"body": args.body, "seed": args.seed}
    setup = bench.out / "setup.json"
    if setup.exists() and json.loads(setup.read_text()) != stamp:
        parser.error(f"{setup} is of another body or seed: {setup.read_text()}")
    setup.write_text(json.dumps(stamp))
    known = {line["index"]: line for line in bench.lines("sizes.jsonl")}
    done = {line["set"] for line in bench.lines("sets.jsonl") if "answer" in line}
    others = {line["program"] for line in bench.lines("sets.jsonl")} - {bench.digest}
    if others:
        print(f"warning: {bench.out} also holds answers of other builds ({', '.join(sorted(others))})", file=sys.stderr)
    with ThreadPoolExecutor(args.jobs) as pool:
        work = [pool.submit(bench.one, i, strengths, known, done) for i in range(args.sets)]
        work += [pool.submit(bench.empty, i, done) for i in range(args.empty)]
        for piece in work:
            piece.result()
    score([args.out])
    return None


if __name__ == "__main__":
    sys.exit(main())
