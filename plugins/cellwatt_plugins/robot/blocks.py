"""Bayesian linear regression of several channels on blocks of columns, and what further blocks would add.

``regression`` has the law. Here the products of many blocks are kept, so that each candidate of a search costs only its
own. Correlated noise is met by a factor for each channel: a residual with a correlation factor f counts as N / f
samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.robot.regression import Fit, Float, Prior, Products, log_evidence


@dataclass(frozen=True, eq=False)
class Block:
    """Columns of one term: (N, m) acting on one ``channel``, or (N, C, m) acting on all (``channel`` None)."""

    columns: Float
    channel: int | None
    prior: Prior

    @property
    def size(self) -> int:
        """Number of coefficients, m."""
        return int(self.columns.shape[-1])

    def of(self, channel: int) -> Float | None:
        """Return the columns (N, m) as they act on a channel; None where they do not."""
        if self.channel is None:
            return np.asarray(self.columns[:, channel])
        return self.columns if self.channel == channel else None

    def times(self, coefficients: Float, channels: int) -> Float:
        """Return what the term adds to all channels, (N, C)."""
        if self.channel is None:
            return np.asarray(self.columns @ coefficients)
        out = np.zeros((len(self.columns), channels))
        out[:, self.channel] = self.columns @ coefficients
        return out


@dataclass(frozen=True)
class _Channel:
    """Columns of blocks that act on a channel, each row over its standard deviation, and their products."""

    places: NDArray[np.intp]
    """Of their coefficients among all."""
    columns: Float
    gram: Float
    pull: Float
    """With the target."""


@dataclass(frozen=True)
class _Product:
    """A block's columns at one channel, and the products of these over their standard deviation."""

    channel: int
    columns: Float
    """As they are in the block, which has them anyway."""
    cross: Float
    """With the design's columns."""
    gram: Float
    pull: Float
    """With the target."""


class Design:
    """``target`` (N, C) with ``variance`` (N, C) and the blocks that are always there; their products are kept."""

    def __init__(self, target: Float, variance: Float, blocks: Sequence[Block]) -> None:
        self.target, self.blocks = target, tuple(blocks)
        self.root = 1 / np.sqrt(variance)
        self.slices = places(self.blocks, 0)
        self.size = self.slices[-1].stop if self.slices else 0
        self.channels = self.by_channel(self.blocks, self.slices)
        self._products: dict[Block, list[_Product]] = {}

    def with_priors(self, priors: Sequence[Prior]) -> Design:
        """Return the same design where its blocks have other ``priors``; its products are shared."""
        new = copy(self)
        new.blocks = tuple(replace(block, prior=prior) for block, prior in zip(self.blocks, priors, strict=True))
        return new

    def by_channel(self, blocks: Sequence[Block], slices: Sequence[slice]) -> list[_Channel]:
        """Return the columns of ``blocks`` at each channel; ``slices`` are the places of their coefficients."""
        out = []
        for c in range(self.target.shape[1]):
            root = self.root[:, c : c + 1]
            used, parts = [np.empty(0, np.intp)], [np.empty((len(self.target), 0))]
            for block, place in zip(blocks, slices, strict=True):
                columns = block.of(c)
                if columns is not None:
                    there = np.flatnonzero(np.any(columns != 0, axis=0))
                    used.append(place.start + there)
                    parts.append(columns[:, there] * root)
            columns = np.concatenate(parts, axis=1)
            pull = columns.T @ (self.target[:, c] * root[:, 0])
            out.append(_Channel(np.concatenate(used), columns, columns.T @ columns, pull))
        return out

    def products(self, blocks: Sequence[Block]) -> list[list[_Product]]:
        """Return each block's products with every channel that it acts on; blocks of a channel share the work."""
        out: list[list[_Product]] = [[] for _ in blocks]
        for c, channel in enumerate(self.channels):
            acting = [(i, part) for i, block in enumerate(blocks) if (part := block.of(c)) is not None]
            if not acting:
                continue
            together = np.concatenate([part for _, part in acting], axis=1) * self.root[:, c : c + 1]
            cross, pull = channel.columns.T @ together, together.T @ (self.target[:, c] * self.root[:, c])
            start = 0
            for i, part in acting:
                span = slice(start, start + part.shape[1])
                columns = together[:, span]
                out[i].append(_Product(c, part, cross[:, span], columns.T @ columns, pull[span]))
                start = span.stop
        return out

    def kept_products(self, blocks: Sequence[Block]) -> list[list[_Product]]:
        """Return ``products``, remembered for blocks that are tried again and again."""
        new = [block for block in blocks if block not in self._products]
        self._products.update(zip(new, self.products(new), strict=True))
        return [self._products[block] for block in blocks]


