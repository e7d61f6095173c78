"""The process of a region: a member of the world that also has links to the other regions."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

from minerva_bus.blame import report
from minerva_bus.errors import BusError, MinervaError, UserCodeError, WorldStopped
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member import Member
from minerva_bus.frame.messages import Welcome
from minerva_bus.launch.access import security_of_region
from minerva_bus.launch.pipes import ReportPipe
from minerva_bus.launch.regions.layout import RegionSpec
from minerva_bus.launch.regions.member import RegionMember
from minerva_bus.runtime.admission import ListenConfig, Security
from minerva_bus.runtime.arrival import STARTED_HERE, Arrival
from minerva_bus.runtime.direct import Deliver, InProcessRunner
from minerva_bus.runtime.endpoints import check_endpoint
from minerva_bus.runtime.inbox import KeyedSample, keyed_sample
from minerva_bus.runtime.member import BACK_WITHIN, MemberProcess
from minerva_bus.runtime.region_hub import HubConfig, HubItem, RegionHub
from minerva_bus.runtime.region_links import ParcelArrived, RegionAppeared, RegionLinks
from minerva_bus.runtime.runner import Notice
from minerva_bus.runtime.system import Timer
from minerva_bus.security.credentials import Credentials
from minerva_bus.wire.keys import LINK, linked_at, name_of_region
from minerva_bus.wording import duration

AGAIN_SECONDS: Final = 1.0
"""Interval at which parcels are sent again to regions that are still awaited."""


@dataclass(frozen=True, slots=True)
class _SendAgain:
    """Periodic timer: parcels may have been lost."""


@dataclass(frozen=True, slots=True)
class _Unreachable:
    """Reason why the links of another region cannot be reached; empty: none is known."""

    region: int
    reason: str


class RegionProcess(MemberProcess):
    """Runs a region: its arrivals from the coordinator and from other regions are in one queue."""

    def __init__(
        self,
        spec: RegionSpec,
        endpoint: str,
        notify: Callable[[str], None],
        *,
        shared: bool = False,
        own: Credentials | None = None,
        back_within: float = BACK_WITHIN,
        arrival: Arrival = STARTED_HERE,
        reports: ReportPipe | None = None,
    ) -> None:
        """The arguments are those of a member; `spec` describes the region.

        The launcher of its hosts receives `reports` about them; without one, lines do.
        """
        self._spec = spec
        self._own = own
        self._reports = reports
        self._hub: RegionHub | None = None
        self._joined: Welcome | None = None
        self._links: RegionLinks | None = None
        self._timer: Timer | None = None
        self._unreachable: dict[int, str | None] = {}
        make_runner = partial(self._make_hub, shared) if spec.hosts_at else InProcessRunner
        self._region = RegionMember(spec, self._send_parcel, self._log, make_runner)
        super().__init__(
            [self._region],
            spec.world_file.world.name,
            endpoint,
            notify,
            shared=shared,
            own=own,
            back_within=back_within,
            arrival=arrival,
        )
        self._handlers |= {
            ParcelArrived: self._on_parcel,
            RegionAppeared: self._on_appeared,
            _SendAgain: self._on_send_again,
            _Unreachable: self._on_unreachable,
            HubItem: self._on_hub_item,
        }

    def _make_hub(
        self,
        shared: bool,
        algorithm: FrameAlgorithm,
        members: Iterable[Member],
        observe: Callable[[Notice], None],
        *,
        deliver: Deliver,
    ) -> RegionHub:
        spec, file = self._spec, self._spec.world_file
        config = HubConfig(
            ListenConfig(spec.hosts_at, shared, security=self._security()),
            replace(file, processes=spec.hosts).deadlines,
            file.access.limits,
            late=self._note_late,
            joined=self._note_joined,
            listening=self._note_listening,
        )
        # It is made before the queue of this process, which it uses when it is opened.
        self._hub = RegionHub(
            config, lambda item: self.inbox.put(item), algorithm, members, observe, deliver
        )
        return self._hub

    def _security(self) -> Security | None:
        """That of the session for hosts, if they come from other machines."""
        spec = self._spec
        if self._own is None or not check_endpoint(spec.hosts_at).secured:
            return None
        return security_of_region(self._own, spec.world_file.world.name, spec.name)

    def _reports_about(self, host: str) -> ReportPipe | None:
        """The pipe to the launcher, if it has started this host."""
        return self._reports if any(host == each.name for each in self._spec.hosts) else None

    def _log(self, about: str, text: str, details: str) -> None:
        """Report a line about a host to its launcher; print any other, after its member's name."""
        if (reports := self._reports_about(about)) is not None:
            reports.send("log", member=about, text=text, details=details, keep=True)
            return
        for line in text.split("\n"):
            self._notify(f"{about}: {line}" if about else line)

    def _note_late(self, host: str, waited: float) -> None:
        """Let the launcher kill a host that has not answered in time."""
        if (reports := self._reports_about(host)) is not None:
            reports.send("timed_out", member=host, waited=waited)
        else:
            self._notify(f"{host}: no answer for {duration(waited)}: restart it where it runs")

    def _note_joined(self, host: str) -> None:
        if (reports := self._reports_about(host)) is not None:
            reports.send("joined", member=host)

    def _note_listening(self, endpoint: str) -> None:
        if self._reports is not None:
            self._reports.send("hub", region=self._spec.name, endpoint=endpoint)

    def _on_hub_item(self, item: HubItem) -> None:
        assert self._hub is not None
        self._hub.take(item)
        for reply in self._region.hosts_answered():
            self.link.send(reply)

    def _declare(self, session: Any) -> list[Any]:
        spec = self._spec
        assert spec.world_file.partition is not None
        keys, count = self.link.keys, spec.world_file.partition.count
        links = RegionLinks(
            keys, spec.number, spec.endpoints, self.inbox, count=count, own=self._own
        )
        self._links = links
        self._timer = self._system.every(AGAIN_SECONDS, lambda: self.inbox.put(_SendAgain()))
        declared: list[Any] = []
        if spec.announces:
            liveliness, handler = session.liveliness(), self.inbox.handler
            declared += [liveliness.declare_token(keys.link(spec.name, links.endpoint))]
            declared += super()._declare(session)
            others = handler(keyed_sample)
            declared += [liveliness.declare_subscriber(keys.link(), others, history=True)]
            return declared
        return super()._declare(session)

    def _close_services(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if self._links is not None:
            self._links.close()
        if self._hub is not None:
            self._hub.close()

    def _send_parcel(self, region: int, data: bytes) -> None:
        if self._links is not None:
            self._links.send(region, data)

    def _on_sample(self, sample: KeyedSample) -> None:
        """Process a sample, or link to another region where it receives parcels now."""
        if self.link.keys.kind(sample.key) != LINK:
            super()._on_sample(sample)
            return
        region, endpoint = linked_at(sample.key)
        if not sample.there or region is None or not region < self._spec.number:
            return
        assert self._links is not None
        try:
            # Another region must not choose a link without certificates.
            if self._own is not None and not check_endpoint(endpoint).secured:
                raise BusError(f"{endpoint} is not a secured link")
            self._links.dial(region, endpoint)
        except BusError as error:
            self._notify(f"{name_of_region(region)}: {error}")

    def _on_appeared(self, appeared: RegionAppeared) -> None:
        self._unreachable.pop(appeared.region, None)
        self._region.send_again([appeared.region])

    def _on_send_again(self, _: _SendAgain) -> None:
        awaited, links = self._region.awaited, self._links
        for reply in self._region.a_second_later():
            self.link.send(reply)
        if self._region.world is not None:
            # A successor of the coordinator, which has sent another welcome, knows no hosts.
            if self._region.world is not self._joined:
                self._joined, self._first.figures = self._region.world, {}
            self._first.report_figures()
        for region in awaited if links is not None and self._spec.announces else ():
            endpoint = links.unlinked(region) if links is not None else ""
            # None: a check is under way.
            if endpoint and self._unreachable.get(region, "") is not None:
                before = self._unreachable.get(region, "")
                self._unreachable[region] = None
                self._system.aside(partial(self._check, region, endpoint, before or ""))

    def _check(self, region: int, endpoint: str, before: str) -> None:
        reason = self._system.obstacle(endpoint, self._own)
        self.inbox.put(_Unreachable(region, "" if reason == before else reason))

    def _on_unreachable(self, unreachable: _Unreachable) -> None:
        region, reason = unreachable.region, unreachable.reason
        if reason:
            self._notify(f"{self._spec.name}: {name_of_region(region)} is unreachable: {reason}")
        self._unreachable[region] = reason

    def _on_parcel(self, arrived: ParcelArrived) -> None:
        for reply in self._region.parcel(arrived):
            self.link.send(reply)

    def _described(self, error: Exception) -> str:
        """The error, with the name of the member in this process whose code failed, if it was."""
        running = "" if isinstance(error, WorldStopped) else self._region.running
        # Errors of the user's function that assigns regions, or with a text for the user.
        if not running and isinstance(error, MinervaError | UserCodeError):
            return report(error)
        ours = f"{self._spec.name}: an error of Minerva Bus, not of the world's code"
        return f"{running or ours}: {report(error)}"
