"""The demo behind ``cellwatt demo``: emulated devices, the daemon and a subscriber as processes, and a summary."""
