"""Bayesian linear regression of several channels on blocks of columns, and what further blocks would add.

``regression`` defines the law. Here the products of many blocks are cached, so that each candidate of a search costs
only its own products. A factor of each channel accounts for correlated noise: a residual with a correlation factor f
counts as N / f samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.robot.regression import Fit, Prior, Products, log_evidence


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
        """Return the columns (N, m) that act on a ``channel``; None if the block does not act on it."""
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
    """Columns of the blocks that act on one channel, each row divided by its standard deviation, and their products."""

    places: NDArray[np.intp]
    """Positions of the columns' coefficients among all coefficients of the design."""
    columns: Float
    products: Products


@dataclass(frozen=True)
class _Product:
    """A block's columns at one channel, and their products, each row divided by its standard deviation."""

    columns: Float
    """The columns as the block holds them, not divided by the standard deviation."""
    cross: Float
    """Products with the design's columns."""
    gram: Float
    pull: Float
    """Products with the target."""


class Design:
    """``target`` (N, C) with ``variance`` (N, C) and the blocks of every fit; their products are computed once."""

    def __init__(self, target: Float, variance: Float, blocks: Sequence[Block]) -> None:
        self.target, self.blocks = target, tuple(blocks)
        self.root = 1 / np.sqrt(variance)
        self.slices = places(self.blocks, 0)
        self.size = self.slices[-1].stop if self.slices else 0
        self.channels = self._by_channel()
        self._nothing_known()

    def _nothing_known(self) -> None:
        self._products = WeakKeyDictionary[Block, dict[int, _Product]]()
        self._pairs = WeakKeyDictionary[Block, WeakKeyDictionary[Block, dict[int, Float]]]()

    def of_rows(self, rows: NDArray[np.intp]) -> Design:
        """Return the design of some ``rows`` alone; further blocks must have these rows alone, too."""
        new = copy(self)
        new.target, new.root = self.target[rows], self.root[rows]
        columns = [(channel.places, channel.columns[rows]) for channel in self.channels]
        new.channels = [new._channel(c, *each) for c, each in enumerate(columns)]
        new._nothing_known()
        return new

    def with_priors(self, priors: Sequence[Prior]) -> Design:
        """Return the same design with other ``priors`` of its blocks; the products are shared."""
        new = copy(self)
        new.blocks = tuple(replace(block, prior=prior) for block, prior in zip(self.blocks, priors, strict=True))
        return new

    def _by_channel(self) -> list[_Channel]:
        """Weighted columns and products of the blocks at each channel."""
        out = []
        for c in range(self.target.shape[1]):
            root = self.root[:, c : c + 1]
            used, parts = [np.empty(0, np.intp)], [np.empty((len(self.target), 0))]
            for block, place in zip(self.blocks, self.slices, strict=True):
                columns = block.of(c)
                if columns is not None:
                    there = np.flatnonzero(np.any(columns != 0, axis=0))
                    used.append(place.start + there)
                    parts.append(columns[:, there] * root)
            out.append(self._channel(c, np.concatenate(used), np.concatenate(parts, axis=1)))
        return out

    def _channel(self, c: int, positions: NDArray[np.intp], columns: Float) -> _Channel:
        target = self.target[:, c] * self.root[:, c]
        return _Channel(positions, columns, Products(columns.T @ columns, columns.T @ target, float(target @ target)))

    def products(self, blocks: Sequence[Block]) -> list[dict[int, _Product]]:
        """Return each block's products with every channel that it acts on; blocks of a channel share the work."""
        out: list[dict[int, _Product]] = [{} for _ in blocks]
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
                out[i][c] = _Product(part, cross[:, span], columns.T @ columns, pull[span])
                start = span.stop
        return out

    def kept_products(self, blocks: Sequence[Block]) -> list[dict[int, _Product]]:
        """Return ``products``, cached as long as the blocks exist: a search tries the same blocks many times."""
        new = [block for block in blocks if block not in self._products]
        self._products.update(zip(new, self.products(new), strict=True))
        return [self._products[block] for block in blocks]

    def pair(self, one: Block, other: Block) -> dict[int, Float]:
        """Return the products of two blocks' columns at each channel that both act on, cached as long as both exist."""
        known = self._pairs.setdefault(one, WeakKeyDictionary())
        if other not in known:
            parts = {c: (one.of(c), other.of(c)) for c in range(self.target.shape[1])}
            weight = np.square(self.root)
            known[other] = {
                c: (a.T * weight[:, c]) @ b for c, (a, b) in parts.items() if a is not None and b is not None
            }
        return known[other]

    def equations(self, blocks: Sequence[Block]) -> list[tuple[NDArray[np.intp], Products]]:
        """Return the normal equations at each channel, of the design and further ``blocks``.

        With the positions of their coefficients: the design's come first, then those of the blocks.
        """
        everywhere, known, out = places(blocks, self.size), self.kept_products(blocks), []
        for c, fixed in enumerate(self.channels):
            acting = [(b, s, own[c]) for b, s, own in zip(blocks, everywhere, known, strict=True) if c in own]
            at = np.concatenate([fixed.places, *(np.arange(s.start, s.stop) for _, s, _ in acting)])
            gram, pull = np.zeros((len(at), len(at))), np.zeros(len(at))
            first, products = slice(0, len(fixed.places)), fixed.products
            gram[first, first], pull[first] = products.gram, products.pull
            before: list[tuple[Block, slice]] = []
            for (block, _, own), here in zip(acting, places([b for b, _, _ in acting], first.stop), strict=True):
                gram[here, here], pull[here] = own.gram, own.pull
                for there, cross in [(first, own.cross), *((s, self.pair(b, block)[c]) for b, s in before)]:
                    gram[there, here], gram[here, there] = cross, cross.T
                before.append((block, here))
            out.append((at, Products(gram, pull, products.square)))
        return out

    def fitted(self, blocks: Sequence[Block], coefficients: Float) -> Float:
        """Return the values (N, C) that ``coefficients`` give, the design's and those of further ``blocks``."""
        out = np.column_stack([c.columns @ coefficients[c.places] for c in self.channels]) / self.root
        for block, place in zip(blocks, places(blocks, self.size), strict=True):
            own = slice(None) if block.channel is None else block.channel
            out[:, own] += block.columns @ coefficients[place]
        return out


