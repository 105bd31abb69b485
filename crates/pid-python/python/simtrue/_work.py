"""What one does with a robot and its records."""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Optional

import numpy as np
import numpy.typing as npt

from . import _simtrue
from ._logs import Logs, numbers, read, table, times
from ._results import Diagnosis, Finding, Identification, Interrupted
from ._simtrue import Records, Robot, SimtrueError
from ._types import Path, Values

Step = Optional[Callable[[str], object]]


def load_robot(
    path: Path,
    *,
    trust: str = "cad",
    joints: Optional[Sequence[str]] = None,
    guess_inertias: bool = False,
    strict: bool = False,
    drive: Optional[str] = None,
) -> Robot:
    """Reads a robot from a URDF, an MJCF, a ``nominal.toml`` or a folder with one.

    Args:
        path: the file or folder.
        trust: where masses and inertias of a URDF or MJCF come from: ``cad`` (within 5 %),
            ``data-sheet`` (20 %) or ``guessed`` (a factor of two).
        joints: joints of a URDF that move; the others are held at zero. By default all.
        guess_inertias: masses and inertias that a URDF lacks are guessed from its geometry.
        strict: inertias that no body can have are refused instead of being mended.
        drive: law of the loops by which drives follow commanded positions where logs have no input: ``p``,
            ``pd``, ``pid``, ``cascade`` or ``none``. By default that of the file, or ``pd`` of unknown gains.

    Raises:
        SimtrueError: a file that cannot be read or is no robot.
    """
    of = None if joints is None else list(joints)
    return Robot.load(
        os.fspath(path),
        trust=trust,
        joints=of,
        guess_inertias=guess_inertias,
        strict=strict,
        drive=drive,
    )


def example() -> tuple[Robot, Records]:
    """The embedded example: a robot with two joints, and records of one that has an effect more."""
    return Robot.from_model("two_link"), Records.example()


def check(robot: Robot, logs: Logs, **reading: Any) -> list[Finding]:
    """Checks records against a robot, before anything is fitted; the worst finding first.

    Args:
        robot: the robot.
        logs: as in :func:`read`, whose options are taken as well.

    Raises:
        SimtrueError: logs that cannot be read.
    """
    records = read(robot, logs, **reading)
    found: list[dict[str, Any]] = json.loads(_simtrue.check(robot, records))
    joints = records.joints
    return [
        Finding(
            kind=f["kind"],
            severity=f["severity"],
            joints=tuple(joints[j - 1] for j in f["joints"]),
            record=f["experiment"],
            sentence=f["sentence"],
            mend=f["mend"],
            details=f,
        )
        for f in found
    ]


def diagnose(
    robot: Robot,
    logs: Logs,
    *,
    anyway: bool = False,
    next: bool = False,
    joint_seconds: Optional[float] = None,
    refit_all: bool = False,
    progress: Step = None,
    **reading: Any,
) -> Diagnosis:
    """Names the physical effects that the model of a robot lacks.

    Other Python threads run meanwhile. Ctrl-C ends the search; a second one ends the wait for it.

    Args:
        robot: the robot.
        logs: as in :func:`read`, whose options are taken as well.
        anyway: go on although the records contradict the robot.
        next: look for the motion that separates the first two candidates even where the records
            do so already.
        joint_seconds: length of the train records that is fitted, seconds times joints.
        refit_all: refit every candidate to its end; slow.
        progress: called with each step of the search in words.

    Raises:
        SimtrueError: logs that cannot be read, or that contradict the robot.
        Interrupted: Ctrl-C; ``.result`` is the diagnosis so far.
    """
    records = read(robot, logs, **reading)
    report, cut = _simtrue.diagnose(
        robot,
        records,
        anyway=anyway,
        next=next,
        joint_seconds=joint_seconds,
        refit_all=refit_all,
        step=progress,
    )
    result = Diagnosis(report, tuple(robot.joints))
    if cut:
        raise Interrupted(result)
    return result


