"""Laws that a physicist might invent: the population of `benches/laws.py`.

A law is a dictionary: `entry`, a hidden effect `law` of `aloft simulate` in whose formulas `@` stands for the strength;
`family`; `expressible`, true for one variable in one elementary shape; `truth`, what a right answer may say:

  carriers    links (or `body`) on which the law may be said to act
  actions     force, couple
  directions  words for the direction
  variables   alternatives; an answer is right if its variables are all in one alternative
  constant    true if the direction's vector is the whole law (force = strength · ω × v): no variable need be named
  known       catalogue entries that are physically the same: none, such laws are not drawn

This file imports nothing from the program and was fixed before the search was tuned.
"""

import math

AXES = "xyz"


def number(x):
    return f"{x:.5g}"


def unit(rng):
    x = [rng.gauss(0, 1) for _ in range(3)]
    n = math.sqrt(sum(a * a for a in x))
    return [round(a / n, 4) for a in x]


class Body:
    """What the laws need to know of a body: links and points on them, hinges, usual sizes."""

    def __init__(self, kind):
        self.kind = kind
        if kind == "chain":
            # link -> box of points (link frame, m); none within 25 mm of the hinge, which belongs
            # to both links
            self.boxes = {"link0": [(-0.05, 0.05), (0.05, 0.23), (-0.03, 0.05)], "link1": [(-0.2, -0.05), (-0.05, 0.05), (-0.02, 0.03)]}
            self.hinges = {"link1": ("link0", "link1")}
            self.speed, self.spin, self.rate = 2.0, 6.0, 8.0
            self.middle, self.reach = (0.0, 0.0, 1.8), 1.0
        else:
            box = [(-0.05, 0.05), (-0.12, 0.05), (-0.05, 0.05)]
            self.boxes = {link: box for link in ("torso", "thigh_r", "shank_l", "forearm_r", "upper_arm_l", "hand_l")}
            self.boxes["torso"] = [(-0.1, 0.1), (0.05, 0.35), (-0.12, 0.12)]
            self.boxes["pelvis"] = [(-0.08, 0.08), (0.0, 0.12), (-0.1, 0.1)]
            self.hinges = {f"{a}_{s}": (f"{b}_{s}", f"{a}_{s}") for a, b in (("forearm", "upper_arm"), ("shank", "thigh")) for s in "rl"}
            self.speed, self.spin, self.rate = 1.6, 2.5, 6.0
            self.middle, self.reach = (0.0, 0.0, 1.2), 1.0
        self.links = list(self.boxes)

    def point(self, rng, link):
        return [round(rng.uniform(a, b), 3) for a, b in self.boxes[link]]

    def anchor(self, rng):
        """A place in the room that the body passes at a distance."""
        d = unit(rng)
        size = rng.uniform(0.8, 1.5) * self.reach
        return [round(m + size * a, 3) for m, a in zip(self.middle, d)]


def law(family, body, entry, carriers, action, directions, variables, expressible, constant=False):
    truth = {"carriers": list(carriers), "actions": [action], "directions": list(directions),
             "variables": [list(v) for v in variables], "constant": constant, "known": []}
    return {"family": family, "entry": {"effect": "law", **entry}, "expressible": expressible, "truth": truth}


def on_link(rng, body, whole=0.0):
    """A carrier with a point: entry, carriers; with some probability the whole body."""
    if rng.random() < whole:
        return {"link": "body"}, ["body"]
    link = rng.choice(body.links)
    return {"link": link, "point_m": body.point(rng, link)}, [link]


def vector(direction, scalar, key="force"):
    """Three formulas along a constant direction."""
    return {key: [f"{number(a)}*({scalar})" if a else 0 for a in direction]}


def along_velocity(scalar):
    """Against the velocity; `scalar` is force over speed."""
    return {"force": [f"-({scalar})*{v}" for v in ("vx", "vy", "vz")]}


def axis(k):
    return [1 if i == k else 0 for i in range(3)]


EPS = "max(speed, 1e-6)"


# ---- one variable, one shape -------------------------------------------------------------------

def power_drag(rng, body):
    at, carriers = on_link(rng, body, 0.25)
    p = rng.choice([0.4, 0.6, 1.4, 1.6, 2.5, 3.0])
    return law("power of speed", body, {**at, **along_velocity(f"@*{EPS}^({number(p - 1)})")}, carriers, "force", ["against_velocity"], [["speed"]], True)


