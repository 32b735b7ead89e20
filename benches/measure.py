"""Shared by the scripts of this folder: simulated studies, and a program run with its time and greatest memory."""

import os
import pathlib
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent


def aloft():
    """The release binary: $ALOFT, or the one of this checkout."""
    if "ALOFT" in os.environ:
        return os.environ["ALOFT"]
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    binary = target / "release" / "aloft"
    if not binary.is_file():
        sys.exit(f"{binary} is missing: cargo build --release")
    return str(binary)


def run(arguments, check=True):
    """Runs a program; gives wall seconds, processor seconds, greatest resident memory in MB."""
    start = time.perf_counter()
    child = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    message = child.stderr.read()
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    wall = time.perf_counter() - start
    if check and child.returncode != 0:
        sys.exit(f"{' '.join(map(str, arguments))}\n{message.decode(errors='replace')}")
    return wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def laboratory(folder, jumps, exercises=2, exercise_s=5.0, flights=(3, 3)):
    """A simulated person's recordings in `folder`, made unless they are there: 200 Hz, 35 markers, two plates; a jump trial of three flights
    lasts about five seconds."""
    folder = pathlib.Path(folder)
    if not (folder / "subject.yaml").is_file():
        folder.parent.mkdir(parents=True, exist_ok=True)
        scenario = folder.with_suffix(".yaml")
        scenario.write_text(
            "name: bench\nseed: 7\nbody:\n  kind: human\n  person: {sex: F, height_m: 1.62, mass_kg: 58.4}\n"
            f"  protocol: {{jumps: {jumps}, flights: [{flights[0]}, {flights[1]}], exercises: {exercises}, "
            f"exercise_s: {exercise_s}}}\n"
        )
        run([aloft(), "simulate", str(scenario), "--out", str(folder)])
    return folder


def chain(folder, recordings):
    """Recordings of a thrown chain of two links in `folder`, made unless they are there: 200 Hz, 9 markers, no plates."""
    folder = pathlib.Path(folder)
    if not (folder / "object.yaml").is_file():
        folder.parent.mkdir(parents=True, exist_ok=True)
        scenario = folder.with_suffix(".yaml")
        scenario.write_text(
            "name: bench\nseed: 3\nbody:\n  kind: chain\n"
            f"  throws: {{recordings: {recordings}, throws: 4, carry_s: [1.2, 1.5], static_s: 1.0, calibration_s: 8.0}}\n"
        )
        run([aloft(), "simulate", str(scenario), "--out", str(folder)])
    return folder
