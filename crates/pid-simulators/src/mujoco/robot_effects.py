"""Effects of a robot that robot.xml cannot express, around MuJoCo's step.

Needs numpy and mujoco. Reads robot.xml and robot_effects.json from its own folder:

    from robot_effects import Robot

    robot = Robot()
    robot.reset(q=[0.1], v=[0.0])
    for command in commands:                 # one command per joint, held for `period` seconds
        robot.step(robot.data, command, period)
        q, v = robot.readings(robot.data)    # as the encoders show them, once per period

Inputs are in the units of the description (A, V, N m or N); where a drive has a position loop they are
its targets (rad or m). The wrapper drives the joints itself: it turns the group of the robot's
actuators off and sets forces, friction and damping of its joints at every step. Everything else of the
model and its data stays as it is.

Positions and velocities are those of the side of the gear on which the encoder sits. One step of
length h, for every joint, with Coulomb level and damping from the effects:

    M dv/dt + bias = gain u_a + forces - damping v - friction,  friction within its level
"""

import importlib.util
import json
import math
from pathlib import Path

import mujoco
import numpy as np

FOLDER = Path(__file__).resolve().parent

INPUT = (
    "input_delay",
    "actuator_lag",
    "torque_saturation",
    "gain_error_nonlinear",
    "current_offset",
    "drive_dead_zone",
    "gain_over_time",
    "supply_sag",
)
FRICTION = (
    "stribeck",
    "coulomb_asymmetry",
    "load_dependent_friction",
    "friction_drift",
    "saturating_friction",
    "presliding_hysteresis",
    "friction_above_speed",
    "friction_above_load",
    "friction_wave",
)
FORCE = (
    "cogging",
    "motor_coupling",
    "spring",
    "joint_coupling",
    "external_force",
    "presliding_hysteresis",
    "hinge_above",
    "hinge_below",
    "time_wave",
    "wave_of_two",
    "wave_of_two_before",
    "pull_of_two",
    "base_wave",
)
READING = ("encoder_offset", "encoder_eccentricity", "sensor_delay", "velocity_filter_lag")
GEAR = ("backlash",)


def _beside(name):
    """A module of this folder, which need not be on the path of Python."""
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class _Effect:
    """An effect with its parameters and its memory."""

    def __init__(self, data):
        self.id = data["id"]
        self.joint = data["joint"]
        self.p = data["parameters"]
        self.memory = 0.0
        if self.id not in INPUT + FRICTION + FORCE + READING + GEAR:
            raise ValueError(f"effect {self.id} is unknown to this wrapper; export the robot again")


