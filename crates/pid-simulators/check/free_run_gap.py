"""Free-run gap of an exported robot in MuJoCo against the records of a data folder.

    python free_run_gap.py EXPORT DESCRIPTION DATA

EXPORT: folder of `simtrue export --to mujoco`; DESCRIPTION: the extended.toml it was made from; DATA:
folder with dataset.toml. Needs numpy, scipy and mujoco. The gap is that of `simtrue diagnose`: windows
of `horizon_s`, errors of position and velocity over the standard deviation of the read channel, root
mean square over joints, channels and test records.

Where a window begins within a record, states that no sensor reads come from a run over the second
before; positions and velocities are then set to the smoothed readings.
"""

import csv
import importlib.util
import math
import sys
import tomllib
from pathlib import Path

import numpy as np
from scipy.signal import butter, filtfilt

WARM = 1.0
START_HZ = 30.0
LARGEST = 9.9


def module(folder):
    spec = importlib.util.spec_from_file_location("robot_effects", folder / "robot_effects.py")
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def column(rows, *names):
    for name in names:
        if name in rows[0]:
            return np.array([float(r[name]) if r[name] not in ("", "nan", "NaN") else math.nan for r in rows])
    return None


def smoothed(t, q):
    rate = 1.0 / (t[1] - t[0])
    known = np.isfinite(q)
    q = np.interp(t, t[known], q[known])
    b, a = butter(3, min(START_HZ, 0.4 * rate), fs=rate)
    q = filtfilt(b, a, q)
    return q, np.gradient(q, t)


def prompt(robot, j, delay, smooth_q, smooth_v, k, h):
    """Smoothed reading of joint j at sample k, shifted by the delay of its sensor."""
    x = min(k + delay / h, len(smooth_q) - 1.0)
    i = min(int(x), len(smooth_q) - 2)
    s = x - i
    v = 0.0 if k == 0 else smooth_v[i] * (1 - s) + smooth_v[i + 1] * s
    return smooth_q[i] * (1 - s) + smooth_q[i + 1] * s, v


def put(robot, q, v):
    """Sets positions and velocities of the encoders' side; twists of gears stay."""
    d = robot.data
    for j in range(robot.n):
        a, b = robot._unread(j, q[j], v[j])
        if robot.on_link and j in robot.twist:
            at, dof, _ = robot.twist[j]
            a, b = a - d.qpos[at], b - d.qvel[dof]
        elif j in robot.twist:
            # The other side of the gear keeps its own velocity.
            at, dof, _ = robot.twist[j]
            d.qvel[dof] += d.qvel[robot.dof[j]] - b
        d.qpos[robot.qadr[j]], d.qvel[robot.dof[j]] = a, b


def window(robot, r, k, length, velocities):
    """Errors of one window, [sample, joint, channel]."""
    n, h, t = robot.n, r["h"], r["t"]
    delays = [robot._sum("sensor_delay", j, "delay_s") for j in range(n)]
    at = lambda k: list(zip(*[prompt(robot, j, delays[j], r["sq"][j], r["sv"][j], k, h) for j in range(n)]))
    begin = max(0, k - round(WARM / h))
    hold = slice(begin, begin + int(0.015 / h) + 1)
    robot.reset(*at(begin), u=r["u"][:, hold].mean(axis=1), time=begin * h,
                earlier=[(i * h, r["u"][:, i]) for i in range(max(0, begin - 200), begin)])
    for i in range(begin, k):
        robot.step(robot.data, r["u"][:, i], h)
    if k > begin:
        put(robot, *at(k))
    # The history of readings and the filters begin anew at the window.
    robot.history = [(robot.data.time, *robot._encoders(robot.data))]
    robot.before = np.where(np.isfinite(r["q"][:, k]), r["q"][:, k], r["sq"][:, k])
    first = np.where(np.isfinite(r["v"][:, k]), r["v"][:, k], r["sv"][:, k])
    robot.filtered, robot.shown, robot.read_at = first.copy(), first.copy(), robot.data.time
    out = np.full((length, n, 2), math.nan)
    for i in range(length):
        robot.step(robot.data, r["u"][:, k + i], h)
        q, v = robot.readings(robot.data)
        out[i, :, 0] = q - r["q"][:, k + i + 1]
        if velocities:
            out[i, :, 1] = v - r["v"][:, k + i + 1]
    return out


def main(export, description, data):
    robot = module(export).Robot(export)
    stated = tomllib.loads(description.read_text())
    dataset = tomllib.loads((data / "dataset.toml").read_text())
    fitted = stated.get("simulated", {}).get("fitted_records", [])
    names = [j["name"] for j in dataset["joint"]]
    sums = []
    for e in dataset["experiment"]:
        name = Path(e["file"]).stem
        if e["role"] != "test" or name in fitted:
            continue
        rows = list(csv.DictReader((data / e["file"]).open()))
        t = column(rows, "t")
        h = (t[-1] - t[0]) / (len(t) - 1)
        pick = lambda what, k: column(rows, f"{what}_{names[k]}", f"{what}{k + 1}", f"{what}_{k + 1}", what)
        r = {"t": t, "h": h}
        for what, key in (("q", "q"), ("dq", "v"), ("u", "u")):
            own = [pick(what, k) for k in range(robot.n)]
            r[key] = np.array([np.full(len(t), math.nan) if x is None else x for x in own])
        if e.get("u_unit_factor"):
            r["u"] = r["u"] * e["u_unit_factor"]
        even = t[0] + h * np.arange(len(t))
        if np.abs(even - t).max() > 0.02 * h:
            # Uneven stamps: readings on straight lines, inputs held.
            for key in ("q", "v"):
                r[key] = np.array([np.interp(even, t, x) for x in r[key]])
            r["u"] = r["u"][:, np.clip(np.searchsorted(t, even + 1e-9, side="right") - 1, 0, len(t) - 1)]
            r["t"] = t = even
        smooth = [smoothed(t, q) for q in r["q"]]
        r["sq"], r["sv"] = np.array([s[0] for s in smooth]), np.array([s[1] for s in smooth])
        last = len(t) - 1
        horizon = stated["robot"].get("horizon_s")
        length = last if horizon is None else min(max(round(horizon / h), 1), last)
        size = np.stack([np.nanstd(r["q"], axis=1), np.nanstd(r["v"], axis=1)], axis=1)
        velocities = bool(np.isfinite(r["v"]).any())
        errors = [window(robot, r, k * length, length, velocities) / size for k in range(last // length)]
        each = [np.sqrt(np.nanmean(e**2)) for e in errors]
        print(f"  {name}: windows", " ".join(f"{x:.4f}" for x in each))
        square = np.nanmean(np.concatenate(errors) ** 2, axis=0)
        sums.append(np.minimum(square, LARGEST**2))
    joints = np.mean(sums, axis=0)
    for name, (q, v) in zip(names, np.sqrt(joints)):
        print(f"  joint {name}: position {q:.4f}, velocity {v:.4f}")
    print(f"free-run gap in MuJoCo: {math.sqrt(np.nanmean(joints)):.4f}")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*map(Path, sys.argv[1:]))
