"""Check, identification, simulation and diagnosis of an arm; Ctrl-C; the command."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import simtrue

from conftest import Command, Swing


WITHOUT = {"viscous_shoulder": 0.0, "coulomb_shoulder": 0.0, "rotor_shoulder": 0.0}
"""Friction and rotor, which the equation of a pendulum does not have."""


def test_a_swing_against_the_equation(arm: simtrue.Robot) -> None:
    """A small swing without friction: T = 2π sqrt(I / (m g l))."""
    inertia, weight = 0.088 + 6 * 0.17**2, 6 * 9.81 * 0.17
    period = 2 * np.pi * np.sqrt(inertia / weight)
    t = np.linspace(0.0, period, 101)
    found = simtrue.simulate(arm, t, np.zeros(101), [1e-3], parameters=WITHOUT)
    assert found.q.shape == found.v.shape == (101, 1)
    assert found.q[50, 0] == pytest.approx(-1e-3, rel=1e-5)
    assert found.q[100, 0] == pytest.approx(1e-3, rel=1e-5)
    assert found.v[25, 0] == pytest.approx(-1e-3 * 2 * np.pi / period, rel=1e-5)


def test_an_effect_of_the_description_is_simulated(arm: simtrue.Robot, tmp_path: Path) -> None:
    """A spring K turns the equation into (K + m g l) q."""
    text = arm.to_toml() + '\n[[effect]]\nid = "spring"\njoint = "shoulder"\n'
    text += "[effect.parameters]\nstiffness = { value = 10.0, unit = \"N*m/rad\" }\npreload = { value = 0.0, unit = \"N*m\" }\n"
    file = tmp_path / "nominal.toml"
    file.write_text(text)
    robot = simtrue.load_robot(file)
    inertia, stiffness = 0.088 + 6 * 0.17**2, 10.0 + 6 * 9.81 * 0.17
    period = 2 * np.pi * np.sqrt(inertia / stiffness)
    t = np.linspace(0.0, period, 51)
    found = simtrue.simulate(robot, t, np.zeros(51), [1e-3], parameters=WITHOUT)
    assert found.q[-1, 0] == pytest.approx(1e-3, rel=1e-5)


def test_drives_follow_targets_by_the_law_that_is_stated(arm_file: Path) -> None:
    """A log of positions and targets alone; the loop's gain is found."""
    kp, kd, viscous, weight = 60.0, 1.5, 0.5, 6 * 9.81 * 0.17
    t, step = 0.01 * np.arange(1500), 0.0005
    target = 0.4 * np.sin(2.0 * t) + 0.3 * np.sin(5.3 * t) + 0.2 * np.sign(np.sin(1.7 * t))
    q, v, positions = 0.0, 0.0, np.zeros(len(t))
    for k, held in enumerate(target):
        positions[k] = q
        for _ in range(20):
            friction = viscous * v + 0.3 * np.tanh(v / 0.01)
            force = kp * (held - q) - kd * v - weight * np.sin(q) - friction
            v += step * force / (0.088 + 6 * 0.17**2)
            q += step * v
    positions += 1e-4 * np.random.default_rng(2).standard_normal(len(t))
    frame = pd.DataFrame({"time": t, "shoulder_pos": positions, "shoulder_pos_cmd": target})
    found = simtrue.identify(simtrue.load_robot(arm_file, drive="pd"), frame).parameters
    interval = found["kp_shoulder"].interval
    assert interval is not None and interval[0] < kp < interval[1]
    assert "kd_shoulder" in found
    assert "kd_shoulder" not in simtrue.identify(simtrue.load_robot(arm_file, drive="p"), frame).parameters
    with pytest.raises(simtrue.SimtrueError, match="drive: `pi` is no law of a loop"):
        simtrue.load_robot(arm_file, drive="pi")


def test_what_cannot_be_simulated_is_told(arm: simtrue.Robot) -> None:
    t = [0.0, 0.1, 0.2]
    with pytest.raises(simtrue.SimtrueError, match=r"`tau` has shape \(2,\), and there are 3"):
        simtrue.simulate(arm, t, [0.0, 0.0])
    with pytest.raises(simtrue.SimtrueError, match="`tau`, row 2, column 1: nan"):
        simtrue.simulate(arm, t, [0.0, np.nan, 0.0])
    with pytest.raises(simtrue.SimtrueError, match=r"`q0` has shape \(2,\), and there are 1"):
        simtrue.simulate(arm, t, np.zeros(3), [0.0, 0.0])
    with pytest.raises(simtrue.SimtrueError, match="no `weight`\n  help: its parameters are "):
        simtrue.simulate(arm, t, np.zeros(3), parameters={"weight": 1.0})
    with pytest.raises(simtrue.SimtrueError, match="diverged|not finite|too small"):
        simtrue.simulate(arm, t, [1e300] * 3)
    motors, _ = simtrue.example()
    with pytest.raises(simtrue.SimtrueError, match="the inputs of `.*` are in A, A"):
        simtrue.simulate(motors, t, np.zeros((3, 2)))
    moved = simtrue.simulate(motors, t, u=np.zeros((3, 2)), q0=[0.1, 0.0])
    assert moved.q.shape == (3, 2)