def places(blocks: Sequence[Block], start: int) -> list[slice]:
    """Return the place of each block's coefficients, from ``start`` on."""
    out = []
    for block in blocks:
        out.append(slice(start, start + block.size))
        start += block.size
    return out


class Regression:
    """Fit of the design's blocks and further ``blocks`` together, each channel with its correlation ``factor`` (C,).

    Raises ``numpy.linalg.LinAlgError`` where data and priors do not determine the coefficients.
    """

    def __init__(self, design: Design, blocks: Sequence[Block], factor: Float, alike: Regression | None = None) -> None:
        """``alike`` is a fit of the same blocks with another factor: their products are not made again."""
        self.design, self.blocks, self.factor = design, tuple(blocks), factor
        self.slices = places(self.blocks, design.size)
        self.size = self.slices[-1].stop if self.slices else design.size
        self._added: list[_Channel] = design.by_channel(self.blocks, self.slices) if alike is None else alike._added
        self._crosses: list[Float] = (
            [fixed.columns.T @ added.columns for fixed, added in zip(design.channels, self._added, strict=True)]
            if alike is None
            else alike._crosses
        )
        information, right = np.zeros((self.size, self.size)), np.zeros(self.size)
        for fixed, added, cross, f in zip(design.channels, self._added, self._crosses, factor, strict=True):
            there = np.concatenate([fixed.places, added.places])
            information[np.ix_(there, there)] += np.block([[fixed.gram, cross], [cross.T, added.gram]]) / f
            right[there] += np.concatenate([fixed.pull, added.pull]) / f
        prior = Prior.joined(*(block.prior for block in (*design.blocks, *self.blocks)))
        self._fit = Fit(Products(information, right), prior)
        self.coefficients = self._fit.coefficients
        parts = [
            sum(each.columns @ self.coefficients[each.places] for each in both)
            for both in zip(design.channels, self._added, strict=True)
        ]
        self.fitted = np.column_stack(parts) / design.root
        self.residual = design.target - self.fitted

    @property
    def covariance(self) -> Float:
        """Posterior covariance of all coefficients."""
        return self._fit.covariance

    def added(self, part: slice) -> float:
        """Return the log evidence (nats) that coefficients of this fit add to its others."""
        return self._fit.gain(part)

    @cached_property
    def _weighed(self) -> list[Float]:
        """Rows of the added blocks' columns at each channel, over their variance."""
        return [added.columns.T * self.design.root[:, c] for c, added in enumerate(self._added)]

    def gain(self, block: Block) -> tuple[float, Float]:
        """Return the log evidence (nats) that a further block adds, and the coefficients (m,) that it would have."""
        return self.gains([block])[0]

    def gains(self, blocks: Sequence[Block], keep: bool = False) -> list[tuple[float, Float]]:
        """Return the ``gain`` of several blocks, each alone; ``keep`` their products for the next time."""
        if not blocks:
            return []
        products = self.design.kept_products(blocks) if keep else self.design.products(blocks)
        mixed = np.zeros((self.size, sum(b.size for b in blocks)))
        spans = places(blocks, 0)
        for span, acting in zip(spans, products, strict=True):
            for own in acting:
                c = own.channel
                mixed[self.design.channels[c].places, span] += own.cross / self.factor[c]
                if len(self._added[c].places):
                    mixed[self._added[c].places, span] += self._weighed[c] @ own.columns / self.factor[c]
        target = np.concatenate([sum(own.pull / self.factor[own.channel] for own in acting) for acting in products])
        pull = target - mixed.T @ self.coefficients
        every = self._fit.solved(mixed)
        out: list[tuple[float, Float] | None] = [None] * len(blocks)
        for size in {b.size for b in blocks}:
            same = [i for i, b in enumerate(blocks) if b.size == size]
            own_gram = np.stack([sum(p.gram / self.factor[p.channel] for p in products[i]) for i in same])
            columns = np.concatenate([np.arange(spans[i].start, spans[i].stop) for i in same])
            left, right = (part[:, columns].reshape(-1, len(same), size).transpose(1, 0, 2) for part in (mixed, every))
            information = own_gram - left.transpose(0, 2, 1) @ right
            gain, mean = log_evidence(information, pull[columns].reshape(-1, size), [blocks[i].prior for i in same])
            for i, g, m in zip(same, gain, mean, strict=True):
                out[i] = float(g), m
        return [each for each in out if each is not None]
