"""Arms with a known energy balance, for ``bench/energy.py`` and the tests of ``cellwatt disaggregate``."""
