"""Recordings: written first, crash-safe, read back exactly."""
