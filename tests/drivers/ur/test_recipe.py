"""What is asked for, and columns from data packages."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt.align import Aligner
from cellwatt.batch import Batch
from cellwatt.channel import Stream
from cellwatt.errors import ProtocolError
from cellwatt_drivers.ur.fields import FIELDS
from cellwatt_drivers.ur.recipe import Decoder, Selection
from cellwatt_drivers.ur.wire import ELEMENTS, ControllerVersion

STRUCT = {"u1": "B", ">u4": "I", ">u8": "Q", ">i4": "i", ">f8": "d"}
OFFERED = sorted(name for name, field in FIELDS.items() if field.channels)


def one_by_one(data: bytes, types: list[str]) -> list[tuple[float, ...]]:
    """All elements of all packages by struct, without the header."""
    form = struct.Struct(">4x" + "".join(STRUCT[ELEMENTS[t][0]] * ELEMENTS[t][1] for t in types))
    return list(form.iter_unpack(data))


def packages(types: list[str], n: int, seed: int) -> bytes:
    """n data packages of recipe 7 with random contents, by struct."""
    chance = np.random.default_rng(seed)
    form = struct.Struct(">HBB" + "".join(STRUCT[ELEMENTS[t][0]] * ELEMENTS[t][1] for t in types))
    out = []
    for i in range(n):
        row: list[float] = [form.size, ord("U"), 7, 1000.0 + i]
        for t in types[1:]:
            code, width = ELEMENTS[t]
            if code == ">f8":
                row += chance.normal(size=width).tolist()
            else:
                row += chance.integers(0, 2 if code == "u1" else 2**31, width).tolist()
        out.append(form.pack(*row))
    return b"".join(out)


@given(st.lists(st.sampled_from(OFFERED), min_size=1, max_size=14, unique=True), st.integers(1, 40), st.integers(0, 99))
def test_decoding_many_equals_struct_one_by_one(fields, n, seed):
    selection = Selection.of(fields)
    types = [FIELDS[name].type for name in selection.names]
    data = packages(types, n, seed)
    decoder = Decoder(selection, 7, types)
    assert decoder.package.size * n == len(data)
    time, values = decoder.decode(memoryview(data), n)
    scales = [FIELDS[name].scale for name in fields for _ in range(FIELDS[name].width)]
    expected = np.array(one_by_one(data, types))
    assert time.tolist() == expected[:, 0].tolist()
    assert values.shape == (n, len(selection.channels))
    np.testing.assert_array_equal(values, expected[:, 1:] * scales)


@given(
    st.lists(st.sampled_from([f"joint_{i}.{q}" for i in range(1, 7) for q in ("position", "current")]), unique=True),
    st.integers(0, 9),
)
def test_single_channels_are_picked(channels, seed):
    selection = Selection.of([*channels, "robot_mode", "bus.power"])
    types = [FIELDS[name].type for name in selection.names]
    data = packages(types, 5, seed)
    _, values = Decoder(selection, 7, types).decode(memoryview(data), 5)
    rows = np.array(one_by_one(data, types))
    table = {}
    at = 0
    for name in selection.names:
        for i in range(FIELDS[name].width):
            table[name, i] = rows[:, at]
            at += 1
    for column, channel in zip(values.T, selection.channels, strict=True):
        if channel.name == "bus.power":
            expected = table["actual_robot_voltage", 0] * table["actual_robot_current", 0]
        else:
            field = next(f for f in selection.fields if channel in f.channels)
            expected = table[field.name, field.channels.index(channel)]
        np.testing.assert_array_equal(column, expected)
    assert {c.name for c in selection.channels} == {*channels, "robot.mode", "bus.power"}


def test_milliampere_leave_as_ampere():
    decoder = Decoder(Selection.of(["io_current"]), 1, ("DOUBLE", "DOUBLE"))
    _, values = decoder.decode(memoryview(struct.pack(">HBB2d", 20, 85, 1, 1.0, 250.0)), 1)
    assert values.tolist() == [[0.25]]


@pytest.mark.parametrize("types", [("DOUBLE",), ("DOUBLE", "NOT_FOUND")])
def test_types_that_do_not_fit_the_question_are_refused(types):
    with pytest.raises(ProtocolError, match="declares"):
        Decoder(Selection.of(["actual_q"]), 1, types)


@pytest.mark.parametrize(
    ("version", "known", "unknown"),
    [
        ((5, 5, 1), "payload payload_cog", "ft_raw_wrench payload_inertia"),
        ((5, 23, 0), "payload actual_current_as_torque", ""),
        ((3, 15, 0), "payload payload_inertia", "ft_raw_wrench actual_current_as_torque"),
        ((10, 11, 0), "actual_current_as_torque", ""),
    ],
)
def test_versions_know_their_fields(version, known, unknown):
    controller = ControllerVersion(*version, 0)
    assert all(FIELDS[n].served_by(controller) for n in known.split())
    assert not any(FIELDS[n].served_by(controller) for n in unknown.split())


def test_frames_have_no_orientation_between_two_that_flip_their_sign():
    pose, n = Stream("rtde", Selection.of(["actual_TCP_pose"]).channels, 500.0, "device"), 100
    time, flipping = np.arange(n) * 2_000_000 + 1_000_000, np.resize([np.pi, np.pi, -np.pi], (n, 1)).repeat(6, axis=1)
    none = np.zeros(n, np.int64)
    aligner = Aligner({"arm": (pose,)}, 50.0, 0.1)
    found = aligner.add(Batch("arm", pose, 0, int(time[-1]), time, none, flipping, none.astype(np.uint8)))
    values = np.concatenate([f.values for f in found])
    assert set(np.abs(values[:, 3:]).ravel()) == {np.pi}
    assert (np.abs(values[1:, :3]) < 3).any(), "positions are interpolated"
