"""Rows of a recording as a data frame of pandas or polars, or as an Arrow table."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from importlib.util import find_spec
from typing import Any, Literal

import pyarrow as pa

from cellwatt.errors import CellwattError
from cellwatt.frames import Frames, Layout
from cellwatt.record.header import Header
from cellwatt.record.tables import about

Library = Literal["pandas", "polars", "arrow"]


def data_frame(rows: pa.RecordBatch, header: Header, start: int, library: Library | None) -> Any:
    """A data frame of ``library``; by default of pandas, else polars, else Arrow, whichever is installed.

    Units by column are in ``attrs["units"]`` (pandas) or in the fields' metadata (Arrow); polars keeps none.
    Raises ``CellwattError`` where ``library`` is not installed.
    """
    library = library or next((name for name in ("pandas", "polars") if find_spec(name)), "arrow")
    table = pa.Table.from_batches([rows]).replace_schema_metadata({"cellwatt": json.dumps(about(header, start))})
    try:
        if library == "pandas":
            frame = table.to_pandas(ignore_metadata=True)
            units = {f.name: f.metadata[b"unit"].decode() for f in table.schema if f.metadata}
            frame.attrs = {**about(header, start), "units": units}
            return frame
        if library == "polars":
            import polars

            return polars.from_arrow(table)
    except ImportError as error:
        raise CellwattError(f"library={library!r} is not installed: pip install {library}") from error
    return table


def of_channels(frames: Frames, wanted: Sequence[str]) -> Frames:
    """Frames of the channels that are ``wanted`` by name or pattern. Raises ``ConfigError``."""
    layout = frames.layout
    found = [[i for i, c in enumerate(layout.names) if fnmatchcase(c, n)] or [layout.index(n)] for n in wanted]
    columns = [i for each in found for i in each]
    chosen = Layout(tuple(layout.channels[i] for i in columns), layout.rate)
    return replace(
        frames, layout=chosen, **{name: getattr(frames, name)[:, columns] for name in ("values", "quality", "bound")}
    )
