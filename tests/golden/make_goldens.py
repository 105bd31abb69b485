#!/usr/bin/env python3
"""Golden values of the dynamics of the arms in `models`, computed by Pinocchio from the published tables.

    python3 -m venv venv && venv/bin/pip install -r tests/golden/requirements.txt
    venv/bin/python tests/golden/make_goldens.py            # writes tests/golden/<robot>.json

The robots are built here from their sources (Denavit-Hartenberg tables and inertias in the frames in which they are published,
joint origins of the URDF), not from the declarations in `models`. A file holds, per point, the parameters by name (those not
named are zero, gains are one), q, v, a, tau, and
    inverse  = rnea(q, v, a)         N m, N
    forward  = aba(q, v, tau)        rad/s^2, m/s^2
First point: nominal parameters. Others: the inertia of every link is scaled, and a point mass is added at a random place, so
that all ten parameters of each link differ and remain those of a body.
"""
import json
import math
import pathlib

import numpy as np
import pinocchio as pin

HERE = pathlib.Path(__file__).resolve().parent
POINTS = 12
GRAVITY = [0.0, 0.0, -9.81]


def rot_x(angle):
    # Quarter turns are meant exactly.
    c, s = round(math.cos(angle), 15), round(math.sin(angle), 15)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rot_y(angle):
    c, s = round(math.cos(angle), 15), round(math.sin(angle), 15)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def move(x=0.0, y=0.0, z=0.0, rotation=np.eye(3)):
    return pin.SE3(rotation, np.array([x, y, z], float))


def tensor(xx, yy, zz, xy=0.0, xz=0.0, yz=0.0):
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def body(mass, com, inertia):
    """Inertia about the centre of mass."""
    return pin.Inertia(mass, np.array(com, float), inertia)


class Arm:
    """A chain: per joint its model, its frame in the frame of the joint before, and the inertia in its own frame."""

    def __init__(self, name):
        self.name, self.joints = name, []

    def add(self, link, joint, placement, inertia):
        self.joints.append((link, joint, placement, inertia))

    def model(self, inertias):
        model = pin.Model()
        model.gravity.linear = np.array(GRAVITY)
        parent = 0
        for (link, joint, placement, _), inertia in zip(self.joints, inertias):
            parent = model.addJoint(parent, joint, placement, link)
            model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
        return model


def denavit_hartenberg(name, links, rows, bodies):
    """Standard convention: frame i is frame i-1 after rotz(q) trans(a, 0, d) rotx(alpha); bodies are given in frame i."""
    arm, before = Arm(name), pin.SE3.Identity()
    for link, (a, d, alpha), inertia in zip(links, rows, bodies):
        after = move(x=a, z=d, rotation=rot_x(alpha))
        arm.add(link, pin.JointModelRZ(), before, after.act(inertia))
        before = after
    return arm


def ur10e():
    """Universal Robots, DH Parameters for calculations of kinematics and dynamics: UR10e."""
    right = math.pi / 2
    rows = [(0, 0.1807, right), (-0.6127, 0, 0), (-0.57155, 0, 0), (0, 0.17415, right), (0, 0.11985, -right), (0, 0.11655, 0)]
    wrist = tensor(0.00296, 0.00222, 0.00258, -0.00001, 0.0, -0.00024)
    bodies = [
        body(7.369, [0.021, 0.0, 0.027], tensor(0.03408, 0.03529, 0.02156, 0.00002, -0.00425, 0.00008)),
        body(13.051, [0.380, 0.0, 0.158], tensor(0.02814, 0.77068, 0.76943, 0.00005, -0.01561, 0.00002)),
        body(3.989, [0.240, 0.0, 0.068], tensor(0.01014, 0.30928, 0.30646, 0.00008, 0.00916, 0.0)),
        body(2.100, [0.0, 0.007, 0.018], wrist),
        body(1.980, [0.0, 0.007, 0.018], wrist),
        body(0.615, [0.0, 0.0, -0.026], tensor(0.00040, 0.00041, 0.00034)),
    ]
    links = ["shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"]
    return denavit_hartenberg("ur10e", links, rows, bodies)


def panda():
    """Franka Emika (Craig's convention: a and alpha of the row before) and Gaz et al. 2019."""
    right = math.pi / 2
    rows = [(0, 0, 0.333), (0, -right, 0), (0, right, 0.316), (0.0825, right, 0), (-0.0825, -right, 0.384), (0, right, 0),
            (0.088, right, 0)]
    # mass, com x y z, xx yy zz xy xz yz
    table = [
        (4.970684, 0.003875, 0.002081, -0.04762, 0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169),
        (0.646926, -0.003141, -0.02872, 0.003495, 0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704),
        (3.228604, 0.027518, 0.039252, -0.066502, 0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805),
        (3.587895, -0.05317, 0.104419, 0.027454, 0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641),
        (1.225946, -0.011953, 0.041065, -0.038437, 0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229),
        (1.666555, 0.060149, -0.014117, -0.010517, 0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341),
        (0.735522, 0.010517, -0.004252, 0.061597, 0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741),
    ]
    arm = Arm("panda")
    for k, ((a, alpha, d), row) in enumerate(zip(rows, table)):
        # rotx(alpha) trans(a, 0, 0), then d along the new z.
        turned = move(x=a, rotation=rot_x(alpha)) * move(z=d)
        arm.add(f"l{k + 1}", pin.JointModelRZ(), turned, body(row[0], row[1:4], tensor(*row[4:])))
    return arm


