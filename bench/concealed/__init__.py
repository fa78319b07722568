"""Blind benchmark of `cellwatt explain`: recordings by another physics engine, effects drawn by a committed seed.

Nothing here imports the product or its dynamics library: the product runs as a process on the files written here.

    families, arms, describe     an arm, as MJCF for the plant and as URDF and robot.yaml for the product
    motion, plant, law           what it is told to do, what MuJoCo makes of it, what the simulation says
    mechanics, sensing, supply   what acts at the joints, in the measured torque and at the meter
    setting, effects, cases      what is drawn how, and which cases a seed stands for; seal: the promise on the seed
    own, simulation              in half of the cases: a simulation that is not what the description says
    record, files                a case as files with its key; a recording beside its simulation, read back
    product                      the answers of the product
    judging, kept, runner        a case from draw to scores; each step kept, so that a stopped run goes on
    scoring, totals, page        one case against its key, all cases, tables
"""
