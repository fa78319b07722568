"""Every effect by one table, and each against the plant's closed form or the definition in the contract."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from cellwatt_plugins.robot.effects import BY_NAME, EFFECTS
from cellwatt_plugins.robot.effects.effect import Estimate, Parameter
from cellwatt_plugins.robot.effects.supply.thermal import warmth
from cellwatt_plugins.robot.servo import BY_NAME_IN_MOTION
from tests.effect_names import CONTRACT
from tests.plugins.explain import plant

JOINT = 1
"""0-based: the shoulder, which gravity loads."""

TWO_MASS = ("joint_elasticity", "backlash")

ACTS_AT_REST = """
payload payload_change link_inertial_error gravity_tilt spring_load position_periodic_torque joint_elasticity
external_contact torque_gain torque_offset torque_drift torque_saturation standby_power copper_loss winding_temperature
converter_efficiency fan_switching
"""


@dataclass(frozen=True)
class Setting:
    """Two runs of an arm whose simulation lacks an effect, and what is left unexplained there."""

    runs: list
    still: object
    residual: list
    joint: int | None
    shapes: list


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    """One description with all terms, one with none of those that may be left out."""
    bare = {"coulomb_friction": 0.0, "viscous_friction": 0.0, "rotor_inertia": 0.0, "winding_resistance": 0.0}
    full = plant.load(plant.write_robot(tmp_path_factory.mktemp("full")))
    return full, plant.load(plant.write_robot(tmp_path_factory.mktemp("bare"), standby_power=0.0, **bare))


@pytest.fixture(scope="module")
def full_runs(arms):
    return [plant.states(arms[0], seed=1, index=0), plant.states(arms[0], seed=2, index=1)]


@pytest.fixture(scope="module", params=EFFECTS, ids=[e.name for e in EFFECTS])
def effect(request):
    return request.param


@pytest.fixture(scope="module")
def setting(effect, arms):
    joint = None
    if effect.place == "joint":
        # A gap shows where the load turns over: not at the shoulder, which gravity holds on one flank.
        joint = 0 if effect.name == "backlash" else JOINT
    arm = next(arm for arm in arms if effect.possible(arm.description, joint))
    runs = [plant.states(arm, seed=1, index=0), plant.states(arm, seed=2, index=1)]
    still = plant.states(arm, seed=1, still=True)
    random = np.random.default_rng(0)
    residual = []
    for run in runs:
        on = (run.time > 2.0) & (run.time < 5.0)
        if effect.place == "supply":
            residual.append(25.0 * on[:, None] + random.standard_normal((len(on), 1)))
        else:
            carried = 2.0 * run.regressor[:, :, -10] * on[:, None]
            residual.append(carried + 0.1 * random.standard_normal(run.q.shape))
        if effect.name == "torque_saturation":
            clipped = np.clip(run.torque, -0.8 * np.max(run.torque, axis=0), 0.8 * np.max(run.torque, axis=0))
            residual[-1] = clipped - run.torque
    return Setting(runs, still, residual, joint, list(effect.shapes(runs, joint, residual)))


def some(shapes):
    """First, middle and last."""
    return [shapes[i] for i in sorted({0, len(shapes) // 2, len(shapes) - 1})]


def test_the_names_are_those_of_the_contract():
    words = CONTRACT.split()
    assert {e.name: e.place != "joint" for e in EFFECTS} == {w.rstrip("*"): w.endswith("*") for w in words}
    assert all(BY_NAME[e.name] is e for e in EFFECTS)


def test_columns_are_numbers_of_the_right_shape(effect, setting):
    for run in setting.runs:
        for shape in some(setting.shapes):
            columns = effect.columns(run, setting.joint, shape)
            assert columns.shape[0] == len(run.time)
            assert np.isfinite(columns).all()
            if effect.place == "robot":
                assert columns.ndim == 3
            if columns.ndim == 3:
                assert columns.shape[1] == plant.JOINTS
            assert effect.place != "supply" or columns.ndim == 2


def test_some_shape_adds_something_to_some_run(effect, setting):
    assert any(np.any(effect.columns(run, setting.joint, s)) for s in setting.shapes for run in setting.runs)


def test_columns_of_several_shapes_are_those_of_each(effect, setting):
    shapes = some(setting.shapes)
    for columns, shape in zip(effect.grid(setting.runs[0], setting.joint, shapes), shapes, strict=True):
        alone = effect.columns(setting.runs[0], setting.joint, shape)
        if effect.name in TWO_MASS:  # at its own joint; what the others feel comes with the term
            alone = alone[:, setting.joint, :1]
        assert columns.shape == alone.shape
        assert np.sqrt(np.mean((columns - alone) ** 2)) <= 0.1 * np.sqrt(np.mean(alone**2)) + 1e-9


def test_other_joints_feel_a_swinging_link(full_runs):
    """What a joint needs more for its link's acceleration, the others need by the mass matrix."""
    run = full_runs[0]
    columns = BY_NAME["joint_elasticity"].columns(run, 1, (900.0, 2.0, 0.0))
    still, pushed = np.zeros_like(run.qd), np.zeros_like(run.qd)
    pushed[:, 1] = 1.0
    mass = plant.links(plant.NOMINAL, run.q, still, pushed) - plant.links(plant.NOMINAL, run.q, still, still)
    more = columns[:, 1, 0] / mass[:, 1]
    assert np.any(columns[:, 2, 1])
    assert np.allclose(columns[:, [0, 2], 1], mass[:, [0, 2]] * more[:, None], atol=1e-6)
    assert not columns[:, [0, 2], 0].any()
    assert not columns[:, 1, 1].any()


