"""The simulated springs against solve_ivp on the same equation of motion, which shares no code with them."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cellwatt_plugins.robot.effects.compliance.two_mass import elastic, with_gap

STEP = 0.004
INERTIA = 2.5
"""kg m²"""


class Arm:
    """A joint whose link needs a given torque; what the effects read of a run."""

    step = STEP

    def __init__(self, need, inertia=INERTIA, speed=0.0):
        self.need = need
        time = np.arange(1500) * STEP
        self.rigid = self.load = need(time)[:, None]
        self.own_inertia = np.full((len(time), 1), inertia)
        self.qd = np.full((len(time), 1), speed)
        self.time = time


def load(time):
    """Nm: gravity that turns over and a faster part."""
    return 20 * np.sin(2 * np.pi * 0.4 * time + 0.3) + 6 * np.sin(2 * np.pi * 2.1 * time)


def integrated(arm, spring, damper, twist, speed):
    """Torque through the gear (N,) Nm from M δ'' + s(δ, δ') = u."""

    def through(delta, rate):
        return spring(delta) + damper(delta) * rate

    def slope(time, state):
        return [state[1], (arm.need(time) - through(*state)) / INERTIA]

    solved = solve_ivp(slope, (0, arm.time[-1]), [twist, speed], t_eval=arm.time, rtol=1e-8, atol=1e-11, max_step=STEP)
    return through(*solved.y)


def share(got, expected):
    """rms difference over the rms of what is expected."""
    return np.sqrt(np.mean((got - expected) ** 2) / np.mean(expected**2))


def assert_same(got, expected):
    """To 2 %, or to 0.2 % of the load: it is held over a sample."""
    assert np.sqrt(np.mean((got - expected) ** 2)) < 0.02 * np.sqrt(np.mean(expected**2)) + 0.03


@pytest.mark.parametrize("frequency", [1.5, 6.0, 20.0])
@pytest.mark.parametrize("damping", [0.01, 0.1, 0.7])
def test_a_spring_rings_as_the_equation_says(frequency, damping):
    arm = Arm(load)
    w = 2 * np.pi * frequency
    stiffness, damper = INERTIA * w**2, 2 * damping * INERTIA * w
    got = elastic(arm, 0, np.array([stiffness]), np.array([damper]), np.array([0.0]))[:, 0]
    expected = integrated(arm, lambda d: stiffness * d, lambda d: damper, load(0.0) / stiffness, 0.0) - arm.rigid[:, 0]
    assert_same(got, expected)


def test_a_link_that_stood_still_while_the_motor_moved_is_pulled_along():
    arm = Arm(load, speed=0.3)
    w = 2 * np.pi * 5.0
    stiffness, damper = INERTIA * w**2, 0.1 * INERTIA * w
    along, still = elastic(arm, 0, np.full(2, stiffness), np.full(2, damper), np.array([0.0, 1.0])).T
    expected = integrated(arm, lambda d: stiffness * d, lambda d: damper, load(0.0) / stiffness, 0.3) - arm.rigid[:, 0]
    assert_same(still, expected)
    assert share(along, expected) > 0.5


OTHERWISE = [pytest.param(*pair, marks=pytest.mark.slow) for pair in ((0.004, 0.2), (0.02, 0.07))]


@pytest.mark.parametrize(("gap", "damping"), [(0.004, 0.07), (0.02, 0.2), *OTHERWISE])
@pytest.mark.parametrize("frequency", [0.12, 0.4, 0.55])
def test_a_gap_is_crossed_as_the_equation_says(gap, damping, frequency):
    """However soon the load turns over again: every 4, 1.2 or 0.9 s."""

    def need(time):
        return 20 * np.sin(2 * np.pi * frequency * time + 0.3)

    arm = Arm(need)
    w = 2 * np.pi * 12.0
    stiffness, damper = INERTIA * w**2, 2 * damping * INERTIA * w

    def pressed(delta):
        return delta - np.clip(delta, -gap / 2, gap / 2)

    start = need(0.0) / stiffness + gap / 2
    got = with_gap(arm, 0, np.array([stiffness]), np.array([gap]), np.array([damper]))[:, 0]
    expected = integrated(arm, lambda d: stiffness * pressed(d), lambda d: damper * (pressed(d) != 0), start, 0.0)
    expected = expected - arm.rigid[:, 0]
    assert np.max(np.abs(expected)) > 3
    assert share(got, expected) < 0.2
