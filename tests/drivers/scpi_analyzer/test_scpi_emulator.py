"""The instrument behind the emulator, and the emulator's port, without our driver."""

from __future__ import annotations

import math

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


@pytest.mark.parametrize(
    "line", ["CHANN1:MEAS:FUNC?", "CHAN2:MEAS:FUNC?", "MEAS:FUNC?", "CHAN1:MEAS:FORM ASC;MEAS:FUNC?"]
)
def test_other_spellings_are_undefined(analyzer, line):
    assert analyzer.execute(line, 0.0) is None
    assert analyzer.execute("SYST:ERR?", 0.0) == '-113,"Undefined header"'
    assert analyzer.execute("SYST:ERR?", 0.0) == '0,"No error"'


def test_data_follow_the_selected_functions(analyzer):
    assert analyzer.execute("CHAN1:MEAS:FUNC P,URMS,Lambda", 1.0) is None
    assert analyzer.execute("CHAN1:MEAS:FUNC?", 1.0) == "P,URMS,LAMB"
    assert analyzer.execute("CHAN1:MEAS:DATA?", 1.0) == "5.0000E+02,2.3000E+02,8.6957E-01"


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("CHAN1:MEAS:FUNC POWER", '-224,"Illegal parameter value"'),
        ("CHAN1:MEAS:FUNC", '-109,"Missing parameter"'),
        ("INT:MODE SOMETIMES", '-224,"Illegal parameter value"'),
    ],
)
def test_what_it_refuses(analyzer, line, error):
    analyzer.execute(line, 0.0)
    assert analyzer.execute("SYST:ERR?", 0.0) == error
    assert analyzer.functions[0] == "URMS"


def test_all_errors_at_once_and_the_registers_of_ieee_488(analyzer):
    assert analyzer.execute("SYST:ERR:ALL?", 0.0) == '0,"No error"'
    analyzer.execute("*ESE 32;*SRE 32;NONSENSE;CHAN1:MEAS:FUNC POWER", 0.0)
    assert analyzer.execute("*ESE?;*SRE?", 0.0) == "32;32"
    assert analyzer.execute("*STB?", 0.0) == "100"  # an error waits 4, its event is enabled 32, and asks for service 64
    assert analyzer.execute("*ESR?", 0.0) == "48"  # command error 32, execution error 16
    assert analyzer.execute("*STB?", 0.0) == "4"
    assert analyzer.execute("SYST:ERR:ALL?", 0.0) == '-113,"Undefined header",-224,"Illegal parameter value"'
    assert analyzer.execute("*STB?;*ESR?", 0.0) == "0;0"
    for line in ("*ESE 256", "*SRE many"):
        analyzer.execute(line, 0.0)
        assert analyzer.execute("SYST:ERR?", 0.0) == '-224,"Illegal parameter value"'


def test_a_measurement_stands_for_a_tenth_of_a_second():
    class Ramp:
        def at(self, t):
            return {"supply.power": 1000.0 * t}

        def disturb(self, change):
            raise ValueError

    analyzer = EmulatedAnalyzer(Ramp(), "x")
    analyzer.execute("CHAN1:MEAS:FUNC P", 0.0)
    # The mean of 1000 t over 0.9 … 1.0 s is 950, and stays until 1.1 s.
    assert analyzer.execute("CHAN1:MEAS:DATA?", 1.001) == "9.5000E+02"
    assert analyzer.execute("CHAN1:MEAS:DATA?", 1.099) == "9.5000E+02"
    assert analyzer.execute("CHAN1:MEAS:DATA?", 1.101) == "1.0500E+03"


def test_the_integrator_adds_power_times_time(analyzer):
    analyzer.execute("CHAN1:MEAS:FUNC WH,TIME", 0.05)
    assert analyzer.execute("CHAN1:MEAS:DATA?", 10.05) == "0.000000E+00,0.0000E+00"
    analyzer.execute("INT:MODE MAN;:INT:STAT ON;STAR", 10.05)
    # 500 W for an hour are 500 Wh, also when nobody asked meanwhile.
    assert analyzer.execute("CHAN1:MEAS:DATA?", 3610.05) == "5.000000E+02,3.6000E+03"
    analyzer.execute("INT:STOP", 3610.05)
    assert analyzer.execute("CHAN1:MEAS:DATA?", 4000.0) == "5.000000E+02,3.6000E+03"
    analyzer.execute("INT:RES", 4000.0)
    assert analyzer.execute("CHAN1:MEAS:DATA?", 4000.0) == "0.000000E+00,0.0000E+00"


def test_overload_and_nothing_measured(analyzer):
    analyzer.execute("CHAN1:MEAS:FUNC URMS,IRMS", 0.0)
    analyzer.overload = {"IRMS"}
    assert analyzer.execute("CHAN1:MEAS:DATA?", 1.0) == "2.3000E+02,9.9000E+37"
    dead = EmulatedAnalyzer(type(STILL)({}), "x")
    dead.execute("CHAN1:MEAS:FUNC LAMB,FU", 0.0)
    assert dead.execute("CHAN1:MEAS:DATA?", 1.0) == "9.9100E+37,9.9100E+37"


def test_alternating_current_is_measured_as_root_mean_square():
    class Sine:
        def at(self, t):
            wave = np.sin(2 * math.pi * 50.0 * t)
            return {"supply.voltage": 325.0 * wave, "supply.current": 2.0 * wave, "supply.power": 650.0 * wave**2}

        def disturb(self, change):
            raise ValueError

    analyzer = EmulatedAnalyzer(Sine(), "x")
    analyzer.execute("CHAN1:MEAS:FUNC URMS,IRMS,P,LAMB", 0.0)
    found = [float(x) for x in analyzer.execute("CHAN1:MEAS:DATA?", 1.0).split(",")]
    assert found == pytest.approx([325 / math.sqrt(2), 2 / math.sqrt(2), 325.0, 1.0], rel=1e-3)
