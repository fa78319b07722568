"""Many recordings of one arm through `cellwatt explain`, by one process and by several.

recordings   an arm, effects that its simulation leaves out, and as many runs as are asked for, made by MuJoCo
product      the product as a process: time, computing, and a digest of what it wrote
"""
