"""Creates the subscription that reads a server."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from cellwatt.errors import DeviceError
from cellwatt_drivers.opc_ua.nodes import TagPlace
from cellwatt_drivers.opc_ua.session import Session
from cellwatt_drivers.opc_ua.settings import OpcUaSettings

if TYPE_CHECKING:
    from asyncua import ua

_LIVES: Final = 3
"""Number of missed keep-alives after which the server ends the subscription, by the standard's rule."""


@dataclass(frozen=True, slots=True)
class Subscribed:
    """A subscription as the server made it: intervals in s, and the sources by the handle of their monitored item."""

    sampling: float
    publishing: float
    life_sign: float
    queue: int
    sources: Mapping[int, Sequence[TagPlace]]

    def revised(self, asked: OpcUaSettings) -> list[str]:
        """Settings that the server revised for the worse, in words."""
        found = []
        if self.sampling > 1.01 / asked.rate:
            found.append(f"samples every {self.sampling:g} s instead of every {1 / asked.rate:g} s")
        if self.publishing > 1.01 * asked.publish:
            found.append(f"sends every {self.publishing:g} s instead of every {asked.publish:g} s")
        if self.queue < min(asked.queue_size, self.publishing * asked.rate):
            found.append(f"keeps {self.queue} values of each tag instead of {asked.queue_size}")
        return found


async def subscribe(session: Session, asked: OpcUaSettings, found: Sequence[TagPlace]) -> Subscribed:
    """Subscribe to all sources. Raises ``SourceError``, and ``DeviceError`` if an item is refused."""
    from asyncua import ua

    life = max(_LIVES, int(2 * asked.silence / asked.publish))
    # A keep-alive in each interval without a change: frames continue in time only with it.
    wanted = ua.CreateSubscriptionParameters(
        asked.publish * 1e3, life, RequestedMaxKeepAliveCount=1, PublishingEnabled=True
    )
    made = await session.subscribe(wanted)
    by_node: dict[ua.NodeId, list[TagPlace]] = {}
    for source in found:
        by_node.setdefault(source.node, []).append(source)
    items = [_item(handle, node, asked) for handle, node in enumerate(by_node, 1)]
    results = await session.monitor(made.SubscriptionId, items)
    for node, result in zip(by_node, results, strict=True):
        if result.StatusCode.is_bad():
            hint = "; leave out 'every_sample'" if "Filter" in result.StatusCode.name else ""
            raise DeviceError(f"the server refuses to watch {node.to_string()}: {result.StatusCode.name}{hint}")
    publishing = float(made.RevisedPublishingInterval) * 1e-3
    return Subscribed(
        max(float(r.RevisedSamplingInterval) for r in results) * 1e-3,
        publishing,
        publishing * max(1, int(made.RevisedMaxKeepAliveCount)),
        min(int(r.RevisedQueueSize) for r in results),
        dict(enumerate(by_node.values(), 1)),
    )


def _item(handle: int, node: ua.NodeId, asked: OpcUaSettings) -> ua.MonitoredItemCreateRequest:
    from asyncua import ua

    wanted = ua.MonitoringParameters(handle, 1e3 / asked.rate, QueueSize=asked.queue_size, DiscardOldest=True)
    if asked.every_sample:
        wanted.Filter = ua.DataChangeFilter(ua.DataChangeTrigger.StatusValueTimestamp)
    value = ua.ReadValueId(node, ua.AttributeIds.Value)
    return ua.MonitoredItemCreateRequest(value, ua.MonitoringMode.Reporting, wanted)
