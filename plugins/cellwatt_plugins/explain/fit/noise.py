"""Noise floors and correlation times, measured from the data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float

WINDOW = 0.4
"""s: within a window this short a sound residual is a parabola plus noise."""
LISTEN = 1.6
"""s of the windows whose spectrum is searched for lines."""
DEEPEST, NEAR, BESIDE = 3.0, 1.3, 3.0
"""Hz: lowest frequency of a line, half-width of a line, width of the bands beside it that give the background."""
FEWEST = 3
"""Smallest number of windows for a spectrum."""
STANDS_OUT = 5.0
"""Power of a line relative to the level on both of its sides."""
LONGEST = 1.0
"""s of lag up to which a residual's autocorrelation is computed."""
MOST, FEWEST_SAMPLES = 0.25, 9.0
"""Largest correlation factor, in s or in samples (the longer): a longer correlation is an effect, not noise."""


def floor(residuals: Sequence[Float], steps: Sequence[float]) -> Float:
    """Noise floor (C,) of channels, from the quiet third of all short windows; residuals (N, C) of each run."""
    spreads = np.concatenate([_window_spreads(r, s) for r, s in zip(residuals, steps, strict=True)])
    if not len(spreads):
        return np.asarray(np.maximum(np.std(np.concatenate(list(residuals)), axis=0), 1e-9))
    ordered = np.sort(spreads, axis=0)
    noise = ordered[len(ordered) // 3] * _lower_third(steps)
    return np.asarray(np.maximum(noise * np.sqrt(1 - tones(residuals, steps)), 1e-9))


def tones(residuals: Sequence[Float], steps: Sequence[float]) -> Float:
    """Share (C,) of the quiet windows' power that lies in spectral lines: a machine hums, noise does not.

    A line stands out from the frequencies on both of its sides; filtered noise does not.
    """
    spectrum, resolution = _quiet_spectrum(residuals, steps)
    first = int(np.ceil(DEEPEST / resolution))
    shares = [
        float(np.sum(_lines(each, resolution)[first:]) / max(float(np.sum(each[first:])), 1e-300))
        for each in spectrum.T
    ]
    return np.clip(shares, 0.0, 0.99)


def hum(residuals: Sequence[Float], steps: Sequence[float]) -> float | None:
    """Frequency in Hz of the strongest line of one channel's residuals (N, 1) of each run; None if there is no line."""
    spectrum, resolution = _quiet_spectrum(residuals, steps)
    lines = _lines(spectrum[:, 0], resolution)
    return float(np.argmax(lines) * resolution) if np.any(lines > 0) else None


def _quiet_spectrum(residuals: Sequence[Float], steps: Sequence[float]) -> tuple[Float, float]:
    """Mean power spectrum (F, C) of the quiet third of long windows (0 without windows), and its resolution in Hz."""
    step = float(np.median(steps))
    width = max(16, round(LISTEN / step))
    windows = np.concatenate([_detrended(residual, width) for residual in residuals])
    if len(windows) < FEWEST:
        return np.zeros((width // 2 + 1, residuals[0].shape[1])), 1 / (width * step)
    order = np.argsort(np.mean(np.square(windows), axis=1), axis=0)[: max(FEWEST, len(windows) // 3)]
    quiet = np.take_along_axis(windows, order[:, None, :], axis=0)
    transformed = np.fft.rfft(quiet * np.hanning(width)[None, :, None], axis=1)
    return np.asarray(np.mean(np.square(np.abs(transformed)), axis=0)), 1 / (width * step)


def _lines(spectrum: Float, resolution: float) -> Float:
    """Power (F,) that stands out from the level on both sides, from ``DEEPEST`` Hz on."""
    beside, near = max(2, round(BESIDE / resolution)), max(2, round(NEAR / resolution))
    out = np.zeros_like(spectrum)
    for i in range(int(np.ceil(DEEPEST / resolution)), len(spectrum) - near - 2):
        left = spectrum[max(1, i - near - beside) : i - near + 1]
        right = spectrum[i + near : i + near + beside + 1]
        level = max(float(np.median(left)), float(np.median(right)))
        if spectrum[i] > STANDS_OUT * level:
            around = slice(i - near + 1, i + near)
            out[around] = np.maximum(out[around], spectrum[around] - level)
    return out


def _detrended(residual: Float, width: int) -> Float:
    """Windows (W, width, C) without their parabola."""
    count = len(residual) // width
    windows = residual[: count * width].reshape(count, width, residual.shape[1])
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1, 1, width), 3))
    return np.asarray(windows - np.einsum("wk,nkc->nwc", basis, np.einsum("wk,nwc->nkc", basis, windows)))


def correlation_factor(standard: Sequence[Float], steps: Sequence[float]) -> Float:
    """1 + 2 Σ autocorrelation (C,) of standardised residuals (N, C) of each run: samples per independent sample.

    The sum runs to the first lag without autocorrelation, at most ``LONGEST`` s.
    """
    step = float(np.median(steps))
    lags = max(2, min(round(LONGEST / step), min(len(run) for run in standard) // 2))
    sums = np.zeros((lags + 1, standard[0].shape[1]))
    for run in standard:
        size = 2 ** int(np.ceil(np.log2(len(run) + lags + 1)))
        spectrum = np.fft.rfft(run, size, axis=0)
        sums += np.fft.irfft(np.abs(spectrum) ** 2, size, axis=0)[: lags + 1]
    correlation = sums[1:] / np.maximum(sums[0], 1e-300)
    lasting = np.cumprod(correlation > 0.05, axis=0)
    return np.asarray(np.clip(1 + 2 * np.sum(correlation * lasting, axis=0), 1.0, max(FEWEST_SAMPLES, MOST / step)))


def _window_spreads(residual: Float, step: float) -> Float:
    """Standard deviation (W, C) of each window about its parabola."""
    width = max(8, round(WINDOW / step))
    return np.asarray(np.sqrt(np.sum(_detrended(residual, width) ** 2, axis=1) / (width - 3)))


def _lower_third(steps: Sequence[float]) -> float:
    """Factor from the lower third of window spreads of white noise to its standard deviation."""
    width = max(8, round(WINDOW / float(np.median(steps))))
    degrees = width - 3
    # Wilson-Hilferty: the cube root of chi²/degrees is nearly normal.
    third = (1 - 2 / (9 * degrees) - 0.4307 * np.sqrt(2 / (9 * degrees))) ** 3
    return float(1 / np.sqrt(third))
