"""Universal Robots arms over RTDE (TCP 30004)."""

from cellwatt_drivers.ur.driver import UrDriver

__all__ = ["UrDriver"]
