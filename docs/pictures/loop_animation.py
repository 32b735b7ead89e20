#!/usr/bin/env python3
"""Makes loop_animation.svg: the loop on a person on a safety line, as a moving picture.

    cargo build --release
    python3 docs/pictures/loop_animation.py [--aloft target/release/aloft]

Every number is what the program prints about fixtures/human_tethered; the figure is the exported motion of one jump.
Python's standard library is enough. The picture needs no script: SVG animations run wherever pictures are shown.
"""
import argparse
import csv
import html
import pathlib
import tempfile

from make import BONES, INK, LINE, PANEL, PINK, ROOT, SOFT, Drawing, Study, digits

GOOD, FAIR = "#16734a", "#965b00"
# seconds of the whole picture, and when each step begins
WHOLE, STEPS = 18.0, [0.0, 3.5, 7.0, 11.5]
# seconds and pictures of one jump
JUMP, PICTURES = 3.0, 30
MONO = "font-family=\"'DejaVu Sans Mono', Menlo, Consolas, monospace\""


def shown(begin, end=WHOLE, whole=WHOLE):
    """Makes the element visible from one time to another, again and again."""
    times, values = [0.0], ["inline" if begin == 0 else "none"]
    for at, value in ((begin, "inline"), (end, "none")):
        if 0 < at < whole:
            times.append(at / whole)
            values.append(value)
    keys = ";".join(f"{t:.4f}" for t in times)
    return (
        f'<animate attributeName="display" calcMode="discrete" dur="{whole}s" repeatCount="indefinite" '
        f'keyTimes="{keys}" values="{";".join(values)}"/>'
    )


def motion(study, folder):
    """Joint centres of one jump in pictures: `[picture][joint]`, world x and z, m; and whether it is in flight."""
    study("export", "--to", str(folder), "--format", "csv", "--trial", "jump03")
    with open(folder / "Tables" / "jump03.csv", newline="") as f:
        rows = list(csv.DictReader(f))
    flying = [r["in_flight"] in ("1", "true") for r in rows]
    start = flying.index(True)
    rate = 1 / (float(rows[1]["time [s]"]) - float(rows[0]["time [s]"]))
    first, last = max(0, start - int(0.45 * rate)), min(len(rows) - 1, start + int(1.05 * rate))
    out = []
    for k in range(PICTURES):
        i = first + (last - first) * k // (PICTURES - 1)
        row = rows[i]

        def at(name, row=row):
            return [float(next(v for key, v in row.items() if key.startswith(f"{name} {a} [")) or "nan") for a in "xz"]

        joints = {j: at(f"joint_centre {j}") for bone in BONES for j in bone}
        head = [at(f"marker {m}") for m in ("LFHD", "RFHD", "LBHD", "RBHD")]
        joints["HEAD"] = [sum(p[a] for p in head) / 4 for a in range(2)]
        for side in "LR":
            joints[f"{side}TOE"], joints[f"{side}HEE"] = at(f"marker {side}TOE"), at(f"marker {side}HEE")
        out.append((joints, flying[i]))
    return out


def figure(d, pictures, anchor):
    """The jump with the line, which `discover` suspects and `effect add` puts into the model."""
    scale, floor, left = 132.0, 388.0, 760.0
    middle = sum(p[0]["PELO"][0] for p in pictures) / len(pictures)

    def place(p):
        return left + (p[0] - middle) * scale, floor - p[1] * scale

    d.add('<clipPath id="room"><rect x="610" y="76" width="322" height="330"/></clipPath><g clip-path="url(#room)">')
    d.line([(610, floor), (932, floor)], LINE, 2)
    for k, (joints, _) in enumerate(pictures):
        begin, end = JUMP * k / PICTURES, JUMP * (k + 1) / PICTURES
        d.add("<g>" + shown(begin, end, JUMP))
        points = {j: place(p) for j, p in joints.items()}
        line = [points["PELO"], place(anchor)]
        # a line that is suspected is dashed, one in the model is drawn through
        d.add("<g>" + shown(STEPS[2], STEPS[3]))
        d.line(line, PINK, 2, "6 5")
        d.add("</g><g>" + shown(STEPS[3]))
        d.line(line, PINK, 3)
        d.add("</g>")
        for side in "LR":
            colour, thick = ("#9aa6b2", 5.0) if side == "L" else ("#465563", 6.0)
            for a, b in BONES:
                own = "L" if a[0] == "L" and a != "LUMB" or b[0] == "L" and b != "LUMB" else "R"
                if own == side:
                    d.line([points[a], points[b]], colour, thick)
            ankle = points[f"{side}AJC"]
            d.line([ankle, points[f"{side}HEE"], points[f"{side}TOE"], ankle], colour, 3.5)
        d.line([points["NECK"], points["HEAD"]], "#465563", 5)
        d.disc(*points["HEAD"], 12, "#465563")
        d.add("</g>")
    d.add("</g>")
    for begin, end, words, colour in (
        (STEPS[0], STEPS[2], "a jump on a safety line that the model does not know", SOFT),
        (STEPS[2], STEPS[3], "found missing: a tether at the pelvis", PINK),
        (STEPS[3], WHOLE, "the tether is in the model", PINK),
    ):
        d.add("<g>" + shown(begin, end))
        d.text(771, 426, words, 13, colour, "middle")
        d.add("</g>")


