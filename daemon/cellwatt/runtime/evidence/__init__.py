"""Evidence packs: the recording around an alarm as a separate file, with a page.

keeper   notes the alarms that get a pack and has the packs made, one at a time
making   the process that makes one pack: cuts it out of the record and writes its page
"""

from cellwatt.runtime.evidence.keeper import Keeper

__all__ = ["Keeper"]
