"""Values of a file that a program wrote are those that were written, or the file is refused."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from offradar_ros.bounded_input import parse_yaml
from offradar_ros.config import Config, load_config, parameters, read_parameters, write_parameters
from offradar_ros.errors import ConfigError
from offradar_ros.records import read_tree
from offradar_ros.shipped import shipped_files
from offradar_ros.yaml_digest import AlteredError, check_digest, digest_line

VALUES = {leaf.name: leaf.value for leaf in parameters(Config())} | {'map.path': 'town.db', 'query.levels': 40}
SEED = 3


@pytest.fixture
def written(tmp_path: Path) -> Path:
    path = tmp_path / 'car.yaml'
    write_parameters(path, VALUES, 'Written by a test.', with_digest=True)
    return path


def test_what_is_written_is_read(written: Path) -> None:
    assert read_parameters(written) == VALUES


def test_a_flipped_bit_changes_nothing_or_is_refused(written: Path) -> None:
    content, random_, refused = written.read_bytes(), random.Random(SEED), 0
    for _ in range(300):
        damaged = bytearray(content)
        damaged[random_.randrange(len(content))] ^= 1 << random_.randrange(8)
        written.write_bytes(damaged)
        try:
            assert read_parameters(written) == VALUES
        except ConfigError as error:
            refused += 1
            assert str(error).startswith(f'{written}: ')
            assert len(str(error).splitlines()) == 1
    assert refused > 200


def test_who_edits_the_file_is_told_which_line_to_delete(written: Path) -> None:
    lines = written.read_text().replace('levels: 40', 'levels: 50').splitlines(keepends=True)
    written.write_text(''.join(lines))
    with pytest.raises(ConfigError, match='damaged, or if you changed it, delete its line "# digest'):
        load_config(written)
    written.write_text(''.join(line for line in lines if not line.startswith('# digest')))
    assert load_config(written).query.levels == 50


def test_comments_and_layout_may_change(written: Path) -> None:
    text = written.read_text()
    written.write_text('# mine\n' + text.replace('\n', '\r\n') + '# end\n')
    assert read_parameters(written) == VALUES


def test_a_value_that_json_does_not_have_is_covered() -> None:
    text = 'day: 2026-01-01\n'
    text = digest_line(parse_yaml(text)) + text
    check_digest(text, parse_yaml(text))
    damaged = text.replace('2026', '2027')
    with pytest.raises(AlteredError):
        check_digest(damaged, parse_yaml(damaged))


def test_files_to_edit_have_none(tmp_path: Path) -> None:
    write_parameters(tmp_path / 'all.yaml', VALUES)
    assert 'digest' not in (tmp_path / 'all.yaml').read_text()


def test_the_coefficients_that_ship_have_one() -> None:
    files = shipped_files('confidence')
    assert files
    for file in files:
        assert '# digest of the values below' in file.read_text()
        assert read_tree(file)
