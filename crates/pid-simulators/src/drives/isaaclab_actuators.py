"""Actuators of a robot for Isaac Lab 3, from robot_drives.json in the same folder.

    from isaaclab_actuators import actuators

    robot = ArticulationCfg(..., actuators=actuators(step=0.005))   # step of the physics, s

Import robot.urdf as the articulation. Where a drive has a position loop, its actuator has the gains of
it: command targets by the articulation's position target. Others have none: command efforts, the gain of
the drive (`gain` in robot_drives.json) times the input, by its effort target.
"""

import json
from pathlib import Path

from isaaclab.actuators import DCMotorCfg, DelayedPDActuatorCfg, IdealPDActuatorCfg

DRIVES = json.loads((Path(__file__).resolve().parent / "robot_drives.json").read_text(encoding="utf-8"))["drives"]


def actuators(step):
    """Configurations by joint; a delay becomes the nearest whole number of steps, or none behind a
    limit that falls with the speed, which has no delayed form."""
    out = {}
    for drive in DRIVES:
        fields = dict(
            joint_names_expr=[drive["joint"]],
            stiffness=drive["stiffness"],
            damping=drive["damping"],
            armature=drive["armature"],
            friction=drive["static_friction"],
            dynamic_friction=drive["friction"],
            viscous_friction=drive["viscous"],
        )
        if drive["effort_limit"] is not None:
            fields["actuator_effort_limit"] = drive["effort_limit"]
        if drive["no_load_speed"] is not None:
            out[drive["joint"]] = DCMotorCfg(
                saturation_effort=drive["stall_effort"],
                actuator_velocity_limit=drive["no_load_speed"],
                **fields,
            )
        elif drive["delay_s"] > 0.0:
            steps = round(drive["delay_s"] / step)
            out[drive["joint"]] = DelayedPDActuatorCfg(min_delay=steps, max_delay=steps, **fields)
        else:
            out[drive["joint"]] = IdealPDActuatorCfg(**fields)
    return out
