"""Workflows on the cores of this machine, to their ends, by the pinned Snakemake from PyPI: `cores.py ALOFT FOLDER`.

1. The demonstration: every file of every result is that of `aloft run`, but for the seconds that manifests record.
2. Two subjects, one with two sessions, whose names and recordings hold spaces, quotes, brackets and other alphabets. One recording is broken
   and one job is killed; then the call is repeated; then the recording is mended. Each time the results are those of `aloft run`.

Snakemake is installed into FOLDER/venv. Where that is not possible (no network, no `venv`), the script says what it skipped and ends well.
"""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from same import unlike

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
SUBJECTS = ["bar 'a' \"1\"/day [1]", "bar 'a' \"1\"/day 2 & 3", "bar {ü} 日本"]
THROWS = ["throw 'one'", "throw [2] $(false) {x}", "throw \"drei\" üñ"]
BROKEN = THROWS[1]

PIPELINE = """name: odd names
model: two_link
marker_set: two-link-chain
object: two_link_chain
subjects: {folders: ["bar *"], sessions: ["day*"]}
trials:
  static: ["static.c3d"]
  calibration: ["hinge_calib.c3d"]
  identify: ["throw*.c3d"]
  validate: []
"""

# the first job that matches dies in the middle of its work
KILLED_ONCE = """#!/bin/sh
case "$*" in
*"--only ik"*)
    if mkdir "{flag}" 2> /dev/null; then
        "{aloft}" "$@" &
        sleep 0.02
        kill -9 $!
        exit 137
    fi ;;
esac
exec "{aloft}" "$@"
"""


def snakemake(folder: Path) -> Path | None:
    """Installs Snakemake; none where that is not possible."""
    venv = folder / "venv"
    program = venv / "bin" / "snakemake"
    if program.is_file():
        return program
    install = [venv / "bin" / "python", "-m", "pip", "install", "-q", "--disable-pip-version-check", "--retries", "1"]
    for command in ([sys.executable, "-m", "venv", venv], [*install, "-r", HERE / "requirements.txt"]):
        try:
            done = subprocess.run(command, capture_output=True, text=True)
        except OSError as e:
            return print(e)
        if done.returncode != 0:
            said = (done.stderr or done.stdout).strip().splitlines()
            return print(said[-1] if said else f"{command[0]} ended with {done.returncode}")
    return program


def check(holds: bool, what: str) -> None:
    if not holds:
        sys.exit(f"FAILED: {what}")


class Case:
    """A study that is processed twice, in two folders with the same words: by Snakemake and by `aloft run`."""

    def __init__(self, program: Path, aloft: Path, folder: Path, pipeline: Path, data: Path | None):
        self.program, self.aloft = program, aloft
        self.one, self.other = folder / "aloft", folder / "snakemake"
        self.words = [str(pipeline), "--workspace", "out", *(["--data", str(data)] if data else [])]
        for at in (self.one, self.other):
            at.mkdir(parents=True)
        self.call(self.other, 0, "workflow")

    def call(self, at: Path, code: int, command: str) -> None:
        done = subprocess.run([self.aloft, command, *self.words], cwd=at, capture_output=True, text=True)
        check(done.returncode == code, f"aloft {command} ended with {done.returncode}, not {code}\n{done.stderr}")

    def jobs(self, well: bool, aloft: Path | None = None) -> str:
        """Snakemake on two cores; what it said."""
        start = time.monotonic()
        config = f"aloft={aloft or self.aloft}"
        command = [self.program, "-s", "Snakefile", "--cores", "2", "--keep-going", "--config", config]
        done = subprocess.run(command, cwd=self.other, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        check((done.returncode == 0) == well, f"Snakemake ended with {done.returncode}\n{done.stdout[-6000:]}")
        print(f"  {done.stdout.count('Finished jobid')} jobs, {time.monotonic() - start:.0f} s")
        return done.stdout

    def compare(self, code: int) -> None:
        self.call(self.one, code, "run")
        different, files = unlike(self.one / "out", self.other / "out")
        names = "\n".join(different[:10])
        check(files > 0 and not different, f"{len(different)} of {files} files differ from those of `aloft run`:\n{names}")
        print(f"  {files} files are those of `aloft run`, but for recorded seconds")


def demonstration(program: Path, aloft: Path, folder: Path) -> None:
    print("the demonstration")
    case = Case(program, aloft, folder, ROOT / "pipelines" / "demo.yaml", None)
    case.jobs(True)
    case.compare(0)
    check("Finished jobid" not in case.jobs(True), "a second call has work to do")


def odd_names(program: Path, aloft: Path, folder: Path) -> None:
    print("several subjects, odd names, a broken recording, a killed job")
    demo = ROOT / "fixtures" / "demo"
    for subject in SUBJECTS:
        at = folder / "data" / subject
        at.mkdir(parents=True)
        for name in ("static.c3d", "hinge_calib.c3d", "object.yaml"):
            shutil.copy(demo / name, at)
        for i, name in enumerate(THROWS, 1):
            shutil.copy(demo / f"throws_0{i}.c3d", at / f"{name}.c3d")
    broken = folder / "data" / SUBJECTS[0] / f"{BROKEN}.c3d"
    good = broken.read_bytes()
    broken.write_bytes(good[:600])
    pipeline = folder / "odd.yaml"
    pipeline.write_text(PIPELINE)
    case = Case(program, aloft, folder / "case", pipeline, folder / "data")
    wrapper = folder / "aloft_killed_once"
    wrapper.write_text(KILLED_ONCE.format(flag=folder / "killed", aloft=aloft))
    wrapper.chmod(0o755)
    case.jobs(False, wrapper)
    check((folder / "killed").is_dir(), "no job was killed")
    said = case.jobs(False)
    for words in (f"import {BROKEN}: ", "1 failed or missing"):
        check(words in said, f"the verdict does not say `{words}`\n{said[-3000:]}")
    case.compare(1)
    time.sleep(1)  # file times decide which jobs Snakemake starts
    broken.write_bytes(good)
    case.jobs(True)
    case.compare(0)


def main() -> None:
    aloft, folder = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    os.environ |= {"NO_COLOR": "1", "COLUMNS": "1000"}
    if os.name == "nt":
        print("skipped: no workflow was run, because Snakemake's jobs need a POSIX shell")
        return
    program = snakemake(folder)
    if program is None:
        print("skipped: no workflow was run, because Snakemake could not be installed from PyPI (see the line above)")
        return
    for case in (demonstration, odd_names):
        at = folder / case.__name__
        shutil.rmtree(at, ignore_errors=True)
        case(program, aloft, at)


if __name__ == "__main__":
    main()
