"""What check, identification and diagnosis find."""

import html
import json
import os
from dataclasses import dataclass
from typing import Any, Optional, Union

from . import _simtrue
from ._types import Path

_WIDE = 1.959963984540054
"""Standard deviations on each side of an interval of 95 %."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C stopped a diagnosis or an identification.

    Attributes:
        result: the :class:`Diagnosis` or :class:`Identification` as far as it came.
    """

    def __init__(self, result: "Union[Diagnosis, Identification]") -> None:
        super().__init__("stopped; what was found so far is in `.result`")
        self.result = result


@dataclass(frozen=True)
class Parameter:
    """A value with its standard deviation.

    Attributes:
        name: name.
        value: value in ``unit``.
        unit: SI unit; ``1`` for a plain number.
        std: standard deviation in ``unit``; None if the records do not determine the value.
    """

    name: str
    value: float
    unit: str
    std: Optional[float]

    @property
    def interval(self) -> Optional[tuple[float, float]]:
        """Interval of 95 % by the standard deviation; None without one."""
        if self.std is None:
            return None
        return (self.value - _WIDE * self.std, self.value + _WIDE * self.std)


@dataclass(frozen=True)
class Effect:
    """An effect that the model lacks.

    Attributes:
        name: identifier in the library of effects, such as ``stribeck``.
        joint: name of its joint; None for an effect of the whole robot.
        parameters: its magnitudes.
        share: share of the squared gap beyond the floor that it explains, 0 to 1; None where no
            free run tells.
        regime: where it shows.
    """

    name: str
    joint: Optional[str]
    parameters: tuple[Parameter, ...]
    share: Optional[float]
    regime: str


@dataclass(frozen=True)
class Finding:
    """What a check of records against a robot finds.

    Attributes:
        kind: kind, such as ``unit`` or ``sign``.
        severity: ``wrong`` (the record contradicts the robot or itself), ``doubtful`` or ``note``.
        joints: names of the joints it is about; empty: the whole record.
        record: name of the record; None: all.
        sentence: what is seen.
        mend: what to do.
        details: everything ``simtrue check --json`` says of it.
    """

    kind: str
    severity: str
    joints: tuple[str, ...]
    record: Optional[str]
    sentence: str
    mend: str
    details: dict[str, Any]

    def __str__(self) -> str:
        place = ", ".join((*([self.record] if self.record else []), *self.joints)) or "all records"
        return f"{self.severity}: {place}: {self.sentence}\n  help: {self.mend}"


class _Page:
    """A result with a page, as a notebook shows it."""

    def __init__(self, report: "Union[_simtrue.Report, _simtrue.Fit]") -> None:
        self._report = report
        self._values: dict[str, Any] = json.loads(report.to_json())

    def to_dict(self) -> dict[str, Any]:
        """The content of the JSON file, anew with every call."""
        values: dict[str, Any] = json.loads(self._report.to_json())
        return values

    def to_json(self) -> str:
        """The text of the JSON file."""
        return self._report.to_json()

    def to_html(self) -> str:
        """The page ``report.html``: with its plots, without other files."""
        return self._report.to_html()

    def save(self, folder: Path) -> None:
        """Writes the files of the command into a folder, which is made if needed.

        Raises:
            SimtrueError: a file that cannot be written.
        """
        self._report.save(os.fspath(folder))

    def _repr_html_(self) -> str:
        # A frame of its own: styles of the page and of the notebook stay apart.
        page = html.escape(self.to_html(), quote=True)
        return f'<iframe srcdoc="{page}" style="width:100%;height:48em;border:0"></iframe>'

    def __str__(self) -> str:
        return self._report.summary().rstrip("\n")


class Diagnosis(_Page):
    """What the model lacks: verdict, effects, and the figures they rest on.

    ``print`` shows the summary of the command, a notebook its page. ``save`` writes
    ``report.html``, ``diagnosis.json``, ``extended.toml`` and ``next_experiment.csv``, as far as
    there are such.
    """

    _report: _simtrue.Report

    def __init__(self, report: _simtrue.Report, joints: tuple[str, ...]) -> None:
        super().__init__(report)
        self._joints = joints

    @property
    def verdict(self) -> str:
        """``none``, ``one cause``, ``several``, ``partly unknown`` or ``unknown``."""
        return str(self._values["verdict"])

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects named, the largest first."""
        return tuple(self._effect(e) for e in self._values["effects"])

    def _effect(self, e: dict[str, Any]) -> Effect:
        of = ((p["name"], p["value"], p["unit"], p["std"]) for p in e["parameters"])
        return Effect(
            name=e["effect"],
            joint=None if e["joint"] is None else self._joints[e["joint"] - 1],
            parameters=tuple(Parameter(*p) for p in of),
            share=e["share"],
            regime=e["regime"],
        )

    @property
    def confidence(self) -> float:
        """Stated probability that the verdict is right."""
        return float(self._values["confidence"])

    @property
    def gap_before(self) -> float:
        """Gap of the model as it is: free-run error over motion, test records."""
        return float(self._values["gap_before"])

    @property
    def gap_after(self) -> float:
        """Gap with the effects named."""
        return float(self._values["gap_after"])

    @property
    def gap_floor(self) -> float:
        """Gap that noise alone leaves."""
        return float(self._values["gap_floor"])

    @property
    def gap_intervals(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Intervals of 95 % of the gap before and after."""
        before, after = self._values["gap_intervals"]
        return ((before[0], before[1]), (after[0], after[1]))

    @property
    def confusion_set(self) -> tuple[str, ...]:
        """Effects that the records cannot tell from the named one."""
        return tuple(self._values["confusion_set"])

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is odd in the records or in the search."""
        return tuple(self._values["warnings"])

    @property
    def extended_toml(self) -> Optional[str]:
        """The robot with the effects found, as a nominal description; None if none can state it."""
        return self._report.extended()

    def __repr__(self) -> str:
        named = [e.name + (f" at {e.joint}" if e.joint else "") for e in self.effects]
        gap = f"gap {self.gap_before:.4g} -> {self.gap_after:.4g}"
        return f"Diagnosis({self.verdict!r}, effects={named}, {gap}, floor {self.gap_floor:.4g})"


class Identification(_Page):
    """Identified parameters. ``save`` writes ``report.html`` and ``fit.json``."""

    @property
    def verdict(self) -> str:
        """``good``, ``fair`` or ``bad``; a bad result must not be used."""
        return str(self._values["outcome"]["verdict"])

    @property
    def status(self) -> str:
        """How the solver ended, in words."""
        return str(self._values["outcome"]["status"])

    @property
    def objective(self) -> Optional[float]:
        """Value of the objective at the result."""
        value: Optional[float] = self._values["outcome"]["objective"]
        return value

    @property
    def parameters(self) -> dict[str, Parameter]:
        """All parameters by name, in the order of the model."""
        rows = self._values["parameters"]
        of = ((r["name"], r["value"], r["unit"], r["deviation"]) for r in rows)
        return {p[0]: Parameter(*p) for p in of}

    def __repr__(self) -> str:
        return f"Identification({self.verdict!r}, {len(self.parameters)} parameters)"