def terminal(d, steps):
    """Commands, one after the other, each with the line that answers."""
    d.box(28, 76, 560, 218, PANEL)
    for k, (command, answer) in enumerate(steps):
        y = 104 + 50 * k
        d.add("<g>" + shown(STEPS[k]))
        d.add(f'<text x="44" y="{y}" font-size="13.5" fill="{INK}" font-weight="bold" {MONO}>$ {html.escape(command)}</text>')
        d.text(44, y + 20, answer, 13.5, SOFT)
        d.add("</g>")


def bar(d, before, after):
    """The error as a bar that falls to the floor when the effect is added."""
    left, width, top, height = 44.0, 380.0, 340.0, 30.0
    most = 1.04 * before["held_out_error"]
    full, low, floor = (width * v / most for v in (before["held_out_error"], after["held_out_error"], after["noise_floor"]))
    d.text(28, 322, "Error in held-out flight", 14, weight="bold")
    at, fall = STEPS[3] / WHOLE, (STEPS[3] + 1.6) / WHOLE
    timing = f'dur="{WHOLE}s" repeatCount="indefinite" keyTimes="0;{at:.4f};{fall:.4f};1"'
    d.add(
        f'<rect x="{left}" y="{top}" width="{full:.1f}" height="{height}" rx="3" fill="{FAIR}">'
        f'<animate attributeName="width" {timing} values="{full:.1f};{full:.1f};{low:.1f};{low:.1f}"/>'
        f'<animate attributeName="fill" calcMode="discrete" {timing} values="{FAIR};{FAIR};{GOOD};{GOOD}"/></rect>'
    )
    low95, high95 = (width * v / most for v in after["noise_floor_ci95"])
    d.add(f'<rect x="{left + low95:.1f}" y="{top - 6}" width="{high95 - low95:.1f}" height="{height + 12}" fill="#0072b2" opacity="0.14"/>')
    d.line([(left + floor, top - 8), (left + floor, top + height + 8)], INK, 2, "5 4")
    d.text(left + floor, top + height + 26, f"noise floor {digits(after['noise_floor'])} N", 12.5, SOFT, "middle")
    for begin, end, r in ((0, STEPS[3] + 1.6, before), (STEPS[3] + 1.6, WHOLE, after)):
        words = f"{digits(r['held_out_error'])} N, {r['times_floor']:.1f} × floor"
        d.add("<g>" + shown(begin, end))
        d.text(left + width + 12, top + 20, words, 14, GOOD if r is after else FAIR, weight="bold")
        d.add("</g>")


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--aloft", default=str(ROOT / "target/release/aloft"))
    a = arguments.parse_args()
    with tempfile.TemporaryDirectory() as name:
        place = pathlib.Path(name)
        person = Study(a.aloft, place / "person", "demo_human.yaml")
        person("run")
        compared, found = person.json("compare"), person.json("discover")
        best = found["candidates"][0]
        key = found["found"][0]["key"]
        person("effect add", key)
        rungs = person.json("history")["revisions"]
        pictures = motion(person, place / "export")
    before, after = rungs[0], rungs[-1]
    anchor = {p["name"]: p["value"] for p in found["found"][0]["nonlinear"]}
    share = 100 * best["held_out_ratio"]
    d = Drawing(960, 446)
    d.text(28, 34, "From recordings to the effect that the model was missing", 18, weight="bold")
    d.text(28, 55, "Six jumps of a simulated person on a safety line (fixtures/human_tethered)", 12.5, SOFT)
    terminal(d, [
        ("aloft run demo_human.yaml", f"{compared['parameters']['flights']} flights: masses and inertias identified, held-out error {digits(before['held_out_error'])} N"),
        ("aloft compare demo_human.yaml", f"{before['times_floor']:.1f} times the error that a perfect model would leave"),
        ("aloft discover demo_human.yaml", f"{key} is missing: error falls to {share:.0f} % ({100 * best['ci95'][0]:.0f} to {100 * best['ci95'][1]:.0f} %)"),
        (f"aloft effect add demo_human.yaml '{key}'", f"error {digits(before['held_out_error'])} → {digits(after['held_out_error'])} N, {after['times_floor']:.1f} times the floor"),
    ])
    bar(d, before, after)
    figure(d, pictures, [anchor["anchor_x"], anchor["anchor_z"]])
    d.save("loop_animation.svg", "The loop: run, compare, discover, effect add; the error falls to the noise floor")


if __name__ == "__main__":
    main()
