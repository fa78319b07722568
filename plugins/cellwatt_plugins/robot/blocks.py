"""Bayesian linear regression of several channels on blocks of columns, and what further blocks would add.

``regression`` has the law. Here the products of many blocks are kept, so that each candidate of a search costs only its
own. Correlated noise is met by a factor for each channel: a residual with a correlation factor f counts as N / f
samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
        """The columns (N, m) as they act on a channel; None where they do not."""
        if self.channel is None:
            return np.asarray(self.columns[:, channel])
        return self.columns if self.channel == channel else None

    def times(self, coefficients: Float, channels: int) -> Float:
        """Contribution (N, C) of the term to all channels."""
        if self.channel is None:
            return np.asarray(self.columns @ coefficients)
        out = np.zeros((len(self.columns), channels))
        out[:, self.channel] = self.columns @ coefficients
        return out


@dataclass(frozen=True)
class _Channel:
    """Columns of the fixed blocks that act on a channel, each row over its standard deviation, and their products."""

    places: NDArray[np.intp]
    columns: Float
    target: Float
    gram: Float
    pull: Float


@dataclass(frozen=True)
class Product:
    """A block's columns over their standard deviation at one channel, and their products."""

    channel: int
    columns: Float
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
        self.channels = [self._channel(c) for c in range(target.shape[1])]
        self._products: dict[Block, list[Product]] = {}

    def _channel(self, channel: int) -> _Channel:
        root = self.root[:, channel : channel + 1]
        used, parts = [np.empty(0, np.intp)], [np.empty((len(self.target), 0))]
        for block, place in zip(self.blocks, self.slices, strict=True):
            columns = block.of(channel)
            if columns is not None:
                there = np.flatnonzero(np.any(columns != 0, axis=0))
                used.append(place.start + there)
                parts.append(columns[:, there] * root)
        columns, target = np.concatenate(parts, axis=1), self.target[:, channel] * root[:, 0]
        return _Channel(np.concatenate(used), columns, target, columns.T @ columns, columns.T @ target)

    def products(self, blocks: Sequence[Block]) -> list[list[Product]]:
        """For each block its products with every channel that it acts on; blocks of a channel share the work."""
        out: list[list[Product]] = [[] for _ in blocks]
        for c, channel in enumerate(self.channels):
            acting = [(i, part) for i, block in enumerate(blocks) if (part := block.of(c)) is not None]
            if not acting:
                continue
            together = np.concatenate([part for _, part in acting], axis=1) * self.root[:, c : c + 1]
            cross, pull = channel.columns.T @ together, together.T @ channel.target
            start = 0
            for i, part in acting:
                span = slice(start, start + part.shape[1])
                columns = together[:, span]
                out[i].append(Product(c, columns, cross[:, span], columns.T @ columns, pull[span]))
                start = span.stop
        return out

    def kept_products(self, blocks: Sequence[Block]) -> list[list[Product]]:
        """``products``, remembered for blocks that are tried again and again."""
        new = [block for block in blocks if block not in self._products]
        self._products.update(zip(new, self.products(new), strict=True))
        return [self._products[block] for block in blocks]


def places(blocks: Sequence[Block], start: int) -> list[slice]:
    """Place of each block's coefficients, from ``start`` on."""
    out = []
    for block in blocks:
        out.append(slice(start, start + block.size))
        start += block.size
    return out


class Regression:
    """The design's blocks and further ``blocks`` together, each channel with its correlation ``factor`` (C,)."""

    def __init__(self, design: Design, blocks: Sequence[Block], factor: Float) -> None:
        self.design, self.blocks, self.factor = design, tuple(blocks), factor
        self.slices = places(self.blocks, design.size)
        self.size = self.slices[-1].stop if self.slices else design.size
        self._added = design.products(self.blocks)
        self._solve()

    def _solve(self) -> None:
        design, size = self.design, self.size
        information, right = np.zeros((size, size)), np.zeros(size)
        for channel, f in zip(design.channels, self.factor, strict=True):
            information[np.ix_(channel.places, channel.places)] += channel.gram / f
            right[channel.places] += channel.pull / f
        for i, place in enumerate(self.slices):
            for own in self._added[i]:
                f, channel = self.factor[own.channel], design.channels[own.channel]
                there = np.arange(place.start, place.stop)
                information[np.ix_(channel.places, there)] += own.cross / f
                information[np.ix_(there, channel.places)] += own.cross.T / f
                information[place, place] += own.gram / f
                right[place] += own.pull / f
                for before, mixed in self._mixed(own, i):
                    information[before, place] += mixed
                    information[place, before] += mixed.T
        prior = Prior.joined(*(block.prior for block in (*design.blocks, *self.blocks)))
        self._fit = Fit(Products(information, right), prior)
        self.coefficients = self._fit.coefficients
        self.fitted = self._predict()
        self.residual = design.target - self.fitted

    def _mixed(self, own: Product, count: int) -> list[tuple[slice, Float]]:
        """Products of a block's columns with those of the first ``count`` added blocks at the same channel."""
        f = self.factor[own.channel]
        return [
            (place, other.columns.T @ own.columns / f)
            for place, added in zip(self.slices[:count], self._added, strict=False)
            for other in added
            if other.channel == own.channel
        ]

    def _predict(self) -> Float:
        design = self.design
        out = np.zeros_like(design.target)
        for c, channel in enumerate(design.channels):
            out[:, c] = channel.columns @ self.coefficients[channel.places]
        for place, products in zip(self.slices, self._added, strict=True):
            for product in products:
                out[:, product.channel] += product.columns @ self.coefficients[place]
        return np.asarray(out / design.root)

    @property
    def covariance(self) -> Float:
        """Posterior covariance of all coefficients."""
        return self._fit.covariance

    def gain(self, block: Block) -> tuple[float, Float]:
        """Log evidence (nats) that a further block adds, and the coefficients (m,) that it would have."""
        return self.gains([block])[0]

    def gains(self, blocks: Sequence[Block], keep: bool = False) -> list[tuple[float, Float]]:
        """``gain`` of several blocks, each alone; ``keep`` their products for the next time."""
        if not blocks:
            return []
        products = self.design.kept_products(blocks) if keep else self.design.products(blocks)
        mixed = np.zeros((self.size, sum(b.size for b in blocks)))
        spans = places(blocks, 0)
        together = self._together()
        for span, acting in zip(spans, products, strict=True):
            for own in acting:
                f, (there, columns) = self.factor[own.channel], together[own.channel]
                mixed[self.design.channels[own.channel].places, span] += own.cross / f
                mixed[there, span] += columns.T @ own.columns / f
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

    def _together(self) -> list[tuple[NDArray[np.intp], Float]]:
        """The added blocks' columns of each channel, side by side, and the places of their coefficients."""
        out = []
        for c in range(len(self.factor)):
            acting = [
                (s, p) for s, added in zip(self.slices, self._added, strict=True) for p in added if p.channel == c
            ]
            there = np.concatenate([np.empty(0, np.intp), *(np.arange(s.start, s.stop) for s, _ in acting)])
            empty = np.empty((len(self.design.target), 0))
            out.append((there.astype(np.intp), np.concatenate([empty, *(p.columns for _, p in acting)], axis=1)))
        return out
