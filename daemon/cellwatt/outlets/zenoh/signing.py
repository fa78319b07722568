"""Signatures of a cell's messages, for consumers that do not trust the network between.

A signature covers cell, topic, mark (session, number, time) and payload. So a signed message cannot be changed or
passed off as one of another topic or cell; a replayed one is recognised by its number. The signature is the last
64 bytes of the attachment, after the mark. An answer is signed together with the parameters of its question; a
consumer that puts a random number into each question knows that the answer is fresh.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from cellwatt.errors import ConfigError, OutletError
from cellwatt.outlets.zenoh.messages import parse_json
from cellwatt.signing import SIGNATURE, Signer, Verifier

MESSAGE: Final = "cellwatt: message of a cell, version 1"
ANSWER: Final = "cellwatt: answer of a cell, version 1"
REFUSAL: Final = "cellwatt: refusal of a question, version 1"


class Seal:
    """Signs a cell's messages if the cell has a key; ``root`` is the cell's Zenoh key. Call ``open`` first."""

    def __init__(self, root: str, key: Path | None) -> None:
        self._root = root
        self._path = key
        self._signer: Signer | None = None

    def open(self) -> None:
        """Read the key. Raises ``OutletError`` on failure: nothing goes out unsigned."""
        if self._path is not None:
            try:
                self._signer = Signer(self._path)
            except ConfigError as error:
                raise OutletError(f"sign: {error}") from None

    def message(self, topic: str, attachment: bytes, payload: bytes) -> bytes:
        """The attachment of a message, followed by the signature."""
        if self._path is None:
            return attachment
        return attachment + self._opened().sign(MESSAGE, self._root, topic, attachment, payload)

    def answer(self, topic: str, parameters: str, attachment: bytes, payload: bytes) -> bytes:
        """The signed attachment of an answer to a question about a topic, or to ``@/NAME``, with these parameters."""
        if self._path is None:
            return attachment
        return attachment + self._opened().sign(ANSWER, self._root, topic, _asked(parameters), attachment, payload)

    def refusal(self, parameters: str, error: str) -> dict[str, str]:
        """The signed body of a refusal of a question with these parameters."""
        if self._path is None:
            return {"error": error}
        signature = self._opened().sign(REFUSAL, self._root, _asked(parameters), error)
        return {"error": error, "signature": signature.hex()}

    def _opened(self) -> Signer:
        assert self._signer is not None, "not open"
        return self._signer


class Check:
    """Verifies messages of the cell at the Zenoh key ``root``. Raises ``ConfigError`` if ``key`` holds no key."""

    def __init__(self, root: str, key: Path) -> None:
        self._root = root
        self._verifier = Verifier(key)

    def message(self, topic: str, attachment: bytes, payload: bytes) -> bool:
        """True if the cell published this message under a topic."""
        mark, signature = attachment[:-SIGNATURE], attachment[-SIGNATURE:]
        return self._verifier.holds(signature, MESSAGE, self._root, topic, mark, payload)

    def answer(self, topic: str, parameters: str, attachment: bytes, payload: bytes) -> bool:
        """True if the cell gave this answer to this very question about a topic, or to ``@/NAME``."""
        mark, signature = attachment[:-SIGNATURE], attachment[-SIGNATURE:]
        return self._verifier.holds(signature, ANSWER, self._root, topic, _asked(parameters), mark, payload)

    def refusal(self, parameters: str, payload: bytes) -> bool:
        """True if the cell refused a question with these parameters."""
        try:
            body = parse_json(payload)
            signature = bytes.fromhex(body["signature"])
            return self._verifier.holds(signature, REFUSAL, self._root, _asked(parameters), str(body["error"]))
        except (ValueError, KeyError, TypeError):
            return False


def _asked(parameters: str) -> str:
    """Parameters without those that Zenoh adds on the way, whose names begin with an underscore."""
    return ";".join(part for part in parameters.split(";") if not part.startswith("_"))
