"""Noise floors and correlation times, measured from the data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Bool, Float

WINDOW = 0.4
"""s: within a window this short a sound residual is a parabola plus noise."""
LISTEN = 1.6
"""s of the windows whose spectrum is searched for lines."""
DEEPEST, NEAR, BESIDE = 3.0, 1.3, 3.0
"""Hz: lowest frequency of a line, half-width of a line, width of the bands beside it that give the background."""
FEWEST = 3
"""Smallest number of windows for a spectrum."""
UNKNOWN = 0.1
"""Share of a window above which samples that were not measured make it quieter than the noise."""
STANDS_OUT = 5.0
"""Power of a line relative to the level on both of its sides."""
LONGEST = 1.0
"""s of lag up to which a residual's autocorrelation is computed."""
MOST, FEWEST_SAMPLES = 0.25, 9.0
"""Largest correlation factor, in s or in samples (the longer): a longer correlation is an effect, not noise."""


def floor(residuals: Sequence[Float], steps: Sequence[float], known: Sequence[Bool] | None = None) -> Float:
    """Noise floor (C,) of channels, from the quiet third of all short windows; residuals (N, C) of each run.

    ``known`` (N, C) is true where a residual was measured; None: everywhere. Windows with others do not count.
    """
    widths = [max(8, round(WINDOW / step)) for step in steps]
    spreads = np.concatenate([_window_spreads(r, width) for r, width in zip(residuals, widths, strict=True)])
    if not len(spreads):
        return np.asarray(np.maximum(np.std(np.concatenate(list(residuals)), axis=0), 1e-9))
    ordered = np.sort(_counted(spreads, known, widths), axis=0)
    third = np.count_nonzero(~np.isnan(ordered), axis=0) // 3
    noise = np.take_along_axis(ordered, third[None, :], axis=0)[0] * _lower_third(steps)
    return np.asarray(np.maximum(noise * np.sqrt(1 - tones(residuals, steps, known)), 1e-9))


def tones(residuals: Sequence[Float], steps: Sequence[float], known: Sequence[Bool] | None = None) -> Float:
    """Share (C,) of the quiet windows' power that lies in spectral lines: a machine hums, noise does not.

    A line stands out from the frequencies on both of its sides; filtered noise does not.
    """
    spectrum, resolution = _quiet_spectrum(residuals, steps, known)
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


def _quiet_spectrum(
    residuals: Sequence[Float], steps: Sequence[float], known: Sequence[Bool] | None = None
) -> tuple[Float, float]:
    """Mean power spectrum (F, C) of the quiet third of long windows (0 without windows), and its resolution in Hz."""
    step = float(np.median(steps))
    width = max(16, round(LISTEN / step))
    windows = np.concatenate([_detrended(residual, width) for residual in residuals])
    power = _counted(np.mean(np.square(windows), axis=1), known, [width] * len(residuals))
    spectrum = np.zeros((width // 2 + 1, residuals[0].shape[1]))
    for channel, each in enumerate(power.T):
        if (count := np.count_nonzero(~np.isnan(each))) >= FEWEST:
            quiet = windows[np.argsort(each)[: max(FEWEST, count // 3)], :, channel]
            transformed = np.fft.rfft(quiet * np.hanning(width), axis=1)
            spectrum[:, channel] = np.mean(np.square(np.abs(transformed)), axis=0)
    return spectrum, 1 / (width * step)


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


def _counted(values: Float, known: Sequence[Bool] | None, widths: Sequence[int]) -> Float:
    """Values (W, C) of all runs' windows, NaN where too little is ``known`` (N, C), unless no window has more."""
    if known is None:
        return values
    shares = [np.mean(windowed(k.astype(np.float64), w), axis=1) for k, w in zip(known, widths, strict=True)]
    lost = np.concatenate(shares) < 1 - UNKNOWN
    return np.where(lost & ~lost.all(axis=0), np.nan, values)


def windowed(samples: Float, width: int) -> Float:
    """Samples (N, C) as windows (W, width, C)."""
    count = len(samples) // width
    return samples[: count * width].reshape(count, width, samples.shape[1])


def _detrended(residual: Float, width: int) -> Float:
    """Windows (W, width, C) without their parabola."""
    windows = windowed(residual, width)
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


def _window_spreads(residual: Float, width: int) -> Float:
    """Standard deviation (W, C) of each window about its parabola."""
    return np.asarray(np.sqrt(np.sum(_detrended(residual, width) ** 2, axis=1) / (width - 3)))


def _lower_third(steps: Sequence[float]) -> float:
    """Factor from the lower third of window spreads of white noise to its standard deviation."""
    width = max(8, round(WINDOW / float(np.median(steps))))
    degrees = width - 3
    # Wilson-Hilferty: the cube root of chi²/degrees is nearly normal.
    third = (1 - 2 / (9 * degrees) - 0.4307 * np.sqrt(2 / (9 * degrees))) ** 3
    return float(1 / np.sqrt(third))
