"""Faults judged interval by interval, while the cell runs: power and encoders against the healthy reference."""
