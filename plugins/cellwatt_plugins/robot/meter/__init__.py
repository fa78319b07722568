"""A power meter as it is: its values are means over a time, come late, and are held until the next.

Whatever is compared with measured power is first put through the meter: averaged over the same times.
"""

from cellwatt_plugins.robot.meter.file import power_beside, with_meters
from cellwatt_plugins.robot.meter.find import find
from cellwatt_plugins.robot.meter.held import held, onto
from cellwatt_plugins.robot.meter.kinds import Course, kinds_of_power
from cellwatt_plugins.robot.meter.model import Meter, Readings, Windows

__all__ = [
    "Course",
    "Meter",
    "Readings",
    "Windows",
    "find",
    "held",
    "kinds_of_power",
    "onto",
    "power_beside",
    "with_meters",
]
