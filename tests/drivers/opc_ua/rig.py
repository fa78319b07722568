"""Emulated OPC UA servers and drivers."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager
from pathlib import Path

from cellwatt_drivers.opc_ua import OpcUaDriver, OpcUaSettings
from cellwatt_drivers.opc_ua.emulator import OpcUaEmulator

from ..certificates import self_signed
from ..inlet import CollectingInlet
from ..running import Run, Served, Steady, endpoint, repeated, with_address

STILL = Steady({"joint_1.position": 0.5, "joint_1.current": 2.5, "supply.power": 500.0})
TAGS = {
    "joint_1.position": {"node": "ns=plc;s=Arm.Position", "index": 0, "unit": "deg"},
    "joint_2.position": {"node": "ns=plc;s=Arm.Position", "index": 1, "unit": "deg"},
    "joint_1.current": {"node": 'ns=plc;s="DB_Arm"."current"', "unit": "mA"},
    "supply.power": {"path": "plc:Cell/plc:Supply/plc:Power", "unit": "kW", "scale": 0.1},
}
PLC = {"tags": TAGS, "namespaces": {"plc": "urn:plant:plc"}}


def options(**changes: str) -> dict[str, str]:
    """Options of an emulator that has the tags of ``PLC``."""
    made = OpcUaSettings.model_validate({"host": "127.0.0.1", "rate": "20 Hz", **PLC})
    return OpcUaEmulator.options_for([made]) | changes


def emulated(signals=STILL, **changes: str) -> Served[OpcUaEmulator]:
    """An emulator and where it listens."""
    return with_address(OpcUaEmulator(signals, "127.0.0.1:0", seed=3, options=options(**changes)))


def settings(place: str, **changes: object) -> OpcUaSettings:
    base = {"rate": "20 Hz", "publish": "50 ms", **PLC}
    return OpcUaSettings.model_validate(endpoint(place) | base | changes)


def driver(place: str, **changes: object) -> OpcUaDriver:
    return OpcUaDriver("plc", settings(place, **changes), CollectingInlet())


def running(place: str, **changes: object) -> AbstractAsyncContextManager[Run[OpcUaDriver]]:
    return repeated(driver(place, **changes))


def certificate(folder: Path, name: str, uri: str | None = None) -> tuple[Path, Path]:
    """Files of a self-signed certificate and its key; an empty ``uri`` leaves the application URI out."""
    names = [f"URI:{uri or f'urn:test:{name}'}", "DNS:localhost"][uri == "" :]
    uses = "digitalSignature,nonRepudiation,keyEncipherment,dataEncipherment"
    told = {"subjectAltName": ",".join(names), "keyUsage": uses, "extendedKeyUsage": "clientAuth,serverAuth"}
    return self_signed(folder, name, basicConstraints="CA:FALSE", **told)
