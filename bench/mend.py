"""`cellwatt explain --mend` and `mujoco.sysid` on the same recordings, judged in MuJoCo; see the package `mend`.

python bench/mend.py --json [--work DIR] [--only NAME …] [--no-peer]
"""

from mend.runner import main

if __name__ == "__main__":
    main()
