"""The embedded example in Python and by the command: the same numbers."""

import html
import json
from pathlib import Path
from typing import Any

import pytest

import simtrue

from conftest import Command, Diagnosed


def without_time(value: Any) -> Any:
    """JSON values without the times that a computation took."""
    if isinstance(value, dict):
        return {k: without_time(v) for k, v in value.items() if k != "seconds"}
    if isinstance(value, list):
        return [without_time(v) for v in value]
    return value


@pytest.fixture(scope="session")
def folder(diagnosed: Diagnosed, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example's records as a data folder."""
    path = tmp_path_factory.mktemp("example") / "data"
    assert diagnosed.records.save(diagnosed.robot, path)
    return path


def test_the_effect_of_the_example_is_named(diagnosed: Diagnosed) -> None:
    """Truth: −8 N·m exp(−(v / 0.8 rad/s)²) tanh(50 v) at the elbow, dry friction 2 N·m."""
    d = diagnosed.result
    assert d.verdict == "one cause"
    assert [(e.name, e.joint) for e in d.effects] == [("stribeck", "elbow")]
    parameters = {p.name: p for p in d.effects[0].parameters}
    for name, truth, unit in [("static_to_coulomb", 5.0, "1"), ("stribeck_velocity", 0.8, "rad/s")]:
        found = parameters[name]
        assert found.value == pytest.approx(truth, rel=0.1)
        assert found.unit == unit
        assert found.interval is not None and found.std is not None
        low, high = found.interval
        assert high - low == pytest.approx(2 * 1.96 * found.std, rel=1e-3)
        assert (low + high) / 2 == pytest.approx(found.value)
    assert d.gap_after < 1.1 * d.gap_floor < d.gap_before
    (low, high), _ = d.gap_intervals
    assert low <= d.gap_before <= high


def test_the_command_gives_the_same_diagnosis(
    diagnosed: Diagnosed, folder: Path, command: Command, tmp_path: Path
) -> None:
    done = command("diagnose", folder, "--model", "two_link", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    theirs = json.loads((tmp_path / "diagnosis.json").read_text())
    assert without_time(diagnosed.result.to_dict()) == without_time(theirs)
    lines = str(diagnosed.result).splitlines()
    assert lines[0] in done.stdout and lines[1] in done.stdout


def test_the_command_gives_the_same_identification(
    diagnosed: Diagnosed, folder: Path, command: Command, tmp_path: Path
) -> None:
    ours = simtrue.identify(diagnosed.robot, diagnosed.records)
    done = command("identify", "two_link", folder, "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    theirs = json.loads((tmp_path / "fit.json").read_text())
    assert without_time(ours.to_dict()["parameters"]) == theirs["parameters"]
    assert without_time(ours.to_dict()["outcome"]) == without_time(theirs["outcome"])
    row = theirs["parameters"][0]
    first = ours.parameters[row["name"]]
    assert (first.value, first.std, first.unit) == (row["value"], row["deviation"], row["unit"])
    assert list(ours.parameters) == [r["name"] for r in theirs["parameters"]]


def test_a_notebook_shows_the_page(diagnosed: Diagnosed, tmp_path: Path) -> None:
    shown = diagnosed.result._repr_html_()
    start, end = '<iframe srcdoc="', '" style="'
    assert shown.startswith(start) and shown.endswith("></iframe>")
    page = html.unescape(shown[len(start) : shown.rindex(end)])
    assert page == diagnosed.result.to_html()
    assert page.startswith("<!DOCTYPE html>") and "stribeck" in page and "<svg" in page
    diagnosed.result.save(tmp_path / "new" / "folder")
    assert (tmp_path / "new" / "folder" / "report.html").read_text() == page
    written = json.loads((tmp_path / "new" / "folder" / "diagnosis.json").read_text())
    assert written == diagnosed.result.to_dict()


def test_a_folder_that_cannot_be_written_is_told(diagnosed: Diagnosed, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(simtrue.SimtrueError, match=r"file.*cannot be written"):
        diagnosed.result.save(file)


def test_the_work_is_told_and_other_threads_run(diagnosed: Diagnosed) -> None:
    assert len(diagnosed.steps) >= 3
    assert any("gap" in step for step in diagnosed.steps)
    # With Python held, the other thread would have run at the steps only.
    assert diagnosed.ticks > 5 * len(diagnosed.steps)


def test_the_example_as_arrays(diagnosed: Diagnosed) -> None:
    records = diagnosed.records
    assert records.joints == diagnosed.robot.joints == ["shoulder", "elbow"]
    assert records.input_units == diagnosed.robot.input_units == ["A", "A"]
    assert records.roles == ["train", "train", "test"] and len(records) == 3
    arrays = records.arrays("train_sway")
    assert arrays["t"].shape == (601,)
    assert arrays["q"].shape == arrays["v"].shape == arrays["u"].shape == (601, 2)
    assert arrays["q"][0] == pytest.approx([0.2, 3.6], abs=2e-3)
    with pytest.raises(simtrue.SimtrueError, match="the records are train_sway, "):
        records.arrays("sway")


def test_the_example_by_arrays_again(diagnosed: Diagnosed) -> None:
    """Arrays of records, given back as such, are the same records."""
    logs = []
    for name in diagnosed.records.names:
        a = diagnosed.records.arrays(name)
        logs.append(simtrue.Record(a["t"], a["q"], a["v"], u=a["u"], name=name))
    again = simtrue.read(diagnosed.robot, logs)
    assert again.names == diagnosed.records.names
    assert again.roles == diagnosed.records.roles
    for name in again.names:
        ours, theirs = again.arrays(name), diagnosed.records.arrays(name)
        assert ours.keys() == theirs.keys()
        assert all((ours[k] == theirs[k]).all() for k in ours)
