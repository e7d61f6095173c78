"""Runs the cases of the conformance suite against a member, several at a time."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import count
from typing import Final

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.frame import messages as m
from minerva_conformance.case import Case, CaseOutcome, CaseResult, Role, Tier
from minerva_conformance.cases import CASES
from minerva_conformance.launching import StartMember, command
from minerva_conformance.link import NotJoined, TimeLimits
from minerva_conformance.player import play, probe
from minerva_conformance.scripted_world import ScriptedHub
from minerva_conformance.world import MemberRole, capabilities_of, roles_of

JOBS: Final = 4
"""Cases that are played at the same time."""


@dataclass(frozen=True, slots=True)
class ScoreCard:
    """The results of all selected cases, in their order."""

    roles: tuple[Role, ...]
    results: tuple[CaseResult, ...]

    def count(self, tier: Tier, outcome: CaseOutcome) -> int:
        """Number of cases of a tier with this outcome."""
        return sum(r.case.tier is tier and r.outcome is outcome for r in self.results)

    @property
    def passed(self) -> bool:
        """Whether no case failed or was blocked."""
        good = (CaseOutcome.PASSED, CaseOutcome.NOT_APPLICABLE)
        return all(result.outcome in good for result in self.results)

    @property
    def reached(self) -> Tier | None:
        """The highest tier in which, and in all before it, every case passed."""
        reached: Tier | None = None
        for tier in Tier:
            bad = (CaseOutcome.FAILED, CaseOutcome.BLOCKED)
            if any(self.count(tier, outcome) for outcome in bad):
                break
            reached = tier
        return reached


def select(names: Collection[str] = (), roles: Collection[MemberRole] = ()) -> tuple[Case, ...]:
    """The cases with these names, or whose names begin with `NAME.`; all without names.

    Raises MisuseError if a name selects nothing.
    """
    for name in names:
        if not any(is_named(case, name) for case in CASES):
            known = sorted({part for case in CASES for part in (case.id, case.id.split(".")[0])})
            raise MisuseError(
                f"there is no case {name!r}{nearest(name, known)}; `minerva conformance --list`"
            )
    return tuple(
        [
            case
            for case in CASES
            if (not names or any(is_named(case, name) for name in names))
            and (not roles or set(case.roles) & set(roles))
        ]
    )


def is_named(case: Case, name: str) -> bool:
    """Whether a name selects a case: its own, or that of its group."""
    return case.id == name or case.id.startswith(f"{name}.")


class Suite:
    """Plays cases against one member; `start` starts it, with the environment of a case."""

    def __init__(
        self, start: StartMember, hub: ScriptedHub, limits: TimeLimits | None = None
    ) -> None:
        self._start = start
        self._hub = hub
        self._limits = limits or TimeLimits()
        self._worlds = count(1)

    def run(
        self,
        cases: Iterable[Case] = CASES,
        roles: Collection[MemberRole] = (),
        jobs: int = JOBS,
    ) -> ScoreCard:
        """Play the cases of these roles; by default of those that the member declares."""
        cases = tuple(cases)
        hellos = self._hellos(roles)
        plan = [
            (case, role, hello)
            for role, hello in hellos.items()
            for case in cases
            if role in case.roles
        ]
        pool = ThreadPoolExecutor(jobs)
        try:
            results = list(pool.map(self._play, *zip(*plan, strict=True))) if plan else []
        except BaseException:
            # Ctrl-C: the players end their members and return.
            self._hub.interrupted = True
            raise
        finally:
            pool.shutdown(cancel_futures=True)
        return ScoreCard(tuple(hellos), tuple(results))

    def _hellos(self, roles: Collection[MemberRole]) -> Mapping[MemberRole, m.Hello | None]:
        """What the member declares in each role; None if it does not join."""
        if roles:
            return {role: self._hello_in(role) for role in roles}
        try:
            hello = self._probe(None)
        except NotJoined as reason:
            raise MisuseError(
                f"the member does not join, so its roles are unknown: {reason}; name one with"
                " --role to see which cases fail"
            ) from None
        declared = roles_of(hello)
        if not declared:
            raise MisuseError("the member declares no role: no kinds, event types or views")
        return dict.fromkeys(declared, hello)

    def _hello_in(self, role: MemberRole) -> m.Hello | None:
        try:
            return self._probe(role)
        except NotJoined:
            return None

    def _probe(self, role: MemberRole | None) -> m.Hello:
        return probe(role, self._start, self._hub, self._world(), self._limits)

    def _world(self) -> str:
        return f"conformance-{next(self._worlds)}"

    def _play(self, case: Case, role: MemberRole, hello: m.Hello | None) -> CaseResult:
        if hello is None and case.joined:
            return CaseResult(case, role, CaseOutcome.BLOCKED, "it does not join")
        capabilities = frozenset[str]() if hello is None else capabilities_of(hello)
        if not case.requires <= capabilities:
            missing = ", ".join(sorted(case.requires - capabilities))
            return CaseResult(case, role, CaseOutcome.NOT_APPLICABLE, f"it declares no {missing}")
        return play(case, role, self._start, self._hub, self._world(), capabilities, self._limits)


def run_suite(
    words: Sequence[str],
    *,
    cases: Collection[str] = (),
    roles: Collection[str] = (),
    jobs: int = JOBS,
) -> ScoreCard:
    """Play cases against a program.

    Args:
        words: the program and its arguments.
        cases: names of cases or of groups, such as `tick`; default: all.
        roles: roles that the program takes by MINERVA_ROLE; default: those that it declares.
        jobs: cases that are played at the same time.

    Raises:
        MisuseError: there is no such case, role or program, or the member does not answer.

    """
    chosen = roles_named(roles)
    with ScriptedHub() as hub:
        return Suite(command(words), hub).run(select(cases, chosen), chosen, jobs)


def roles_named(names: Iterable[str]) -> tuple[MemberRole, ...]:
    """The roles with these names. Raises MisuseError."""
    names = tuple(names)
    for name in names:
        if name not in set(MemberRole):
            raise MisuseError(f"there is no role {name!r}; expected {', '.join(MemberRole)}")
    return tuple([MemberRole(name) for name in names])


def check_case(case: Case, role: MemberRole, words: Sequence[str]) -> None:
    """Play one case against a program, as a test does. Raises AssertionError if it fails."""
    card = run_suite(words, cases=[case.id], roles=[role.value])
    problems = [
        f"{result.case.id}: {result.problem}"
        for result in card.results
        if result.outcome in (CaseOutcome.FAILED, CaseOutcome.BLOCKED)
    ]
    if problems:
        raise AssertionError("\n".join(problems))


def parameters(*roles: str) -> Iterator[tuple[Case, MemberRole]]:
    """The cases of these roles, each with its role, as parameters of a test."""
    for role in roles_named(roles):
        for case in select((), (role,)):
            yield case, role
