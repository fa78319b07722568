"""Joins and cuts batches and frames by sequence number. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from cellwatt.batch import Batch
from cellwatt.frames import Frames

Block = TypeVar("Block", bound=Batch | Frames)


def join(blocks: Sequence[Block], limit: int) -> Block | None:
    """Join the first blocks, up to the first hole in their numbering and at most ``limit`` samples."""
    taken: list[Block] = []
    count = 0
    for block in blocks:
        if count >= limit or (taken and not follows(taken[-1], block)):
            break
        taken.append(block)
        count += len(block)
    return cut(concatenate(taken), 0, limit) if taken else None


def follows(first: Block, second: Block) -> bool:
    """True if ``second`` continues ``first`` without a hole and in the same form."""
    if isinstance(first, Batch) and isinstance(second, Batch):
        same = first.stream == second.stream and (first.device_time is None) == (second.device_time is None)
    else:
        same = isinstance(first, Frames) and isinstance(second, Frames) and first.layout == second.layout
    return same and second.sequence == first.sequence + len(first)


def concatenate(blocks: Sequence[Block]) -> Block:
    """Join consecutive blocks; a batch gets the ``arrival`` of the last one."""
    if len(blocks) == 1:
        return blocks[0]
    changed: dict[str, Any] = {n: np.concatenate([getattr(b, n) for b in blocks]) for n in _arrays(blocks[0])}
    if isinstance(blocks[-1], Batch):
        changed["arrival"] = blocks[-1].arrival
    return replace(blocks[0], **changed)


def cut(content: Block, first: int, last: int) -> Block:
    """Rows ``first`` … ``last`` of a block, with their own sequence number."""
    if first <= 0 and last >= len(content):
        return content
    first = max(first, 0)
    changed: dict[str, Any] = {name: getattr(content, name)[first:last] for name in _arrays(content)}
    return replace(content, sequence=content.sequence + first, **changed)


def _arrays(block: Batch | Frames) -> list[str]:
    return [f.name for f in fields(block) if f.init and isinstance(getattr(block, f.name), np.ndarray)]
