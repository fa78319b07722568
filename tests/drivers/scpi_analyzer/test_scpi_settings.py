from __future__ import annotations

import pytest

from cellwatt_drivers.scpi_analyzer import ScpiAnalyzerDriver, ScpiAnalyzerSettings

from .rig import Inlet


@pytest.mark.parametrize(
    ("found", "window"),
    [({}, 0.1), ({"window": "250 ms"}, 0.25), ({"model": "wt300"}, 0.0), ({"model": "wt300", "window": "1 s"}, 1.0)],
)
def test_values_are_declared_as_means_as_far_as_that_is_known(found, window):
    settings = ScpiAnalyzerSettings.model_validate({"host": "192.0.2.1", "functions": ["P", "WH"], **found})
    (stream,) = ScpiAnalyzerDriver("supply", settings, Inlet()).streams
    assert [c.window for c in stream.channels] == [window, 0.0]
