"""Table I of ECDP, as in docs/energy-campaign.md: the path S–P1–P2–P3–P4–S in the ISO 9283 cube's diagonal plane."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Cube:
    """Corners P1 … P4, m in the base's frame, and the maximum payload, kg."""

    points: tuple[tuple[float, float, float], ...]
    payload: float

    @property
    def path(self):
        """S, P1, P2, P3, P4, S: (6, 3) m. S is the middle of P4–P1, where Table III's times have it."""
        corners = np.array(self.points)
        start = (corners[3] + corners[0]) / 2
        return np.vstack([start, corners, start])

    @property
    def legs(self):
        """Lengths (5,) m of the straight legs."""
        return np.linalg.norm(np.diff(self.path, axis=0), axis=1)

    def seconds(self, speed):
        """Time (5,) s of each leg, so that the mean speed of a repetition is ``speed`` mm/s."""
        return self.legs * 1000.0 / speed


CUBES = {
    "UR5e": Cube(((0.310, 0.200, 0.056), (0.710, 0.200, 0.456), (0.710, -0.200, 0.456), (0.310, -0.200, 0.056)), 5.0),
    # The table swaps x of the last two, so that the path crosses itself: 4.53 m. The brakes' energy of Table III
    # (534.6 J at 6.9176 W and 50 mm/s) is that of 3.86 m, the path in the cube's diagonal plane, as of other robots.
    "UR10e": Cube(((0.326, 0.4, -0.4), (1.126, 0.4, 0.4), (1.126, -0.4, 0.4), (0.326, -0.4, -0.4)), 10.0),
    "FR3": Cube(((0.298, 0.200, 0.052), (0.698, 0.200, 0.452), (0.698, -0.200, 0.452), (0.298, -0.200, 0.052)), 3.0),
    # The table has y = 350 mm for the middle two: a path of 2.08 m and no cube of 400 mm. Table III's energy of the
    # electronics (1133.6 J at 29.54 W and 50 mm/s) is that of 1.92 m: 250 mm it is, 1.93 m.
    "Gen3": Cube(((0.25, -0.15, -0.2), (0.65, 0.25, -0.2), (0.65, 0.25, 0.2), (0.25, -0.15, 0.2)), 4.0),
}
TABLE_SECONDS = {"UR5e": 168.8 / 4.3669, "UR10e": 534.6 / 6.9176, "FR3": 720.0 / 18.6436, "Gen3": 1133.6 / 29.54}
"""Of a repetition at 50 mm/s: energy over power of the brakes, or of the electronics, in Tables II and III."""
