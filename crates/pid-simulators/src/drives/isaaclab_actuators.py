"""Actuators of a robot for Isaac Lab 3, from robot_drives.json in the same folder.

    from isaaclab_actuators import actuators

    robot = ArticulationCfg(..., actuators=actuators(step=0.005))   # step of the physics, s

Import robot.urdf as the articulation. The actuators have no gains of their own: command efforts, the
gain of the drive (`gain` in robot_drives.json) times the input, by the articulation's effort target.
"""

import json
from pathlib import Path

from isaaclab.actuators import DelayedPDActuatorCfg, IdealPDActuatorCfg

DRIVES = json.loads((Path(__file__).resolve().parent / "robot_drives.json").read_text(encoding="utf-8"))["drives"]


def actuators(step):
    """Configurations by joint; a delay becomes the nearest whole number of steps."""
    out = {}
    for drive in DRIVES:
        fields = dict(
            joint_names_expr=[drive["joint"]],
            stiffness=0.0,
            damping=0.0,
            armature=drive["armature"],
            friction=drive["static_friction"],
            dynamic_friction=drive["friction"],
            viscous_friction=drive["viscous"],
        )
        if drive["effort_limit"] is not None:
            fields["actuator_effort_limit"] = drive["effort_limit"]
        if drive["delay_s"] > 0.0:
            steps = round(drive["delay_s"] / step)
            out[drive["joint"]] = DelayedPDActuatorCfg(min_delay=steps, max_delay=steps, **fields)
        else:
            out[drive["joint"]] = IdealPDActuatorCfg(**fields)
    return out
