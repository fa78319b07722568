"""An arm that repeats a task, with plausible torques, currents and supply power.

A stand-in world for emulators: enough physics (gravity, inertia, friction, copper loss, standby) that a spring hooked
on a joint is visible in power and hardly in position, as on a position-controlled arm. It shares no code with the
models in the plugins.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cellwatt.arrays import Float


@dataclass(frozen=True, slots=True)
class Move:
    """Joints (1-based) that move together by ``by`` rad each within ``seconds`` s, then rest for ``rest`` s."""

    by: Mapping[int, float]
    seconds: float
    rest: float = 0.25


PICK_AND_PLACE: tuple[Move, ...] = (
    Move({1: 0.9}, 0.8),
    Move({3: -0.7}, 0.7),
    Move({2: 0.35, 5: -0.5}, 0.7),
    Move({6: 1.2}, 0.5, 0.4),
    Move({3: 0.7}, 0.7),
    Move({1: -0.9}, 0.8),
    Move({2: -0.35, 5: 0.5}, 0.7),
    Move({6: -1.2}, 0.5, 0.5),
)


@dataclass
class ArmSignals:
    """Six joints that repeat ``moves`` for ever, starting at ``home`` (rad); ``speed`` 1 is as planned.

    ``disturb(spring=3, stiffness=60, rest=0, at=12.5)`` hooks a spring (Nm/rad) on joint 3 at t = 12.5 s; without
    ``rest``, rad, the spring is slack at the joint's home position. ``disturb(encoder=2, offset=0.05, at=…)`` shifts an
    encoder by 0.05 rad. Both end after ``for`` s, if given. ``noise`` scales the measurement noise.
    """

    moves: tuple[Move, ...] = PICK_AND_PLACE
    home: tuple[float, ...] = (0.0, -1.2, 1.4, -1.6, -1.5, 0.0)
    speed: float = 1.0
    seed: int = 0
    noise: float = 1.0
    standby: float = 95.0  # W
    bus_voltage: float = 48.0  # V
    gravity: tuple[float, ...] = (0.0, 42.0, 18.0, 2.5, 0.8, 0.0)  # Nm at the horizontal
    inertia: tuple[float, ...] = (4.0, 4.5, 1.8, 0.35, 0.25, 0.1)  # kg m²
    coulomb: tuple[float, ...] = (6.0, 7.0, 4.0, 1.5, 1.2, 1.0)  # Nm
    viscous: tuple[float, ...] = (8.0, 9.0, 5.0, 2.0, 1.6, 1.2)  # Nm s/rad
    torque_constant: tuple[float, ...] = (12.0, 12.0, 9.0, 6.5, 6.5, 6.5)  # Nm/A
    resistance: tuple[float, ...] = (1.1, 1.1, 1.2, 2.0, 2.0, 2.0)  # ohm
    stiffness: float = 60000.0  # Nm/rad of the position loop
    _springs: list[tuple[int, float, float, float, float]] = field(default_factory=list)
    _encoders: list[tuple[int, float, float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(self.seed)

    @property
    def period(self) -> float:
        """Duration of one repetition, s."""
        return sum(m.seconds + m.rest for m in self.moves) / self.speed

    def starts(self, joint: int) -> list[float]:
        """Times within one repetition, s, at which a joint starts to move."""
        found, t = [], 0.0
        for move in self.moves:
            if joint in move.by:
                found.append(t / self.speed)
            t += move.seconds + move.rest
        return found

    def disturb(self, change: Mapping[str, float | str]) -> None:
        """See the class; raises ``ValueError`` for an unknown change."""
        known = {k: float(v) for k, v in change.items()}
        at = known.get("at", 0.0)
        end = at + known["for"] if "for" in known else np.inf
        if not {"spring", "encoder"} & set(known):
            raise ValueError(f"an emulated arm knows spring and encoder, not {', '.join(change)}")
        joint = int(known.get("spring", known.get("encoder", 0)))
        if not 1 <= joint <= len(self.home):
            raise ValueError(f"an emulated arm has joints 1 to {len(self.home)}, not {joint}")
        if "spring" in known:
            rest = known.get("rest", self.home[joint - 1])
            self._springs.append((joint - 1, known.get("stiffness", 60.0), rest, at, end))
        else:
            self._encoders.append((joint - 1, known.get("offset", 0.05), at, end))

    def motion(self, t: Float) -> tuple[Float, Float, Float]:
        """Position rad, velocity rad/s, acceleration rad/s², each (n, 6), of the planned motion at t (n,) s."""
        phase = np.mod(np.asarray(t, dtype=np.float64), self.period) * self.speed
        q = np.tile(np.asarray(self.home), (len(phase), 1))
        w, a = np.zeros_like(q), np.zeros_like(q)
        start = 0.0
        for move in self.moves:
            s = np.clip((phase - start) / move.seconds, 0.0, 1.0)
            rate = self.speed / move.seconds
            for joint, by in move.by.items():
                q[:, joint - 1] += by * (10 * s**3 - 15 * s**4 + 6 * s**5)
                w[:, joint - 1] += by * rate * 30 * s**2 * (1 - s) ** 2
                a[:, joint - 1] += by * rate**2 * 60 * s * (1 - s) * (1 - 2 * s)
            start += move.seconds + move.rest
        return q, w, a

    def torque(self, t: Float, q: Float, w: Float, a: Float) -> tuple[Float, Float]:
        """Drive torque (n, 6) Nm, and the share of it that acts against hooked springs, (n, 6) Nm."""
        angle = np.cumsum(q[:, 1:4], axis=1)
        gravity = np.zeros_like(q)
        gravity[:, 1:4] = np.asarray(self.gravity[1:4]) * np.cos(angle)
        gravity[:, 4] = self.gravity[4] * np.cos(q[:, 4])
        friction = np.asarray(self.coulomb) * np.tanh(w / 0.01) + np.asarray(self.viscous) * w
        spring = np.zeros_like(q)
        for joint, stiffness, rest, at, end in self._springs:
            spring[:, joint] += np.where((t >= at) & (t < end), stiffness * (q[:, joint] - rest), 0.0)
        return gravity + np.asarray(self.inertia) * a + friction + spring, spring

    def at(self, t: Float) -> Mapping[str, Float]:
        """All channels that an arm, its supply or an analyzer on its mains can deliver, (n,) each, at t (n,) s."""
        t = np.asarray(t, dtype=np.float64)
        q, w, a = self.motion(t)
        torque, spring = self.torque(t, q, w, a)
        current = torque / np.asarray(self.torque_constant)
        power = self.standby + (torque * w + np.asarray(self.resistance) * current**2).sum(axis=1)
        measured = q - spring / self.stiffness
        for joint, offset, at, end in self._encoders:
            measured[:, joint] += np.where((t >= at) & (t < end), offset, 0.0)

        def noisy(x: Float, sigma: float) -> Float:
            return x + self.noise * sigma * self._random.standard_normal(x.shape)

        supply = noisy(power, 1.5)
        out: dict[str, Float] = {}
        for name, table, sigma in (
            ("position", measured, 2e-5),
            ("velocity", w, 1e-3),
            ("torque", torque, 0.2),
            ("current", current, 0.02),
        ):
            for joint, column in enumerate(noisy(table, sigma).T, start=1):
                out[f"joint_{joint}.{name}"] = column
        for joint in range(1, 7):
            out[f"joint_{joint}.temperature"] = 31.0 + joint + 0.002 * np.minimum(t, 3000.0)
            out[f"joint_{joint}.voltage"] = np.full_like(t, self.bus_voltage)
        out["supply.power"] = supply
        out["supply.voltage"] = noisy(np.full_like(t, 230.0), 0.1)
        out["supply.current"] = supply / 0.95 / 230.0
        out["bus.voltage"] = noisy(np.full_like(t, self.bus_voltage), 0.02)
        out["bus.current"] = (supply - 0.4 * self.standby) / self.bus_voltage
        return out
