"""What ``cellwatt demo`` runs: emulated devices, the daemon and a subscriber as processes, and what came of it."""
