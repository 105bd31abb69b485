"""The compiled part of ``simtrue``."""

from collections.abc import Callable, Sequence
from typing import Optional, final

from ._types import Path, Source, Values

__all__ = [
    "Fit",
    "Records",
    "Report",
    "Robot",
    "SimtrueError",
    "check",
    "command",
    "diagnose",
    "identify",
    "read",
    "simulate",
]

class SimtrueError(ValueError):
    """An error in the input. The message says the place, the value, and how to mend it."""

@final
class Robot:
    """A robot: its nominal description, and what reading its file told."""

    @staticmethod
    def load(
        path: Path,
        *,
        trust: str = "cad",
        joints: Optional[list[str]] = None,
        guess_inertias: bool = False,
        strict: bool = False,
        drive: Optional[str] = None,
    ) -> Robot:
        """As :func:`simtrue.load_robot`."""
    @staticmethod
    def from_urdf(
        path: Path,
        *,
        trust: str = "cad",
        joints: Optional[list[str]] = None,
        guess_inertias: bool = False,
        strict: bool = False,
    ) -> Robot:
        """Reads a URDF; options as :func:`simtrue.load_robot`."""
    @staticmethod
    def from_mjcf(path: Path, *, trust: str = "cad") -> Robot:
        """Reads an MJCF; option as :func:`simtrue.load_robot`."""
    @staticmethod
    def from_description(path: Path) -> Robot:
        """Reads a ``nominal.toml``, or that of a folder."""
    @staticmethod
    def from_model(name: str) -> Robot:
        """A robot that is declared in the program, as ``simtrue models`` lists them."""
    @property
    def name(self) -> str:
        """Its name."""
    @property
    def joints(self) -> list[str]:
        """Names of its joints, base to tip: the order of columns in arrays."""
    @property
    def input_units(self) -> list[str]:
        """Units of its inputs, joint by joint: ``N*m``, ``N``, ``A`` or ``V``."""
    @property
    def parameters(self) -> dict[str, float]:
        """Nominal values by name, SI."""
    @property
    def tolerances(self) -> dict[str, float]:
        """Half widths about the nominal values by name, SI; 0 where a value is exact."""
    @property
    def parameter_units(self) -> dict[str, str]:
        """Units of the parameters by name."""
    @property
    def warnings(self) -> list[str]:
        """What is odd in the file."""
    @property
    def assumptions(self) -> list[str]:
        """What the file does not say, and the rule by which it was decided."""
    def to_toml(self) -> str:
        """The nominal description. Raises SimtrueError for robots that no such file can state."""

@final
class Records:
    """Records of a robot in SI units, and what was assumed of them."""

    @staticmethod
    def example() -> Records:
        """Those of :func:`simtrue.example`."""
    @property
    def names(self) -> list[str]:
        """Names of the records."""
    @property
    def roles(self) -> list[str]:
        """``train`` (to fit on) or ``test`` (to judge with), record by record."""
    @property
    def joints(self) -> list[str]:
        """Names of the joints, base to tip."""
    @property
    def input_units(self) -> list[str]:
        """Units of the inputs, joint by joint."""
    @property
    def assumptions(self) -> list[str]:
        """What the logs do not say, and the rule by which it was decided."""
    @property
    def warnings(self) -> list[str]:
        """What is odd or was left out."""
    def arrays(self, name: str) -> dict[str, Values]:
        """Arrays of a record: ``t`` (N,), ``q`` and ``u`` (N, n), and ``v``, ``tau_sensor``, ``qref``
        where they are recorded. NaN where a value is missing."""
    def save(self, robot: Robot, folder: Path) -> bool:
        """Writes ``dataset.toml``, ``nominal.toml`` and CSV files. Whether ``nominal.toml`` is
        there: it cannot state every robot."""
    def __len__(self) -> int: ...

@final
class Report:
    def to_json(self) -> str: ...
    def to_html(self) -> str: ...
    def summary(self) -> str: ...
    def extended(self) -> Optional[str]: ...
    def save(self, folder: Path) -> None: ...

@final
class Fit:
    def to_json(self) -> str: ...
    def to_html(self) -> str: ...
    def summary(self) -> str: ...
    def save(self, folder: Path) -> None: ...

def read(
    robot: Robot,
    sources: list[Source],
    *,
    map: Optional[list[str]] = None,
    map_file: Optional[Path] = None,
    input: Optional[str] = None,
    gain: Optional[list[float]] = None,
    input_hold: Optional[str] = None,
    targets: bool = False,
    gain_factor: Optional[list[str]] = None,
    passive: bool = False,
    test: Optional[list[str]] = None,
    sample_time: Optional[float] = None,
) -> Records: ...
def check(robot: Robot, records: Records) -> str: ...
def diagnose(
    robot: Robot,
    records: Records,
    *,
    anyway: bool = False,
    next: bool = False,
    joint_seconds: Optional[float] = None,
    refit_all: bool = False,
    step: Optional[Callable[[str], object]] = None,
) -> tuple[Report, bool]: ...
def identify(
    robot: Robot,
    records: Records,
    *,
    hold: Optional[list[str]] = None,
    horizon: Optional[str] = None,
    starts: int = 1,
    seed: int = 0,
    step: Optional[Callable[[str], object]] = None,
) -> tuple[Fit, bool]: ...
def simulate(
    robot: Robot,
    t: bytes,
    u: bytes,
    q0: bytes,
    v0: bytes,
    *,
    linear: bool,
    values: Sequence[tuple[str, float]],
) -> tuple[Values, Values]: ...
def command(words: list[str]) -> int: ...
