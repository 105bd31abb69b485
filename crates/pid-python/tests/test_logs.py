"""Files, frames and arrays as records; what is wrong with them, with place and mend."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pytest

import simtrue

from conftest import Swing


def assert_swing(records: simtrue.Records, swing: Swing) -> None:
    """The rows of one record are split: the first two thirds train, the rest tests."""
    assert records.roles == ["train", "test"]
    parts = [records.arrays(name) for name in records.names]
    for word, values in (("q", swing.q), ("v", swing.v), ("u", swing.tau)):
        found = np.concatenate([part[word][:, 0] for part in parts])
        assert found == pytest.approx(values, rel=1e-12, abs=1e-12), word
    steps = np.concatenate([np.diff(part["t"]) for part in parts])
    assert steps == pytest.approx(0.005)


def test_arrays(arm: simtrue.Robot, swing: Swing) -> None:
    assert_swing(simtrue.read(arm, swing.record()), swing)
    assert simtrue.read(arm, {"by name": swing.record()}).names[0] == "by_name_train"


def test_a_pandas_frame(arm: simtrue.Robot, swing: Swing) -> None:
    frame = pd.DataFrame(swing.columns()).assign(note="text")
    assert_swing(simtrue.read(arm, frame), swing)
    timed = frame.drop(columns="time_ms")
    timed.index = pd.to_timedelta(swing.t, unit="s")
    assert_swing(simtrue.read(arm, timed), swing)
    dated = frame.drop(columns="time_ms")
    dated.index = pd.Timestamp("2024-05-06T07:08:09Z") + pd.to_timedelta(swing.t, unit="s")
    dated.index.name = "stamp"
    assert_swing(simtrue.read(arm, dated), swing)
    assert_swing(simtrue.read(arm, dated.reset_index(), map="t=stamp"), swing)


def test_a_polars_frame(arm: simtrue.Robot, swing: Swing) -> None:
    frame = pl.DataFrame(swing.columns()).with_columns(note=pl.lit("text"))
    assert_swing(simtrue.read(arm, frame), swing)
    lengths = pl.Series((swing.t * 1e9).round().astype(int)).cast(pl.Duration("ns"))
    timed = frame.with_columns(time=lengths)
    assert_swing(simtrue.read(arm, timed.drop("time_ms")), swing)
    listed = pl.DataFrame({"t": swing.t, "q": swing.q[:, None], "tau": swing.tau[:, None]})
    records = simtrue.read(arm, listed, map=["q=q", "u=tau"], input="torque")
    assert "v" not in records.arrays(records.names[0])
    assert records.arrays(records.names[0])["q"][0, 0] == swing.q[0]


def test_a_file(arm: simtrue.Robot, swing: Swing, tmp_path: Path) -> None:
    path = tmp_path / "swing.csv"
    pd.DataFrame(swing.columns()).to_csv(path, index=False)
    records = simtrue.read(arm, path)
    assert_swing(records, swing)
    assert any("unit deg, as stated there" in line for line in records.assumptions)
    folder = tmp_path / "data"
    assert records.save(arm, folder) is True
    again = simtrue.read(simtrue.Robot.from_description(folder), folder)
    assert again.names == records.names
    assert (again.arrays(again.names[0])["q"] == records.arrays(again.names[0])["q"]).all()


def test_what_inputs_do_between_samples(arm: simtrue.Robot, swing: Swing, tmp_path: Path) -> None:
    """It can be said, and is written to the folder that repeats the run."""
    for held in ("zero-order", "linear"):
        folder = tmp_path / held
        records = simtrue.read(arm, pd.DataFrame(swing.columns()), input_hold=held)
        assert records.save(arm, folder)
        assert f'input_hold = "{held}"' in (folder / "dataset.toml").read_text()


def test_gains_by_record(arm: simtrue.Robot, swing: Swing, tmp_path: Path) -> None:
    """They are written to the folder that repeats the run."""
    frames = {name: pd.DataFrame(swing.columns()) for name in ("slow_kp100", "slow_kp400")}
    records = simtrue.read(arm, frames, gain_factor="*_kp400=kp:4")
    assert records.save(arm, tmp_path / "data")
    text = (tmp_path / "data" / "dataset.toml").read_text()
    assert text.count("gain_factors") == 1 and "gain_factors = { kp = [4.0] }" in text


def test_files_frames_and_arrays_together(
    arm: simtrue.Robot, swing: Swing, tmp_path: Path
) -> None:
    path = tmp_path / "file.csv"
    pd.DataFrame(swing.columns()).to_csv(path, index=False)
    logs: list[simtrue.Log] = [pd.DataFrame(swing.columns()), path, swing.record(), str(path)]
    records = simtrue.read(arm, logs, test="swing")
    assert records.names[:3] == ["record_1", "file", "swing"] and len(records) == 4
    assert records.roles == ["train", "train", "test", "train"]
    for name in records.names:
        assert records.arrays(name)["q"][:, 0] == pytest.approx(swing.q, rel=1e-12)


def test_a_record_with_missing_readings(arm: simtrue.Robot, swing: Swing) -> None:
    v = swing.v.copy()
    v[7] = np.nan
    records = simtrue.read(arm, simtrue.Record(swing.t, swing.q, v, swing.tau))
    assert np.isnan(records.arrays(records.names[0])["v"][7, 0])


def wrong_records(s: Swing) -> list[tuple[str, Any, str]]:
    late = s.t.copy()
    late[5] = late[4]
    infinite = s.q.copy()
    infinite[3] = np.inf
    no_time = s.t.copy()
    no_time[2] = np.nan
    return [
        ("rows", lambda: simtrue.Record(s.t, s.q[1:]), "record: `q` has shape (1199,), and there are 1200 times"),
        ("joints", lambda: simtrue.Record(s.t, s.q, np.zeros((1200, 2))), "`v` has shape (1200, 2), and there are 1200 times and 1 joints"),
        ("time", lambda: simtrue.Record(no_time, s.q), "record: `t`, row 3: nan is no time"),
        ("order", lambda: simtrue.Record(late, s.q, name="a"), "a: `t`, row 6: 0.02 s does not come after 0.02 s"),
        ("infinite", lambda: simtrue.Record(s.t, infinite), "record: `q`, row 4, column 1: inf"),
        ("text", lambda: simtrue.Record(s.t, ["x"] * 1200), "record: `q` holds something else than numbers"),
        ("ragged", lambda: simtrue.Record(s.t, [[1.0], [1.0, 2.0]]), "record: `q` holds something else"),
        ("two inputs", lambda: simtrue.Record(s.t, s.q, tau=s.tau, u=s.tau), "record: `tau` and `u` are given"),
    ]


@pytest.mark.parametrize("which", range(8))
def test_arrays_that_are_no_record(swing: Swing, which: int) -> None:
    _, make, message = wrong_records(swing)[which]
    with pytest.raises(simtrue.SimtrueError, match=re.escape(message)) as told:
        make()
    assert "\n  help: " in str(told.value)
    assert isinstance(told.value, ValueError)


def test_logs_that_do_not_fit(arm: simtrue.Robot, swing: Swing, tmp_path: Path) -> None:
    def told(logs: Any, **options: Any) -> str:
        with pytest.raises(simtrue.SimtrueError) as error:
            simtrue.read(arm, logs, **options)
        text = str(error.value)
        assert "\n  help: " in text and "--" not in text, text
        return text

    columns = swing.columns()
    assert "nowhere.csv: cannot be read" in told(tmp_path / "nowhere.csv")
    assert "record_1: no column holds numbers" in told(pd.DataFrame({"a": ["x", "y"]}))
    nameless = pl.DataFrame({"time": swing.t, "a": swing.q, "b": swing.tau})
    unknown = told({"run 7": nameless})
    assert unknown.startswith("run 7: ") and "position" in unknown and "map=" in unknown
    slip = told(pd.DataFrame(columns), map="q:sholder=shoulder_pos")
    assert "no joint `sholder`" in slip and "shoulder" in slip
    assert "no channel `elbow_pos`" in told(pd.DataFrame(columns), map=["q:shoulder=elbow_pos"])
    effort = {("effort" if "torque" in k else k): v for k, v in columns.items()}
    assert "input torque" in told(pd.DataFrame(effort))
    assert "input_hold: `cubic`" in told(pd.DataFrame(columns), input_hold="cubic")
    assert "gain_factor: `a=kq:4`" in told(pd.DataFrame(columns), gain_factor="a=kq:4")
    assert "no commanded positions" in told(pd.DataFrame(columns), targets=True)
    assert "input: `power`" in told(pd.DataFrame(effort), input="power")
    late = pd.DataFrame(columns)
    late.loc[4, "time_ms"] = np.nan
    assert "row 5" in told(late)
    two = simtrue.Record(swing.t, np.zeros((1200, 2)), tau=np.zeros((1200, 2)), name="two")
    assert "two: `q` has 2 columns, the robot 1 joints: shoulder" in told(two)
    assert "a int is no log" in told([7])
    assert "logs" in told([])
    assert "sample_time: -1" in told(pd.DataFrame(columns), sample_time=-1.0)
    records = simtrue.read(arm, swing.record())
    assert "gain says how logs are read" in told(records, gain=[1.0])


def test_robots_that_are_none(arm_file: Path, tmp_path: Path) -> None:
    with pytest.raises(simtrue.SimtrueError, match=r"nowhere\.urdf: cannot be read"):
        simtrue.load_robot(tmp_path / "nowhere.urdf")
    with pytest.raises(simtrue.SimtrueError, match="a URDF, not an MJCF"):
        simtrue.Robot.from_mjcf(arm_file)
    with pytest.raises(simtrue.SimtrueError, match="use 'cad', 'data-sheet' or 'guessed'"):
        simtrue.load_robot(arm_file, trust="much")
    with pytest.raises(simtrue.SimtrueError, match="two_link"):
        simtrue.Robot.from_model("two_lnk")


def test_robots_of_all_forms(arm: simtrue.Robot, tmp_path: Path) -> None:
    assert (arm.name, arm.joints, arm.input_units) == ("Arm", ["shoulder"], ["N*m"])
    mass = next(name for name in arm.parameters if "mass" in name)
    assert arm.parameters[mass] == 6.0
    assert arm.tolerances[mass] == pytest.approx(0.3), "5 % of a CAD model"
    assert arm.parameter_units[mass] == "kg"
    file = tmp_path / "nominal.toml"
    file.write_text(arm.to_toml())
    assert simtrue.Robot.from_description(file).parameters == arm.parameters
    mjcf = tmp_path / "arm.xml"
    mjcf.write_text(
        """<mujoco model="arm"><compiler angle="radian"/><worldbody><body name="upper">
        <joint name="shoulder" type="hinge" axis="0 1 0" damping="0.5"/>
        <inertial pos="0 0 -0.17" mass="6" diaginertia="0.085 0.088 0.012"/></body></worldbody>
        <actuator><motor joint="shoulder"/></actuator></mujoco>"""
    )
    robot = simtrue.Robot.from_mjcf(mjcf)
    assert robot.joints == ["shoulder"]
    assert 6.0 in robot.parameters.values()