def power_component(rng, body):
    at, carriers = on_link(rng, body)
    k, p, world = rng.randrange(3), rng.choice([0.5, 1.5, 2.0, 3.0]), rng.random() < 0.5
    v = ("v" if world else "u") + AXES[k]
    name = f"v_{'world' if world else 'link'}_{AXES[k]}"
    entry = {**at, "axes": "world" if world else "link", **vector(axis(k), f"-@*sign({v})*abs({v})^{number(p)}")}
    return law("power of one component", body, entry, carriers, "force", ["world" if world else "link"], [[name]], True)


def dead_zone(rng, body):
    at, carriers = on_link(rng, body)
    s = number(body.speed * rng.uniform(0.4, 0.9))
    return law("dead zone", body, {**at, **along_velocity(f"@*max(speed - {s}, 0)/{EPS}")}, carriers, "force", ["against_velocity"], [["speed"]], True)


def saturating(rng, body):
    at, carriers = on_link(rng, body)
    s = number(body.speed * rng.uniform(0.3, 0.8))
    return law("saturating drag", body, {**at, **along_velocity(f"@*tanh(speed/{s})/{EPS}")}, carriers, "force", ["against_velocity"], [["speed"]], True)


def point_field(rng, body):
    at, carriers = on_link(rng, body, 0.2)
    a = body.anchor(rng)
    r = f"dist({', '.join(number(x) for x in a)})"
    length = number(body.reach * rng.uniform(0.3, 0.9))
    shape = rng.choice(["inverse square", "inverse", "exponential", "gauss", "square", "root", "cube"])
    size = {"inverse square": f"1/({r}^2 + 0.01)", "inverse": f"1/{r}", "exponential": f"exp(-{r}/{length})", "gauss": f"exp(-({r}/{length})^2)", "square": f"{r}^2", "root": f"sqrt({r})", "cube": f"{r}^3"}[shape]
    sign = rng.choice(["", "-"])
    force = [f"{sign}@*{size}/max({r}, 1e-3)*({number(c)} - {x})" for c, x in zip(a, AXES)]
    return law("point field: " + shape, body, {**at, "force": force}, carriers, "force", ["towards"], [["distance"]], True)


def plane_field(rng, body):
    at, carriers = on_link(rng, body, 0.2)
    # a person stays where he jumps: only height varies
    k = rng.randrange(3) if body.kind == "chain" else 2
    x, x0 = AXES[k], number(body.middle[k] + rng.uniform(-0.3, 0.3))
    length = number(rng.uniform(0.2, 0.5))
    shape = rng.choice(["exponential", "gauss", "linear", "cubic"])
    scalar = {"exponential": f"@*exp(-({x} - {x0})/{length})", "gauss": f"@*exp(-(({x} - {x0})/{length})^2)", "linear": f"@*({x} - {x0})", "cubic": f"@*({x} - {x0})^3"}[shape]
    direction = rng.choice([unit(rng), axis(k)])
    return law("plane field: " + shape, body, {**at, **vector(direction, scalar)}, carriers, "force", ["world"], [[f"r_{x}"]], True)


def cross(b, v):
    n = [number(x) for x in b]
    return [f"({n[1]}*{v[2]} - {n[2]}*{v[1]})", f"({n[2]}*{v[0]} - {n[0]}*{v[2]})", f"({n[0]}*{v[1]} - {n[1]}*{v[0]})"]


def across(rng, body):
    at, carriers = on_link(rng, body)
    p, world = rng.choice([0.5, 1.0, 1.0, 2.0]), rng.random() < 0.5
    v = ("vx", "vy", "vz") if world else ("ux", "uy", "uz")
    factor = "@" if p == 1.0 else f"@*{EPS}^({number(p - 1)})"
    force = [f"{factor}*{c}" for c in cross(unit(rng), v)]
    return law("across the velocity", body, {**at, "axes": "world" if world else "link", "force": force}, carriers, "force", ["across_velocity" if world else "across_velocity_in_link"], [["speed"]], True, p == 1.0)


