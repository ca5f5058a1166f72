"""A folder appears when it is complete, and no other file is lost."""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from offradar_ros.errors import DataError
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.bags.writer import BagOptions, write_bag
from offradar_ros.recordings.new_folder import new_folder


def fill(draft: Path, text: str = 'new') -> None:
    draft.mkdir()
    (draft / 'metadata.yaml').write_text(text)


@pytest.fixture
def old(tmp_path: Path) -> Path:
    fill(tmp_path / 'bag', 'old')
    return tmp_path / 'bag'


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_it_appears_at_the_end(tmp_path: Path) -> None:
    with new_folder(tmp_path / 'bag', overwrite=False) as draft:
        fill(draft)
        assert len(names(tmp_path)) == 1
        assert re.fullmatch(r'bag\.[0-9a-f]{16}\.partial', names(tmp_path)[0])
    assert names(tmp_path) == ['bag']


@pytest.mark.parametrize('error', [KeyboardInterrupt, DataError, OSError(28, 'No space left on device')])
def test_what_is_not_finished_is_removed_and_the_old_one_stays(old: Path, error: type[BaseException]) -> None:
    with pytest.raises((KeyboardInterrupt, DataError)), new_folder(old, overwrite=True) as draft:
        fill(draft)
        raise error
    assert names(old.parent) == ['bag']
    assert (old / 'metadata.yaml').read_text() == 'old'


def test_the_old_one_goes_when_the_new_one_is_in_place(old: Path) -> None:
    with new_folder(old, overwrite=True) as draft:
        fill(draft)
        assert (old / 'metadata.yaml').read_text() == 'old'
    assert names(old.parent) == ['bag']
    assert (old / 'metadata.yaml').read_text() == 'new'


def test_the_old_one_comes_back_where_the_new_one_cannot_be_moved(old: Path) -> None:
    with pytest.raises(DataError, match='cannot be written'), new_folder(old, overwrite=True):
        pass
    assert names(old.parent) == ['bag']
    assert (old / 'metadata.yaml').read_text() == 'old'


def test_a_link_to_a_bag_is_replaced_and_the_bag_stays(old: Path, tmp_path: Path) -> None:
    link = tmp_path / 'out'
    link.symlink_to(old)
    for text in ('first', 'second'):
        with new_folder(link, overwrite=True) as draft:
            fill(draft, text)
        assert not link.is_symlink()
        assert (link / 'metadata.yaml').read_text() == text
    assert names(tmp_path) == ['bag', 'out']
    assert (old / 'metadata.yaml').read_text() == 'old'


