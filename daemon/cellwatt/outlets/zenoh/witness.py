"""Tells a cell's own messages from forged ones, for consumers that have its public key."""

from __future__ import annotations

import logging
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from cellwatt.outlets.zenoh.keys import HEALTH
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.received import read_refusal
from cellwatt.outlets.zenoh.signing import Check

if TYPE_CHECKING:
    import zenoh

log = logging.getLogger("cellwatt.subscriber")


class Witness:
    """Verifies the signatures of the cell at the Zenoh key ``root``; without its ``key`` every message is accepted.

    Rejected messages are counted in ``counts``: ``unsigned``, and ``replayed`` for repeated health messages.
    Raises ``ConfigError`` if ``key`` holds no key.
    """

    def __init__(self, root: str, key: Path | None, counts: Counter[str]) -> None:
        self._root = root
        self._counts = counts
        self._check = None if key is None else Check(root, key)

    @property
    def asks_for_proof(self) -> bool:
        """True if answers must prove that they are fresh: each question then carries a random number."""
        return self._check is not None

    def message(self, topic: str, sample: zenoh.Sample) -> bool:
        """True if the cell published this message under a topic."""
        if self._check is None:
            return True
        return self._right(self._check.message(topic, *_parts(sample)), "unsigned", topic)

    def reply(self, topic: str, selector: str, reply: zenoh.Reply) -> bool:
        """True if the cell gave this answer to this very question."""
        parameters = selector.partition("?")[2]
        if self._check is None or (reply.ok is None and (reply.err is None or read_refusal(reply.err) is None)):
            return True
        if reply.ok is not None:
            return self._right(self._check.answer(topic, parameters, *_parts(reply.ok)), "unsigned", topic)
        assert reply.err is not None
        return self._right(self._check.refusal(parameters, reply.err.payload.to_bytes()), "unsigned", topic)

    def newer(self, mark: Mark, reached: tuple[int, int]) -> bool:
        """True if a health message is newer than ``reached``; an older one may be a replay."""
        session, sequence = reached
        again = self._check is not None and mark.session == session and mark.sequence <= sequence
        return self._right(not again, "replayed", HEALTH)

    def _right(self, right: bool, wrong: str, topic: str) -> bool:
        if not right:
            self._counts[wrong] += 1
            if self._counts[wrong] == 1:  # whoever forges could fill the log
                log.warning("%s/%s: a message that is %s came; such are left out", self._root, topic, wrong)
        return right


def _parts(sample: zenoh.Sample) -> tuple[bytes, bytes]:
    """Attachment and payload."""
    return b"" if sample.attachment is None else sample.attachment.to_bytes(), sample.payload.to_bytes()
