"""The meter's protocol: one line of ASCII per request, one per answer. No I/O here, so that it is easy to test.

Document your own with example bytes; if a maintained library speaks the protocol, use it and remove this file.
"""

from __future__ import annotations

from dataclasses import dataclass

from cellwatt import ProtocolError

PORT = 10000
WHO = b"ID?\n"
"""Request for the identity: ``METER,<serial>,<firmware>``."""
READ = b"READ?\n"
"""Request for a sample: ``<volt> <ampere> <milliwatt>``."""
LONGEST = 256
"""Longest answer, bytes."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One sample in SI units: V, A, W."""

    voltage: float
    current: float
    power: float


def parse_sample(line: bytes) -> Sample:
    """Parse a line into a sample in SI units; the meter sends mW. Raises ``ProtocolError``."""
    try:
        voltage, current, milliwatt = (float(part) for part in line.decode("ascii").split())
    except ValueError as error:
        raise ProtocolError(f"expected three numbers, got {line[:80]!r}") from error
    return Sample(voltage, current, milliwatt / 1000.0)


def format_sample(sample: Sample) -> bytes:
    """Format a sample as the meter sends it."""
    return f"{sample.voltage:.3f} {sample.current:.4f} {sample.power * 1000.0:.0f}\n".encode("ascii")


def parse_identity(line: bytes) -> tuple[str, str]:
    """Parse serial number and firmware. Raises ``ProtocolError`` if the answer is not a meter's."""
    parts = line.decode("ascii", "replace").strip().split(",")
    if len(parts) != 3 or parts[0] != "METER":
        raise ProtocolError(f"expected METER,<serial>,<firmware>, got {line[:80]!r}")
    return parts[1], parts[2]
