"""Cycles of emulated arms with known faults, judged by `cellwatt faults`; see the package `faults` beside this file.

python bench/faults.py --json [--cases N] [--cycles N] [--first-seed N]
python bench/faults.py --healthy --json [--cases N] [--cycles N] [--first-seed N]
python bench/faults.py --edited --json [--cases N] [--cycles N] [--first-seed N]
python bench/faults.py --networks --json [--cases N] [--cycles N] [--first-seed N]
python bench/faults.py --real --json

The second form counts false alarms in calm cycles by the share that is accepted; the third in known tasks of which
somebody has changed a pose; the fourth holds thresholds and the paper's network against each other; the fifth judges
recordings of real arms that lie beside the checkout. With --scheduler local:2, or tcp://HOST:PORT, workers do the
cells.
"""

from faults.runner import main

if __name__ == "__main__":
    main()
