"""Mean power over the utility's interval."""

from demand_stage.stage import DemandSettings, DemandStage

__all__ = ["DemandSettings", "DemandStage"]
