"""The instrument behind the emulator, and the emulator's port, without our driver."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from cellwatt_drivers.scpi_analyzer.emulated_analyzer import EmulatedAnalyzer

from .rig import STILL


@pytest.fixture
def analyzer():
    return EmulatedAnalyzer(STILL, "Rohde&Schwarz,HMC8015,1,HW1,SW1")


@pytest.mark.parametrize(
    "line",
    [
        "chan1:meas:func?",
        ":CHANnel1:MEASurement:FUNCtions?",
        "CHAN1:MEAS:FORM ASC;FUNC?",
        "CHAN1:MEAS:FORM ASC;*CLS;FUNC?",
    ],
)
def test_spellings_of_one_query(analyzer, line):
    assert analyzer.execute(line, 0.0) == "URMS,IRMS,P,FPLL,URAN,IRAN,S,Q,LAMB,PHI"
    assert not analyzer.errors


def test_a_measurement_stands_for_a_tenth_of_a_second():
    analyzer = EmulatedAnalyzer(SimpleNamespace(at=lambda t: {"supply.power": 1000.0 * t}), "x")
    analyzer.execute("CHAN1:MEAS:FUNC P", 0.0)
    # The mean of 1000 t over 0.9 … 1.0 s is 950, and stays until 1.1 s.
    assert analyzer.execute("CHAN1:MEAS:DATA?", 1.001) == "9.5000E+02"
    assert analyzer.execute("CHAN1:MEAS:DATA?", 1.099) == "9.5000E+02"
    assert analyzer.execute("CHAN1:MEAS:DATA?", 1.101) == "1.0500E+03"


def test_alternating_current_is_measured_as_root_mean_square():
    def sine(t):
        wave = np.sin(2 * math.pi * 50.0 * t)
        return {"supply.voltage": 325.0 * wave, "supply.current": 2.0 * wave, "supply.power": 650.0 * wave**2}

    analyzer = EmulatedAnalyzer(SimpleNamespace(at=sine), "x")
    analyzer.execute("CHAN1:MEAS:FUNC URMS,IRMS,P,LAMB", 0.0)
    found = [float(x) for x in analyzer.execute("CHAN1:MEAS:DATA?", 1.0).split(",")]
    assert found == pytest.approx([325 / math.sqrt(2), 2 / math.sqrt(2), 325.0, 1.0], rel=1e-3)
