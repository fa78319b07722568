"""The ways out of a cell: one folder each."""
