#!/usr/bin/env python3
"""Builds the wheel of the Python package and tests it as a user has it: in a new virtual environment.

    tests/peers/python_package.py [--update]

1. The command line is built (`cargo build --release`), then the wheel by maturin from the same build.
2. The wheel is installed in an empty virtual environment (packages from PyPI only), where mypy and its
   `stubtest` check the types, and `python_checks.py` checks tables, errors, progress and Ctrl-C.
3. The notebook `docs/tutorial/python.ipynb` runs there. Its answers are compared with the output of
   the command line in a workspace of its own: the texts have to be equal, byte for byte, and every
   table of the results has to be equal bit for bit.

`--update` writes the outputs of the run into the notebook. Prints the size of the wheel, the times of
building and importing, and `ok`. Everything that it makes lies in a temporary folder, except `target`.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOK = ROOT / "docs/tutorial/python.ipynb"
PIPELINE = ROOT / "pipelines/demo.yaml"
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
ALOFT = TARGET / "release" / ("aloft.exe" if os.name == "nt" else "aloft")

# What the notebook's variables hold, and the command that prints it. The commands run in this
# order.
COMMANDS = [
    (None, ["run", "PIPELINE"]),
    ("comparison", ["compare", "PIPELINE", "--json"]),
    ("discovery", ["discover", "PIPELINE", "--json"]),
    (None, ["effect", "add", "PIPELINE", "quadratic_drag"]),
    ("ladder", ["history", "PIPELINE", "--json"]),
    ("parameters", ["parameters", "PIPELINE", "--json"]),
]


def python_of(folder: Path) -> Path:
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def environment(folder: Path, *packages: str) -> Path:
    venv.create(folder, with_pip=True)
    python = python_of(folder)
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages], check=True)
    return python


def build(folder: Path) -> Path:
    """The wheel, built from the same dependencies as the command line."""
    subprocess.run(["cargo", "build", "--release"], cwd=ROOT, check=True)
    maturin = environment(folder / "maturin", "maturin>=1.8,<2")
    started = time.monotonic()
    wheels = folder / "wheels"
    manifest = ROOT / "crates/py/Cargo.toml"
    subprocess.run(
        [maturin, "-m", "maturin", "build", "--release", "--quiet", "-m", manifest, "--out", wheels], cwd=ROOT, check=True
    )
    [wheel] = wheels.glob("*.whl")
    print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.2f} MB, built in {time.monotonic() - started:.0f} s")
    assert "-abi3-" in wheel.name, "one wheel for all versions of Python"
    return wheel


def run_notebook(python: Path, folder: Path) -> tuple[dict[str, str], Path]:
    """Runs the notebook; returns its answers, and its workspace."""
    out = folder / "answers.json"
    names = [name for name, _ in COMMANDS if name]
    script = f"""
import nbformat, nbclient
book = nbformat.read({str(NOTEBOOK)!r}, as_version=4)
told = nbformat.v4.new_code_cell(
    "import json, pathlib\\n"
    "pathlib.Path({str(out)!r}).write_text(json.dumps("
    "{{name: globals()[name].json for name in {names!r}}} | {{'workspace': str(study.workspace)}}))"
)
book.cells.append(told)
nbclient.NotebookClient(book, timeout=600, kernel_name="python3",
    resources={{"metadata": {{"path": {str(NOTEBOOK.parent)!r}}}}}).execute()
book.cells.pop()
for cell in book.cells:
    cell.metadata = {{}}
book.metadata = {{"kernelspec": {{"display_name": "Python 3", "language": "python", "name": "python3"}}}}
if {"--update" in sys.argv!r}:
    nbformat.write(book, {str(NOTEBOOK)!r})
"""
    subprocess.run([python, "-c", script], check=True)
    answers = json.loads(out.read_text())
    return answers, Path(answers.pop("workspace"))


def command_line(workspace: Path) -> dict[str, str]:
    """The same by the command line."""
    answers = {}
    for name, words in COMMANDS:
        words = [str(PIPELINE) if w == "PIPELINE" else w for w in words]
        done = subprocess.run(
            [ALOFT, *words, "--workspace", workspace], cwd=ROOT, check=True, capture_output=True, text=True, encoding="utf-8"
        )
        if name:
            answers[name] = done.stdout.rstrip("\n")
    return answers


def compare(python: Path, notebook: dict[str, str], shell: dict[str, str], ours: Path, theirs: Path) -> None:
    numbers = 0
    for name, text in shell.items():
        # the history stands in the answer of `add`, and is printed again from its values
        same = notebook[name] == text or json.loads(notebook[name]) == json.loads(text)
        assert same, f"{name}: the notebook and the command line differ"
        numbers += sum(1 for word in text.replace(",", " ").split() if word.lstrip("-")[:1].isdigit())
    print(f"{len(shell)} answers of the notebook are those of the command line: {numbers} numbers, to the last bit")
    # the tables of both workspaces, read by the package
    script = f"""
import aloft, pathlib
ours, theirs = [aloft.open({str(PIPELINE)!r}, workspace=w) for w in ({str(ours)!r}, {str(theirs)!r})]
assert ours.tables() == theirs.tables() and len(ours.tables()) > 20
n = 0
for place in ours.tables():
    a, b = ours.table(*place), theirs.table(*place)
    assert a.names == b.names, place
    for name in a.names:
        assert a[name].tobytes() == b[name].tobytes(), (place, name)
        n += a[name].size
print(f"{{len(ours.tables())}} tables of both workspaces are equal: {{n}} numbers, to the last bit")
"""
    subprocess.run([python, "-c", script], check=True)


def main() -> None:
    with tempfile.TemporaryDirectory(prefix="aloft-python-") as temporary:
        folder = Path(temporary)
        wheel = build(folder)
        packages = ["polars", "pandas", "pyarrow", "mypy", "nbclient", "nbformat", "ipykernel"]
        python = environment(folder / "user", str(wheel), *packages)
        times = []
        for _ in range(5):
            started = time.monotonic()
            subprocess.run([python, "-c", "import aloft"], check=True, cwd=folder)
            whole = time.monotonic() - started
            started = time.monotonic()
            subprocess.run([python, "-c", "import numpy"], check=True, cwd=folder)
            times.append((whole, whole - (time.monotonic() - started)))
        whole, own = sorted(times)[2]
        print(f"import aloft: {1000 * whole:.0f} ms with the start of Python, {1000 * own:.0f} ms more than import numpy")
        types = ROOT / "crates/py/pyproject.toml"
        subprocess.run([python, "-m", "mypy", "--config-file", types, "-p", "aloft"], check=True, cwd=folder)
        subprocess.run([python, "-m", "mypy.stubtest", "--mypy-config-file", types, "aloft._aloft"], check=True, cwd=folder)
        subprocess.run([python, ROOT / "tests/peers/python_checks.py"], check=True, cwd=folder)
        answers, workspace = run_notebook(python, folder)
        theirs = folder / "shell"
        compare(python, answers, command_line(theirs), workspace, theirs)
    print("ok")


if __name__ == "__main__":
    main()
