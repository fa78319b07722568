"""What the supply draws beyond the simulation's law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from concealed import supply
from concealed.effects.kinds import Kind, Truth, into
from concealed.setting import RATIO, Setting, require

ELECTRICS: dict[str, Kind] = {}


@into(ELECTRICS, None)
def standby_power(s: Setting, joint: int) -> Truth:
    """The simulation has no standby power."""
    s.believed = replace(s.believed, standby=0.0)
    return {"power": s.base.standby}


@into(ELECTRICS, None)
def brake_power(s: Setting, joint: int) -> Truth:
    """Power while the brakes are released."""
    power, delay = s.target() * s.base.power_noise * 1.2, float(s.rng.uniform(0.15, 0.8))
    s.supply = replace(s.supply, brake=supply.Brake(power, delay))
    return {"power": power, "delay": delay}


@into(ELECTRICS, None)
def copper_loss(s: Setting, joint: int) -> Truth:
    """The simulation has no winding resistances."""
    s.believed = replace(s.believed, resistance=np.zeros(s.joints))
    require(s.power_ratio(resistance=np.zeros(s.joints)) > RATIO["weak"][0])
    return {}


@into(ELECTRICS, None, "long")
def winding_temperature(s: Setting, joint: int) -> Truth:
    """Winding resistance that grows as the windings warm by their own loss."""
    loss = np.mean((s.base.resistance * (s.torque / s.base.constant) ** 2)[:, 0][s.alive[:, 0]], axis=0)
    full = 90.0 / max(float(loss.max()), 1e-3) * s.rng.uniform(0.8, 1.2, s.joints)
    time_constant = float(s.rng.uniform(90.0, 220.0))
    most = s.power_ratio(winding=supply.Winding(full, time_constant))
    share = min(1.2, s.target() / most)
    require(share * most > RATIO["weak"][0])
    s.supply = replace(s.supply, winding=supply.Winding(share * full, time_constant))
    return {"rise": [float(x) for x in share * full], "time_constant": time_constant}


@into(ELECTRICS, None)
def iron_loss(s: Setting, joint: int) -> Truth:
    """Loss in the motors' iron."""
    size = s.base.rotor / s.base.rotor.sum()
    mix = s.rng.uniform(0.2, 0.8)
    unit = supply.Iron(mix * size, (1 - mix) * size)
    share = s.target() / s.power_ratio(iron=unit)
    iron = supply.Iron(share * unit.hysteresis, share * unit.eddy)
    s.supply = replace(s.supply, iron=iron)
    return {"hysteresis": [float(x) for x in iron.hysteresis], "eddy": [float(x) for x in iron.eddy]}


@into(ELECTRICS, None)
def converter_efficiency(s: Setting, joint: int) -> Truth:
    """Drive power reaches the meter through a converter with losses both ways."""
    wanted = s.target()
    choices = np.linspace(0.75, 0.985, 24)
    ratios = np.array([s.power_ratio(efficiency=float(x)) for x in choices])
    efficiency = float(choices[np.argmin(np.abs(ratios - wanted))])
    require(s.power_ratio(efficiency=efficiency) > RATIO["weak"][0])
    s.supply = replace(s.supply, efficiency=efficiency)
    return {"efficiency": efficiency}


@into(ELECTRICS, None)
def regeneration_dissipated(s: Setting, joint: int) -> Truth:
    """Drive power below zero is burnt in a brake resistor."""
    require(s.power_ratio(dissipates=True) > RATIO["weak"][0])
    s.supply = replace(s.supply, dissipates=True)
    return {}


@into(ELECTRICS, None, "medium")
def fan_switching(s: Setting, joint: int) -> Truth:
    """A fan on the cabinet's temperature, which nobody records."""
    power = s.target() * s.base.power_noise * 1.4
    mean = float(np.mean(s.power_of(s.supply)[:, : s.opens][s.alive[:, : s.opens]]))
    on = float(s.rng.uniform(35.0, 40.0))
    off = on - float(s.rng.uniform(3.0, 6.0))
    fan = supply.Fan(
        power,
        float(s.rng.uniform(28.0, 34.0)),
        on,
        off,
        float(s.rng.uniform(18.0, 40.0)),
        float(s.rng.uniform(24.0, 32.0)) / mean,
        float(s.rng.uniform(0.1, 0.25)),
        25.0,
    )
    s.supply = replace(s.supply, fan=fan)
    return {
        "power": power,
        "start_temperature": fan.start_temperature,
        "on_above": on,
        "off_below": off,
        "time_constant": fan.time_constant,
    }
