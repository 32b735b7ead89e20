"""Cost curves: time and greatest memory of `aloft run` against degrees of freedom, the length of a trial, and the number of trials.

    python3 benches/curves.py FOLDER [MOST]        # 1, 3, 10 … MOST trials (1000 unless said); FOLDER keeps the recordings

Trials beyond twenty are the first twenty again under other names, with another last digit of one sample (their bytes are read, worked on and stored like any others).
Curves of the kernels against markers, degrees of freedom and rows are `cargo bench -p aloft-ik`, `-p aloft-body`, `-p aloft-regressor`.
"""

import json
import os
import pathlib
import shutil
import sys

from measure import ROOT, aloft, chain, laboratory, run

folder = pathlib.Path(sys.argv[1])
most = int(sys.argv[2]) if len(sys.argv) > 2 else 1000


def study(lab, name, pipeline="human"):
    """Wall, processor seconds, MB; wall seconds with nothing changed; MB of the workspace; frames of all trials."""
    workspace = folder / f"workspace_{name}"
    shutil.rmtree(workspace, ignore_errors=True)
    where = [str(ROOT / "pipelines" / f"{pipeline}.yaml"), "--data", str(lab), "--workspace", str(workspace)]
    result = run([aloft(), "run", *where])
    again = min(run([aloft(), "run", *where]) for _ in range(3))
    size = sum(f.stat().st_size for f in workspace.rglob("*") if f.is_file()) / 1e6
    frames = sum(json.loads(f.read_text())["n_frames"] for f in workspace.glob("import/*/trial.json"))
    shutil.rmtree(workspace)
    return *result, again[0], size, frames


print("| body | frames | wall s | processor s | s a thousand frames | memory MB |")
print("|---|---|---|---|---|---|")
for name, lab, pipeline in [
    ("chain, 7 degrees of freedom, 9 markers", chain(folder / "chain_10", 10), "chain"),
    ("person, 34 degrees of freedom, 35 markers", laboratory(folder / "person_10", jumps=9, exercises=1), "human"),
]:
    wall, cpu, memory, _, _, frames = study(lab, "body", pipeline)
    print(f"| {name} | {frames} | {wall:.2f} | {cpu:.2f} | {1e3 * cpu / frames:.3f} | {memory:.0f} |", flush=True)

print()
print("| length of an exercise s | frames | wall s | processor s | memory MB |")
print("|---|---|---|---|---|")
for length in [5, 10, 20, 40, 80]:
    lab = laboratory(folder / f"length_{length}", jumps=1, exercises=1, exercise_s=length)
    wall, cpu, memory, _, _, _ = study(lab, "length")
    print(f"| {length} | {200 * length} | {wall:.2f} | {cpu:.2f} | {memory:.0f} |", flush=True)

print()
source = laboratory(folder / "twenty", jumps=20)
print("| jump trials | wall s | processor s | s a trial | memory MB | nothing changed s | workspace MB |")
print("|---|---|---|---|---|---|---|")
trials = 1
while trials <= most:
    lab = folder / f"copies_{trials}"
    shutil.rmtree(lab, ignore_errors=True)
    lab.mkdir()
    for name in ["static.c3d", "exercise01.c3d", "exercise02.c3d", "subject.yaml"]:
        os.link(source / name, lab / name)
    for i in range(trials):
        # the last digit of one sample differs: Aloft refuses copies
        recording = bytearray((source / f"jump{i % 20 + 1:02}.c3d").read_bytes())
        recording[-3000 - 4 * (i // 20)] ^= 1
        (lab / f"jump{i + 1:04}.c3d").write_bytes(recording)
    wall, cpu, memory, again, size, _ = study(lab, "trials")
    print(f"| {trials} | {wall:.2f} | {cpu:.2f} | {cpu / (trials + 2):.3f} | {memory:.0f} | {again:.3f} | {size:.0f} |", flush=True)
    shutil.rmtree(lab)
    trials = trials * 3 if str(trials)[0] == "1" else trials * 10 // 3
