"""Published recordings of others as recordings of cellwatt: column maps, readers of their files, a writer."""

from cellwatt.imports.column_map import ColumnMap, read_map, shipped_maps
from cellwatt.imports.parts import Part, read_parts
from cellwatt.imports.writing import write_recording

__all__ = ["ColumnMap", "Part", "read_map", "read_parts", "shipped_maps", "write_recording"]
