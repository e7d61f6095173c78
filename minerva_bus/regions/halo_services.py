"""Which services run in each region, with a halo, and which run in one region for all."""

from __future__ import annotations

from collections.abc import Iterable

from minerva_bus.regions.partition import ByPosition, Partition
from minerva_bus.regions.tree import ByTree
from minerva_bus.world.halo import Halo
from minerva_bus.world.services import Device, Generator, Service


def halo_services(partition: Partition | None, services: Iterable[Service | None]) -> list[Service]:
    """Those of the services of a world that run in each region with a halo.

    Sensor topics do not leave a region. So services that exchange them run in each region together,
    or not at all.
    """
    if not (isinstance(partition, ByPosition | ByTree) and partition.halo):
        return []
    present = [each for each in services if each is not None]
    near = [each for each in present if _can_be_near(each)]
    while True:
        outside = [each for each in present if each not in near]
        published = {topic for each in near for topic in each.publishes}
        stay = [
            each
            for each in near
            if published.issuperset(each.topics) and not exchange(each, outside)
        ]
        if len(stay) == len(near):
            return near
        near = stay


def _can_be_near(service: Service) -> bool:
    # A service may have an attribute of its own with this name.
    if not isinstance(service.halo, Halo):
        return False
    answers = isinstance(service, Generator) and service.lockstep
    return answers and (service.coupled if isinstance(service, Device) else bool(service.topics))


def exchange(service: Service, others: Iterable[Service]) -> bool:
    """Whether a service reads a sensor topic of one of the others, or the other way round."""
    return any(
        {*service.topics}.intersection(other.publishes)
        or {*service.publishes}.intersection(other.topics)
        for other in others
    )
