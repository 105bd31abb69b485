"""Free-run gap of an exported robot in MuJoCo against the records of a data folder.

    python free_run_gap.py EXPORT DESCRIPTION DATA

EXPORT: folder of `simtrue export --to mujoco`; DESCRIPTION: the extended.toml it was made from; DATA:
folder with dataset.toml. Needs numpy, scipy and mujoco. The gap is that of `simtrue diagnose`: windows
of `horizon_s`, errors of position and velocity over the standard deviation of the read channel, root
mean square over joints, channels and test records.

Where a window begins within a record, states that no sensor reads come from a run over the second
before, integrals of position loops from a run over all of the record before; positions and velocities
are then set to the smoothed readings.
"""

import csv
import importlib.util
import math
import sys
import tomllib
from pathlib import Path

import mujoco
import numpy as np
from scipy.signal import butter, filtfilt

WARM = 1.0
START_HZ = 30.0
LARGEST = 9.9


def module(folder):
    """The wrapper of an export; others may be loaded beside it."""
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


def begins(q, h, fastest):
    """Velocity with which a record begins: the slope of a cubic through its first 0.1 s, where that is certain and
    more than a tenth of the largest speed."""
    count = min(len(q), max(8, round(0.1 / h)))
    known = np.isfinite(q[:count])
    x, y = h * np.arange(count)[known], q[:count][known]
    if len(x) < 6:
        return 0.0
    line, spread = np.polyfit(x, y, 3, cov=True)
    certain = abs(line[2]) > 4.0 * math.sqrt(spread[2, 2])
    return line[2] if certain and abs(line[2]) > 0.1 * fastest else 0.0


def prompt(robot, j, delay, smooth_q, smooth_v, k, h):
    """Smoothed reading of joint j at sample k, shifted by the delay of its sensor."""
    x = min(k + delay / h, len(smooth_q) - 1.0)
    i = min(int(x), len(smooth_q) - 2)
    s = x - i
    v = smooth_v[0] if k == 0 else smooth_v[i] * (1 - s) + smooth_v[i + 1] * s
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


def integrals(robot):
    """Joints whose loops have an integral."""
    return [j for j, loop in enumerate(robot.loops) if loop is not None and loop._integrates()]


def hidden(robot, r, k, size, velocities, twisted):
    """Twists of gears at the start of a record and their rates, if they are asked for, and what integrals of loops
    hold beyond the weight, from the second after it.

    They minimise the free-run error over 1 % of the motion, and the squares of the deviations from rest
    over a tenth of the twist under the largest torque, or over the input that dry friction holds:
    Gauss-Newton steps with differences.
    """
    gears = [(j, g) for j, (_, _, g) in robot.twist.items()] if twisted else []
    units = []
    for j, g in gears:
        twist = 0.1 * np.abs(robot.gain[j] * r["u"][j]).max() / g["stiffness"] + 0.5 * g["gap"]
        units += [twist, twist * math.sqrt(g["stiffness"] / mass(robot, j))]
    units += [robot.coulomb[j] / abs(robot.gain[j]) for j in integrals(robot)]
    if k > 0 or not units:
        return []
    length = min(round(1.0 / r["h"]), r["q"].shape[1] - 1)

    def left(x):
        e = window(robot, r, k, length, velocities, [a * b for a, b in zip(x, units)]) / size / 0.01
        return np.concatenate([e[np.isfinite(e)], x])

    x = np.zeros(len(units))
    best = left(x)
    for _ in range(4):
        slopes = np.stack([(left(x + 0.02 * d) - best) / 0.02 for d in np.eye(len(x))], axis=1)
        full = -np.linalg.lstsq(slopes, best, rcond=None)[0]
        trials = [(x + s * full, left(x + s * full)) for s in (1.0, 0.5, 0.25)]
        y, e = min(trials, key=lambda trial: (trial[1] ** 2).sum())
        if (e**2).sum() >= (best**2).sum():
            break
        x, best = y, e
    return [a * b for a, b in zip(x, units)]


def mass(robot, j):
    """Inertia of the link behind the gear of joint j."""
    m, d = robot.model, robot.data
    full = np.zeros((m.nv, m.nv))
    mujoco.mj_forward(m, d)
    mujoco.mj_fullM(m, d, full) if mujoco.__version__ >= "4" else mujoco.mj_fullM(m, full, d.qM)
    return full[robot.twist[j][1], robot.twist[j][1]]


