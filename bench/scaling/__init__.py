"""Many recordings of one arm through `cellwatt explain`, by one process and by workers of a scheduler.

recordings   an arm, effects that its simulation leaves out, and as many runs as are asked for, made by MuJoCo
product      the product as a process: time, computing, and a digest of what it wrote
inside       the same in one process with a clock at each part of the work that can be spread
overheads    what a scheduler costs: its start, a task, a byte
law          from these numbers to any number of workers
page         tables
"""
