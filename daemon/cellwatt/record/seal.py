"""A signed digest beside each finished recording: ``NAME.mcap.sig``.

It holds the file's name, size and SHA-256, how it was finished (``closed``, or ``repaired`` after a crash), and the
cell's signature (Ed25519) of these four. Site, cell and session are in the header of the recording.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, Literal

from pydantic import TypeAdapter

from cellwatt.door.signing import Signer, Verifier
from cellwatt.errors import why
from cellwatt.files import replace_text
from cellwatt.record.header import PART, FileName, closed_name
from cellwatt.record.survey import files_at

SUFFIX: Final = ".sig"
RECORDING: Final = "cellwatt: recording of a cell, version 1"
State = Literal["closed", "repaired"]
_LARGEST: Final = 4096
"""Largest size in bytes of a seal that is read; ours have some 350."""


@dataclass(frozen=True, slots=True)
class Seal:
    """Seal of one file; ``signature`` is hexadecimal."""

    file: str
    bytes: int
    sha256: str
    state: State
    signature: str = ""

    @property
    def parts(self) -> tuple[str, ...]:
        """The signed texts."""
        return (RECORDING, self.file, str(self.bytes), self.sha256, self.state)


_SEAL: Final = TypeAdapter(Seal)


def seal_of(recording: Path) -> Path:
    """Path of a recording's seal."""
    return recording.with_name(recording.name + SUFFIX)


def write(recording: Path, state: State, signer: Signer) -> None:
    """Sign a finished file; one that still has the suffix ``.part`` is signed under its final name.

    Reads the whole file. Raises ``OSError``.
    """
    target = closed_name(recording)
    bare = Seal(target.name, *_digest(recording), state)
    replace_text(seal_of(target), json.dumps({**asdict(bare), "signature": signer.sign(*bare.parts).hex()}))


def read(recording: Path) -> Seal | None:
    """A recording's seal, unchecked; ``None`` if there is no readable one."""
    try:
        with seal_of(recording).open("rb") as file:
            return _SEAL.validate_json(file.read(_LARGEST))
    except (OSError, ValueError):
        return None


def verify(recordings: Iterable[Path], key: Path) -> Iterator[tuple[Path, State | None, str]]:
    """Check files, and all files of folders: yield each with its state, or with ``None`` and what is wrong with it.

    Files missing between others of a session are reported, too. Raises ``ConfigError`` if ``key`` holds no
    public key, ``RecordingError`` if there are no recordings.
    """
    verifier = Verifier(key)
    files = sorted(files_at(list(recordings)))
    for file in files:
        problem = _problem(file, verifier)
        found = read(file)
        yield file, None if problem or found is None else found.state, problem
    for path in _missing(files):
        yield path, None, "is missing, although earlier and later files of the same session exist"


def _problem(file: Path, verifier: Verifier) -> str:
    """Return what is wrong with a file; empty if it is unchanged since its cell signed it."""
    seal = read(file)
    if seal is None:
        return "is not finished, so it is not signed yet" if file.name.endswith(PART) else "is not signed"
    if not verifier.holds(_hex(seal.signature), *seal.parts):
        return "is signed with another key, or its signature was changed"
    if seal.file != file.name:
        return f"was signed under another name: {seal.file}"
    try:
        if (seal.bytes, seal.sha256) != _digest(file):
            return "was changed after its cell signed it"
    except OSError as error:
        return f"cannot be read: {why(error)}"
    return ""


def _missing(files: Iterable[Path]) -> Iterator[Path]:
    """Files that are absent according to the file numbers of a session."""
    there: dict[tuple[Path, int, str], set[int]] = {}
    for file in files:
        name = FileName.parse(file.name)
        if name is not None:
            there.setdefault((file.parent, name.session, name.cell), set()).add(name.number)
    for (folder, session, cell), numbers in there.items():
        for number in sorted(set(range(min(numbers), max(numbers))) - numbers):
            yield folder / str(FileName(session, number, cell))


def _digest(path: Path) -> tuple[int, str]:
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return file.tell(), digest


def _hex(text: str) -> bytes:
    try:
        return bytes.fromhex(text)
    except ValueError:
        return b""
