"""Runs a cell: sources, frames, stages, record and sinks, each contained."""
