"""Logs: files, frames and arrays as records of a robot."""

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Optional, Protocol, Union, runtime_checkable

import numpy as np
import numpy.typing as npt

from ._simtrue import Records, Robot, SimtrueError
from ._simtrue import read as _read
from ._types import Arrays, Path, Source, Table, Values


@runtime_checkable
class Frame(Protocol):
    """A pandas or polars frame: named columns of equal length."""

    @property
    def columns(self) -> Any:
        """Names of the columns."""

    def __getitem__(self, name: Any, /) -> Any:
        """The column of a name."""


class Record:
    """One experiment as arrays in SI units, joints base to tip.

    Args:
        t: times, s; shape (N,), strictly increasing.
        q: measured positions, rad or m; shape (N, n), or (N,) for one joint. NaN: missing.
        v: measured velocities, rad/s or m/s; as ``q``.
        tau: torques or forces that the drives apply at the joints, N·m or N; as ``q``.
        u: inputs of the drives in the robot's unit (A, V, N·m or N; ``Robot.input_units``); as
            ``q``. Give ``tau`` or ``u``, or neither with ``passive=True``.
        qref: commanded positions, rad or m; as ``q``.
        tau_sensor: torques or forces of a sensor at the joints, N·m or N; as ``q``.
        name: name of the record in results.

    Raises:
        SimtrueError: an array of another shape, or of something else than numbers.
    """

    def __init__(
        self,
        t: npt.ArrayLike,
        q: npt.ArrayLike,
        v: Optional[npt.ArrayLike] = None,
        tau: Optional[npt.ArrayLike] = None,
        *,
        u: Optional[npt.ArrayLike] = None,
        qref: Optional[npt.ArrayLike] = None,
        tau_sensor: Optional[npt.ArrayLike] = None,
        name: str = "",
    ) -> None:
        label = name or "record"
        if tau is not None and u is not None:
            raise SimtrueError(
                f"{label}: `tau` and `u` are given\n"
                "  help: give the input once; a sensor's torque is `tau_sensor`"
            )
        self.name = name
        self.t = times(label, t)
        self.channels: dict[str, Values] = {}
        given = {"q": q, "v": v, "tau": tau, "u": u, "qref": qref, "tau_sensor": tau_sensor}
        joints: Optional[int] = None
        for word, values in given.items():
            if values is not None:
                self.channels[word] = table(label, word, values, len(self.t), joints)
                joints = self.channels[word].shape[1]

    def __repr__(self) -> str:
        rows, joints = self.channels["q"].shape
        return f"Record({self.name!r}, {rows} samples, {joints} joints, {list(self.channels)})"


Log = Union[str, "os.PathLike[str]", Frame, Record]
"""A file or folder of a log, a frame, or arrays."""

Logs = Union[Log, Sequence[Log], Mapping[str, Log], Records]
"""One log, several, several by name, or records that were read before."""


