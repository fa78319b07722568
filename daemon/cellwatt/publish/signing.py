"""Signatures of a cell's messages, for consumers who do not trust who carries them.

A signature covers what a message says and where it belongs: cell, topic, mark (session, number, time) and payload. So
a signed message cannot be changed, nor shown as one of another topic or cell; where it is shown again, its number is
known. It is the last 64 bytes of the attachment, behind the mark. An answer is signed together with the parameters of
its question; who puts a number drawn by lot into each question knows that the answer is of now.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from cellwatt.errors import ConfigError, SinkError
from cellwatt.publish.messages import parse_json
from cellwatt.signing import SIGNATURE, Signer, Verifier

MESSAGE: Final = "cellwatt: message of a cell, version 1"
ANSWER: Final = "cellwatt: answer of a cell, version 1"
REFUSAL: Final = "cellwatt: refusal of a question, version 1"


class Seal:
    """Signs what a cell says, where it was given a key; ``root`` is the key of the cell. Open it first."""

    def __init__(self, root: str, key: Path | None) -> None:
        self._root = root
        self._path = key
        self._signer: Signer | None = None

    def open(self) -> None:
        """Read the key. Raises ``SinkError`` where that fails: nothing goes out unsigned."""
        if self._path is not None:
            try:
                self._signer = Signer(self._path)
            except ConfigError as error:
                raise SinkError(f"sign: {error}") from None

    def message(self, topic: str, attachment: bytes, payload: bytes) -> bytes:
        """The attachment of a message with its signature behind it."""
        if self._path is None:
            return attachment
        return attachment + self._opened().sign(MESSAGE, self._root, topic, attachment, payload)

    def answer(self, topic: str, parameters: str, attachment: bytes, payload: bytes) -> bytes:
        """The same of an answer to a question about a topic, or to ``@/NAME``, with these parameters."""
        if self._path is None:
            return attachment
        return attachment + self._opened().sign(ANSWER, self._root, topic, _asked(parameters), attachment, payload)

    def refusal(self, parameters: str, error: str) -> dict[str, str]:
        """The body of a refusal of a question with these parameters."""
        if self._path is None:
            return {"error": error}
        signature = self._opened().sign(REFUSAL, self._root, _asked(parameters), error)
        return {"error": error, "signature": signature.hex()}

    def _opened(self) -> Signer:
        assert self._signer is not None, "not open"
        return self._signer


class Check:
    """Knows whether the cell at the key ``root`` said something. Raises ``ConfigError`` where ``key`` holds no key."""

    def __init__(self, root: str, key: Path) -> None:
        self._root = root
        self._verifier = Verifier(key)

    def message(self, topic: str, attachment: bytes, payload: bytes) -> bool:
        """Whether it said this under a topic."""
        mark, signature = attachment[:-SIGNATURE], attachment[-SIGNATURE:]
        return self._verifier.holds(signature, MESSAGE, self._root, topic, mark, payload)

    def answer(self, topic: str, parameters: str, attachment: bytes, payload: bytes) -> bool:
        """Whether it answered this to just this question about a topic, or to ``@/NAME``."""
        mark, signature = attachment[:-SIGNATURE], attachment[-SIGNATURE:]
        return self._verifier.holds(signature, ANSWER, self._root, topic, _asked(parameters), mark, payload)

    def refusal(self, parameters: str, payload: bytes) -> bool:
        """Whether it refused a question with these parameters."""
        try:
            body = parse_json(payload)
            signature = bytes.fromhex(body["signature"])
            return self._verifier.holds(signature, REFUSAL, self._root, _asked(parameters), str(body["error"]))
        except (ValueError, KeyError, TypeError):
            return False


def _asked(parameters: str) -> str:
    """Without what Zenoh adds of its own on the way, which begins with an underline."""
    return ";".join(part for part in parameters.split(";") if not part.startswith("_"))
