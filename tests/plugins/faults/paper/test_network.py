import numpy as np
import onnx
import pytest
from bench.faults.tables import PICK_AND_PLACE, POLISHING

from cellwatt_plugins.faults.paper.network import FaultNetwork, train


@pytest.fixture(scope="module", params=[PICK_AND_PLACE, POLISHING], ids=["table_I", "table_II"])
def trained(request):
    return request.param, train(request.param)


def test_its_layers_are_those_of_the_paper(trained):
    table, content = trained
    graph = onnx.load_from_string(content).graph
    shapes = {tuple(each.dims) for each in graph.initializer}
    intervals = len(table)
    assert {(intervals, 3 * intervals), (3 * intervals, 6 + 1)} <= shapes


def test_it_is_run_from_a_file_and_knows_its_table(trained, tmp_path):
    table, content = trained
    path = tmp_path / "table.onnx"
    path.write_bytes(content)
    network = FaultNetwork(path)
    assert np.array_equal(network.table, table)
    assert [network.joints(column) for column in table.T] == [(1,), (2,), (3,), (4,), (5,), (6,)]
    assert network.joints(np.zeros(len(table), np.int8)) == ()


def test_one_interval_that_was_missed_seldom_changes_the_name(trained):
    """The codes of a real fault are not all outside 10 %: of a column with several, one is left out."""
    table, content = trained
    network = FaultNetwork(content)
    cases = [(j, i) for j in range(6) for i in np.flatnonzero(table[:, j]) if np.count_nonzero(table[:, j]) > 2]
    hits = 0
    for j, i in cases:
        codes = table[:, j].copy()
        codes[i] = 0
        hits += network.joints(codes) == (j + 1,)
    assert hits / len(cases) > 0.7


def test_joints_with_one_column_are_named_together_and_joints_without_codes_never():
    table = PICK_AND_PLACE.copy()
    table[:, 3] = table[:, 2]
    table[:, 0] = 0
    network = FaultNetwork(train(table))
    assert network.groups == ((2,), (3, 4), (5,), (6,))
    assert network.joints(table[:, 3]) == (3, 4)
    assert network.joints(table[:, 0]) == ()
