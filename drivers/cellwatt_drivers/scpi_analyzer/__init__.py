"""Power analyzers that speak SCPI: R&S HMC8015, Yokogawa WT300, ZES Zimmer LMG600."""

from cellwatt_drivers.scpi_analyzer.driver import ScpiAnalyzerDriver, ScpiAnalyzerSettings

__all__ = ["ScpiAnalyzerDriver", "ScpiAnalyzerSettings"]
