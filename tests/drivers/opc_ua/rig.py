"""Emulated OPC UA servers and drivers."""

from __future__ import annotations

import datetime
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from cellwatt_drivers.opc_ua import OpcUaDriver, OpcUaSettings
from cellwatt_drivers.opc_ua.emulator import OpcUaEmulator

from ..inlet import CollectingInlet
from ..running import Run, Steady, endpoint, repeated, served

_USES = x509.KeyUsage(
    digital_signature=True,
    content_commitment=True,
    key_encipherment=True,
    data_encipherment=True,
    key_agreement=False,
    key_cert_sign=False,
    crl_sign=False,
    encipher_only=False,
    decipher_only=False,
)
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


@asynccontextmanager
async def emulated(signals=STILL, **changes: str) -> AsyncIterator[tuple[OpcUaEmulator, str]]:
    """An emulator and where it listens."""
    emulator = OpcUaEmulator(signals, "127.0.0.1:0", seed=3, options=options(**changes))
    async with served(emulator) as address:
        yield emulator, address


def settings(place: str, **changes: object) -> OpcUaSettings:
    base = {"rate": "20 Hz", "publish": "50 ms", **PLC}
    return OpcUaSettings.model_validate(endpoint(place) | base | changes)


def driver(place: str, **changes: object) -> OpcUaDriver:
    return OpcUaDriver("plc", settings(place, **changes), CollectingInlet())


def running(place: str, **changes: object) -> AbstractAsyncContextManager[Run[OpcUaDriver]]:
    return repeated(driver(place, **changes))


def certificate(folder: Path, name: str, uri: str | None = None) -> tuple[Path, Path]:
    """Files of a self-signed certificate and its key."""
    key = rsa.generate_private_key(65537, 2048)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    now = datetime.datetime.now(datetime.UTC)
    names = [x509.UniformResourceIdentifier(f"urn:test:{name}" if uri is None else uri), x509.DNSName("localhost")]
    made = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))
        .not_valid_after(now + datetime.timedelta(days=2))
        .add_extension(x509.SubjectAlternativeName(names[not (uri is None or uri) :]), critical=False)
        .add_extension(
            x509.ExtendedKeyUsage([ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]), critical=False
        )
        .add_extension(_USES, critical=False)
        .sign(key, hashes.SHA256())
    )
    files = folder / f"{name}.pem", folder / f"{name}-key.pem"
    files[0].write_bytes(made.public_bytes(serialization.Encoding.PEM))
    files[1].write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    return files