class Robot:
    """A MuJoCo model of the robot with all its effects."""

    def __init__(self, folder=FOLDER, model=None):
        """Reads the robot of a folder; `model`: a larger one that holds robot.xml, in place of it."""
        folder = Path(folder)
        known = json.loads((folder / "robot_effects.json").read_text(encoding="utf-8"))
        self.model = model or mujoco.MjModel.from_xml_path(str(folder / "robot.xml"))
        self.data = mujoco.MjData(self.model)
        self.joints = known["joints"]
        self.effects = [_Effect(e) for e in known["effects"]]
        self.on_link = known["encoder_side"] == "joint"
        m = self.model
        m.opt.disableactuator |= 1 << known["actuator_group"]
        self.n = len(self.joints)
        id_of = lambda kind, name: mujoco.mj_name2id(m, kind, name)
        joint = [id_of(mujoco.mjtObj.mjOBJ_JOINT, j["name"]) for j in self.joints]
        self.qadr = np.array([m.jnt_qposadr[k] for k in joint])
        self.dof = np.array([m.jnt_dofadr[k] for k in joint])
        self.gain = np.array([j["gain"] for j in self.joints])
        self.coulomb = np.array([j["coulomb"] for j in self.joints])
        self.viscous = np.array([j["viscous"] for j in self.joints])
        self.induced = np.array([j["induced"] for j in self.joints])
        self.off = np.zeros(self.n, bool)
        self.twist = {}
        for j, known_joint in enumerate(self.joints):
            gear = known_joint["gear"]
            if gear is None:
                continue
            k = id_of(mujoco.mjtObj.mjOBJ_JOINT, gear["joint"])
            self.twist[j] = (m.jnt_qposadr[k], m.jnt_dofadr[k], gear)
            if gear["gap"] > 0.0:
                m.jnt_limited[k] = 0
        self.followers = [
            (*(id_of(mujoco.mjtObj.mjOBJ_JOINT, f[key]) for key in ("joint", "leader")), f["ratio"], f["offset"])
            for f in known["followers"]
        ]
        own = [j["loop"] for j in self.joints]
        laws = _beside("position_loops") if any(own) else None
        self.loops = [None if p is None else laws.Loop(p) for p in own]
        self.drives = _Known(folder / known["drive_model"], self.joints) if known["drive_model"] else None
        self.tool = None
        if known["tool"] is not None:
            body = id_of(mujoco.mjtObj.mjOBJ_BODY, known["tool"]["body"])
            self.tool = (body, np.array(known["tool"]["point"]))
        self.reset(np.zeros(self.n), np.zeros(self.n))

    # Start.

    def gain_factors(self, **factors):
        """Gains of the position loops are so many times those of the description from now on: `kp=4.0` for all
        joints, `kp=[4.0, 1.0]` for each; without arguments they are as described."""
        for j, loop in enumerate(self.loops):
            own = {key: float(x[j] if np.ndim(x) else x) for key, x in factors.items()}
            if loop is not None:
                loop.times(own)

    def drives_off(self, off=True):
        """Drives have open terminals from now on: their motors exert no torque and do not brake. `off`: of all joints,
        or one for each; `False` switches them on."""
        self.off[:] = off

    def reset(self, q, v, u=None, time=0.0, earlier=(), data=None):
        """Starts `data` anew, with the robot where its encoders read `q`, `v` (without delay) and
        its drives at the inputs `u`; a loop without a target starts at the position that it reads.

        Gears are twisted and bristles bent as at rest under the weight. `time`: seconds since the
        start of what counts as the start of the motion (warm-up, pushes). `earlier`: pairs of the
        time and the inputs held from then on, for inputs that act later. The input before the first
        of them is the first one.
        """
        d = self.data if data is None else data
        m = self.model
        at_rest = [0.0 if loop is None else float(q[j]) for j, loop in enumerate(self.loops)]
        u = np.asarray(at_rest if u is None else u, float)
        mujoco.mj_resetData(m, d)
        d.time = time
        true = [self._unread(j, float(q[j]), float(v[j])) for j in range(self.n)]
        for j in range(self.n):
            d.qpos[self.qadr[j]], d.qvel[self.dof[j]] = true[j]
        for own, leader, ratio, offset in self.followers:
            d.qpos[m.jnt_qposadr[own]] = ratio * d.qpos[m.jnt_qposadr[leader]] + offset
            d.qvel[m.jnt_dofadr[own]] = ratio * d.qvel[m.jnt_dofadr[leader]]
        bias = self._weight(d)
        for j, (at, dof, gear) in self.twist.items():
            side = -0.5 if bias[j] < 0.0 else 0.5
            d.qpos[at] = -bias[j] / gear["stiffness"] - gear["gap"] * side
            if self.on_link:
                d.qpos[self.qadr[j]] -= d.qpos[at]
        mujoco.mj_forward(m, d)
        self.load = bias
        self.commands = [(t, np.asarray(x, float)) for t, x in earlier]
        self.spacing = m.opt.timestep
        self.acceleration = np.zeros(self.n)
        u = self._rest(d, u, bias)
        self.history = [(d.time, *self._encoders(d))]
        self.shown = self._encoders(d)[1].copy()
        self.filtered = self.shown.copy()
        self.before = self._encoders(d)[0].copy()
        self.read_at = d.time
        for e in self.effects:
            if e.id == "actuator_lag":
                e.memory = u[e.joint]
            elif e.id == "presliding_hysteresis":
                balance = self.gain[e.joint] * u[e.joint] - bias[e.joint]
                e.memory = min(1.0, max(-1.0, balance / (self.coulomb[e.joint] + 1e-12)))

    def _rest(self, d, u, bias):
        """Inputs of the motors at rest: of loops, those for their targets."""
        out = np.array(u, float)
        read = [self._sense(j, q, v) for j, (q, v) in enumerate(zip(*self._encoders(d)))]
        gravity = self.drives.weight([q for q, _ in read]) if self.drives else np.zeros(self.n)
        for j, loop in enumerate(self.loops):
            if loop is not None:
                out[j] = loop.reset(u[j], *read[j], needed=bias[j] / self.gain[j], gravity=gravity[j])
        out[self.off] = 0.0
        return out

    def _weight(self, d):
        """Torque that holds each joint at rest."""
        speed = d.qvel.copy()
        d.qvel[:] = 0.0
        mujoco.mj_forward(self.model, d)
        weight = d.qfrc_bias[self.dof] - self._push(d, 1e-3)[self.dof]
        d.qvel[:] = speed
        return weight

    def _unread(self, j, q, v):
        """True position and velocity whose reading is `q`, `v`."""
        a, b = q, v
        for _ in range(8):
            read = self._sense(j, a, b)
            a, b = a + q - read[0], b + v - read[1]
        return a, b

    # Step.

    def step(self, data, u, duration=None):
        """Moves `data` by `duration` seconds (one step of the model by default) under the inputs `u`.

        The duration is cut into equal steps, none longer than the model's.
        """
        longest = self.model.opt.timestep
        duration = longest if duration is None else duration
        steps = max(1, math.ceil(duration / longest - 1e-9))
        h = duration / steps
        self.commands.append((data.time, np.asarray(u, float)))
        self.spacing = duration
        late = max([e.p["delay_s"] for e in self.effects if e.id == "input_delay"], default=0.0)
        # The acceleration of a target takes two more.
        oldest = data.time - late - h - 2.0 * duration
        while len(self.commands) > 1 and self.commands[1][0] <= oldest:
            self.commands.pop(0)
        self.model.opt.timestep = h
        for _ in range(steps):
            self._one(data, h)
        self.model.opt.timestep = longest

    def _one(self, d, h):
        m = self.model
        q, v = d.qpos[self.qadr], d.qvel[self.dof]
        reading = self._encoders(d)
        self.falls = np.zeros(self.n)
        fed = self._follow(reading, d.time, h) if any(self.loops) else (np.zeros(self.n), np.zeros(self.n))
        asked = [self._asked(j, d, reading, fed, h) for j in range(self.n)]
        # What all drives take from the supply: the outputs of their loops, or what is commanded.
        sizes = [abs(self.commands[-1][1][j] if self.loops[j] is None else asked[j]) for j in range(self.n)]
        sizes = [0.0 if off else size for off, size in zip(self.off, sizes)]
        taken = sum(sizes)
        applied = np.array([self._applied(j, asked[j], taken - sizes[j], d.time, h) for j in range(self.n)])
        forward, backward = self.coulomb.copy(), self.coulomb.copy()
        applied[self.off], self.falls[self.off] = 0.0, 0.0
        damping = self.viscous - np.where(self.off, self.induced, 0.0)
        for e in self.effects:
            self._friction(e, q, v, d.time, h, forward, backward, damping)
        # Half of what the step changes of a loop's damping is implicit.
        implicit = 0.5 * self.gain * self.falls
        force = self.gain * applied + implicit * v
        damping += implicit
        for e in self.effects:
            self._force(e, q, v, d.time, h, force, damping)
        # Friction within [-backward, forward] is a symmetric one about half of the difference.
        force = force - 0.5 * (forward - backward)
        m.dof_frictionloss[self.dof] = np.maximum(0.5 * (forward + backward), 0.0)
        m.dof_damping[self.dof] = damping
        still = m.opt.gravity.copy()
        m.opt.gravity[:] = still - self._shake(d.time + 0.5 * h)
        push = self._push(d, h)
        total = push.copy()
        total[self.dof] += force
        for at, dof, gear in self.twist.values():
            if gear["gap"] > 0.0:
                total[dof] += self._contact(d, at, dof, gear, h)
        # Forces that others apply stay.
        d.qfrc_applied += total
        mujoco.mj_step(m, d)
        d.qfrc_applied -= total
        if any(e.id in ("load_dependent_friction", "friction_above_load") for e in self.effects):
            through = np.zeros(m.nv)
            mujoco.mj_rne(m, d, 1, through)
            self.load = (through - push)[self.dof]
        m.opt.gravity[:] = still
        moved = d.qpos[self.qadr] - q
        for e in self.effects:
            if e.id == "presliding_hysteresis":
                w = moved[e.joint] / e.p["presliding_range"]
                decay, mean, _ = _passage(abs(w))
                e.memory = e.memory * decay + w * mean
        now = self._encoders(d)
        self.acceleration = (now[1] - reading[1]) / h
        self.history.append((d.time, *now))
        self._forget(d.time)

    def _contact(self, d, at, dof, gear, h):
        """Force of the contact between rotor and link in a gear with play, and its damping.

        Half a step of the spring is implicit: stiff contacts stay stable.
        """
        middle = d.qpos[at] + 0.5 * h * d.qvel[dof]
        edge = 0.5 * gear["gap"]
        over = middle - min(edge, max(-edge, middle))
        if over == 0.0:
            self.model.dof_damping[dof] = gear["open"]
            return 0.0
        implicit = 0.5 * h * gear["stiffness"]
        self.model.dof_damping[dof] = gear["open"] + gear["damping"] + implicit
        return implicit * d.qvel[dof] - gear["stiffness"] * over

    def _command(self, j, t, h, before=0):
        """Command of joint `j` as it arrives over the step of length `h` from `t`, or so many commands before."""
        late = self._sum("input_delay", j, "delay_s")
        if late == 0.0 and before == 0:
            return self.commands[-1][1][j]
        return self._earlier(j, t - late - before * self.spacing, h)

    def _follow(self, reading, t, h):
        """Moves what the loops follow on; the inputs with which drives make up for gravity and inertia."""
        for j, loop in enumerate(self.loops):
            if loop is None:
                continue
            r = self._command(j, t, h)
            rate = acceleration = 0.0
            if loop.needs_rate or self.drives is not None:
                last, first = (self._command(j, t, h, before) for before in (1, 2))
                rate = (r - last) / self.spacing
                acceleration = (rate - (last - first) / self.spacing) / self.spacing
            loop.follow(r, rate, acceleration, t, h)
        if self.drives is None:
            return np.zeros(self.n), np.zeros(self.n)
        q = [self._read(j, reading, t, 0.0)[0] for j in range(self.n)]
        follows = [0.0 if loop is None else loop.follows.acceleration for loop in self.loops]
        return self.drives.weight(q), self.drives.inertia(follows)

    def _read(self, j, reading, t, ahead):
        """Position and velocity of joint `j` as its loop reads them, so long after `t`."""
        late = 0.0 if self.loops[j] is None else self.loops[j].delay
        if late > 0.0:
            return self._sense(j, *self._late(j, t + ahead - late))
        q, v = reading[0][j], reading[1][j]
        return self._sense(j, q + v * ahead, v + self.acceleration[j] * ahead)

    def _asked(self, j, d, reading, fed, h):
        """Input of joint `j` before the effects of its drive, averaged over the step of length `h`."""
        t = d.time
        u = self._command(j, t, h)
        loop = self.loops[j]
        if loop is None:
            return u
        read = lambda ahead: self._read(j, reading, t, ahead)
        asked, falls = loop.answer(read, fed[0][j], fed[1][j], t, h)
        side = math.copysign(1.0, self.gain[j])
        u = loop.slowed(asked, side * d.qvel[self.dof[j]])
        # Behind a gear that gives way the encoder may move by itself.
        self.falls[j] = falls if u == asked and not (self.on_link and j in self.twist) else 0.0
        return u

    def _applied(self, j, u, others, t, h):
        """Applied input of joint `j` behind the effects of its drive; `others`: sizes of the inputs of all others."""
        for e in self.effects:
            if e.id == "supply_sag":
                u = u * (1.0 - e.p["loss_per_input"] * (abs(u) + others))
            if e.joint != j:
                continue
            if e.id == "actuator_lag":
                time = e.p["time_constant_s"]
                fade = math.exp(-h / time)
                gone = e.memory - u
                e.memory = u + gone * fade
                u = u + gone * time * (1.0 - fade) / h
            elif e.id == "torque_saturation":
                limit = e.p["limit_input"]
                u = min(limit, max(-limit, u))
            elif e.id == "gain_error_nonlinear":
                u = u / (1.0 + e.p["droop_per_input_squared"] * u * u)
            elif e.id == "current_offset":
                u = u + e.p["offset"]
            elif e.id == "drive_dead_zone":
                width = e.p["half_width"]
                u = u - min(width, max(-width, u))
            elif e.id == "gain_over_time":
                u = u * (1.0 - e.p["loss"] * (1.0 - math.exp(-(t + 0.5 * h) / e.p["time_constant_s"])))
        return u

    def _earlier(self, j, t, h):
        """Mean of the commands of joint `j` from `t` to `t + h`."""
        total, end = 0.0, t + h
        for k, (since, u) in enumerate(self.commands):
            start = -math.inf if k == 0 else since
            stop = self.commands[k + 1][0] if k + 1 < len(self.commands) else math.inf
            total += u[j] * max(0.0, min(stop, end) - max(start, t))
        return total / h

    def _friction(self, e, q, v, t, h, forward, backward, damping):
        """Changes Coulomb levels and damping of the effect's joint over the step of length `h` from `t`."""
        j, p = e.joint, e.p
        if e.id == "stribeck":
            x = v[j] / p["stribeck_velocity"]
            factor = 1.0 + p["excess"] * math.exp(-x * x)
            forward[j] *= factor
            backward[j] *= factor
        elif e.id == "coulomb_asymmetry":
            a = p["asymmetry"]
            forward[j] *= 1.0 + a
            backward[j] *= 1.0 - a
            damping[j] *= 1.0 + a if v[j] > 0.0 else 1.0 - a
        elif e.id == "saturating_friction":
            rise = math.tanh(abs(v[j]) / p["saturation_speed"])
            factor = 1.0 - p["share"] + p["share"] * rise
            forward[j] *= factor
            backward[j] *= factor
        elif e.id == "load_dependent_friction":
            more = p["load_coefficient"] * abs(self.load[j])
            forward[j] += more
            backward[j] += more
        elif e.id == "friction_drift":
            factor = 1.0 + p["cold_excess"] * math.exp(-(t + 0.5 * h) / p["time_constant_s"])
            forward[j] *= factor
            backward[j] *= factor
            damping[j] *= factor
        elif e.id == "presliding_hysteresis":
            forward[j] = backward[j] = 0.0
        elif e.id == "friction_above_speed":
            more = p["slope"] * max(0.0, abs(v[j]) - p["from"])
            forward[j] += more
            backward[j] += more
        elif e.id == "friction_above_load":
            more = p["coefficient"] * max(0.0, abs(self.load[j]) - p["from"])
            forward[j] += more
            backward[j] += more
        elif e.id == "friction_wave":
            more = _wave(p, p["periods_per_unit"] * (q[j] + 0.5 * h * v[j]))
            forward[j] += more
            backward[j] += more

    def _force(self, e, q, v, t, h, force, damping):
        """Adds the forces of an effect; what grows with the velocity goes to the damping."""
        j, p = e.joint, e.p
        middle = q + 0.5 * h * v
        if e.id == "cogging":
            force[j] += _wave(p, p["periods_per_unit"] * middle[j])
        elif e.id == "motor_coupling" and j > 0:
            w = v[j] + p["ratio"] * v[j - 1]
            drag = p["viscous"] * w + p["coulomb"] * math.tanh(w / p["transition"])
            force[j] -= drag
            force[j - 1] -= drag * p["ratio"]
        elif e.id == "spring":
            force[j] += p["preload"] - p["stiffness"] * q[j]
        elif e.id == "joint_coupling" and j > 0:
            pull = p["preload"] - p["stiffness"] * (q[j] + p["ratio"] * q[j - 1])
            force[j] += pull
            force[j - 1] += pull * p["ratio"]
        elif e.id == "presliding_hysteresis":
            # The bristle over a step of constant speed, its mean, and its rate with the speed after it.
            travel = h / p["presliding_range"]
            decay, mean, lag = _passage(abs(v[j]) * travel)
            micro = p["micro_damping_time"] / h
            force[j] -= self.coulomb[j] * e.memory * (mean + micro * (decay - 1.0))
            damping[j] += self.coulomb[j] * travel * (lag + micro * mean)

        elif e.id == "hinge_above":
            force[j] -= p["stiffness"] * max(0.0, middle[j] - p["from"])
        elif e.id == "hinge_below":
            force[j] += p["stiffness"] * max(0.0, p["from"] - middle[j])
        elif e.id == "time_wave":
            force[j] += _wave(p, p["angular_frequency"] * (t + 0.5 * h))
        elif e.id in ("wave_of_two", "wave_of_two_before") and j > 0:
            on = j if e.id == "wave_of_two" else j - 1
            force[on] += _wave(p, p["periods_per_unit"] * (middle[j] + p["ratio"] * middle[j - 1]))
        elif e.id == "pull_of_two" and j > 0:
            pull = -p["stiffness"] * max(0.0, middle[j] + p["ratio"] * middle[j - 1] - p["from"])
            force[j] += pull
            force[j - 1] += pull * p["ratio"]

    def _shake(self, t):
        """Acceleration of the base at a time; the links feel gravity less that."""
        out = np.zeros(3)
        for e in self.effects:
            if e.id == "base_wave":
                p, phase = e.p, e.p["angular_frequency"] * t
                out += math.sin(phase) * np.array([p["sine_x"], p["sine_y"], p["sine_z"]])
                out += math.cos(phase) * np.array([p["cosine_x"], p["cosine_y"], p["cosine_z"]])
        return out

    def _push(self, d, h):
        """Forces on all degrees of freedom from what pushes the tool."""
        out = np.zeros(self.model.nv)
        for e in self.effects:
            if e.id != "external_force" or self.tool is None:
                continue
            p, share = e.p, 0.0
            for k in (1, 2, 3):
                on, off = p[f"on_{k}_s"], p[f"off_{k}_s"]
                share += max(0.0, min(off, d.time + h) - max(on, d.time)) / h
            if share == 0.0:
                continue
            body, point = self.tool
            at = d.xpos[body] + d.xmat[body].reshape(3, 3) @ point
            jacobian = np.zeros((3, self.model.nv))
            mujoco.mj_jac(self.model, d, jacobian, None, at, body)
            out += share * jacobian.T @ np.array([p["force_x"], p["force_y"], p["force_z"]])
        return out

    # Readings.

    def _encoders(self, d):
        """True positions and velocities on the side of the encoders."""
        q, v = d.qpos[self.qadr].copy(), d.qvel[self.dof].copy()
        if self.on_link:
            for j, (at, dof, _) in self.twist.items():
                q[j] += d.qpos[at]
                v[j] += d.qvel[dof]
        return q, v

    def _sense(self, j, q, v):
        for e in self.effects:
            if e.joint != j:
                continue
            if e.id == "encoder_offset":
                q = q + e.p["offset"]
            elif e.id == "encoder_eccentricity":
                a, b = e.p["sine"], e.p["cosine"]
                s, c = math.sin(q), math.cos(q)
                q, v = q + a * s + b * c, v * (1.0 + a * c - b * s)
        return q, v

    def _sum(self, id, j, name):
        return sum(e.p[name] for e in self.effects if e.id == id and e.joint == j)

    def _forget(self, t):
        longest = max((self._sum("sensor_delay", j, "delay_s") for j in range(self.n)), default=0.0)
        longest = max([longest, *(loop.delay for loop in self.loops if loop is not None)])
        while len(self.history) > 2 and self.history[1][0] < t - longest:
            self.history.pop(0)

    def _late(self, j, t):
        """Position and velocity of joint `j` at a time; before the first known one at its velocity."""
        first = self.history[0]
        if t <= first[0]:
            return first[1][j] + first[2][j] * (t - first[0]), first[2][j]
        for k in range(len(self.history) - 1, 0, -1):
            (t0, q0, v0), (t1, q1, v1) = self.history[k - 1], self.history[k]
            if t0 <= t:
                s = min((t - t0) / (t1 - t0), 1.0)
                return q0[j] * (1.0 - s) + q1[j] * s, v0[j] * (1.0 - s) + v1[j] * s
        return first[1][j], first[2][j]

    def readings(self, data):
        """Positions and velocities as the sensors show them. Filters move on by the time since the
        call before: call it once per period of the controller."""
        h = data.time - self.read_at
        self.read_at = data.time
        q, v = np.zeros(self.n), np.zeros(self.n)
        for j, known in enumerate(self.joints):
            delay = self._sum("sensor_delay", j, "delay_s")
            q[j], read = self._sense(j, *self._late(j, data.time - delay))
            if h > 0.0:
                if known["velocity"] == "derived":
                    hz = known["filter_hz"]
                    fade = 0.0 if hz is None else math.exp(-2.0 * math.pi * hz * h)
                    self.filtered[j] = fade * self.filtered[j] + (1.0 - fade) * (q[j] - self.before[j]) / h
                    self.before[j] = q[j]
                    read = self.filtered[j]
                lag = self._sum("velocity_filter_lag", j, "time_constant_s")
                fade = math.exp(-h / lag) if lag > 0.0 else 0.0
                self.shown[j] = fade * self.shown[j] + (1.0 - fade) * read
            v[j] = self.shown[j]
        return q, v


