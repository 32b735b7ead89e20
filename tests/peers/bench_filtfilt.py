"""scipy's filtfilt on the input of crates/signal/benches/filtfilt.rs: 105 channels x 100,000 samples, order 3, 10 Hz at 200 Hz.

    python tests/peers/bench_filtfilt.py
"""

import time

import numpy as np
import scipy
from scipy import signal

x = np.sin(0.37 * np.arange(105 * 100_000)).reshape(105, 100_000)
b, a = signal.butter(3, 10.0, fs=200.0)
for name, data, axis in [("channel-major", x, 1), ("frame-major", np.ascontiguousarray(x.T), 0)]:
    times = []
    for _ in range(5):
        start = time.perf_counter()
        signal.filtfilt(b, a, data, axis=axis)
        times.append(time.perf_counter() - start)
    print(f"scipy {scipy.__version__} {name}: {x.size / min(times) / 1e6:.0f} Msamples/s")
