"""The live side of models: frames in, predictions out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, FilePath

from cellwatt.frames import Frames, Layout
from cellwatt.quantity import Fraction
from cellwatt.results import Prediction, Result
from cellwatt.stage import CellInfo, Stage, StageSettings
from cellwatt_plugins.model.fit import check_rate, check_robot, columns
from cellwatt_plugins.model.network import open_network
from cellwatt_plugins.model.outside import Limits, RangeWatch
from cellwatt_plugins.model.window import Window

CLEAR = 1.0
"""Time for which an input must be back in its range before its alarm is cleared, s."""


class ModelSettings(StageSettings):
    """Runs an ONNX file on the frames; it is refused where it does not fit the cell."""

    file: FilePath
    """ONNX file with cellwatt's metadata."""
    source: str | None = None
    """Source whose channels are meant where several give an input of the model."""
    outside: Fraction = Field(0.05, ge=0)
    """How far an input may leave the range of the training, as a share of its width, before it is told."""


class ModelStage(Stage[ModelSettings]):
    """Gives a ``Prediction`` for each block of frames, and alarms ``model_outside_range``, one an input.

    A frame whose inputs are not all there, or whose window is not whole, has NaN for a prediction.
    """

    Settings = ModelSettings
    title = "predictions of an ONNX model, checked against the cell's channels, units, robot and rate"

    def __init__(self, name: str, settings: ModelSettings, layout: Layout, cell: CellInfo) -> None:
        super().__init__(name, settings, layout, cell)
        path = cell.folder / settings.file
        self._network = open_network(path)
        self.metadata = self._network.metadata
        check_robot(self.metadata, cell.robot, path)
        check_rate(self.metadata, layout.rate, path)
        self._columns = np.array(columns(self.metadata, layout, settings.source, path))
        self._window = Window(self.metadata.window, len(self._columns), layout.step)
        self._units = {output.name: output.unit for output in self.metadata.outputs}
        limits = [
            Limits(layout.channels[column], low, high)
            for column, (low, high) in zip(self._columns.tolist(), self.metadata.training.range, strict=True)
        ]
        patience = max(1, round(CLEAR * layout.rate))
        self._ranges = RangeWatch(name, self.metadata.name, limits, settings.outside, patience)

    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        """The predictions for this block, and the alarms that changed with it."""
        if not len(frames):
            return ()
        values = frames.values[:, self._columns]
        outputs = self._predict(frames.time, values).T.tolist()
        prediction = Prediction(
            model=self.name,
            sequence=frames.sequence,
            time=tuple(frames.time.tolist()),
            outputs={name: tuple(column) for name, column in zip(self._units, outputs, strict=True)},
            units=self._units,
        )
        return [prediction, *self._ranges.update(frames.time, values)]

    def _predict(self, time: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Outputs (n, outputs), NaN where the model did not see a whole input."""
        rows, inputs = self._window.update(time, self._network.cast(values))
        if len(rows) == len(values):
            return self._network.run(inputs)
        outputs = np.full((len(values), len(self._units)), np.nan)
        if len(rows):
            outputs[rows] = self._network.run(inputs)
        return outputs
