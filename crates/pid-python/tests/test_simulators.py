"""What `simtrue export` writes, run in MuJoCo."""

import importlib.util
import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[3]
CHECK = ROOT / "crates" / "pid-simulators" / "check"
LEG = ROOT / "examples" / "leg" / "nominal.toml"

TARGET = np.array([0.2, 0.6, -1.0])
"""Abduction, hip and knee, rad."""


def load(file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_position_loops_are_those_of_the_library() -> None:
    """The table stands for the library: the tests of pid-simulators hold it."""
    known = json.loads((CHECK / "position_loops.json").read_text(encoding="utf-8"))
    for own, expected in zip(load(CHECK / "position_loops.py").table(), known, strict=True):
        assert own["loop"] == expected["loop"]
        assert own["u"] == pytest.approx(expected["u"], rel=1e-9, abs=1e-9)


@pytest.fixture
def leg(tmp_path: Path, command: Callable[..., Any]) -> Callable[..., Path]:
    """Exports the leg with known gains, further lines of its loops and effects."""

    def export(lines: str, effects: str = "") -> Path:
        text = LEG.read_text(encoding="utf-8")
        for gain, value in (("kp", 40.0), ("kd", 1.0)):
            text = text.replace(f"{gain} = {{ unknown = true }}", f"{gain} = {value}")
        robot = tmp_path / "leg.toml"
        text = text.replace("rate_hz = 1000.0", f"rate_hz = 1000.0\n{lines}", 1) + effects
        robot.write_text(text, encoding="utf-8")
        done = command("export", robot, "--to", "mujoco", "--out", tmp_path / "sim")
        assert done.returncode == 0, done.stderr
        return tmp_path / "sim"

    return export


def test_a_leg_goes_to_its_targets(leg: Callable[..., Path]) -> None:
    """With gravity made up for, friction alone holds it off: 0.3 N m over 40 N m/rad. Without that the weight does
    too, in the file alone as in the wrapper."""
    mujoco = pytest.importorskip("mujoco")
    within = 0.3 / 40.0 + 1e-3
    held = load(leg("gravity = 1.0") / "robot_effects.py").Robot()
    held.reset(np.zeros(3), np.zeros(3), u=np.zeros(3))
    for _ in range(100):
        held.step(held.data, TARGET, 0.02)
    assert np.abs(held.readings(held.data)[0] - TARGET).max() < within

    free = load(leg("") / "robot_effects.py").Robot()
    free.reset(np.zeros(3), np.zeros(3), u=np.zeros(3))
    for _ in range(100):
        free.step(free.data, TARGET, 0.02)
    own = free.readings(free.data)[0]
    assert np.abs(own - TARGET).max() > 2.0 * within

    model = mujoco.MjModel.from_xml_path(str(leg("") / "robot.xml"))
    data = mujoco.MjData(model)
    data.ctrl[:] = TARGET
    for _ in range(round(2.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    assert np.abs(data.qpos - own).max() < 2.0 * within


def test_a_drive_at_its_no_load_speed_brings_nothing(leg: Callable[..., Path]) -> None:
    """A target far away: the joint comes to the speed at which the motor has as much left as friction takes."""
    pytest.importorskip("mujoco")
    robot = load(leg("no_load_speed = 6.0") / "robot_effects.py").Robot()
    robot.model.opt.gravity[:] = 0.0
    robot.reset(np.zeros(3), np.zeros(3), u=np.zeros(3))
    far = np.array([1e3, 0.0, 0.0])
    for _ in range(100):
        robot.step(robot.data, far, 0.02)
    speed = robot.readings(robot.data)[1][0]
    # stall (1 - v/6) = 0.3 + 0.05 v with a stall of 23.
    expected = (23.0 - 0.3) / (23.0 / 6.0 + 0.05)
    assert speed == pytest.approx(expected, rel=0.02)


def test_a_supply_sags_under_the_outputs_of_all_loops(leg: Callable[..., Path]) -> None:
    """Targets far away: without friction and weight all velocities grow by what the supply leaves of the limits."""
    pytest.importorskip("mujoco")

    def speeds(loss: float) -> Any:
        sag = f'[[effect]]\nid = "supply_sag"\n[effect.parameters]\nloss_per_input = {{ value = {loss} }}\n'
        robot = load(leg("", sag) / "robot_effects.py").Robot()
        robot.model.opt.gravity[:] = 0.0
        robot.coulomb[:] = 0.0
        robot.reset(np.zeros(3), np.zeros(3), u=np.zeros(3))
        robot.step(robot.data, np.full(3, 1e3), 0.002)
        return robot.readings(robot.data)[1]

    # Three limits of 23 N m.
    left = 1.0 - 0.004 * 3.0 * 23.0
    assert speeds(0.004) / speeds(0.0) == pytest.approx(np.full(3, left), rel=0.01)


def test_gains_of_a_record_are_factors_of_the_described_ones(leg: Callable[..., Path]) -> None:
    """Near its targets a leg with twice the gains is one whose torques are twice as large."""
    pytest.importorskip("mujoco")

    def speeds(error: float, **factors: float) -> Any:
        robot = load(leg("") / "robot_effects.py").Robot()
        robot.model.opt.gravity[:] = 0.0
        robot.coulomb[:] = 0.0
        robot.gain_factors(**factors)
        robot.reset(np.zeros(3), np.zeros(3), u=np.zeros(3))
        robot.step(robot.data, np.full(3, error), 0.0005)
        return robot.readings(robot.data)[1]

    assert speeds(0.01, kp=2.0) == pytest.approx(speeds(0.02), rel=0.01)
    with pytest.raises(ValueError, match="pd has no gain ki"):
        speeds(0.01, ki=2.0)


def test_a_drive_that_is_off_neither_drives_nor_brakes(leg: Callable[..., Path]) -> None:
    pytest.importorskip("mujoco")
    robot = load(leg("") / "robot_effects.py").Robot()
    robot.model.opt.gravity[:] = 0.0
    robot.coulomb[:] = 0.0
    robot.viscous[:] = robot.induced[:] = 1.0

    def speeds(off: Any) -> Any:
        robot.drives_off(off)
        robot.reset(np.zeros(3), np.full(3, 0.2), u=np.full(3, 0.5))
        before = robot.readings(robot.data)[1].copy()
        robot.step(robot.data, np.full(3, 0.5), 0.0005)
        return before, robot.readings(robot.data)[1]

    before, after = speeds(True)
    # Without a force the links of a leg turn on, but for what they pull at each other.
    assert after == pytest.approx(before, abs=1e-3)
    before, after = speeds([False, True, True])
    assert after[0] - before[0] > 0.01
