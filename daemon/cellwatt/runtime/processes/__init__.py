"""The daemon's processes: *collect*, *align*, a *judge* for each chain of stages, and *tell*, which publishes."""
