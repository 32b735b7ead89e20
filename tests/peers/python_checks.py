"""Checks of the installed Python package; run by `python_package.py` in a new virtual environment.

Each function is one sentence about what holds. Prints the names of those that passed.
"""

import json
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import warnings
from pathlib import Path

import aloft
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa

ROOT = Path(__file__).resolve().parents[2]
PIPELINE = ROOT / "pipelines/demo.yaml"
FOLDER = Path(tempfile.mkdtemp(prefix="aloft-checks-"))


def raised(kind, call):
    try:
        call()
    except kind as error:
        return error
    raise AssertionError(f"no {kind.__name__} was raised")


def every_part_has_documentation_and_units():
    for name in aloft.__all__:
        thing = getattr(aloft, name)
        assert name == "__version__" or thing.__doc__, name
    for name, thing in vars(aloft.Study).items():
        assert name.startswith("_") or thing.__doc__, name
    for name in ["markers", "plate", "motion", "marker_errors", "forces", "windows"]:
        text = getattr(aloft.Study, name).__doc__
        assert " m" in text or "N" in text, name
        assert name == "marker_errors" or "world" in text or "root" in text, name


def a_run_tells_its_progress_in_the_calling_thread(study):
    steps, threads = [], set()

    def told(step):
        steps.append(step)
        threads.add(threading.get_ident())

    done = study.run(progress=told)
    assert done.ok and not done.failures and done["tasks"]
    assert threads == {threading.get_ident()}
    assert steps[-1].done == steps[-1].total > 20 and {s.what for s in steps} >= {"import", "ik", "compare"}
    assert "of" in str(steps[-1])
    again = study.run()
    assert {t["outcome"] for t in again["tasks"]} == {"up to date"}
    assert study.run(dry_run=True, force=True).tasks["outcome"].tolist() == ["would run"] * len(again["tasks"])


def series_are_shared_with_numpy_arrow_polars_and_pandas(study):
    table = study.motion("throws_01")
    rows, columns = table.shape
    assert rows > 1000 and columns == len(table.names) == len(list(table)) and len(table) == rows
    arrow, frame, panda = table.to_arrow(), table.to_polars(), table.to_pandas()
    series = pl.from_arrow(arrow)
    for name in table.names:
        values = table[name]
        assert values.dtype == np.float64 and not values.flags.writeable
        at = values.__array_interface__["data"][0]
        assert table[name].__array_interface__["data"][0] == at
        assert arrow[name].chunk(0).buffers()[1].address == at
        assert frame[name].to_numpy(allow_copy=False).__array_interface__["data"][0] == at
        assert series[name].to_numpy(allow_copy=False).__array_interface__["data"][0] == at
        assert np.shares_memory(panda[name].to_numpy(), values)
        assert panda[name].to_numpy().tobytes() == values.tobytes()
    # the memory outlives the table
    kept, before = table["time_s"], table["time_s"].tolist()
    del table, arrow, frame, panda, series
    assert kept.tolist() == before
    # the files that other programs read hold the same
    path = study.workspace / "filter/throws_01/motion.parquet"
    other = pl.read_parquet(path)
    assert study.motion("throws_01").to_polars().equals(other, null_equal=True)


def tables_of_records_keep_values_and_kinds():
    records = [
        {"name": "a", "n": 1, "x": 0.1, "on": True, "ci95": [1.5, None], "com_m": [1, 2.5, 3], "in": {"y": 5e-324}, "l": ["p"]},
        {"name": None, "n": 2**53 + 1, "x": None, "on": False, "ci95": None, "com_m": [0, 0, -0.0], "new": "ä"},
    ]
    table = aloft.Table.of_records(records)
    wanted = ["name", "n", "x", "on", "ci95.low", "ci95.high", "com_m.x", "com_m.y", "com_m.z", "in.y", "l", "ci95", "new"]
    assert sorted(table.names) == sorted(wanted), table.names
    for frame in (table.to_polars(), pl.from_arrow(table.to_arrow())):
        assert frame["n"].to_list() == [1, 2**53 + 1] and frame["x"].to_list() == [0.1, None]
        assert frame["on"].to_list() == [True, False] and frame["name"].to_list() == ["a", None]
        assert frame["in.y"].to_list() == [5e-324, None] and frame["new"].to_list() == [None, "ä"]
    assert table["n"].dtype == np.int64 and table["on"].dtype == bool and np.isnan(table["x"][1])
    assert table["on"].tolist() == [True, False] and table["name"].tolist() == ["a", None]
    assert table.to_pandas()["name"].tolist()[0] == "a"
    assert "<th>in.y</th>" in table._repr_html_()
    empty = aloft.Table.of_records([])
    assert empty.shape == (0, 0) and empty.to_polars().shape == (0, 0) and empty.to_arrow().num_rows == 0
    raised(KeyError, lambda: table["none"])


