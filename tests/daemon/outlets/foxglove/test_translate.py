"""Frames as transforms, links and the log, without a server."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from cellwatt.outlets.foxglove.topics import Moment, Outgoing
from cellwatt.outlets.foxglove.translate import Translator
from tests.daemon.outlets.foxglove.cell import LAYOUT, frames
from tests.daemon.outlets.foxglove.client import message_class
from tests.daemon.outlets.foxglove.moving import skeleton


def decoded(outgoing: Outgoing) -> Any:
    return message_class(outgoing.topic.schema_name, outgoing.topic.schema).FromString(outgoing.data)


def on(moments: list[Moment], topic: str) -> list[Outgoing]:
    return [out for moment in moments for out in moment.messages if out.topic.name == topic]


def test_fast_frames_move_the_arm_fifty_times_a_second() -> None:
    fast = replace(LAYOUT, rate=500.0)
    slow = frames(0, 100)
    block = replace(slow, layout=fast, time=slow.time[0] + (slow.time - slow.time[0]) // 10)
    moments = list(Translator(lambda _: [skeleton()]).frames(block))
    assert len(on(moments, "/frame")) == 100
    assert len(on(moments, "/tf")) == 10


def test_links_are_lines_from_parent_to_joint_and_told_once() -> None:
    translator = Translator(lambda _: [skeleton()])
    moments = [*translator.frames(frames(0, 3)), *translator.frames(frames(3, 3))]
    (told,) = on(moments, "/scene")
    assert told.key == "links"
    scene = decoded(told)
    assert [e.frame_id for e in scene.entities] == ["arm/base", *(f"arm/joint_{i}" for i in range(1, 6))]
    for entity, joint in zip(scene.entities, skeleton()["joints"], strict=True):
        start, end = entity.lines[0].points
        assert [start.x, start.y, start.z] == [0, 0, 0]
        assert [end.x, end.y, end.z] == pytest.approx(joint["xyz"])
        assert entity.frame_locked


def test_two_arms_stand_apart() -> None:
    two = [skeleton(), {**skeleton(), "source": "other"}]
    told = decoded(on(list(Translator(lambda _: two).frames(frames(0, 1))), "/tf")[0])
    bases = {t.child_frame_id: t.translation.y for t in told.transforms if t.parent_frame_id == "world"}
    assert bases == {"arm/base": 0.0, "other/base": 1.5}


def test_what_is_lost_is_a_line() -> None:
    (line,) = on([Translator().lost(5, "frame", 12)], "/log")
    assert decoded(line).message == "12 of frame did not arrive: the cell no longer has them"
