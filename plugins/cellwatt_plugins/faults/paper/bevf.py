"""BEVF, Bode equations vector fitting of a power pattern (Sabry et al., section III and Fig. 6).

The input adaptor takes time as frequency, s = j t, and the pattern as the magnitude of a response; the phase of the
stable minimum-phase response follows from Bode's relation of gain and phase. Vector fitting gives poles, residues and
a constant. The output adaptor takes the magnitude again.

The paper prints the magnitude as eq. (17), a sum of moduli, which is not the modulus of the sum.
``PowerEquation.power`` uses the modulus of the sum; its rms decreases as in Fig. 11.
"""

from __future__ import annotations

from itertools import islice

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ModelError
from cellwatt_plugins.faults.paper.equation import PowerEquation
from cellwatt_plugins.faults.paper.rational import Complex, iterations, starting_poles

ORDERS = (24, 34, 44)
"""Orders of approximation of Fig. 10 …"""
ITERATIONS = 12
"""… and the number of iterations of each."""
BEYOND = 8
"""Length for which the pattern is extended with its last value, in lengths of the pattern."""


def fit(t: Float, power: Float, *, order: int, iterations_done: int = ITERATIONS) -> PowerEquation:
    """Fit a power pattern (n,) W at evenly spaced times t (n,) s from 0 on.

    The equation is that of the iteration with the smallest rms. Raises ``ModelError`` if the order is odd, the points
    are too few, or power is not above 0.
    """
    _check(t, power, order)
    s = np.asarray(1j * t, np.complex128)  # the input adaptor's axis
    fits = list(islice(iterations(s, bode_response(power), starting_poles(float(t[-1]), order)), iterations_done))
    found = [rms(power, np.abs(each.at(s))) for each in fits]
    best = int(np.argmin(found))
    return PowerEquation.of(fits[best], float(t[-1]), found)


def bode_response(power: Float) -> Complex:
    """The minimum-phase response (n,) whose magnitude is ``power`` (n,) W at s = j t, t evenly spaced from 0 on.

    Bode's relation: the phase is the Hilbert transform of the logarithm of the magnitude, which is even in t.
    """
    one_side = np.concatenate([np.log(power), np.full((BEYOND - 1) * len(power), np.log(power[-1]))])
    even = np.concatenate([one_side, one_side[-2:0:-1]])
    half = len(even) // 2
    keep = np.zeros(len(even))
    keep[0] = keep[half] = 1
    keep[1:half] = 2
    # The cepstrum of a minimum-phase response is one-sided.
    log_response = np.fft.fft(np.fft.ifft(even).real * keep)[: len(power)]
    return np.asarray(np.exp(log_response), dtype=np.complex128)


def rms(power: Float, estimate: Float) -> float:
    """Root mean square error, eq. (19), in the unit of its arguments (n,)."""
    return float(np.sqrt(np.mean((power - estimate) ** 2)))


def _check(t: Float, power: Float, order: int) -> None:
    if order < 2 or order % 2:
        raise ModelError(f"order {order} of a power equation: expected an even number, 2 or more")
    if len(t) <= 2 * order:
        raise ModelError(f"order {order} needs more than {2 * order} points of a power pattern, there are {len(t)}")
    if not np.all(power > 0):
        raise ModelError(
            f"a power pattern must stay above 0 W to be fitted, its least is {power.min():.1f} W: "
            "take the power of the whole supply, with standby"
        )
