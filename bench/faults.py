"""Cycles of emulated arms with known faults, judged by `cellwatt faults`; see the package `faults` beside this file.

python bench/faults.py --json [--cases N] [--cycles N] [--first-seed N]
"""

from faults.runner import main

if __name__ == "__main__":
    main()