def identify(
    robot: Robot,
    logs: Logs,
    *,
    hold: Sequence[str] = (),
    horizon: Optional[str] = None,
    starts: int = 1,
    seed: int = 0,
    progress: Step = None,
    **reading: Any,
) -> Identification:
    """Identifies the parameters of a robot from its train records.

    Tolerances of the robot are bounds and priors, its stated noise is that of the channels, as in
    ``simtrue identify --nominal``. Other Python threads run meanwhile; Ctrl-C as in
    :func:`diagnose`.

    Args:
        robot: the robot.
        logs: as in :func:`read`, whose options are taken as well.
        hold: names of parameters that keep their values.
        horizon: how far a simulation runs before it is restarted: ``record``, a time (``1s``) or a
            number of samples. By default the whole record, or ``1s`` where one is longer than 10 s.
        starts: number of starts, drawn around the first.
        seed: seed of the draws.
        progress: called with each step in words.

    Raises:
        SimtrueError: logs that cannot be read or do not fit the robot.
        Interrupted: Ctrl-C; ``.result`` is the identification so far.
    """
    if starts < 1 or seed < 0:
        raise SimtrueError(
            f"starts = {starts}, seed = {seed}\n  help: give at least one start and a seed from 0"
        )
    records = read(robot, logs, **reading)
    fit, cut = _simtrue.identify(
        robot,
        records,
        hold=[hold] if isinstance(hold, str) else list(hold),
        horizon=horizon,
        starts=starts,
        seed=seed,
        step=progress,
    )
    result = Identification(fit)
    if cut:
        raise Interrupted(result)
    return result


class Motion(NamedTuple):
    """A simulated motion.

    Attributes:
        t: times, s; shape (N,).
        q: positions, rad or m; shape (N, n).
        v: velocities, rad/s or m/s; shape (N, n).
    """

    t: Values
    q: Values
    v: Values


def simulate(
    robot: Robot,
    t: npt.ArrayLike,
    tau: Optional[npt.ArrayLike] = None,
    q0: Optional[npt.ArrayLike] = None,
    v0: Optional[npt.ArrayLike] = None,
    *,
    u: Optional[npt.ArrayLike] = None,
    hold: str = "zero-order",
    parameters: Optional[Mapping[str, float]] = None,
) -> Motion:
    """Simulates a robot, with the effects of its description, at a controlled error of 1e-8.

    Args:
        robot: the robot.
        t: times, s; shape (N,), strictly increasing.
        tau: torques or forces at the joints, N·m or N; shape (N, n). For robots whose inputs are
            such (``Robot.input_units``).
        q0: positions at the first time, rad or m; shape (n,). By default zero.
        v0: velocities at the first time, rad/s or m/s; shape (n,). By default zero.
        u: inputs in the robot's unit, in place of ``tau``; shape (N, n).
        hold: course of the input between times: ``zero-order`` or ``linear``.
        parameters: values by name in place of nominal ones, SI.

    Raises:
        SimtrueError: arrays of other shapes, a parameter that does not exist, a motion that diverges.
    """
    place = "simulate"
    at = times(place, t)
    joints = len(robot.input_units)
    if (tau is None) == (u is None):
        raise SimtrueError(f"{place}: give either `tau` or `u`\n  help: zeros for a robot at rest")
    if tau is not None and any(unit not in ("N*m", "N") for unit in robot.input_units):
        units = ", ".join(robot.input_units)
        raise SimtrueError(
            f"{place}: `tau` is given, and the inputs of `{robot.name}` are in {units}\n"
            "  help: give them as `u`"
        )
    if hold not in ("zero-order", "linear"):
        raise SimtrueError(f"{place}: hold: `{hold}`\n  help: use 'zero-order' or 'linear'")
    word, values = ("tau", tau) if tau is not None else ("u", u)
    inputs = _finite(place, word, table(place, word, values, len(at), joints))  # type: ignore[arg-type]
    start = [_state(place, w, x, joints) for w, x in (("q0", q0), ("v0", v0))]
    own = [(name, float(value)) for name, value in (parameters or {}).items()]
    q, v = _simtrue.simulate(
        robot,
        at.tobytes(),
        inputs.tobytes(),
        start[0].tobytes(),
        start[1].tobytes(),
        linear=hold == "linear",
        values=own,
    )
    return Motion(at, q, v)


def _state(
    place: str, word: str, values: Optional[npt.ArrayLike], joints: int
) -> Values:
    if values is None:
        return np.zeros(joints)
    found = numbers(place, word, values).reshape(-1) if np.ndim(values) == 0 else numbers(place, word, values)
    if found.shape != (joints,):
        raise SimtrueError(
            f"{place}: `{word}` has shape {found.shape}, and there are {joints} joints\n"
            "  help: give one value per joint, base to tip"
        )
    return _finite(place, word, found)


def _finite(
    place: str, word: str, values: Values
) -> Values:
    if bool(np.isfinite(values).all()):
        return values
    at = np.argwhere(~np.isfinite(values))[0]
    where = ", ".join(f"{name} {int(k) + 1}" for name, k in zip(("row", "column"), at))
    raise SimtrueError(
        f"{place}: `{word}`, {where}: {values[tuple(at)]} is no finite number\n"
        "  help: a simulation needs every value"
    )
