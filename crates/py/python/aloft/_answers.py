"""Answers: the JSON of the command line as Python data, with its lists as tables."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from ._table import Table


class Answer(Mapping[str, Any]):
    """An answer of the program: what the command line prints with `--json`, key by key.

    `answer["key"]` is plain Python data; `answer.table("key")` is a list of records as a
    :class:`Table`. The keys of each answer are described in the book, in *JSON of the commands*.
    Names of keys carry units (`force_n`, `com_m`, `mass_kg`, `seconds`).
    """

    def __init__(self, text: str) -> None:
        self._text = text
        self._data: dict[str, Any] = json.loads(text)

    @property
    def json(self) -> str:
        """The text that the command line prints."""
        return self._text

    @property
    def stale(self) -> Table:
        """Results behind the answer that the pipeline and the recordings would not give now."""
        return self.table("stale")

    def table(self, key: str) -> Table:
        """A list of records as a table; keys below others are joined by dots (`"held_out.force_n"`)."""
        value: Any = self._data
        for part in key.split("."):
            value = value[part]
        if not isinstance(value, list) or not all(isinstance(v, Mapping) for v in value):
            raise TypeError(f"`{key}` is not a list of records")
        return Table.of_records(value)

    def __getitem__(self, key: str) -> Any:
        return self._data[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._data)

    def __len__(self) -> int:
        return len(self._data)

    def __repr__(self) -> str:
        return f"<aloft.{type(self).__name__}: {', '.join(self._data)}>"


def errors_in_words(errors: list[dict[str, Any]]) -> str:
    """Lines like `in flight: held-out error 0.0479 N, 4.4 times the noise floor (0.0108 N): poor`."""
    lines = []
    for e in errors:
        text = f"in {e['judged_on']}: held-out error {e['held_out_error']:.3g} N"
        if e["noise_floor"] is not None and e["times_floor"] is not None:
            text += f", {e['times_floor']:.2g} times the noise floor ({e['noise_floor']:.3g} N)"
        lines.append(f"{text}: {e['judged']}")
    return "\n".join(lines)


class Comparison(Answer):
    """Model against measurement (`aloft compare --json`)."""

    @property
    def errors(self) -> Table:
        """Held-out error over weak windows and the noise floor, N, in flight and in held-out contact.

        `held_out_error` is the root mean square of the force, with the moment over a lever of 0.1 m;
        `noise_floor` is the error that a perfect model would leave.
        """
        return self.table("errors")

    @property
    def trials(self) -> Table:
        """Errors of the single trials, N and N·m, in contact and in flight.

        `force_n`, `moment_nm` are in the axes of the root link, `force_world_n`, `moment_world_nm` in
        world axes; moments are about the root's origin.
        """
        return self.table("trials")

    def __repr__(self) -> str:
        return f"<aloft.Comparison\n{errors_in_words(self['errors'])}>"


class Parameters(Answer):
    """Identified parameters (`aloft parameters --json`)."""

    @property
    def base(self) -> Table:
        """Base parameters: `name`, `value`, `se` (standard error), 95 % interval, prior, `unit`.

        kg for masses, kg·m for first moments, kg·m² for moments of inertia, in link frames.
        """
        return self.table("base")

    @property
    def links(self) -> Table:
        """Physically consistent links: `mass_kg`, `com_m` and `inertia_kgm2` in the link's frame."""
        return self.table("links")

    @property
    def effects(self) -> Table:
        """Coefficients of the model's effects with standard errors and 95 % intervals.

        SI units; `aloft.effect(name)` states the unit of each.
        """
        return self.table("effects")


class Discovery(Answer):
    """Which effect is missing (`aloft discover --json`)."""

    @property
    def verdict(self) -> str:
        """`supported`, `one_of`, `described`, `nothing_missing`, `not_detectable` …"""
        return str(self["verdict"])

    @property
    def effects(self) -> list[str]:
        """Names of the effects that the verdict speaks of."""
        return list(self["effects"])

    @property
    def candidates(self) -> Table:
        """Every candidate: share of the error that it leaves (`held_out_ratio`), coefficients, confusable effects."""
        return self.table("candidates")

    def __repr__(self) -> str:
        return f"<aloft.Discovery: {self.verdict}: {', '.join(self.effects) or '–'}>"


class History(Answer):
    """Revisions of the model with their errors (`aloft history --json`)."""

    def __init__(self, text: str, run: Run | None = None) -> None:
        super().__init__(text)
        self._run = run

    @property
    def run(self) -> Run | None:
        """What ran for the change, for an answer of `add` or `remove`."""
        return self._run

    @property
    def revisions(self) -> Table:
        """One row a revision: `held_out_error` and `noise_floor` in N, where its effects act."""
        return self.table("revisions")

    def __repr__(self) -> str:
        lines = []
        for r in self["revisions"]:
            error = "–" if r["held_out_error"] is None else f"{r['held_out_error']:.3g} N"
            times = "" if r["times_floor"] is None else f", {r['times_floor']:.2g} times the floor"
            lines.append(f"{r['revision']} {r['action']}: {error}{times}")
        return "<aloft.History\n" + "\n".join(lines) + ">"


class Run(Answer):
    """What a run did."""

    @property
    def ok(self) -> bool:
        """True if no task failed or was blocked, and every subject could be processed."""
        return bool(self["ok"])

    @property
    def seconds(self) -> float:
        """Wall time, s."""
        return float(self["seconds"])

    @property
    def tasks(self) -> Table:
        """One row a task: stage, trial, `outcome` (`ran`, `up to date`, `would run`, `failed`, `blocked`), reason, s."""
        return self.table("tasks")

    @property
    def failures(self) -> list[dict[str, Any]]:
        """The tasks that failed, with reason and hint."""
        return [t for t in self["tasks"] if t["outcome"] == "failed"]

    def __repr__(self) -> str:
        count: dict[str, int] = {}
        for t in self["tasks"]:
            count[t["outcome"]] = count.get(t["outcome"], 0) + 1
        parts = ", ".join(f"{n} {outcome}" for outcome, n in count.items())
        return f"<aloft.Run: {parts}; {self.seconds:.1f} s>"
