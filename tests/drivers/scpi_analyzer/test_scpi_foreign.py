"""Clients that we did not write, at the emulator: each opens it and reads as its own users would."""

from __future__ import annotations

import asyncio

import pytest

from .rig import emulated


def read_by_rsinstrument(place: str) -> tuple[dict[str, object], list[float]]:
    from RsInstrument import RsInstrument, StatusException

    host, _, port = place.rpartition(":")
    instrument = RsInstrument(f"TCPIP::{host}::{port}::SOCKET", True, False, "SelectVisa='SocketIo'")
    try:
        instrument.write_str("CHAN1:MEAS:FUNC URMS,IRMS,P")
        values = instrument.query_bin_or_ascii_float_list("CHAN1:MEAS:DATA?")
        with pytest.raises(StatusException, match="Undefined header"):  # its check of *STB? and the queue
            instrument.write_str("NONSENSE")
        found = {
            "model": instrument.full_instrument_model_name,
            "maker": instrument.manufacturer,
            "version": instrument.query_str("SYST:VERS?"),
            "errors": instrument.query_str("SYST:ERR:ALL?"),
            "complete": instrument.query_opc(),
        }
    finally:
        instrument.close()
    return found, values


async def test_rsinstrument_opens_reads_and_checks_it():
    pytest.importorskip("RsInstrument", reason="RsInstrument is not installed")
    async with emulated() as (_, place):
        found, values = await asyncio.to_thread(read_by_rsinstrument, place)
    assert found == {
        "model": "HMC8015",
        "maker": "Rohde&Schwarz",
        "version": "1999.0",
        "errors": '0,"No error"',
        "complete": True,
    }
    assert values == [230.0, 2.5, 500.0]


def read_by_pyvisa(resource: str) -> tuple[str, list[float], list[str]]:
    import pyvisa

    manager = pyvisa.ResourceManager("@py")
    try:
        with manager.open_resource(resource, read_termination="\n", write_termination="\n") as instrument:
            instrument.timeout = 20_000
            identity = instrument.query("*IDN?")
            instrument.write("CHAN1:MEAS:FUNC URMS,IRMS,P")
            values = instrument.query_ascii_values("CHAN1:MEAS:DATA?")
            instrument.write("NONSENSE;*OPC")
            status = [instrument.query(q) for q in ("*STB?", "*ESR?", "*ESR?", "SYST:ERR:ALL?", "*STB?")]
    finally:
        manager.close()
    return identity, values, status


@pytest.mark.parametrize("address", ["127.0.0.1:0", "pty"])
async def test_pyvisa_reads_it(address):
    pytest.importorskip("pyvisa_py", reason="pyvisa-py is not installed")
    async with emulated(address) as (_, place):
        host, _, port = place.rpartition(":")
        resource = f"ASRL{place}::INSTR" if address == "pty" else f"TCPIP0::{host}::{port}::SOCKET"
        identity, values, status = await asyncio.to_thread(read_by_pyvisa, resource)
    assert identity.split(",")[:2] == ["Rohde&Schwarz", "HMC8015"]
    assert values == [230.0, 2.5, 500.0]
    # An error waits (4); a command error (32) and the end of all operations (1), told once; then all is told.
    assert status == ["4", "33", "0", '-113,"Undefined header"', "0"]
