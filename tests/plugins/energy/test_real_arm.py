"""The split on five short moves of a real UR3e (Hein Lab, MIT): power of its 48 V bus, torque from its currents."""

import numpy as np
import pytest

from cellwatt_plugins.energy.electronics import at_campaign
from cellwatt_plugins.energy.known import Known
from cellwatt_plugins.energy.task_energy import Stretch, task_energy
from tests.science.test_energy_split import fit, needs_ur3e, recorded_ur3e

pytestmark = needs_ur3e


@pytest.fixture(scope="module")
def arm_and_moves(tmp_path_factory):
    return recorded_ur3e(tmp_path_factory.mktemp("ur3e"))


def known_from(identified):
    """What a campaign of these moves would tell the live side; power at rest was not recorded."""
    missed = [one.residual(identified.drive).sum() / one.power.sum() for one in identified.observed]
    fixed_twice = [0, *range(len(identified.covariance))]  # no brakes: electronics and fixed power are one
    return Known(
        robot="ur3e",
        drive=identified.drive,
        electronics=identified.drive.fixed,
        brakes=0.0,
        brakes_uncertainty=0.0,
        model_error=float(np.sqrt(np.mean(np.square(missed)))),
        viscous=(0.0,) * 6,
        late=0.0,
        covariance=identified.covariance[np.ix_(fixed_twice, fixed_twice)],
    )


def stretch_of(one):
    """The move on one grid, its power where the clocks say it was."""
    motion, reading = one.run.motion, one.run.reading
    power = np.interp(motion.time, reading.time - one.offset.seconds, reading.power)
    return Stretch(motion.step, motion.position, motion.velocity, motion.torque, power)


def test_groups_add_up_to_what_was_measured_within_the_stated_uncertainty(arm_and_moves):
    arm, moves = arm_and_moves
    whole = fit(arm, moves)
    known = known_from(whole)
    for one in whole.observed:
        energy = task_energy(arm, known, stretch_of(one), at_campaign(known))
        assert sum(energy.groups.values()) == pytest.approx(energy.total, rel=1e-9)
        assert abs(energy.groups["unexplained"]) < 2 * energy.uncertainty < 0.05 * energy.total
        assert abs(energy.groups["unexplained"]) < 0.02 * energy.total
        assert energy.groups["mechanical_losses"] > 0
        assert energy.groups["electrical_losses"] > 0


def test_a_move_left_out_is_met_within_the_uncertainty_of_the_fit(arm_and_moves):
    arm, moves = arm_and_moves
    for i, one in enumerate(fit(arm, moves).observed):
        others = known_from(fit(arm, moves[:i] + moves[i + 1 :]))
        energy = task_energy(arm, others, stretch_of(one), at_campaign(others))
        assert abs(energy.groups["unexplained"]) < 2 * energy.uncertainty < 0.15 * energy.total
        assert abs(energy.groups["unexplained"]) < 0.1 * energy.total