def answers_have_the_text_of_the_command_line(study):
    for ask in [study.compare, study.parameters, study.history, study.check, study.status, study.verify, study.summary]:
        answer = ask()
        assert json.loads(answer.json) == dict(answer) and len(answer) == len(list(answer))
        assert repr(answer).startswith("<aloft.")
    assert study.compare().errors.to_pandas()["held_out_error"][0] == study.compare()["errors"][0]["held_out_error"]
    assert study.parameters().base.to_polars().height == len(study.parameters()["base"])
    assert study.parameters().links.to_arrow().num_rows == 2
    assert study.trials.to_polars()["role"].n_unique() >= 2
    assert study.parameters(rows="acceleration")["rows"] != study.parameters()["rows"]
    assert len(study.tables()) > 20
    assert study.forces("throws_01")["in_flight"].max() == 1
    assert study.windows("throws_01").shape[0] > 0 and study.marker_errors("throws_01").shape[0] > 1000
    assert study.markers("throws_01").names[0] == "time_s"
    assert study.flights("throws_01")["start"].dtype == np.int64


def the_model_grows_and_shrinks(study):
    found = study.discover(only="quadratic_drag", closed=True)
    assert found["candidates"] and found.candidates.shape[0] == len(found["candidates"])
    ladder = study.add("quadratic_drag")
    assert ladder.run.ok and ladder["revisions"][1]["at_floor"] is True
    assert json.loads(study.history().json) == json.loads(ladder.json)
    assert raised(aloft.RequestError, lambda: study.add("quadratic_drag")).hint
    assert len(study.remove("quadratic_drag")["revisions"]) == 3


def errors_have_message_hint_and_place(study):
    error = raised(aloft.RequestError, lambda: study.add("quadratic_drg"))
    assert "quadratic_drag" in error.hint and "hint:" in str(error)
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.hint) == (type(error), str(error), error.hint)
    raised(LookupError, lambda: study.motion("throws_99"))
    assert "throws_01" in raised(aloft.RequestError, lambda: study.motion("throws_O1")).hint
    raised(aloft.RequestError, lambda: study.table("ik", "throws_01", "none.parquet"))
    raised(aloft.RequestError, lambda: study.parameters(rows="none"))
    raised(aloft.RequestError, lambda: study.run(from_stage="none"))
    raised(aloft.FileError, lambda: aloft.open(FOLDER / "none.yaml"))
    raised(OSError, lambda: aloft.open(FOLDER / "none.yaml"))
    broken = FOLDER / "broken.yaml"
    broken.write_text(PIPELINE.read_text().replace("filter:", "filtr:"))
    error = raised(aloft.ConfigError, lambda: aloft.open(broken))
    assert error.place is not None and f"line {error.place[0]}" in str(error), error
    raised(aloft.RequestError, lambda: aloft.open(PIPELINE, workspace=FOLDER / "fresh").compare())
    raised(TypeError, lambda: study.compare().table("version"))


def a_result_that_is_not_up_to_date_is_told():
    text = PIPELINE.read_text().replace("../", f"{ROOT}/")
    pipeline = FOLDER / "changed.yaml"
    pipeline.write_text(text)
    study = aloft.open(pipeline, workspace=FOLDER / "changed", data=ROOT / "fixtures/demo")
    study.run()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        study.compare()
        study.motion("throws_01")
    pipeline.write_text(text.replace("cutoff_hz: 10.0", "cutoff_hz: 11.0"))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        assert study.compare().stale.shape[0] > 0
        study.motion("throws_01")
    assert [w.category for w in told] == [aloft.StaleWarning] * 2
    assert all(Path(w.filename) == Path(__file__) for w in told), [w.filename for w in told]


def an_error_of_the_callback_ends_the_work(study):
    def told(step):
        raise ZeroDivisionError(step.what)

    raised(ZeroDivisionError, lambda: study.run(force=True, progress=told))
    raised(ZeroDivisionError, lambda: study.discover(progress=told))
    assert study.run().ok


