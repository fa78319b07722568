"""Consumers of a cell's data beside Zenoh, each a folder of its own."""
