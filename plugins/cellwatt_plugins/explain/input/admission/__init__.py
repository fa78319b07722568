"""Check that recordings and simulations can be compared, and say in one line what is wrong with them.

A wrong input is claimed only where it is far from anything physical (an angle off by 57.3, a torque by 1000), and where
undoing it makes recording and simulation agree far better than they do as they are. Effects that a robot can have are
no wrong input, however strong.
"""

from cellwatt_plugins.explain.input.admission.examine import Admitted, admit, check_run

__all__ = ["Admitted", "admit", "check_run"]
