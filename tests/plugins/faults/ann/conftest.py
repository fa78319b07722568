from tests.plugins.faults.cycles.conftest import healthy, known, robot

__all__ = ["healthy", "known", "robot"]
