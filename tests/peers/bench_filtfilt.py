"""scipy's filtfilt on the input of crates/signal/benches/filtfilt.rs: 105 channels x 100,000 samples, order 3, 10 Hz at 200 Hz.

    python tests/peers/bench_filtfilt.py
"""

import numpy as np
import scipy
from ours import least, line, ours
from scipy import signal

x = np.sin(0.37 * np.arange(105 * 100_000)).reshape(105, 100_000)
b, a = signal.butter(3, 10.0, fs=200.0)
peers = {}
for name, data, axis in [("channel-major", x, 1), ("frame-major", np.ascontiguousarray(x.T), 0)]:
    peers[name] = least(lambda: signal.filtfilt(b, a, data, axis=axis))
    line(f"scipy {scipy.__version__} {name}", peers[name], x.size / 1e6, "Msamples")
for name, seconds in ours("aloft-signal", "filtfilt", "105 x 100000").items():
    layout = next(k for k in peers if k in name)
    line(f"aloft {layout}", seconds, x.size / 1e6, "Msamples")
    print(f"  scipy / aloft {peers[layout] / seconds:.1f}")
