"""Consumers of the supply's power."""
