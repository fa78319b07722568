"""Reads tables: every command that takes a file of samples opens it here, with the same names and units.

files     opens and writes files; ``encoding``, ``rows``, ``cells``, ``times`` and ``fractions`` read their text
table     a file by its columns and quantities
names     the quantity, joint and unit that a column name means
by_name   columns of named joints, in the robot's order
likely    guesses for unknown names, from the values
"""

from cellwatt.tables.files import is_table, read_table, write_table
from cellwatt.tables.names import usual
from cellwatt.tables.table import Table, listed

__all__ = ["Table", "is_table", "listed", "read_table", "usual", "write_table"]
