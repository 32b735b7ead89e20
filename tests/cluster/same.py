"""Compares two workspaces: `same.py ONE OTHER`. Exit code 1 where they differ.

1. What was concluded, byte by byte: identified parameters, comparison, discovery.
2. Every result of every stage: its hash of contents, its inputs, parameters, outcome, warnings and figures (all of its manifest
   but the seconds it took). Nodes of the merge tree, which only a workflow makes, are left out.
"""

import hashlib
import json
import sys
from pathlib import Path

FILES = [
    "identify/_study/parameters_weak.json",
    "identify/_study/parameters_acceleration.json",
    "compare/_study/comparison.json",
    "discovery.json",
]


def results(workspace: Path) -> dict[str, dict]:
    out = {}
    for path in workspace.glob("*/*/manifest.json"):
        key = path.parent.relative_to(workspace).as_posix()
        if not key.startswith("merge/"):
            out[key] = json.loads(path.read_text())
            del out[key]["seconds"], out[key]["check"]
    return out


def contents(workspace: Path) -> dict[str, bytes | dict]:
    """Every file of a workspace; of manifests what they hold but for the seconds and the hash over them. Left out is what only one kind of
    run makes: nodes of the merge tree, marks of jobs, the list of the recordings' hashes."""
    out = {}
    for path in workspace.rglob("*"):
        key = path.relative_to(workspace)
        if not path.is_file() or key.name == "inputs.json" or any(p == "merge" or p.startswith(".") for p in key.parts):
            continue
        out[key.as_posix()] = path.read_bytes()
        if key.name == "manifest.json":
            out[key.as_posix()] = json.loads(path.read_text())
            for own in ("seconds", "check"):
                del out[key.as_posix()][own]
    return out


def unlike(one: Path, other: Path) -> tuple[list[str], int]:
    """Files in which two workspaces differ or that only one of them has, and the number of all files."""
    a, b = contents(one), contents(other)
    return sorted(k for k in a.keys() | b.keys() if a.get(k) != b.get(k)), len(a.keys() | b.keys())


def main() -> int:
    one, other = (Path(p) for p in sys.argv[1:3])
    different = 0
    for name in FILES:
        a, b = (one / name).read_bytes(), (other / name).read_bytes()
        different += a != b
        print(f"{'same     ' if a == b else 'DIFFERENT'}  {name}  {len(a)} bytes  {hashlib.sha256(a).hexdigest()[:16]}")
    a, b = results(one), results(other)
    unlike = sorted(k for k in a.keys() | b.keys() if a.get(k) != b.get(k))
    print(f"{len(a.keys() & b.keys()) - len([k for k in unlike if k in a and k in b])} of {len(a)} results have the same contents")
    for key in unlike[:10]:
        print(f"DIFFERENT  {key}")
    return 1 if different or unlike else 0


if __name__ == "__main__":
    sys.exit(main())
