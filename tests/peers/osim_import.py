"""An imported OpenSim model after `aloft export --format osim,mot,trc`: OpenSim loads the patched file, and its own inverse kinematics agrees.

    aloft run P.yaml && aloft export P.yaml --to EXPORT --format osim,mot,trc
    tests/peers/.venv/bin/python tests/peers/osim_import.py EXPORT ORIGINAL.osim

Checks: the patched model differs from the original in inertias only; OpenSim reruns inverse kinematics on each
exported recording (the set-up file in IK), and every coordinate that markers see agrees within 0.5° and 0.5 mm
(RMS, frames at an end of a range included). Exits with 1 where a limit is exceeded.
"""
import os
import pathlib
import re
import sys

import numpy as np
import opensim

LIMIT_DEG, LIMIT_M = 0.5, 5e-4


def without_inertias(text):
    text = re.sub(r"<!-- Inertials identified.*?-->\n", "", text, flags=re.S)
    return re.sub(r"<(mass|mass_center|inertia)>[^<]*</\1>", r"<\1/>", text)


def table(path):
    lines = path.read_text().splitlines()
    start = next(i for i, line in enumerate(lines) if line.strip() == "endheader") + 1
    names = lines[start].split("\t")
    rows = np.array([[float(x) for x in line.split("\t")] for line in lines[start + 1:] if line.strip()])
    return dict(zip((n.strip() for n in names), rows.T))


def main():
    folder, original = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()
    patched = next((folder / "Models").glob("*.osim"))
    same = without_inertias(original.read_text()) == without_inertias(patched.read_text())
    print(f"{patched.name}: only inertias differ from {original.name}: {same}")
    new, old = opensim.Model(str(patched)), opensim.Model(str(original))
    masses = []
    for model in (old, new):
        state = model.initSystem()
        masses.append(model.getTotalMass(state))
    print(f"total mass {masses[0]:.3f} kg in the original, {masses[1]:.3f} kg in the patched file")
    good = same
    angles = {c.getName() for c in new.getCoordinateSet() if c.getMotionType() == 1}
    # paths in the set-up files are relative to their folder
    os.chdir(folder / "IK")
    for setup in sorted((folder / "IK").glob("*_ik_setup.xml")):
        stem = setup.name.removesuffix("_ik_setup.xml")
        tool = opensim.InverseKinematicsTool(str(setup))
        tool.set_report_errors(False)
        tool.run()
        ours = table(folder / "IK" / f"{stem}_ik.mot")
        theirs = table(folder / "IK" / f"{stem}_ik_opensim.mot")
        held = []
        worst = {True: ("", 0.0), False: ("", 0.0)}
        for name, values in theirs.items():
            if name == "time" or name not in ours:
                continue
            if np.ptp(ours[name]) == 0:
                held.append(name)  # no marker sees it
                continue
            mine = np.interp(theirs["time"], ours["time"], ours[name])
            off = values - mine
            if name in angles:
                off = (off + 180) % 360 - 180
            rms = float(np.sqrt(np.nanmean(off**2)))
            worst[name in angles] = max(worst[name in angles], (name, rms), key=lambda w: w[1])
        (a, deg), (b, m) = worst[True], worst[False]
        good &= deg < LIMIT_DEG and m < LIMIT_M
        print(f"{stem}: largest difference {deg:.4f} deg ({a}), {1e3 * m:.4f} mm ({b}), RMS over {len(theirs['time'])} frames"
              + (f"; held: {', '.join(held)}" if held else ""))
    sys.exit(0 if good else 1)


main()