def window(robot, r, k, length, velocities, states=()):
    """Errors of one window, [sample, joint, channel]; `states` are those of the start of the record."""
    n, h, t = robot.n, r["h"], r["t"]
    delays = [robot._sum("sensor_delay", j, "delay_s") for j in range(n)]
    at = lambda k: list(zip(*[prompt(robot, j, delays[j], r["sq"][j], r["sv"][j], k, h) for j in range(n)]))
    begin = max(0, k - round(WARM / h)) if not integrals(robot) else 0
    own = len(integrals(robot))
    twists, held = (states[: len(states) - own], states[len(states) - own :]) if begin == 0 else ((), ())
    hold = slice(begin, begin + int(0.015 / h) + 1)
    robot.reset(*at(begin), u=r["u"][:, hold].mean(axis=1), time=begin * h,
                earlier=[(i * h, r["u"][:, i]) for i in range(max(0, begin - 200), begin)])
    for i, j in enumerate(robot.twist if len(twists) else ()):
        at_twist, dof, _ = robot.twist[j]
        robot.data.qpos[at_twist] += twists[2 * i]
        robot.data.qvel[dof] += twists[2 * i + 1]
        if robot.on_link:
            robot.data.qpos[robot.qadr[j]] -= twists[2 * i]
            robot.data.qvel[robot.dof[j]] -= twists[2 * i + 1]
    for j, more in zip(integrals(robot), held):
        robot.loops[j].integral += more
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


def start(robot, r, size, horizon):
    """Velocities with which a record begins whose cubic says that it begins in motion: those whose free run stays
    nearest to the positions over a quarter of a window. Gauss-Newton steps with differences."""
    moving = np.flatnonzero(r["sv"][:, 0])
    if not len(moving):
        return
    length = min(max(round((0.25 * horizon if horizon else 0.1) / r["h"]), 10), r["q"].shape[1] - 1)

    def left(v):
        r["sv"][moving, 0] = v
        e = window(robot, r, 0, length, False)[..., 0] / size[:, 0]
        return e[np.isfinite(e)]

    v = r["sv"][moving, 0].copy()
    best = left(v)
    for _ in range(4):
        steps = 0.01 * np.abs(r["sv"][moving]).max(axis=1)
        slopes = [(left(v + step * one) - best) / step for step, one in zip(steps, np.eye(len(v)))]
        trial = v - np.linalg.lstsq(np.stack(slopes, axis=1), best, rcond=None)[0]
        e = left(trial)
        if (e**2).sum() >= (best**2).sum():
            break
        v, best = trial, e
    r["sv"][moving, 0] = v


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
        if any(loop is not None for loop in robot.loops):
            robot.gain_factors(**e.get("gain_factors", {}))
            robot.drives_off(e.get("off", False))
        t = column(rows, "t")
        h = (t[-1] - t[0]) / (len(t) - 1)
        pick = lambda what, k: column(rows, f"{what}_{names[k]}", f"{what}{k + 1}", f"{what}_{k + 1}", what)
        r = {"t": t, "h": h}
        for what, key in (("q", "q"), ("dq", "v"), ("u", "u")):
            # Behind a position loop the input is the target.
            target = lambda k: what == "u" and robot.loops[k] is not None
            own = [pick("qref" if target(k) else what, k) for k in range(robot.n)]
            r[key] = np.array([np.full(len(t), math.nan) if x is None else x for x in own])
        if np.all(e.get("off", False)):
            r["u"] = np.zeros_like(r["q"])
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
        r["sv"][:, 0] = [begins(q, h, np.abs(v[1:]).max()) for q, v in zip(r["q"], r["sv"])]
        last = len(t) - 1
        horizon = stated["robot"].get("horizon_s")
        length = last if horizon is None else min(max(round(horizon / h), 1), last)
        size = np.stack([np.nanstd(r["q"], axis=1), np.nanstd(r["v"], axis=1)], axis=1)
        start(robot, r, size, horizon)
        velocities = bool(np.isfinite(r["v"]).any())
        twisted = bool(stated.get("simulated", {}).get("hidden_states"))
        states = hidden(robot, r, 0, size, velocities, twisted)
        run = lambda k: window(robot, r, k, length, velocities, states)
        errors = [run(k * length) / size for k in range(last // length)]
        each = [np.sqrt(np.nanmean(e**2)) for e in errors]
        print(f"  {name}: windows", " ".join(f"{x:.4f}" for x in each))
        square = np.nanmean(np.concatenate(errors) ** 2, axis=0)
        sums.append(np.minimum(square, LARGEST**2))
    joints = np.mean(sums, axis=0)
    for name, (q, v) in zip(names, np.sqrt(joints)):
        print(f"  joint {name}: position {q:.4f}, velocity {v:.4f}")
    print(f"free-run gap in MuJoCo: {math.sqrt(np.nanmean(joints)):.3g}")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*map(Path, sys.argv[1:]))
