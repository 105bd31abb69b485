"""Holds mass matrix and bias of URDFs against Pinocchio at random states.

    cargo build --release -p pid-interpret --example dynamics_of_file
    pip install pin numpy
    python crates/pid-urdf/check/pinocchio_dynamics.py target/release/examples/dynamics_of_file FILE.urdf ...

Both read the same numbers: the example writes the URDF with the inertias that it read, so that mended and
guessed ones are the same. Joints are matched by name. What is held here is locked there, and joints that follow
others are projected onto them: M = G' M G, b = G' b. Prints a line a file and ends with 1 if one differs by more than
1e-10 of the largest entry.
"""

import json
import os
import subprocess
import sys
import tempfile

import numpy as np
import pinocchio as pin

TOLERANCE = 1e-10
STATES = 5


def states_of(example, file, written):
    """Lines of the example: what moves, then the states."""
    done = subprocess.run([example, file, str(STATES), written], capture_output=True, text=True, timeout=300)
    if done.returncode != 0:
        raise ValueError(f"not read: {done.stderr.strip().splitlines()[:1]}")
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    return lines[0], lines[1:]


def reduced(written, moving):
    """Pinocchio's model in which only these joints move."""
    model = pin.buildModelFromUrdf(written)
    locked = [k for k in range(1, model.njoints) if model.names[k] not in moving]
    return pin.buildReducedModel(model, locked, pin.neutral(model))


def projection(model, joints, follows):
    """G and c with q = G q_free + c and v = G v_free in the order of Pinocchio's velocities."""
    matrix, offset = np.zeros((model.nv, len(joints))), np.zeros(model.nv)
    leaders = {follower: (leader, ratio, c) for follower, leader, ratio, c in follows}
    for k in range(1, model.njoints):
        name, ratio, c = model.names[k], 1.0, 0.0
        if name in leaders:
            name, ratio, c = leaders[name]
        matrix[model.joints[k].idx_v, joints.index(name)] = ratio
        offset[model.joints[k].idx_v] = c
    return matrix, offset


def configuration(model, x):
    """Coordinates of Pinocchio, which are cosine and sine for a continuous joint."""
    q = np.zeros(model.nq)
    for joint, angle in ((j, x[j.idx_v]) for j in list(model.joints)[1:]):
        at = joint.idx_q
        q[at : at + joint.nq] = [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
    return q


def compare(example, file):
    """The number of coordinates and the largest difference, relative to the largest entry of each quantity."""
    with tempfile.TemporaryDirectory() as folder:
        written = os.path.join(folder, "written.urdf")
        head, states = states_of(example, file, written)
        joints, follows = head["joints"], head["follows"]
        model = reduced(written, set(joints) | {f[0] for f in follows})
    if model.nv != len(joints) + len(follows):
        raise ValueError(f"{model.nv} joints move there, {len(joints) + len(follows)} here")
    data, (matrix, offset) = model.createData(), projection(model, joints, follows)
    n, worst = len(joints), 0.0
    for state in states:
        q = configuration(model, matrix @ state["q"] + offset)
        v = matrix @ state["v"]
        mass = pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        mass = matrix.T @ mass @ matrix
        bias = matrix.T @ pin.nonLinearEffects(model, data, q, v)
        ours = np.zeros((n, n))
        ours[np.tril_indices(n)] = state["m"]
        for here, there in ((ours, np.tril(mass)), (np.array(state["b"]), bias)):
            worst = max(worst, np.abs(here - there).max() / max(np.abs(there).max(), 1e-12))
    return n, worst


def main():
    example, failed = sys.argv[1], 0
    good = 0
    for file in sys.argv[2:]:
        try:
            n, worst = compare(example, file)
        except (ValueError, subprocess.TimeoutExpired) as error:
            print(f"{file}: not compared: {error}", flush=True)
            continue
        good += worst <= TOLERANCE
        failed += worst > TOLERANCE
        print(f"{file}: {n} coordinates, {worst:.1e}", flush=True)
    print(f"{good} agree to {TOLERANCE:.0e}, {failed} do not")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
