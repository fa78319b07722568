"""Loads: links, payload, gravity, springs, contacts."""
