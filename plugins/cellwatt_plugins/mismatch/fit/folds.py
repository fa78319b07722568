"""Products of a design's rows fold by fold: a fit without one of them costs no second pass over the others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.robot.blocks import Block, Design, places
from cellwatt_plugins.robot.regression import Fit, Prior, Products

Float = NDArray[np.float64]

LEFT_OUT = 1e9
"""Factor on the variance of samples that do not count."""


class Folds:
    """A design whose rows belong to folds, ``fold`` (N,) counted from 0."""

    def __init__(self, design: Design, fold: NDArray[np.intp], count: int) -> None:
        self.design, self.fold, self.count = design, fold, count
        rows = [np.flatnonzero(fold == k) for k in range(count)]
        self._target = design.target * design.root
        self._grams, self._pulls = [], []
        for c, channel in enumerate(design.channels):
            parts = [channel.columns[at] for at in rows]
            self._grams.append([part.T @ part for part in parts])
            self._pulls.append([part.T @ self._target[at, c] for part, at in zip(parts, rows, strict=True)])

    def residual(self, blocks: list[Block], factor: Float) -> Float:
        """Residual (N, C) of each row in the fit of design and ``blocks`` that did not see its fold.

        ``factor`` (C,) is the correlation factor.
        """
        design = self.design
        slices = places(blocks, design.size)
        added = design.by_channel(blocks, slices)
        size = slices[-1].stop if slices else design.size
        information, right = np.zeros((self.count, size, size)), np.zeros((self.count, size))
        for c, (fixed, own) in enumerate(zip(design.channels, added, strict=True)):
            there = np.concatenate([fixed.places, own.places])
            for k in range(self.count):
                seen = own.columns * (self.fold == k)[:, None]
                cross = fixed.columns.T @ seen
                gram = np.block([[self._grams[c][k], cross], [cross.T, own.columns.T @ seen]]) / factor[c]
                pull = np.concatenate([self._pulls[c][k], seen.T @ self._target[:, c]]) / factor[c]
                information[k][np.ix_(there, there)] += gram
                right[k][there] += pull
        prior = Prior.joined(*(block.prior for block in (*design.blocks, *blocks)))
        found = np.column_stack(
            [Fit(Products(_without(information, k), _without(right, k)), prior).coefficients for k in range(self.count)]
        )
        out = np.empty_like(design.target)
        for c, both in enumerate(zip(design.channels, added, strict=True)):
            fitted = np.asarray(sum(each.columns @ found[each.places] for each in both))
            unseen = np.take_along_axis(fitted, self.fold[:, None], axis=1)[:, 0]
            out[:, c] = design.target[:, c] - unseen / design.root[:, c]
        return out


def _without(sums: Float, k: int) -> Float:
    """The sum over all folds in which number ``k`` counts next to nothing."""
    weight = np.where(np.arange(len(sums)) == k, 1 / LEFT_OUT, 1.0)
    return np.asarray(np.tensordot(weight, sums, axes=1))