def together(equations: Sequence[tuple[NDArray[np.intp], Products]], factor: Float, size: int) -> Products:
    """Return the normal equations of all channels, whose residuals have the correlation ``factor`` (C,)."""
    gram, pull = np.zeros((size, size)), np.zeros(size)
    for (at, own), f in zip(equations, factor, strict=True):
        gram[np.ix_(at, at)] += own.gram / f
        pull[at] += own.pull / f
    return Products(gram, pull)


def places(blocks: Sequence[Block], start: int) -> list[slice]:
    """Return the slice of each block's coefficients; the first one begins at ``start``."""
    out = []
    for block in blocks:
        out.append(slice(start, start + block.size))
        start += block.size
    return out


class Regression:
    """Fit of the design's blocks and further ``blocks`` together, each channel with its correlation ``factor`` (C,).

    Raises ``numpy.linalg.LinAlgError`` where data and priors do not determine the coefficients.
    """

    def __init__(self, design: Design, blocks: Sequence[Block], factor: Float) -> None:
        self.design, self.blocks, self.factor = design, tuple(blocks), factor
        self.slices = places(self.blocks, design.size)
        self.size = self.slices[-1].stop if self.slices else design.size
        prior = Prior.joined(*(block.prior for block in (*design.blocks, *self.blocks)))
        self._fit = Fit(together(design.equations(self.blocks), factor, self.size), prior)
        self.coefficients = self._fit.coefficients
        self.residual = design.target - design.fitted(self.blocks, self.coefficients)

    @property
    def covariance(self) -> Float:
        """Posterior covariance of all coefficients."""
        return self._fit.covariance

    def added(self, part: slice) -> float:
        """Return the log evidence (nats) that the coefficients in ``part`` add to the other coefficients of this
        fit."""
        return self._fit.gain(part)

    @cached_property
    def _weighed(self) -> list[tuple[NDArray[np.intp], Float]]:
        """Coefficients' positions, and rows divided by their variance, of the added blocks' columns at each channel."""
        out = []
        for c in range(len(self.design.channels)):
            acting = [(p, part) for b, p in zip(self.blocks, self.slices, strict=True) if (part := b.of(c)) is not None]
            there = [np.arange(place.start, place.stop) for place, _ in acting]
            rows = [(part * self.design.root[:, c : c + 1] ** 2).T for _, part in acting]
            out.append((np.concatenate([np.empty(0, np.intp), *there]), np.vstack(rows) if rows else np.empty(0)))
        return out

    def gain(self, block: Block) -> tuple[float, Float]:
        """Return the log evidence (nats) that a further block adds, and its coefficients (m,) in that fit."""
        return self.gains([block])[0]

    def gains(self, blocks: Sequence[Block], keep: bool = False) -> list[tuple[float, Float]]:
        """Return the ``gain`` of several blocks, each added alone; ``keep`` caches their products for the next call."""
        if not blocks:
            return []
        products = self.design.kept_products(blocks) if keep else self.design.products(blocks)
        mixed = np.zeros((self.size, sum(b.size for b in blocks)))
        spans = places(blocks, 0)
        for span, acting in zip(spans, products, strict=True):
            for c, own in acting.items():
                mixed[self.design.channels[c].places, span] += own.cross / self.factor[c]
                there, rows = self._weighed[c]
                if len(there):
                    mixed[there, span] += rows @ own.columns / self.factor[c]
        target = np.concatenate([sum(own.pull / self.factor[c] for c, own in acting.items()) for acting in products])
        pull = target - mixed.T @ self.coefficients
        every = self._fit.solved(mixed)
        out: list[tuple[float, Float] | None] = [None] * len(blocks)
        for size in {b.size for b in blocks}:
            same = [i for i, b in enumerate(blocks) if b.size == size]
            own_gram = np.stack([sum(own.gram / self.factor[c] for c, own in products[i].items()) for i in same])
            columns = np.concatenate([np.arange(spans[i].start, spans[i].stop) for i in same])
            left, right = (part[:, columns].reshape(-1, len(same), size).transpose(1, 0, 2) for part in (mixed, every))
            information = own_gram - left.transpose(0, 2, 1) @ right
            gain, mean = log_evidence(information, pull[columns].reshape(-1, size), [blocks[i].prior for i in same])
            for i, g, m in zip(same, gain, mean, strict=True):
                out[i] = float(g), m
        return [each for each in out if each is not None]
