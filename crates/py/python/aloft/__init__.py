"""Aloft: the mass properties of a moving body from its motion in flight, and the physics that a model is missing.

    import aloft

    s = aloft.open("study.yaml")
    s.run()                       # from recordings to parameters and their error
    s.compare()                   # where the model fails
    s.discover()                  # which effect is missing
    s.add("quadratic_drag")       # add it to the model
    s.history()                   # revisions of the model with their errors

The package calls the functions behind the command `aloft`; answers hold the numbers that it prints with
`--json`, to the last bit. SI units everywhere, radians; the world is right-handed with Z up; names of
keys and columns carry units. Work runs without Python's lock (GIL) and ends on Ctrl-C.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from . import _aloft
from ._aloft import __version__
from ._answers import Answer, Comparison, Discovery, History, Parameters, Run
from ._errors import (
    AloftError,
    AloftWarning,
    ConfigError,
    DamagedError,
    DefectError,
    FailedTrialsWarning,
    FileError,
    LockedError,
    RequestError,
    StaleWarning,
)
from ._study import Names, PathLike, Progress, Study
from ._table import Table

__all__ = [
    "AloftError",
    "AloftWarning",
    "Answer",
    "Comparison",
    "ConfigError",
    "DamagedError",
    "DefectError",
    "Discovery",
    "FailedTrialsWarning",
    "FileError",
    "History",
    "LockedError",
    "Parameters",
    "Progress",
    "RequestError",
    "Run",
    "StaleWarning",
    "Study",
    "Table",
    "__version__",
    "effect",
    "effects",
    "init",
    "inspect",
    "open",
    "schema",
    "simulate",
]


def open(
    pipeline: PathLike,
    *,
    data: PathLike | None = None,
    workspace: PathLike | None = None,
    subject: Names = None,
    session: Names = None,
) -> Study:
    """Opens a pipeline file.

    Args:
        pipeline: the pipeline file (YAML).
        data: folder of recordings, instead of the pipeline's.
        workspace: folder of results, instead of the pipeline's.
        subject, session: names or patterns, to choose among several.

    Raises:
        ConfigError: the file says something that cannot be; `place` is the line and column.
        FileError: the file cannot be read.
    """
    return Study(pipeline, data, workspace, subject, session)


def effects(pipeline: PathLike | None = None) -> Table:
    """The effects that a model can hold: the catalogue, and those that a pipeline defines or names."""
    found = json.loads(_aloft.effects(None if pipeline is None else Path(pipeline)))
    return Table.of_records(found)


def effect(name: str, pipeline: PathLike | None = None) -> str:
    """Physics, equation, unknowns with units and sources of one effect, as Markdown."""
    return _aloft.show_effect(name, None if pipeline is None else Path(pipeline))


def inspect(file: PathLike) -> Answer:
    """What is in a recording (C3D, TRC …), and what is wrong with it."""
    return Answer(_aloft.inspect(Path(file)))


def init(
    folder: PathLike, out: PathLike | None = None, *, one_subject: bool = False, subject: str | None = None
) -> Path:
    """Inspects a folder of recordings and writes a commented pipeline file; returns its path.

    Args:
        folder: folder of recordings.
        out: the pipeline file; ``aloft.yaml`` in the current folder where not given.
        one_subject: all recordings are of one person, whatever names and folders say.
        subject: use only the files that name this subject.
    """
    return Path(_aloft.init(Path(folder), None if out is None else Path(out), one_subject, subject))


def simulate(scenario: PathLike, out: PathLike, *, seed: int | None = None) -> list[Path]:
    """Writes a laboratory folder of simulated recordings with known truth; returns the files."""
    return [Path(p) for p in _aloft.simulate(str(scenario), Path(out), seed)]


def schema() -> dict[str, Any]:
    """The JSON schema of pipeline files."""
    found: dict[str, Any] = json.loads(_aloft.schema())
    return found
