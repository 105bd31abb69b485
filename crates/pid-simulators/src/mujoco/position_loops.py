"""Position loops inside drives: from targets to the inputs of motors. robot_effects.py uses them.

Behind such a loop the input of a joint is a target r:

    target -> stages of the target -> error less the dead band -> law on the position and the velocity as
    read, late and filtered -> plus gravity and inertia that the drive knows -> limit -> motor

Keys are those of the table [drive] of the description.
"""

import math
from collections import deque

NEVER = -math.inf


class _Motion:
    """Position, velocity and acceleration of what is followed."""

    def __init__(self, r, rate=0.0, acceleration=0.0):
        self.r, self.rate, self.acceleration = r, rate, acceleration


class Loop:
    """The loop of one drive with what it remembers."""

    def __init__(self, numbers):
        self.p, self.stated = dict(numbers), dict(numbers)
        self.law = self.p["law"]
        self.delay = self.p.get("feedback_delay_s", 0.0)
        self.needs_rate = any(key in self.p for key in ("velocity_feed_forward", "inertia_feed_forward"))
        self.reset(0.0, 0.0, 0.0)

    def reset(self, r, q, v, needed=None, gravity=0.0):
        """At rest at a target; `q`, `v`: as the loop reads them, `needed`: the input that holds the robot,
        which the integral brings where there is one. Returns the output."""
        self.taken, self.next_target = r, NEVER
        self.moving, self.before, self.next_rate = _Motion(r), None, NEVER
        self.goes, self.filtered = _Motion(r), _Motion(r)
        self.rest, self.past = r, deque()
        self.follows, self.velocity = _Motion(r), v
        self.integral, self.due, self.held = 0.0, NEVER, 0.0
        at = (r, q, v, 0.0, gravity, 0.0)
        if self._integrates() and needed is not None:
            self.integral = self._clipped(needed - self._free(at, 0.0))
        return self._limited(self._free(at, self.integral))

    def times(self, factors):
        """Gains are so many times those of the description, as pairs of key and factor; others are as described."""
        missing = [key for key in factors if key not in self.stated]
        if missing:
            raise ValueError(f"the law {self.law} has no gain {missing[0]}")
        self.p = self.stated | {key: factor * self.stated[key] for key, factor in factors.items()}

    # What is followed.

    def _period(self):
        rate = self.p.get("rate_hz")
        return 0.0 if rate is None else 1.0 / rate

    def _holds(self, h):
        """Period of a loop that reads at the start of a step of `h` and holds its output, or None."""
        period = self._period()
        number = period / h
        whole = number > 0.5 and abs(number - round(number)) < 1e-3 * number
        return period if whole or number > 2.0 else None

    def due_at(self, t, h):
        """Whether the loop reads in the step of `h` from `t`."""
        return self._holds(h) is None or t >= self.due - 1e-3 * h

    def follow(self, r, rate, acceleration, t, h):
        """Moves the stages of the target on over the step of `h` from `t`."""
        if not self.due_at(t, h):
            return
        period = self._holds(h)
        length, lead = (period, 0.0) if period is not None else (h, 0.5 * self._period())
        middle, end = self._stages(_Motion(r, rate, acceleration), t, length, lead)
        self.follows = middle if period is None else end

    def _stages(self, target, t, h, lead):
        p = self.p
        times = (min(0.5 * h + lead, h), h)
        own = self._moving(target, t, h)
        own = _Motion(self._taken(target.r, t, h), own.rate, own.acceleration)
        speed, hardest = p.get("target_speed"), p.get("target_acceleration")
        if hardest is not None:
            both = [_profile(self.goes, own.r, speed, hardest, time) for time in times]
        elif speed is not None:
            both = [_slewed(self.goes.r, own, speed, time) for time in times]
        else:
            both = [own, own]
        self.goes = both[1]
        if "target_average_s" in p:
            both = self._averaged(both, p["target_average_s"], t, times)
        if "target_filter_s" in p:
            both = [_filtered(self.filtered, m, p["target_filter_s"], time) for m, time in zip(both, times)]
            self.filtered = both[1]
        return both

    def _moving(self, target, t, h):
        """The target with its velocity and acceleration as the drive has them."""
        hz = self.p.get("target_rate_hz")
        if hz is None:
            return target
        if t >= self.next_rate - 1e-3 * h:
            if self.before is not None:
                since = t - self.before[1]
                rate = (target.r - self.before[0]) / since
                self.moving = _Motion(target.r, rate, (rate - self.moving.rate) / since)
            self.before = (target.r, t)
            self.next_rate = _next_period(t, 1.0 / hz, 1e-3 * h)
        return _Motion(target.r, self.moving.rate, self.moving.acceleration)

    def _taken(self, r, t, h):
        hz, step = self.p.get("target_rate_hz"), self.p.get("target_step")
        if hz is None or t >= self.next_target - 1e-3 * h:
            # Halves go away from zero.
            self.taken = r if step is None else math.copysign(math.floor(abs(r) / step + 0.5) * step, r)
            if hz is not None:
                self.next_target = _next_period(t, 1.0 / hz, 1e-3 * h)
        return self.taken

    def _averaged(self, both, time, t, times):
        """Means over the time before; between moments what is followed goes along straight lines."""
        total = _moment(self.past[-1], t)[0] if self.past else 0.0
        span = times[1] - times[0]
        slope = lambda a, b: (b - a) / span if span > 0.0 else 0.0
        moved, grown = slope(both[0].r, both[1].r), slope(both[0].rate, both[1].rate)
        now = (t, total, both[1].r - moved * times[1], moved, both[1].rate - grown * times[1], grown)
        self.past.append(now)
        while len(self.past) > 1 and self.past[1][0] <= t - time:
            self.past.popleft()
        out = []
        for own, later in zip(both, times):
            until = _moment(now, t + later)[0]
            since, r, rate = self._at(t + later - time)
            out.append(_Motion((until - since) / time, (own.r - r) / time, (own.rate - rate) / time))
        return out

    def _at(self, t):
        for moment in reversed(self.past):
            if moment[0] <= t:
                return _moment(moment, t)
        first = self.past[0]
        return first[1] + self.rest * (t - first[0]), self.rest, 0.0

    # What it answers.

    def answer(self, read, gravity, inertia, t, h):
        """Input of the motor over the step of `h` from `t`, and by how much it falls with the velocity.

        `read(ahead)`: position and velocity as the encoder shows them so long after the start of the step.
        """
        ahead = self.p.get("velocity_feed_forward", 0.0) * self.follows.rate
        period = self._holds(h)
        if period is not None:
            if t < self.due - 1e-3 * h:
                return self.held, 0.0
            first = self.due == NEVER
            q, v = read(0.0)
            _, self.velocity, _ = self._velocity(v if first else self.velocity, v, period)
            at = (self.follows.r, q, self.velocity, ahead, gravity, inertia)
            self.integral = self._integrated(at, period)
            self.held = self._limited(self._free(at, self.integral))
            late = first or t > self.due + period
            self.due = (t if late else self.due) + period
            return self.held, 0.0
        q, v = read(0.5 * (h - self._period()))
        middle, self.velocity, moves = self._velocity(self.velocity, v, h)
        at = (self.follows.r, q, middle, ahead, gravity, inertia)
        before, self.integral = self.integral, self._integrated(at, h)
        free = self._free(at, 0.5 * (before + self.integral))
        u = self._limited(free)
        falls = self.p["kv"] if self.law == "cascade" else self.p.get("kd", 0.0)
        return u, falls * moves if u == free and self.delay == 0.0 else 0.0

    def slowed(self, u, speed):
        """What the motor brings of an input at a speed in the direction in which a positive one drives."""
        stall, most = self.p.get("stall"), self.p.get("no_load_speed")
        if most is None:
            return u
        return min(stall * (1.0 - speed / most), max(-stall * (1.0 + speed / most), u))

    def _velocity(self, before, v, h):
        """Behind its filter in the middle and at the end of a step, and how the first moves with `v`."""
        time = self.p.get("velocity_filter_s")
        if time is None:
            return v, v, 1.0
        half, whole = math.exp(-0.5 * h / time), math.exp(-h / time)
        return v + (before - v) * half, v + (before - v) * whole, 1.0 - half

    def _integrates(self):
        return self.law in ("pid", "cascade")

    def _error(self, r, q):
        band = self.p.get("dead_band", 0.0)
        error = r - q
        return error - min(band, max(-band, error))

    def _lacks(self, at):
        """Of a cascade: the velocity that is asked for less that which is read."""
        r, q, v, ahead, _, _ = at
        wanted = self.p["kp"] * self._error(r, q) + ahead
        most = self.p.get("velocity_limit", math.inf)
        return min(most, max(-most, wanted)) - v

    def _free(self, at, integral):
        r, q, v, ahead, gravity, inertia = at
        p = self.p
        if self.law == "cascade":
            u = p["kv"] * self._lacks(at) + integral
        else:
            u = p["kp"] * self._error(r, q) - p.get("kd", 0.0) * (v - ahead)
            u += integral if self.law == "pid" else 0.0
        return u + p.get("gravity", 0.0) * gravity + p.get("inertia_feed_forward", 0.0) * inertia

    def _limited(self, u):
        limit = self.p.get("limit", math.inf)
        return min(limit, max(-limit, u))

    def _clipped(self, integral):
        most = self.p.get("integral_limit", math.inf)
        return min(most, max(-most, integral))

    def _integrated(self, at, h):
        """It stops where the output is limited and the error pushes further."""
        if not self._integrates():
            return self.integral
        grows = self._lacks(at) if self.law == "cascade" else self._error(at[0], at[1])
        more = self.p["ki"] * grows * h
        free = self._free(at, self.integral)
        if free != self._limited(free) and free * more > 0.0:
            return self.integral
        return self._clipped(self.integral + more)


