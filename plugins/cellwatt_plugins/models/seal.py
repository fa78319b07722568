"""A digest at the end of a model file, which shows changed weights; all weights must be in that file.

It is one more entry of ``metadata_props`` appended to the ONNX file (a protobuf message may be continued that way): the
key ``cellwatt.sha256`` with the SHA-256, in hex, of all bytes before. Other programs can still read the file.
"""

from __future__ import annotations

import hashlib
import re
from typing import Final

KEY: Final = "cellwatt.sha256"

_ENTRY: Final = b"\x0a" + bytes([len(KEY)]) + KEY.encode() + b"\x12\x40"  # StringStringEntryProto: key, value of 64
_HEAD: Final = b"\x72" + bytes([len(_ENTRY) + 64]) + _ENTRY  # ModelProto.metadata_props
_OUTSIDE: Final = re.compile(rb"\x6a[\x00-\xff]{1,2}\x0a\x08location\x12")  # TensorProto.external_data
_LENGTH: Final = len(_HEAD) + 64


def sealed(content: bytes) -> bytes:
    """A serialised ONNX model with its digest appended."""
    return content + _HEAD + _digest(content)


def broken(content: bytes) -> bool:
    """True if a file ends with a digest that does not match it; files without a digest are never broken."""
    body, seal = content[:-_LENGTH], content[-_LENGTH:]
    return seal.startswith(_HEAD) and seal != _HEAD + _digest(body)


def uncovered(content: bytes) -> bool:
    """True if a file has a digest, and weights in another file, which the digest does not cover."""
    return content[-_LENGTH:].startswith(_HEAD) and _OUTSIDE.search(content) is not None


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()
