"""Golden of crates/compare: stretches of a simulated subject's true motion and the contact wrench that belongs to it.

    python tests/peers/compare_subject.py DATA      (DATA holds subject_a; writes fixtures/goldens/compare_subject.json)

The simulator is a floating-base integrator on Pinocchio 4.1, the joints are laboratory-aligned in the neutral posture.
q as in Pinocchio (free: x y z, quaternion x y z w; spherical: quaternion x y z w; hinge: angle), v and a likewise.
The wrench acts on the body, world axes, about the world origin.
"""

import json
import pathlib
import sys

import numpy as np

OUT = pathlib.Path(__file__).resolve().parent.parent.parent / "fixtures" / "goldens" / "compare_subject.json"
# phi of the data: m, mc, Ixx, Ixy, Iyy, Ixz, Iyz, Izz  ->  m, mc, Ixx, Iyy, Izz, Iyz, Izx, Ixy
ORDER = [0, 1, 2, 3, 4, 6, 9, 8, 7, 5]


def rounded(x, digits):
    return [float(f"{v:.{digits}g}") for v in np.asarray(x, dtype=float).ravel()]


def main():
    folder = pathlib.Path(sys.argv[1]) / "subject_a" / "truth"
    truth = json.loads((folder / "truth.json").read_text())
    links = [
        dict(
            name=l["name"],
            parent=l["parent"],
            joint=l["joint"],
            position_m=l["offset"],
            phi=[l["phi"][i] for i in ORDER],
        )
        for l in truth["links"]
    ]
    stretches = []
    for trial, first, end in [("exercise01", 300, 375), ("jump01", 440, 560)]:
        z = np.load(folder / f"truth_{trial}.npz")
        flights = [[round(a * 200) - first, round(b * 200) - first] for a, b in z["flights"].reshape(-1, 2)]
        stretches.append(
            dict(
                trial=trial,
                rate_hz=200.0,
                frames=end - first,
                flights=[f for f in flights if f[0] >= 0 and f[1] <= end - first],
                q=rounded(z["q"][first:end], 9),
                v=rounded(z["v"][first:end], 6),
                a=rounded(z["a"][first:end], 6),
                wrench=rounded(z["contact_wrench_1k"][::5][first:end], 7),
            )
        )
    OUT.write_text(json.dumps(dict(made_with="tests/peers/compare_subject.py", links=links, stretches=stretches)) + "\n")
    print(OUT.stat().st_size, [s["flights"] for s in stretches])


if __name__ == "__main__":
    main()
