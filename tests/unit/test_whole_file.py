"""What is written appears whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from evergym.whole_file import whole_file, write_whole


def test_an_interrupted_file_leaves_the_old_one_and_nothing_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    write_whole(path, "old\r\n")
    with pytest.raises(KeyboardInterrupt), whole_file(path) as draft:
        draft.write_text("half")
        assert path.read_bytes() == b"old\r\n"
        raise KeyboardInterrupt
    assert path.read_bytes() == b"old\r\n"
    assert list(tmp_path.iterdir()) == [path]


def test_a_draft_ends_as_the_file_does_and_takes_its_place(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    with whole_file(path, keep_ending=True) as draft, whole_file(path) as other:
        assert (draft.suffix, other.suffix) == (".mp4", ".part")
        assert draft.parent == other.parent == tmp_path
        draft.write_bytes(b"film")
        other.write_bytes(b"film")
    assert path.read_bytes() == b"film"
    write_whole(path, b"other")
    assert path.read_bytes() == b"other"
    assert list(tmp_path.iterdir()) == [path]


def test_where_nothing_can_be_written_the_error_is_the_systems(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        write_whole(tmp_path / "no_folder" / "file", "text")
