"""Whether markers overshoot the bone in real drop jumps, x_bone = x_marker + c x_marker'': three ways to estimate c.

    python drop_jump_overshoot.py WORKSPACE

WORKSPACE is that of `aloft run pipelines/drop_jump.yaml --data DATA`. With R the residual (predicted minus measured), the law predicts
R = -c W'' for a wrench W with the content of the motion. W'' can be taken from the motion's own force or from the plates. In flight the
motion's own force is R alone, so that R = -c R'' has a solution near c = <R', R'> / <R'', R''> > 0 for every residual, whatever caused it:
the script prints both. Each jump is predicted from the others; vertical force in contact.
"""
import pathlib, sys
import numpy as np
import polars as pl

ws = pathlib.Path(sys.argv[1])
JUMPS = ["DJ1", "DJ2", "DJ3", "DJAsym1", "DJAsym2", "DJAsym3"]
AXES = ["force_x_n", "force_y_n", "force_z_n"]
RATE_HZ = 100.0


def load(trial):
    t = pl.read_parquet(ws / "compare/_study" / f"series_{trial}.parquet")
    of = lambda name: np.stack([t[f"{name}.{a}"].to_numpy() for a in AXES], 1)
    return of("measured"), of("identified"), t["in_flight"].to_numpy() > 0.5, t["counts"].to_numpy() > 0.5


def first(x):
    out = np.full_like(x, np.nan)
    out[1:-1] = (x[2:] - x[:-2]) * RATE_HZ / 2
    return out


def second(x):
    out = np.full_like(x, np.nan)
    out[1:-1] = (x[2:] - 2 * x[1:-1] + x[:-2]) * RATE_HZ**2
    return out


data = {trial: load(trial) for trial in JUMPS}


def contact(columns):
    """Mean absolute vertical error of each jump with unknowns fitted to the forces of the others, and the unknowns of all."""
    rows = {}
    for trial, (measured, predicted, air, counts) in data.items():
        x = np.stack([c(measured, predicted) for c in columns], 2) if columns else np.zeros((*measured.shape, 0))
        y = predicted - measured
        keep = counts & ~air & np.isfinite(y).all(1) & np.isfinite(x).all((1, 2))
        rows[trial] = (x[keep], y[keep])
    k = len(columns)

    def fit(trials):
        if k == 0:
            return np.zeros(0)
        x = np.concatenate([rows[t][0].reshape(-1, k) for t in trials])
        return np.linalg.lstsq(x, np.concatenate([rows[t][1].ravel() for t in trials]), rcond=None)[0]

    error = [np.abs(rows[t][1][:, 1] - rows[t][0][:, 1] @ fit([u for u in JUMPS if u != t])).mean() for t in JUMPS]
    return error, fit(JUMPS)


delay = lambda measured, predicted: first(measured)
own = lambda measured, predicted: -second(predicted)
plates = lambda measured, predicted: -second(measured)
print("contact, vertical error, N                             DJ1-3             DJAsym1-3           mean   delay s, c s²")
for name, columns in [("nothing", []), ("delay", [delay]), ("delay, c with the motion's own force", [delay, own]), ("delay, c with the force of the plates", [delay, plates])]:
    error, unknowns = contact(columns)
    print(f"{name:40s} {' '.join(f'{e:7.1f}' for e in error)}   {np.mean(error):6.1f}   {' '.join(f'{u:.2e}' for u in unknowns)}")


def flight(residuals):
    """c from R = -c R'', and the share of the error that it leaves."""
    y = np.concatenate([r[1:-1].ravel() for r in residuals])
    x = np.concatenate([-second(r)[1:-1].ravel() for r in residuals])
    c = x @ y / (x @ x)
    return c, np.sqrt(((y - c * x) ** 2).mean() / (y**2).mean())


def stretches():
    for measured, predicted, air, counts in data.values():
        keep = air & np.isfinite(predicted).all(1)
        edges = np.flatnonzero(np.diff(np.r_[0, keep.astype(int), 0]))
        for start, end in zip(edges[::2], edges[1::2]):
            if end - start >= 12:
                yield (predicted - np.where(np.isfinite(measured), measured, 0.0))[start:end]


found = flight(list(stretches()))
inner = [(first(r)[1:-1], second(r)[1:-1]) for r in stretches()]
slopes, bends = (sum((x[i] ** 2).sum() for x in inner) for i in (0, 1))
print(f"\nflight, force: c {found[0]:.2e} s², leaves {found[1]:.2f} of the error; <R', R'> / <R'', R''> of the residual alone {slopes / bends:.2e} s²")
