"""Serial power-measuring board behind an XBee/ZigBee receiver."""

from cellwatt_drivers.power_board.driver import PowerBoardDriver, PowerBoardSettings

__all__ = ["PowerBoardDriver", "PowerBoardSettings"]
