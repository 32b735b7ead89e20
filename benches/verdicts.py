#!/usr/bin/env python3
"""How often `aloft discover` names what is hidden: fresh sets through the whole program.

Each set is a laboratory that `aloft simulate` writes (C3D files with marker noise, gaps and, for
people, soft tissue), processed by `aloft run` and asked by `aloft discover`. Kinds and sizes are
drawn from the seed; nothing is chosen by what the program finds. An answer counts as

  right        only the hidden effects are named
  class        the hidden effect is one of those named (several effects: all of them are)
  unexplained  the program says that something remains that it cannot name
  missed       "nothing missing" or "not detectable"
  wrong        something is named and the hidden effect is not among it

Of empty sets "nothing missing" and "not detectable" are right.

Sets are reported by how far the model without the effect stands above its noise floor. Usage:

  python3 benches/verdicts.py --aloft target/release/aloft --body chain --sets 40 --empty 10 --seed 1
"""

import argparse
import json
import math
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def unit(rng):
    x = [rng.gauss(0, 1) for _ in range(3)]
    n = math.sqrt(sum(a * a for a in x))
    return [a / n for a in x]


def times(direction, size):
    return [round(a * size, 5) for a in direction]


def chain_effect(rng):
    """One hidden effect on the thrown chain: the scenario's entry and the names that are right."""
    link = rng.choice(["link0", "link1"])
    kind = rng.choice(["quadratic_drag", "linear_drag", "rotational_drag", "wind", "constant_force", "gravity_tilt",
                       "tether", "crane", "flywheel", "rotor", "thrust", "added_mass", "payload"])
    size = math.exp(rng.uniform(math.log(0.5), math.log(2)))
    anchor = [round(rng.uniform(-1.5, 1.5), 3), round(rng.uniform(-1.5, 1.5), 3), round(rng.uniform(2.0, 3.0), 3)]
    point = [round(rng.uniform(-0.1, 0.1), 3), 0.0, 0.0]
    entry = {
        "quadratic_drag": {"drag_area_m2": 0.03 * size},
        "linear_drag": {"coefficient_nspm": 0.05 * size},
        "rotational_drag": {"coefficient_nmsprad": 0.0006 * size},
        "wind": {"velocity_mps": times(unit(rng), 2 * size), "drag_area_m2": 0.03},
        "constant_force": {"link": link, "point_m": point, "force_n": times(unit(rng), 0.15 * size)},
        "gravity_tilt": {"about_x_deg": round(1.5 * size * rng.choice([-1, 1]), 3), "about_y_deg": round(rng.uniform(-1, 1), 3)},
        "tether": {"link": link, "anchor_m": anchor, "rest_length_m": 0.5, "stiffness_npm": 0.2 * size},
        "crane": {"link": link, "pulley_m": anchor, "tension_n": 0.3 * size},
        "flywheel": {"link": link, "momentum_nms": times(unit(rng), 0.004 * size)},
        "rotor": {"link": link, "axis": unit(rng), "mean_nms": 0.003 * size, "swing_nms": 0.003 * size, "frequency_hz": 3.0},
        "thrust": {"link": link, "point_m": point, "force_n": times(unit(rng), 0.2 * size)},
        "added_mass": {"link": link, "mass_kg": 0.03 * size},
        "payload": {"link": link, "point_m": point, "mass_kg": 0.03 * size},
    }[kind]
    return {"effect": kind, **entry}, {kind}


def human_effect(rng):
    """The same on a person who jumps."""
    limb = rng.choice(["hand_r", "hand_l", "forearm_r", "shank_l", "thigh_r", "torso", "pelvis"])
    kind = rng.choice(["tether", "constant_force", "crane", "payload", "payload", "load", "wind", "gravity_tilt",
                       "plate_time_offset", "plate_gain", "body_mass", "gravity_scale"])
    size = math.exp(rng.uniform(math.log(0.5), math.log(2)))
    anchor = [round(rng.uniform(-1, 1), 3), round(rng.uniform(-1, 1), 3), round(rng.uniform(2.5, 3.5), 3)]
    load = {"link": limb, "mass_kg": 1.5 * size}
    entry, names = {
        "tether": ({"link": "pelvis", "anchor_m": anchor, "rest_length_m": 1.0, "stiffness_npm": 40 * size}, None),
        "constant_force": ({"link": limb, "force_n": times(unit(rng), 15 * size)}, None),
        "crane": ({"link": "pelvis", "pulley_m": anchor, "tension_n": 40 * size}, None),
        "payload": ({**load, "trials": ["jump05", "jump06", "jump07", "jump08"]}, None),
        "load": (load, {"link_mass", "payload"}),
        "wind": ({"velocity_mps": times([1, rng.uniform(-1, 1), 0], 4 * size), "drag_area_m2": 0.5}, None),
        "gravity_tilt": ({"about_x_deg": round(1.0 * size, 3), "about_y_deg": round(rng.uniform(-1, 1), 3)}, None),
        "plate_time_offset": ({"offset_s": round(0.006 * size * rng.choice([-1, 1]), 5)}, None),
        "plate_gain": ({"plate": 1, "gain": [1.0 + 0.04 * size] * 6}, None),
        "body_mass": ({"error_kg": round(2.5 * size * rng.choice([-1, 1]), 3)}, {"body_mass", "plate_gain"}),
        "gravity_scale": ({"factor": round(1 + 0.02 * size * rng.choice([-1, 1]), 5)}, None),
    }[kind]
    return {"effect": "payload" if kind == "load" else kind, **entry}, names or {kind}


