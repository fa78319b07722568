"""What tolerances of robot.yaml mean for links."""

import numpy as np
import pytest

from cellwatt_plugins.robot.priors import body_prior, link_prior, links_prior

ROD = np.array([4.0, 0.8, 0.0, 0.0, 0.01, 0.0, 0.3, 0.0, 0.0, 0.3])
"""kg, kg m, kg m²: 4 kg with the centre 0.2 m along x."""


def test_a_tolerance_is_one_standard_deviation_of_the_whole_link():
    prior = link_prior(ROD, 0.05)
    scaled = 0.05 * ROD
    assert scaled @ prior.precision @ scaled == pytest.approx(1.0, rel=0.1)
    assert prior.deviations[0] == pytest.approx(0.05 * 4.0, rel=0.03)
    assert prior.mean == pytest.approx(0.0)


def test_links_are_independent():
    prior = links_prior(np.concatenate([ROD, 2 * ROD]), 0.03)
    assert prior.covariance[:10, :10] == pytest.approx(link_prior(ROD, 0.03).covariance)
    assert prior.covariance[10:, 10:] == pytest.approx(link_prior(2 * ROD, 0.03).covariance)
    assert prior.covariance[:10, 10:] == pytest.approx(0.0)


def test_a_carried_body_has_its_centre_within_reach():
    prior = body_prior(2.0, 0.1)
    assert prior.deviations[:4] == pytest.approx([2.0, 0.2, 0.2, 0.2])
    assert prior.deviations[4:] == pytest.approx(2.0 * 0.4 * 0.01)
