"""Baseline of the recordings: the user's simulation as a law, and its torque and power beyond that law.

A simulation holds the planned motion, and the arm's motion differs from it. To transfer the simulated torque, the
numbers of the description (links, friction, rotors, windings, standby) are identified from the simulation, which has no
noise; the remainder that the law does not reproduce is added as a function of time. Without a simulation, robot.yaml is
the law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from cellwatt.arrays import Float
from cellwatt_plugins.explain.input.factors import MOVES
from cellwatt_plugins.explain.input.moved import moved, servo_lag
from cellwatt_plugins.explain.input.run import Run, Simulated
from cellwatt_plugins.robot import Arm, Body, RobotDescription
from cellwatt_plugins.robot.blocks import Block, Design, Regression
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.drive import nominal_power
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import SIGN_WIDTH, Moved, Plan, direction
from cellwatt_plugins.robot.mount import mount
from cellwatt_plugins.robot.priors import body_prior, link_prior
from cellwatt_plugins.robot.regression import Prior
from cellwatt_plugins.robot.samples import interpolated
from cellwatt_plugins.robot.servo.law import earlier

ROWS = 4000
"""Approximate number of samples, of all simulations together, from which the law is identified."""
SAME = 0.003
"""Residual of a channel, as a share of its rms, up to which the law reproduces the simulation."""
LINKS = 0.25
"""Share to which other links, or converter losses, must reduce the mean square residual to be accepted."""
OFF = 0.1
"""Share by which each link may differ from the URDF; the last one may also carry a tool."""
TOOL = (0.3, 0.2)
"""Mass of a tool as a share of the arm's mass, and distance, m, of its centre from the last joint's frame."""
FINE = 1e-3
"""Accuracy to which a law is fitted to a torque or a power, as a share of its rms."""
NO_WORSE = 1.1
"""Factor on the rms residual up to which a number has the description's value, or is 0."""
LOSSIEST = 0.4
"""Lowest efficiency of a converter."""
SLOW = 0.03
"""rad/s below which simulators differ in how friction reverses."""
LEADS = tuple((0.0005 * np.arange(61)).tolist())
"""Leads, s, by which friction may reverse before the velocity."""
SOONER = 0.7
"""Share to which a lead must reduce the mean square residual to be accepted."""
FRICTION = ("coulomb_friction", "viscous_friction", "rotor_inertia")


@dataclass(frozen=True)
class Baseline:
    """The arm with the numbers of the simulation."""

    arm: Arm
    recorded: Arm
    """The same arm as it was recorded: its mount, its motors' coupling and its friction lead may differ."""

    @property
    def mounted(self) -> Float | None:
        """Gravity (3,) m/s² of the real mount minus the simulation's, in the base's frame; None if equal."""
        change = self.recorded.body.gravity_field - self.arm.body.gravity_field
        return change if change.any() else None

    def states(self, run: Run, motion: Moved | None) -> States:
        """States of the simulated arm along a run that is only predicted; None: its ``motion`` is not known yet."""
        return self.along(run, -1, moved(run) if motion is None else motion, *self.beyond(run))

    def along(self, run: Run, index: int, motion: Moved, torque: Float | None, power: Float | None) -> States:
        """States along a run with a known motion, and the known ``torque`` and ``power`` beyond the law.

        ``index`` is the number of the run among those explained.
        """
        return States(
            run.name,
            index,
            run.time,
            motion,
            self.recorded,
            run.temperature,
            torque,
            power,
            exact_times=run.exact_times,
            drive=run.drive,
        )

    def beyond(self, run: Run) -> tuple[Float | None, Float | None]:
        """Torque (N, n) Nm and power (N,) W of a run's simulation beyond the law; None if the simulation has none."""
        simulated = run.simulated
        if simulated is None:
            return None, None
        torque = simulated.torque - self.arm.torque(*simulated.plan.courses)
        onto = interpolated(run.time, simulated.time, torque)
        power = None
        if simulated.power is not None:
            law = nominal_power(self.arm.description, simulated.torque, simulated.plan.velocity)
            power = np.interp(run.time, simulated.time, simulated.power - law)
        return earlier(onto, servo_lag(run), run.step), power


