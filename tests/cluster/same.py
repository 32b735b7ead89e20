"""Compares what two workspaces hold of identified parameters, comparison and discovery, byte by byte. Exit code 1 where they differ."""

import hashlib
import sys
from pathlib import Path

FILES = [
    "identify/_study/parameters_weak.json",
    "identify/_study/parameters_paper.json",
    "compare/_study/comparison.json",
    "discovery.json",
]


def main() -> int:
    one, other = (Path(p) for p in sys.argv[1:3])
    different = 0
    for name in FILES:
        a, b = (one / name).read_bytes(), (other / name).read_bytes()
        same = a == b
        different += not same
        print(f"{'same     ' if same else 'DIFFERENT'}  {name}  {len(a)} bytes  {hashlib.sha256(a).hexdigest()[:16]}")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
