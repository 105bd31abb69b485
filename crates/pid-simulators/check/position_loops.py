"""Outputs of position loops along a motion, as the wrapper for MuJoCo computes them.

    python position_loops.py          # prints the table that position_loops.json holds

The tests of the wheel hold position_loops.json against this module, those of pid-simulators hold it against the
library: two programs, one table.
"""

import importlib.util
import json
import math
from pathlib import Path

HERE = Path(__file__).resolve().parent
STEP, COUNT, EVERY = 1e-3, 1200, 60
LOOPS = [
    {"law": "p", "kp": 12.0, "limit": 1.5},
    {"law": "pd", "kp": 12.0, "kd": 0.9, "dead_band": 0.02, "velocity_filter_s": 0.03},
    {"law": "pd", "kp": 12.0, "kd": 0.9, "velocity_feed_forward": 0.7, "target_speed": 0.8, "rate_hz": 250.0},
    {"law": "pd", "kp": 12.0, "kd": 0.9, "target_rate_hz": 25.0, "target_step": 0.05, "target_filter_s": 0.06},
    {"law": "pid", "kp": 12.0, "kd": 0.9, "ki": 25.0, "limit": 2.0, "integral_limit": 0.5, "gravity": 0.8},
    {"law": "pid", "kp": 12.0, "kd": 0.9, "ki": 25.0, "target_acceleration": 5.0, "velocity_feed_forward": 1.0},
    {"law": "cascade", "kp": 12.0, "kv": 1.1, "ki": 8.0, "velocity_limit": 0.9, "limit": 6.0, "rate_hz": 200.0},
    {
        "law": "cascade",
        "kp": 12.0,
        "kv": 1.1,
        "ki": 8.0,
        "target_acceleration": 8.0,
        "target_speed": 0.9,
        "target_average_s": 0.05,
        "inertia_feed_forward": 0.6,
    },
]


def target(t):
    """Position, velocity and acceleration of the target: a sine, and a step at 0.4 s."""
    s, c = math.sin(3.0 * t), math.cos(3.0 * t)
    return 0.5 * s + (0.6 if t >= 0.4 else 0.0), 1.5 * c, -4.5 * s


def motion(t):
    """Position and velocity that the loop reads."""
    return 0.4 * math.sin(3.0 * t - 0.3), 1.2 * math.cos(3.0 * t - 0.3)


def outputs(laws, numbers):
    """The output at every 60th step of 1 ms."""
    loop = laws.Loop(numbers)
    loop.reset(target(0.0)[0], *motion(0.0))
    out = []
    for k in range(COUNT):
        t = STEP * k
        loop.follow(*target(t), t, STEP)
        gravity = math.cos(t)
        inertia = 0.1 * loop.follows.acceleration
        u, _ = loop.answer(lambda ahead: motion(t + ahead), gravity, inertia, t, STEP)
        if k % EVERY == EVERY - 1:
            out.append(u)
    return out


def module():
    """The module that the wrapper loads."""
    file = HERE.parent / "src" / "mujoco" / "position_loops.py"
    spec = importlib.util.spec_from_file_location("position_loops", file)
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def table():
    """Each loop with its outputs."""
    laws = module()
    return [{"loop": numbers, "u": outputs(laws, numbers)} for numbers in LOOPS]


if __name__ == "__main__":
    print(json.dumps(table(), indent=1))
