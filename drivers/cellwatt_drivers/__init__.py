"""Drivers: how each device speaks, one folder a device family."""
