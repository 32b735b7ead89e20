"""Times of this project's own benches, for the scripts here that time other programs on the same inputs.

`ours(package, bench, filter)` runs `cargo bench` and gives the least time of one iteration in seconds by benchmark; `ratio` prints a line.
`CARGO_TARGET_DIR` and `CARGO` are respected.
"""

import json
import os
import pathlib
import subprocess
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]


def ours(package, bench, only=""):
    """Least seconds an iteration of every benchmark whose name holds `only`."""
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    start = time.time()
    # the whole workspace's features, so that nothing is built twice
    command = [os.environ.get("CARGO", "cargo"), "bench", "--workspace", "--bench", bench, "--", only]
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    found = {}
    for sample in (target / "criterion").rglob("new/sample.json"):
        if sample.stat().st_mtime < start:
            continue
        name = json.loads((sample.parent / "benchmark.json").read_text())["full_id"]
        data = json.loads(sample.read_text())
        found[name] = 1e-9 * min(t / n for t, n in zip(data["times"], data["iters"]))
    if not found:
        raise SystemExit(f"{package}: no benchmark of {bench} matches {only!r}")
    return found


def least(call, repeat=5):
    """Least seconds of a call."""
    best = float("inf")
    for _ in range(repeat):
        start = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - start)
    return best


def line(name, seconds, work=None, unit=""):
    """Prints a time, and the rate where `work` says how much was done."""
    rate = f"   {work / seconds:,.0f} {unit}/s" if work else ""
    print(f"{name:<58} {1e3 * seconds:10.3f} ms{rate}", flush=True)
