"""What two foreign readers, ezc3d and the Python package c3d, see in C3D files.

    c3d_ezc3d.py golden OUT.json FOLDER...      summaries of every file, which crates/c3d/tests/foreign_readers.rs compares
    c3d_ezc3d.py same ORIGINALS REWRITTEN       both readers must see the same in two folders of equal layout
                                                (REWRITTEN made by `cargo run --release -p aloft-c3d --example rewrite`)

Needs numpy, ezc3d and c3d. A summary keeps sums over all samples and the values at a few places, never whole recordings.
"""

import json
import math
import sys
import warnings
from pathlib import Path

import c3d
import ezc3d
import numpy as np

warnings.filterwarnings("ignore")


def short(x):
    """Eight digits: single precision and a little."""
    return float(f"{float(x):.8g}")


def numbers(array):
    """JSON has no NaN: null stands for it."""
    return [None if not math.isfinite(x) else short(x) for x in np.asarray(array, dtype=float).ravel()]


def places(n):
    """Frames or samples that a summary shows."""
    return sorted({n // 3, n - 1}) if n > 0 else []


def point_summary(xyz, valid, residual=None):
    """xyz (n, 3), valid (n)."""
    n = len(xyz)
    good = xyz[valid]
    out = {
        "valid": int(valid.sum()),
        "sum": numbers(good.sum(axis=0) if len(good) else np.zeros(3)),
        "at": [[i, *(numbers(xyz[i]) if valid[i] else [None] * 3)] for i in places(n)],
    }
    if residual is not None:
        out["residual_sum"] = short(residual[valid].sum())
    return out


def series_summary(values):
    values = np.asarray(values, dtype=float)
    finite = np.where(np.isfinite(values), values, 0.0)
    return {"sum": short(finite.sum()), "abs": short(np.abs(finite).sum()),
            "at": [[i, *numbers([values[i]])] for i in places(len(values))]}


def vector_summary(values):
    """values (3, n)."""
    return [series_summary(row) for row in values]


def strings(parameters, group, name):
    """LABELS, LABELS2, ... together."""
    out = []
    for k in range(1, 100):
        key = name if k == 1 else f"{name}{k}"
        if group not in parameters or key not in parameters[group]:
            break
        out += [str(s).strip() for s in parameters[group][key]["value"]]
    return out


def with_ezc3d(path):
    try:
        file = ezc3d.c3d(str(path))
    except Exception as problem:  # the reader's own words
        return {"error": str(problem)[:200]}
    parameters = file["parameters"]
    points = file["data"]["points"]
    residuals = file["data"]["meta_points"]["residuals"][0]
    analogs = file["data"]["analogs"][0]
    out = {
        "frames": int(points.shape[2]),
        "point_rate_hz": float(file["header"]["points"]["frame_rate"]),
        "first_frame": int(file["header"]["points"]["first_frame"]) + 1,
        "labels": strings(parameters, "POINT", "LABELS")[: points.shape[1]],
        "points": [],
        "analog_labels": strings(parameters, "ANALOG", "LABELS")[: analogs.shape[0]],
        "analogs": [series_summary(a) for a in analogs],
    }
    for i in range(points.shape[1]):
        xyz = points[:3, i, :].T
        valid = (residuals[i] >= 0) & np.isfinite(xyz).all(axis=1)
        out["points"].append(point_summary(xyz, valid))
    if "EVENT" in parameters and "TIMES" in parameters["EVENT"]:
        times = np.asarray(parameters["EVENT"]["TIMES"]["value"], dtype=float)
        if times.ndim == 2 and times.shape[0] == 2:
            out["event_times_s"] = numbers(60 * times[0] + times[1])
    try:
        plates = ezc3d.c3d(str(path), extract_forceplat_data=True)["data"]["platform"]
        out["plates"] = [
            {
                "corners": numbers(np.asarray(p["corners"]).T),
                "position_unit": str(p["unit_position"]),
                "force": vector_summary(p["force"]),
                # about the mean of the corners, world axes, force unit times position unit
                "moment": vector_summary(p["moment"]),
            }
            for p in plates
        ]
    except Exception as problem:
        out["plates_error"] = str(problem)[:200]
    return out


def parameters_with_ezc3d(path):
    """Every parameter as ezc3d gives it, but for the place of the samples, which moves."""
    out = {}
    for group, content in ezc3d.c3d(str(path))["parameters"].items():
        for name, parameter in content.items():
            if name != "__METADATA__" and (group, name) != ("POINT", "DATA_START"):
                value = parameter["value"]
                out[f"{group}:{name}"] = repr(value.tolist() if hasattr(value, "tolist") else value)
    return out


def with_python_c3d(path):
    try:
        with open(path, "rb") as handle:
            reader = c3d.Reader(handle)
            points, analogs = [], []
            for _, p, a in reader.read_frames(copy=True):
                points.append(p)
                analogs.append(a)
            points = np.asarray(points, dtype=float)
            out = {
                "frames": len(points),
                "point_rate_hz": float(reader.point_rate),
                "first_frame": int(reader.first_frame),
                "labels": [str(s).strip() for s in reader.point_labels][: points.shape[1] if points.ndim == 3 else 0],
                "points": [],
            }
            if points.ndim == 3:
                for i in range(points.shape[1]):
                    valid = points[:, i, 3] >= 0
                    out["points"].append(point_summary(points[:, i, :3], valid, points[:, i, 3]))
            joined = np.concatenate(analogs, axis=1) if len(analogs) and np.size(analogs[0]) else np.zeros((0, 0))
            out["analogs"] = [series_summary(a) for a in joined]
            return out
    except Exception as problem:
        return {"error": f"{type(problem).__name__}: {problem}"[:200]}


def files(folder):
    folder = Path(folder)
    return {str(p.relative_to(folder)): p for p in sorted(folder.rglob("*")) if p.suffix.lower() == ".c3d"}


def golden(target, folders):
    out = {"ezc3d": ezc3d.__version__, "files": {}}
    for folder in folders:
        for name, path in files(folder).items():
            seen = {"ezc3d": with_ezc3d(path), "python_c3d": with_python_c3d(path)}
            # what both see alike is kept once
            for key in [k for k in seen["python_c3d"] if k != "points" and seen["ezc3d"].get(k) == seen["python_c3d"][k]]:
                seen["python_c3d"][key] = "as ezc3d"
            for i, point in enumerate(seen["python_c3d"].get("points", [])):
                others = seen["ezc3d"].get("points", [])
                if i < len(others) and all(point[k] == others[i][k] for k in ("valid", "sum", "at")):
                    seen["python_c3d"]["points"][i] = {"residual_sum": point["residual_sum"]}
            out["files"][name] = seen
    text = json.dumps(out, indent=None, separators=(",", ":"), sort_keys=True)
    Path(target).write_text(text.replace('},"', '},\n"') + "\n")
    print(f"{len(out['files'])} files")


def same(originals, rewritten):
    bad = 0
    counts = {}
    kept = changed = 0
    new = files(rewritten)
    for name, path in files(originals).items():
        if name not in new:
            print(f"missing: {name}")
            bad += 1
            continue
        old_parameters, new_parameters = parameters_with_ezc3d(path), parameters_with_ezc3d(new[name])
        for key in sorted(old_parameters.keys() | new_parameters.keys()):
            if old_parameters.get(key) != new_parameters.get(key):
                changed += 1
                print(f"ezc3d: {name}: {key} {old_parameters.get(key)} became {new_parameters.get(key)}")
            else:
                kept += 1
        for reader in (with_ezc3d, with_python_c3d):
            a, b = reader(path), reader(new[name])
            key = reader.__name__
            total, equal, unreadable = counts.get(key, (0, 0, 0))
            if "error" in a:
                counts[key] = (total + 1, equal, unreadable + 1)
                if "error" not in b:
                    print(f"{key}: reads the re-written {name}, not the original ({a['error']})")
                continue
            differing = [k for k in a if a.get(k) != b.get(k)]
            counts[key] = (total + 1, equal + (not differing), unreadable)
            if differing:
                bad += 1
                print(f"{key}: {name}: {differing} {b.get('error', '')}")
    for key, (total, equal, unreadable) in counts.items():
        print(f"{key}: {equal} of {total - unreadable} readable files seen alike ({unreadable} originals not readable)")
    print(f"ezc3d: {kept} parameters kept, {changed} changed")
    return bad


if __name__ == "__main__":
    if len(sys.argv) >= 4 and sys.argv[1] == "golden":
        golden(sys.argv[2], sys.argv[3:])
    elif len(sys.argv) == 4 and sys.argv[1] == "same":
        sys.exit(1 if same(sys.argv[2], sys.argv[3]) else 0)
    else:
        sys.exit(__doc__)
