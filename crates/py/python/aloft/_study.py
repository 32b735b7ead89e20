"""A pipeline bound to recordings: the loop, and the series behind it."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from . import _aloft
from ._answers import Answer, Comparison, Discovery, History, Parameters, Run
from ._errors import AloftWarning, FailedTrialsWarning, RequestError, StaleWarning
from ._table import Table

PathLike = str | os.PathLike[str]
Names = str | Sequence[str] | None
A = TypeVar("A", bound=Answer)


class Progress(NamedTuple):
    """One step of a computation, as `progress` functions receive it."""

    what: str
    """Stage, `discover` or `self-test`."""
    subject: str
    """Subject and session, in a study of several."""
    trial: str | None
    """Trial whose task ended; None where there is none."""
    done: int
    """Steps that are done."""
    total: int
    """Steps expected in all."""
    seconds_left: float | None
    """Forecast, s; None while nothing is known."""
    so_far: str | None = None
    """What a discovery knows already, in words; its answer may still differ. None for a step."""

    def __str__(self) -> str:
        if self.so_far is not None:
            return f"{self.what} so far: {self.so_far}"
        words = [w for w in (self.what, self.subject, self.trial) if w]
        left = "" if self.seconds_left is None else f", {self.seconds_left:.0f} s left"
        return f"{' '.join(words)} ({self.done} of {self.total}{left})"


Callback = Callable[[Progress], object] | None


def _told(progress: Callback) -> Callable[..., object] | None:
    if progress is None:
        return None
    call = progress
    return lambda *step: call(Progress(*step))


def _list(names: Names) -> list[str]:
    if names is None:
        return []
    return [names] if isinstance(names, str) else list(names)


class Study:
    """A pipeline bound to the recordings of one subject, or of several.

    Made by :func:`aloft.open`. Every call reads the pipeline file and the results again, so the
    command line, an editor and Python can work on one study in turn.

    For a study of several subjects or sessions, `run` and `summary` work on all of them; the other
    calls need one: `for one in study.members: one.compare()`.
    """

    def __init__(
        self,
        pipeline: PathLike,
        data: PathLike | None = None,
        workspace: PathLike | None = None,
        subject: Names = None,
        session: Names = None,
    ) -> None:
        self._path = Path(pipeline)
        self._data = None if data is None else Path(data)
        self._workspace = None if workspace is None else Path(workspace)
        self._native = _aloft.Native(self._path, self._data, self._workspace, _list(subject), _list(session))
        for note in self._look()["notes"]:
            warnings.warn(note, AloftWarning, stacklevel=3)

    # --- what there is

    def _look(self) -> dict[str, Any]:
        look: dict[str, Any] = json.loads(self._native.look())
        return look

    @property
    def path(self) -> Path:
        """The pipeline file."""
        return self._path

    @property
    def workspace(self) -> Path:
        """The folder of results."""
        return Path(self._look()["workspace"])

    @property
    def data(self) -> Path:
        """The folder of recordings."""
        return Path(self._look()["data"])

    @property
    def members(self) -> list[Study]:
        """The subjects and sessions, each as a study of its own; of a study of one subject, itself."""
        look = self._look()
        if not look["several"]:
            return [self]
        return [
            Study(self._path, self._data, self._workspace, _exactly(m["subject"]), _exactly(m["session"]))
            for m in look["members"]
        ]

    @property
    def subject(self) -> str | None:
        """Name of the subject's folder, for a member of a study of several."""
        members = self._look()["members"]
        return members[0]["subject"] if len(members) == 1 else None

    @property
    def session(self) -> str | None:
        """Name of the session's folder, for a member of a study of several sessions."""
        members = self._look()["members"]
        return members[0]["session"] if len(members) == 1 else None

    @property
    def trials(self) -> Table:
        """The recordings: `name`, `role` (static, calibration, identify, validate), `file`, `group`, `excluded`."""
        return Table.of_records(self._one()["trials"])

    def __repr__(self) -> str:
        look = self._look()
        members = look["members"]
        n = sum(len(m["trials"]) for m in members)
        who = f"{len(members)} subjects or sessions, " if len(members) != 1 else ""
        return f"<aloft.Study {look['name']}: {who}{n} recordings in {look['data']}>"

    def _one(self) -> dict[str, Any]:
        """The only member; an error that explains how to choose if there are several."""
        look = self._look()
        members: list[dict[str, Any]] = look["members"]
        if len(members) == 1:
            return members[0]
        names = ["/".join(x for x in (m["subject"], m["session"]) if x) for m in members]
        raise RequestError(
            f"{look['data']} holds {len(names)} subjects or sessions; this needs one",
            hint=f"take one of study.members, or aloft.open(…, subject=…); there are {', '.join(names)}",
        )

    # --- the loop

    def run(
        self,
        *,
        from_stage: str | None = None,
        only: str | None = None,
        until: str | None = None,
        trials: Names = None,
        force: bool = False,
        dry_run: bool = False,
        wait: bool = False,
        progress: Callback = None,
    ) -> Run:
        """Brings the results up to date: from recordings to parameters and their error.

        Only what changed runs again. A trial that fails does not stop the others: a warning names it,
        and `Run.failures` has the reason. Ctrl-C ends the run after the tasks that have begun; what is
        done is kept.

        Args:
            from_stage, only, until: stages to run (all by default).
            trials: names or patterns of trials (all by default).
            force: also run what is up to date.
            dry_run: only report what would run.
            wait: wait for another run that holds the workspace.
            progress: called with a :class:`Progress` after each task, in the calling thread.
        """
        done = Run(
            self._native.run(
                from_stage, only, until, _list(trials), force, dry_run, wait, _told(progress)
            )
        )
        _warn_of(done, stacklevel=3)
        return done

    def compare(self) -> Comparison:
        """Model against measurement: held-out error and noise floor, by trial, phase, axis and segment.

        Forces in N, moments in N·m; the names of keys state axes (`force_world_n`: world, Z up;
        `force_n`: root link).
        """
        return self._answer(Comparison, self._native.compare)

    def discover(
        self,
        *,
        only: Names = None,
        without: Names = None,
        closed: bool = False,
        budget_s: float | None = None,
        progress: Callback = None,
    ) -> Discovery:
        """Ranks the physical effects and measurement errors that the model may be missing.

        Args:
            only: effects to try (all by default).
            without: effects to leave out.
            closed: leave out the search beyond the catalogue.
            budget_s: limit of that search, s.
            progress: called with a :class:`Progress` as effects are scored.
        """
        self._one()
        told = _told(progress)
        names = _list(only), _list(without)
        return self._answer(Discovery, lambda: self._native.discover(*names, closed, budget_s, told))

    def add(
        self,
        effect: str,
        values: Mapping[str, float] | None = None,
        *,
        wait: bool = False,
        progress: Callback = None,
    ) -> History:
        """Adds an effect to the model as a new revision, and brings its results up to date.

        Args:
            effect: name of the effect, with its target if it has one (`"tether[pelvis]"`), or a law
                that the last `discover` found.
            values: parameters that are stated and not fitted, in SI units, by name.

        Returns the history, with the new revision last.
        """
        self._one()
        set_values = [(name, float(value)) for name, value in (values or {}).items()]
        return self._changed(self._native.add(effect, set_values, wait, _told(progress)))

    def remove(self, effect: str, *, wait: bool = False, progress: Callback = None) -> History:
        """Removes an effect from the model: a new revision without it."""
        self._one()
        return self._changed(self._native.remove(effect, wait, _told(progress)))

    def history(self) -> History:
        """Revisions of the model with their held-out errors, N."""
        return self._answer(History, self._native.history)

    def parameters(self, *, rows: str | None = None, assess: bool = False) -> Parameters:
        """What was identified, with 95 % intervals and the prior beside it.

        Args:
            rows: `"weak"` or `"acceleration"`; by default those of the pipeline.
            assess: also compute the assessment of window lengths and errors in variables.
        """
        return self._answer(Parameters, lambda: self._native.parameters(rows, assess))

    # --- more answers

    def estimators(self) -> Answer:
        """Estimators beside each other, on the same held-out motion."""
        return self._answer(Answer, self._native.estimators)

    def leave_one_out(self) -> Answer:
        """The parameters with each trial left out in turn."""
        return self._answer(Answer, self._native.leave_one_out)

    def self_test(self, *, only: Names = None, without: Names = None, progress: Callback = None) -> Answer:
        """Injects effects of known size into these recordings and tries to find them."""
        self._one()
        told = _told(progress)
        return self._answer(Answer, lambda: self._native.self_test(_list(only), _list(without), told))

    def check(self) -> Answer:
        """Configuration, labels and files, and what the recordings say about themselves; changes nothing."""
        return self._answer(Answer, self._native.check)

    def status(self) -> Answer:
        """The state of every result: `rows` with one cell a stage."""
        return self._answer(Answer, self._native.status)

    def verify(self) -> Answer:
        """Compares every file of the results with its hash."""
        return self._answer(Answer, self._native.verify)

    def summary(self) -> Answer:
        """One row a trial over all subjects and sessions, with reasons of quality control (`rows`)."""
        return Answer(self._native.summary())

    def export(
        self, to: PathLike | None = None, *, formats: Names = None, trials: Names = None, angles: str | None = None
    ) -> Answer:
        """Writes results for other programs; `folder` in the answer is where.

        Args:
            to: folder; `export` in the workspace by default.
            formats: `"osim"`, `"urdf"`, `"mjcf"`, `"c3d"`, `"csv"`, `"parquet"` … (all by default).
            angles: `"model"` or `"isb"`.
        """
        self._one()
        where = None if to is None else Path(to)
        done = Answer(self._native.export(where, _list(formats), _list(trials), angles))
        for what, problem in done["failures"]:
            warnings.warn(f"{what}: {problem}", AloftWarning, stacklevel=2)
        return done

    def report(self, out: PathLike | None = None) -> Path:
        """Writes the report, one self-contained HTML page; returns its path."""
        self._one()
        return Path(self._native.report(None if out is None else Path(out)))

    # --- series

    def tables(self) -> list[tuple[str, str | None, str]]:
        """All tables of the results: stage, trial (None for the whole study), file. See :meth:`table`."""
        self._one()
        return self._native.tables()

    def table(self, stage: str, trial: str | None, file: str) -> Table:
        """A table of the results as it lies in the workspace."""
        return Table(_aloft.NativeTable.read(self._result(stage, trial, file)))

    def markers(self, trial: str) -> Table:
        """Markers as recorded: `time_s`, then `LABEL.x`, `.y`, `.z` in m, world frame (Z up); NaN in gaps."""
        return self.table("import", trial, "markers.parquet")

    def plate(self, trial: str, number: int = 1) -> Table:
        """A force plate: `force_n.x` … in N and `moment_nm.x` … in N·m about the world's origin, on the subject.

        World axes (Z up), at the plate's own rate.
        """
        return self.table("import", trial, f"plate_{number}.parquet")

    def motion(self, trial: str, *, filtered: bool = True) -> Table:
        """Joint motion: `time_s`, coordinates, and if filtered velocities and accelerations (`d/dt …`).

        Root: position in m in the world frame and unit quaternion x y z w; spherical joints:
        quaternion from the link's frame to its parent's; hinges: rad. Velocities in m/s and rad/s in
        the axes of the moving link, accelerations their rates. `sd …` are standard deviations.

        Args:
            filtered: through the zero-phase low-pass; False gives inverse kinematics as solved.
        """
        return self.table("filter" if filtered else "ik", trial, "motion.parquet")

    def marker_errors(self, trial: str) -> Table:
        """Distance of each marker from the model, m, one row a frame; NaN where it was not seen."""
        return self.table("ik", trial, "residuals.parquet")

    def forces(self, trial: str) -> Table:
        """External force and moment, measured and of each model, one row a frame.

        `measured.force_x_n` … in N, `measured.moment_x_nm` … in N·m, in the axes of the root link and about
        its origin; `identified.…`, `prior.…` and others beside them. `measured` is zero in flight, NaN
        where the plates do not measure everything. `in_flight` is 1 in flight, `counts` is 1 where
        the frame counts in the errors.
        """
        return self.table("compare", None, f"series_{trial}.parquet")

    def windows(self, trial: str) -> Table:
        """Error of each model over weak windows (predicted − measured): `centre_s`, then force and moment.

        N and N·m in world axes (Z up), moments about the path of the centre of mass.
        """
        return self.table("compare", None, f"windows_{trial}.parquet")

    def flights(self, trial: str) -> Table:
        """The flights of a trial: first frame, and the frame after the last."""
        return Table.of_records(json.loads(self._result("flight", trial, "flights.json").read_text())["flights"])

    # --- inside

    def _result(self, stage: str, trial: str | None, file: str) -> Path:
        self._one()
        path, late = self._native.result(stage, trial, file)
        if late is not None:
            warnings.warn(f"{late}; run() brings results up to date", StaleWarning, stacklevel=4)
        return Path(path)

    def _answer(self, kind: type[A], ask: Callable[[], str]) -> A:
        self._one()
        answer = kind(ask())
        stale = [n for n in answer.get("stale", []) if not n["follows"]]
        if stale:
            first = stale[0]
            of = "" if first["trial"] == "_study" else f" of {first['trial']}"
            more = f", and {len(stale) - 1} more" if len(stale) > 1 else ""
            text = f"{first['state']}: {first['stage']}{of}: {first['because']}{more}; run() brings results up to date"
            warnings.warn(text, StaleWarning, stacklevel=3)
        return answer

    def _changed(self, text: str) -> History:
        both = json.loads(text)
        run = Run(json.dumps(both["run"]))
        _warn_of(run, stacklevel=4)
        return History(json.dumps(both["history"]), run)


def _exactly(name: str | None) -> str | None:
    """The pattern that matches exactly this name."""
    if name is None:
        return None
    return "".join(f"[{c}]" if c in "*?[]{}" else c for c in name)


def _warn_of(run: Run, stacklevel: int) -> None:
    for note in run["notes"]:
        warnings.warn(note, AloftWarning, stacklevel=stacklevel)
    broken = [f"{b['subject']}: {b['because']}" for b in run["broken"]]
    failed = [f"{f['stage']} of {f['trial'] or 'the study'}: {f['because']}" for f in run.failures]
    if broken or failed:
        first, more = (broken + failed)[0], len(broken) + len(failed) - 1
        text = first + (f" … and {more} more (see Run.failures)" if more else "")
        warnings.warn(text, FailedTrialsWarning, stacklevel=stacklevel)
