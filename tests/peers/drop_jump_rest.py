"""What the residual wrench of real drop jumps is made of: reads what `aloft run` and `aloft compare --leave-one-out` left.

    python drop_jump_rest.py WORKSPACE DATA

WORKSPACE is that of `aloft run pipelines/drop_jump.yaml --data DATA`. Prints, for the contact after each landing: error against time
since touch-down, spectra of measured force and of error, the time shift and gain that fit best, one plate at a time, and the balance of
impulse between free phases, which needs no kinematics but the height of the body.
"""
import json, pathlib, sys
import numpy as np
import polars as pl
from scipy.signal import butter, filtfilt, welch

ws, data = map(pathlib.Path, sys.argv[1:3])
JUMPS = ["DJ1", "DJ2", "DJ3", "DJAsym1", "DJAsym2", "DJAsym3"]
AXES = ["force_x_n", "force_y_n", "force_z_n", "moment_x_nm", "moment_y_nm", "moment_z_nm"]
G = 9.80665


def series(trial):
    t = pl.read_parquet(ws / "compare/_study" / f"series_{trial}.parquet")
    stack = lambda name: np.stack([t[f"{name}.{a}"].to_numpy() for a in AXES], 1)
    return t["time_s"].to_numpy(), t["in_flight"].to_numpy() > 0.5, t["counts"].to_numpy() > 0.5, stack("measured"), stack("identified")


def runs(mask):
    edges = np.flatnonzero(np.diff(np.r_[0, mask.astype(int), 0]))
    return list(zip(edges[::2], edges[1::2]))


def mot(trial):
    lines = (data / "forces" / f"{trial}_grf.mot").read_text().splitlines()
    end = next(i for i, l in enumerate(lines) if l.strip() == "endheader")
    names = lines[end + 1].split("\t")
    return names, np.array([[float(x) for x in l.split("\t")] for l in lines[end + 2:] if l.strip()])


def flights(trial):
    return [(f["start"], f["end"]) for f in json.loads((ws / "flight" / trial / "flights.json").read_text())["flights"]]


print("## contact frames that count: mean absolute error by time since touch-down (identified, root axes: forward, up/lateral as in the root frame)")
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

print("\n## balance of impulse over the contact between two free phases: plates against weight and ballistic motion")
mass = json.loads((ws / "scale/_study/subject.json").read_text())["facts"]["mass_kg"]
for trial in JUMPS:
    names, values = mot(trial)
    vertical = sum(values[:, i] for i, n in enumerate(names) if n.endswith("_vy"))
    fl = flights(trial)
    if len(fl) < 2:
        continue
    (a0, a1), (b0, b1) = fl[0], fl[1]
    impulse = np.trapezoid(vertical[a1:b0 + 1], dx=0.01)
    rise = G * (b1 - b0) / 2 / 100  # take-off speed if landing is as high as take-off
    contact = (b0 - a1) / 100
    fall = impulse / mass - G * contact - rise
    print(f"{trial:8s} contact {contact:.2f} s, impulse {impulse:.1f} N·s, take-off {rise:.2f} m/s → touch-down {fall:.2f} m/s (drop of {fall ** 2 / 2 / G:.3f} m)")
