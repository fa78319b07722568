from itertools import islice

import numpy as np
import pytest

from cellwatt_plugins.faults.paper.rational import Rational, iterations, starting_poles

TRUE = Rational(
    np.array([-0.2 + 3j, -0.2 - 3j, -0.5 + 7j, -0.5 - 7j, -4.0 + 0j, -9.0 + 0j]),
    np.array([1 + 2j, 1 - 2j, -3 + 0.5j, -3 - 0.5j, 5.0 + 0j, -2.0 + 0j]),
    1.5,
)
S = 1j * np.linspace(0.01, 10, 400)


def fitted(s, f, order, count=12):
    poles = starting_poles(float(s[-1].imag), order)
    return next(islice(iterations(s, f, poles), count - 1, None))


def test_poles_residues_and_constant_of_a_rational_function_are_found():
    found = fitted(S, TRUE.at(S), 6)
    for name in ("poles", "residues"):
        there, wanted = (np.sort_complex(getattr(each, name)) for each in (found, TRUE))
        assert there == pytest.approx(wanted, rel=1e-6)
    assert found.constant == pytest.approx(1.5, rel=1e-6)


def test_all_poles_are_stable_and_come_in_pairs():
    random = np.random.default_rng(5)
    found = fitted(S, random.standard_normal(400) + 0j, 10)
    assert np.all(found.poles.real < 0)
    assert np.sort_complex(found.poles) == pytest.approx(np.sort_complex(found.poles.conj()))
    assert len(found.poles) == 10


@pytest.mark.filterwarnings("ignore:The fitted network is passive:UserWarning")
@pytest.mark.parametrize("order", [4, 6, 10])
def test_on_a_common_problem_it_is_what_scikit_rf_finds(order):
    """One resonance more than the order has pole pairs, so that both tools have to compromise."""
    skrf = pytest.importorskip("skrf", reason="scikit-rf, the tool to compare with, is not installed")
    tool = pytest.importorskip("skrf.vectorFitting", reason="scikit-rf without vector fitting")
    w = 2 * np.pi * np.linspace(1e6, 1e9, 401)
    random = np.random.default_rng(8)
    centres, losses = 2 * np.pi * np.linspace(1e8, 9e8, order // 2 + 1), 2 * np.pi * 2e7
    gains = 2 * np.pi * random.uniform(1e6, 2e7, len(centres))
    near = 1j * w[:, None] + losses
    f = (gains / (near - 1j * centres) + gains / (near + 1j * centres)).sum(axis=1)
    network = skrf.Network(frequency=skrf.Frequency.from_f(w / 2 / np.pi, unit="hz"), s=f[:, None, None])
    theirs = tool.VectorFitting(network)
    theirs.vector_fit(n_poles_real=0, n_poles_cmplx=order // 2, enforce_dc=False)
    their_rms = np.sqrt(np.mean(np.abs(theirs.get_model_response(0, 0, w / 2 / np.pi) - f) ** 2))
    scale = float(w[-1])
    ours = fitted(1j * w / scale, f, order, count=30).at(1j * w / scale)
    assert np.sqrt(np.mean(np.abs(ours - f) ** 2)) == pytest.approx(their_rms, rel=1e-4)
