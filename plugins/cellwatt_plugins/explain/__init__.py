"""Finds where simulation and recordings differ, names the cause, models it, and shows the improvement of the fit."""
