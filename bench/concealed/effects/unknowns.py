"""Effects that are in no table: a tool must say that something is there, and where, without giving it a name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from concealed import mechanics, sensing, supply
from concealed.effects.kinds import Kind, Truth, either, every, into
from concealed.effects.measurement import add_output, add_sensor
from concealed.setting import RATIO, Setting, require

UNKNOWNS: dict[str, Kind] = {}


def visited(s: Setting, joint: int) -> float:
    """A position that the joint passes often while it moves."""
    moving = np.abs(s.v[:, : s.opens, joint]) > 0.05
    require(int(moving.sum()) > 50)
    return float(s.rng.choice(s.q[:, : s.opens, joint][moving]))


@into(UNKNOWNS, every)
def vibration(s: Setting, joint: int) -> Truth:
    """A tone inside a window of positions."""
    where, width = visited(s, joint), float(s.rng.uniform(0.12, 0.35))
    hertz = float(s.rng.uniform(5.0, 0.3 * min(50.0, s.interface.rate)))
    term = lambda x: mechanics.Shaking(joint, x, hertz, where, width)  # noqa: E731
    amplitude = s.size(joint, term, 30 * float(s.base.noise[joint]))
    s.body.joints.loads.append(term(amplitude))
    return {"amplitude": amplitude, "hertz": hertz, "where": where, "width": width}


@into(UNKNOWNS, every)
def howl(s: Setting, joint: int) -> Truth:
    """A tone inside a band of speeds."""
    speed = float(s.base.speed[joint] * s.rng.uniform(0.2, 0.6))
    band, hertz = 0.25 * speed, float(s.rng.uniform(6.0, 0.3 * min(50.0, s.interface.rate)))
    term = lambda x: mechanics.Howling(joint, x, hertz, speed, band)  # noqa: E731
    amplitude = s.size(joint, term, 30 * float(s.base.noise[joint]))
    s.body.joints.loads.append(term(amplitude))
    return {"amplitude": amplitude, "hertz": hertz, "speed": speed}


@into(UNKNOWNS, every)
def rough_patch(s: Setting, joint: int) -> Truth:
    """More friction in part of the range."""
    start = visited(s, joint)
    force = s.size(joint, lambda x: mechanics.Patch(joint, x, start), 1.5 * float(s.base.coulomb[joint]))
    beyond = s.q[:, : s.opens, joint][np.abs(s.v[:, : s.opens, joint]) > 0.05] > start
    require(0.15 < float(np.mean(beyond)) < 0.85)
    s.body.joints.frictions.append(mechanics.Patch(joint, force, start))
    return {"force": force, "start": start}


@into(UNKNOWNS, every)
def knocking(s: Setting, joint: int) -> Truth:
    """A pulse of torque at a fixed period."""
    period, width = float(s.rng.uniform(1.7, 4.5)), float(s.rng.uniform(0.08, 0.16))
    term = lambda x: mechanics.Knock(joint, x, period, width, 0.7)  # noqa: E731
    torque = either(s) * s.size(joint, term, 40 * float(s.base.noise[joint]))
    s.body.joints.loads.append(term(torque))
    return {"torque": torque, "period": period, "width": width}


@into(UNKNOWNS, every)
def dead_band(s: Setting, joint: int) -> Truth:
    """Small torques read as zero."""
    torque = s.torque[:, :, joint]
    bands = np.geomspace(1.0, 60.0, 30) * float(s.base.noise[joint])
    ratios = np.array([s.rms(torque * (np.abs(torque) < b)) for b in bands]) / s.base.noise[joint]
    band = float(bands[np.argmin(np.abs(ratios - s.target()))])
    require(s.rms(torque * (np.abs(torque) < band)) > RATIO["weak"][0] * s.base.noise[joint])
    require(band < 0.6 * float(np.max(np.abs(torque))))
    add_output(s, sensing.DeadBand(joint, band))
    return {"band": band}


@into(UNKNOWNS, every)
def cross_talk(s: Setting, joint: int) -> Truth:
    """Another joint's torque leaks into the measurement."""
    source = int(s.rng.choice([j for j in range(s.joints) if j != joint]))
    once = s.rms(s.torque[:, :, source]) / float(s.base.noise[joint])
    share = either(s) * s.target() / once
    require(abs(share) < 0.6)
    add_sensor(s, sensing.CrossTalk(joint, source, share))
    return {"source": source, "share": share}


@into(UNKNOWNS, every)
def loose_contact(s: Setting, joint: int) -> Truth:
    """The reading jumps between two levels at random."""
    step = either(s) * s.target() * float(s.base.noise[joint]) * 1.4
    add_sensor(s, sensing.LooseContact(joint, step, float(s.rng.uniform(0.8, 2.5)), int(s.rng.integers(2**31))))
    return {"step": step}


@into(UNKNOWNS, None)
def strange_consumer(s: Setting, joint: int) -> Truth:
    """Something at the same meter draws short pulses at a fixed period."""
    period = float(s.rng.uniform(1.3, 3.5))
    width = period * float(s.rng.uniform(0.15, 0.3))
    power = s.target() * s.base.power_noise / np.sqrt(width / period)
    s.supply = replace(s.supply, pulses=supply.Pulses(power, period, width))
    return {"power": power, "period": period, "width": width}
