"""Decodes text files of any program."""

from __future__ import annotations

import codecs
from contextlib import suppress
from typing import Final

_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),  # starts with the mark of UTF-16
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_OTHERS: Final = (
    (b"PK\x03\x04", "a workbook or an archive, no text: save the sheet as CSV"),
    (b"\xd0\xcf\x11\xe0", "an Excel workbook, no text: save the sheet as CSV"),
    (b"\x1f\x8b", "packed with gzip: unpack it"),
    (b"\x28\xb5\x2f\xfd", "packed with zstd: unpack it"),
    (b"#ROSBAG", "a ROS 1 bag: convert it to ROS 2 (rosbags-convert)"),
    (b"\x93NUMPY", "a NumPy array: save its columns as CSV, with their names"),
    (b"MATLAB ", "a MATLAB file: write its table as CSV (writetable)"),
    (b"{", "JSON, no table: write CSV or Parquet"),
    (b"\x89HDF", "an HDF5 file, no text: save the table as CSV or Parquet"),
)
_LOOKED_AT: Final = 512
"""Number of bytes that are checked for a 0 in every other byte, as in UTF-16 without a mark."""


def text_of(content: bytes) -> str:
    """Decode UTF-8, UTF-16 or UTF-32, otherwise Windows-1252; lines end with ``\\n``.

    Raises ``ValueError`` if the bytes are not text.
    """
    for start, kind in _OTHERS:
        if content.startswith(start):
            raise ValueError(f"it is {kind}")
    mark, encoding = next(((mark, name) for mark, name in _MARKS if content.startswith(mark)), (b"", ""))
    text = _decoded(content[len(mark) :], encoding).rstrip("\0")  # blocks of zeros that a power cut leaves
    if "\0" in text:
        raise ValueError("it holds bytes of 0 and is no text: expected CSV")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _decoded(content: bytes, encoding: str) -> str:
    even, odd = content[:_LOOKED_AT:2], content[1:_LOOKED_AT:2]
    if not encoding and len(content) % 2 == 0 and len(content) > 2 and (not any(odd) or not any(even)):
        encoding = "utf-16-be" if any(odd) else "utf-16-le"
    for each in [encoding] if encoding else ("utf-8", "cp1252"):
        with suppress(UnicodeDecodeError):
            return content.decode(each)
    raise ValueError("its encoding is not known: save it as UTF-8")