class _Known:
    """The robot as the drives know it, at rest."""

    def __init__(self, file, joints):
        self.model = mujoco.MjModel.from_xml_path(str(file))
        self.data = mujoco.MjData(self.model)
        m = self.model
        joint = [mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_JOINT, j["name"]) for j in joints]
        self.qadr = np.array([m.jnt_qposadr[k] for k in joint])
        self.dof = np.array([m.jnt_dofadr[k] for k in joint])
        self.gain = np.array([j["known_gain"] for j in joints])

    def weight(self, q):
        """Inputs that hold it at positions."""
        self.data.qpos[self.qadr] = q
        mujoco.mj_forward(self.model, self.data)
        return self.data.qfrc_bias[self.dof] / self.gain

    def inertia(self, acceleration):
        """Inputs that accelerate it where it was weighed last."""
        full = np.zeros(self.model.nv)
        full[self.dof] = acceleration
        force = np.zeros(self.model.nv)
        mujoco.mj_mulM(self.model, self.data, force, full)
        return force[self.dof] / self.gain


def _wave(p, phase):
    """A wave with the amplitudes of its sine and cosine."""
    return p["sine"] * math.sin(phase) + p["cosine"] * math.cos(phase)


def _passage(x):
    """exp(-x), its mean A over the way to x, and (1 - A)/x, for x >= 0."""
    if x < 1e-3:
        mean = 1.0 - 0.5 * x * (1.0 - x / 3.0)
        return 1.0 - x * mean, mean, 0.5 - x * (1.0 - 0.25 * x) / 6.0
    decay = math.exp(-x)
    mean = (1.0 - decay) / x
    return decay, mean, (1.0 - mean) / x
