"""The simulated contact wrench of two trials, thinned, as truth for the plates in crates/c3d/tests/plates.rs.

    c3d_plate_truth.py SUBJECT_A_FOLDER OUT.json

The wrench is the simulator's own, on the body about the world origin, before noise and drift were added to the channels.
"""

import json
import sys
from pathlib import Path

import numpy as np

folder, target = Path(sys.argv[1]), Path(sys.argv[2])
out = {}
for trial in ("exercise01", "jump01"):
    wrench = np.load(folder / "truth" / f"truth_{trial}.npz")["contact_wrench_1k"]
    samples = range(0, len(wrench), 97)
    out[trial] = [[i, *(round(float(x), 4) for x in wrench[i])] for i in samples]
target.write_text(json.dumps(out, separators=(",", ":")).replace("],[", "],\n[") + "\n")
