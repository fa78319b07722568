"""One case while it is being drawn: arm, task, what the simulation believes, and what the effects change."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from concealed.arms import Arm, Array, draw_arm, mistune
from concealed.law import friction
from concealed.mechanics import Friction, Joints, Load, playback
from concealed.motion import STYLES, TICK, Plan
from concealed.plant import Body, rigid_torque
from concealed.sensing import Interface, draw_interface
from concealed.simulation import Simulation
from concealed.supply import Supply


class NotVisibleError(ValueError):
    """The effect would not show with this arm and this task; another draw is needed."""


@dataclass(frozen=True)
class RunSet:
    """The recordings of one case: (style, seconds) of the open and the sealed ones, Hz to choose from, s of a tick."""

    open: tuple[tuple[str, float], ...]
    sealed: tuple[tuple[str, float], ...]
    rates: tuple[float, ...]
    tick: float
    grid: float


RUN_SETS = {
    "short": RunSet(
        (("excite", 30), ("task", 30), ("sweep", 45), ("task", 30)),
        (("excite", 30), ("task", 30)),
        (50, 100, 125, 200, 250),
        TICK,
        0.004,
    ),
    "jerky": RunSet(
        (("excite", 30), ("jerky", 30), ("sweep", 45), ("jerky", 30)),
        (("excite", 30), ("jerky", 30)),
        (100, 125, 200, 250),
        TICK,
        0.004,
    ),
    "medium": RunSet((("task", 120), ("excite", 120), ("sweep", 90)), (("task", 120),), (50, 62.5, 100), TICK, 0.01),
    "long": RunSet((("cycle", 720), ("sweep", 90)), (("cycle", 720),), (25, 40, 50), 2 * TICK, 0.02),
}
"""Long runs have coarser ticks: their effects are slow, and a case must be quick to make."""

RATIO = {"weak": (1.5, 3.0), "medium": (3.0, 6.0), "strong": (6.0, 12.0)}
"""Size of an effect in its channel over all open runs, as RMS over the noise of that channel."""


@dataclass
class Setting:
    """One case: the plant's truth and what differs from it in the simulation.

    Effects change `body`, `interface`, `supply` or `believed`; `simulation` is what it has beyond its law.
    `q`, `v`, `a`, `rigid` are the planned motion and the links' torque on a coarse grid, (N, C, n), held after a
    run's end; `alive` (N, C) marks each run's length.
    """

    rng: np.random.Generator
    base: Arm
    believed: Arm
    plans: list[Plan]
    opens: int
    run_set: str
    grid: float
    body: Body
    interface: Interface
    supply: Supply
    q: Array
    v: Array
    a: Array
    rigid: Array
    alive: Array
    shows_temperature: bool = False
    level: str = "medium"
    focus: list[int] = field(default_factory=list)
    simulation: Simulation = field(default_factory=Simulation)
    hertz: float | None = None
    """Of the controller's loop, where that is soft."""

    @property
    def joints(self) -> int:
        """Number of joints."""
        return self.base.joints

    @property
    def t(self) -> Array:
        """(N,) times of the coarse grid, s."""
        return np.arange(len(self.q)) * self.grid

    @property
    def torque(self) -> Array:
        """(N, C, n) motor torque on the planned motion without any effect, Nm."""
        return np.asarray(self.rigid + self.base.rotor * self.a + friction(self.base, self.v))

    def target(self) -> float:
        """A ratio of effect to noise within the level."""
        return float(self.rng.uniform(*RATIO[self.level]))

    def rms(self, x: Array) -> float:
        """RMS of x (N, C) over the open runs."""
        use = self.alive[:, : self.opens]
        return float(np.sqrt(np.mean(x[:, : self.opens][use] ** 2)))

    def ratio(self, joint: int, term: Friction | Load, instead_of: float = 0.0) -> float:
        """RMS over noise of what one term adds at a joint, or puts in the place of some Coulomb friction."""
        coulomb = np.zeros(self.joints)
        coulomb[joint] = -instead_of
        alone = Joints(coulomb, np.zeros(self.joints), [term])
        add = playback(self.base, alone, self.q, self.v, self.rigid, self.t)
        return float(self.rms(add[:, :, joint]) / self.base.noise[joint])

    def size(self, joint: int, unit: Callable[[float], Friction | Load], cap: float) -> float:
        """Amplitude at which a term that is linear in it has the level's ratio, at most `cap`."""
        once = self.ratio(joint, unit(1.0))
        amplitude = min(self.target() / max(once, 1e-12), cap)
        require(amplitude * once >= RATIO["weak"][0])
        return amplitude

    def power_of(self, supply: Supply) -> Array:
        """(N, C) supply power on the planned motion, W."""
        torque = self.torque
        return np.stack([supply.power(self.t, torque[:, c], self.v[:, c]) for c in range(len(self.plans))], axis=1)

    def power_ratio(self, **change: object) -> float:
        """RMS of what a change of the supply adds to the power over the meter's noise."""
        changed = replace(self.supply, **change)  # type: ignore[arg-type]
        return self.rms(self.power_of(changed) - self.power_of(self.supply)) / self.base.power_noise


def require(visible: bool) -> None:
    """Raise NotVisibleError unless the condition holds."""
    if not visible:
        raise NotVisibleError


def coarse(plans: Sequence[Plan], grid: float) -> tuple[Array, Array, Array, Array]:
    """Motion of all plans on a common coarse grid, (N, C, n), and where each is alive, (N, C)."""
    skip = round(grid / plans[0].tick)
    longest = max(len(p.q[::skip]) for p in plans)
    fill = lambda x: np.concatenate([x, np.repeat(x[-1:], longest - len(x), axis=0)])  # noqa: E731
    q, v, a = (np.stack([fill(getattr(p, w)[::skip]) for p in plans], axis=1) for w in "qva")
    alive = np.stack([np.arange(longest) < len(p.q[::skip]) for p in plans], axis=1)
    return q, v, a, alive


def new_setting(rng: np.random.Generator, family: str, run_set: str, focus: Sequence[int]) -> Setting:
    """A case without effects: its simulation is mistuned, nothing is missing."""
    base = draw_arm(rng, family)
    runs = RUN_SETS[run_set]
    plans = [STYLES[style](rng, base, seconds, focus, runs.tick) for style, seconds in (*runs.open, *runs.sealed)]
    q, v, a, alive = coarse(plans, runs.grid)
    rate = float(rng.choice(runs.rates))
    body = Body(base, Joints.of(base))
    return Setting(
        rng,
        base,
        mistune(rng, base),
        plans,
        len(runs.open),
        run_set,
        runs.grid,
        body,
        draw_interface(rng, base.noise, base.power_noise, rate),
        Supply.of(base),
        q,
        v,
        a,
        rigid_torque(body, q, v, a, np.arange(len(q)) * runs.grid),
        alive,
        focus=list(focus),
    )