def test_check_finds_degrees_that_call_themselves_radians(
    arm: simtrue.Robot, swing: Swing
) -> None:
    right = simtrue.check(arm, swing.record())
    assert not [f for f in right if f.severity == "wrong"]
    degrees = simtrue.Record(swing.t, np.degrees(swing.q), np.degrees(swing.v), swing.tau)
    wrong = [f for f in simtrue.check(arm, degrees) if f.severity == "wrong"]
    assert "unit" in [f.kind for f in wrong]
    unit = next(f for f in wrong if f.kind == "unit")
    assert unit.joints == ("shoulder",) and unit.mend
    assert unit.details["sentence"] == unit.sentence in str(unit)
    with pytest.raises(simtrue.SimtrueError, match="contradict the robot") as told:
        simtrue.diagnose(arm, degrees)
    assert unit.sentence in str(told.value) and "anyway=True" in str(told.value)


def test_check_and_identify_are_those_of_the_command(
    arm: simtrue.Robot, swing: Swing, command: Command, tmp_path: Path
) -> None:
    records = simtrue.read(arm, swing.record())
    folder = tmp_path / "data"
    assert records.save(arm, folder)
    done = command("check", folder, "--json")
    assert done.returncode == 0, done.stderr
    assert [f.details for f in simtrue.check(arm, records)] == json.loads(done.stdout)
    ours = simtrue.identify(arm, records)
    nominal = folder / "nominal.toml"
    done = command("identify", "--nominal", nominal, folder, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    theirs = json.loads((tmp_path / "out" / "fit.json").read_text())
    assert [p.value for p in ours.parameters.values()] == [
        p["value"] for p in theirs["parameters"]
    ]
    assert [p.std for p in ours.parameters.values()] == [
        p["deviation"] for p in theirs["parameters"]
    ]
    viscous = next(p for n, p in ours.parameters.items() if "viscous" in n)
    assert viscous.interval is not None and viscous.interval[0] < 0.5 < viscous.interval[1]
    ours.save(tmp_path / "again")
    again = json.loads((tmp_path / "again" / "fit.json").read_text())
    assert again == ours.to_dict()
    with pytest.raises(simtrue.SimtrueError, match="hold: the robot has no parameter `mass`"):
        simtrue.identify(arm, records, hold=["mass"])
    with pytest.raises(simtrue.SimtrueError, match="horizon"):
        simtrue.identify(arm, records, horizon="soon")


INTERRUPTED = """
import os, signal, sys
import simtrue

told = []

def step(what):
    told.append(what)
    if len(told) <= int(sys.argv[1]):
        os.kill(os.getpid(), signal.SIGINT)

robot, records = simtrue.example()
try:
    simtrue.diagnose(robot, records, progress=step)
except simtrue.Interrupted as e:
    print("so far", e.result.verdict, "|", e.result.warnings[-1])
except KeyboardInterrupt as e:
    print("left", type(e).__name__)
else:
    print("not interrupted")
"""


def interrupted(times: int) -> str:
    line = [sys.executable, "-c", INTERRUPTED, str(times)]
    done = subprocess.run(line, capture_output=True, text=True, check=True)
    return done.stdout


@pytest.mark.skipif(sys.platform == "win32", reason="signals of a process to itself end it there")
def test_ctrl_c_ends_a_diagnosis_with_what_it_has() -> None:
    assert "the search was stopped before its end" in interrupted(1)
    assert interrupted(2) == "left KeyboardInterrupt\n"


def test_what_a_callback_raises_ends_the_work() -> None:
    def step(_: str) -> None:
        raise RuntimeError("enough")

    robot, records = simtrue.example()
    with pytest.raises(RuntimeError, match="enough"):
        simtrue.diagnose(robot, records, progress=step)


def test_the_command_has_its_exit_codes(command: Command, tmp_path: Path) -> None:
    version = command("--version")
    assert (version.returncode, version.stderr) == (0, "")
    assert version.stdout == f"simtrue {simtrue.__version__}\n"
    missing = command("diagnose", tmp_path / "nowhere")
    assert missing.returncode == 1 and "nowhere" in missing.stderr
    assert command("diagnose", "--no-such-option").returncode == 2
    module = subprocess.run(
        [sys.executable, "-m", "simtrue", "models"], capture_output=True, text=True, check=False
    )
    assert module.returncode == 0 and module.stdout.startswith("two_link: ")