def test_a_link_that_hangs_behind_its_motor_turns_what_it_carries(full_runs):
    run, stiffness = full_runs[0], 3000.0
    columns = BY_NAME["joint_elasticity"].columns(run, 1, (stiffness, 2.0, 0.0))
    twist = (plant.links(plant.NOMINAL, run.q, run.qd, run.qdd)[:, 1] + columns[:, 1, 0]) / stiffness
    still, hanging = np.zeros_like(run.qd), run.q.copy()
    hanging[:, 1] -= twist
    change = plant.links(plant.NOMINAL, hanging, still, still) - plant.links(plant.NOMINAL, run.q, still, still)
    assert np.max(np.abs(change)) > 0.05
    assert np.allclose(columns[:, :, 2], change, atol=0.05 * np.max(np.abs(change)))


def test_at_rest_there_is_nothing_unless_the_effect_acts_there(effect, setting):
    sizes = [np.max(np.abs(effect.columns(setting.still, setting.joint, s))) for s in some(setting.shapes)]
    assert (max(sizes) > 1e-6) == (effect.name in ACTS_AT_REST.split())


def test_priors_are_covariances_of_all_coefficients(effect, setting):
    for shape in some(setting.shapes):
        columns = np.concatenate([effect.columns(run, setting.joint, shape) for run in setting.runs])
        size = np.full(1 if effect.place == "supply" else plant.JOINTS, 3.0)
        prior = effect.prior(setting.runs, setting.joint, columns, size)
        assert prior.mean.shape == (columns.shape[-1],)
        assert np.linalg.eigvalsh(prior.covariance)[0] > 0


def test_shapes_lie_within_their_bounds_and_are_charged(effect, setting):
    for shape in some(setting.shapes):
        bounds = effect.bounds(shape)
        assert len(bounds) in (0, len(shape))
        for value, (low, high) in zip(shape, bounds, strict=False):
            assert low <= value <= high
        assert effect.charge(setting.runs, shape) >= 0


