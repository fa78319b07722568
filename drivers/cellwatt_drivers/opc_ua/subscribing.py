"""Makes the subscription by which a server is read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from cellwatt.errors import DeviceError
from cellwatt_drivers.opc_ua.nodes import Source
from cellwatt_drivers.opc_ua.session import Session

if TYPE_CHECKING:
    from asyncua import ua

_LIVES: Final = 3
"""Signs of life that may be missed before the server gives the subscription up, by the standard's rule."""
_NO_FILTER: Final = ("BadMonitoredItemFilterUnsupported", "BadFilterNotAllowed", "BadMonitoredItemFilterInvalid")


@dataclass(frozen=True, slots=True)
class Subscribed:
    """A subscription as the server made it: intervals in s, and the sources by the handle of their item."""

    sampling: float
    publishing: float
    life_sign: float
    queue: int
    without_filter: bool
    sources: Mapping[int, Sequence[Source]]


async def subscribe(
    session: Session,
    rate: float,
    publish: float,
    silence: float,
    queue: int,
    every_sample: bool,
    found: Sequence[Source],
) -> Subscribed:
    """Subscribe to all sources. Raises ``SourceError``, ``DeviceError`` where an item is refused."""
    made = await session.subscribe(_parameters(publish, silence))
    by_node: dict[ua.NodeId, list[Source]] = {}
    for source in found:
        by_node.setdefault(source.node, []).append(source)
    handles = dict(enumerate(by_node.items(), start=1))
    nodes = {handle: node for handle, (node, _) in handles.items()}
    results = await _monitored(session, made.SubscriptionId, nodes, rate, queue, every_sample)
    refused = [h for h, r in results.items() if r.StatusCode.name in _NO_FILTER] if every_sample else []
    if refused:
        again = {h: nodes[h] for h in refused}
        results |= await _monitored(session, made.SubscriptionId, again, rate, queue, False)
    for handle, result in results.items():
        if result.StatusCode.is_bad():
            raise DeviceError(f"the server refuses to watch {nodes[handle].to_string()}: {result.StatusCode.name}")
    publishing = float(made.RevisedPublishingInterval) * 1e-3
    return Subscribed(
        max(float(r.RevisedSamplingInterval) for r in results.values()) * 1e-3,
        publishing,
        publishing * max(1, int(made.RevisedMaxKeepAliveCount)),
        min(int(r.RevisedQueueSize) for r in results.values()),
        bool(refused),
        {handle: tuple(sources) for handle, (_, sources) in handles.items()},
    )


def _parameters(publish: float, silence: float) -> ua.CreateSubscriptionParameters:
    """A subscription that says each time that it is alive, where nothing changed: only then frames go on in time."""
    from asyncua import ua

    life = max(_LIVES, int(2 * silence / publish))
    return ua.CreateSubscriptionParameters(publish * 1e3, life, RequestedMaxKeepAliveCount=1, PublishingEnabled=True)


async def _monitored(
    session: Session, subscription: int, nodes: Mapping[int, ua.NodeId], rate: float, queue: int, every_sample: bool
) -> dict[int, ua.MonitoredItemCreateResult]:
    items = [_item(handle, node, rate, queue, every_sample) for handle, node in nodes.items()]
    results = await session.monitor(subscription, items)
    return dict(zip(nodes, results, strict=True))


def _item(handle: int, node: ua.NodeId, rate: float, queue: int, every_sample: bool) -> ua.MonitoredItemCreateRequest:
    from asyncua import ua

    wanted = ua.MonitoringParameters(handle, 1e3 / rate, QueueSize=queue, DiscardOldest=True)
    if every_sample:
        wanted.Filter = ua.DataChangeFilter(ua.DataChangeTrigger.StatusValueTimestamp)
    value = ua.ReadValueId(node, ua.AttributeIds.Value)
    return ua.MonitoredItemCreateRequest(value, ua.MonitoringMode.Reporting, wanted)
