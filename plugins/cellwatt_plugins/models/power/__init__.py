"""Current of each joint and electrical power of a moving arm: the paper's two estimators, and a better one."""
