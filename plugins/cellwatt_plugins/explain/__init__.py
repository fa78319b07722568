"""Finds where simulation and recordings differ, names the cause, models it, and shows the improvement of the fit.

input        reads, lines up and checks recordings and simulations
fit          searches the terms that the data support, and accepts or rejects each
verdict      makes findings of the accepted terms: sentence, confidence, rival names
report       shows them on a page and in the terminal
simulators   runs the user's simulator, and writes the findings into its file
live         the stage ``mismatch``
"""
