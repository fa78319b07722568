import numpy as np
import pytest

from cellwatt_plugins.explain.simulators.inertia import at_centre, moved, nearest, physical


def points(seed=1, count=40):
    """Point masses kg and their places (K, 3) m."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0.1, 0.3, count), rng.normal(0, 0.1, (count, 3)) + np.array([0.1, -0.2, 0.05])


def summed(masses, places):
    """Ten parameters of point masses, by their definition."""
    out = np.zeros(10)
    for m, (x, y, z) in zip(masses, places, strict=True):
        squares = [y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y]
        out += m * np.array([1, x, y, z, *squares])
    return out


def test_parameters_of_point_masses_in_another_frame():
    masses, places = points()
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = turn * np.linalg.det(turn), [0.3, 0.1, -0.7]
    there = places @ frame[:3, :3].T + frame[:3, 3]
    np.testing.assert_allclose(moved(summed(masses, places), frame), summed(masses, there), atol=1e-12)


def test_about_the_centre():
    masses, places = points()
    mass, centre, inertia = at_centre(summed(masses, places))
    np.testing.assert_allclose(centre, masses @ places / mass, atol=1e-12)
    own = summed(masses, places - centre)
    np.testing.assert_allclose(inertia, own[[4, 6, 9, 5, 7, 8]], atol=1e-12)


@pytest.mark.parametrize(
    ("changed", "real"),
    [
        ({}, True),
        ({0: -0.5}, False),
        ({9: 5.0}, False),  # more about z than about x and y together
        ({4: 0.0}, False),
    ],
)
def test_bodies_that_can_exist(changed, real):
    row = summed(*points())
    for place, value in changed.items():
        row[place] = value
    assert physical(row) == real


def test_the_nearest_body_gives_way_where_no_torque_tells():
    """Only the inertia about z is felt: a body that cannot exist changes elsewhere and keeps it."""
    wanted = summed(*points())
    wanted[0], wanted[4] = 0.01, -0.2
    felt = np.zeros((10, 10))
    felt[9, 9] = 1e6
    found = nearest(wanted[None], felt)[0]
    assert physical(found)
    assert found[9] == pytest.approx(wanted[9], rel=1e-3)
