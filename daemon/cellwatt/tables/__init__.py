"""Reads tables: every command that takes a file of samples opens it here, with the same names and units."""

from cellwatt.tables.files import is_table, read_table, write_table
from cellwatt.tables.names import usual
from cellwatt.tables.table import Table, listed

__all__ = ["Table", "is_table", "listed", "read_table", "usual", "write_table"]