def test_an_estimate_becomes_parameters_with_units_and_one_sentence(effect, setting):
    for shape in some(setting.shapes):
        count = effect.columns(setting.runs[0], setting.joint, shape).shape[-1]
        size = count + len(shape)
        coefficients = np.linspace(1.0, 1.5, count)
        estimate = Estimate(coefficients, np.array(shape), 0.01 * np.eye(size))
        parameters = effect.parameters(estimate, setting.runs[0].robot, setting.joint)
        assert parameters
        for name, parameter in parameters.items():
            assert name.isidentifier()
            assert np.isfinite(parameter.value)
            assert isinstance(parameter.unit, str)
            assert parameter.std >= 0
        place = "The robot" if setting.joint is None else f"Joint {setting.joint + 1}"
        sentence = effect.statement(place, parameters)
        assert sentence[0].isupper() or sentence[0].isdigit()
        assert sentence.endswith(".")
        assert "\n" not in sentence
        assert "nan" not in sentence
        assert setting.joint is None or place.lower() in sentence.lower()


def test_what_it_can_be_confused_with_is_known_and_comes_with_an_experiment(effect):
    assert effect.confusions
    for confusion in effect.confusions:
        assert confusion.effect in {*BY_NAME, "unknown"} - {effect.name}
        assert len(confusion.experiment.split()) >= 4


def added(name, run, shape, coefficients, joint=JOINT):
    effect = BY_NAME[name]
    return effect.columns(run, None if effect.place != "joint" else joint, shape) @ np.array(coefficients)


def shoulder(run):
    return run.q[:, JOINT], run.qd[:, JOINT], run.sign[:, JOINT]


FRICTION = {
    "coulomb_friction": ((), [3.0], lambda q, w, s: 3.0 * s),
    "viscous_friction": ((), [2.0], lambda q, w, s: 2.0 * w),
    "stribeck_friction": ((0.2,), [4.0], lambda q, w, s: 4.0 * np.exp(-((w / 0.2) ** 2)) * s),
    "nonlinear_viscous_friction": ((3.0,), [1.5], lambda q, w, s: 1.5 * w**3),
    "asymmetric_friction up": ((1.0,), [2.0], lambda q, w, s: np.where(w > 0, 2.0 * s, 0.0)),
    "asymmetric_friction both": ((0.0,), [2.0], lambda q, w, s: np.abs(s)),
    "spring_load": ((), [20.0, 6.0], lambda q, w, s: 20.0 * (q + 0.3)),
    "position_periodic_torque": ((9.0,), [3.0, 4.0], lambda q, w, s: 5.0 * np.sin(9 * q + np.arctan2(4, 3))),
    "position_periodic_torque twice": ((9.0, 2.0), [3, 0, 0, 1], lambda q, w, s: 3 * np.sin(9 * q) + np.cos(18 * q)),
    "torque_offset": ((), [1.2], lambda q, w, s: np.full_like(q, 1.2)),
}


@pytest.mark.parametrize("name", FRICTION)
def test_columns_are_what_the_contract_defines(full_runs, name):
    shape, coefficients, truth = FRICTION[name]
    run = full_runs[0]
    assert np.allclose(added(name.split()[0], run, shape, coefficients), truth(*shoulder(run)), atol=1e-6)


@pytest.mark.parametrize("name", ["payload", "link_inertial_error", "payload_change"])
def test_a_mass_on_the_last_link_is_what_the_closed_form_needs_more(full_runs, name):
    run = full_runs[0]
    mass, reach = 1.7, 0.3
    place = [mass, mass * reach, 0, 0, 0, 0, mass * reach**2, 0, 0, mass * reach**2]
    more = plant.links(plant.loaded(plant.NOMINAL, mass, reach), run.q, run.qd, run.qdd) - run.rigid
    shape = (0.0, 1.0, 3.0) if name == "payload_change" else ()
    if name == "payload_change":
        more = more * ((run.time >= 1.0) & (run.time <= 3.0))[:, None]
    assert np.allclose(added(name, run, shape, place, joint=2), more, atol=1e-9)


