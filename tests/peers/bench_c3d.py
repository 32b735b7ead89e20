"""Reading C3D files from memory to typed markers and channels: ezc3d and the Python package c3d against crates/c3d, same files, same run.

    python tests/peers/bench_c3d.py FOLDER      # the eight largest files below FOLDER, as crates/c3d/benches/read.rs takes them

ezc3d reads from disk only: its file is in the page cache.
"""

import io
import pathlib
import sys

import c3d
import ezc3d
from ours import least, line, ours

folder = pathlib.Path(sys.argv[1])
files = sorted(folder.rglob("*.c3d"), key=lambda p: (p.stat().st_size, str(p)))[-8:]
size = sum(p.stat().st_size for p in files)
print(f"{len(files)} files, {size / 1e6:.1f} MB")


def by_ezc3d():
    for path in files:
        c = ezc3d.c3d(str(path))
        c["data"]["points"], c["data"]["analogs"]


readable = []
for path in files:
    try:
        sum(1 for _ in c3d.Reader(io.BytesIO(path.read_bytes())).read_frames())
        readable.append(path.read_bytes())
    except Exception as problem:  # the package refuses some vendors' files
        print(f"c3d cannot read {path.name}: {problem}")


def by_c3d():
    for data in readable:
        for _ in c3d.Reader(io.BytesIO(data)).read_frames(copy=False):
            pass


line("ezc3d", e := least(by_ezc3d, 3), size / 1e6, "MB")
part = sum(map(len, readable))
line("c3d (Python)", p := least(by_c3d, 3) * size / max(part, 1), size / 1e6, "MB")
found = ours("aloft-c3d", "read", "recorded/together")
a = min(found.values())
line("aloft", a, size / 1e6, "MB")
print(f"ezc3d / aloft {e / a:.0f}, c3d / aloft {p / a:.0f}")