def test_what_cannot_be_removed_of_the_old_one_is_in_nobodys_way(old: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(path: Path, ignore_errors: bool = False) -> None:
        if not ignore_errors:
            raise PermissionError(13, 'Permission denied')

    with monkeypatch.context() as patched:
        patched.setattr('shutil.rmtree', fail)
        with new_folder(old, overwrite=True) as draft:
            fill(draft)
    (left,) = (name for name in names(old.parent) if name != 'bag')
    assert re.fullmatch(r'bag\.[0-9a-f]{16}\.partial', left)
    with new_folder(old, overwrite=True) as draft:
        fill(draft, 'newer')
    assert names(old.parent) == ['bag']
    assert (old / 'metadata.yaml').read_text() == 'newer'


def test_a_run_that_has_just_begun_is_not_disturbed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By one that looks for what others left, between the making of a folder and its lock."""
    lock = fcntl.flock

    def after_another(descriptor: int, operation: int) -> None:
        monkeypatch.setattr(fcntl, 'flock', lock)
        with new_folder(tmp_path / 'bag', overwrite=False) as other:
            fill(other, 'other')
        lock(descriptor, operation)

    monkeypatch.setattr(fcntl, 'flock', after_another)
    with new_folder(tmp_path / 'bag', overwrite=True) as draft:
        fill(draft)
    assert names(tmp_path) == ['bag']
    assert (tmp_path / 'bag' / 'metadata.yaml').read_text() == 'new'


def test_a_bag_can_be_written_over_its_own_source(street: Callable[..., Any], tmp_path: Path) -> None:
    bag = write_bag(street(count=3), tmp_path / 'bag')
    write_bag(BagSequence(bag), bag, BagOptions(overwrite=True))
    assert len(BagSequence(bag)) == 3
    assert names(tmp_path) == ['bag']


LEFT = 'bag.0123456789abcdef.partial'


@pytest.mark.parametrize('inner', [(), ('bag',)])
def test_what_an_earlier_run_left_is_removed(tmp_path: Path, inner: tuple[str, ...]) -> None:
    for name in inner:
        (tmp_path / LEFT / name).mkdir(parents=True)
    (tmp_path / LEFT).mkdir(exist_ok=True)
    with new_folder(tmp_path / 'bag', overwrite=False) as draft:
        fill(draft)
    assert names(tmp_path) == ['bag']


@pytest.mark.parametrize('name', ['thesis.tex', 'bag'])
def test_what_somebody_else_left_stays(tmp_path: Path, name: str) -> None:
    for folder in (LEFT, 'bag.partial', 'bag.mine.partial'):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / name).write_text('years of work')
    with new_folder(tmp_path / 'bag', overwrite=False) as draft:
        fill(draft)
    for folder in (LEFT, 'bag.partial', 'bag.mine.partial'):
        assert (tmp_path / folder / name).read_text() == 'years of work'


def test_links_are_not_followed(tmp_path: Path) -> None:
    (tmp_path / 'elsewhere' / 'bag').mkdir(parents=True)
    (tmp_path / 'elsewhere' / 'bag' / 'kept').write_text('kept')
    for link in (LEFT, 'bag.partial'):
        (tmp_path / link).symlink_to(tmp_path / 'elsewhere')
    with new_folder(tmp_path / 'bag', overwrite=False) as draft:
        fill(draft)
    assert names(tmp_path / 'elsewhere' / 'bag') == ['kept']
    assert names(tmp_path / 'bag') == ['metadata.yaml']
    (tmp_path / 'bag.replaced').symlink_to(tmp_path / 'elsewhere')
    with pytest.raises(DataError, match='in the way'), new_folder(tmp_path / 'bag', overwrite=True):
        pass
    assert names(tmp_path / 'elsewhere') == ['bag']


def test_two_runs_at_once_do_not_disturb_each_other(tmp_path: Path) -> None:
    with new_folder(tmp_path / 'bag', overwrite=True) as first:
        fill(first, 'first')
        with new_folder(tmp_path / 'bag', overwrite=True) as second:
            fill(second, 'second')
        assert (first / 'metadata.yaml').read_text() == 'first'
    assert names(tmp_path) == ['bag']
    assert (tmp_path / 'bag' / 'metadata.yaml').read_text() == 'first'


def test_what_appeared_in_the_meantime_is_not_replaced(tmp_path: Path) -> None:
    with pytest.raises(DataError, match='exists already'), new_folder(tmp_path / 'bag', overwrite=False) as draft:
        fill(draft)
        fill(tmp_path / 'bag', 'of another run')
    assert names(tmp_path) == ['bag']
    assert (tmp_path / 'bag' / 'metadata.yaml').read_text() == 'of another run'


def test_a_bag_moved_aside_and_a_link_at_its_place_are_in_the_way(tmp_path: Path) -> None:
    (tmp_path / 'bag.replaced').mkdir()
    with pytest.raises(DataError, match='left by a run that was cut off'), new_folder(tmp_path / 'bag', overwrite=True):
        pass
    assert (tmp_path / 'bag.replaced').exists()
    (tmp_path / 'link').symlink_to(tmp_path / 'nowhere')
    with pytest.raises(DataError, match='exists already'), new_folder(tmp_path / 'link', overwrite=False):
        pass


def test_it_is_on_the_disk_before_it_appears(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[Path] = []
    monkeypatch.setattr(os, 'fsync', lambda fd: synced.append(Path(f'/proc/self/fd/{fd}').readlink()))
    with new_folder(tmp_path / 'bag', overwrite=False) as draft:
        fill(draft)
        (draft / 'inner').mkdir()
        (draft / 'inner' / 'file').write_text('x')
    within = [path.relative_to(draft).as_posix() for path in synced if path.is_relative_to(draft)]
    assert sorted(within) == ['.', 'inner', 'inner/file', 'metadata.yaml']
    assert synced[-1] == tmp_path


@pytest.mark.parametrize('odd', ['', '.', '..', '/', 'a/..', 'nul\0', 'half\ud800', 'x' * 300, 'x' * 252])
def test_an_odd_path_is_one_line(
    street: Callable[..., Any], tmp_path: Path, odd: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for overwrite in (False, True):
        with pytest.raises(DataError) as refused:
            write_bag(street(count=2), odd, BagOptions(overwrite=overwrite))
        assert len(str(refused.value).splitlines()) == 1
    assert names(tmp_path) == []