def test_a_tilted_base_turns_gravity(full_runs):
    """Against the slope of the potential energy of the two centres of mass under the turned gravity."""
    run, roll, pitch = full_runs[0], 0.015, -0.02
    (m2, m3), (c2, c3) = plant.NOMINAL.masses, plant.NOMINAL.centres

    def energy(q, gravity):
        a, b = q[:, 1], q[:, 1] + q[:, 2]
        elbow = plant.NOMINAL.length
        out = c2 * np.cos(a), elbow * np.cos(a) + c3 * np.cos(b)
        up = -c2 * np.sin(a), -elbow * np.sin(a) - c3 * np.sin(b)
        places = [np.stack([r * np.cos(q[:, 0]), r * np.sin(q[:, 0]), z], axis=1) for r, z in zip(out, up, strict=True)]
        return -(m2 * places[0] + m3 * places[1]) @ gravity

    def torque(gravity):
        steps = 1e-5 * np.eye(3)
        return np.stack([(energy(run.q + s, gravity) - energy(run.q - s, gravity)) / 2e-5 for s in steps], axis=1)

    about_x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    about_y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    level = np.array([0, 0, -plant.G])
    expected = torque((about_y @ about_x).T @ level) - torque(level)
    got = added("gravity_tilt", run, (), [roll, pitch])
    assert np.max(np.abs(got - expected)) < 0.03 * np.max(np.abs(expected))


@pytest.mark.parametrize("name", ["time_delay", "clock_drift"])
def test_late_torque_is_that_of_the_motion_before(full_runs, name):
    run = full_runs[0]
    late = 0.03 if name == "time_delay" else 0.002 * run.time
    before = plant.motors(plant.NOMINAL, *plant.moves(1, 8.0)(run.time - late))
    got = added(name, run, (0.03 if name == "time_delay" else 0.002,), [1.0])
    inner = slice(20, None)
    difference = (before - run.torque)[inner]
    assert np.sqrt(np.mean((got[inner] - difference) ** 2)) < 0.1 * np.sqrt(np.mean(difference**2))


def test_errors_of_the_measurement_see_the_torque(full_runs):
    run = full_runs[0]
    torque = plant.motors(plant.NOMINAL, run.q, run.qd, run.qdd)[:, JOINT]
    assert np.allclose(added("torque_gain", run, (), [0.1]), 0.1 * torque)
    limit = 0.7 * np.max(np.abs(torque))
    clipped = np.sign(torque) * np.minimum(np.abs(torque), limit)
    assert np.allclose(added("torque_saturation", run, (limit,), [1.0]), clipped - torque)


def test_a_drift_is_steady_or_settles(full_runs):
    run = full_runs[0]
    assert np.allclose(added("torque_drift", run, (0.0,), [3.0]), 3.0 * run.time / 60)
    assert np.allclose(added("torque_drift", run, (10.0,), [3.0]), 3.0 * (1 - np.exp(-run.time / 10)))


def test_a_push_is_in_its_run_alone(full_runs):
    shape = (1.0, 4.0, 0.2)
    assert not added("external_contact", full_runs[0], shape, [8.0]).any()
    push = added("external_contact", full_runs[1], shape, [8.0])
    assert push.max() == pytest.approx(8.0)
    assert full_runs[1].time[np.argmax(push)] == pytest.approx(4.0)


def test_supply_columns_are_what_the_plant_draws_more(full_runs):
    run = full_runs[0]
    torque = plant.motors(plant.NOMINAL, run.q, run.qd, run.qdd)
    copper = plant.heat(plant.NOMINAL, torque)
    drive = np.sum(torque * run.qd + copper, axis=1)
    assert np.allclose(added("converter_efficiency", run, (0.0,), [0.25]), 0.25 * drive)
    assert np.allclose(added("converter_efficiency", run, (1.0,), [0.25]), 0.25 * np.maximum(drive, 0))
    assert np.allclose(added("regeneration_dissipated", run, (0.0,), [1.0]), np.maximum(-drive, 0))
    assert np.allclose(added("iron_loss", run, (1.5,), [7.0, 2.0, 0.5]), np.abs(run.qd) ** 1.5 @ [7.0, 2.0, 0.5])
    assert np.allclose(added("copper_loss", run, (), plant.NOMINAL.resistance), np.sum(copper, axis=1))
    assert np.allclose(added("standby_power", run, (), [30.0]), 30.0)


