"""600,000 x 128 rows to a triangle: numpy against crates/regressor/src/triangle.rs, same numbers, same run, one thread.

    OPENBLAS_NUM_THREADS=1 python tests/peers/bench_triangle.py

Prints times, their ratio, and how far numpy's R and the normal equations lie from each other on these rows.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np
from ours import least, line, ours

m, n = 600_000, 128
k = np.arange(m * n, dtype=float)
rows = np.fmod(np.sin(k * 12.9898) * 43_758.5453, 1.0).reshape(m, n)
del k


def blocked(height=4096):
    r = np.zeros((0, n))
    for at in range(0, m, height):
        r = np.linalg.qr(np.vstack([r, rows[at : at + height]]), "r")
    return r


peers = {
    "numpy QR": least(lambda: np.linalg.qr(rows, "r"), 2),
    "numpy QR in blocks of 4,096 rows": least(blocked, 3),
    "numpy normal equations (half the digits)": least(lambda: np.linalg.cholesky(rows.T @ rows), 3),
}
for name, seconds in peers.items():
    line(name, seconds)
found = ours("aloft-regressor", "rows", "600000 x 128")
one = next(s for name, s in found.items() if "1 threads" in name)
two = next(s for name, s in found.items() if "2 threads" in name)
line("aloft, one thread", one)
line("aloft, two threads", two)
print(f"numpy QR / aloft {peers['numpy QR'] / one:.1f}, blocked {peers['numpy QR in blocks of 4,096 rows'] / one:.1f}, two threads x {one / two:.2f}")
