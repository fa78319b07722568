"""Finds faults by interval while the cell runs: compares power and encoders with the healthy reference."""
