"""Journals of regions: their entries, cut off anywhere, and those that the coordinator keeps."""

import pytest

from minerva_bus.regions.journal import CHECKPOINT, COORDINATOR, KeptJournals, encoded, entries

ENTRIES = [(0, b"abc"), (COORDINATOR, b""), (7, bytes(300)), (CHECKPOINT, b"x")]


def journal(*listed):
    return b"".join(encoded(source, data) for source, data in listed)


def test_a_journal_has_the_entries_that_it_was_made_of_wherever_it_is_cut_off():
    whole, ends = journal(*ENTRIES), [0]
    for entry in ENTRIES:
        ends.append(ends[-1] + len(journal(entry)))
    for cut in range(len(whole) + 1):
        complete = sum(end <= cut for end in ends[1:])
        assert list(entries(whole[:cut])) == ENTRIES[:complete]


def test_reports_are_added_and_a_checkpoint_replaces_those_before():
    kept = KeptJournals({"region-1": journal((1, b"old"))})
    assert kept.of("region-0") is None
    kept.add("region-0", journal((1, b"a")))
    kept.add("region-0", journal((2, b"b"), (3, b"c")))
    kept.add("region-1", b"")
    assert kept.of("region-0") == journal((1, b"a"), (2, b"b"), (3, b"c"))
    assert kept.of("region-1") == journal((1, b"old"))
    kept.add("region-0", journal((CHECKPOINT, b"d"), (1, b"e")))
    assert kept.of("region-0") == journal((CHECKPOINT, b"d"), (1, b"e"))
    saved = kept.all()
    assert saved == {"region-0": kept.of("region-0"), "region-1": kept.of("region-1")}
    kept.add("region-0", journal((1, b"f")))
    again = KeptJournals(saved)
    again.add("region-1", journal((2, b"g")))
    assert again.of("region-0") == journal((CHECKPOINT, b"d"), (1, b"e"))
    assert kept.of("region-1") == journal((1, b"old"))


@pytest.mark.parametrize("reported", [b"", b"\1", journal((1, b"abc"))[:-1]])
def test_a_report_without_a_whole_entry_replaces_nothing(reported):
    kept = KeptJournals({"region-0": journal((1, b"a"))})
    kept.add("region-0", reported)
    assert kept.of("region-0") == journal((1, b"a")) + reported
