"""Ids of a population with births in a pool: they are those of a plain list of texts."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import Ids
from minerva_bus.grammar import ids as module
from minerva_bus.grammar.ids import (
    SPARE,
    IdPool,
    Places,
    RowDelta,
    hashes_of,
    row_delta_of_ids,
    updated_ids,
)
from minerva_bus.world.context import hash_of

# Few different texts, so that the dead are born again and newborns have the ids of others.
TEXTS = st.sampled_from(
    [*(f"f{n}" for n in range(8)), *(f"f{n}:{k}" for n in range(4) for k in "12")]
)


@st.composite
def frames(draw):
    """The rows that a frame removes from a list of texts, and its newborns by their rows."""

    def of(texts: list[str]) -> tuple[RowDelta, list[str]]:
        gone = draw(st.sets(st.integers(0, len(texts) - 1)))
        least = 1 if len(gone) == len(texts) else 0
        born = draw(st.lists(TEXTS, min_size=least, max_size=6))
        after = len(texts) - len(gone) + len(born)
        rows = draw(st.sets(st.integers(0, after - 1), min_size=len(born), max_size=len(born)))
        return RowDelta(
            len(texts), np.array(sorted(gone), np.intp), np.array(sorted(rows), np.intp)
        ), born

    return of


def after(texts: list[str], row_delta: RowDelta, born: list[str]) -> list[str]:
    gone, newborn = (
        set(row_delta.gone.tolist()),
        dict(zip(row_delta.born.tolist(), born, strict=True)),
    )
    left = iter([text for row, text in enumerate(texts) if row not in gone])
    return [newborn[row] if row in newborn else next(left) for row in range(row_delta.after)]


def first_rows(texts: list[str], wanted: list[str]) -> list[int]:
    return [texts.index(text) if text in texts else -1 for text in wanted]


def check(ids: Ids, texts: list[str], wanted: list[str]) -> None:
    assert ids.texts() == texts == [ids[row] for row in range(len(texts))]
    assert ids == Ids.of(texts)
    assert hash(ids) == hash(Ids.of(texts))
    repeated = len(set(texts)) < len(texts)
    assert (ids.duplicate is not None) == repeated
    assert not (ids.distinct and repeated)
    assert ids.text_of(slice(None)) == "".join(f"{text}\n" for text in texts).encode()
    if not repeated:
        for others in (Ids.of(wanted), ids.take(slice(None, None, 2))):
            assert ids.rows_of(others).tolist() == first_rows(texts, others.texts())


@given(
    st.data(), st.lists(TEXTS, min_size=1, max_size=8, unique=True), st.sampled_from([63, 2, 1, 0])
)
def test_ids_in_a_pool_are_those_of_a_list(data, texts, bits):
    """Also if many ids have the same hash."""
    with patch.object(
        module,
        "hashes_of",
        lambda array: (
            hashes_of(array) >> np.uint64(64 - bits) if bits else hashes_of(array) * np.uint64(0)
        ),
    ):
        ids, branch = Ids.of(texts), data.draw(st.integers(0, 3))
        kept = ids, texts
        for number in range(5):
            row_delta, born = data.draw(frames())(texts)
            newborn = Ids.of(born) if born else None
            old, ids, texts = (
                ids,
                updated_ids(ids, row_delta, newborn),
                after(texts, row_delta, born),
            )
            check(ids, texts, data.draw(st.lists(TEXTS, max_size=5)))
            if not ids.duplicate and not old.duplicate:
                since = row_delta_of_ids(old, Ids.of(ids.texts()))
                assert (
                    since is None
                    or after(old.texts(), since, ids.take(since.born).texts()) == texts
                )
            if number == branch:
                kept = ids, texts
        # Another frame from an earlier state shares the pool with those that followed it.
        ids, texts = kept
        row_delta, born = data.draw(frames())(texts)
        changed = updated_ids(ids, row_delta, Ids.of(born) if born else None)
        check(changed, after(texts, row_delta, born), [])
        check(ids, texts, [])


@given(st.data(), st.lists(TEXTS, min_size=3, max_size=8, unique=True))
def test_rows_of_a_pool_can_be_replaced_and_joined(data, texts):
    ids = updated_ids(
        Ids.of(texts), RowDelta(len(texts), np.array([0]), np.array([1])), Ids.of(["a:1"])
    )
    texts = [texts[1], "a:1", *texts[2:]]
    others = data.draw(st.lists(TEXTS, min_size=2, max_size=2))
    replaced = ids.put(np.array([0, 2]), Ids.of(others))
    assert replaced.texts() == [others[0], "a:1", others[1], *texts[3:]]
    assert Ids.concatenated([ids, replaced]).texts() == [*texts, *replaced.texts()]
    assert Ids.concatenated([ids, Ids.of(others)]).texts() == [*texts, *others]
    rows = ids.differs(replaced)
    assert rows is not None
    assert rows.tolist() == [row for row, text in enumerate(texts) if replaced[row] != text]


def test_the_dead_leave_a_pool_that_has_many_of_them():
    ids = Ids.of([f"f{n}" for n in range(10)])
    for frame in range(3 * SPARE):
        ids = updated_ids(ids, RowDelta(10, np.array([0]), np.array([9])), Ids.of([f"f:{frame}-1"]))
    assert ids.texts() == [f"f:{frame}-1" for frame in range(3 * SPARE - 10, 3 * SPARE)]
    assert ids.pool is not None
    assert ids.pool.count <= 21 + SPARE


@given(st.lists(st.integers(0, 40), min_size=1, max_size=60), st.integers(1, 60))
def test_hashes_are_found_however_they_were_added(hashes, size):
    all_of_them = np.array(hashes, np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    places = Places(all_of_them[:size])
    for end in range(size + 7, len(hashes) + 7, 7):
        places.extend(all_of_them[:end], end - 7)
    wanted = np.arange(50, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    known = [hashes.index(n) if n in hashes else -1 for n in range(50)]
    assert places.rows_of(wanted).tolist() == known


def test_hashes_of_a_pool_are_those_of_the_texts():
    ids = updated_ids(
        Ids.of(["a", "b"]), RowDelta(2, np.array([0]), np.array([0])), Ids.of(["b:1"])
    )
    assert ids.hashes.tolist() == [hash_of("b:1"), hash_of("b")]


def test_equal_hashes_need_no_equal_ids():
    texts = np.array([b"a", b"b"])
    pool = IdPool.of(texts, np.array([1, 2], np.uint64))
    assert pool is not None
    assert pool.find(np.array([b"b", b"c", b"d"]), np.array([2, 1, 3], np.uint64)).tolist() == [
        1,
        -1,
        -1,
    ]
    assert pool.add(np.array([b"c"]), np.array([1], np.uint64)) is None
    assert pool.add(np.array([b"c", b"d"]), np.array([3, 3], np.uint64)) is None
    added = pool.add(np.array([b"long", b"a"]), np.array([4, 1], np.uint64))
    assert added is not None
    assert added.tolist() == [2, 0]
    assert IdPool.of(texts, np.array([1, 1], np.uint64)) is None
    with pytest.raises(IndexError):
        pool.texts(np.array([9]))
