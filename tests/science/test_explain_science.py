"""The explainer's equations against their sources, and its stated uncertainties against how far it is really off."""

from dataclasses import replace
from functools import partial
from statistics import NormalDist

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cellwatt_plugins.explain.fit.coordinate_search import climb
from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.fit.sides import torque_problem
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.verdict.estimates import estimates
from cellwatt_plugins.robot.drive import nominal_power
from cellwatt_plugins.robot.effects import BY_NAME
from cellwatt_plugins.robot.effects.friction.presliding_hysteresis import dahl_state
from tests.plugins.explain import plant


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return plant.load(plant.write_robot(tmp_path_factory.mktemp("plant")))


def test_the_law_is_the_one_that_is_stated(arm):
    """torque = links + rotor · qdd + Fc tanh(qd / 0.004) + Fv qd; power = standby + Σ (torque qd + R i²)."""
    q, qd, qdd = np.random.default_rng(0).uniform(-1.5, 1.5, (3, 40, 3))
    qd[:5] *= 1e-3
    torque = plant.links(plant.NOMINAL, q, qd, qdd)
    torque = torque + plant.NOMINAL.rotor * qdd + plant.NOMINAL.coulomb * np.tanh(qd / 0.004)
    torque = torque + plant.NOMINAL.viscous * qd
    assert np.allclose(arm.torque(q, qd, qdd), torque, atol=1e-10)
    current = torque / plant.NOMINAL.constant
    power = plant.NOMINAL.standby + np.sum(torque * qd + plant.NOMINAL.resistance * current**2, axis=1)
    assert np.allclose(nominal_power(arm.description, torque, qd), power)


def test_dahls_friction_follows_his_differential_equation():
    """dF/dx = σ (1 - F/Fc sign(v)), with exponent 1: Dahl, Solid Friction Damping of Mechanical Vibrations (1976)."""
    way, w = 0.004, 2 * np.pi * 0.5
    time = np.linspace(0, 5, 20001)

    def slope(t, z):
        speed = 0.02 * w * np.cos(w * t)
        return speed / way * (1 - z * np.sign(speed))

    solved = solve_ivp(slope, (0, 5), [0.0], t_eval=time, rtol=1e-8, atol=1e-10, max_step=1e-3)
    assert np.max(np.abs(dahl_state(0.02 * np.sin(w * time), way) - solved.y[0])) < 2e-3


def test_windings_grow_by_copper_s_coefficient(arm):
    """0.393 % more resistance a kelvin above 20 °C."""
    states = plant.states(arm, seconds=3.0)
    warm = replace(states, temperature=np.full_like(states.q, 70.0))
    more = BY_NAME["winding_temperature"].columns(warm, None, (0.0,))[:, 0]
    assert np.allclose(more, 50 * 0.00393 * np.sum(plant.heat(plant.NOMINAL, states.torque), axis=1))


COVERED = 40
"""Recordings drawn."""
MOTIONS = 4


def drawn(states, seed, rho):
    """A joint with Stribeck friction, nominal numbers off by their tolerances, and noise that remembers by ``rho``."""
    random = np.random.default_rng(seed)

    def near(values, tolerance):
        return tuple(np.array(values) * (1 + tolerance * random.standard_normal(3)))

    real = replace(
        plant.NOMINAL,
        coulomb=near(plant.NOMINAL.coulomb, 0.1),
        viscous=near(plant.NOMINAL.viscous, 0.1),
        rotor=near(plant.NOMINAL.rotor, 0.05),
    )
    excess, speed = random.uniform(2, 5), random.uniform(0.1, 0.3)
    sticky = excess * np.exp(-((states.qd[:, 1] / speed) ** 2)) * plant.turned(states.qd[:, 1])
    from scipy.signal import lfilter

    noise = lfilter([np.sqrt(1 - rho**2)], [1, -rho], random.standard_normal(states.q.shape), axis=0)
    torque = plant.motors(real, states.q, states.qd, states.qdd) + plant.column(sticky, 2) + plant.TORQUE_NOISE * noise
    return Run("run_01", states.time, states.q, states.qd, torque), excess, speed


def estimated(run, states, speed):
    """Stribeck friction at joint 2 with its deviations, refined from a speed nearby."""
    problem = torque_problem([run], [states])
    term = Term(BY_NAME["stribeck_friction"], 1, (1.1 * speed,))
    factor = None

    def evidence(alone, shape):
        return alone.gain(problem.block(Term(term.effect, 1, shape)))[0]

    for _ in range(2):
        fit = problem.fit([problem.block(term)], factor)
        factor = problem.factor(fit.residual) * np.maximum(problem.chi2(fit.residual), 1.0)
        shape = climb(partial(evidence, problem.fit([], factor)), term.shape, [(0.03, 0.9)])
        term = replace(term, shape=shape)
    solution = Solution(problem, [term], problem.fit([problem.block(term)], factor), factor)
    return term.effect.parameters(estimates(solution)[term.place], states.robot, 1)


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_stated_intervals_hold_the_truth_about_as_often_as_they_say(arm, rho):
    """95 % intervals over recordings drawn anew, with white and with correlated noise."""
    motions = [plant.states(arm, seed=seed, seconds=12.0) for seed in range(MOTIONS)]
    off = {"excess": [], "velocity": []}
    for seed in range(COVERED):
        states = motions[seed % MOTIONS]
        run, excess, speed = drawn(states, seed, rho)
        parameters = estimated(run, states, speed)
        for name, true in (("excess", excess), ("velocity", speed)):
            off[name].append((parameters[name].value - true) / parameters[name].std)
    for name, scores in off.items():
        held = np.mean(np.abs(scores) < NormalDist().inv_cdf(0.975))
        # Of 40, 34 or fewer would come from true 95 % intervals once in fifty times.
        assert held > 0.85, (name, held, np.std(scores))
        # Intervals that are far too wide hold everything and say nothing.
        assert np.std(scores) > 0.4, (name, np.std(scores))
