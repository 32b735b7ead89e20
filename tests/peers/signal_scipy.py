"""Goldens of crates/signal, made with scipy.

    python tests/peers/signal_scipy.py        (writes fixtures/goldens/signal_*.json)

`filtfilt`: scipy.signal.filtfilt(*butter(order, cutoff, fs=rate)) with its default padding. Where the transfer-function form itself has
lost its digits (high order at a low cut-off), the reference is sosfiltfilt with the same padding length; both are compared here first
and the form used is recorded. `welch`: scipy.signal.welch. `winter`: design cut-offs by the exact bilinear formula.
"""

import json
import pathlib

import numpy as np
import scipy
from scipy import signal

HERE = pathlib.Path(__file__).resolve().parent
OUT = HERE.parent.parent / "fixtures" / "goldens"


def test_signal(n, rate, seed):
    rng = np.random.default_rng(seed)
    t = np.arange(n) / rate
    return np.round(
        1.5 * np.sin(2 * np.pi * 1.3 * t + 0.4) + 0.4 * np.sin(2 * np.pi * 7.0 * t) - 3.0 * t + 0.05 * rng.standard_normal(n), 9
    )


def filtfilt_cases():
    cases = []
    for order in list(range(1, 9)) + [10, 12]:
        pad = 3 * (order + 1)
        for rate, cutoff in [(100.0, 6.0), (200.0, 10.0), (1000.0, 20.0), (120.0, 50.0), (200.0, 0.7)]:
            for n in [pad + 1, 100]:
                x = test_signal(n, rate, 1000 * order + n)
                sos = signal.butter(order, cutoff, fs=rate, output="sos")
                y_sos = signal.sosfiltfilt(sos, x, padlen=pad)
                with np.errstate(all="ignore"):
                    import warnings

                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore")
                        y_tf = signal.filtfilt(*signal.butter(order, cutoff, fs=rate), x)
                gap = np.max(np.abs(y_sos - y_tf)) if np.all(np.isfinite(y_tf)) else np.inf
                form = "filtfilt" if gap < 5e-11 else "sosfiltfilt"
                if order <= 3 and cutoff >= 6.0:
                    assert form == "filtfilt", (order, rate, cutoff, gap)
                y = y_tf if form == "filtfilt" else y_sos
                cases.append(
                    dict(order=order, rate_hz=rate, cutoff_hz=cutoff, form=form, x=x.tolist(), y=[float(v) for v in y])
                )
    return cases


def winter_cases():
    cases = []
    for order in [1, 2, 3, 4]:
        for rate, cutoff in [(100.0, 6.0), (200.0, 6.0), (200.0, 12.0), (100.0, 12.0), (250.0, 10.0)]:
            c = (np.sqrt(2.0) - 1.0) ** (1.0 / (2 * order))
            design = rate / np.pi * np.arctan(np.tan(np.pi * cutoff / rate) / c)
            # the check that scipy's own filter is really -3 dB there, after both passes
            b, a = signal.butter(order, design, fs=rate)
            _, h = signal.freqz(b, a, worN=[cutoff], fs=rate)
            assert abs(abs(h[0]) ** 2 - np.sqrt(0.5)) < 1e-10
            cases.append(dict(order=order, rate_hz=rate, cutoff_hz=cutoff, design_cutoff_hz=float(design)))
    return cases


def welch_cases():
    cases = []
    for n, rate, nperseg in [(500, 200.0, 128), (300, 100.0, 75), (64, 50.0, 64)]:
        x = test_signal(n, rate, n)
        f, p = signal.welch(x, fs=rate, nperseg=nperseg)
        cases.append(dict(rate_hz=rate, segment=nperseg, x=x.tolist(), frequency_hz=f.tolist(), density=p.tolist()))
    return cases


def main():
    OUT.mkdir(parents=True, exist_ok=True)
    made_with = dict(scipy=scipy.__version__, numpy=np.__version__, script="tests/peers/signal_scipy.py")
    for name, cases in [("filtfilt", filtfilt_cases()), ("winter", winter_cases()), ("welch", welch_cases())]:
        path = OUT / f"signal_{name}.json"
        path.write_text(json.dumps(dict(made_with=made_with, cases=cases)) + "\n")
        print(path.name, len(cases), path.stat().st_size)
        if name == "filtfilt":
            print("   forms:", {f: sum(c["form"] == f for c in cases) for f in ("filtfilt", "sosfiltfilt")})
            print("   sos:", sorted({(c["order"], c["rate_hz"], c["cutoff_hz"]) for c in cases if c["form"] == "sosfiltfilt"}))


if __name__ == "__main__":
    main()
