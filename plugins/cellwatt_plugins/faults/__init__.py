"""Says which joint or encoder is faulty, from supply power and encoders against healthy cycles (Sabry et al.)."""

from cellwatt_plugins.faults.stage import FaultsSettings, FaultsStage

__all__ = ["FaultsSettings", "FaultsStage"]
