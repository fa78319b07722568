"""Clients that we did not write, at the emulator: each opens it and reads as its own users would."""

from __future__ import annotations

import asyncio

import pytest

from .rig import emulated


def read_by_rsinstrument(place: str) -> tuple[str, str, list[float]]:
    from RsInstrument import RsInstrument

    host, _, port = place.rpartition(":")
    options = "SelectVisa='SocketIo', QueryInstrumentStatus=False"  # no driver asks for the status of IEEE 488.2
    instrument = RsInstrument(f"TCPIP::{host}::{port}::SOCKET", True, False, options)
    try:
        instrument.write_str("CHAN1:MEAS:FUNC URMS,IRMS,P")
        values = instrument.query_bin_or_ascii_float_list("CHAN1:MEAS:DATA?")
        return instrument.manufacturer, instrument.full_instrument_model_name, values
    finally:
        instrument.close()


async def test_rsinstrument_opens_and_reads_it():
    pytest.importorskip("RsInstrument", reason="RsInstrument is not installed")
    async with emulated() as (_, place):
        found = await asyncio.to_thread(read_by_rsinstrument, place)
    assert found == ("Rohde&Schwarz", "HMC8015", [230.0, 2.5, 500.0])


def read_by_pyvisa(resource: str) -> tuple[str, list[float], str]:
    import pyvisa

    manager = pyvisa.ResourceManager("@py")
    try:
        with manager.open_resource(resource, read_termination="\n", write_termination="\n") as instrument:
            instrument.timeout = 20_000
            identity = instrument.query("*IDN?")
            instrument.write("CHAN1:MEAS:FUNC URMS,IRMS,P")
            values = instrument.query_ascii_values("CHAN1:MEAS:DATA?")
            instrument.write("NONSENSE")
            error = instrument.query("SYST:ERR?")
    finally:
        manager.close()
    return identity, values, error


@pytest.mark.parametrize("address", ["127.0.0.1:0", "pty"])
async def test_pyvisa_reads_it(address):
    pytest.importorskip("pyvisa_py", reason="pyvisa-py is not installed")
    async with emulated(address) as (_, place):
        host, _, port = place.rpartition(":")
        resource = f"ASRL{place}::INSTR" if address == "pty" else f"TCPIP0::{host}::{port}::SOCKET"
        identity, values, error = await asyncio.to_thread(read_by_pyvisa, resource)
    assert identity.split(",")[:2] == ["Rohde&Schwarz", "HMC8015"]
    assert values == [230.0, 2.5, 500.0]
    assert error == '-113,"Undefined header"'
