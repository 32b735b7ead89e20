"""Golden for crates/flight: true centre of mass of simulated jumps, frame by frame (m, five decimals of a millimetre kept).

usage: python flight_centre_of_mass.py DATA_FOLDER OUT_FOLDER
DATA_FOLDER holds subject_a/truth; writes subject_a_jumpNN_com.csv with columns x, y, z.
"""

import pathlib
import sys

import numpy as np

data, out = map(pathlib.Path, sys.argv[1:3])
out.mkdir(parents=True, exist_ok=True)
for number in (1, 8):
    truth = np.load(data / f"subject_a/truth/truth_jump{number:02d}.npz")
    np.savetxt(out / f"subject_a_jump{number:02d}_com.csv", truth["com"], fmt="%.7f", delimiter=",")