def control_c_ends_the_work_and_keeps_what_is_done():
    script = f"""
import aloft, os, signal, sys
study = aloft.open({str(PIPELINE)!r}, workspace={str(FOLDER / "stopped")!r})
def told(step):
    if step.done == 5:
        os.kill(os.getpid(), signal.SIGINT)
try:
    study.run(progress=told)
except KeyboardInterrupt:
    done = study.run(dry_run=True)["tasks"]
    left = sum(t["outcome"] == "would run" for t in done)
    assert 0 < left < len(done), (left, len(done))
    assert study.run().ok
    print("kept", len(done) - left)
"""
    if os.name == "posix":
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
        assert done.returncode == 0 and "kept" in done.stdout, done
        assert "panicked" not in done.stderr, done.stderr


def other_threads_run_meanwhile(study):
    ticks, stop = [], threading.Event()

    def count():
        while not stop.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.005)

    thread = threading.Thread(target=count)
    thread.start()
    started = time.monotonic()
    study.run(force=True)
    seconds = time.monotonic() - started
    stop.set()
    thread.join()
    longest = max(b - a for a, b in zip(ticks, ticks[1:]))
    assert longest < max(0.5, 0.3 * seconds), (longest, seconds)


def two_studies_run_in_two_threads():
    answers = {}

    def one(name):
        study = aloft.open(PIPELINE, workspace=FOLDER / name)
        study.run()
        answers[name] = study.compare().json

    threads = [threading.Thread(target=one, args=(name,)) for name in ("a", "b")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert answers["a"] == answers["b"]


def a_fork_is_refused_and_not_waited_for():
    if not hasattr(os, "fork"):
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        child = os.fork()
    if child == 0:
        try:
            aloft.open(PIPELINE)
        except aloft.RequestError as error:
            os._exit(0 if "spawn" in error.hint else 1)
        os._exit(2)
    signal.alarm(60)
    assert os.waitpid(child, 0)[1] == 0
    signal.alarm(0)


def several_subjects_are_members():
    lab = FOLDER / "several"
    for name in ("sub-a", "sub-b"):
        for file in (ROOT / "fixtures/demo").iterdir():
            target = lab / name / file.name
            target.parent.mkdir(parents=True, exist_ok=True)
            if file.is_file():
                target.write_bytes(file.read_bytes())
    study = aloft.open(PIPELINE, data=lab, workspace=FOLDER / "several-ws")
    assert study.run().ok
    assert [m.subject for m in study.members] == ["sub-a", "sub-b"]
    error = raised(aloft.RequestError, study.compare)
    assert "members" in error.hint
    first, second = (m.compare() for m in study.members)
    assert first["errors"] == second["errors"]
    assert aloft.open(PIPELINE, data=lab, workspace=FOLDER / "several-ws", subject="sub-b").subject == "sub-b"
    assert study.summary().table("rows").to_polars()["subject"].n_unique() == 2


def functions_without_a_pipeline_work():
    assert aloft.effects().to_polars().height >= 28
    assert aloft.effect("quadratic_drag").startswith("# ")
    assert "properties" in aloft.schema()
    recording = next((ROOT / "fixtures/demo").glob("*.c3d"))
    assert aloft.inspect(recording)["markers"]
    assert raised(aloft.RequestError, lambda: aloft.effect("quadratic_drg")).hint


def files_for_other_programs_and_the_report_are_written(study):
    done = study.export(FOLDER / "export", formats=["csv", "urdf"])
    assert Path(done["folder"]).is_dir() and not done["failures"]
    page = study.report(FOLDER / "page.html")
    assert page.stat().st_size > 50_000


def main():
    warnings.simplefilter("error", aloft.AloftWarning)
    study = aloft.open(PIPELINE, workspace=FOLDER / "main")
    n, failed = 0, []
    for name, check in list(globals().items()):
        if callable(check) and getattr(check, "__module__", "") == "__main__" and name not in ("main", "raised"):
            started = time.monotonic()
            try:
                check(*([study] if check.__code__.co_argcount else []))
            except Exception:
                traceback.print_exc()
                failed.append(name)
                continue
            print(f"  {name.replace('_', ' ')} ({time.monotonic() - started:.1f} s)")
            n += 1
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")
    print(f"{n} checks passed; numpy {np.__version__}, pandas {pd.__version__}, polars {pl.__version__}, pyarrow {pa.__version__}")


if __name__ == "__main__":
    main()
