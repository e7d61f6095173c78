"""A member under test beside the reference, which receives the same messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from minerva_bus.frame import messages as m
from minerva_bus.frame.member_side import SHOWN_VIEWS, Refusal
from minerva_bus.frame.stimuli import plain_form
from minerva_conformance.link import CaseFailure, MemberLink
from minerva_conformance.texts import KnownState, text_of
from minerva_conformance.world import MEMBER, MemberRole, reference


class ComparedMember:
    """The reference, and what is known of it and of the member in one case.

    `saved` is the data that the reference and the member have saved last.
    """

    def __init__(self, role: MemberRole, case: str, capabilities: frozenset[str]) -> None:
        self.saved: list[m.Saved] = [None, None]
        self._role = role
        self._case = case
        self._capabilities = capabilities
        self._reference = reference(role)
        self._states = KnownState(), KnownState()

    @property
    def is_plain(self) -> bool:
        """Whether the member declines columns."""
        return "plain" in self._capabilities

    def start_again(self) -> None:
        """Replace the reference, because the member is a new process."""
        self._reference = reference(self._role)

    def succeed(self) -> None:
        """Another coordinator is about to greet both."""
        self._reference.clear_tick()

    def sent(self, message: m.ToMember) -> None:
        """Note a message that both have been sent."""
        for state in self._states:
            state.sent(message)

    def in_its_form(self, message: m.ToMember) -> m.ToMember:
        """The message as the coordinator sends it to the member, which may decline columns."""
        if not self.is_plain:
            return message
        if isinstance(message, m.EvolveRequest) and MEMBER in message.asked:
            only = message.only or tuple(self._states[0].fragments)
            message = replace(message, asked=(MEMBER,), only=only)
        return plain_form(message)

    def receive(self, message: m.ToMember | m.Readings) -> list[m.FromMember | m.Readings]:
        """What the reference answers to a message. Raises Refusal."""
        try:
            answers = self._reference.receive(message)
        except Refusal:
            raise
        except Exception as error:
            error.add_note(f"in the reference of the case {self._case!r}")
            raise
        for answer in answers:
            if isinstance(answer, m.TickReply):
                self.saved[0] = answer.saved
        silent = "publishes" not in self._capabilities
        return [a for a in answers if not (silent and isinstance(a, m.Readings))]

    def compare(self, expected: Sequence[m.FromMember | m.Readings], link: MemberLink) -> None:
        """Compare the next messages of the member with these, in order. Raises CaseFailure."""
        wanted: list[str] = []
        received: list[str] = []
        for message in expected:
            figures = _required(message)
            wanted.append(text_of(message, self._states[0], figures))
            answer = link.next_message(link.limits.answer)
            if answer is None:
                limit = f"within {link.limits.answer:g} s"
                raise CaseFailure(f"no answer {limit}", wanted, received)
            if isinstance(answer, m.TickReply):
                self.saved[1] = answer.saved
            received.append(text_of(answer, self._states[1], figures))
            if received[-1] != wanted[-1]:
                raise CaseFailure("another answer than expected", wanted, received)


def _required(message: m.FromMember | m.Readings) -> list[str]:
    """The figures of a report that another member reports, too.

    The count of the views that it did not show is a figure of ours, not of the protocol.
    """
    figures = message.figures if isinstance(message, m.Report) else ()
    return [name for name in figures if not name.startswith(SHOWN_VIEWS)]
