"""A whole study from C3D to report: wall and processor time, greatest memory; then the same with nothing changed.

    python3 benches/study.py FOLDER [TRIALS]       # 100 trials unless said; FOLDER keeps the simulated recordings

The recordings come from `aloft simulate` (nothing is stored in the repository): nine jump trials for each exercise, five seconds each, 200 Hz,
35 markers, two plates of six channels at 1000 Hz.
"""

import json
import pathlib
import shutil
import sys

from measure import ROOT, aloft, laboratory, run

folder = pathlib.Path(sys.argv[1])
trials = int(sys.argv[2]) if len(sys.argv) > 2 else 100
exercises = max(1, trials // 10)
lab = laboratory(folder / f"study_{trials}", jumps=trials - exercises, exercises=exercises)
workspace = folder / f"workspace_{trials}"
shutil.rmtree(workspace, ignore_errors=True)
where = [str(ROOT / "pipelines" / "human.yaml"), "--data", str(lab), "--workspace", str(workspace)]
megabytes = sum(f.stat().st_size for f in lab.glob("*.c3d")) / 1e6
print(f"{trials} trials and a static one, {megabytes:.0f} MB of C3D")
wall, cpu, memory = run([aloft(), "run", *where])
print(f"run:              {wall:.2f} s, {cpu:.2f} s of processor, {memory:.0f} MB at most")
seconds = {}
for manifest in workspace.glob("*/*/manifest.json"):
    m = json.loads(manifest.read_text())
    seconds[m["stage"]] = seconds.get(m["stage"], 0.0) + m["seconds"]
print("  by stage (sum over trials):", ", ".join(f"{s} {t:.2f} s" for s, t in sorted(seconds.items(), key=lambda x: -x[1])))
report = min(run([aloft(), "report", *where]) for _ in range(3))
print(f"report:           {report[0]:.2f} s, {report[1]:.2f} s of processor, {report[2]:.0f} MB at most")
again = min(run([aloft(), "run", *where]) for _ in range(5))
print(f"nothing changed:  {again[0]:.3f} s, {again[1]:.3f} s of processor")
start = min(run([aloft(), "--version"]) for _ in range(20))
print(f"start-up:         {1e3 * start[0]:.1f} ms")
