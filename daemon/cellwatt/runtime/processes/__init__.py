"""The daemon as processes: one collects, one aligns, one judges for each chain of stages, one tells."""