def arm6():
    """UR10 of example-robot-data: joint origins and inertias of the URDF, its fixed links left out."""
    up = rot_y(math.pi / 2)
    arm = Arm("arm6")
    for link, joint, placement, mass, length, cross, along in [
        ("l1", pin.JointModelRZ(), move(z=0.1273), 7.778, 0.0, 0.031474312577, 0.021875625),
        ("l2", pin.JointModelRY(), move(y=0.220941, rotation=up), 12.93, 0.306, 0.421753803798, 0.036365625),
        ("l3", pin.JointModelRY(), move(y=-0.1719, z=0.612), 3.87, 0.28615, 0.111069694097, 0.010884375),
        ("l4", pin.JointModelRY(), move(z=0.5723, rotation=up), 1.96, 0.0, 0.005108247957, 0.0055125),
        ("l5", pin.JointModelRZ(), move(y=0.1149), 1.96, 0.0, 0.005108247957, 0.0055125),
        ("l6", pin.JointModelRY(), move(z=0.1157), 0.202, 0.0, 0.000526462289, 0.000568125),
    ]:
        arm.add(link, joint, placement, body(mass, [0.0, 0.0, length], tensor(cross, cross, along)))
    return arm


def scara(p):
    """Cobra 600 by its Denavit-Hartenberg table (a1, d1, a2, alpha2, prismatic third joint) and named parameters.

    What does not enter the equations is filled in at random, so that a dependence on it would show."""
    rng = np.random.default_rng(7)

    def link(m, c, izz):
        inertia = tensor(*(0.01 + 0.01 * rng.random(2)), 0.0)
        inertia[2, 2] = izz
        return body(m, c, inertia)

    # The inner link: inertia about the first axis iz1, split at random between turning mass and mass off the axis.
    m1, c1 = 2.0, np.array([0.05, 0.02, 0.3])
    bodies = [
        link(m1, c1, p["iz1"] - m1 * (c1[0] ** 2 + c1[1] ** 2)),
        link(p["m2"], [p["sx2"], p["sy2"], 0.07], p["iz2"]),
        # The quill does not turn against the outer link: its inertia about its axis would add to iz2.
        link(p["m3"], [0.0, 0.0, -0.05], 0.0),
        link(p["m4"], [p["sx4"], p["sy4"], 0.02], p["iz4"]),
    ]
    arm = Arm("scara")
    arm.add("inner", pin.JointModelRZ(), move(z=0.387), bodies[0])
    arm.add("outer", pin.JointModelRZ(), move(x=0.325), bodies[1])
    arm.add("quill", pin.JointModelPZ(), move(x=0.275, rotation=rot_x(math.pi)), bodies[2])
    arm.add("flange", pin.JointModelRZ(), pin.SE3.Identity(), bodies[3])
    return arm


SCARA = {"iz1": 0.45, "m2": 8.0, "sx2": 0.14, "sy2": 0.01, "iz2": 0.09, "m3": 1.5, "m4": 0.8, "sx4": 0.012, "sy4": -0.004,
         "iz4": 0.002}


def standard(link, inertia):
    """The ten parameters of a link by name: mass, first moment, inertia about the origin."""
    x = inertia.toDynamicParameters()               # m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz
    names = ["m", "mx", "my", "mz", "ixx", "ixy", "iyy", "ixz", "iyz", "izz"]
    return {f"{link}_{name}": value for name, value in zip(names, x.tolist())}


def disturbed(inertia, rng):
    scale = 2.0 ** rng.uniform(-1, 1)
    extra = pin.Inertia(0.5 * inertia.mass * rng.random(), 0.2 * rng.uniform(-1, 1, 3), np.zeros((3, 3)))
    return pin.Inertia.FromDynamicParameters(scale * inertia.toDynamicParameters() + extra.toDynamicParameters())


def point(model, params, rng):
    n, data = model.nq, model.createData()
    q, v, a = rng.uniform(-3, 3, n), rng.uniform(-2, 2, n), rng.uniform(-10, 10, n)
    tau = rng.uniform(-50, 50, n)
    return {
        "params": params, "q": q.tolist(), "v": v.tolist(), "a": a.tolist(), "tau": tau.tolist(),
        "inverse": pin.rnea(model, data, q, v, a).tolist(),
        "forward": pin.aba(model, data, q, v, tau).tolist(),
    }


def write(name, points):
    lines = ",\n ".join(json.dumps(p) for p in points)
    (HERE / f"{name}.json").write_text(f"[{lines}]\n")
    print(name, len(points), "points")


def main():
    for seed, arm in enumerate([arm6(), ur10e(), panda()]):
        rng, points = np.random.default_rng(seed), []
        for k in range(POINTS):
            inertias = [inertia if k == 0 else disturbed(inertia, rng) for *_, inertia in arm.joints]
            params = {}
            for (link, *_), inertia in zip(arm.joints, inertias):
                params |= standard(link, inertia)
            points.append(point(arm.model(inertias), params, rng))
        write(arm.name, points)
    rng, points = np.random.default_rng(3), []
    for k in range(POINTS):
        params = {name: x * (1.0 if k == 0 else 2.0 ** rng.uniform(-1, 1)) for name, x in SCARA.items()}
        arm = scara(params)
        points.append(point(arm.model([inertia for *_, inertia in arm.joints]), params, rng))
    write("scara", points)


if __name__ == "__main__":
    main()
