"""Writes fixtures/osim: an OpenSim model of a body, and recordings of its flights that OpenSim simulated.

OpenSim 4.6 integrates the equations of motion of `truth/true.osim`: joints on springs, nothing but gravity from
outside. Its markers, with noise of 0.3 mm, are the recordings. `body.osim` is what a laboratory would have: the same
geometry and markers, other inertias (masses of segments off by up to 15 %, centres of mass by up to 12 mm, inertias
by up to 20 %), the same total mass.

    tests/peers/.venv/bin/python tests/peers/osim_fixture.py
"""
import math
import pathlib
import random

import opensim

FOLDER = pathlib.Path(__file__).resolve().parents[2] / "fixtures/osim"
RATE_HZ, SECONDS, NOISE_M = 100.0, 0.7, 0.0003

# name: mass, centre of mass, principal radii of gyration (x, y, z)
BODIES = {
    "pelvis": (11.0, (-0.02, 0.02, 0.0), (0.085, 0.095, 0.08)),
    "torso": (33.0, (-0.01, 0.26, 0.0), (0.175, 0.11, 0.165)),
    "arm_r": (3.1, (0.0, -0.22, 0.0), (0.13, 0.03, 0.13)),
    "hand_r": (0.5, (0.0, -0.07, 0.0), (0.042, 0.02, 0.04)),
    "thigh_r": (8.6, (0.0, -0.17, 0.0), (0.12, 0.055, 0.125)),
    "patella_r": (0.1, (0.002, 0.0, 0.0), (0.015, 0.015, 0.015)),
    "shank_r": (3.2, (0.0, -0.18, 0.0), (0.105, 0.035, 0.106)),
    "foot_r": (0.9, (0.05, -0.03, 0.0), (0.03, 0.06, 0.058)),
    "toes_r": (0.2, (0.03, 0.0, 0.0), (0.015, 0.025, 0.025)),
}
MARKERS = {
    "pelvis": {"ASIS": (0.08, 0.03, 0.12), "PSIS": (-0.12, 0.04, 0.05)},
    "torso": {"SHO": (0.0, 0.44, 0.17), "CHEST": (0.11, 0.28, 0.06), "BACK": (-0.13, 0.33, 0.05)},
    "arm_r": {"ARM": (0.05, -0.12, 0.03), "ELB": (0.0, -0.28, 0.05)},
    "hand_r": {"WRI": (0.02, -0.01, 0.03), "FIN": (0.0, -0.11, 0.02)},
    "thigh_r": {"THI": (0.07, -0.2, 0.05), "KNE": (0.0, -0.4, 0.06), "KNM": (0.0, -0.4, -0.05)},
    "shank_r": {"TIB": (0.05, -0.15, 0.04), "ANK": (0.0, -0.4, 0.04), "SHI": (0.05, -0.28, -0.02)},
    "foot_r": {"FOOT": (0.12, -0.03, 0.03), "HEE": (-0.05, -0.04, 0.0)},
    "toes_r": {"TOE": (0.05, 0.01, 0.0)},
}


def sides(name):
    return [name] if not name.endswith("_r") else [name, name[:-2] + "_l"]


def mirrored(v, name):
    return (v[0], v[1], -v[2]) if name.endswith("_l") else v


def numbers(v):
    return " ".join(repr(round(x, 9)) for x in v)


def body(name, mass, com, radii, spread):
    if spread:
        mass *= 1 + 0.15 * spread.uniform(-1, 1)
        com = tuple(c + 0.012 * spread.uniform(-1, 1) for c in com)
        radii = tuple(r * (1 + 0.1 * spread.uniform(-1, 1)) for r in radii)
    return name, mass, mirrored(com, name), [mass * r * r for r in radii]


def bodies(spread):
    out = [body(side, *values, spread) for name, values in BODIES.items() for side in sides(name)]
    total = sum(b[1] for b in out)
    scale = 72.0 / total
    return [(n, m * scale, c, [i * scale for i in moments]) for n, m, c, moments in out]


def coordinate(name, low, high, default=0.0, clamped=True, locked=False):
    return f"""              <Coordinate name="{name}">
                <default_value>{default}</default_value>
                <range>{low} {high}</range>
                <clamped>{str(clamped).lower()}</clamped>
                <locked>{str(locked).lower()}</locked>
              </Coordinate>"""


