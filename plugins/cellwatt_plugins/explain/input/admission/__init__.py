"""Check that recordings and simulations can be compared, and report in one line what is wrong with them.

An input is refused only if it is far from anything physical (an angle off by a factor of 57.3, a torque by 1000), and
if correcting it makes recording and simulation agree far better. Effects that a robot can have are not input errors,
however strong.
"""

from cellwatt_plugins.explain.input.admission.examine import Admitted, admit, check_run

__all__ = ["Admitted", "admit", "check_run"]
