"""Power analyzers with SCPI commands: R&S HMC8015, Yokogawa WT300, ZES Zimmer LMG600."""

from cellwatt_drivers.scpi_analyzer.driver import ScpiAnalyzerDriver, ScpiAnalyzerSettings

__all__ = ["ScpiAnalyzerDriver", "ScpiAnalyzerSettings"]
