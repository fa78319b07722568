"""What is lost, without a server."""

from __future__ import annotations

from cellwatt.outlets.foxglove.translate import Translator
from tests.daemon.outlets.foxglove.client import message_class


def test_what_is_lost_is_a_line() -> None:
    (line,) = Translator().lost(5, "frame", 12).messages
    told = message_class(line.topic.schema_name, line.topic.schema).FromString(line.data)
    assert told.message == "12 of frame are lost: the cell no longer stores them"