def spin_cross(rng, body):
    at, carriers = on_link(rng, body)
    force = [f"@*({a})" for a in ("wy*vz - wz*vy", "wz*vx - wx*vz", "wx*vy - wy*vx")]
    return law("spin cross velocity", body, {**at, "force": force}, carriers, "force", ["spin_cross_velocity"], [["speed"], ["spin"]], True, True)


def joint_driven(rng, body):
    link = rng.choice(list(body.hinges))
    pair = body.hinges[link]
    on = rng.choice(pair)
    what = rng.choice(["angle", "square", "sine", "rate"])
    q, qd = f"q_{link}", f"qd_{link}"
    scalar = {"angle": f"@*{q}", "square": f"@*{q}^2", "sine": f"@*sin({number(rng.uniform(1.5, 3))}*{q})", "rate": f"@*abs({qd})*{qd}"}[what]
    variable = qd if what == "rate" else q
    couple = rng.random() < 0.4
    if couple and rng.random() < 0.4:
        # about the hinge, whose axis is z of the distal link and fixed in both
        entry = {"link": link, "axes": "link", **vector([0, 0, 1], scalar, "moment")}
        return law("couple by joint " + what, body, entry, pair, "couple", ["link"], [[variable]], True)
    if couple:
        entry = {"link": on, "axes": "link", **vector(unit(rng), scalar, "moment")}
        return law("couple by joint " + what, body, entry, [on], "couple", ["link"], [[variable]], True)
    box = on if on in body.boxes else None
    point = body.point(rng, box) if box else [0.0, -0.1, 0.0]
    world = rng.random() < 0.3
    entry = {"link": on, "point_m": point, "axes": "world" if world else "link", **vector(unit(rng), scalar)}
    return law("force by joint " + what, body, entry, [on], "force", ["world" if world else "link"], [[variable]], True)


def spin_couple(rng, body):
    link, p = rng.choice(body.links), rng.choice([0.5, 1.5, 2.0, 3.0])
    if rng.random() < 0.5:
        k = rng.randrange(3)
        w = "p" + AXES[k]
        entry = {"link": link, "axes": "link", **vector(axis(k), f"-@*sign({w})*abs({w})^{number(p)}", "moment")}
        return law("couple against one spin component", body, entry, [link], "couple", ["link"], [[f"omega_link_{AXES[k]}"]], True)
    entry = {"link": link, "moment": [f"-@*max(spin, 1e-6)^({number(p - 1)})*{w}" for w in ("wx", "wy", "wz")]}
    return law("couple against spin", body, entry, [link], "couple", ["against_spin"], [["spin"]], True)


def clock(rng, body):
    f, phase = rng.uniform(0.7, 4.0), rng.uniform(0, 6.28)
    scalar = f"@*sin(2*pi*{number(f)}*t + {number(phase)})"
    if rng.random() < 0.3:
        # a couple along the world's axes is the same on every link
        carriers = body.links + ["body"]
        return law("couple on the clock", body, {"link": rng.choice(body.links), **vector(unit(rng), scalar, "moment")}, carriers, "couple", ["world"], [["t"]], True)
    at, carriers = on_link(rng, body, 0.25)
    world = carriers == ["body"] or rng.random() < 0.5
    return law("force on the clock", body, {**at, "axes": "world" if world else "link", **vector(unit(rng), scalar)}, carriers, "force", ["world" if world else "link"], [["t"]], True)


def since_start(rng, body):
    at, carriers = on_link(rng, body)
    tau = number(rng.uniform(0.08, 0.3))
    scalar = rng.choice([f"@*exp(-since_start/{tau})", f"@*max(1 - since_start/{tau}, 0)", f"@*since_start/{tau}*exp(-since_start/{tau})"])
    world = rng.random() < 0.5
    return law("decay since take-off", body, {**at, "axes": "world" if world else "link", **vector(unit(rng), scalar)}, carriers, "force", ["world" if world else "link"], [["since_start"]], True)


def tilt(rng, body):
    link, k = rng.choice(body.links), rng.randrange(3)
    up = f"up_{AXES[k]}"
    scalar = rng.choice([f"@*{up}^2", f"@*{up}^3", f"@*abs({up})"])
    name = [f"tilt_{AXES[k]}"]
    if rng.random() < 0.5:
        return law("couple by heading", body, {"link": link, "axes": "link", **vector(unit(rng), scalar, "moment")}, [link], "couple", ["link"], [name], True)
    return law("force by heading", body, {"link": link, "point_m": body.point(rng, link), "axes": "link", **vector(unit(rng), scalar)}, [link], "force", ["link"], [name], True)


