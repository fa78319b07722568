"""Evidence packs: what the record holds around an alarm becomes a file of its own, with a page.

keeper   notes the alarms that want a pack and has the packs made, one at a time
making   the process that makes one: cuts it out of the record and writes its page
"""

from cellwatt.runtime.evidence.keeper import Keeper

__all__ = ["Keeper"]
