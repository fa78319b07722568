import numpy as np
import pytest
import yaml

from cellwatt.errors import ModelError
from cellwatt_plugins.faults.paper import equation as file
from cellwatt_plugins.faults.paper.bevf import fit
from tests.plugins.faults.paper.irb1200 import PICK_AND_PLACE
from tests.plugins.faults.paper.patterns import pattern_of


@pytest.fixture(scope="module")
def fitted():
    t, power = pattern_of(PICK_AND_PLACE, cycles=4)
    return t, fit(t, power, order=24, iterations_done=4)


@pytest.fixture
def path(fitted, tmp_path):
    file.save(fitted[1], tmp_path / "task.yaml")
    return tmp_path / "task.yaml"


def test_the_file_gives_the_same_power(fitted, path):
    t, equation = fitted
    again = file.load(path)
    assert np.array_equal(again.power(t), equation.power(t))
    assert (again.order, again.duration, len(again.rms)) == (24, equation.duration, 4)


def test_a_person_can_evaluate_it_as_the_file_says(fitted, path):
    t, equation = fitted
    told = yaml.safe_load(path.read_text())
    p, r = ([complex(*pair) for pair in told[name]] for name in "pr")
    assert told["power"] == "abs(K + sum(r[k] / (1j*t - p[k]))) W, t in s"
    for at in (0, 100, len(t) - 1):
        by_hand = abs(told["K"] + sum(r[k] / (1j * t[at] - p[k]) for k in range(told["order"])))
        assert by_hand == pytest.approx(equation.power(t)[at])


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"cellwatt_power_equation": 2}, "cellwatt_power_equation: found 2, expected 1"),
        ({"p": [[0.0, 1.0]] * 24}, "pole on the imaginary axis"),
    ],
)
def test_a_wrong_file_is_refused_with_its_place(path, change, problem):
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | change))
    with pytest.raises(ModelError, match=problem):
        file.load(path)
