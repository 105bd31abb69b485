"""Find out why a simulation and a robot disagree.

    import simtrue

    robot = simtrue.load_robot("robot.urdf")
    found = simtrue.diagnose(robot, ["run1.mcap", "run2.csv"])
    print(found)            # verdict, effects, gap
    found.save("diagnosis") # report.html, diagnosis.json, extended.toml

Logs are files, pandas or polars frames, or a :class:`Record` of numpy arrays. All values are in SI
units. Every error in the input is a :class:`SimtrueError`, whose message has place, value and mend;
options that it names are keyword arguments.
"""

from importlib.metadata import PackageNotFoundError, version

from ._logs import Frame, Log, Logs, Record, read
from ._results import Diagnosis, Effect, Finding, Identification, Interrupted, Parameter
from ._simtrue import Records, Robot, SimtrueError
from ._work import Motion, check, diagnose, example, identify, load_robot, simulate

try:
    __version__ = version("simtrue")
except PackageNotFoundError:  # the sources, not installed
    __version__ = "0"

__all__ = [
    "Diagnosis",
    "Effect",
    "Finding",
    "Frame",
    "Identification",
    "Interrupted",
    "Log",
    "Logs",
    "Motion",
    "Parameter",
    "Record",
    "Records",
    "Robot",
    "SimtrueError",
    "check",
    "diagnose",
    "example",
    "identify",
    "load_robot",
    "read",
    "simulate",
]
