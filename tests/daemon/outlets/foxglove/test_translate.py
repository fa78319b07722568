"""Frames as transforms, links and the log, without a server."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from cellwatt import FrameChannel, Layout
from cellwatt.outlets.foxglove.topics import Moment, Outgoing
from cellwatt.outlets.foxglove.translate import Translator
from cellwatt.record.messages import simple
from tests.daemon.outlets.foxglove.cell import LAYOUT, alarm, frames
from tests.daemon.outlets.foxglove.client import message_class
from tests.daemon.outlets.foxglove.moving import skeleton, tool, tool_of


def decoded(outgoing: Outgoing) -> Any:
    return message_class(outgoing.topic.schema_name, outgoing.topic.schema).FromString(outgoing.data)


def on(moments: list[Moment], topic: str) -> list[Outgoing]:
    return [out for moment in moments for out in moment.messages if out.topic.name == topic]


def test_each_frame_has_the_pose_of_its_encoders() -> None:
    told = on(list(Translator(lambda _: [skeleton()]).frames(frames())), "/tf")
    assert [out.time for out in told] == frames().time.tolist()
    for out, values in zip(told, frames().values, strict=True):
        assert tool_of(decoded(out)) == pytest.approx(tool(values[:6]), abs=1e-12)
        stamp = decoded(out).transforms[0].timestamp
        assert stamp.seconds * 10**9 + stamp.nanos == out.time


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


def test_other_channels_are_another_topic() -> None:
    translator = Translator()
    before = on(list(translator.frames(frames(0, 1))), "/frame")[0].topic
    fewer = replace(frames(1, 1), layout=Layout((FrameChannel("a.b", "W", "continuous", "linear"),), 50.0))
    fewer = replace(fewer, values=fewer.values[:, :1], quality=fewer.quality[:, :1], bound=fewer.bound[:, :1])
    moments = list(translator.frames(fewer))
    assert on(moments, "/frame")[0].topic != before
    assert len(on(moments, "/channels")) == 1


def test_an_alarm_is_a_line_when_it_is_raised_graver_or_over() -> None:
    translator = Translator()
    told = [alarm(1, "warning"), alarm(1, "warning"), alarm(1, "error"), alarm(1, "error", active=False)]
    lines = [on([translator.item(one)], "/log") for one in told]
    assert [[decoded(line).level for line in found] for found in lines] == [[3], [], [4], [2]]
    assert [found[0].over for found in lines if found] == [False, False, True]


def test_what_is_lost_is_a_line() -> None:
    (line,) = on([Translator().lost(5, "frame", 12)], "/log")
    assert decoded(line).message == "12 of frame did not arrive: the cell no longer has them"


def test_a_value_that_may_be_null_is_of_its_other_type() -> None:
    union = {"anyOf": [{"type": "integer"}, {"type": "null"}], "title": "Joint", "default": None}
    assert simple({"properties": {"joint": union}}) == {"properties": {"joint": {"title": "Joint", "type": "integer"}}}
    either = {"anyOf": [{"type": "integer"}, {"type": "string"}]}
    assert simple(either) == either
