"""Whether it was the cell that said something, for consumers who have its key."""

from __future__ import annotations

import logging
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from cellwatt.publish.keys import HEALTH
from cellwatt.publish.mark import Mark
from cellwatt.publish.received import read_refusal
from cellwatt.publish.signing import Check

if TYPE_CHECKING:
    import zenoh

log = logging.getLogger("cellwatt.subscriber")


class Witness:
    """Knows what the cell at the key ``root`` signed; without its ``key`` everything is taken for the cell's.

    What is not the cell's is counted in ``counts``: ``unsigned``, and ``replayed`` for health that is shown again.
    Raises ``ConfigError`` where ``key`` holds no key.
    """

    def __init__(self, root: str, key: Path | None, counts: Counter[str]) -> None:
        self._root = root
        self._counts = counts
        self._check = None if key is None else Check(root, key)

    @property
    def asks_for_proof(self) -> bool:
        """Whether an answer must be of now: each question then carries a number drawn by lot."""
        return self._check is not None

    def message(self, topic: str, sample: zenoh.Sample) -> bool:
        """Whether the cell said this under a topic."""
        if self._check is None:
            return True
        return self._right(self._check.message(topic, *_parts(sample)), "unsigned", topic)

    def reply(self, topic: str, selector: str, reply: zenoh.Reply) -> bool:
        """Whether the cell answered this, and to this very question."""
        parameters = selector.partition("?")[2]
        if self._check is None or (reply.ok is None and (reply.err is None or read_refusal(reply.err) is None)):
            return True
        if reply.ok is not None:
            return self._right(self._check.answer(topic, parameters, *_parts(reply.ok)), "unsigned", topic)
        assert reply.err is not None
        return self._right(self._check.refusal(parameters, reply.err.payload.to_bytes()), "unsigned", topic)

    def newer(self, mark: Mark, reached: tuple[int, int]) -> bool:
        """Whether a health message comes after the one ``reached``: what was signed once can be shown again."""
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
