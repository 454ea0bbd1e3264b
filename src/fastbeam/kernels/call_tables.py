"""Call tables: pass the terms of a model, and the record that they share, to loops that are compiled once
(kernels/jit/calls.py)."""
from __future__ import annotations

import dis
from functools import cache
from typing import Any

import numpy as np

from fastbeam.kernels.jit.calls import CALLS, NO_TERM, NOTHING, Question, type_of
from fastbeam.kernels.jit.decorators import address_of, prepare
from fastbeam.kernels.jit.records import Record, RecordType, same_record
from fastbeam.kernels.jit.sources import is_term
from fastbeam.kernels.questions import BY_CONTACT
from fastbeam.kernels.terms import (
    NoTies,
    Shared,
    System,
    WithContact,
    WithMethod,
    accept,
    account,
    assemble,
    begin_contact,
    begin_step,
    clear,
    first_guess,
    put_loads,
    scale_residual,
    scale_solutions,
    spread_nodes,
    within_limits,
)

Array = np.ndarray
# words ahead of the entries (code, term): for each question the begin and the length of its list
HEAD = 1 + 2 * len(Question.all)
# parts of the system that terms read, from least to most
VIEWS = WithMethod, WithContact, System
# first argument of a question to the scene as a whole, and the least part of the system that its entries read
OF_SCENE: dict[str, Any] = {"dofs": WithMethod, "method": WithMethod, "contact": WithContact, "solver": System}
SCENE = [x for x in Question.all if x.names[0] in OF_SCENE]
TERMS = [x for x in Question.all if x.names[0] not in OF_SCENE and x.of is not put_loads]


def _numbers(*asked: Any) -> frozenset[int]:
    return frozenset(x.question.number for x in asked)


# questions to terms that add to equations, to all terms in an assembly, for a shape at rest, in an iteration, and in steps
ADDED = _numbers(assemble)
ASSEMBLY = _numbers(spread_nodes, clear, assemble, scale_residual, scale_solutions)
AT_REST = ASSEMBLY | _numbers(begin_step, begin_contact, first_guess)
OF_CONTACTS = {x for asked in BY_CONTACT.values() for x in asked}
EVERYTHING = frozenset(x.number for x in Question.all)
ITERATION = EVERYTHING - _numbers(account, accept, within_limits)
# (question, type of the term, type of the system) -> address
_ENTRIES: dict[tuple[int, Any, Any], int] = {}
# (type of the system, questions) -> words of a table
_SCENES: dict[Any, Array] = {}
# types of terms and system -> (words of a table, places of addresses of terms in it, their numbers)
_PLANS: dict[Any, tuple[Array, Array, Array]] = {}


@cache
def _does_nothing(function: Any) -> bool:
    """Return whether an implementation is empty."""
    steps = [x for x in dis.get_instructions(function.py_func) if x.opname not in ("RESUME", "NOP")]
    return len(steps) < 3 and all(x.argval is None for x in steps)


# type of the record that all scenes have in common, once there is one
_OF_ALL: list[RecordType] = []


class SystemRecord(Record):
    """Record of the data that all terms share, for loops that are independent of the scene.

    only: numbers of the questions that loops may ask: others are not answered.
    typed: the same memory for code that is compiled for the scene.
    views: types of the system for what reads only so much of it.
    """

    __slots__ = "typed", "views", "_words"

    def __init__(self, of: System, only: frozenset[int] = EVERYTHING) -> None:
        super().__init__(of)
        self.typed = Typed(self, self._numba_type_)
        self.views, self._numba_type_ = _views(self.typed._numba_type_, of)
        key = self.typed._numba_type_, only
        if key not in _SCENES:
            _SCENES[key] = _plan_of_scene(of, self.views, only)
        self._words = _SCENES[key].copy()
        self._words[0] = self.address
        # the first number of a system
        self._memory.view(np.int64)[0] = self._words.ctypes.data


def _plan_of_scene(of: System, views: dict[Any, RecordType], only: frozenset[int]) -> Array:
    """Return the words of the table of questions to a scene as a whole."""
    wanted = []
    for question in (x for x in SCENE if x.number in only):
        function = question.of.implementation(*(getattr(of, x, None) for x in question.names[:2]))
        least = max(OF_SCENE[question.names[0]], _reads(getattr(of, question.names[0])), key=VIEWS.index)
        wanted.append((question, NO_TERM, views[least], question.returns == NOTHING and _does_nothing(function)))
    return _words([question.number for question, *_ in wanted], _addresses(wanted))


def _words(numbers: list[int], codes: list[int]) -> Array:
    """Return a table of entries in the order of their questions, without addresses of terms."""
    words = np.zeros(HEAD + 2 * len(codes), np.int64)
    words[HEAD::2] = codes
    for number in dict.fromkeys(numbers):
        words[1 + 2 * number:3 + 2 * number] = HEAD + 2 * numbers.index(number), numbers.count(number)
    return words


def system_record(of: System, last: SystemRecord | None, only: frozenset[int] = EVERYTHING) -> SystemRecord:
    """Return a record of a system: the last one if it holds the same arrays and numbers."""
    return last if last is not None and same_record(of, last.of) else SystemRecord(of, only)


