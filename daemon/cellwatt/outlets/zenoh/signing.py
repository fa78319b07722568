"""Signatures of a cell's messages, for consumers that do not trust the network.

A signature covers cell, topic, mark (session, number, time) and payload. So a signed message cannot be changed or
moved to another topic or cell; a replayed one is recognised by its number. The signature is the last 64 bytes of the
attachment, after the mark. An answer is signed together with the parameters of its question; a consumer that puts a
random number into each question knows that the answer is fresh.
"""

from __future__ import annotations

import logging
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Final

from cellwatt.door.signing import SIGNATURE, Signer, Verifier
from cellwatt.errors import ConfigError, OutletError
from cellwatt.outlets.zenoh.keys import HEALTH
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import parse_json
from cellwatt.outlets.zenoh.received import read_refusal

if TYPE_CHECKING:
    import zenoh


MESSAGE: Final = "cellwatt: message of a cell, version 1"
ANSWER: Final = "cellwatt: answer of a cell, version 1"
REFUSAL: Final = "cellwatt: refusal of a question, version 1"


class MessageSigner:
    """Signs a cell's messages if the cell has a key; ``root`` is the cell's Zenoh key. Call ``open`` first."""

    def __init__(self, root: str, key: Path | None) -> None:
        self._root = root
        self._path = key
        self._signer: Signer | None = None

    def open(self) -> None:
        """Read the key. Raises ``OutletError`` on failure: nothing is sent unsigned."""
        if self._path is not None:
            try:
                self._signer = Signer(self._path)
            except ConfigError as error:
                raise OutletError(f"sign: {error}") from None

    def message(self, topic: str, attachment: bytes, payload: bytes) -> bytes:
        """The attachment of a message with the signature appended."""
        return attachment + self._signature(MESSAGE, topic, attachment, payload)

    def answer(self, topic: str, parameters: str, attachment: bytes, payload: bytes) -> bytes:
        """The signed attachment of an answer to a question about a topic, or to ``@/NAME``, with these parameters."""
        return attachment + self._signature(ANSWER, topic, _asked(parameters), attachment, payload)

    def refusal(self, parameters: str, error: str) -> dict[str, str]:
        """The signed body of a refusal of a question with these parameters."""
        signature = self._signature(REFUSAL, _asked(parameters), error).hex()
        return {"error": error, "signature": signature} if signature else {"error": error}

    def _signature(self, kind: str, *parts: bytes | str) -> bytes:
        """Signature over the cell and these parts; empty if the cell has no key."""
        if self._path is None:
            return b""
        assert self._signer is not None, "not open"
        return self._signer.sign(kind, self._root, *parts)


def _asked(parameters: str) -> str:
    """Parameters without those that Zenoh adds, whose names begin with an underscore."""
    return ";".join(part for part in parameters.split(";") if not part.startswith("_"))


log = logging.getLogger("cellwatt.subscriber")


class MessageVerifier:
    """Verifies the signatures of the cell at the Zenoh key ``root``; without its ``key`` every message is accepted.

    Rejected messages are counted in ``counts``: ``unsigned``, and ``replayed`` for repeated health messages.
    Raises ``ConfigError`` if ``key`` holds no key.
    """

    def __init__(self, root: str, key: Path | None, counts: Counter[str]) -> None:
        self._root = root
        self._counts = counts
        self._verifier = None if key is None else Verifier(key)

    @property
    def asks_for_proof(self) -> bool:
        """True if answers must prove that they are fresh: each question then includes a random number."""
        return self._verifier is not None

    def message(self, topic: str, sample: zenoh.Sample) -> bool:
        """True if the cell published this message under a topic."""
        return self._right(self._signed(sample, MESSAGE, topic), "unsigned", topic)

    def reply(self, topic: str, selector: str, reply: zenoh.Reply) -> bool:
        """True if the cell gave this answer or refusal to this question."""
        asked = _asked(selector.partition("?")[2])
        if reply.ok is not None:
            return self._right(self._signed(reply.ok, ANSWER, topic, asked), "unsigned", topic)
        if reply.err is None or read_refusal(reply.err) is None:  # an error of Zenoh itself
            return True
        return self._right(self._refused(asked, reply.err.payload.to_bytes()), "unsigned", topic)

    def _signed(self, sample: zenoh.Sample, kind: str, topic: str, *about: str) -> bool:
        """True if the cell signed this message under a topic, or this answer to a question ``about``."""
        if self._verifier is None:
            return True
        attachment = b"" if sample.attachment is None else sample.attachment.to_bytes()
        mark, signature = attachment[:-SIGNATURE], attachment[-SIGNATURE:]
        return self._verifier.holds(signature, kind, self._root, topic, *about, mark, sample.payload.to_bytes())

    def _refused(self, asked: str, payload: bytes) -> bool:
        try:
            body = parse_json(payload)
            signature, error = bytes.fromhex(body["signature"]), str(body["error"])
        except (ValueError, KeyError, TypeError):
            return self._verifier is None
        return self._verifier is None or self._verifier.holds(signature, REFUSAL, self._root, asked, error)

    def newer(self, mark: Mark, reached: tuple[int, int]) -> bool:
        """True if a health message is newer than ``reached`` (session, number); an older one may be a replay."""
        session, sequence = reached
        again = self._verifier is not None and mark.session == session and mark.sequence <= sequence
        return self._right(not again, "replayed", HEALTH)

    def _right(self, right: bool, wrong: str, topic: str) -> bool:
        if not right:
            self._counts[wrong] += 1
            if self._counts[wrong] == 1:  # a forger could fill the log
                log.warning("%s/%s: a message that is %s came; such are left out", self._root, topic, wrong)
        return right
