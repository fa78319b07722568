"""``cellwatt demo explain``: conceal physics from a simulation, and let ``explain`` find it."""
