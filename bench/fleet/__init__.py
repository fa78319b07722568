"""Emulated fleets of arms that wear: physics of their own, no code in common with the product."""