def draw(body, rng, index):
    """A scenario for each of one or two folders, and what is hidden: a list of sets of right names."""
    if body == "chain":
        base = {"kind": "chain"}
        case = rng.choice(["one", "one", "one", "one", "two", "part"])
        one, names = chain_effect(rng)
        if one["effect"] == "payload" or case == "part":
            return [(base, [one]), (base, [])], [names], "part"
        if case == "two":
            other, more = chain_effect(rng)
            # wind contains drag in still air: two of them are one
            air = {"wind", "quadratic_drag", "linear_drag"}
            if other["effect"] not in ("payload", one["effect"]) and not {one["effect"], other["effect"]} <= air:
                return [(base, [one, other])], [names, more], "two"
        return [(base, [one])], [names], "one"
    person = {"sex": rng.choice("MF"), "height_m": round(rng.uniform(1.55, 1.9), 3), "mass_kg": round(rng.uniform(52, 90), 1)}
    base = {"kind": "human", "person": person, "protocol": {"jumps": 8, "exercises": 2}}
    one, names = human_effect(rng)
    if rng.random() < 0.15:
        mass = round(rng.uniform(0.8, 1.6), 2)
        pair = [{"effect": "payload", "link": l, "mass_kg": mass, "trials": ["jump01", "jump03", "jump05", "jump07"]}
                for l in rng.choice([("shank_l", "shank_r"), ("forearm_l", "forearm_r"), ("thigh_l", "thigh_r")])]
        return [(base, pair)], [{"payload"}], "two of a kind"
    return [(base, [one])], [names], "one"


def call(aloft, *args):
    return subprocess.run([aloft, *map(str, args)], capture_output=True, text=True)


def prepare(aloft, place, scenarios, seed):
    """The folder of recordings; of two scenarios, recordings 1-2 of the first and 3-5 of the second."""
    folders = []
    for k, (body, hidden, *capture) in enumerate(scenarios):
        file, out = place / f"scenario{k}.yaml", place / f"data{k}"
        scenario = {"name": f"set{k}", "seed": seed, "body": body, "hidden": hidden}
        file.write_text(json.dumps({**scenario, "capture": capture[0]} if capture else scenario))
        done = call(aloft, "simulate", file, "--out", out)
        if done.returncode:
            raise RuntimeError(done.stderr[-500:])
        folders.append(out)
    if len(folders) == 2:
        for name in ("throws_01", "throws_02"):
            for file in folders[0].glob(f"{name}*"):
                shutil.copy(file, folders[1] / file.name)
        return folders[1]
    return folders[0]


def judge(found, truth):
    named = set(found["effects"])
    if found["verdict"] == "unexplained":
        return "unexplained"
    if not truth:
        return "wrong" if named else "right"
    if not named:
        return "missed"
    if all(named & right for right in truth):
        extra = named - set().union(*truth)
        return "right" if not extra else "class"
    return "wrong"


def interval(k, n):
    """95 % interval of a share, Wilson."""
    if n == 0:
        return "–"
    p, z = k / n, 1.96
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return f"{100 * p:.0f} % ({100 * max(middle - half, 0):.0f}-{100 * min(middle + half, 1):.0f})"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--aloft", default=str(ROOT / "target/release/aloft"))
    parser.add_argument("--body", choices=["chain", "human"], default="chain")
    parser.add_argument("--sets", type=int, default=40)
    parser.add_argument("--empty", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    pipeline = ROOT / f"pipelines/{args.body}.yaml"
    rows = []
    for i in range(args.sets + args.empty):
        rng = random.Random(f"{args.body} {args.seed} {i}")
        scenarios, truth, kind = draw(args.body, rng, i)
        if i >= args.sets:
            scenarios, truth, kind = [(scenarios[0][0], [])], [], "empty"
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            try:
                data = prepare(args.aloft, place, scenarios, 1_000_000 + args.seed * 1000 + i)
                at = ["--data", data, "--workspace", place / "ws"]
                call(args.aloft, "run", pipeline, *at)
                found = json.loads(call(args.aloft, "discover", pipeline, *at, "--json").stdout)
            except (RuntimeError, json.JSONDecodeError) as problem:
                print(f"{i:3d} not usable: {problem}", file=sys.stderr)
                continue
        above = (found["held_out_error"] or 0) / found["noise_floor"] if found["noise_floor"] else float("nan")
        left = (found["held_out_error_after"] or 0) / found["noise_floor"] if found["noise_floor"] else float("nan")
        outcome = judge(found, truth)
        rows.append((kind, outcome, above))
        hidden = ", ".join(h["effect"] + ("[" + h["link"] + "]" if "link" in h else "") for _, hs in scenarios for h in hs)
        keys = ", ".join(f["key"] + (f" in {len(f['trials'])}" if f["trials"] else "") for f in found["found"])
        print(f"{i:3d} {kind:13s} {outcome:11s} hidden: {hidden or '-':45s} said: {found['verdict']} {','.join(found['effects'])} "
              f"[{keys}] {above:.1f} -> {left:.1f} x floor", flush=True)
    print()
    outcomes = ["right", "class", "unexplained", "missed", "wrong"]
    hidden = [r for r in rows if r[0] != "empty"]
    groups = [("hidden, all", hidden)]
    groups += [(f"  {k}", [r for r in hidden if r[0] == k]) for k in sorted({r[0] for r in hidden})]
    groups += [("  above 2 floors", [r for r in hidden if r[2] > 2])]
    groups += [("empty", [r for r in rows if r[0] == "empty"])]
    print(f"{'':18s} {'sets':>4s} " + " ".join(f"{o:>16s}" for o in outcomes))
    for name, of in groups:
        print(f"{name:18s} {len(of):4d} " + " ".join(f"{interval(sum(r[1] == o for r in of), len(of)):>16s}" for o in outcomes))


if __name__ == "__main__":
    main()
