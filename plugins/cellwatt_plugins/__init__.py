"""Plugins: what is learned from the data, one folder a capability."""
