"""Cycles of emulated arms with known faults, and how well `cellwatt faults` and the paper's method find them.

The plant's rigid bodies are MuJoCo's, its arms, friction and supply are written here and in ``concealed``: nothing is
shared with the model that judges it.
"""
