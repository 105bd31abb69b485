"""Drives of a robot for Newton, from robot_drives.json in the same folder.

    from newton_drives import add_robot

    builder = newton.ModelBuilder()
    add_robot(builder, step=0.002)           # step of the physics, s
    model = builder.finalize()

It adds robot.urdf, sets armature, friction and damping of its joints, and gives each an actuator: with
the gains of its position loop, where it has one, for which target positions are the commands. Others have
none: command efforts, the gain of the drive (`gain` in robot_drives.json) times the input, as feedforward.
"""

import json
from pathlib import Path

from newton.actuators import ClampingDCMotor, ClampingMaxEffort, DrivePD

FOLDER = Path(__file__).resolve().parent
DRIVES = json.loads((FOLDER / "robot_drives.json").read_text(encoding="utf-8"))["drives"]


def add_robot(builder, step, **options):
    """Adds the robot to a builder; `options` go to `add_urdf`. Returns the degree of freedom of each
    joint by name. A delay becomes the nearest whole number of steps."""
    first = builder.joint_count
    builder.add_urdf(str(FOLDER / "robot.urdf"), floating=False, **options)
    names = [label.rsplit("/", 1)[-1] for label in builder.joint_label[first:]]
    degrees = {}
    for drive in DRIVES:
        joint = first + names.index(drive["joint"])
        dof = builder.joint_qd_start[joint]
        builder.joint_armature[dof] = drive["armature"]
        builder.joint_friction[dof] = drive["friction"]
        builder.joint_damping[dof] = drive["viscous"]
        builder.joint_target_ke[dof] = builder.joint_target_kd[dof] = 0.0
        limit, no_load = drive["effort_limit"], drive["no_load_speed"]
        clamping = [] if limit is None else [(ClampingMaxEffort, {"max_effort": limit})]
        if no_load is not None:
            motor = {"saturation_effort": drive["stall_effort"], "velocity_limit": no_load}
            clamping.append((ClampingDCMotor, motor))
        builder.add_actuator(
            DrivePD,
            index=dof,
            pos_index=builder.joint_q_start[joint],
            clamping=clamping or None,
            delay_steps=round(drive["delay_s"] / step) or None,
            kp=drive["stiffness"],
            kd=drive["damping"],
            const_effort=drive["constant_effort"],
        )
        degrees[drive["joint"]] = dof
    return degrees
