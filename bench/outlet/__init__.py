"""What a daemon with outlets talks to: emulated devices (``cell``), free ports, and ``servers`` of this host."""