def switch(rng, body):
    at, carriers = on_link(rng, body)
    link = carriers[0]
    what = rng.choice(["height", "heading", "posture"] + ["place"] * (body.kind == "chain"))
    k = rng.randrange(3)
    if what == "height":
        scalar, name = f"@*step(z - {number(body.middle[2] + rng.uniform(-0.1, 0.15))})", "r_z"
        at = dict(at)
    elif what == "place":
        scalar, name = f"@*step({AXES[k % 2]} - {number(rng.uniform(-0.1, 0.1))})", f"r_{AXES[k % 2]}"
    elif what == "heading":
        scalar, name = f"@*step(up_{AXES[k]} - {number(rng.uniform(-0.3, 0.3))})", f"tilt_{AXES[k]}"
    else:
        hinge = rng.choice(list(body.hinges))
        middle = rng.uniform(-0.4, 0.4) if body.kind == "chain" else rng.uniform(0.3, 0.9) * (1 if "forearm" in hinge else -1)
        scalar, name = f"@*step(q_{hinge} - {number(middle)})", f"q_{hinge}"
    world = rng.random() < 0.5
    return law("switch by " + what, body, {**at, "link": link, "axes": "world" if world else "link", **vector(unit(rng), scalar)}, carriers, "force", ["world" if world else "link"], [[name]], True)


# ---- not one variable in one shape -------------------------------------------------------------

def product_drag(rng, body):
    at, carriers = on_link(rng, body)
    z0, length = number(body.middle[2]), number(rng.uniform(0.15, 0.4))
    f = number(rng.uniform(0.7, 3.0))
    what = rng.choice(["height", "clock", "since", "heading"])
    k = rng.randrange(3)
    factor, name = {"height": (f"exp(-(z - {z0})/{length})", "r_z"), "clock": (f"(1 + sin(2*pi*{f}*t))", "t"), "since": (f"exp(-since_start/{length})", "since_start"), "heading": (f"up_{AXES[k]}^2", f"tilt_{AXES[k]}")}[what]
    p = rng.choice([0.0, 0.5, 1.0])
    scalar = f"@*{factor}" + (f"*{EPS}^{number(p)}" if p else "")
    return law("drag times " + what, body, {**at, **along_velocity(scalar)}, carriers, "force", ["against_velocity"], [["speed", name]], False)


def product_joint(rng, body):
    hinge = rng.choice(list(body.hinges))
    at, carriers = on_link(rng, body)
    k = rng.randrange(3)
    other, name = rng.choice([(f"u{AXES[k]}", f"v_link_{AXES[k]}"), (f"p{AXES[k]}", f"omega_link_{AXES[k]}"), (f"up_{AXES[k]}", f"tilt_{AXES[k]}"), ("speed", "speed")])
    return law("joint angle times motion", body, {**at, "axes": "link", **vector(unit(rng), f"@*q_{hinge}*{other}")}, carriers, "force", ["link"], [[f"q_{hinge}", name]], False)


def delayed_drag(rng, body):
    at, carriers = on_link(rng, body)
    delay = round(rng.uniform(0.03, 0.09), 3)
    if rng.random() < 0.5:
        k = rng.randrange(3)
        entry = {**at, **vector(axis(k), f"-@*v{AXES[k]}*abs(v{AXES[k]})"), "delay_s": delay}
        return law("delayed drag", body, entry, carriers, "force", ["world"], [[f"v_world_{AXES[k]}"]], False)
    entry = {**at, **along_velocity(f"@*{EPS}"), "delay_s": delay}
    return law("delayed drag", body, entry, carriers, "force", ["against_velocity", "world"], [["speed"], ["v_world_x", "v_world_y", "v_world_z"]], False)


def delayed_joint(rng, body):
    hinge = rng.choice(list(body.hinges))
    at, carriers = on_link(rng, body)
    shape = rng.choice(["@*q_{0}", "@*q_{0}^3", "@*qd_{0}"]).format(hinge)
    entry = {**at, "axes": "link", **vector(unit(rng), shape), "delay_s": round(rng.uniform(0.03, 0.09), 3)}
    # a late angle is an angle and a rate
    return law("delayed joint force", body, entry, carriers, "force", ["link"], [[f"q_{hinge}", f"qd_{hinge}"]], False)