def frames(parent, at, child, on, turned=(0, 0, 0)):
    place = "/" + parent if parent == "ground" else f"/bodyset/{parent}"
    return f"""            <frames>
              <PhysicalOffsetFrame name="{parent}_offset">
                <socket_parent>{place}</socket_parent>
                <translation>{numbers(at)}</translation>
                <orientation>{numbers(turned)}</orientation>
              </PhysicalOffsetFrame>
              <PhysicalOffsetFrame name="{child}_offset">
                <socket_parent>/bodyset/{child}</socket_parent>
                <translation>{numbers(on)}</translation>
                <orientation>{numbers(turned)}</orientation>
              </PhysicalOffsetFrame>
            </frames>"""


def joint(kind, name, parent, at, child, on, coordinates="", transform="", turned=(0, 0, 0)):
    listed = f"            <coordinates>\n{coordinates}\n            </coordinates>\n" if coordinates else ""
    return f"""          <{kind} name="{name}">
            <socket_parent_frame>{parent}_offset</socket_parent_frame>
            <socket_child_frame>{child}_offset</socket_child_frame>
{listed}{frames(parent, at, child, on, turned)}
{transform}          </{kind}>"""


LINEAR = "<LinearFunction name=\"function\"><coefficients> 1 0</coefficients></LinearFunction>"
ZERO = "<Constant name=\"function\"><value>0</value></Constant>"


