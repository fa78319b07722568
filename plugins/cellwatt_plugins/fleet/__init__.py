"""Compares many cells over many weeks: finds cells that drift, joints that wear, and changes common to a kind of arm.

``lake`` finds the recordings, ``weekly`` computes friction and energy of a cell's week, ``adjusted`` removes the
effects of programs and temperature, ``courses`` follows the values over the weeks, ``kinds`` and ``slopes`` compare
arms, and ``judge`` decides which changes are significant.
"""