def smaller_of_two(rng, body):
    at, carriers = on_link(rng, body)
    length, z0 = number(rng.uniform(0.15, 0.35)), number(body.middle[2] + rng.uniform(-0.1, 0.1))
    which, s = rng.choice(["min", "max"]), number(body.speed * rng.uniform(0.6, 1.1))
    scalar = f"@*{which}(speed/{s}, exp(-(z - {z0})/{length}))"
    return law(which + " of two laws", body, {**at, **vector(unit(rng), scalar)}, carriers, "force", ["world"], [["speed", "r_z"]], False)


def mixture(rng, body):
    at, carriers = on_link(rng, body)
    s = number(body.speed * rng.uniform(0.7, 1.1))
    shape = rng.choice([f"speed^0.4 + 2*step(speed - {s})", f"speed*(1 + sin(4*speed))", f"min(speed^3, {s}*speed)*exp(-speed/4)"])
    return law("mixture of shapes", body, {**at, **along_velocity(f"@*({shape})/{EPS}")}, carriers, "force", ["against_velocity"], [["speed"]], False)


def lift(rng, body):
    at, carriers = on_link(rng, body)
    k = rng.randrange(3)
    j = (k + 1 + rng.randrange(2)) % 3
    # lift of a flat wing with the normal k: across the flow, by the angle of attack
    scalar = f"-@*u{AXES[k]}*abs(u{AXES[j]})"
    names = [f"v_link_{AXES[k]}", f"v_link_{AXES[j]}", "speed"]
    return law("lift", body, {**at, "axes": "link", **vector(axis(k), scalar)}, carriers, "force", ["link"], [names], False)


def posture_switch(rng, body):
    hinge = rng.choice(list(body.hinges))
    at, carriers = on_link(rng, body)
    middle = rng.uniform(-0.4, 0.4) if body.kind == "chain" else rng.uniform(0.3, 0.9) * (1 if "forearm" in hinge else -1)
    scalar = f"@*step(q_{hinge} - {number(middle)})*{EPS}"
    return law("drag in one posture", body, {**at, **along_velocity(scalar)}, carriers, "force", ["against_velocity"], [["speed", f"q_{hinge}"]], False)


def spin_product(rng, body):
    link, k = rng.choice(body.links), rng.randrange(3)
    j = (k + 1) % 3
    entry = {"link": link, "axes": "link", **vector(axis(k), f"-@*p{AXES[k]}*abs(p{AXES[j]})*(1 + up_{AXES[j]})", "moment")}
    return law("couple by two spins and heading", body, entry, [link], "couple", ["link"], [[f"omega_link_{AXES[k]}", f"omega_link_{AXES[j]}", f"tilt_{AXES[j]}"]], False)


def travelling_wave(rng, body):
    at, carriers = on_link(rng, body)
    k = rng.randrange(3) if body.kind == "chain" else 2
    scalar = f"@*sin(2*pi*({number(rng.uniform(0.5, 2))}*t - {AXES[k]}/{number(rng.uniform(0.8, 2))}))"
    return law("travelling wave", body, {**at, **vector(unit(rng), scalar)}, carriers, "force", ["world"], [["t", f"r_{AXES[k]}"]], False)


EXPRESSIBLE = [power_drag, power_component, dead_zone, saturating, point_field, plane_field, across, spin_cross, joint_driven, spin_couple, clock, since_start, tilt, switch, point_field, joint_driven]
OTHERS = [product_drag, product_joint, delayed_drag, delayed_joint, smaller_of_two, mixture, lift, posture_switch, spin_product, travelling_wave]


def draw(kind, seed, index, attempt, random):
    """Law `index` of the population: two of five are not expressible; families in a drawn order."""
    order = random.Random(f"laws order {kind} {seed}")
    families = [list(EXPRESSIBLE), list(OTHERS)]
    for f in families:
        order.shuffle(f)
    other = index % 5 in (1, 3)
    before = sum((i % 5 in (1, 3)) == other for i in range(index))
    family = families[other][before % len(families[other])]
    rng = random.Random(f"law {kind} {seed} {index} {attempt}")
    return family(rng, Body(kind))
