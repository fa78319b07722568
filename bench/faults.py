"""Cycles of emulated arms with known faults, judged by `cellwatt faults`; see the package `faults` beside this file.

python bench/faults.py --json [--bare] [--cases N] [--cycles N] [--first-seed N]
python bench/faults.py --healthy --json [--cases N] [--cycles N] [--first-seed N]
python bench/faults.py --edited --json [--cases N] [--cycles N] [--first-seed N]

The second form counts false alarms in calm cycles by the share that is accepted; the third in known tasks of which
somebody has changed a pose. With --scheduler local:2, or tcp://HOST:PORT, workers do the cells.
"""

from faults.runner import main

if __name__ == "__main__":
    main()