def baseline(runs: Sequence[Run], arm: Arm) -> Baseline:
    """The law that the simulations of the runs follow; the description's if no run has a simulation."""
    simulations = [run.simulated for run in runs if run.simulated is not None]
    if not simulations:
        return Baseline(arm, arm)
    simulated = _thinned(simulations)
    found = _mechanics(simulated, arm)
    found = replace(found, description=_supply(simulated, found.description))
    return Baseline(found, found)


def _thinned(simulations: Sequence[Simulated]) -> Simulated:
    """Thinned samples of all simulations; with power if all have it."""
    thin = max(1, sum(len(each.time) for each in simulations) // ROWS)
    powers = [each.power for each in simulations if each.power is not None]

    def together(parts: Sequence[Float]) -> Float:
        return np.concatenate([part[::thin] for part in parts])

    plan = Plan(*map(together, zip(*(each.plan.courses for each in simulations), strict=True)))
    power = together(powers) if len(powers) == len(simulations) else None
    return Simulated(together([s.time for s in simulations]), plan, together([s.torque for s in simulations]), power)


def _mechanics(simulated: Simulated, arm: Arm) -> Arm:
    if lead := _lead(simulated, arm.body):
        arm = arm.with_friction_lead(lead)
    if _residual(simulated, arm).max() < SAME:
        return arm
    plan = simulated.plan
    beside = simulated.torque - arm.torque(*plan.courses)
    if (found := mount(arm.body, *plan.courses, beside)) is not None:
        arm = arm.with_gravity(found.field)
    rubbing = _with_friction(simulated, arm)
    if _residual(simulated, rubbing).max() < SAME:
        return rubbing
    other = _other_links(simulated, arm)
    believed = np.sum(np.square(_residual(simulated, other))) < LINKS * np.sum(np.square(_residual(simulated, rubbing)))
    return other if believed else rubbing


def _residual(simulated: Simulated, arm: Arm) -> Float:
    """Rms (n,) of a law's torque residual, as a share of the rms torque."""
    residual = np.where(_clear(simulated.plan, arm), simulated.torque - arm.torque(*simulated.plan.courses), 0.0)
    return np.asarray(np.sqrt(np.mean(residual**2, axis=0)) / np.maximum(_size(simulated), 1e-9))


def _size(simulated: Simulated) -> Float:
    size = np.sqrt(np.mean(simulated.torque**2, axis=0))
    return np.asarray(np.maximum(size, 0.01 * size.max()))


def _clear(plan: Plan, arm: Arm) -> NDArray[np.bool_]:
    """Samples (N, n) at which friction's sign is the same in every simulator: at rest, or clearly moving."""
    speed = np.abs(plan.velocity + arm.description.friction_lead * plan.acceleration)
    return np.asarray((speed < 0.01 * SIGN_WIDTH) | (speed > SLOW))


def _courses(plan: Plan, joint: int, lead: float) -> Float:
    """Torque (N, 3) at a joint per unit of Coulomb friction, viscous friction and rotor inertia."""
    speed, gain = plan.velocity[:, joint], plan.acceleration[:, joint]
    return np.column_stack([direction(speed + lead * gain), speed, gain])


def _lead(simulated: Simulated, body: Body) -> float:
    """s by which friction of the simulation reverses before the velocity; 0 if a lead explains little."""
    plan = simulated.plan
    rest = simulated.torque - body.inverse_dynamics(*plan.courses)
    size = _size(simulated)

    def residual(lead: float) -> float:
        """Mean square residual, joints summed, after fitting each joint's own friction and rotor."""
        out = 0.0
        for joint in range(body.joints):
            courses = _courses(plan, joint, lead)
            apart = rest[:, joint] - courses @ np.linalg.lstsq(courses, rest[:, joint], rcond=None)[0]
            out += float(np.mean(np.square(apart / size[joint])))
        return out

    found = {lead: residual(lead) for lead in LEADS}
    best = min(found, key=lambda lead: found[lead])
    return best if found[best] < SOONER * found[0.0] else 0.0


def _with_friction(simulated: Simulated, arm: Arm) -> Arm:
    """The arm with friction and rotors identified for its links; joints that do not move stay unchanged."""
    plan = simulated.plan
    rest = simulated.torque - arm.body.inverse_dynamics(*plan.courses)
    travelled = np.ptp(plan.position, axis=0) > MOVES * arm.body.levers
    clear, numbers = _clear(plan, arm), _friction(arm)
    for i, own in enumerate(numbers):
        courses = _courses(plan, i, arm.description.friction_lead)[clear[:, i]]
        moved = np.sqrt(np.mean(courses**2, axis=0)) if len(courses) else np.zeros(len(FRICTION))
        if travelled[i] and np.all(moved > 0):
            found = nnls(courses / moved, rest[clear[:, i], i])[0] / moved
            small = FINE * float(np.sqrt(np.mean(simulated.torque[:, i] ** 2)))
            found = np.where(found * moved < small, 0.0, found)
            numbers[i] = np.where(np.abs(found - own) * moved < small, own, found)
    return _rubbing(arm, numbers)


def _friction(arm: Arm) -> Float:
    """Coulomb and viscous friction and rotor inertia of each joint, (n, 3)."""
    return np.stack([arm.column(name) for name in FRICTION], axis=1)


def _rubbing(arm: Arm, numbers: Float) -> Arm:
    """The arm with friction and rotors ``numbers`` (n, 3); see ``_friction``."""
    pairs = zip(arm.description.joints, numbers.tolist(), strict=True)
    joints = tuple(joint.model_copy(update=dict(zip(FRICTION, own, strict=True))) for joint, own in pairs)
    return replace(arm, description=arm.description.model_copy(update={"joints": joints}))


def _other_links(simulated: Simulated, arm: Arm) -> Arm:
    """Identify links, friction and rotors together; a number is the description's, or 0, if that fits as well."""
    own = _friction(arm).ravel()
    fit = _LinkFit(simulated, arm, own)
    rests = np.ptp(simulated.plan.position, axis=0) <= MOVES * arm.body.levers
    resting = np.repeat(rests, len(FRICTION))
    fixed = {int(i): float(own[i]) for i in np.flatnonzero(resting)}
    best = fit.residual(fixed)
    for i in np.flatnonzero(~resting).tolist():
        for value in dict.fromkeys((float(own[i]), 0.0)):
            residual = fit.residual({**fixed, i: value})
            if residual < NO_WORSE * best:
                fixed[i], best = value, max(best, residual)
                break
    links, friction = fit.solved(fixed)
    described = _rubbing(arm, np.maximum(friction, 0.0).reshape(-1, len(FRICTION))).description
    return Arm(described, arm.body.with_parameters(arm.body.parameters() + links))


class _LinkFit:
    """Least squares of links, friction and rotors on a simulated torque."""

    def __init__(self, simulated: Simulated, arm: Arm, own: Float) -> None:
        self._own, body, plan = own, arm.body, simulated.plan
        self._target = simulated.torque - body.inverse_dynamics(*plan.courses)
        self._variance = np.where(_clear(plan, arm), np.square(FINE * _size(simulated)), 1e12)
        regressor = body.regressor(*plan.courses)
        links = body.parameters().reshape(-1, PER_LINK)
        priors = [link_prior(each, OFF) for each in links]
        tool = body_prior(TOOL[0] * float(np.sum(links[:, 0])), TOOL[1])
        priors[-1] = Prior(priors[-1].mean, priors[-1].covariance + tool.covariance)
        self._links = [
            Block(regressor[:, :, PER_LINK * i : PER_LINK * (i + 1)], None, prior) for i, prior in enumerate(priors)
        ]
        lead = arm.description.friction_lead
        courses = [(j, _courses(plan, j, lead)) for j in range(body.joints)]
        self._courses = [(j, each[:, k : k + 1]) for j, each in courses for k in range(len(FRICTION))]
        self._wide = [_size(simulated)[j] / max(float(np.sqrt(np.mean(c**2))), 1e-6) for j, c in self._courses]

    def residual(self, fixed: dict[int, float]) -> float:
        """Rms of the residual with some friction numbers fixed, in units of the standard deviation."""
        fit = self._fit(fixed)
        return float(np.sqrt(np.mean(np.square(fit.residual) / self._variance)))

    def solved(self, fixed: dict[int, float]) -> tuple[Float, Float]:
        """Corrections of the links (10 n,), and friction (3 n,)."""
        coefficients = self._fit(fixed).coefficients
        links = PER_LINK * len(self._links)
        friction = coefficients[links:].copy()
        for i, value in fixed.items():
            friction[i] = value
        return coefficients[:links], friction

    def _fit(self, fixed: dict[int, float]) -> Regression:
        friction = [Block(course, joint, self._prior(i, fixed)) for i, (joint, course) in enumerate(self._courses)]
        design = Design(self._target, self._variance, [*self._links, *friction])
        return Regression(design, [], np.ones(self._target.shape[1]))

    def _prior(self, i: int, fixed: dict[int, float]) -> Prior:
        if i in fixed:
            return Prior(np.array([fixed[i]]), np.array([[(1e-6 * self._wide[i]) ** 2]]))
        return Prior(self._own[i : i + 1], np.array([[self._wide[i] ** 2]]))


def _supply(simulated: Simulated, robot: RobotDescription) -> RobotDescription:
    """The description with standby power, windings and converter losses identified from the simulation."""
    if simulated.power is None:
        return robot
    residual = simulated.power - nominal_power(robot, simulated.torque, simulated.plan.velocity)
    if np.sqrt(np.mean(residual**2)) < SAME * np.sqrt(np.mean(simulated.power**2)):
        return robot
    drives = np.sum(simulated.torque * simulated.plan.velocity, axis=1)
    plain = _drawn(np.column_stack([np.ones_like(drives), np.square(simulated.torque)]), simulated.power - drives)
    ways = np.column_stack([np.ones_like(drives), np.maximum(drives, 0.0), np.minimum(drives, 0.0)])
    lossy = _drawn(np.column_stack([ways, np.square(simulated.torque)]), simulated.power)
    if lossy[1] > LINKS * plain[1] or not 1 <= lossy[0][1] < 1 / LOSSIEST:
        (standby, *gains), gain, back = plain[0].tolist(), 1.0, 1.0
    else:
        standby, gain, back, *gains = lossy[0].tolist()
    joints = []
    for joint, heat in zip(robot.joints, gains, strict=True):
        # Only R / K² matters for the heat: an unknown K is taken as 1 Nm/A.
        constant = joint.torque_constant or 1.0
        ohms = heat / gain * constant**2
        joints.append(joint.model_copy(update={"torque_constant": constant, "winding_resistance": ohms}))
    supply = {"standby_power": standby, "converter_efficiency": 1 / gain, "regeneration": min(back, 1.0)}
    return robot.model_copy(update={**supply, "joints": tuple(joints)})


def _drawn(columns: Float, power: Float) -> tuple[Float, float]:
    """Nonnegative coefficients, small ones 0, of columns (N, m) fitted to ``power`` (N,) W; mean square residual."""
    scale = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-12)
    found = nnls(columns / scale, power)[0]
    found = np.where(found < FINE * float(np.sqrt(np.mean(power**2))), 0.0, found) / scale
    return found, float(np.mean(np.square(power - columns @ found)))
