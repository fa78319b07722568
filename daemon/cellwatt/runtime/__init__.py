"""Runs a cell: sources, frames, stages, record and outlets, each contained."""
