"""The demo of ``cellwatt demo``: runs emulated devices, the daemon and a subscriber as processes, and summarises."""
