"""What the residual wrench of real drop jumps is made of: reads what `aloft run` left.

    python drop_jump_rest.py WORKSPACE

WORKSPACE is that of `aloft run pipelines/drop_jump.yaml --data DATA`. Prints, for the contact after each landing: error against time
since touch-down, spectra of measured force and of error, the time shift and the gain that fit best, and the mass by impulse between flights.
"""
import json, pathlib, sys
import numpy as np
import polars as pl
from scipy.signal import welch

ws = pathlib.Path(sys.argv[1])
JUMPS = ["DJ1", "DJ2", "DJ3", "DJAsym1", "DJAsym2", "DJAsym3"]
AXES = ["force_x_n", "force_y_n", "force_z_n", "moment_x_nm", "moment_y_nm", "moment_z_nm"]


def series(trial):
    t = pl.read_parquet(ws / "compare/_study" / f"series_{trial}.parquet")
    stack = lambda name: np.stack([t[f"{name}.{a}"].to_numpy() for a in AXES], 1)
    return t["time_s"].to_numpy(), t["in_flight"].to_numpy() > 0.5, t["counts"].to_numpy() > 0.5, stack("measured"), stack("identified")


def runs(mask):
    edges = np.flatnonzero(np.diff(np.r_[0, mask.astype(int), 0]))
    return list(zip(edges[::2], edges[1::2]))


def flights(trial):
    return [(f["start"], f["end"]) for f in json.loads((ws / "flight" / trial / "flights.json").read_text())["flights"]]


print("## contact frames that count: mean absolute error by time since touch-down (identified; force forward, up, right, N; moment list, rotation, tilt, N·m)")
bins = [(0.05, 0.10), (0.10, 0.15), (0.15, 0.20), (0.20, 0.30), (0.30, 1.0)]
by_bin = {b: [] for b in bins}
shape = []
for trial in JUMPS:
    time, air, counts, measured, predicted = series(trial)
    error = predicted - measured
    for start, end in flights(trial):
        # contact that follows this flight
        follow = [f for f in range(end, len(time)) if not air[f]]
        stop = next((f for f in range(end, len(time)) if air[f] and f > end + 2), len(time))
        for f in range(end, stop):
            if counts[f] and np.all(np.isfinite(error[f])):
                since = (f - end) / 100.0
                for b in bins:
                    if b[0] <= since < b[1]:
                        by_bin[b].append((np.abs(error[f]), np.abs(measured[f])))
for b, rows in by_bin.items():
    if rows:
        e, m = np.mean([r[0] for r in rows], 0), np.mean([r[1] for r in rows], 0)
        print(f"{b[0]:.2f}-{b[1]:.2f} s ({len(rows):3d} frames): error {np.round(e, 1)}  measured {np.round(m, 0)}")

print("\n## spectra of the vertical force in contact (root axis of largest mean force), band powers of measured and error")
bands = [(0, 2), (2, 4), (4, 6), (6, 8), (8, 10), (10, 15)]
total = {b: np.zeros(2) for b in bands}
for trial in JUMPS:
    time, air, counts, measured, predicted = series(trial)
    up = int(np.nanargmax(np.abs(np.nanmean(measured[counts & ~air][:, :3], 0))))
    for a, b in runs(counts & ~air):
        if b - a < 20:
            continue
        m, e = measured[a:b, up], (predicted - measured)[a:b, up]
        if not (np.all(np.isfinite(m)) and np.all(np.isfinite(e))):
            continue
        for k, x in enumerate([m - m.mean(), e]):
            f, p = welch(x, 100, nperseg=min(len(x), 64), detrend=False)
            for band in bands:
                s = (f >= band[0]) & (f < band[1])
                total[band][k] += p[s].sum() * (b - a)
sums = sum(total.values())
for band, v in total.items():
    print(f"{band[0]:2d}-{band[1]:2d} Hz: measured {100 * v[0] / sums[0]:5.1f} %  error {100 * v[1] / sums[1]:5.1f} %  error/measured {np.sqrt(v[1] / max(v[0], 1e-9)):.2f}")

print("\n## shift of the plates against the motion, and gain, that fit the vertical force best")
for trial in JUMPS:
    time, air, counts, measured, predicted = series(trial)
    up = int(np.nanargmax(np.abs(np.nanmean(measured[counts & ~air][:, :3], 0))))
    use = counts & ~air & np.isfinite(predicted[:, up]) & np.isfinite(measured[:, up])
    m = np.where(np.isfinite(measured[:, up]), measured[:, up], 0.0)
    best = []
    for shift in np.arange(-0.03, 0.0301, 0.001):
        moved = np.interp(time, time + shift, m)
        best.append((np.mean(np.abs(predicted[use, up] - moved[use])), shift))
    e0 = np.mean(np.abs(predicted[use, up] - m[use]))
    e1, shift = min(best)
    gain = (predicted[use, up] @ m[use]) / (predicted[use, up] @ predicted[use, up])
    e2 = np.mean(np.abs(gain * predicted[use, up] - m[use]))
    print(f"{trial:8s} error {e0:5.1f} N; plates later by {1e3 * shift:+.0f} ms: {e1:5.1f} N; gain {gain:.3f}: {e2:5.1f} N")

print("\n## mass by the plates' impulse from flight to flight (what the stage `flight` left)")
for trial in JUMPS:
    for m in json.loads((ws / "flight" / trial / "impulse_mass.json").read_text()):
        print(f"{trial:8s} {m['mass_kg']:.2f} kg: {m['impulse_ns']:.1f} N·s over {m['duration_s']:.2f} s, velocity changes by {m['velocity_change_mps']:.2f} m/s")
