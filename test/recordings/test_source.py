"""Opening a recording where not everything is installed."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from absent_packages import environment_without

OPEN = """
import sys
from pathlib import Path
from offradar_ros.errors import DataError
from offradar_ros.recordings.source import open_source
for path in sys.argv[1:]:
    try:
        print(len(open_source(Path(path))))
    except DataError as error:
        print(error)
"""


def test_folders_are_opened_without_rosbags_and_a_bag_asks_for_it(
    street_bag: Callable[..., Path], radiate_folder: Path, tmp_path: Path
) -> None:
    bag = street_bag('bag', count=2)
    environment = os.environ | environment_without(['rosbags'], tmp_path / 'absent')
    command = [sys.executable, '-c', OPEN, str(radiate_folder), str(bag)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    count, message = done.stdout.splitlines()
    assert count == '5'
    assert message.startswith(f"{bag}: a bag is read with the Python package rosbags: pip install 'rosbags>=0.11'")
