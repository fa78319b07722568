import ast
from pathlib import Path

import numpy as np
import pytest
from faults.networks import _with_wrong

BENCH = Path(__file__).resolve().parents[3] / "bench"
PLANT = ["faults/plant.py", "faults/tasks.py", "concealed/arms.py", "concealed/families.py", "concealed/law.py"]


@pytest.mark.parametrize("name", PLANT)
def test_the_plant_that_tests_imports_nothing_that_judges(name):
    tree = ast.parse((BENCH / name).read_text())
    names = [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert not [each for each in names if each.startswith("cellwatt")]


@pytest.mark.parametrize(("wrong", "ways"), [(1, 8), (2, 24)])
def test_wrong_codes_are_tried_every_way(wrong, ways):
    column = np.array([1, 0, -1, 0], np.int8)
    found = _with_wrong(column, wrong)
    assert len({tuple(codes) for codes in found}) == len(found) == ways
    assert all((codes != column).sum() == wrong for codes in found)