def _next_period(t, period, slack):
    return (math.floor((t + slack) / period) + 1.0) * period


def _slewed(start, own, speed, time):
    most = speed * time
    slow = abs(own.rate) <= speed
    r = start + min(most, max(-most, own.r - start))
    return _Motion(r, min(speed, max(-speed, own.rate)), own.acceleration if slow else 0.0)


def _filtered(before, own, time, h):
    kept = math.exp(-h / time)
    rate = own.rate + (before.rate - own.rate) * kept
    return _Motion(own.r + (before.r - own.r) * kept, rate, (own.rate - rate) / time)


def _moment(moment, t):
    """Integral up to `t`, position and velocity there."""
    begin, total, r, moved, rate, grown = moment
    since = t - begin
    return total + (r + 0.5 * moved * since) * since, r + moved * since, rate + grown * since


def _profile(start, target, speed, a, time):
    """The fastest motion to rest at a target within a speed and an acceleration, `time` later."""
    way, v = target - start.r, start.rate
    brakes = v * abs(v) / (2.0 * a)
    beyond = way - brakes
    on_curve = abs(beyond) <= 1e-12 * max(abs(way), abs(brakes))
    sign = math.copysign(1.0, v if on_curve else beyond)
    way, v = way * sign, v * sign
    top = v if on_curve else math.sqrt(max(0.0, a * way + 0.5 * v * v))
    fastest = top if speed is None else min(top, speed)
    speeds_up = (fastest - v) / a
    goes_on = (way - (2.0 * fastest * fastest - v * v) / (2.0 * a)) / fastest if fastest < top else 0.0
    end = speeds_up + goes_on + fastest / a
    if time < speeds_up:
        r, rate, acceleration = (v + 0.5 * a * time) * time, v + a * time, a
    elif time < speeds_up + goes_on:
        r = (fastest * fastest - v * v) / (2.0 * a) + fastest * (time - speeds_up)
        rate, acceleration = fastest, 0.0
    elif time < end:
        left = end - time
        r, rate, acceleration = way - 0.5 * a * left * left, a * left, -a
    else:
        return _Motion(target)
    return _Motion(start.r + r * sign, rate * sign, acceleration * sign)
