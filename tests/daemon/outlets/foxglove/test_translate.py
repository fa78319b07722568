"""What is lost, and what ends with the cell's daemon, without a server."""

from __future__ import annotations

import pytest

from cellwatt.alarms import RESTARTED
from cellwatt.outlets.foxglove.serving import moments
from cellwatt.outlets.foxglove.translate import Translator
from cellwatt.subscriber import Health, Message
from tests.daemon.outlets.foxglove.client import decoder_of
from tests.daemon.outlets.zenoh.fake_cell import EPOCH, alarm


def test_what_is_lost_is_a_line() -> None:
    (line,) = Translator().lost(5, "frame", 12).messages
    told = decoder_of(line.topic.schema_name, line.topic.schema)(line.data)
    assert told.message == "12 of frame are lost: the cell no longer stores them"


@pytest.mark.parametrize("restart", [EPOCH + 100, EPOCH - 100], ids=["later", "with the clock set back"])
def test_alarms_of_a_daemon_that_ended_are_over(restart: int) -> None:
    """A client that connects later must not see them as active: the new daemon says nothing of them."""
    translator = Translator()

    def health(session: int) -> list[str | None]:
        status = {"alarms": [{"id": "alarm-2"}] if session == restart else []}
        told = moments(translator, Message("health", session, 0, False, Health(session, session, {}, status)))
        return [each.key for moment in told for each in moment.messages if each.over and each.topic.name == "/alarm"]

    assert health(EPOCH) == []
    for item in (alarm(1), alarm(2), alarm(2)):  # the new daemon raises the second one, too
        translator.item(item)
    assert health(restart) == ["alarm-1"]
    assert health(restart) == []
    assert translator.item(alarm(1, False, statement=RESTARTED)).messages[0].over
