"""Exceptions and warnings of the package. The messages are those of the command line."""

from __future__ import annotations


class AloftError(Exception):
    """An error of the program: what happened and where, and what to do about it.

    Attributes:
        problem: what was found and what was expected.
        hint: what to do about it, if the program knows.
        place: line and column in the pipeline file, both from 1, for errors in it.
    """

    def __init__(self, problem: str, *, hint: str | None = None, place: tuple[int, int] | None = None) -> None:
        super().__init__(problem)
        self.problem = problem
        self.hint = hint
        self.place = place

    def __str__(self) -> str:
        where = "" if self.place is None else f" (line {self.place[0]}, column {self.place[1]})"
        return self.problem + where + (f"\nhint: {self.hint}" if self.hint else "")

    def __reduce__(self) -> tuple[object, ...]:
        return _again, (type(self), self.problem, self.hint, self.place)


def _again(kind: type[AloftError], problem: str, hint: str | None, place: tuple[int, int] | None) -> AloftError:
    return kind(problem, hint=hint, place=place)


class ConfigError(AloftError, ValueError):
    """The pipeline or a file that it names says something that cannot be."""


class RequestError(AloftError, LookupError):
    """The request names something that is not there, or needs results that do not exist yet."""


class FileError(AloftError, OSError):
    """A file cannot be read or written."""


class DamagedError(AloftError):
    """A result is not what was written; `run()` makes it again."""


class LockedError(AloftError):
    """Another run holds the workspace."""


class DefectError(AloftError, RuntimeError):
    """A defect of the program, not of the data."""


class AloftWarning(UserWarning):
    """A remark of the program."""


class StaleWarning(AloftWarning):
    """An answer rests on results that the pipeline and the recordings would not give now."""


class FailedTrialsWarning(AloftWarning):
    """Some trials failed in a run; the results of the others are complete."""
