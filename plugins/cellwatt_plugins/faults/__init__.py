"""Names the faulty joint or encoder by comparing supply power and positions with healthy cycles (Sabry et al.)."""

from cellwatt_plugins.faults.stage import FaultsSettings, FaultsStage

__all__ = ["FaultsSettings", "FaultsStage"]
