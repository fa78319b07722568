"""The live side of models: frames in, predictions out."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, FilePath

from cellwatt.frames import Frames, Layout
from cellwatt.quantity import Fraction
from cellwatt.results import Prediction, Result
from cellwatt.stage import CellInfo, Stage, StageSettings
from cellwatt_plugins.models.fits_cell import check_rate, check_robot, columns
from cellwatt_plugins.models.network import Network
from cellwatt_plugins.models.outside import OUTSIDE, RangeWatch
from cellwatt_plugins.models.window import Window

CLEAR = 1.0
"""Time in s for which an input must be back in its range before its alarm is cleared."""


class ModelSettings(StageSettings):
    """Runs an ONNX file on the frames; a file that does not fit the cell is refused."""

    file: FilePath
    """ONNX file with cellwatt's metadata."""
    source: str | None = None
    """Source whose channels are used if several sources have an input of the model."""
    outside: Fraction = Field(OUTSIDE, ge=0)
    """Share of its training range by which an input may leave the range without an alarm."""


class ModelStage(Stage[ModelSettings]):
    """Gives a ``Prediction`` for each block of frames, and alarms ``model_outside_range``, one per input.

    A model with a ``delay`` predicts a frame when that number of later frames has come; its predictions carry the
    sequence and times of the frames that they are for. The prediction is NaN for a frame without a required input, or
    without a complete window.
    """

    Settings = ModelSettings
    title = "predictions of an ONNX model, checked against the cell's channels, units, robot and rate"

    def __init__(self, name: str, settings: ModelSettings, layout: Layout, cell: CellInfo) -> None:
        super().__init__(name, settings, layout, cell)
        path = cell.folder / settings.file
        self._network = Network(path)
        self.metadata = self._network.metadata
        check_robot(self.metadata, cell, path)
        check_rate(self.metadata, layout.rate, path)
        found = columns(self.metadata, layout, settings.source, path)
        self._given = [i for i, column in enumerate(found) if column is not None]
        self._columns = np.array([column for column in found if column is not None])
        needed = np.array([not wanted.optional for wanted in self.metadata.inputs])
        self._window = Window(self.metadata.window, needed, layout.step)
        self._units = {output.name: output.unit for output in self.metadata.outputs}
        channels = [layout.channels[column] for column in self._columns.tolist()]
        ranges = np.array(self.metadata.training.range)[self._given]
        self._behind: list[tuple[int, int]] = []
        """Sequence and time of the newest frames, which are not predicted yet."""
        patience = max(1, round(CLEAR * layout.rate))
        self._ranges = RangeWatch(name, self.metadata.name, channels, ranges, settings.outside, patience)

    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        """The predictions for this block, and the alarms that it changed."""
        if not len(frames):
            return ()
        values = frames.values[:, self._columns]
        outputs = self._predict(frames.time, values)
        alarms = self._ranges.update(frames.time, values)
        known = [*self._behind, *enumerate(frames.time.tolist(), start=frames.sequence)]
        ready = max(0, len(known) - self.metadata.delay)
        self._behind = known[ready:]
        given = outputs[len(outputs) - ready :]
        # Frames may have been skipped since the last block: a prediction is of consecutive frames.
        edges = [i for i in range(1, ready) if known[i][0] != known[i - 1][0] + 1]
        parts = [slice(*ends) for ends in pairwise([0, *edges, ready]) if ready]
        return [*(self._prediction(known[part], given[part]) for part in parts), *alarms]

    def _prediction(self, frames: Sequence[tuple[int, int]], outputs: NDArray[np.float64]) -> Prediction:
        """The prediction of consecutive frames (n), by their sequences and times."""
        return Prediction(
            model=self.name,
            sequence=frames[0][0],
            time=tuple(time for _, time in frames),
            outputs={name: tuple(column) for name, column in zip(self._units, outputs.T.tolist(), strict=True)},
            units=self._units,
        )

    def _predict(self, time: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Outputs (n, outputs), NaN where an input of the model was incomplete."""
        if len(self._given) < len(self.metadata.inputs):
            given, values = values, np.full((len(values), len(self.metadata.inputs)), np.nan)
            values[:, self._given] = given
        rows, inputs = self._window.update(time, self._network.cast(values))
        if len(rows) == len(values):
            return self._network.run(inputs)
        outputs = np.full((len(values), len(self._units)), np.nan)
        if len(rows):
            outputs[rows] = self._network.run(inputs)
        return outputs
