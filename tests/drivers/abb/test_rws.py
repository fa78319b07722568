from __future__ import annotations

import math

import pytest

from cellwatt.errors import ProtocolError
from cellwatt_drivers.abb import rws

# As printed in the manual, 3HAC050973.
STATE = b"""<?xml version="1.0" encoding="UTF-8"?>
<html xmlns="http://www.w3.org/1999/xhtml"><head><title>panel</title>
<base href= "http://localhost/rw/panel/ctrlstate/" />
</head><body><div class="state"><a href= "" rel="self"/><a href= "?action=show" rel="action"/>
<ul><li class="pnl-ctrlstate" title="ctrlstate"><span class="ctrlstate">motoron</span></li></ul></div></body></html>"""
ENERGY = b"""<?xml version="1.0" encoding="UTF-8"?>
<html xmlns="http://www.w3.org/1999/xhtml"><head><title>system</title></head><body><div class="state"><ul>
<li class="sys-energy-state-li" title="energy-state"><span class="state">0</span>
<span class="energy-state">blocked</span><span class="change-count">4</span><span class="time-stamp">0</span>
<span class="reset-time">0</span><span class="interval-length">2</span>
<span class="interval-energy">8888.1234</span><span class="accumulated-energy">9999.5</span></li>
<li class="sys-energy-mec-li" title="STN_1"><ul><li class="sys-energy-axis-li" title="1">
<span class="interval-energy">1.5</span></li></ul></li>
<li class="sys-energy-mec-li" title="ROB_1"><ul><li class="sys-energy-axis-li" title="1">
<span class="interval-energy">5189.1564</span></li><li class="sys-energy-axis-li" title="2">
<span class="interval-energy">-12.25</span></li></ul></li></ul></div></body></html>"""


def test_energy_of_one_robot():
    found = rws.energy(ENERGY, "ROB_1")
    assert found == rws.Energy(True, 4, "blocked", 2.0, 8888.1234, 9999.5, (5189.1564, -12.25))
    assert rws.energy(ENERGY, "STN_1").joints == (1.5,)


def test_energy_that_is_not_measured():
    found = rws.energy(ENERGY.replace(b'>0</span>\n<span class="energy', b'>-1</span>\n<span class="energy'), "ROB_1")
    assert not found.valid
    assert math.isnan(rws.energy(ENERGY.replace(b">9999.5<", b"><"), "ROB_1").accumulated)


@pytest.mark.parametrize("page", [b"", b"<html>", b"{}", STATE, ENERGY.replace(b"9999.5", b"many")])
def test_pages_that_are_none(page):
    with pytest.raises(ProtocolError):
        rws.energy(page, "ROB_1")


def test_a_page_in_an_encoding_that_there_is_not():
    with pytest.raises(ProtocolError, match="not XHTML"):
        rws.items(b'<?xml version="1.0" encoding="rot13"?><ul/>')
