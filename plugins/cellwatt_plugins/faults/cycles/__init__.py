"""Judges whole cycles by physics: finds the joint whose motion explains the difference from healthy power.

recording, runs, loops, match, new_tasks   motion between rests; tasks that recur; known cycles and new tasks
pattern, learn, known                      the healthy cycles of each task and speed, learned or read from the file
arm, bare_arm, load, identify, metering    the power of an arm with or without a description, fitted to healthy cycles
samples, off_path                          the residual of one cycle; what a joint off its path may mean
effects, weigh, best_effects               faults and harmless changes, and the few that explain the residual best
examine, findings, words                   the verdict on a cycle, its findings, their sentences
live, alarms                               running cycles, and the alarms of both
"""