def test_brakes_draw_from_before_motion_until_after_it(full_runs):
    """The first move begins at 0.6 s, very gently; then all joints rest for half a second."""
    run = full_runs[0]
    turning = np.any(np.abs(run.qd) > 1e-9, axis=1)
    end = run.time[(run.time > 0.6) & ~turning][1]
    leads = added("brake_power", run, (0.0, 0.25), [1.0])
    assert not leads[run.time < 0.33].any()
    assert leads[(run.time > 0.5) & (run.time < end - 0.2)].all()
    stays = added("brake_power", run, (0.3, 0.0), [1.0])
    assert not stays[run.time < 0.58].any()
    assert stays[(run.time > 0.8) & (run.time < end + 0.05)].all()
    assert not stays[(run.time > end + 0.32) & (run.time < end + 0.48)].any()


def test_recorded_temperature_lowers_friction_by_e_over_its_scale(arms):
    arm = arms[0]
    cold = plant.states(arm)
    warm = [20.0, 32.0]
    sizes = []
    for temperature in warm:
        run = type(cold)(cold.name, 0, cold.time, cold.moved, arm, np.full_like(cold.q, temperature))
        sizes.append(np.max(np.abs(added("temperature_dependent_friction", run, (12.0, 0.0), [1.0]))))
    assert sizes[1] / sizes[0] == pytest.approx(np.exp(-1), rel=1e-6)
    assert not added("temperature_dependent_friction", cold, (12.0, 0.0), [1.0]).any(), "its temperature is unknown"


def test_a_joint_that_turns_round_has_no_ripple_of_one_or_two_cycles_a_turn(arms):
    """That is gravity, or a spring; a description without a gear's ratio must not ask for it."""
    run = plant.states(arms[0])
    joints = tuple(joint.model_copy(update={"gear_ratio": 1.0}) for joint in run.robot.joints)
    wide = replace(run.moved, position=40 * run.q)
    arm = replace(run.arm, description=run.robot.model_copy(update={"joints": joints}))
    shapes = BY_NAME["position_periodic_torque"].shapes([replace(run, arm=arm, moved=wide)], JOINT, [])
    assert min(shapes) == (3.0,)


def test_a_link_without_a_load_shows_no_play(full_runs):
    bare = replace(full_runs[0])
    bare.__dict__["rigid"] = np.zeros_like(bare.q)
    for effect in (BY_NAME["backlash"], BY_NAME_IN_MOTION["backlash"]):
        assert effect.shapes([bare], JOINT, []) == []


@pytest.mark.parametrize("time_constant", [0.5, 300.0])
def test_warmth_answers_a_step_as_a_first_order_lag(time_constant):
    step = 0.02
    time = np.arange(3000) * step
    rise = warmth(np.full((3000, 2), [5.0, 1.0]), step, time_constant)
    expected = 1 - np.exp(-time / time_constant)
    assert np.allclose(rise, np.outer(expected, [5.0, 1.0]), atol=1e-9)


@pytest.mark.parametrize(
    ("parameter", "text"),
    [
        (Parameter(4.123, 0.21, "N*m"), "4.1 ± 0.2 Nm"),
        (Parameter(1234.5, 30.0, "W"), "1234 ± 30 W"),
        (Parameter(0.5, 0.0, ""), "0.5"),
    ],
)
def test_values_are_said_with_the_digits_that_are_known(parameter, text):
    assert f"{parameter}" == text
