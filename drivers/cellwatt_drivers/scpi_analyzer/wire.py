"""Parses lines of text from an analyzer. Pure functions; see ``dialect`` for the commands."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from cellwatt.driver import Identity
from cellwatt.errors import ProtocolError

PORT = 5025
LONGEST = 4096
"""Longest accepted line, bytes; the measured values of all functions fit in a tenth of it."""

_MOST_VALUES = 255
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_UNAVAILABLE = re.compile(r"[-+]?(?:NAN|1\.#(?:QNAN|SNAN|IND)0*)|-+", re.IGNORECASE)
_INFINITE = re.compile(r"[-+]?(?:INF(?:INITY)?|1\.#INF0*)|-*O(?:[FL]|VLD|VER(?:LOAD)?)-*", re.IGNORECASE)
_NOT_A_NUMBER = 9.91e37  # SCPI 1999, 7.2.1.5
_LARGEST = 9.9e36
_ERROR = re.compile(r"(?::\S+ )?([-+]?[0-9]+)\s*(?:,\s*\"?([^\"]*)\"?)?")


@dataclass(frozen=True, slots=True)
class Value:
    """One value of an answer; NaN if the analyzer has none, with ``overload`` if its input was overloaded."""

    number: float
    overload: bool = False


def parse_value(text: str) -> Value:
    """Parse a number, or a mark for "none" (NAN, 1.#QNAN, dashes, 9.91E37) or "overload" (9.9E37, INF, -OL-, OVLD).

    Raises ``ProtocolError`` for any other text.
    """
    token = text.strip()
    if _INFINITE.fullmatch(token):
        return Value(math.nan, overload=True)
    if _UNAVAILABLE.fullmatch(token):
        return Value(math.nan)
    if not _NUMBER.fullmatch(token):
        raise ProtocolError(f"{token[:40]!r} is not a measured value")
    number = float(token)
    if abs(number) < _LARGEST:
        return Value(number)
    return Value(math.nan, overload=not math.isclose(abs(number), _NOT_A_NUMBER, rel_tol=1e-3))


def parse_values(line: str, count: int, separator: str = ",") -> tuple[Value, ...]:
    """Parse the values of one answer, which may end with a separator; raises ``ProtocolError`` unless ``count``."""
    tokens = line.rstrip().removesuffix(separator).split(separator)
    if len(tokens) != count:
        raise ProtocolError(f"{len(tokens)} values in {line[:60]!r}; expected {count}")
    return tuple(parse_value(token) for token in tokens)


def parse_error(line: str) -> tuple[int, str]:
    """Parse code and text of an entry of the error queue; code 0: the queue is empty. Raises ``ProtocolError``."""
    found = _ERROR.fullmatch(line.strip())
    if not found:
        raise ProtocolError(f"{line[:60]!r} is not an entry of the error queue")
    return int(found[1]), (found[2] or "").strip()


def parse_count(line: str) -> int:
    """Parse the number of values in an analyzer's answers, with or without a header. Raises ``ProtocolError``."""
    text = line.strip().split(" ")[-1]
    if not text.isascii() or not text.isdigit() or int(text) > _MOST_VALUES:
        raise ProtocolError(f"{line[:40]!r} is not a number of values")
    return int(text)


def parse_identification(line: str, maker: str) -> Identity:
    """Parse an answer to ``*IDN?``: the second and third field, and the last as firmware; absent ones are empty."""
    fields = [field.strip() for field in line.split(",")]
    model, serial = (*fields, "", "", "")[1:3]
    return Identity(maker, model, serial, fields[-1] if len(fields) > 3 else "")


def decode_line(data: bytes) -> str:
    """Decode a line without its end. Raises ``ProtocolError`` if it is not printable ASCII."""
    text = data.decode("ascii", "replace")
    if not text.isprintable() or "\ufffd" in text:
        raise ProtocolError(f"{data[:40]!r} is not a line of text")
    return text
