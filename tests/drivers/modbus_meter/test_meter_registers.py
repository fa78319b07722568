from __future__ import annotations

from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt_drivers.modbus_meter.registers import LONGEST, Block, Slot, WordOrder, plan, width


@pytest.mark.parametrize(
    ("words", "kind", "order", "value"),
    [
        ((0x4366, 0x199A), "float32", "big", pytest.approx(230.10, abs=1e-5)),  # SDM630: 43 66 19 9A
        ((0x08FD, 0x0000), "int32", "little", 2301),  # EM340: 230.1 V
        ((0xFFFF, 0xFFFE), "int32", "big", -2),
        ((0x0003, 0x0002, 0x0001, 0x0000), "uint64", "little", 0x1_0002_0003),
        ((0x40C3, 0x8800, 0x0000, 0x0000), "float64", "big", 10000.0),
        ((0xFC18,), "int16", "little", -1000),
        ((0x6643, 0x9A19), "float32", "badc", pytest.approx(230.10, abs=1e-5)),
        ((0x9A19, 0x6643), "float32", "dcba", pytest.approx(230.10, abs=1e-5)),
    ],
)
def test_words_of_each_kind(words, kind, order, value):
    assert Block((Slot(7, kind, 0),), order).decode(words) == (value,)


def test_neighbours_are_read_together_and_gaps_only_as_allowed():
    slots = [Slot(a, "float32", i) for i, a in enumerate((10, 0, 2, 4, 20))]
    assert [(b.address, b.count) for b in plan(slots, 125, 0, "big")] == [(0, 6), (10, 2), (20, 2)]
    assert [(b.address, b.count) for b in plan(slots, 125, 4, "big")] == [(0, 12), (20, 2)]
    assert [(b.address, b.count) for b in plan(slots, 125, 8, "big")] == [(0, 22)]
    assert [(b.address, b.count) for b in plan(slots, 12, 8, "big")] == [(0, 12), (20, 2)]


def test_a_refused_block_is_split_at_gaps_first_then_value_by_value():
    (block,) = plan([Slot(a, "float32", i) for i, a in enumerate((0, 2, 8))], 125, 4, "big")
    first = block.split()
    assert [(b.address, b.count) for b in first] == [(0, 4), (8, 2)]
    assert [(b.address, b.count) for b in first[0].split()] == [(0, 2), (2, 2)]
    assert first[1].split() == ()


kinds = st.sampled_from(("int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64"))


@st.composite
def layouts(draw):
    address, slots = 0, []
    for column, kind in enumerate(draw(st.lists(kinds, min_size=1, max_size=20))):
        address += draw(st.integers(0, 30))
        slots.append(Slot(address, kind, column))
        address += width(kind)
    return slots


@given(layouts(), st.integers(4, LONGEST), st.integers(0, 40), st.sampled_from(get_args(WordOrder)))
def test_every_value_is_read_once_and_within_the_limits(slots, longest, gap, order):
    blocks = plan(slots, longest, gap, order)
    assert sorted(c for b in blocks for c in b.columns) == list(range(len(slots)))
    assert all(b.count <= longest for b in blocks)
    for block in blocks:
        ends = [s.end for s in block.slots]
        assert all(s.address - e <= gap for s, e in zip(block.slots[1:], ends, strict=False))


@given(layouts(), st.sampled_from(get_args(WordOrder)), st.data())
def test_what_is_encoded_is_decoded(slots, order, data):
    numbers = []
    for slot in slots:
        bits = 16 * width(slot.kind)
        if slot.kind.startswith("float"):
            numbers.append(data.draw(st.floats(allow_nan=False, width=bits)))
        else:
            low = 0 if slot.kind.startswith("u") else -(1 << (bits - 1))
            numbers.append(data.draw(st.integers(low, low + (1 << bits) - 1)))
    registers = [0] * slots[-1].end
    for block in plan(slots, LONGEST, 10, order):
        block.encode([numbers[c] for c in block.columns], registers, 0)
    for block in plan(slots, LONGEST, 0, order):
        found = block.decode(registers[block.address : block.address + block.count])
        assert list(found) == [numbers[c] for c in block.columns]