def read(
    robot: Robot,
    logs: Logs,
    *,
    map: Union[str, Iterable[str], None] = None,
    map_file: Optional[Path] = None,
    input: Optional[str] = None,
    gain: Optional[Sequence[float]] = None,
    input_hold: Optional[str] = None,
    targets: bool = False,
    gain_factor: Union[str, Iterable[str], None] = None,
    passive: bool = False,
    test: Union[str, Iterable[str], None] = None,
    sample_time: Optional[float] = None,
) -> Records:
    """Reads logs as records of a robot.

    Columns are found by their names and the names of the joints, units by brackets such as
    ``elbow_pos [deg]``; what a log does not say is in ``Records.assumptions``. Values that have a
    meaning are never guessed.

    Args:
        robot: the robot.
        logs: a file (MCAP, rosbag2, CSV, Parquet, LeRobot, NPZ, MAT), a folder with
            ``dataset.toml``, a pandas or polars frame, a :class:`Record`, a list of these, or a
            dictionary of them by name.
        map: columns by hand, ``KIND:JOINT=COLUMN[UNIT]`` such as ``q:elbow=/js/elbow/pos[deg]``;
            kinds are t, q, dq, u, tau (of a sensor) and qref.
        map_file: TOML file of such entries.
        input: what the inputs are where names and units do not say it: ``torque``, ``current`` or
            ``voltage``.
        gain: factors from the inputs to the torque or force at the joints, one per joint.
        input_hold: what the inputs do between samples: ``linear`` (readings run straight) or
            ``zero-order`` (commands keep their value). By default measured inputs run straight.
        targets: the commanded positions are the inputs, behind the position loops of the drives;
            recorded inputs of the motors are left out.
        gain_factor: how many times a gain of the position loops acts in some records,
            ``RECORD=GAIN:FACTOR`` such as ``*_kp400=kp:4``, or ``drop_*=off`` where the drives are off.
        passive: no joint is driven, the inputs are zero.
        test: names of the records to judge with; by default the last quarter of several, or the
            last third of a single one.
        sample_time: step of logs without times, s.

    Returns:
        The records.

    Raises:
        SimtrueError: the first thing that is wrong or may mean two things.
    """
    options = {
        "map": _words(map),
        "map_file": None if map_file is None else os.fspath(map_file),
        "input": input,
        "gain": None if gain is None else [float(k) for k in gain],
        "input_hold": input_hold,
        "targets": targets,
        "gain_factor": _words(gain_factor),
        "passive": passive,
        "test": _words(test),
        "sample_time": sample_time,
    }
    if isinstance(logs, Records):
        stated = [name for name, value in options.items() if value not in (None, False)]
        if stated:
            raise SimtrueError(
                f"{stated[0]} says how logs are read, and these records are read already\n"
                "  help: give it to simtrue.read"
            )
        return logs
    return _read(robot, _sources(logs), **options)  # type: ignore[arg-type]


def _words(words: Union[str, Iterable[str], None]) -> Optional[list[str]]:
    if words is None:
        return None
    return [words] if isinstance(words, str) else [str(word) for word in words]


def _sources(logs: Union[Log, Sequence[Log], Mapping[str, Log]]) -> list[Source]:
    if isinstance(logs, (str, os.PathLike, Record)) or _is_frame(logs):
        logs = [logs]  # type: ignore[list-item]
    if isinstance(logs, Mapping):
        return [_source(log, str(name), str(name)) for name, log in logs.items()]
    if not isinstance(logs, Iterable):
        raise _no_log(logs, "logs")
    return [_source(log, "", f"record_{k}") for k, log in enumerate(logs, 1)]


def _source(log: object, named: str, otherwise: str) -> Source:
    if isinstance(log, (str, os.PathLike)):
        return os.fspath(log)
    if isinstance(log, Record):
        name = named or log.name or otherwise
        channels = [(word, values.tobytes()) for word, values in log.channels.items()]
        return Arrays(name=name, t=log.t.tobytes(), channels=channels)
    if _is_frame(log):
        return (named or otherwise, _columns(log, named or otherwise))
    raise _no_log(log, named or otherwise)


def _no_log(log: object, place: str) -> SimtrueError:
    return SimtrueError(
        f"{place}: a {type(log).__name__} is no log\n"
        "  help: give a path, a pandas or polars frame, or a simtrue.Record"
    )


def _is_frame(log: object) -> bool:
    return hasattr(log, "columns") and hasattr(log, "__getitem__")


def _columns(frame: Any, place: str) -> Table:
    """Numeric columns of a frame, and a named or timed index of pandas."""
    columns: Table = []
    index = getattr(frame, "index", None)
    if index is not None and index.dtype.kind in "Mm":
        # Stamps and durations are times, whatever their name.
        name = "time" if index.name is None else f"{index.name} time"
        columns += _column(name, _array(index), place)
    elif index is not None and index.name is not None:
        columns += _column(str(index.name), _array(index), place)
    for name in frame.columns:
        words = ".".join(str(part) for part in name) if isinstance(name, tuple) else str(name)
        values = frame[name]
        if getattr(values, "ndim", 1) != 1:
            raise SimtrueError(
                f"{place}: several columns are called `{words}`\n  help: rename all but one of them"
            )
        columns += _column(words, _array(values), place)
    if not columns:
        raise SimtrueError(f"{place}: no column holds numbers\n  help: give columns of t, q and u")
    return columns


