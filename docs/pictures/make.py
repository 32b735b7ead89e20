#!/usr/bin/env python3
"""Makes the pictures of the book from what the program prints about the recordings in `fixtures/`.

    cargo build --release
    python3 docs/pictures/make.py [--aloft target/release/aloft] [--png FOLDER]

Writes loop.svg, skeleton.svg, ladder.svg, residual_map.svg and noise_units.svg beside this file; `--png` also
renders each with headless Chromium, for looking at. Python's standard library is enough. Results of the runs
lie in a temporary folder. Two of the bodies of noise_units.svg are not in this repository: noise_units.json has
what `aloft run` wrote for each (`noise_units` of identify/_study/parameters_weak.json), and `--drawn-only`
draws it without running anything.
"""
import argparse
import csv
import html
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
INK, SOFT, LINE, PANEL = "#1b2733", "#5c6873", "#d5dbe1", "#f4f6f8"
BLUE, ORANGE, GREEN, PINK = "#0b6fa4", "#c65a11", "#118a5a", "#b5346c"
FONT = "font-family=\"Helvetica, Arial, 'DejaVu Sans', sans-serif\""


class Drawing:
    """An SVG with a white ground, in pixels."""

    def __init__(self, width, height):
        self.width, self.height, self.parts = width, height, []

    def add(self, text):
        self.parts.append(text)

    def text(self, x, y, words, size=13, fill=INK, anchor="start", weight="normal", turn=0, mono=False):
        family = "font-family=\"'DejaVu Sans Mono', Menlo, Consolas, monospace\"" if mono else FONT
        turned = f' transform="rotate({turn} {x:.1f} {y:.1f})"' if turn else ""
        self.add(
            f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" fill="{fill}" text-anchor="{anchor}" '
            f'font-weight="{weight}" {family}{turned}>{html.escape(words)}</text>'
        )

    def box(self, x, y, w, h, fill="white", stroke=LINE, radius=6, width=1.2):
        self.add(
            f'<rect x="{x:.1f}" y="{y:.1f}" width="{w:.1f}" height="{h:.1f}" rx="{radius}" fill="{fill}" '
            f'stroke="{stroke}" stroke-width="{width}"/>'
        )

    def line(self, points, stroke=INK, width=1.5, dash="", cap="round"):
        dashes = f' stroke-dasharray="{dash}"' if dash else ""
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self.add(
            f'<polyline points="{path}" fill="none" stroke="{stroke}" stroke-width="{width}" '
            f'stroke-linecap="{cap}" stroke-linejoin="round"{dashes}/>'
        )

    def disc(self, x, y, r, fill, stroke="none"):
        self.add(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r}" fill="{fill}" stroke="{stroke}"/>')

    def arrow(self, x0, y0, x1, y1, stroke=SOFT, width=2.0, head=7.0):
        """A straight arrow from (x0, y0) to (x1, y1)."""
        length = ((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5
        if length < 1e-9:
            return
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        head = min(head, length)
        bx, by = x1 - ux * head, y1 - uy * head
        self.line([(x0, y0), (bx, by)], stroke, width, cap="butt")
        wing = head * 0.45
        self.add(
            f'<polygon points="{x1:.1f},{y1:.1f} {bx - uy * wing:.1f},{by + ux * wing:.1f} '
            f'{bx + uy * wing:.1f},{by - ux * wing:.1f}" fill="{stroke}"/>'
        )

    def save(self, name, title):
        body = "\n".join(self.parts)
        text = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}" '
            f'width="{self.width}" height="{self.height}" role="img" aria-label="{html.escape(title)}">\n'
            f"<title>{html.escape(title)}</title>\n"
            f'<rect width="{self.width}" height="{self.height}" rx="8" fill="white"/>\n{body}\n</svg>\n'
        )
        path = HERE / name
        path.write_text(text)
        print(f"{path.relative_to(ROOT)}: {len(text) / 1000:.0f} kB")