def transform(axes):
    out, units = [], [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
    for k in range(6):
        name = f"{'rotation' if k < 3 else 'translation'}{k % 3 + 1}"
        coordinate_, axis, function = axes.get(k, ("", None, ZERO))
        # OpenSim wants three axes that span space, also where one does not move
        used = [tuple(abs(x) for x in a[1]) for i, a in axes.items() if i < 3]
        axis = axis or ([a for a in units if a not in used][k - len(used)] if k < 3 else units[k - 3])
        out.append(f"""              <TransformAxis name="{name}">
                <coordinates>{coordinate_}</coordinates>
                <axis>{numbers(axis)}</axis>
                {function}
              </TransformAxis>""")
    return "            <SpatialTransform>\n" + "\n".join(out) + "\n            </SpatialTransform>\n"


def joints():
    free = {0: ("pelvis_tilt", (0, 0, 1), LINEAR), 1: ("pelvis_list", (1, 0, 0), LINEAR),
            2: ("pelvis_rotation", (0, 1, 0), LINEAR)}
    free |= {3 + k: (f"pelvis_t{a}", None, LINEAR) for k, a in enumerate("xyz")}
    own = [coordinate(f"pelvis_{a}", -1.6, 1.6) for a in ("tilt", "list", "rotation")]
    own += [coordinate(f"pelvis_t{a}", -5, 5) for a in "xyz"]
    out = [joint("CustomJoint", "ground_pelvis", "ground", (0, 0, 0), "pelvis", (0, 0, 0), "\n".join(own), transform(free))]
    back = {0: ("lumbar_extension", (0, 0, 1), LINEAR), 1: ("lumbar_bending", (1, 0, 0), LINEAR),
            2: ("lumbar_rotation", (0, 1, 0), LINEAR)}
    own = [coordinate(f"lumbar_{a}", -1.2, 1.2) for a in ("extension", "bending", "rotation")]
    out.append(joint("CustomJoint", "back", "pelvis", (-0.05, 0.09, 0), "torso", (0, 0, 0), "\n".join(own), transform(back)))
    for s in "rl":
        side = 1 if s == "r" else -1
        hip = {0: (f"hip_flexion_{s}", (0, 0, 1), LINEAR), 1: (f"hip_adduction_{s}", (side, 0, 0), LINEAR),
               2: (f"hip_rotation_{s}", (0, side, 0), LINEAR)}
        own = [coordinate(f"hip_{a}_{s}", -2.1, 2.1) for a in ("flexion", "adduction", "rotation")]
        out.append(joint("CustomJoint", f"hip_{s}", "pelvis", (-0.05, -0.06, 0.085 * side), f"thigh_{s}", (0, 0, 0),
                         "\n".join(own), transform(hip)))
        k = f"knee_angle_{s}"
        slide = ("<SimmSpline name=\"function\"><x> -0.2 0 0.35 0.8 1.3 1.9 2.4</x>"
                 "<y> 0.001 0 0.0022 0.0035 0.0026 -0.0012 -0.004</y></SimmSpline>")
        screw = "<PolynomialFunction name=\"function\"><coefficients>-0.05 0.16 0</coefficients></PolynomialFunction>"
        drop = ("<MultiplierFunction name=\"function\"><function><PolynomialFunction><coefficients>0.0012 -0.003 0</coefficients>"
                "</PolynomialFunction></function><scale>1.1</scale></MultiplierFunction>")
        knee = {0: (k, (0, 0, -1), LINEAR), 1: (k, (0, side, 0), screw), 3: (k, None, slide), 4: (k, None, drop)}
        out.append(joint("CustomJoint", f"knee_{s}", f"thigh_{s}", (0, -0.41, 0), f"shank_{s}", (0, 0, 0),
                         coordinate(k, -0.2, 2.4), transform(knee)))
        beta = f"{k}_beta"
        round_ = "<PolynomialFunction name=\"function\"><coefficients>-0.02 0.01 0.045</coefficients></PolynomialFunction>"
        patella = {0: (beta, (0, 0, -1), LINEAR), 3: (beta, None, round_)}
        out.append(joint("CustomJoint", f"patellofemoral_{s}", f"thigh_{s}", (0, -0.4, 0), f"patella_{s}", (0, 0, 0),
                         coordinate(beta, -99999.9, 99999.9, clamped=False), transform(patella)))
        out.append(joint("PinJoint", f"ankle_{s}", f"shank_{s}", (0, -0.4, 0), f"foot_{s}", (0, 0, 0),
                         coordinate(f"ankle_angle_{s}", -1.0, 1.0), turned=(0.15 * side, -0.1 * side, 0)))
        out.append(joint("PinJoint", f"mtp_{s}", f"foot_{s}", (0.13, -0.05, 0), f"toes_{s}", (0, 0, 0),
                         coordinate(f"mtp_angle_{s}", -0.6, 0.6, 0.1, locked=True)))
        arm = {0: (f"arm_flex_{s}", (0, 0, 1), LINEAR), 1: (f"arm_add_{s}", (side, 0, 0), LINEAR)}
        own = [coordinate(f"arm_{a}_{s}", -3.1, 3.1) for a in ("flex", "add")]
        out.append(joint("CustomJoint", f"shoulder_{s}", "torso", (0, 0.4, 0.17 * side), f"arm_{s}", (0, 0, 0),
                         "\n".join(own), transform(arm)))
        out.append(joint("WeldJoint", f"wrist_{s}", f"arm_{s}", (0, -0.5, 0), f"hand_{s}", (0, 0, 0), turned=(0, 0.4, 0)))
    return "\n".join(out)


def model(title, masses):
    sets = []
    for name, mass, com, moments in masses:
        sets.append(f"""          <Body name="{name}">
            <!--kg-->
            <mass>{mass!r}</mass>
            <mass_center>{numbers(com)}</mass_center>
            <!--about the centre of mass: xx yy zz xy xz yz-->
            <inertia>{numbers(moments)} 0 0 0</inertia>
          </Body>""")
    markers = []
    for name, own in MARKERS.items():
        for side in [name] if name.endswith("_r") else ["r", "l"]:
            for body_ in sides(name) if name.endswith("_r") else [name]:
                left = body_.endswith("_l") or side == "l"
                for label, at in own.items():
                    at = (at[0], at[1], -at[2]) if left else at
                    markers.append(f"""          <Marker name="{'L' if left else 'R'}_{label}">
            <socket_parent_frame>/bodyset/{body_}</socket_parent_frame>
            <location>{numbers(at)}</location>
          </Marker>""")
    couplers = "\n".join(f"""          <CoordinateCouplerConstraint name="patellofemoral_{s}_follows">
            <coupled_coordinates_function>
              <LinearFunction><coefficients> 0.9 0</coefficients></LinearFunction>
            </coupled_coordinates_function>
            <independent_coordinate_names>knee_angle_{s}</independent_coordinate_names>
            <dependent_coordinate_name>knee_angle_{s}_beta</dependent_coordinate_name>
          </CoordinateCouplerConstraint>""" for s in "rl")
    return f"""<?xml version="1.0" encoding="UTF-8" ?>
<OpenSimDocument Version="40000">
  <!--{title}; written by tests/peers/osim_fixture.py-->
  <Model name="body">
    <gravity>0 -9.80665 0</gravity>
    <Ground name="ground" />
    <BodySet name="bodyset">
      <objects>
{chr(10).join(sets)}
      </objects>
    </BodySet>
    <JointSet name="jointset">
      <objects>
{joints()}
      </objects>
    </JointSet>
    <ConstraintSet name="constraintset">
      <objects>
{couplers}
      </objects>
    </ConstraintSet>
    <MarkerSet name="markerset">
      <objects>
{chr(10).join(markers)}
      </objects>
    </MarkerSet>
  </Model>
</OpenSimDocument>
"""


def simulate(path, number, rng):
    """One throw: times, places of markers (m, ground), values of the coordinates."""
    sim = opensim.Model(str(path))
    free = [c for c in sim.getCoordinateSet() if not c.getName().startswith("pelvis") and "beta" not in c.getName()
            and "mtp" not in c.getName()]
    start = {}
    for c in free:
        name = c.getName()
        stiffness = {"hip": 90, "kne": 45, "ank": 12, "arm": 30, "lum": 260}[name[:3]]
        rest = {"knee_angle": 0.7, "hip_flexio": 0.5, "arm_flex_r": 0.6, "arm_flex_l": 0.4}.get(name[:10], 0.0)
        spring = opensim.SpringGeneralizedForce(name)
        spring.setStiffness(stiffness)
        spring.setRestLength(rest)
        spring.setViscosity(0.02 * stiffness)
        spring.setName(f"spring_{name}")
        sim.addForce(spring)
        wide = 0.12 if name.startswith("lumbar") else 0.35
        start[name] = (rest + wide * rng.uniform(-1, 1), (6 if wide > 0.2 else 1.5) * rng.uniform(-1, 1))
    state = sim.initSystem()
    values = {"pelvis_tilt": (0.2 * rng.uniform(-1, 1), 4 * rng.uniform(-1, 1)),
              "pelvis_list": (0.1 * rng.uniform(-1, 1), 2 * rng.uniform(-1, 1)),
              "pelvis_rotation": (0.4 * rng.uniform(-1, 1), 2.5 * rng.uniform(-1, 1)),
              "pelvis_tx": (0, 0.4 * rng.uniform(-1, 1)), "pelvis_ty": (1.0, 3.9), "pelvis_tz": (0, 0.3 * rng.uniform(-1, 1))}
    for name, (value, speed) in (values | start).items():
        c = sim.getCoordinateSet().get(name)
        c.setValue(state, value, False)
        c.setSpeedValue(state, speed)
    sim.assemble(state)
    manager = opensim.Manager(sim)
    manager.setIntegratorAccuracy(1e-9)
    state.setTime(0)
    manager.initialize(state)
    times, places, coordinates = [], [], []
    names = [m.getName() for m in sim.getMarkerSet()]
    for k in range(int(SECONDS * RATE_HZ) + 1):
        state = manager.integrate(k / RATE_HZ) if k else state
        sim.realizePosition(state)
        times.append(k / RATE_HZ)
        row = []
        for m in sim.getMarkerSet():
            p = m.getLocationInGround(state)
            row.append([p[i] for i in range(3)])
        places.append(row)
        coordinates.append([c.getValue(state) for c in sim.getCoordinateSet()])
    return times, names, places, [c.getName() for c in sim.getCoordinateSet()], coordinates


def trc(path, times, names, places, rng):
    with open(path, "w") as out:
        out.write(f"PathFileType\t4\t(X/Y/Z)\t{path.name}\n")
        out.write("DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n")
        out.write(f"{RATE_HZ:g}\t{RATE_HZ:g}\t{len(times)}\t{len(names)}\tmm\t{RATE_HZ:g}\t1\t{len(times)}\n")
        out.write("Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t\n")
        out.write("\t\t" + "\t".join(f"{a}{i + 1}" for i in range(len(names)) for a in "XYZ") + "\n\n")
        for k, row in enumerate(places):
            cells = [f"{1e3 * (x + rng.gauss(0, NOISE_M)):.1f}" for p in row for x in p]
            out.write(f"{k + 1}\t{times[k]:.6f}\t" + "\t".join(cells) + "\n")


def main():
    (FOLDER / "truth").mkdir(parents=True, exist_ok=True)
    (FOLDER / "body.osim").write_text(model("the model of a laboratory: scaled, with inertias from a table", bodies(None)))
    true = FOLDER / "truth/true.osim"
    true.write_text(model("the body that was simulated", bodies(random.Random(7))))
    for number in range(1, 7):
        rng = random.Random(100 + number)
        times, names, places, coordinates, values = simulate(true, number, rng)
        trc(FOLDER / f"throw_{number:02}.trc", times, names, places, rng)
        if number == 1:
            lines = ["\t".join(["time", *coordinates])]
            lines += ["\t".join([f"{t:.6f}", *(f"{v:.6f}" for v in row)]) for t, row in zip(times, values)]
            (FOLDER / "truth/throw_01.tsv").write_text("\n".join(lines) + "\n")
        print(number, f"highest {max(p[0][1] for p in places):.2f} m", math.isfinite(values[-1][0]))


main()
