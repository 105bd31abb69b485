"""What several tests share: the example diagnosed once, an arm with a log, the installed command."""

import os
import subprocess
import sysconfig
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import simtrue

ARM = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 -0.17"/><mass value="6"/>
<inertia ixx="0.085" iyy="0.088" izz="0.012" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="40" velocity="3"/>
<dynamics damping="0.5" friction="0.3"/></joint></robot>"""
"""A pendulum, inertia about its joint 0.088 + 6·0.17² kg·m²."""

Command = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="session")
def command() -> Command:
    """Runs the command that the wheel has installed."""
    program = Path(sysconfig.get_path("scripts")) / ("simtrue.exe" if os.name == "nt" else "simtrue")

    def run(*words: object) -> "subprocess.CompletedProcess[str]":
        line = [str(program), *map(str, words)]
        return subprocess.run(line, capture_output=True, text=True, check=False)

    return run


class Diagnosed:
    """The example's diagnosis, what was told meanwhile, and how often another thread ran."""

    def __init__(self) -> None:
        self.robot, self.records = simtrue.example()
        self.ticks = 0
        self.steps: list[str] = []
        self._go_on = True
        other = threading.Thread(target=self._tick)
        other.start()
        try:
            self.result = simtrue.diagnose(self.robot, self.records, progress=self.steps.append)
        finally:
            self._go_on = False
            other.join()

    def _tick(self) -> None:
        while self._go_on:
            self.ticks += 1
            time.sleep(0.001)


@pytest.fixture(scope="session")
def diagnosed() -> Diagnosed:
    return Diagnosed()


@pytest.fixture(scope="session")
def arm_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("robot") / "arm.urdf"
    path.write_text(ARM)
    return path


@pytest.fixture(scope="session")
def arm(arm_file: Path) -> simtrue.Robot:
    return simtrue.Robot.from_urdf(arm_file)


class Swing:
    """A swing of the arm under a sine of torque, as arrays."""

    def __init__(self, robot: simtrue.Robot) -> None:
        self.t = 0.005 * np.arange(1200)
        self.tau = 3.0 * np.sin(4.0 * self.t) + 2.0 * np.sin(9.0 * self.t)
        motion = simtrue.simulate(robot, self.t, self.tau, [1.0], [0.0])
        random = np.random.default_rng(1)
        self.q = motion.q[:, 0] + 1e-4 * random.standard_normal(len(self.t))
        self.v = motion.v[:, 0] + 1e-3 * random.standard_normal(len(self.t))

    def record(self) -> simtrue.Record:
        return simtrue.Record(self.t, self.q, self.v, self.tau, name="swing")

    def columns(self) -> "dict[str, np.ndarray[tuple[int], np.dtype[np.float64]]]":
        """As a log names them, positions in degrees."""
        return {
            "time_ms": 1e3 * self.t,
            "shoulder_pos [deg]": np.degrees(self.q),
            "shoulder_vel [rad/s]": self.v,
            "shoulder_torque [Nm]": self.tau,
        }


@pytest.fixture(scope="session")
def swing(arm: simtrue.Robot) -> Swing:
    return Swing(arm)