class Study:
    """A pipeline of the repository with a folder of results of its own."""

    def __init__(self, aloft, folder, pipeline, data=None):
        self.aloft = aloft
        self.options = ["--workspace", str(folder)] + (["--data", str(ROOT / data)] if data else [])
        self.pipeline = str(ROOT / "pipelines" / pipeline)

    def __call__(self, command, *words):
        call = [self.aloft, *command.split(), self.pipeline, *words, *self.options]
        done = subprocess.run(call, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.exit(f"{' '.join(call)}\n{done.stderr}")
        return done.stdout

    def json(self, command):
        return json.loads(self(command, "--json"))


def digits(value):
    """Three significant digits, as the program's tables have them."""
    return f"{value:#.3g}".rstrip(".")


def loop(before, discovery, history):
    """The commands in the order of use, each with its answer on the demonstration."""
    d = Drawing(960, 298)
    start, last = history["revisions"][0], history["revisions"][-1]
    best = next(c for c in discovery["candidates"] if c["effect"].startswith("quadratic_drag"))
    steps = [
        ("run", ["recordings to", "parameters"], [f"{before['parameters']['flights']} flights of a", "two-link chain"]),
        ("compare", ["where the", "model fails"], [f"error {digits(start['held_out_error'])} N,", f"{start['times_floor']:.1f} × noise floor"]),
        ("discover", ["which effect", "is missing"], [best["effect"].split("[")[0], f"error falls to {100 * best['held_out_ratio']:.0f} %"]),
        ("effect add", ["put it into", "the model"], [f"{digits(start['held_out_error'])} → {digits(last['held_out_error'])} N", ""]),
        ("history", ["revisions and", "their errors"], [f"{last['times_floor']:.1f} × noise floor:", "at the floor"]),
        ("report", ["one HTML page", "with everything"], ["charts, tables,", "3-D player"]),
    ]
    w, gap, top, h = 132, 24, 78, 92
    left = (960 - 6 * w - 5 * gap) / 2
    d.text(left, 34, "The loop", 18, weight="bold")
    d.text(left, 55, "Each command with its answer on the recordings in fixtures/demo, a chain thrown through air; the model starts without air resistance", 12.5, SOFT)
    for i, (name, what, answer) in enumerate(steps):
        x = left + i * (w + gap)
        inner = 1 <= i <= 3
        d.box(x, top, w, h, fill="#e8f2f8" if inner else PANEL, stroke=BLUE if inner else LINE)
        d.text(x + w / 2, top + 27, f"aloft {name}", 13, BLUE if inner else INK, "middle", "bold", mono=True)
        for k, words in enumerate(what):
            d.text(x + w / 2, top + 52 + 18 * k, words, 13, INK, "middle")
        if i < 5:
            d.arrow(x + w + 3, top + h / 2, x + w + gap - 3, top + h / 2)
        for k, words in enumerate(answer):
            d.text(x + w / 2, top + h + 24 + 17 * k, words, 12.5, ORANGE, "middle", "bold" if k == 0 else "normal")
    # back from `effect add` to `compare`
    x0, x1, y = left + 3 * (w + gap) + w / 2, left + (w + gap) + w / 2, top + h + 52
    d.line([(x0, y), (x0, y + 34), (x1, y + 34), (x1, y + 12)], BLUE, 2)
    d.arrow(x1, y + 16, x1, y + 1, BLUE, 2)
    d.text((x0 + x1) / 2, y + 54, "again, until discover finds nothing more", 13, BLUE, "middle")
    d.save("loop.svg", "The loop: run, compare, discover, effect add, and again; history and report show the result")


BONES = [
    ("PELO", "LUMB"), ("LUMB", "NECK"), ("NECK", "RSJC"), ("RSJC", "REJC"), ("REJC", "RWJC"), ("NECK", "LSJC"), ("LSJC", "LEJC"),
    ("LEJC", "LWJC"), ("RHJC", "LHJC"), ("RHJC", "RKJC"), ("RKJC", "RAJC"), ("LHJC", "LKJC"), ("LKJC", "LAJC"), ("PELO", "RHJC"),
    ("PELO", "LHJC"),
]


def skeleton(study, folder):
    """Instants of a jump: joint centres, markers, and the force from the ground, measured and computed from the identified model."""
    study("export", "--to", str(folder), "--format", "csv", "--trial", "jump01")
    with open(folder / "Tables" / "jump01.csv", newline="") as f:
        rows = list(csv.DictReader(f))

    def vector(row, name):
        values = [next(v for k, v in row.items() if k.startswith(f"{name} {a} [")) for a in "xyz"]
        return [float(v) if v else float("nan") for v in values]

    def total(row, name):
        return [sum(vector(row, f"{name} {p}")[a] for p in ("FP1", "FP2")) for a in range(3)]

    upward = [total(r, "ground_force")[2] for r in rows]
    flights, inside = [], False
    for i, r in enumerate(rows):
        flying = r["in_flight"] in ("1", "true")
        if flying and not inside:
            flights.append([i, i])
        if flying:
            flights[-1][1] = i
        inside = flying
    start, end = flights[0]
    height = [vector(r, "centre_of_mass whole_body")[2] for r in rows]
    low = min(range(start), key=lambda i: height[i])
    push = max(range(low, start), key=lambda i: upward[i])
    land = max(range(end, min(end + 60, len(rows))), key=lambda i: upward[i])
    apex = max(range(start, end), key=lambda i: height[i])
    shown = [
        (max(low - 25, 0), "lowering"), (low, "lowest point"), (push, "push-off"), (apex, "flight"), (end - 2, "before landing"),
        (land, "landing"),
    ]
    d = Drawing(960, 488)
    d.text(28, 34, "A jump: model, markers and the force from the ground", 18, weight="bold")
    d.text(28, 55, "Simulated person of fixtures/human_twin, jump01, seen from the right; masses identified from flights alone", 12.5, SOFT)
    scale, floor, step = 128.0, 398.0, 150.0
    d.line([(28, floor), (932, floor)], LINE, 2)
    per_newton = 0.052
    for n, (i, words) in enumerate(shown):
        row = rows[i]
        middle = vector(row, "joint_centre PELO")
        x0 = 105 + n * step

        def place(p, x0=x0, middle=middle):
            return x0 + (p[0] - middle[0]) * scale, floor - p[2] * scale

        measured = total(row, "ground_force")
        residual = vector(row, "residual_force pelvis")
        needed = [m + r for m, r in zip(measured, residual)]
        weight = [vector(row, f"ground_force {p}")[2] for p in ("FP1", "FP2")]
        cop = [vector(row, f"centre_of_pressure {p}") for p in ("FP1", "FP2")]
        if sum(weight) > 50:
            point = [sum(w * c[a] for w, c in zip(weight, cop) if c[a] == c[a]) / sum(weight) for a in range(3)]
            x, y = place([point[0], 0, 0])
            for force, colour, dx, thick in ((measured, GREEN, -3, 4.0), (needed, PINK, 3, 2.4)):
                d.arrow(x + dx, y, x + dx + force[0] * per_newton, y - force[2] * per_newton, colour, thick, 12)
        joints = {j: place(vector(row, f"joint_centre {j}")) for bone in BONES for j in bone}
        for side in "LR":  # far side first
            colour, thick = ("#9aa6b2", 5.0) if side == "L" else ("#465563", 6.0)
            for a, b in BONES:
                own = "L" if a[0] == "L" and a != "LUMB" or b[0] == "L" and b not in ("LUMB",) else "R"
                if own == side:
                    d.line([joints[a], joints[b]], colour, thick)
            toe, heel = (place(vector(row, f"marker {side}{m}")) for m in ("TOE", "HEE"))
            ankle = joints[f"{side}AJC"]
            d.line([ankle, heel, toe, ankle], colour, 3.5)
        head = [vector(row, f"marker {m}") for m in ("LFHD", "RFHD", "LBHD", "RBHD")]
        x, y = place([sum(p[a] for p in head) / 4 for a in range(3)])
        d.line([joints["NECK"], (x, y)], "#465563", 5)
        d.disc(x, y, 13, "#465563")
        for name in sorted({k.split(" ")[1] for k in row if k.startswith("marker ")}):
            p = vector(row, f"marker {name}")
            if p[0] == p[0]:
                d.disc(*place(p), 2.2, ORANGE)
        x, y = place(vector(row, "centre_of_mass whole_body"))
        d.disc(x, y, 5.5, "white", INK)
        d.add(f'<path d="M{x:.1f},{y:.1f} v-5.5 a5.5,5.5 0 0,1 5.5,5.5 z m0,0 v5.5 a5.5,5.5 0 0,1 -5.5,-5.5 z" fill="{INK}"/>')
        time = float(row["time [s]"])
        d.text(x0, floor + 21, words, 13, INK, "middle", "bold")
        d.text(x0, floor + 40, f"{time:.2f} s", 12, SOFT, "middle")
        d.text(x0, floor + 58, f"measured {max(measured[2], 0):.0f} N", 12, GREEN, "middle")
        d.text(x0, floor + 75, f"model {needed[2]:.0f} N".replace("-", "−"), 12, PINK, "middle")
    x = 610
    for colour, words, y in ((GREEN, "force measured by the plates", 84), (PINK, "force computed from motion and identified masses", 104)):
        d.arrow(x, y - 4, x + 30, y - 4, colour, 3.2, 10)
        d.text(x + 38, y, words, 12.5)
    d.disc(x + 4, 120, 2.6, ORANGE)
    d.text(x + 14, 124, "markers", 12.5)
    d.disc(x + 92, 120, 5, "white", INK)
    d.add(f'<path d="M{x + 92},120 v-5 a5,5 0 0,1 5,5 z m0,0 v5 a5,5 0 0,1 -5,-5 z" fill="{INK}"/>')
    d.text(x + 104, 124, "centre of mass", 12.5)
    d.save("skeleton.svg", "Stick figures of a jump with measured and computed ground reaction force")


def ladder(panels):
    """Held-out error of each revision beside the noise floor."""
    d = Drawing(960, 400)
    d.text(28, 34, "The revisions of a model and their held-out error", 18, weight="bold")
    d.text(28, 55, "Root mean square over weak windows of flights that took no part in the fit; the command aloft history prints the same numbers", 12.5, SOFT)
    for n, (title, history) in enumerate(panels):
        left, top, w, h = 84 + n * 470, 108, 370, 206
        revisions = history["revisions"]
        most = 1.18 * max(r["held_out_error"] for r in revisions)

        def y(value, most=most, top=top, h=h):
            return top + h * (1 - value / most)

        d.text(left - 56, top - 18, title, 13.5, weight="bold")
        step = 10 ** int(f"{most / 4:e}".split("e")[1])
        step *= next(k for k in (1, 2, 5, 10) if most / (k * step) <= 5.5)
        tick = 0.0
        while tick < most:
            d.line([(left, y(tick)), (left + w, y(tick))], LINE, 1)
            d.text(left - 8, y(tick) + 4, f"{tick:g}" if tick else "0", 12, SOFT, "end")
            tick = round(tick + step, 9)
        d.text(left - 46, top + h / 2, "held-out error, N", 12, SOFT, "middle", turn=-90)
        floor, interval = revisions[-1]["noise_floor"], revisions[-1]["noise_floor_ci95"]
        d.add(
            f'<rect x="{left}" y="{y(interval[1]):.1f}" width="{w}" height="{y(interval[0]) - y(interval[1]):.1f}" '
            f'fill="{GREEN}" opacity="0.16"/>'
        )
        each = w / len(revisions)
        for k, r in enumerate(revisions):
            x, error = left + (k + 0.5) * each, r["held_out_error"]
            colour = BLUE if r["at_floor"] else ORANGE
            d.add(f'<rect x="{x - 44:.1f}" y="{y(error):.1f}" width="88" height="{y(0) - y(error):.1f}" fill="{colour}" opacity="0.9"/>')
            times = f"{r['times_floor']:.1f} × floor" + (", at the floor" if r["at_floor"] else "")
            d.text(x, y(error) - 22, f"{digits(error)} N", 14, INK, "middle", "bold")
            d.text(x, y(error) - 7, times, 12, SOFT, "middle")
            d.text(x, top + h + 20, f"revision {r['revision']}", 12.5, INK, "middle", "bold")
            what = "model without effects" if not r["effects"] else "with " + ", ".join(r["effects"])
            d.text(x, top + h + 38, what, 12, SOFT, "middle")
        d.line([(left, y(floor)), (left + w, y(floor))], GREEN, 2, "6 4")
        d.text(left + w + 4, y(floor) + 4, digits(floor), 12, GREEN)
    d.line([(28, 384), (58, 384)], GREEN, 2, "6 4")
    d.text(66, 388, "noise floor, with its 95 % interval: the error that a perfect model would leave on these recordings", 12.5, SOFT)
    d.save("ladder.svg", "Held-out error before and after adding the missing effect, beside the noise floor")


def shade(ratio):
    """White at the noise floor, dark blue at eight times it."""
    from math import log2

    t = min(max(log2(max(ratio, 1.0)) / 3, 0.0), 1.0)
    stops = [(255, 255, 255), (190, 215, 235), (94, 154, 203), (22, 88, 142), (8, 48, 96)]
    k = min(int(t * 4), 3)
    f = t * 4 - k
    return "#%02x%02x%02x" % tuple(round(a + (b - a) * f) for a, b in zip(stops[k], stops[k + 1])), t


def residual_map(before, after):
    """Error over windows as a multiple of the noise floor, by group and axis, before and after the effect was added."""
    kinds = [("trial", "recording"), ("speed", "speed of the centre of mass"), ("turning", "angular velocity"),
             ("time_in_flight", "part of the flight")]
    d = Drawing(960, 622)
    d.text(28, 34, "Where the error lies: residual map of the demonstration", 18, weight="bold")
    d.text(28, 55, "Mean absolute error over weak windows in flight, as a multiple of the noise floor of the same windows; world axes, z up", 12.5, SOFT)
    axes = ["force x", "force y", "force z", "moment x", "moment y", "moment z"]
    cell, tall, top = 53, 25, 118
    for n, (title, comparison) in enumerate((("start: no effect", before), ("with quadratic_drag", after))):
        left = 244 + n * 362
        d.text(left, top - 34, title, 14, ORANGE if n == 0 else BLUE, weight="bold")
        for a, words in enumerate(axes):
            d.text(left + (a + 0.5) * cell, top - 8, words, 11, SOFT, "middle")
        floors = {(g["by"], g["name"]): g for g in comparison["noise_floor"]["groups"]}
        y = top
        for kind, heading in kinds:
            if n == 0:
                d.text(28, y + 16, heading, 12.5, weight="bold")
            y += 24
            for group in comparison["breakdown"]:
                if group["by"] != kind or group["windows"]["windows"] < 10:
                    continue
                floor = floors[(group["by"], group["name"])]
                if n == 0:
                    d.text(left - 10, y + 17, group["name"], 12, INK, "end")
                for a in range(6):
                    which, axis = ("force_n", a) if a < 3 else ("moment_nm", a - 3)
                    ratio = group["windows"][which]["mae"][axis] / floor["windows"][which]["mae"][axis]
                    colour, t = shade(ratio)
                    d.add(f'<rect x="{left + a * cell}" y="{y}" width="{cell - 1.5}" height="{tall - 1.5}" fill="{colour}" stroke="{LINE}" stroke-width="0.5"/>')
                    d.text(left + (a + 0.5) * cell, y + 16.5, f"{ratio:.1f}", 11.5, "white" if t > 0.5 else INK, "middle")
                y += tall
            y += 6
    x, y = 244, 592
    for k in range(61):
        d.add(f'<rect x="{x + 4 * k}" y="{y}" width="4.5" height="13" fill="{shade(2 ** (k / 20))[0]}"/>')
    d.add(f'<rect x="{x}" y="{y}" width="244" height="13" fill="none" stroke="{LINE}"/>')
    for k, words in enumerate(("1", "2", "4", "8")):
        d.text(x + 81.3 * k, y - 4, words, 11.5, SOFT, "middle")
    d.text(x + 262, y + 11, "times the noise floor", 12, SOFT)
    d.save("residual_map.svg", "Residual map before and after adding air resistance")


def noise_units(bodies):
    """Singular values of the rows in units of their noise, one line of marks for each body."""
    from math import log10

    d = Drawing(960, 366)
    left, right, top, tall = 210, 936, 92, 74
    low, high = log10(0.3), log10(1000)

    def x(value):
        return left + (right - left) * (log10(value) - low) / (high - low)

    d.text(28, 34, "What a motion determines: singular values of the rows in units of their noise", 18, weight="bold")
    d.text(28, 55, "Each mark is one direction of the base parameters; in the shaded range it cannot be told from noise", 12.5, SOFT)
    bottom = top + tall * len(bodies)
    for decade in (0.3, 1, 3, 10, 30, 100, 300, 1000):
        d.line([(x(decade), top), (x(decade), bottom)], LINE, 1)
        d.text(x(decade), bottom + 18, f"{decade:g}", 12, SOFT, "middle")
    d.text((left + right) / 2, bottom + 38, "singular value, noise = 1 (logarithmic)", 12.5, SOFT, "middle")
    for n, body in enumerate(bodies):
        y = top + tall * n
        # variance below 1 + 0.5 / 0.3 times what the estimate leaves, never less than the noise itself
        limit = (max(body["residual"], 1.0) ** 2 * (1 + 0.5 / 0.3)) ** 0.5
        d.add(f'<rect x="{left}" y="{y}" width="{x(limit) - left:.1f}" height="{tall}" fill="{ORANGE}" opacity="0.13"/>')
        d.line([(left, y + tall), (right, y + tall)], LINE, 1)
        d.text(28, y + 24, body["body"], 13, weight="bold")
        recordings = body["recordings"].split(";")[0].split(", ")
        for k, words in enumerate(recordings):
            d.text(28, y + 42 + 16 * k, words, 12, SOFT)
        for value in body["sigma"]:
            colour, thick = (ORANGE, 3) if value < limit else (BLUE, 1.8)
            d.line([(x(value), y + 32), (x(value), y + 62)], colour, thick, cap="butt")
        at_noise = sum(value < limit for value in body["sigma"])
        assert at_noise == body["undetermined"] + 1, "the estimate itself is one of the directions at the noise"
        d.text(x(limit) + 8, y + 21, f"{at_noise} of {len(body['sigma'])} at the noise: {body['at_noise']}", 12.5, ORANGE, weight="bold")
    d.save("noise_units.svg", "Singular values in units of noise for a chain, a rigid body and a person")


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--aloft", default=str(ROOT / "target/release/aloft"))
    arguments.add_argument("--png", type=pathlib.Path)
    arguments.add_argument("--drawn-only", action="store_true", help="only what needs no run of the program")
    a = arguments.parse_args()
    noise_units(json.loads((HERE / "noise_units.json").read_text()))
    if not a.drawn_only:
        run_and_draw(a)
    if a.png:
        render(a.png)


def run_and_draw(a):
    """Pictures of the demonstrations."""
    with tempfile.TemporaryDirectory() as name:
        place = pathlib.Path(name)
        chain = Study(a.aloft, place / "chain", "demo.yaml")
        chain("run")
        before, discovery = chain.json("compare"), chain.json("discover")
        chain("effect add", "quadratic_drag")
        after, history = chain.json("compare"), chain.json("history")
        person = Study(a.aloft, place / "person", "demo_human.yaml")
        person("run")
        person("discover")
        person("effect add", "tether")
        twin = Study(a.aloft, place / "twin", "demo_human.yaml", "fixtures/human_twin")
        twin("run")
        loop(before, discovery, history)
        skeleton(twin, place / "export")
        ladder([("A thrown chain with air resistance (fixtures/demo)", history),
                ("A person on a safety line (fixtures/human_tethered)", person.json("history"))])
        residual_map(before, after)


def render(folder):
    """Every picture as PNG, by headless Chromium."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome") or sys.exit("no chromium")
    folder.mkdir(parents=True, exist_ok=True)
    for svg in sorted(HERE.glob("*.svg")):
        width, height = (svg.read_text().split(f'{k}="')[1].split('"')[0] for k in (" width", " height"))
        subprocess.run(
            [chromium, "--headless", "--no-sandbox", "--disable-gpu", f"--window-size={width},{height}", "--hide-scrollbars",
             f"--screenshot={folder / (svg.stem + '.png')}", svg.as_uri()],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=120, check=False)


if __name__ == "__main__":
    main()