class Typed:
    """Memory of a record seen as a record of another type."""

    __slots__ = "of", "address", "_numba_type_", "_record"

    def __init__(self, record: Record, kind: RecordType) -> None:
        self.of, self.address, self._numba_type_, self._record = record.of, record.address, kind, record


class Calls:
    """Terms of a model for loops that are independent of the scene; only: numbers of the questions that loops may ask these
    terms: others find none."""

    def __init__(self, terms: tuple[Any, ...], only: frozenset[int] = EVERYTHING) -> None:
        self.terms, self._only = terms, only
        self._records = [Record(x) for x in terms]
        self._kinds = tuple(x._numba_type_ for x in self._records)
        self._table: Table | None = None

    def on(self, system: SystemRecord) -> tuple[Table, SystemRecord]:
        """Return the arguments of a loop: a table, made anew if the system is another one, and the system."""
        if self._table is None or self._table.system is not system:
            self._table = Table(system, self._records, *self._plan(system))
        return self._table, system

    def _plan(self, system: SystemRecord) -> tuple[Array, Array, Array]:
        key = self._kinds, system.typed._numba_type_, self._only
        if key not in _PLANS:
            wanted, who = [], []
            of_contact = BY_CONTACT[type(system.of.contact)]
            for question in TERMS:
                if question.number not in self._only or question.of in OF_CONTACTS and question.of not in of_contact:
                    continue
                second = type(system.of.method) if question.names[1] == "method" else System
                for k, (term, kind) in enumerate(zip(self.terms, self._kinds)):
                    function = question.of.of_classes(type(term), second)
                    if function is not None and not (question.returns == NOTHING and _does_nothing(function)):
                        least = WithContact if question.contact else WithMethod
                        wanted.append((question, kind, system.views[max(least, _reads(term), key=VIEWS.index)], False))
                        who.append(k)
            words = _words([question.number for question, *_ in wanted], _addresses(wanted))
            _PLANS[key] = words, np.arange(HEAD + 1, words.size, 2), np.array(who, np.int64)
        return _PLANS[key]


class Table:
    """Table of one model and one system."""

    _numba_type_ = CALLS

    def __init__(self, system: SystemRecord, records: list[Record], words: Array, places: Array, who: Array) -> None:
        # records live as long as this
        self.system, self._records = system, records
        self._words = words.copy()
        self._words[places] = np.array([x.address for x in records], np.int64)[who]
        self._words[0] = system.address
        self.address = self._words.ctypes.data
        self._given: tuple[Any, ...] = ()

    def give(self, given: tuple[Any, ...]) -> None:
        """Register the terms with loads in the next call of a loop (`put_loads`), some of which may be records."""
        records = [x if isinstance(x, Record) else Record(x) for x in given]
        question = put_loads.question
        codes = _addresses([(question, x._numba_type_, self.system.views[WithMethod], False) for x in records])
        entries = np.array([(code, x.address) for code, x in zip(codes, records)], np.int64).reshape(-1)
        self._words[1 + 2 * question.number:3 + 2 * question.number] = (entries.ctypes.data - self.address) // 8, len(given)
        self._given = entries, records


def _reads(term: Any) -> Any:
    """Return the class of the largest part of the system that a term reads; a term from another package may read all."""
    return getattr(term, "reads", System if is_term(type(term)) else WithMethod)


def _addresses(wanted: list[tuple[Question, Any, Any, bool]]) -> list[int]:
    """Return addresses of machine code of entries for types of a term and of the system; 0 if the last of the four says that the
    entry does nothing."""
    keys = [(question.number, kind, view) for question, kind, view, _ in wanted]
    missing = {key: (question.entry, (kind, view, *question.given.values())) for key, (question, kind, view, nothing)
               in zip(keys, wanted) if not nothing and key not in _ENTRIES}
    if missing:
        with prepare(list(missing.values()), "run"):
            # the second process does every other one, in their order
            order = [*missing][::2] + [*missing][1::2][::-1]
            _ENTRIES.update((key, address_of(*missing[key])) for key in order)
    return [0 if nothing else _ENTRIES[key] for key, (*_, nothing) in zip(keys, wanted)]


_VIEWS: dict[Any, tuple[dict[Any, RecordType], RecordType]] = {}


def _views(kind: RecordType, of: System) -> tuple[dict[Any, RecordType], RecordType]:
    """Return types of a system for code that reads part of it, and for loops."""
    if kind not in _VIEWS:
        increment = of.work.increment._replace(off=NoTies())
        least = RecordType(type_of(Shared(*of[:6], of.work._replace(increment=increment))))
        if not _OF_ALL:
            _OF_ALL.append(least)
        if least != _OF_ALL[0]:
            raise TypeError(f"arrays of a system have other types than those of all others: {least.of}, {_OF_ALL[0].of}")
        views = {x: RecordType(type_of(x(*of[:len(x._fields)]))) for x in (WithMethod, WithContact)}
        _VIEWS[kind] = {**views, System: kind}, _OF_ALL[0]
    return _VIEWS[kind]
