"""Answers the questions of operators: over the bus with their rights, and from other threads."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections.abc import Callable, Mapping

import zenoh

from minerva_bus.errors import MinervaError
from minerva_bus.runtime.admission import Admission
from minerva_bus.runtime.control import Command, Operated, answer
from minerva_bus.runtime.inbox import Question, question
from minerva_bus.runtime.questions import Questions
from minerva_bus.runtime.system import System
from minerva_bus.runtime.watchers import Asked
from minerva_bus.wire.keys import Keys, who_asks
from minerva_bus.wire.limits import Limits, check
from minerva_bus.wire.plain import as_map, pack, unpack


class Answers:
    """Checks and answers questions about one world, by its `commands`.

    `operated` is called before an answer is sent. `waiting` are the questions yet to be answered.
    """

    def __init__(
        self,
        world: Operated,
        keys: Keys,
        admission: Admission,
        limits: Limits,
        operated: Callable[[], None],
        system: System,
        commands: Mapping[str, Command],
    ) -> None:
        self.waiting = Questions(limits.questions, self._answer, keys.world, system)
        self._world = world
        self._keys = keys
        self._admission = admission
        self._most_bytes = limits.small_bytes
        self._operated = operated
        self._commands = commands

    def admit(self, query: zenoh.Query) -> Question | None:
        """The question of a query, or None where too many wait; called in a thread of Zenoh."""
        return self.waiting.hear(question(query))

    def take(self, item: Question | Asked) -> None:
        """Queue a question from the bus; answer one from another thread at once."""
        if isinstance(item, Question):
            self.waiting.add(item)
        else:
            item.later.set_result(answer(item.question, self._world, self._commands))

    def answer_due(self) -> None:
        """Answer the next question, if it is due."""
        self.waiting.answer_due()

    def _answer(self, question: Question) -> None:
        who, orders, key = who_asks(question.key, self._keys.world)
        try:
            check("a question", len(question.data), self._most_bytes, "bytes")
            asked = as_map(unpack(question.data), "a question")
            objection = self._admission.objection_to_question(who, orders, asked.get("ask"))
            reply = (
                {"error": objection} if objection else answer(asked, self._world, self._commands)
            )
        except MinervaError as error:
            reply = {"error": str(error)}
        self._operated()  # The journal contains the change before the operator is told of it.
        question.reply(key, pack(reply))
