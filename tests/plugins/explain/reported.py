"""Made-up recordings and findings for the report: what is in them is known because it was put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cellwatt_plugins.explain.fit.solution import Trial
from cellwatt_plugins.explain.input.run import Float
from cellwatt_plugins.explain.report.trace import Trace
from cellwatt_plugins.explain.verdict.findings import (
    Alternative,
    ChannelFit,
    Finding,
    Findings,
    Improvement,
    RetunedNumber,
    Span,
    Step,
    UnexplainedChannel,
    Where,
)
from cellwatt_plugins.robot.effects.effect import Parameter
from tests.plugins.explain.plant import travelled

NOISE, POWER_NOISE, RATE = 0.6, 4.0, 125.0


def motion(seed: int, count: int, joints: int) -> tuple[Float, Float, Float]:
    """Time (N,), position and velocity (N, n): each joint moves between random places, with stops between."""
    random, time = np.random.default_rng(seed), np.arange(count) / RATE
    shape = int(time[-1] / 3) + 10, joints
    go, rest, places = random.uniform(1.5, 5, shape), random.uniform(0.3, 1.5, shape), random.uniform(-1.6, 1.6, shape)
    return time, *travelled(time, np.cumsum(go + rest, axis=0) - go - rest, go, places)[:2]


def trace(
    name: str = "run_01", seed: int = 1, count: int = 7500, joints: int = 6, power: bool = True, effects: bool = True
) -> Trace:
    """Joint 2 lacks Stribeck friction, joint 3 has a bump that no model explains, the supply lacks standby power."""
    time, position, velocity = motion(seed, count, joints)
    random = np.random.default_rng(seed + 100)
    weight = np.array([4, 40, 22, 5, 4, 1, 1, 1, 1, 1.0])[:joints]
    simulation = weight * np.cos(position) * (np.arange(joints) > 0) + 5 * np.tanh(velocity / 0.004) + 6 * velocity
    model = simulation.copy()
    truth = simulation.copy()
    if effects:
        stribeck = 4.1 * np.exp(-((velocity[:, 1] / 0.13) ** 2)) * np.tanh(velocity[:, 1] / 0.004)
        truth[:, 1] += stribeck
        model[:, 1] += 0.98 * stribeck
        if joints > 2:
            truth[:, 2] += 3.0 * np.exp(-(((position[:, 2] - 0.7) / 0.12) ** 2)) * (velocity[:, 2] > 0)
    tau = truth + random.normal(0, NOISE, truth.shape)
    columns = [tau, simulation, model]
    if power:
        drive = (truth * velocity).sum(axis=1, keepdims=True)
        shift = (85.0, 0.0, 84.6) if effects else (0.0, 0.0, 0.0)
        noisy = drive + random.normal(0, POWER_NOISE, drive.shape)
        columns = [np.hstack([c, (noisy if i == 0 else drive) + 150 + shift[i]]) for i, c in enumerate(columns)]
    return Trace(
        name=name,
        time=time,
        position=position,
        velocity=velocity,
        channels=(*(f"tau_{j + 1}" for j in range(joints)), *(["power"] if power else [])),
        units=(*("N*m" for _ in range(joints)), *(["W"] if power else [])),
        measured=columns[0],
        simulation=columns[1],
        model=columns[2],
    )


def floors(of: Trace) -> dict[str, float]:
    """The noise that was put in, by channel."""
    return {c: POWER_NOISE if c == "power" else NOISE for c in of.channels}


def fit(traces: list[Trace]) -> tuple[ChannelFit, ...]:
    """Rms errors as they are."""
    noise = floors(traces[0])

    def rms(channel: str, which: str) -> float:
        return float(np.sqrt(np.mean(np.concatenate([t.residual(channel, getattr(t, which)) for t in traces]) ** 2)))

    fit = list[ChannelFit]()
    for channel, unit, floor in zip(traces[0].channels, traces[0].units, noise.values(), strict=True):
        simulation, model = rms(channel, "simulation"), rms(channel, "model")
        fit.append(ChannelFit(channel, unit, simulation, 0.75 * simulation + 0.25 * model, model, floor))
    return tuple(fit)


STRIBECK = Finding(
    effect="stribeck_friction",
    joint=2,
    kind="missing",
    confidence=0.97,
    statement="Joint 2 needs 4.1 ± 0.2 Nm more below 0.13 rad/s than the simulation's Coulomb and viscous friction "
    "give: Stribeck friction is missing.",
    parameters={"excess": Parameter(4.1234, 0.187, "N*m"), "velocity": Parameter(0.1312, 0.0123, "rad/s")},
    where=Where(
        ("tau_2",), None, (-0.3, 0.3), (Span("run_01", 3.1, 4.0), Span("run_01", 6.2, 6.9), Span("run_02", 11.0, 12.4))
    ),
    improvement=Improvement("tau_2", "N*m", 2.51, 0.63, 0.6, True),
    alternatives=(
        Alternative(
            "load_dependent_friction", 2, "same sign and speed range; run a slow sweep at two loads to tell them apart"
        ),
    ),
)
STANDBY = Finding(
    effect="standby_power",
    joint=None,
    kind="missing",
    confidence=0.9999,
    statement="The cell draws 84.6 ± 0.4 W more than the simulation at all times: standby power is missing.",
    parameters={"power": Parameter(84.612, 0.41, "W")},
    where=Where(("power",)),
    improvement=Improvement("power", "W", 25.3, 4.02, 4.0, True),
)
INERTIA = Finding(
    effect="rotor_inertia",
    joint=1,
    kind="mistuned",
    confidence=0.83,
    statement="The rotor inertia of joint 1 is 8 ± 3 % above what robot.yaml states.",
    parameters={"rotor inertia": Parameter(0.01312, 0.00041, "kg*m^2")},
    where=Where(("tau_1",)),
    improvement=Improvement("tau_1", "N*m", 0.66, 0.61, 0.6, True),
    was=0.15,
)
HEAVIER = RetunedNumber("mass", 3, 2.1, 2.34, 0.03, "kg", 0.1, True, "The mass of link 3 is 2.34 ± 0.03 kg.")
TRIED = (
    Trial("stribeck_friction", 2, 1840.2, True, "raises the evidence and helps in every block left out"),
    Trial("standby_power", None, 9211.0, True, "raises the evidence and helps in every block left out"),
    Trial("position_periodic_torque", 3, 31.4, False, "helps in 3 of 6 blocks left out only"),
    Trial(
        "load_dependent_friction", 2, 1790.1, False, "explains the same as Stribeck friction (joint 2), a little worse"
    ),
    Trial("joint_elasticity", 3, 2.3, False, "its stiffness is not distinguishable from rigid"),
    *(Trial("torque_offset", j, 1.2 - j, False, "within 3 standard deviations of zero") for j in range(1, 7)),
    *(Trial("backlash", j, -0.4 - j, False, "no gain on data left out") for j in range(1, 7)),
    *(Trial("torque_drift", j, -2.4 - j, False, "no gain on data left out") for j in range(1, 7)),
)


def arm() -> tuple[Findings, list[Trace]]:
    """Six joints, two runs: two effects found, one value off, one place unexplained."""
    traces = [trace("run_01", 1), trace("run_02", 2, 5000)]
    rest = UnexplainedChannel(
        "tau_3",
        1.02,
        0.6,
        "Joint 3 needs up to 3 Nm more between 0.5 and 0.9 rad, moving forward only.",
        None,
        (0.5, 0.9),
    )
    notes = (
        "This motion cannot show temperature effects: no joint warms by more than 2 K in 100 s.",
        "Backlash at joint 6 could not be tested: the load never changes its sign there.",
    )
    findings = Findings("partly_explained", (STRIBECK, STANDBY, INERTIA), (rest,), fit(traces), TRIED, notes)
    return replace(findings, retuned=(HEAVIER,), cascade=cascade(findings.fit)), traces


def cascade(fit: tuple[ChannelFit, ...]) -> tuple[Step, ...]:
    """The simulation, Stribeck friction that brings joint 2 to the model's error, and everything at the model's."""
    errors = {f.channel: f.simulation for f in fit}
    after = {f.channel: f.model for f in fit}
    friction = {**errors, "tau_2": after["tau_2"]}
    return (
        Step("simulation", "your simulation", "", None, 8.4, errors, False),
        Step("finding", "Stribeck friction of joint 2", "stribeck_friction", 2, 8.1, friction, True),
        Step("retuning", "your numbers retuned", "", None, 1.2, after, True),
    )


def agreement() -> tuple[Findings, list[Trace]]:
    """Six joints, one run, no difference but noise."""
    traces = [trace(effects=False)]
    return Findings("no_mismatch", (), (), fit(traces), TRIED[8:12], ("Nothing heavier was carried.",)), traces


def single() -> tuple[Findings, list[Trace]]:
    """One joint without power, whose effect is in no library."""
    one = trace("bench", 5, 4000, 1, power=False, effects=False)
    bump = 2.5 * np.exp(-(((one.position[:, :1] - 0.3) / 0.15) ** 2))
    one = Trace(**{**vars(one), "measured": one.measured + bump})
    unknown = Finding(
        "unknown",
        1,
        "missing",
        0.92,
        "Joint 1 needs up to 2.5 Nm more between 0.0 and 0.6 rad; nothing in the library has this shape.",
        {},
        Where(("tau_1",), (0.0, 0.6)),
        Improvement("tau_1", "N*m", 1.12, 1.12, 0.6, True),
        followed=False,
    )
    return Findings("unexplained", (unknown,), (), fit([one]), TRIED[8:10]), [one]
