"""Names the faulty joint or encoder by comparing supply power and positions with healthy cycles (Sabry et al.).

learn, reference   the healthy reference: learned, and as a file
cycles             judges whole cycles by the physics of the arm, described or bare
paper              the method of the paper as published
"""

from cellwatt_plugins.faults.stage import FaultsSettings, FaultsStage

__all__ = ["FaultsSettings", "FaultsStage"]
