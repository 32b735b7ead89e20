"""How much of the model's error the fitted constant of plates that were never unloaded hides, on a simulated subject whose truth is known.

    python exercise_offsets.py WORKSPACE DATA         (WORKSPACE of `aloft run pipelines/human.yaml --data DATA`; DATA with truth/)

Residuals of the frames that count, over 0.3 s windows, about the pelvis, world axes: with the constant that `aloft compare` took off, with the plates' true one
(median of recorded less true contact wrench), and with none taken off.
"""
import json, pathlib, sys
import numpy as np
import polars as pl
from scipy.spatial.transform import Rotation

ws, data = map(pathlib.Path, sys.argv[1:3])
AXES = ["force_x_n", "force_y_n", "force_z_n", "moment_x_nm", "moment_y_nm", "moment_z_nm"]
trials = {t["trial"]: t for t in json.loads((ws / "compare/_study/comparison.json").read_text())["trials"]}
errors = {"fitted": [], "true": [], "none": []}
for name, trial in trials.items():
    if not trial["offset"]:
        continue
    series = pl.read_parquet(ws / "compare/_study" / f"series_{name}.parquet")
    motion = pl.read_parquet(ws / "filter" / name / "motion.parquet")
    stack = lambda model: np.stack([series[f"{model}.{a}"].to_numpy() for a in AXES], 1)
    measured, predicted = stack("measured"), stack("identified")
    counts = (series["counts"].to_numpy() > 0.5) & np.isfinite(measured).all(1)
    root = Rotation.from_quat(np.nan_to_num(np.stack([motion[f"pelvis.q{k}"].to_numpy() for k in "xyzw"], 1), nan=0.5))
    at = np.nan_to_num(np.stack([motion[f"pelvis.{k}"].to_numpy() for k in "xyz"], 1))
    world = lambda w: (root.apply(np.nan_to_num(w[:, :3])), root.apply(np.nan_to_num(w[:, 3:])))
    (force, moment), (force_p, moment_p) = world(measured), world(predicted)
    truth = np.load(data / "truth" / f"truth_{name}.npz")["contact_wrench_1k"][::5][: len(force)]
    true = np.median((np.hstack([force, moment + np.cross(at, force)]) - truth)[counts], 0)
    fitted = np.r_[trial["offset"]["force_n"], trial["offset"]["moment_nm"]]
    half = 29
    psi = (1 - (np.arange(-half, half + 1) / (half + 1)) ** 2) ** 5
    psi /= psi.sum()
    for kind, offset in [("fitted", fitted), ("true", true), ("none", np.zeros(6))]:
        f = force - offset[:3]
        m = moment - (offset[3:] - np.cross(at, np.tile(offset[:3], (len(at), 1))))
        residual = np.hstack([force_p - f, moment_p - m])
        for k in range(half, len(residual) - half, 15):
            window = slice(k - half, k + half + 1)
            if counts[window].all():
                errors[kind].append(psi @ residual[window])
for kind, e in errors.items():
    e = np.abs(np.array(e)).mean(0)
    print(f"offset {kind:6s}: {np.round(e, 3)}  mean {e[:3].mean():.3f} N, {e[3:].mean():.3f} N·m")
