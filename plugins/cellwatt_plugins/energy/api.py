"""``cw.disaggregate``, the function behind ``cellwatt disaggregate``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from cellwatt.errors import RecordingError
from cellwatt.files import Place
from cellwatt_plugins.energy.campaign import Outcome
from cellwatt_plugins.energy.campaign import disaggregate as run_campaign
from cellwatt_plugins.energy.drive import MOTOR
from cellwatt_plugins.energy.fixed import AtRest, steady_power
from cellwatt_plugins.energy.recordings import read_reading, read_runs
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.description import robot_file


def disaggregate(
    *, robot: Place, connected: Place, released: Place, runs: Place, controller: Place | None = None
) -> Outcome:
    """Split a robot's energy by consumer: electronics, brakes, mechanical and electrical losses, chopper.

    ``robot`` is robot.yaml, or its folder. ``controller``, ``connected`` and ``released`` are tables of the analyzer,
    t (s) and power (W): with the arm unplugged; with the arm connected and its brakes on; and with the brakes released
    and the arm at rest. ``runs`` is a folder of SPEED_PAYLOADkg.robot (t, q_i rad, qd_i rad/s, tau_i Nm) and .analyzer
    tables; each pair holds one closed path, repeated from rest to rest. The result has ``findings`` (J, W and their
    uncertainties), ``as_json`` and ``report``.

    Raises ``RecordingError`` if a file cannot be used, ``ConfigError`` if the description lacks a required key.
    Source: ECDP, see the energy page.
    """
    arm = Arm.load(robot, MOTOR)
    alone = None if controller is None else Path(controller)
    rest = _at_rest(arm, alone, Path(connected), Path(released))
    recorded = read_runs(Path(runs), arm.description.names)
    with threadpool_limits(1):
        outcome = run_campaign(arm, rest, recorded)
    given = (robot_file(robot), alone, Path(connected), Path(released), Path(runs))
    return replace(outcome, inputs=tuple(path for path in given if path is not None))


def _at_rest(arm: Arm, controller: Path | None, connected: Path, released: Path) -> AtRest:
    """Power in the three states; if the arm cannot be unplugged, the connected arm's power is the controller's."""
    plugged = steady_power(read_reading(connected))
    if controller is None and arm.description.controller_separate:
        raise RecordingError(
            "no --controller: measure the controller with the arm unplugged, or write controller_separate: false in "
            "robot.yaml if that is impossible"
        )
    alone = plugged if controller is None else steady_power(read_reading(controller))
    return AtRest(alone, plugged, steady_power(read_reading(released)))
