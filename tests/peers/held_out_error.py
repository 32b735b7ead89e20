"""The held-out error of a workspace, from the rows of its windows.

    held_out_error.py WORKSPACE [WORKSPACE…]

`compare/_study/windows_<trial>.parquet` holds one row for each weak window: when it is, whether in flight, and what each model
leaves there (predicted − measured, force in N and moment in N·m, world axes). This script knows nothing of Aloft but those
columns and two rules: in flight all trials count, or only those held out if there are any; in contact those held out. It prints
the root mean square of the force and of the moment over a lever of 0.1 m beside the numbers that `comparison.json` states, and
ends with 1 where they differ by more than 1e-9.
"""

import json
import math
import pathlib
import sys

import polars

LEVER_M = 0.1
AXES = ("x", "y", "z")


def windows(folder, trial, flying):
    table = polars.read_parquet(folder / f"windows_{trial}.parquet")
    return table.filter(polars.col("in_flight") == (1.0 if flying else 0.0))


def error(folder, trials, model, flying):
    """Error, force alone, moment alone, number of windows."""
    force = moment = 0.0
    n = 0
    for trial in trials:
        rows = windows(folder, trial, flying)
        n += rows.height
        for axis in AXES:
            force += float((rows[f"{model}.force_{axis}_n"] ** 2).sum())
            moment += float((rows[f"{model}.moment_{axis}_nm"] ** 2).sum())
    if n == 0:
        return None
    force, moment = math.sqrt(force / n), math.sqrt(moment / n)
    return math.hypot(force, moment / LEVER_M), force, moment, n


def main(workspaces):
    worst = 0.0
    for workspace in workspaces:
        folder = pathlib.Path(workspace) / "compare" / "_study"
        said = json.loads((folder / "comparison.json").read_text())
        trials = said["trials"]
        held = [t["trial"] for t in trials if t["held_out_flight"]]
        counted = {
            "flight": held or [t["trial"] for t in trials],
            "contact": [t["trial"] for t in trials if t["held_out_contact"]],
        }
        print(workspace)
        for entry in said["against_floor"]:
            place = entry["judged_on"]
            own = error(folder, counted[place], said["model"], place == "flight")
            if own is None:
                raise SystemExit(f"{workspace}: no window in {place}, but an error of {entry['held_out_error']} N")
            pairs = [
                (own[0], entry["held_out_error"]),
                (own[1], entry["held_out_force_n"]),
                (own[2], entry["held_out_moment_nm"]),
            ]
            apart = max(abs(a / b - 1.0) for a, b in pairs)
            worst = max(worst, apart)
            floor = entry["floor"]["noise_floor"] if entry["floor"] else math.nan
            print(
                f"  in {place:<8} {own[3]:5d} windows  {own[0]:12.6g} N  force {own[1]:.6g} N  moment {own[2]:.6g} N·m"
                f"  {own[0] / floor:8.3g} times the floor  stated {entry['held_out_error']:.6g} N, apart {apart:.1e}"
            )
    if worst > 1e-9:
        raise SystemExit(f"the stated errors are {worst:.1e} from those of the windows")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    main(sys.argv[1:])