def _array(values: Any) -> "npt.NDArray[Any]":
    """A column or an index as an array; stamps of pandas with a time zone in UTC."""
    if getattr(values.dtype, "tz", None) is not None:
        values = getattr(values, "dt", values).tz_convert(None)
    return np.asarray(values.to_numpy())


def _column(name: str, values: "npt.NDArray[Any]", place: str) -> Table:
    """A column, or one for each element of its rows; nothing for texts."""
    kind = values.dtype.kind
    if kind in "Mm":
        if bool(np.isnat(values).any()):
            row = int(np.flatnonzero(np.isnat(values))[0]) + 1
            raise SimtrueError(f"{place}: `{name}`, row {row}: no time\n  help: drop the row")
        of_ns = values.astype(f"{values.dtype.str[1:2]}8[ns]")
        return [(name, "ns", of_ns.astype(np.int64).tobytes(), True)]
    if kind == "O" and len(values) and isinstance(values[0], (list, tuple, np.ndarray)):
        if len({len(row) for row in values}) == 1:
            values = np.array([list(row) for row in values], dtype=np.float64)
            kind = "f"
    if kind == "O":
        # Columns with missing numbers may come as objects.
        try:
            values = values.astype(np.float64)
        except (TypeError, ValueError):
            return []
    elif kind not in "fiub":
        return []
    if values.ndim == 2:
        parts = [part.astype(np.float64).tobytes() for part in values.T]
        return [(f"{name}[{k}]", None, part, False) for k, part in enumerate(parts)]
    whole = kind == "i"
    return [(name, None, values.astype(np.int64 if whole else np.float64).tobytes(), whole)]


def numbers(place: str, word: str, values: npt.ArrayLike) -> Values:
    """Values as numbers; the error names place and word."""
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SimtrueError(
            f"{place}: `{word}` holds something else than numbers: {error}\n"
            "  help: give an array of numbers, all rows of one length"
        ) from None


def times(place: str, t: npt.ArrayLike) -> Values:
    """Times of shape (N,), s, finite and strictly increasing."""
    found = numbers(place, "t", t)
    if found.ndim != 1 or len(found) < 2:
        raise SimtrueError(
            f"{place}: `t` has shape {found.shape}\n"
            "  help: give one time per sample, shape (N,) with at least two samples"
        )
    if not bool(np.isfinite(found).all()):
        row = int(np.flatnonzero(~np.isfinite(found))[0])
        raise SimtrueError(
            f"{place}: `t`, row {row + 1}: {found[row]} is no time\n"
            "  help: give every sample its time, s, or drop the row"
        )
    late = np.flatnonzero(np.diff(found) <= 0.0)
    if len(late):
        row = int(late[0]) + 1
        raise SimtrueError(
            f"{place}: `t`, row {row + 1}: {found[row]} s does not come after {found[row - 1]} s\n"
            "  help: sort the rows by time and remove repeated ones"
        )
    return found


def table(
    place: str, word: str, values: npt.ArrayLike, rows: int, joints: Optional[int]
) -> Values:
    """Values of shape (N, n), finite or NaN; those of shape (N,) are of one joint."""
    found = numbers(place, word, values)
    if found.ndim == 1:
        found = found.reshape(-1, 1)
    wanted = (rows, joints if joints is not None else found.shape[-1])
    if found.ndim != 2 or found.shape != wanted or not found.shape[1]:
        raise SimtrueError(
            f"{place}: `{word}` has shape {np.shape(values)}, and there are {rows} times"
            + (f" and {joints} joints" if joints is not None else "")
            + "\n  help: give one row per time and one column per joint, base to tip"
        )
    infinite = np.argwhere(np.isinf(found))
    if len(infinite):
        row, column = (int(k) for k in infinite[0])
        raise SimtrueError(
            f"{place}: `{word}`, row {row + 1}, column {column + 1}: {found[row, column]}"
            " is no finite number\n  help: correct the value, or say NaN where it is missing"
        )
    return found
