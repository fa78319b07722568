"""Reads Parquet files that others wrote, checked before they are unpacked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from cellwatt.files import COMPUTED, UnfitFileError, check_file

if TYPE_CHECKING:
    import pyarrow as pa

LARGEST: Final = 4_000_000_000
"""Bytes in memory; a file of some kB may unpack to any number."""


def read_parquet(path: Path) -> pa.Table:
    """Read all columns of a file. Raises ``OSError``, also if it is too large, and pyarrow's errors."""
    import pyarrow.parquet as pq

    check_file(path, COMPUTED)
    about = pq.read_metadata(path)
    packed = sum(about.row_group(i).total_byte_size for i in range(about.num_row_groups))
    if max(8 * about.num_rows * about.num_columns, packed) > LARGEST:
        raise UnfitFileError(f"would take more than {LARGEST:,} bytes of memory")
    return pq.read_table(path)
